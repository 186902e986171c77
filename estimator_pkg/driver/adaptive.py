# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Joints of the observer `adaptive`: known input, evidence, and start parameters."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from estimator_pkg.driver.bank import Bank, Line, Taken, taken
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.efforts import EFFORT_COMMAND, EFFORT_FIELD, Acting, DrivenSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.errors import UsageError
from estimator_pkg.estimate import NOT_OBSERVABLE
from estimator_pkg.observers.adaptive.evidence import Evidence
from estimator_pkg.observers.adaptive.report import IdentificationReport, Origin, report
from estimator_pkg.observers.adaptive.structure import structure
from estimator_pkg.observers.contract import Observer


class AdaptiveJoint(Joint):
    """A `Joint` that collects the evidence of its samples about the parameters.

    Parameters
    ----------
    observer, gains, settings : as in `Joint`.
    source : of the efforts: EFFORT_FIELD (in joint states) or EFFORT_COMMAND (on a topic).
    origin : origin of its start parameters, if they come from a file.

    Attributes
    ----------
    evidence : see `estimator_pkg.observers.adaptive.evidence`.
    unknown : the newest sample had no known input.
    """

    settings: DrivenSettings

    def __init__(
        self,
        observer: type[Observer],
        gains: Any,
        settings: DrivenSettings,
        source: str = EFFORT_FIELD,
        origin: Origin | None = None,
    ) -> None:
        super().__init__(observer, gains, settings)
        self._acting, self.unknown = Acting(1, source, settings), False
        self.origin = origin
        self.evidence = Evidence(structure(gains).slowest, gains.memory)

    def set_gains(self, gains: Any) -> None:
        """See `Joint`."""
        super().set_gains(gains)
        self.evidence.memory = gains.memory

    def take(self, stamp_ns: int, position: float, effort: float) -> bool:
        """Take a sample with the effort of its message, nan: none; return True if it was used."""
        (known_input,) = self._acting.known_input(self.stamp_ns, stamp_ns, (effort,), self.settings)
        self.unknown = not math.isfinite(known_input)
        # counted as such: half a sample is none
        return self.update(stamp_ns, math.nan if self.unknown else position, known_input)

    def command(self, stamp_ns: int, effort: float) -> None:
        """Take an effort_command."""
        self._acting.command(0, stamp_ns, effort)

    def update(self, stamp_ns: int, measurement: Any, known_input: Any = 0.0) -> bool:
        """Take one sample; see `Joint`."""
        used = super().update(stamp_ns, measurement, known_input)
        self.evidence.look(self.state.adapted, self.state.sums)
        return used

    def why_silent(self) -> str:
        """Return why no sample can be used, if its input is the reason, else ''."""
        return self._acting.why_unknown() if self.unknown else ''

    @property
    def needs_motion(self) -> bool:
        """See `Joint`."""
        return self.estimate()[3] == NOT_OBSERVABLE

    def report(self) -> IdentificationReport:
        """Return the identified parameters."""
        return report(
            self.gains, self.design, self.state, self.mean_dt or 1e-3, self.evidence, self.origin
        )


