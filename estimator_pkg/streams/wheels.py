# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The wheels of a base: the node `wheel_odometry`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.bank import Bank, Taken
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.wheels import Geometry, WheelObserver, WheelOdometry
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.estimate import VALID
from estimator_pkg.messages import odometry
from estimator_pkg.messages.field import Field
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.observers.contract import Observer
from estimator_pkg.parameters import structural
from estimator_pkg.streams.answer import Answering
from estimator_pkg.streams.contract import (
    ESTIMATE,
    PUBLISHER,
    STDDEV,
    Answer,
    Output,
    Port,
    Request,
    Stream,
    StreamSettings,
)
from estimator_pkg.streams.sources import JointStates

ODOMETRY = Output('odometry', odometry.TYPE, on_demand=True)


@dataclass(frozen=True)
class WheelSettings(Geometry, StreamSettings):
    """Parameters of the node `wheel_odometry`, without those of its observer."""

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
        'base_link',
        description='frame of the twist: its origin is midway between the (rear) wheels',
    )
    stamp_source: str = structural(
        'header',
        choices=('header', 'publisher'),
        description='time of a message: its header stamp, or the time of publishing',
    )

    def find_observer(self) -> type[Observer]:
        """Return the observer; raise UsageError for a base that is none."""
        self.check()
        return WheelObserver


class WheelStream(Stream):
    """See `Stream`."""

    KIND = 'wheels'
    NODE = 'wheel_odometry'
    SETTINGS = WheelSettings
    bank: Bank
    settings: WheelSettings

    def __init__(self, settings: WheelSettings, configuration: Configuration) -> None:
        inputs = [Port('joint_states', JOINT_STATE)]
        if settings.gyro_topic:
            if settings.gyro_ratio == 0.0:
                raise UsageError("'gyro_ratio' is 0: set 1.0, or another factor to rad/s")
            inputs.append(
                Port(
                    settings.gyro_topic, settings.gyro_type, False, True, field=settings.gyro_field
                )
            )
        bank = Bank(configuration, settings.names)
        super().__init__(settings, WheelObserver, bank, inputs, (ESTIMATE, STDDEV, ODOMETRY))
        of_wheel = configuration.for_joint(settings.wheels_left[0])[1]
        ratio = settings.gyro_ratio if settings.gyro_topic else 0.0
        self.base = WheelOdometry(settings, ratio, of_wheel.wrap_period, of_wheel.timeout)
        self._sample = JointStates(settings.stamp_source == PUBLISHER).sample
        self._answering = Answering(self)
        self._field: Field

    def read_field(self, field: Field, port: int = 0) -> None:
        """See `Stream`."""
        if port == 0:
            super().read_field(field)
        self._field = field

    def take(self, port: int, raw: bytes, publish_ns: int) -> Iterable[Answer]:
        """See `Stream`."""
        if port:
            stamp_ns, _, value = self._field.decode(raw)
            if value is not None and self.base.gyro is not None:
                by_publisher = stamp_ns is None or self.settings.stamp_source == PUBLISHER
                self.base.gyro.receive(publish_ns if by_publisher else stamp_ns or 0, value)
            return ()
        stamp_ns, frame_id, names, positions, efforts = self._sample(raw, publish_ns)
        taken = self.bank.update(stamp_ns, names, positions, efforts)
        answer = self._answering(stamp_ns, frame_id, taken)
        return chain((answer,), self._of_base(stamp_ns, taken))

    def _of_base(self, stamp_ns: int, taken: Taken | None) -> Iterator[Answer]:
        """Move the base and give its odometry, after the estimates of its wheels have left."""
        joints = None if taken is None else self._joints(taken)
        if joints is not None:
            self.base.update(stamp_ns, joints)
            if self.wanted[2]:
                yield {2: self._odometry(stamp_ns)}

    def _odometry(self, stamp_ns: int) -> bytes:
        base, settings = self.base, self.settings
        assert base.twist is not None
        (speed, across), (_, rate) = base.twist_covariance.tolist()
        return odometry.encode(
            stamp_ns,
            (settings.frame_id, settings.child_frame_id),
            base.pose.tolist(),
            base.covariance.tolist(),
            (base.twist[0], 0.0, base.twist[1]),
            ((speed, 0.0, across), (0.0, speed, 0.0), (across, 0.0, rate)),
        )

    def _joints(self, taken: Taken) -> NDArray[np.float64] | None:
        """Return the joints as `Base.update` takes them; None: one is not tracked yet."""
        names, found = self.settings.names, np.zeros((len(self.settings.names), 5))
        places = [taken.names.index(name) for name in names if name in taken.names]
        shown = [taken.estimates[k] for k in places]
        if len(places) < len(names) or any(each is None or each[3] not in VALID for each in shown):
            return None
        found[:, :3] = np.nan_to_num([each[:3] for each in shown if each is not None])
        found[:, 3:] = taken.stddevs(places)
        return found if np.isfinite(found).all() else None

    # Texts

    def reset(self) -> str:
        """See `Stream`; the pose is zero again, and what was learnt of the gyro stays."""
        self.base.reset()
        return f'{super().reset()}; the pose is zero'

    def needed(self) -> set[str]:
        """See `Stream`."""
        return {*super().needed(), *self.settings.names}

    def about(self, name: str) -> Mapping[str, Any]:
        """See `Stream`."""
        return {'slip': self.base.slips or 'none', 'base': self.base.text()}

    def notices(self) -> list[str]:
        """See `Stream`."""
        new, self.base.notices = self.base.notices, []
        return [*super().notices(), *new]

    def _summary_of(self, name: str, joint: Any) -> dict[str, Any]:
        base = {'base': self.base.text()} if name == self.settings.names[0] else {}
        return {**super()._summary_of(name, joint), 'sources': base}

    def finish(self, path: str) -> list[str]:
        """See `Stream`."""
        names = self.settings.names
        missing = [name for name in names if name not in self.bank.joints]
        if missing:
            raise UserError(
                f"topic '{self.topics[0]}' of {path} has no joint '{missing[0]}': name the wheels "
                "in 'wheels_left' and 'wheels_right'"
            )
        if self.base.twist is not None:
            return []
        return [
            f'{path}: no message has an estimate of all of {", ".join(names)}: publish them at once'
        ]

    @classmethod
    def requested(
        cls, values: dict[str, Any], request: Request, has: Callable[[str], bool]
    ) -> dict[str, Any]:
        """See `Stream`."""
        if request.angle or request.joints:
            raise UsageError(
                '--angle and --joint are for observers of single angles: name the wheels with '
                "--set 'wheels_left=[...]'"
            )
        return values
