# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Our rows of the field, each with one gain that is swept over a grid.

Observers of an angle use the same readings as the peers. The others also know the torque and the
joint on which it acts. They are a group of their own, because this knowledge is worth more than any
filter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.columns import Column
from benchmarks.recorded import RAW
from estimator_pkg import observers, registry
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.driver.mechanism import Mechanism, MechanismSettings
from estimator_pkg.driver.switched import SwitchedJoint
from estimator_pkg.estimate import COASTING, TRACKING
from estimator_pkg.evaluation.entries import Entry, at_defaults
from estimator_pkg.parameters import build, declared
from estimator_pkg.sensor.guard import DUPLICATE

Array = NDArray[np.float64]
Run = Callable[[Column, Any], Array]

OURS, PRACTICE, PEERS = 'ours', 'practice', 'peers'
INFORMED, AHEAD = 'knows more', 'looks ahead'
GRID = 13  # settings of an observer of an angle
TOLD_GRID = 7  # settings of an observer with an input, which runs in plain Python
PUBLISHED = (TRACKING, COASTING)

NOT_HERE = {
    'pmsm': 'takes stator currents and voltages: compared with motulator in the part drive',
    'adaptive on pendulums': 'takes a linear joint; gravity is not linear in the angle',
}


@dataclass(frozen=True)
class Estimator:
    """A row of the field.

    run : (column, value of the gain) -> velocity of each sample [rad/s], shape (n,); nan where none
        is published, and everywhere if the column lacks an input.
    values : the grid; (None,) without a gain.
    gain : name of the swept gain.
    group : OURS, PRACTICE, PEERS, INFORMED or AHEAD.
    knows : what it knows in addition to readings and stamps.
    """

    name: str
    run: Run
    values: tuple[Any, ...] = (None,)
    gain: str = ''
    group: str = OURS
    knows: str = ''


def grid(low: float, high: float, count: int) -> tuple[float, ...]:
    """Return `count` values at equal ratios."""
    return tuple(float(f'{each:.4g}') for each in np.geomspace(low, high, count))


def ours() -> list[Estimator]:
    """Return every observer of an angle, swept over its first gain, and the raw difference."""
    found = [_angle(entry) for entry in at_defaults()]
    return [*found, Estimator(RAW.label, _runner(RAW, ''))]


def _angle(entry: Entry) -> Estimator:
    gains = declared(registry.find(registry.OBSERVERS, entry.observer).gains)
    sought = [each for each in gains.values() if each.search is not None]
    if not sought:
        return Estimator(entry.label, _runner(entry, ''))
    low, high = sought[0].search or (1.0, 1.0)
    name = sought[0].name
    return Estimator(entry.label, _runner(entry, name), grid(low, high, GRID), name)


def _runner(entry: Entry, gain: str) -> Run:
    def run(column: Column, value: Any) -> Array:
        joint = entry.joint(wrap_period=column.period, **({gain: value} if gain else {}))
        out = joint.run(column.samples.stamps, column.samples.angle, fast=True)
        return _published(out.velocity, out.status, out.verdict)

    return run


def _published(velocity: Array, status: NDArray[np.int8], verdict: NDArray[np.int8]) -> Array:
    return np.where((verdict < DUPLICATE) & np.isin(status, PUBLISHED), velocity, np.nan)


SWEPT = {'smo': ('mu', grid(1.0, 1000.0, TOLD_GRID))}  # smo has no bandwidth


def with_input() -> list[Estimator]:
    """Return the observers that use a known torque."""
    found = []
    for name in _mechanisms():
        gain, values = SWEPT.get(name, ('bandwidth_hz', grid(0.5, 50.0, TOLD_GRID)))
        found.append(
            Estimator(
                name,
                _mechanical(name, gain),
                values,
                gain,
                INFORMED,
                'torque and the parameters of the joint',
            )
        )
    return [
        *found,
        Estimator(
            'adaptive',
            _adaptive,
            grid(1.0, 30.0, TOLD_GRID),
            'bandwidth_hz',
            INFORMED,
            'torque, and that it acts on an inertia with viscous friction',
        ),
        Estimator(
            'switched',
            _switched,
            grid(0.5, 50.0, TOLD_GRID),
            'bandwidth_hz',
            INFORMED,
            'torque, and the form of the equation of motion',
        ),
    ]


def _mechanisms() -> Iterable[str]:
    return observers.of_kind('mechanical')


def _nothing(column: Column) -> Array:
    return np.full(len(column.samples.stamps), np.nan)


def _mechanical(name: str, gain: str) -> Run:
    observer = registry.find(registry.OBSERVERS, name)

    def run(column: Column, value: float) -> Array:
        if column.torque is None or not column.joint:
            return _nothing(column)
        numbers = tuple(f'{key}={each:.9g}' for key, each in column.joint.items())
        gains = build(observer.gains, {gain: value, 'model_parameters': numbers})
        joint = Mechanism(name, observer, gains, MechanismSettings(), '')
        known = column.samples.stamps, column.samples.angle[:, None], column.torque[:, None]
        _, velocity, status, verdict = joint.run(*known)
        return _published(velocity[:, 0], status, verdict)

    return run


def _adaptive(column: Column, value: float) -> Array:
    if column.torque is None or not column.joint or column.joint.get('gravity'):
        return _nothing(column)
    observer = registry.find(registry.OBSERVERS, 'adaptive')
    joint = Joint(
        observer,
        build(observer.gains, {'bandwidth_hz': value, 'known': ('b1=0', 'k/J=0')}),
        JointSettings(),
    )
    out = joint.run(column.samples.stamps, column.samples.angle, column.torque, fast=True)
    return _published(out.velocity, out.status, out.verdict)


def _switched(column: Column, value: float) -> Array:
    if column.torque is None or not column.joint:
        return _nothing(column)
    observer = registry.find(registry.OBSERVERS, 'switched')
    joint = SwitchedJoint(
        observer,
        build(observer.gains, {'bandwidth_hz': value, 'quantum': column.quantum}),
        JointSettings(),
    )
    velocity = _nothing(column)
    for i, (stamp, angle, torque) in enumerate(_rows(column)):
        if joint.update(stamp, (angle,), (torque,)) and joint.estimate()[3] in PUBLISHED:
            velocity[i] = joint.estimate()[1]
    return velocity


def _rows(column: Column) -> Iterable[tuple[int, float, float]]:
    assert column.torque is not None
    return zip(
        column.samples.stamps.tolist(), column.samples.angle.tolist(), column.torque.tolist()
    )
