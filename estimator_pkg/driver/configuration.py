# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What is set for each joint: settings, gains, common values and overrides per joint."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.observers import instead
from estimator_pkg.observers.contract import Observer
from estimator_pkg.parameters import Parameter, build, declared, structural
from estimator_pkg.sensor.guard import GuardSettings

# What to do to have another observer's gain, with {0} for its name.
SELECT_OBSERVER = "write 'observer: {0}' in the parameter file, or use --observer {0}"


@dataclass(frozen=True)
class JointSettings(GuardSettings):
    """Parameters per joint in addition to the observer's gains."""

    wrap_period: float = structural(
        2.0 * math.pi,
        unit='rad',
        range=(0.0, 1e6),
        description='period after which the reading repeats; 0: prismatic or multi-turn joint, '
        'without wrapping',
    )
    unwrap: bool = structural(
        False, description='count turns from the first sample and publish a multi-turn position'
    )


AS_RATE, AS_ANGLE = 'rate', 'angle'  # kinds of sources


@dataclass(frozen=True)
class SourceSettings:
    """Parameters of one source."""

    topic: str = structural('', description='topic of the messages; automatic: the name')
    field_type: str = structural(
        'sensor_msgs/msg/Imu', description='their type; any that is installed where the node runs'
    )
    field: str = structural(
        'angular_velocity.z', description='the number in these messages, as in velocity[0]'
    )
    kind: str = structural(
        AS_RATE,
        choices=(AS_RATE, AS_ANGLE),
        description='what the number is: rate (gyro, tachometer, velocity of a drive) [rad/s] or '
        'angle (second encoder) [rad]',
    )
    joint: str = structural('', description='the joint that it is of; automatic: every joint')
    ratio: float = structural(
        1.0,
        range=(-1e6, 1e6),
        description="the joint's motion over that of the source: 0.0175 of a gyro in deg/s, -1 of "
        'one that is reversed; `doctor` finds it',
    )
    delay: float = structural(
        0.0,
        unit='s',
        range=(-0.5, 0.5),
        description='of its stamps behind those of the angle; `doctor` finds it',
    )


class Configuration:
    """Checked values of an observer's gains and of the joint settings.

    Parameters
    ----------
    observer : the observer with these gains.
    common : values by parameter name, for every joint.
    overrides : joint name -> values by parameter name; others come from `common`.
    settings : declares the parameters of each joint in addition to the gains.
    remedy : how a user selects another observer, with {0} for its name.

    Raises
    ------
    UsageError : an unknown name (the nearest one is suggested) or a value out of range.
    """

    def __init__(
        self,
        observer: type[Observer],
        common: Mapping[str, Any] | None = None,
        overrides: Mapping[str, Mapping[str, Any]] | None = None,
        settings: type[JointSettings] = JointSettings,
        remedy: str = SELECT_OBSERVER,
    ) -> None:
        self.observer, self._settings, self._remedy = observer, settings, remedy
        self.common = dict(common or {})
        self.overrides = {joint: dict(values) for joint, values in (overrides or {}).items()}
        for values in (self.common, *self.overrides.values()):
            self._check(values)

    def for_joint(self, joint: str) -> tuple[Any, JointSettings]:
        """Return (gains, settings) of this joint."""
        values = {**self.common, **self.overrides.get(joint, {})}
        gains = {name: value for name, value in values.items() if name in self._gains}
        settings = {name: value for name, value in values.items() if name not in self._gains}
        return (
            build(self.observer.gains, gains, owner=self.observer.name),
            build(self._settings, settings),
        )

    def parameters(self) -> dict[str, Parameter]:
        """Return all parameters by name: the gains first, then the joint settings."""
        return {**self._gains, **declared(self._settings)}

    @property
    def _gains(self) -> dict[str, Parameter]:
        return declared(self.observer.gains)

    def _check(self, values: Mapping[str, Any]) -> None:
        known = self.parameters()
        for name, value in values.items():
            if name not in known:
                hint = instead(name, known, self.observer, self._remedy)
                raise UsageError(
                    f"unknown parameter '{name}' of {self.observer.name}: "
                    + (hint or suggestion(name, known))
                )
            known[name].check(value)
