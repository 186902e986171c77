# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The wheels of a base: the node `wheel_odometry`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Any

from estimator_pkg.driver.bank import Bank, Taken
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.pairs import Pairing
from estimator_pkg.errors import UsageError
from estimator_pkg.estimate import VALID
from estimator_pkg.messages import odometry
from estimator_pkg.messages.field import Field
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.wheels import Geometry, WheelObserver, WheelOdometry
from estimator_pkg.parameters import structural
from estimator_pkg.streams.answer import Answering
from estimator_pkg.streams.contract import (
    ESTIMATE,
    PUBLISHER,
    STDDEV,
    Answer,
    Output,
    Port,
    Stream,
    StreamSettings,
)
from estimator_pkg.streams.sources import JointStates

ODOMETRY = Output('odometry', odometry.TYPE, on_demand=True)


@dataclass(frozen=True)
class WheelSettings(Geometry, StreamSettings):
    """Parameters of the node `wheel_odometry`, without those of its observer."""

    wheels_left: tuple[str, ...] = structural(
        ('wheel_left_joint',), description='names of the wheel joints on the left, one or two'
    )
    wheels_right: tuple[str, ...] = structural(
        ('wheel_right_joint',), description='names of the wheel joints on the right, as many'
    )
    gyro_topic: str = structural('', description='topic of a gyro on the base; automatic: no gyro')
    gyro_type: str = structural(
        'sensor_msgs/msg/Imu', description='type of its messages; any that is installed'
    )
    gyro_field: str = structural(
        'angular_velocity.z', description='the yaw rate in them, positive to the left'
    )
    gyro_ratio: float = structural(
        1.0,
        range=(-1e6, 1e6),
        description='factor to rad/s, as 0.0174533 for deg/s; -1.0 for a gyro that is upside down',
    )
    frame_id: str = structural('odom', description='frame of the pose in ~/odometry')
    child_frame_id: str = structural(
        'base_link', description='frame of the twist: its origin is midway between the wheels'
    )
    stamp_source: str = structural(
        'header',
        choices=('header', 'publisher'),
        description='time of a message: its header stamp, or the time of publishing',
    )

    @property
    def names(self) -> tuple[str, ...]:
        """All wheels, left ones first."""
        return (*self.wheels_left, *self.wheels_right)

    def find_observer(self) -> type[Observer]:
        """Return the observer; raise UsageError for a base that is none."""
        for name, example in (('radius', '[0.05]'), ('track', '0.3')):
            if getattr(self, name) is None:
                raise UsageError(f"parameter '{name}' is not set: set it [m], as in {example}")
        if len(self.radius or ()) > 2:
            raise UsageError(
                f"'radius' has {len(self.radius or ())} numbers: set one, or left and right"
            )
        left, right = len(self.wheels_left), len(self.wheels_right)
        if left != right or left > 2 or '' in self.names or len(set(self.names)) < len(self.names):
            raise UsageError(
                f"'wheels_left' has {left} names and 'wheels_right' {right} of the joints "
                f'{", ".join(map(repr, self.names))}: set one or two for each side, as many on '
                'both, each another joint'
            )
        if self.gyro_ratio == 0.0:
            raise UsageError("'gyro_ratio' is 0: set 1.0, or another factor to rad/s")
        return WheelObserver


