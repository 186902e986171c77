# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Any number of joints, which may appear, disappear and change order between messages."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.joint import Joint
from estimator_pkg.engine.calls import pointers


class Taken(NamedTuple):
    """What became of one message of joint states.

    names : of the joints to estimate, in the order of the message.
    estimates : of each (position, velocity, acceleration or nan, status) [SI] after its sample;
        None: the sample was not used.
    efforts : of each, as in the message [N m or N]; empty: it has none.
    line : `Line` or `Rows` of these joints. positions : of each, as measured [rad or m].
    """

    names: Sequence[str]
    estimates: Sequence[tuple[float, float, float, int] | None]
    efforts: Sequence[float]
    line: Any
    positions: Sequence[float]

    def measured_position(self, k: int) -> float:
        """Return the measured position of joint k in the convention of its estimates."""
        measured: float = self.line.in_estimate_convention(k, self.positions[k])
        return measured

    def stddevs(self, shown: Sequence[int]) -> Sequence[tuple[float, float]]:
        """Return one standard deviation of position and velocity of these joints, by number."""
        found: Sequence[tuple[float, float]] = self.line.stddevs(shown)
        return found


def taken(*fields: Any) -> Taken:
    """Return a `Taken` in half the time that its constructor takes."""
    return tuple.__new__(Taken, fields)


class Rows:
    """Numbers of joints whose reading is a vector.

    Parameters
    ----------
    places : (joint, place of the number in its reading) of each.
    """

    def __init__(self, places: Sequence[tuple[Any, int]]) -> None:
        self._places = places

    def in_estimate_convention(self, k: int, position: float) -> float:
        """See `Joint`."""
        joint, index = self._places[k]
        measured: float = joint.in_estimate_convention(position, index)
        return measured

    def stddevs(self, shown: Sequence[int]) -> list[tuple[float, float]]:
        """See `Taken`."""
        places = [self._places[k] for k in shown]
        found = {joint: joint.deviations() for joint in dict(places)}
        return [found[joint][index] for joint, index in places]


class Line:
    """The joints of one message, in its order; None: one joint too many, which is not kept.

    Attributes
    ----------
    compiled : the engine's functions; None: a joint runs as plain Python, is missing, or twice.
    """

    def __init__(self, names: Sequence[str], joints: Sequence[Any]) -> None:
        self.names, self.joints = names, joints
        self.compiled = joints[0].compiled if joints and joints[0] is not None else None
        if self.compiled is not None:
            whole = None not in joints and len(set(map(id, joints))) == len(joints)
            if not whole or any(joint.compiled is not self.compiled for joint in joints):
                self.compiled = None
        if self.compiled is not None:
            count = len(joints)
            self._channels = pointers([joint.memory for joint in joints])
            self._readings, self._out = (ctypes.c_double * count)(), (ctypes.c_double * 4 * count)()
            self._sigmas = (ctypes.c_double * 2 * count)()

    def take(
        self, stamp_ns: int, positions: Sequence[float]
    ) -> list[tuple[float, float, float, int] | None]:
        """Take one message; return the estimates, None where a sample was not used."""
        if self.compiled is None:
            return [
                joint.estimate() if joint is not None and joint.update(stamp_ns, position) else None
                for joint, position in zip(self.joints, positions)
            ]
        self._readings[:] = list(positions)
        self.compiled.message(self._channels, len(positions), stamp_ns, self._readings, self._out)
        return [
            (position, velocity, acceleration, int(status)) if status >= 0.0 else None
            for position, velocity, acceleration, status in self._out
        ]

    def in_estimate_convention(self, k: int, position: float) -> float:
        """See `Joint`."""
        joint = self.joints[k]
        measured: float = position if joint is None else joint.in_estimate_convention(position)
        return measured

    def stddevs(self, shown: Sequence[int]) -> list[tuple[float, float]]:
        """See `Taken`."""
        if self.compiled is None:
            return [self.joints[k].stddev() for k in shown]
        self.compiled.deviations(self._channels, len(self.joints), self._sigmas)
        return [(self._sigmas[k][0], self._sigmas[k][1]) for k in shown]


