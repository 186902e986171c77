# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Shared by the simulators of mechanisms: encoders, messages, and the loop over samples.

A message of `joint_states` carries the measured positions and, as effort, the inputs from the
previous sample to this one (0 for joints without a motor). The truth carries the positions and
velocities at the same stamp.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from estimator_pkg.circle import wrap
from estimator_pkg.errors import UsageError
from estimator_pkg.models.mechanics import Mechanics
from estimator_pkg.models.motion import move
from estimator_pkg.parameters import structural
from sim_pkg.chunks import MEASURED, TRUTH, JointStates, sample_count
from sim_pkg.contract import Message, check_rate, diverged
from sim_pkg.joints.sensor import SECOND, random_stream

CHUNK = 16  # samples made at a time without feedback
FINEST = 5e-4  # longest integration step [s]
PART = 0.5  # longest integration step over the fastest time constant
RUNAWAY = 1e9  # positions [rad or m] and velocities [1/s] above this count as diverged

Vector = tuple[float, ...]
Drive = Callable[[float, Vector, Vector], Vector]  # (time, measured, true velocity) -> inputs


@dataclass(frozen=True)
class MechanismParameters:
    """Parameters that all simulators of mechanisms share."""

    rate: float = structural(224.0, unit='Hz', range=(1.0, 1e5), description='samples per second')
    quantum: tuple[float, ...] = structural(
        (0.0,),
        unit='rad or m',
        kind=list,
        range=(0.0, 10.0),
        description='quantum of the encoders, for all positions or each; 0: exact',
    )
    noise: tuple[float, ...] = structural(
        (0.0,),
        unit='rad or m',
        kind=list,
        range=(0.0, 10.0),
        description='standard deviation of the noise before the encoders, for all or each',
    )
    hold: int = structural(
        1,
        unit='samples',
        range=(1, 1000),
        description='samples for which a reading is repeated (2: encoders at half the rate)',
    )
    model_parameters: tuple[str, ...] = structural(
        (),
        description="parameters of the plant as 'name=value' that differ from the simulator's "
        'defaults; an observer with the defaults does not know them',
    )


def per_position(name: str, values: tuple[float, ...], count: int) -> np.ndarray:
    """Return one number per position, shape (count,); raise UsageError for other lengths."""
    if len(values) not in (1, count):
        raise UsageError(
            f"parameter '{name}' has {len(values)} numbers for {count} positions: give 1 or {count}"
        )
    return np.resize(np.array(values, float), count)


class Encoders:
    """Encoders with noise, a random constant offset, and quantisation; periodic joints wrap."""

    def __init__(self, mechanics: Mechanics, parameters: MechanismParameters, seed: int) -> None:
        n, self._periods = mechanics.degrees, mechanics.periods
        self._quantum = per_position('quantum', parameters.quantum, n)
        self._noise = per_position('noise', parameters.noise, n)
        self._hold, self._count = parameters.hold, 0
        offset = random_stream(seed, 'encoder offset').uniform(-0.5, 0.5, n)
        self._offset = offset * self._quantum
        self._random = random_stream(seed, 'encoder noise')
        self._last: Vector = ()

    def read(self, q: Vector) -> Vector:
        """Return the readings at these positions."""
        draws = self._random.standard_normal(len(q))
        if self._count % self._hold == 0:
            values = np.array(q) + self._noise * draws
            safe = np.where(self._quantum > 0.0, self._quantum, 1.0)
            steps = safe * np.floor((values + self._offset) / safe + 0.5) - self._offset
            values = np.where(self._quantum > 0.0, steps, values)
            self._last = tuple(
                wrap(value, period) for value, period in zip(values.tolist(), self._periods)
            )
        self._count += 1
        return self._last


def fastest(mechanics: Mechanics, q: Vector) -> float:
    """Return the largest rate [1/s] of the mechanism about `q`, at unit speeds (no stiction)."""
    n, at_rest = mechanics.degrees, np.zeros(mechanics.inputs)
    state, step = np.concatenate([q, np.ones(n)]), 1e-6

    def derivative(x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[n:], mechanics.acceleration(x[:n], x[n:], at_rest)])

    slopes = np.array(
        [
            (derivative(state + change) - derivative(state - change)) / (2.0 * step)
            for change in step * np.eye(2 * n)
        ]
    )
    return float(np.abs(np.linalg.eigvals(slopes)).max())


def stream(
    mechanics: Mechanics,
    parameters: MechanismParameters,
    q: Vector,
    v: Vector,
    drive: Drive,
    duration: float,
    seed: int,
    *,
    chunk: int = CHUNK,
    released: Callable[[], bool] = lambda: True,
) -> Iterator[list[Message]]:
    """Yield chunks of `chunk` samples: measurement and truth (see `sim_pkg.contract`).

    Parameters
    ----------
    q, v : start positions and velocities.
    drive : returns the inputs, constant from one sample to the next.
    released : while it returns False the mechanism stays at the start, as if held by hand.

    Raises
    ------
    UsageError : a number of values that fits neither all nor each position; a plant too fast.
    """
    encoders = Encoders(mechanics, parameters, seed)
    largest = fastest(mechanics, q)
    check_rate(largest)
    n, rate = mechanics.degrees, parameters.rate
    dt, left = 1.0 / rate, sample_count(duration, rate)
    parts = max(1, math.ceil(dt / min(FINEST, PART / max(largest, 1e-9))))
    measured, true = (JointStates(each, mechanics.joints) for each in (MEASURED, TRUTH))

    def samples(q: Vector, v: Vector) -> Iterator[list[Message]]:
        effort: Vector = (0.0,) * n
        messages: list[Message] = []
        k = 0
        while k < left:
            due = round(k * SECOND / rate)
            reading = encoders.read(q)
            messages.append(measured.message(due, due, reading, (), effort))
            shown = tuple(wrap(x, period) for x, period in zip(q, mechanics.periods))
            messages.append(true.message(due, due, shown, v, effort))
            k += 1
            if k % chunk == 0:
                yield messages
                messages = []
            acting = [0.0] * n
            if released():
                u = drive((k - 1) * dt, reading, v)
                with np.errstate(all='ignore'):
                    state = np.array(q), np.array(v)
                    moved = move(mechanics, *state, np.array(u[: mechanics.inputs]), dt, parts)
                q, v = (tuple(each.tolist()) for each in moved)
                if not all(-RUNAWAY < value < RUNAWAY for value in q + v):
                    raise diverged(k * dt)
                for index, value in zip(mechanics.actuated, u):
                    acting[index] = value
            effort = tuple(acting)
        if messages:
            yield messages

    return samples(q, v)


def merged(defaults: Mapping[str, object], assignments: tuple[str, ...]) -> tuple[str, ...]:
    """Return assignments for `models.load.load`: the simulator's defaults, then the user's."""
    own = {text.partition('=')[0].strip() for text in assignments}
    return (
        *(f'{name}={value}' for name, value in defaults.items() if name not in own),
        *assignments,
    )
