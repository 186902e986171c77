# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The interface of a model for the observer `switched`, and its checks.

Barbot, Djemai, Manamanni (2007): x' = F(x, Z(k), u), y = h(x), where Z is constant between known
switching instants and Z(k+1) = A_d Z(k) + beta_d(v(k), y(k)) at them; x does not jump. In the
coordinates zeta = Phi_Z(x), the outputs' derivatives, it is a chain for each output with the end

    zeta_{k_i,i}' = Gamma_i(zeta, u) + Lambda_i(zeta, u) Z                                     (9)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from traceback import extract_tb
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import registry
from estimator_pkg.errors import UsageError

Vector = Sequence[float]
Array = NDArray[np.floating[Any]]

RESIDUAL = 1e-5  # allowed relative residual of a numerical derivative
RANK = 1e-6  # least singular value, relative to the largest, that counts as full rank
OUR_MODELS = {
    'example': 'estimator_pkg.models.example:MODEL',
    'gripper': 'estimator_pkg.models.gripper:MODEL',
}


@dataclass(frozen=True)
class SwitchedModel:
    """A hybrid system with linear discrete part. Ordinary Python; zeta, Z, u are tuples.

    Attributes
    ----------
    indices : k_1 .. k_p, the length of each output's chain; zeta lists them one after another.
    size : m, the length of Z.
    gamma : (zeta, u) -> p numbers. lam : (zeta, u) -> p rows of m numbers.
    transition : (mode) -> A_d, m rows of m numbers; None if that event makes Z unknown.
    offset : (mode, v, y) -> beta_d, m numbers.
    phi, phi_inverse : (x, Z) -> zeta and (zeta, Z) -> x; None: x is zeta.
    dynamics : (x, Z, u) -> x', for the checks and for simulation.
    start : (x, Z) of a typical trajectory. probe : (t) -> its u; period : time between events [s].
    bounds : for each output, bounds of its derivatives 2 .. k_i + 1, in ascending order; see
        `estimator_pkg.observers.switched.observer`.
    names, units : of the entries of Z. joints : names of the outputs.
    basis : (y, u) -> p rows of m + 1 numbers: Gamma_i and then the columns of Lambda_i are
        these or, for an `orders` of 1, their derivatives. None: Gamma and Lambda at the
        estimated zeta are used.
    orders : p rows of m + 1 numbers, 0 or 1.
    event : (mode, v) of a typical event, for the checks.
    """

    indices: tuple[int, ...]
    size: int
    gamma: Callable[[Vector, Vector], Vector]
    lam: Callable[[Vector, Vector], Sequence[Vector]]
    transition: Callable[[str], Sequence[Vector] | None]
    offset: Callable[[str, Vector, Vector], Vector]
    dynamics: Callable[[Vector, Vector, Vector], Vector]
    start: tuple[tuple[float, ...], tuple[float, ...]]
    probe: Callable[[float], tuple[float, ...]]
    period: float
    bounds: tuple[tuple[float, ...], ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    joints: tuple[str, ...]
    phi: Callable[[Vector, Vector], Vector] | None = None
    phi_inverse: Callable[[Vector, Vector], Vector] | None = None
    basis: Callable[[Vector, Vector], Sequence[Vector]] | None = None
    orders: tuple[tuple[int, ...], ...] = ()
    event: tuple[str, tuple[float, ...]] = ('', ())

    def zeta(self, x: Vector, z: Vector) -> tuple[float, ...]:
        """Return Phi_Z(x)."""
        return tuple(x) if self.phi is None else tuple(self.phi(x, z))

    def state(self, zeta: Vector, z: Vector) -> tuple[float, ...]:
        """Return x, the inverse of Phi_Z."""
        return tuple(zeta) if self.phi_inverse is None else tuple(self.phi_inverse(zeta, z))

    @property
    def ends(self) -> list[int]:
        """Index in zeta of the last entry of each chain."""
        return [int(end) - 1 for end in np.cumsum(self.indices)]

    @property
    def firsts(self) -> list[int]:
        """Index in zeta of each output."""
        return [end + 1 - k for end, k in zip(self.ends, self.indices)]


def load(name: str) -> SwitchedModel:
    """Return a built-in model by name, or ``package.module:Name``, checked.

    Raises
    ------
    UsageError : not found, not a `SwitchedModel`, or inconsistent.
    """
    if name in OUR_MODELS:
        return registry.load(OUR_MODELS[name])
    if ':' not in name:
        raise UsageError(
            f"unknown switched model '{name}': use {', '.join(OUR_MODELS)} or package.module:Name"
        )
    model = registry.load(name)
    if not isinstance(model, SwitchedModel):
        raise UsageError(f"model '{name}' is not a SwitchedModel: make it one")
    return model


def check(model: SwitchedModel, steps: int = 1) -> float:
    """Compare a model with its own dynamics; return the least singular value of (28).

    Parameters
    ----------
    steps : N, number of past events for the reconstruction of Z.

    Raises
    ------
    UsageError : wrong shapes, a Phi that is not inverted, a chain that contradicts F, a last
        derivative that is not linear in Z, a deficient rank, or code that fails.
    """
    try:
        return _checked(model, steps)
    except UsageError:
        raise
    except Exception as error:  # a user's model may fail in any way
        place = extract_tb(error.__traceback__)[-1]
        raise UsageError(
            f"model: its code fails in '{place.name}', line {place.lineno}: "
            f'{type(error).__name__}: {error}'
        ) from error


def _checked(model: SwitchedModel, steps: int) -> float:
    _check_shapes(model)
    x, z = model.start
    random = np.random.default_rng(1)
    for _ in range(20):
        near = tuple(
            float(a + 0.2 * (1.0 + abs(a)) * b)
            for a, b in zip(x, random.uniform(-1.0, 1.0, len(x)))
        )
        other = tuple(
            float(a + 0.2 * (1.0 + abs(a)) * b)
            for a, b in zip(z, random.uniform(-1.0, 1.0, len(z)))
        )
        _check_chain(model, near, other, model.probe(float(random.uniform(0.0, model.period))))
    least = observability(model, steps)
    if least <= 0.0:
        raise UsageError(
            f'the rank of (28) with N = {steps} is deficient along the whole trajectory of the '
            'model: its outputs do not determine Z'
        )
    return least


def _check_shapes(model: SwitchedModel) -> None:
    p, m, n = len(model.indices), model.size, sum(model.indices)
    x, z = model.start
    if len(x) != n or len(z) != m:
        raise UsageError(f'model: start needs {n} and {m} numbers, not {len(x)} and {len(z)}')
    zeta, u = model.zeta(x, z), model.probe(0.0)
    shapes = {
        'gamma': (np.shape(model.gamma(zeta, u)), (p,)),
        'lam': (np.shape(model.lam(zeta, u)), (p, m)),
        'phi': (np.shape(zeta), (n,)),
        'dynamics': (np.shape(model.dynamics(x, z, u)), (n,)),
        'bounds': (tuple(map(len, model.bounds)), model.indices),
        'names': (len(model.names), m),
        'units': (len(model.units), m),
        'joints': (len(model.joints), p),
    }
    mode, v = model.event
    matrix = model.transition(mode)
    if matrix is not None:
        shapes['transition'] = (np.shape(matrix), (m, m))
        shapes['offset'] = (
            np.shape(model.offset(mode, v, tuple(zeta[i] for i in model.firsts))),
            (m,),
        )
    if model.basis is not None:
        y = tuple(zeta[i] for i in model.firsts)
        shapes['basis'] = (np.shape(model.basis(y, u)), (p, m + 1))
        shapes['orders'] = (np.shape(model.orders), (p, m + 1))
    for name, (shape, wanted) in shapes.items():
        if shape != wanted:
            raise UsageError(f"model: '{name}' has shape {shape}, not {wanted}")


def _check_chain(model: SwitchedModel, x: Vector, z: Vector, u: Vector) -> None:
    """Check that the derivative of Phi_Z(x) along F is the chain and ends in Gamma + Lambda Z."""
    zeta = np.array(model.zeta(x, z))
    back = np.array(model.state(tuple(zeta), z))
    if np.max(np.abs(back - x)) > RESIDUAL * (1.0 + np.max(np.abs(x))):
        raise UsageError("model: 'phi_inverse' does not invert 'phi'")
    rate = np.array(model.dynamics(x, z, u))
    step = 1e-5 / (1.0 + float(np.max(np.abs(rate))))
    ahead, behind = (
        np.array(model.zeta(tuple(np.array(x) + sign * step * rate), z)) for sign in (1.0, -1.0)
    )
    found = (ahead - behind) / (2.0 * step)
    wanted = np.append(zeta[1:], 0.0)
    wanted[model.ends] = np.array(model.gamma(tuple(zeta), u)) + np.array(
        model.lam(tuple(zeta), u)
    ) @ np.array(z)
    worst = int(np.argmax(np.abs(found - wanted)))
    if abs(found[worst] - wanted[worst]) > RESIDUAL * (1.0 + np.max(np.abs(wanted))):
        raise UsageError(
            f'model: the derivative of zeta[{worst}] along the dynamics is {found[worst]:.6g}, but '
            f'the model returns {wanted[worst]:.6g} (a wrong chain, or one that is not linear in Z)'
        )


def trajectory(model: SwitchedModel, events: int, step: float = 1e-3) -> tuple[Array, Array, Array]:
    """Simulate `events` evenly spaced typical events; return times, shape (n,), states, and Z.

    Row i is at time i * step; Z is the one from then on. Runge-Kutta 4.
    """
    x, z = np.array(model.start[0]), np.array(model.start[1])
    per_period = round(model.period / step)
    count = events * per_period
    states, discrete = np.empty((count + 1, len(x))), np.empty((count + 1, len(z)))
    y_at = tuple(model.zeta(tuple(x), tuple(z))[i] for i in model.firsts)
    for i in range(count + 1):
        if i and i % per_period == 0:
            mode, v = model.event
            matrix = model.transition(mode)
            if matrix is not None:
                z = np.array(matrix) @ z + np.array(model.offset(mode, v, y_at))
            y_at = tuple(model.zeta(tuple(x), tuple(z))[j] for j in model.firsts)
        states[i], discrete[i] = x, z
        t = i * step

        def slope(at: Array, time: float, z: Array = z) -> Array:
            return np.array(model.dynamics(at.tolist(), z.tolist(), model.probe(time)))

        k1 = slope(x, t)
        k2 = slope(x + 0.5 * step * k1, t + 0.5 * step)
        k3 = slope(x + 0.5 * step * k2, t + 0.5 * step)
        x = x + step / 6.0 * (k1 + 2.0 * (k2 + k3) + slope(x + step * k3, t + step))
    return np.arange(count + 1) * step, states, discrete


def observability(model: SwitchedModel, steps: int, events: int = 12) -> float:
    """Return the largest value, over a trajectory, of the least singular value of (28).

    0 means that the rank is never reached. If the typical event does not change the discrete part,
    rows within an interval are used.
    """
    times, states, discrete = trajectory(model, events)
    per_period = round(model.period / 1e-3)
    ends = np.arange(per_period - 1, len(times), per_period)
    matrix = model.transition(model.event[0])
    a = np.eye(model.size) if matrix is None else np.array(matrix)
    if np.allclose(a, np.eye(model.size)):
        ends = np.arange(0, len(times), max(1, per_period // 10))
        steps = max(steps, 2 * model.size)
    rows = [
        np.array(model.lam(model.zeta(states[i], discrete[i]), model.probe(times[i]))) for i in ends
    ]
    best = 0.0
    for first in range(len(rows) - steps):
        stacked = np.vstack(
            [rows[first + j] @ np.linalg.matrix_power(a, j) for j in range(steps + 1)]
        )
        values = np.linalg.svd(stacked, compute_uv=False)
        if len(values) >= model.size and values[-1] > RANK * values[0]:
            best = max(best, float(values[-1]))
    return best
