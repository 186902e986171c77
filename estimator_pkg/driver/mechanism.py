# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Mechanisms of one stream: joints are collected by stamp, inputs matched to the time they act.

No ROS here: the live node and replay pass it the same messages and get the same estimates.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from estimator_pkg.circle import Circle, is_angle
from estimator_pkg.driver.bank import Received, Rows, Taken, taken
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.efforts import (
    EFFORT_COMMAND,
    EFFORT_FIELD,
    NO_EFFORT,
    Acting,
    DrivenSettings,
)
from estimator_pkg.driver.joint import TYPICAL_DT, Joint
from estimator_pkg.driver.pairs import Pairing, Partial
from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.mechanism.observer import MechanismObserver, State
from estimator_pkg.parameters import parameter, structural
from estimator_pkg.sensor.convention import Convention


@dataclass(frozen=True)
class MechanismSettings(DrivenSettings):
    """Parameters per mechanism; `wrap_period` comes from the model."""

    joints: tuple[str, ...] | None = structural(
        None,
        kind=tuple,
        description="names of the mechanism's joints in the topics, in the order of the model's "
        "positions; automatic: the model's own names",
    )
    pair_tolerance: float = parameter(
        0.0,
        unit='s',
        range=(0.0, 1.0),
        description='joints in separate messages form one sample if their stamps differ by at most '
        'this',
    )


class Plan:
    """The design of a channel: the observer of a mechanism with its gains."""

    plan: MechanismObserver = None  # type: ignore[assignment]  # before there are gains

    def take(self, other: Plan) -> None:
        """Use another one."""
        self.plan = other.plan


class Interval:
    """The coefficients of a channel: a sample time [s]."""

    dt = TYPICAL_DT

    def take(self, other: Interval) -> None:
        """Copy another one."""
        self.dt = other.dt


class Motion(State):
    """A state of as many positions as its first sample has."""

    def __init__(self) -> None:
        super().__init__(0)

    def take(self, other: State) -> None:
        """Copy another state."""
        self.conventions = [Convention() for _ in other.conventions]
        super().take(other)


class Steps(Observer):
    """What `driver.channel` calls of an observer, for mechanisms; see `observers.contract`."""

    Design, Coefficients, State = Plan, Interval, Motion

    @staticmethod
    def prepare(coefficients: Interval, design: Plan, dt: float) -> None:
        """Set the sample time [s]."""
        coefficients.dt = dt

    @staticmethod
    def is_reading(measurement: Sequence[float]) -> bool:
        """Return False if a position is no reading."""
        return all(map(is_angle, measurement))

    @staticmethod
    def start(_: Any, state: Motion, design: Plan, y: Sequence[float]) -> None:
        """Set every field, after the first sample."""
        state.conventions = [Convention() for _ in y]
        design.plan.start(state, y)

    @staticmethod
    def step(_: Any, state: Motion, coefficients: Interval, design: Plan, y: Any, u: Any) -> None:
        """Take one sample."""
        design.plan.step(state, coefficients.dt, y, u)

    @staticmethod
    def resume(_: Any, state: Motion, coefficients: Interval, design: Plan, y: Any) -> None:
        """Go on after a gap."""
        design.plan.resume(state, y)

    @staticmethod
    def restart(_: Any, state: Motion, coefficients: Interval, design: Plan, y: Any) -> None:
        """Start again after an outage."""
        design.plan.restart(state, y)

    @staticmethod
    def estimate(_: Any, out: Any, state: Motion, c: Any, design: Plan, y: Any, u: Any) -> None:
        """Set the estimate of all positions."""
        out.position, out.velocity = design.plan.estimate(state)
        out.acceleration = [math.nan] * len(out.position)
        out.status = state.status

    @staticmethod
    def deviation(
        _: Any, out: Any, state: Motion, coefficients: Interval, design: Plan, scale: float
    ) -> None:
        """Set the standard deviations of all positions and velocities."""
        out.position, out.velocity = design.plan.deviations(state, coefficients.dt)

    @staticmethod
    def limits(design: Plan, dt: float) -> str | None:
        """Return None, or why these gains cannot work at this dt [s]."""
        return design.plan.limits(dt)

    @staticmethod
    def group_delay(design: Plan, dt: float) -> float:
        """Return the delay of the velocity at low frequency [s]."""
        return design.plan.group_delay(dt)

    @staticmethod
    def why(state: Motion, design: Plan) -> str:
        """Return the meaning of the status as text."""
        return design.plan.why(state)


@cache
def steps_of(observer: Any) -> type[Steps]:
    """Return what `driver.channel` calls of this observer."""

    class Own(Steps):
        @staticmethod
        def design(gains: Any, circle: Circle) -> Plan:
            made = Plan()
            made.plan = observer.plan(gains, circle)
            return made

    return Own


