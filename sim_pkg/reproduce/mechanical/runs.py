# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs of observers of mechanisms over simulated motions, for the rows of the table.

Every run steps the package's own observers (`MechanicalCore.advance`). Features of the paper alone,
such as a start away from the measurement, are added here.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import observers
from estimator_pkg.driver.compiled import compiled
from estimator_pkg.models import cart_pendulum, robotic_leg
from estimator_pkg.models.mechanics import Mechanics
from estimator_pkg.observers.circle import Circle
from estimator_pkg.observers.maths.unroll import written_out
from estimator_pkg.observers.mechanism.algebra import mechanical_algebra
from estimator_pkg.observers.mechanism.core import MechanicalFunctions
from estimator_pkg.observers.mechanism.motion import make_plant, put_row, row_of
from estimator_pkg.parameters import build


def make_motion(mechanics: Mechanics) -> Callable[..., None]:
    """Return motion(values, q, v, inputs, dt, parts, positions, velocities), which simulates a run.

    `inputs` has shape (N, m), constant between samples; row k of `positions` and `velocities`,
    shape (N, n), is the state at sample k.
    """
    plant = make_plant(mechanics)
    vector, out = row_of(max(1, mechanics.inputs)), put_row(mechanics.degrees)

    def motion(
        values: tuple,
        q: tuple,
        v: tuple,
        inputs: Any,
        dt: float,
        parts: int,
        positions: Any,
        velocities: Any,
    ) -> None:
        for k in range(len(positions)):
            out(positions, k, q)
            out(velocities, k, v)
            q, v = plant(values, q, v, vector(inputs, k), dt, parts)

    return motion


Array = NDArray[np.float64]

ONE_SIZE = Circle(0.0, False)  # no wrapping: the runs stay on one turn, or count turns


def quantise(values: Array, quantum: Any) -> Array:
    """Return Q(x) = d floor(x/d + 1/2), in the shape and units of `values`.

    Parameters
    ----------
    values : shape (N, n). quantum : d, one number or one for each column.
    """
    d = np.asarray(quantum, float)
    return d * np.floor(values / d + 0.5)


def make(
    observer: str, model: str, parameters: dict[str, Any], **gains: Any
) -> MechanicalFunctions:
    """Return an observer of a built-in model, on positions that do not wrap (forward Euler)."""
    record = observers.find(observer)
    values = {
        'form': 'paper',
        'model': model,
        **gains,
        'model_parameters': [f'{name}={value!r}' for name, value in parameters.items()],
    }
    checked: Any = build(record.gains, values, owner=observer)
    count = {'single_joint': 1, 'cart_pendulum': 2, 'robotic_leg': 3}[model]
    build_any: Any = record.build  # observers of mechanisms take a circle for each position
    functions = build_any(checked, (ONE_SIZE,) * count)
    assert isinstance(functions, MechanicalFunctions)
    return functions


def make_run(functions: MechanicalFunctions) -> Callable[..., Any]:
    """Return run(core, coefficients, design, measured, inputs, parts, velocities, single) -> core.

    Row k of `velocities` is the estimate from (p_k, y_k), before y_k is injected; the input of
    row k acts from sample k to k + 1. Each sample takes `parts` Euler steps with a constant
    measurement; the coefficients are those of dt / parts. `single`: the state is stored in single
    precision.
    """
    mechanics = functions.mechanics
    n = mechanics.degrees
    advance = functions.core.advance
    row, given, put = row_of(n), row_of(max(1, mechanics.inputs)), put_row(n)
    algebra = mechanical_algebra(n)
    minus, zeros_like = algebra.minus, algebra.zeros_like
    in_single = make_in_single(functions)

    def run(
        core: tuple,
        coefficients: tuple,
        design: tuple,
        measured: Any,
        inputs: Any,
        parts: int,
        velocities: Any,
        single: bool,
    ) -> tuple:
        _, _, _, velocity = core
        put(velocities, 0, velocity)
        for k in range(1, len(measured)):
            before, now, u = row(measured, k - 1), row(measured, k), given(inputs, k - 1)
            moved = minus(now, before)
            for _ in range(parts - 1):
                core, good = advance(
                    core, coefficients, design, before, zeros_like(moved), before, u
                )
            core, good = advance(core, coefficients, design, before, moved, now, u)
            if single:
                core = in_single(core)
            _, _, _, velocity = core
            put(velocities, k, velocity)
        return core

    return run