class AdaptiveConfiguration(Configuration):
    """Gains per joint, with start parameters from a file for the joints that it contains.

    Parameters
    ----------
    observer, common, overrides : as in `Configuration`.
    saved : joint -> its entry in the file (see `estimator_pkg.driver.identified`).

    Raises
    ------
    UsageError : a wrong value, or saved parameters of another order or with parts (load, gravity)
        that these gains lack.
    """

    def __init__(
        self,
        observer: type[Observer],
        common: Mapping[str, Any] | None = None,
        overrides: Mapping[str, Mapping[str, Any]] | None = None,
        saved: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> None:
        super().__init__(observer, common, overrides, DrivenSettings)
        self.saved = dict(saved or {})
        for joint in self.saved:
            self.for_joint(joint)

    def for_joint(self, joint: str) -> tuple[Any, Any]:
        """Return (gains, settings) of this joint."""
        gains, settings = super().for_joint(joint)
        own = self.saved.get(joint)
        if own is None or gains.theta is not None:
            return gains, settings
        if own['order'] != gains.order:
            raise UsageError(
                f"saved parameters of joint '{joint}' have order {own['order']}, "
                f'but order is {gains.order}: set order to {own["order"]}'
            )
        for word, has in (('load', gains.load), ('gravity', gains.gravity)):
            if own.get(word, 0.0) != 0.0 and not has:
                raise UsageError(
                    f"saved parameters of joint '{joint}' have a {word}: set {word} to true"
                )
        model = structure(gains).model
        theta = [a - known for a, known in zip(own['a'], model)] + list(own['b'])
        if gains.load:
            theta.append(own.get('load', 0.0))
        if gains.gravity:
            theta.append(own.get('gravity', 0.0))
        return dataclasses.replace(gains, theta=tuple(theta)), settings

    def origin(self, joint: str) -> Origin | None:
        """Return the origin of a joint's start parameters; None if they are not from the file."""
        own = self.saved.get(joint)
        if own is None or super().for_joint(joint)[0].theta is not None:
            return None
        return Origin(tuple(own.get('stddev', ())), own.get('trusted', True))


class AdaptiveBank(Bank):
    """As `Bank`, for positions with efforts.

    A node or a replay calls `take` once for each message of joint states, in order of arrival, and
    publishes the estimates that it returns. `reports()` returns, at 10 Hz of stamp time, the
    identified parameters, and `identified` saves them. To freeze the parameters, make a
    configuration with `adapt: false` and call `joint.set_gains` with each joint's new gains.

    Parameters
    ----------
    configuration, only, most : as in `Bank`.
    source : as in `AdaptiveJoint`.
    """

    configuration: AdaptiveConfiguration

    def __init__(
        self,
        configuration: AdaptiveConfiguration,
        only: Iterable[str] = (),
        source: str = EFFORT_FIELD,
        most: int | None = None,
    ) -> None:
        super().__init__(configuration, only, most)
        self._source = source
        self.without_input = 0  # messages with positions but without efforts

    def _make(self, name: str) -> AdaptiveJoint:
        gains, settings = self.configuration.for_joint(name)
        origin = self.configuration.origin(name)
        observer = self.configuration.observer
        return AdaptiveJoint(observer, gains, settings, self._source, origin)

    def take(
        self,
        stamp_ns: int,
        names: Sequence[str],
        positions: Sequence[float],
        efforts: Sequence[float],
    ) -> Taken | None:
        """Take one message; return None (and count it) if its arrays do not fit.

        Parameters
        ----------
        positions, efforts : as in a JointState; efforts of EFFORT_COMMAND arrive by `command`.
        """
        if not self.fits(names, positions):
            return None
        commanded = self._source == EFFORT_COMMAND
        if not commanded and len(efforts) != len(names):
            self.without_input += 1
            self.mismatched += 1
            return None
        names, positions, efforts = self.selected(names, positions, efforts)
        joints: list[Any] = [self.joint(name) for name in names]
        of_field = (math.nan,) * len(names) if commanded else efforts
        estimates = [
            joint.estimate() if joint and joint.take(stamp_ns, position, effort) else None
            for joint, position, effort in zip(joints, positions, of_field)
        ]
        return taken(names, estimates, efforts, Line(names, joints), positions)

    def command(self, stamp_ns: int, names: Sequence[str], efforts: Sequence[float]) -> None:
        """Take one effort_command; it is unused for a joint that had no position yet."""
        for name, effort in zip(names, efforts):
            if name in self.joints:
                self.joints[name].command(stamp_ns, effort)

    def why_silent(self, name: str) -> str:
        """Return why no sample of this joint can be used, if its input is the reason, else ''."""
        return str(self.joints[name].why_silent()) if name in self.joints else ''

    def unit(self, name: str) -> str:
        """Return the unit of this joint's input; empty: not known."""
        return str(self.joints[name].settings.input_unit)

    def reports(self) -> dict[str, IdentificationReport]:
        """Return the identified parameters of each joint."""
        return {name: joint.report() for name, joint in self.joints.items() if joint.used}