class Mechanism(Joint):
    """A mechanism's observer, live: a `Joint` whose reading are its positions.

    Attributes
    ----------
    plan : the observer with its gains.
    """

    settings: MechanismSettings

    def __init__(
        self,
        name: str,
        observer: type[Observer],
        gains: Any,
        settings: MechanismSettings,
        source: str,
    ) -> None:
        super().__init__(observer, gains, settings)
        self.name = name
        mechanics = self.plan.mechanics
        self.size, self.names = mechanics.degrees, settings.joints or mechanics.joints
        if len(self.names) != mechanics.degrees:
            raise UsageError(
                f"mechanism '{name}': model '{mechanics.name}' has "
                f'{mechanics.degrees} joints ({", ".join(mechanics.joints)}), but '
                f"'joints' names {len(self.names)}: name one per model joint"
            )
        if len(set(self.names)) < len(self.names):
            raise UsageError(f"mechanism '{name}': 'joints' names a joint twice")
        self._index = {joint: k for k, joint in enumerate(self.names)}
        self._input_of = {self.names[k]: place for place, k in enumerate(mechanics.actuated)}
        self._source = source
        self._acting = Acting(mechanics.inputs, source, settings)
        self._pairing = Pairing(self.size, 1e9 * settings.pair_tolerance)
        self.completed = Partial()  # the newest sample, used or not
        settings.check_inputs(mechanics.inputs, f"mechanism '{name}'")

    def _module_of(self, gains: Any) -> Any:
        observer: Any = self.observer
        return steps_of(observer)

    def _another(self) -> Mechanism:
        return Mechanism(self.name, self.observer, self.gains, self.settings, self._source)

    def _at_rest(self) -> tuple[Any, Any]:
        mechanics = self.plan.mechanics
        return mechanics.centre, (math.nan,) * mechanics.inputs

    @property
    def plan(self) -> MechanismObserver:
        """The observer with its gains."""
        plan: MechanismObserver = self._channel.design.plan
        return plan

    def _turn(self, index: int) -> float:
        return self.plan.mechanics.periods[index]

    def take(
        self,
        stamp_ns: int,
        names: Sequence[str],
        positions: Sequence[float],
        efforts: Sequence[float],
    ) -> bool | None:
        """Take one message; None if it completes no sample, else True if the sample was used."""
        with_efforts = efforts if len(efforts) == len(names) else (None,) * len(names)
        parts = {
            self._index[joint]: (position, effort)
            for joint, position, effort in zip(names, positions, with_efforts)
            if joint in self._index
        }
        found = self._pairing.put(stamp_ns, parts) if parts else None
        if found is None:
            return None
        self.completed = found
        acted = [found.parts[k][1] for k in self.plan.mechanics.actuated]
        known_input = self._acting.known_input(
            self.stamp_ns,
            found.stamp_ns,
            [math.nan if effort is None else effort for effort in acted],
            self.settings,
        )
        measurement = [float(found.parts[k][0]) for k in range(self.size)]
        return self.update(found.stamp_ns, measurement, known_input)

    @property
    def incomplete(self) -> int:
        """Number of stamps that never got all their joints."""
        return self._pairing.unpaired

    def command(self, stamp_ns: int, names: Sequence[str], efforts: Sequence[float]) -> None:
        """Take one effort_command."""
        for joint, value in zip(names, efforts):
            place = self._input_of.get(joint)
            if place is not None:
                self._acting.command(place, stamp_ns, value)

    @property
    def actuated(self) -> tuple[str, ...]:
        """Names of the joints with an input, in the order of the inputs."""
        return tuple(self.names[k] for k in self.plan.mechanics.actuated)

    def set_settings(self, settings: Any) -> None:
        """Use other settings from the next sample on; the state is kept."""
        settings.check_inputs(self.plan.mechanics.inputs, f"mechanism '{self.name}'")
        super().set_settings(settings)
        self._pairing.tolerance_ns = 1e9 * settings.pair_tolerance

    def reset(self) -> None:
        """Reset the observer to its start; the counters continue."""
        super().reset()
        self._acting.clear()
        self._pairing.waiting.clear()

    def why(self) -> str:
        """Return the meaning of the status as text."""
        if not self.running:
            return self.why_silent()
        said = super().why()
        if self.mean_dt > self.longest_dt:
            return said
        if self._source == EFFORT_COMMAND and self._acting.is_unknown:
            said += f'{said and "; "}{self._acting.why_unknown()}'
        elif said.startswith('no effort'):
            said += f': {NO_EFFORT}'
        return said

    def why_silent(self) -> str:
        """Return why samples are incomplete; '' if none is waiting."""
        waiting = self._pairing.waiting
        if not waiting:
            return ''
        seen = {self.names[k] for each in waiting for k in each.parts}
        missing = sorted(set(self.names) - seen)
        if missing:
            return f'waiting for {", ".join(missing)}'
        return (
            'the stamps of its joints differ by at least '
            f'{(self._pairing.nearest_ns or 0) * 1e-9:g} s: increase pair_tolerance'
        )