def make_in_single(functions: MechanicalFunctions) -> Callable[[tuple], tuple]:
    """Return in_single(core), which rounds a core's state to single precision."""
    n = functions.mechanics.degrees
    _, _, disturbances, _ = functions.core.begin()
    disturbed = len(disturbances) > 0
    entries = ''.join(f'float(single(x[{i}])), ' for i in range(n))
    lines = [f'def rounded(x): return ({entries})']
    rounded = written_out(lines, f'rounded for {n}', single=np.float32)['rounded']

    def in_single(core: tuple) -> tuple:
        e, x, d, v = core
        if disturbed:
            d = rounded(d)
        return rounded(e), rounded(x), d, v

    return in_single


def observe(
    functions: MechanicalFunctions,
    measured: Array,
    inputs: Array,
    dt: float,
    *,
    start: Any = None,
    parts: int = 1,
    single: bool = False,
) -> Array:
    """Return estimated velocities, shape (N, n).

    Parameters
    ----------
    start : qh(0); None: y(0). Velocity and momenta start at 0.
    """
    design = functions.core.design()
    coefficients = functions.core.prepare(design, dt / parts)
    core = functions.core.begin()
    if start is not None:
        offset = tuple((np.asarray(start, float) - measured[0]).tolist())
        _, *others = core
        core = (offset, *others)
    velocities = np.zeros_like(measured)
    compiled(make_run(functions))(
        core,
        coefficients,
        design,
        np.ascontiguousarray(measured),
        np.ascontiguousarray(inputs, float),
        parts,
        velocities,
        single,
    )
    return velocities


def move(
    mechanics: Mechanics, q: Any, v: Any, inputs: Array, dt: float, parts: int
) -> tuple[Array, Array]:
    """Return (positions, velocities), shape (N, n): row k at sample k; input k acts from it on."""
    shape = (len(inputs), mechanics.degrees)
    positions, velocities = np.zeros(shape), np.zeros(shape)
    compiled(make_motion(mechanics))(
        mechanics.values,
        tuple(map(float, q)),
        tuple(map(float, v)),
        np.ascontiguousarray(inputs, float),
        dt,
        parts,
        positions,
        velocities,
    )
    return positions, velocities


def metrics(errors: Array) -> list[float]:
    """Return ME x 1e2 and MSE x 1e4 of each column, in turn: (23).

    `errors` has shape (N, n); the units are that of a column, and its square.
    """
    values = []
    for column in errors.T:
        values += [float(np.mean(np.abs(column))) * 1e2, float(np.mean(column**2)) * 1e4]
    return values


METRICS = tuple(
    f'{name}{joint}{unit}' for joint in (1, 2, 3) for name, unit in (('ME', 'e2'), ('MSE', 'e4'))
)
OF_FIRST = ('ME1e2', 'MSE1e4', 'ME2e2', 'MSE2e4')


@lru_cache
def normalised(b: float = 0.1) -> Mechanics:
    """The cart-pendulum of section 5.1: a = m = 1."""
    return cart_pendulum.build(cart_pendulum.Parameters(**cart_of(b)))


def cart_of(b: float = 0.1) -> dict[str, float]:
    """Its numbers."""
    return {'pendulum_inertia': 1.0, 'pendulum_moment': b, 'moving_mass': 1.0, 'gravity': 1.0}


@lru_cache
def leg() -> Mechanics:
    """Return the leg of section 5.2, without the guard of its domain."""
    return robotic_leg.build(robotic_leg.Parameters(margin=1e-9))