class Received:
    """Counts messages of joint states that cannot be used.

    Attributes
    ----------
    mismatched : number of messages whose arrays do not fit their names.
    empty : number of messages without a position.
    """

    joints: Mapping[str, Any]
    refused = expired = 0  # samples of names beyond the limit, and expired joints: see `Bank`

    def __init__(self) -> None:
        self.mismatched = self.empty = 0

    def fits(self, names: Sequence[str], positions: Sequence[float]) -> bool:
        """Return True if there is one position per name; otherwise count the message."""
        if not positions:
            self.empty += 1
            return False
        if len(names) != len(positions):
            self.mismatched += 1
            return False
        return True

    def warm_up(self) -> None:
        """Prepare everything that the first sample needs."""
        for joint in self.joints.values():
            joint.warm_up()

    def why_silent(self, name: str) -> str:
        """Return why a joint may have no usable sample, if it is known; else ''."""
        return ''


class Bank(Received):
    """The joints of one stream, created when they appear.

    Parameters
    ----------
    configuration : observer, gains and settings.
    only : names of the joints to estimate; empty: every joint that appears.
    most : largest number of joints; None: no limit. Joints named in `only` or an override are
        always accepted.

    Attributes
    ----------
    most : see above.
    refused, expired : samples of names beyond `most`, and joints removed by `forget`.
    refused_name : the newest refused name.
    """

    def __init__(
        self, configuration: Configuration, only: Iterable[str] = (), most: int | None = None
    ) -> None:
        super().__init__()
        self.most = math.inf if most is None else most
        self.refused = self.expired = 0
        self.refused_name = ''
        self.configuration = configuration
        self.only = frozenset(only)
        self.joints: dict[str, Any] = {}
        self._line: Line | None = None  # of the newest message
        self._unnamed = 0  # joints that the configuration does not name

    def warm_up(self) -> None:
        """Take samples with a joint without a name."""
        self._make('').warm_up()

    def named(self, name: str) -> bool:
        """Return True if the configuration names this joint."""
        return name in self.only or name in self.configuration.overrides

    def forget(self, name: str) -> None:
        """Remove an expired joint; if it appears again it is a new one."""
        del self.joints[name]
        self._line = None
        self._unnamed -= not self.named(name)
        self.expired += 1

    def joint(self, name: str) -> Joint | None:
        """Return the joint `name`, created at its first appearance; None if it is not selected, or
        if there are too many (the sample is counted).
        """
        joint = self.joints.get(name)
        if joint is None and (not self.only or name in self.only):
            named = self.named(name)
            if self._unnamed >= self.most and not named:
                self.refused += 1
                self.refused_name = name
                return None
            joint = self.joints[name] = self._make(name)
            if not named:
                self._unnamed += 1
        return joint

    def _make(self, name: str) -> Any:
        return Joint(self.configuration.observer, *self.configuration.for_joint(name))

    def selected(
        self, names: Sequence[str], positions: Sequence[float], efforts: Sequence[float]
    ) -> tuple[Sequence[str], Sequence[float], Sequence[float]]:
        """Return what a message says of the joints to estimate; efforts only if they fit."""
        if len(efforts) != len(names):
            efforts = ()
        if not self.only:
            return names, positions, efforts
        places = [k for k, name in enumerate(names) if name in self.only]
        return (
            [names[k] for k in places],
            [positions[k] for k in places],
            [efforts[k] for k in places] if efforts else (),
        )

    def update(
        self,
        stamp_ns: int,
        names: Sequence[str],
        positions: Sequence[float],
        efforts: Sequence[float] = (),
    ) -> Taken | None:
        """Take one message; return None (and count it) if its arrays do not fit.

        Parameters
        ----------
        stamp_ns : stamp of the measurement, int nanoseconds.
        names, positions, efforts : as in a JointState [rad or m, N m or N].
        """
        if not self.fits(names, positions):
            return None
        if self.only or efforts:
            names, positions, efforts = self.selected(names, positions, efforts)
        line = self._line
        if line is None or line.names != names:
            line = Line(names, [self.joint(name) for name in names])
            # a name that is refused counts at each message
            self._line = None if None in line.joints else line
        return taken(names, line.take(stamp_ns, positions), efforts, line, positions)