def check_names(configuration: Configuration, names: Collection[str]) -> None:
    """Raise UsageError if a parameter is set for a mechanism that is not in `names`."""
    for name in configuration.overrides:
        if name not in names:
            raise UsageError(
                f"parameters are set for an unknown mechanism '{name}': {suggestion(name, names)}"
            )


class MechanismBank(Received):
    """The mechanisms of one stream.

    Parameters
    ----------
    names : names of the mechanisms.
    source : of the efforts: EFFORT_FIELD (in joint states) or EFFORT_COMMAND (on a topic).

    Attributes
    ----------
    joints : the mechanisms by name, as in `estimator_pkg.driver.bank.Bank`.
    """

    def __init__(
        self, configuration: Configuration, names: Iterable[str], source: str = EFFORT_FIELD
    ) -> None:
        super().__init__()
        self.configuration = configuration
        self.joints: dict[str, Mechanism] = {}
        of_joint: dict[str, str] = {}  # joint -> its mechanism
        for name in filter(None, names):  # YAML writes an empty list as an empty text
            if name in self.joints:
                raise UsageError(f"parameter 'mechanisms' names '{name}' twice")
            settings: Any
            gains, settings = configuration.for_joint(name)
            made = Mechanism(name, configuration.observer, gains, settings, source)
            for joint in made.names:
                if joint in of_joint:
                    raise UsageError(
                        f"mechanisms '{of_joint[joint]}' and '{name}' both have the "
                        f"joint '{joint}': name theirs with 'per_joint.{name}.joints'"
                    )
                of_joint[joint] = name
            self.joints[name] = made
        if not self.joints:
            raise UsageError("parameter 'mechanisms' is empty: name at least one mechanism")
        check_names(configuration, self.joints)
        self.orders = (  # possible names for the numbers of an effort_command without names
            tuple(name for each in self.joints.values() for name in each.names),
            tuple(name for each in self.joints.values() for name in each.actuated),
        )
        self._reads_efforts = source == EFFORT_FIELD and bool(self.orders[1])
        self.only: frozenset[str] = frozenset()
        self._places = {
            joint: (each, index)
            for each in self.joints.values()
            for index, joint in enumerate(each.names)
        }
        self._key: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
        self._shown: list[tuple[Mechanism, int]] = []

    def update(
        self,
        stamp_ns: int,
        names: Sequence[str],
        positions: Sequence[float],
        efforts: Sequence[float],
    ) -> Taken | None:
        """Take one message of joint states; return None if it completes no mechanism's sample.

        The joints are those of the mechanisms whose samples it completes: those that it names, in
        its order, and behind them those that came before.
        """
        if not self.fits(names, positions):
            return None
        if self._reads_efforts and len(efforts) not in (0, len(names)):
            self.mismatched += 1
            return None
        estimates: dict[str, list[tuple[float, float, float, int]] | None] = {}
        for mechanism in self.joints.values():
            used = mechanism.take(stamp_ns, names, positions, efforts)
            if used is not None:
                estimates[mechanism.name] = mechanism.estimates() if used else None
        if not estimates:
            return None
        shown = self._shape(tuple(names), tuple(estimates))
        samples = [mechanism.completed.parts[index] for mechanism, index in shown]
        return taken(
            [mechanism.names[index] for mechanism, index in shown],
            [
                each[index] if (each := estimates[mechanism.name]) is not None else None
                for mechanism, index in shown
            ],
            [math.nan if effort is None else effort for _, effort in samples]
            if any(effort is not None for _, effort in samples)
            else (),
            Rows(shown),
            [position for position, _ in samples],
        )

    def _shape(
        self, names: tuple[str, ...], complete: tuple[str, ...]
    ) -> list[tuple[Mechanism, int]]:
        """(mechanism, number of the joint in it) of each joint of an answer, in its order."""
        if self._key != (names, complete):
            self._key = names, complete
            joints = [joint for name in complete for joint in self.joints[name].names]
            ordered = [joint for joint in names if joint in joints]
            ordered += [joint for joint in joints if joint not in names]
            self._shown = [self._places[joint] for joint in ordered]
        return self._shown

    def command(self, stamp_ns: int, names: Sequence[str], efforts: Sequence[float]) -> None:
        """Take one effort_command."""
        for mechanism in self.joints.values():
            mechanism.command(stamp_ns, names, efforts)

    def why_silent(self, name: str) -> str:
        """Return why a mechanism has no sample, or ''."""
        return self.joints[name].why_silent()
