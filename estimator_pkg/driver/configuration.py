# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The observer and its gains for each joint: common values, and overrides per joint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from estimator_pkg.driver.joint import JointSettings, SensorSettings
from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.observers import instead
from estimator_pkg.observers.contract import Observer
from estimator_pkg.parameters import Parameter, build, declared

# What to do to have another observer's gain, with {0} for its name.
NAME_IT = "write 'observer: {0}' in the parameter file, or use --observer {0}"


class Configuration:
    """Checked values of an observer's gains and of the joint settings.

    Parameters
    ----------
    observer : the observer with these gains.
    common : values by parameter name, for every joint.
    overrides : joint name -> values by parameter name; others come from `common`.
    settings : declares the parameters of each joint in addition to the gains.

    Raises
    ------
    UsageError : an unknown name (the nearest one is suggested) or a value out of range.
    """

    def __init__(
        self,
        observer: Observer,
        common: Mapping[str, Any] | None = None,
        overrides: Mapping[str, Mapping[str, Any]] | None = None,
        settings: type[JointSettings] = SensorSettings,
    ) -> None:
        self.observer, self._settings = observer, settings
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
                hint = instead(name, known, self.observer, NAME_IT)
                raise UsageError(
                    f"unknown parameter '{name}' of {self.observer.name}: "
                    + (hint or suggestion(name, known))
                )
            known[name].check(value)
