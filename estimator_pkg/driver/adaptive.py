# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Joints of the observer `adaptive`: known input, evidence, and start parameters."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.bank import Bank, Line, Taken, taken
from estimator_pkg.driver.batch import Estimates
from estimator_pkg.driver.configuration import Configuration, JointSettings
from estimator_pkg.driver.efforts import EFFORT_COMMAND, EFFORT_FIELD, Acting, DrivenSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.errors import UsageError
from estimator_pkg.estimate import NOT_OBSERVABLE
from estimator_pkg.observers.adaptive.evidence import Evidence
from estimator_pkg.observers.adaptive.report import IdentificationReport, Origin, report
from estimator_pkg.observers.adaptive.structure import structure
from estimator_pkg.observers.contract import Observer

PIECE_BLOCKS = 0.25  # length of a batch, in blocks of evidence


class AdaptiveJoint(Joint):
    """A `Joint` that collects the evidence of its samples about the parameters.

    Parameters
    ----------
    observer, gains, settings : as in `Joint`.

    Attributes
    ----------
    evidence : see `estimator_pkg.observers.adaptive.evidence`.
    origin : origin of its start parameters, if they come from a file.
    """

    def __init__(self, observer: type[Observer], gains: Any, settings: JointSettings) -> None:
        super().__init__(observer, gains, settings)
        self.evidence = Evidence(structure(gains).slowest, gains.memory)
        self.origin: Origin | None = None

    def set_gains(self, gains: Any) -> None:
        """See `Joint`."""
        super().set_gains(gains)
        self.evidence.memory = gains.memory

    def update(self, stamp_ns: int, measurement: Any, known_input: Any = 0.0) -> bool:
        """Take one sample; see `Joint`."""
        used = super().update(stamp_ns, measurement, known_input)
        self._look()
        return used

    def run(
        self,
        stamps: NDArray[np.int64],
        measurements: NDArray[np.float64],
        known_input: NDArray[np.float64] | None = None,
    ) -> Estimates:
        """As `Joint.run`, piece by piece: blocks of evidence end where a piece does.

        Arrays of shape (n,): stamps [ns], measurements [rad or m], known_input [its unit].
        """
        pieces: list[Estimates] = []
        begin = 0
        while begin < len(stamps) or not pieces:
            length_ns = round(PIECE_BLOCKS * self.evidence.length * 1e9)
            end = len(stamps) and begin + 1 + int(
                np.searchsorted(stamps[begin + 1 :], stamps[begin] + length_ns)
            )
            part = slice(begin, end)
            pieces.append(
                super().run(
                    stamps[part],
                    measurements[part],
                    None if known_input is None else known_input[part],
                )
            )
            self._look()
            begin = end
        return Estimates(*(np.concatenate(column) for column in zip(*pieces)))

    @property
    def needs_motion(self) -> bool:
        """See `Joint`."""
        return self.estimate()[3] == NOT_OBSERVABLE

    def report(self) -> IdentificationReport:
        """Return the identified parameters."""
        return report(
            self.gains, self.design, self.state, self.mean_dt or 1e-3, self.evidence, self.origin
        )

    def _look(self) -> None:
        state = self.state
        self.evidence.look(state.adapted, state.sums)


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

    def for_joint(self, joint: str) -> tuple[Any, JointSettings]:
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
    source : of the efforts: EFFORT_FIELD (in joint states) or EFFORT_COMMAND (on a topic).
    """

    def __init__(
        self,
        configuration: Configuration,
        only: Iterable[str] = (),
        source: str = EFFORT_FIELD,
        most: int | None = None,
    ) -> None:
        super().__init__(configuration, only, most)
        self._source = source
        self._acting: dict[str, Acting] = {}
        self.unknown: set[str] = set()  # joints without a known input at their newest sample
        self.without_input = 0  # messages with positions but without efforts

    def _make(self, name: str) -> Joint:
        made = AdaptiveJoint(self.configuration.observer, *self.configuration.for_joint(name))
        if isinstance(self.configuration, AdaptiveConfiguration):
            made.origin = self.configuration.origin(name)
        return made

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
        if self._source != EFFORT_COMMAND and len(efforts) != len(names):
            self.without_input += 1
            self.mismatched += 1
            return None
        names, positions, efforts = self.selected(names, positions, efforts)
        joints: list[Any] = []
        estimates: list[tuple[float, float, float, int] | None] = []
        commanded = (math.nan,) * len(names)
        for name, position, effort in zip(
            names, positions, commanded if self._source == EFFORT_COMMAND else efforts
        ):
            joint: Any = self.joints.get(name) or self.joint(name)
            joints.append(joint)
            estimates.append(
                joint.estimate()
                if joint is not None and self._update(name, joint, stamp_ns, position, effort)
                else None
            )
        return taken(names, estimates, efforts, Line(names, joints), positions)

    def _update(
        self, name: str, joint: Joint, stamp_ns: int, position: float, effort: float
    ) -> bool:
        """One sample of a joint in; True if it was used."""
        settings: Any = joint.settings
        (known_input,) = self._acting_on(name).known_input(
            joint.stamp_ns, stamp_ns, (effort,), settings
        )
        if math.isfinite(known_input):
            self.unknown.discard(name)
        else:
            position = math.nan  # counted as such: half a sample is none
            self.unknown.add(name)
        return joint.update(stamp_ns, position, known_input)

    def command(self, stamp_ns: int, names: Sequence[str], efforts: Sequence[float]) -> None:
        """Take one effort_command."""
        for name, effort in zip(names, efforts):
            if (
                name in self.joints
                or name in self._acting
                or self.named(name)
                or (not self.only and len(self._acting) < self.most)
            ):
                self._acting_on(name).command(0, stamp_ns, effort)

    def forget(self, name: str) -> None:
        """See `Bank`."""
        super().forget(name)
        self._acting.pop(name, None)
        self.unknown.discard(name)

    def _acting_on(self, name: str) -> Acting:
        acting = self._acting.get(name)
        if acting is None:
            settings: Any = self.configuration.for_joint(name)[1]
            acting = self._acting[name] = Acting(1, self._source, settings)
        return acting

    def why_silent(self, name: str) -> str:
        """Return why no sample of this joint can be used, if its input is the reason, else ''."""
        if name not in self.unknown:
            return ''
        return self._acting_on(name).why_unknown()

    def unit(self, name: str) -> str:
        """Return the unit of this joint's input; empty: not known."""
        settings: Any = self.joints[name].settings
        return settings.input_unit

    def reports(self) -> dict[str, IdentificationReport]:
        """Return the identified parameters of each joint."""
        return {
            name: joint.report()
            for name, joint in self.joints.items()
            if joint.used and isinstance(joint, AdaptiveJoint)
        }