class WheelStream(Stream):
    """See `Stream`."""

    KIND = 'wheels'
    NODE = 'wheel_odometry'
    SETTINGS = WheelSettings
    NAME_THEM = "name the wheels with --set 'wheels_left=[...]'"
    bank: Bank
    settings: WheelSettings

    def __init__(self, settings: WheelSettings, configuration: Configuration) -> None:
        inputs = [Port('joint_states', JOINT_STATE)]
        if settings.gyro_topic:
            topic, kind, field = settings.gyro_topic, settings.gyro_type, settings.gyro_field
            inputs.append(Port(topic, kind, answered=False, optional=True, field=field))
        bank = Bank(configuration, settings.names)
        super().__init__(settings, WheelObserver, bank, inputs, (ESTIMATE, STDDEV, ODOMETRY))
        of_wheel = configuration.for_joint(settings.wheels_left[0])[1]
        gyro = bool(settings.gyro_topic)
        self.base = WheelOdometry(settings, gyro, of_wheel.wrap_period, of_wheel.timeout)
        self._sample = JointStates(settings.stamp_source == PUBLISHER).sample
        self._answering = Answering(self)
        self._pairing = Pairing(len(settings.names))
        self._field: Field

    def read_field(self, field: Field, port: int = 0) -> None:
        """See `Stream`."""
        if port == 0:
            super().read_field(field)
        self._field = field

    def take(self, port: int, raw: bytes, publish_ns: int) -> Iterable[Answer]:
        """See `Stream`."""
        by_publisher = self.settings.stamp_source == PUBLISHER
        if port:
            stamp_ns, _, value = self._field.decode(raw)
            if value is not None and self.base.gyro is not None:
                at_ns = publish_ns if stamp_ns is None or by_publisher else stamp_ns
                self.base.gyro.receive(at_ns, self.settings.gyro_ratio * value)
            return ()
        stamp_ns, frame_id, names, positions, efforts = self._sample(raw, publish_ns)
        taken = self.bank.update(stamp_ns, names, positions, efforts)
        return chain((self._answering(stamp_ns, frame_id, taken),), self._of_base(stamp_ns, taken))

    def _of_base(self, stamp_ns: int, taken: Taken | None) -> Iterator[Answer]:
        """Move the base once all wheels are new, after the estimates of this message have left."""
        if taken is None:
            return
        valid = {k: each for k, each in enumerate(taken.estimates) if each and each[3] in VALID}
        found = self._pairing.put(
            stamp_ns,
            {
                self.settings.names.index(taken.names[k]): (stamp_ns, [*each[:3], *sigmas])
                for (k, each), sigmas in zip(valid.items(), taken.stddevs([*valid]))
                if math.isfinite(sum(sigmas))
            },
        )
        if found is None:
            return
        stamps_ns, wheels = zip(*(found.parts[k] for k in range(len(self.settings.names))))
        stamp_ns = max(stamps_ns)
        self.base.update(stamp_ns, [(stamp_ns - each) * 1e-9 for each in stamps_ns], wheels)
        if self.wanted[2]:
            yield {2: self._odometry(stamp_ns)}

    def _odometry(self, stamp_ns: int) -> bytes:
        base, settings = self.base, self.settings
        (speed, across), (_, rate) = base.twist_covariance.tolist()
        return odometry.encode(
            stamp_ns,
            (settings.frame_id, settings.child_frame_id),
            base.pose.tolist(),
            base.covariance.tolist(),
            (base.twist[0], 0.0, base.twist[1]),
            ((speed, 0.0, across), (0.0, speed, 0.0), (across, 0.0, rate)),
        )

    # Texts

    def reset(self) -> str:
        """See `Stream`; the pose is zero again, and the gyro's bias is forgotten."""
        self.base.reset()
        self._pairing.waiting.clear()
        return f'{super().reset()}; the pose is zero'

    def needed(self) -> set[str]:
        """See `Stream`."""
        return {*super().needed(), *self.settings.names}

    def about(self, name: str) -> Mapping[str, Any]:
        """See `Stream`."""
        return {'base': self.base.text()}

    def notices(self) -> list[str]:
        """See `Stream`."""
        new, self.base.notices = self.base.notices, []
        return [*super().notices(), *new]

    def _summary_of(self, name: str, joint: Any) -> dict[str, Any]:
        base = {'base': self.base.text()} if name == self.settings.names[0] else {}
        return {**super()._summary_of(name, joint), 'sources': base}

    def finish(self, path: str) -> list[str]:
        """See `Stream`."""
        self.require(path, self.settings.names, self.bank.joints)
        return []
