"""Hybrid observer: velocities that stay right when known events switch the dynamics.

Step-by-step super-twisting (22) gives the outputs' derivatives and, last, what ends each chain,
without knowing Z. From that the discrete state Z follows in one of three ways (`discrete`):

    inversion   (25), (28), (29): at each event, from the last N + 1 intervals; for exact outputs
    regression  within an interval, from filtered signals and least squares: for noisy encoders
    copy        Z+ = A_d Z + beta_d alone

Events come at known instants by `jump`. Each stage is sampled implicitly, in closed form, or by
forward Euler (`form: explicit`), which chatters. Python with numpy: the model is the user's.

Barbot, Djemai, Manamanni: State observer and observability conditions for a class of hybrid
continuous-discrete dynamic system (2007); corrections in docs/papers/hybrid_discrete.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from estimator_pkg.errors import UsageError
from estimator_pkg.models.switched import OWN, SwitchedModel, check, load
from estimator_pkg.observers.adaptive_filter import companion
from estimator_pkg.observers.angle import is_angle
from estimator_pkg.observers.circle import Circle, wrap
from estimator_pkg.observers.contract import COASTING, INITIALISING, TRACKING, Functions, Observer
from estimator_pkg.observers.convention import begin, follow, present
from estimator_pkg.observers.scatter import begin_scatter, follow_scatter, resume_scatter
from estimator_pkg.observers.unrolled import algebra
from estimator_pkg.parameters import parameter

LAMBDA, ALPHA = 1.5, 1.1     # lambda = 1.5 sqrt(L), alpha = 1.1 L
VAGUE = 1e8                  # variance of an unknown Z, in variances of the reading
CERTAIN = 0.1                # a standard deviation below this part of Z counts as converged
FORGOTTEN = 8.0              # time constants of the regression's filter until a start is forgotten


@dataclass(frozen=True)
class Gains:
    """Parameters of `switched`."""

    model: str = parameter(
        'gripper', unit='', choices=(*OWN, 'package.module:name'), structural=True,
        description='the system: one of ours, or your own SwitchedModel')
    discrete: str = parameter(
        'regression', unit='', choices=('regression', 'inversion', 'copy'), structural=True,
        description='how Z is found: regression for noisy encoders; inversion as in the paper, for '
                    'exact outputs only; copy: from A_d and beta_d alone', equation='(28), (29)')
    form: str = parameter(
        'implicit', unit='', choices=('implicit', 'explicit'), structural=True,
        description='sampling of super-twisting; explicit chatters, kept to show why not')
    gate: float = parameter(
        1e-3, unit='unit of the output', range=(1e-12, 1e6),
        description='a stage runs while the errors of all before it are below this',
        equation='epsilon in (23)')
    steps: int = parameter(
        1, unit='', range=(1, 20), structural=True,
        description='intervals that the inversion looks back', equation='N in (28)')
    singular_value: float = parameter(
        0.05, unit='', range=(0.0, 1e9),
        description='the inversion is used while the least singular value of its matrix is above')
    settle: float = parameter(
        0.3, unit='s', range=(0.0, 1e6),
        description='after an event Z is predicted, and not converged, for so long; two events '
                    'closer than this leave the prediction', equation='tau_c in (26)')
    reset: str = parameter(
        'all', unit='', choices=('all', 'states', 'none'), structural=True,
        description='what is moved by (13) at an event: the states of both kinds, and (all) what '
                    'ends the chains')
    filter_rate: float = parameter(
        25.0, unit='1/s', range=(1e-3, 1e5), structural=True,
        description='pole of the filter of the regression; as high as the noise allows')
    memory: float = parameter(
        0.0, unit='s', range=(0.0, 1e9),
        description='the regression forgets with this time constant within an interval; 0: never')
    bound_scale: float = parameter(
        1.0, unit='', range=(1e-6, 1e6),
        description="factor on the model's bounds L of the outputs' derivatives")
    quantum: float = parameter(
        0.0, unit='rad', range=(0.0, 10.0),
        description='smallest step of the measurement; 0: not known')
    noise: float | None = parameter(
        None, unit='rad', range=(1e-12, 10.0),
        description='standard deviation of the measurement noise; unset: estimated')


@dataclass(frozen=True)
class SwitchedFunctions(Functions):
    """The contract's functions, for tuples of outputs, and what is known beside the outputs.

    states : (state) -> x, in the coordinates of the model.
    outputs : (state, measurement) -> (position, velocity) of each output.
    discrete : (state) -> (Z, its standard deviations, converged).
    chains : (state) -> (zeta, what ends the chains).
    jump : (state, (mode, v)) -> state, at a switching instant.
    """

    init: Callable[[Any, tuple], Any]

    states: Callable[[Any], tuple[float, ...]] = tuple
    outputs: Callable[[Any, tuple], list[tuple[float, float]]] = lambda state, measurement: []
    discrete: Callable[[Any], tuple[tuple[float, ...], tuple[float, ...], bool]] = (
        lambda state: ((), (), False))
    chains: Callable[[Any], tuple[tuple[float, ...], tuple[float, ...]]] = (
        lambda state: ((), ()))
    jump: Callable[[Any, tuple], Any] = lambda state, event: state


class _State(NamedTuple):
    """zh, zt: for each output, the estimates and (from the second derivative on) the auxiliary
    states, of which the last ends the chain; errors: the last error of each stage.
    """

    zh: tuple[tuple[float, ...], ...]
    zt: tuple[tuple[float, ...], ...]
    errors: tuple[tuple[float, ...], ...]
    y: tuple[float, ...]             # newest outputs, unwrapped
    u: tuple[float, ...]             # newest input
    z: tuple[float, ...]             # Z as learnt
    predicted: tuple[float, ...]     # Z as predicted at the last event
    y_at: tuple[float, ...]          # outputs at the last event
    history: tuple                   # (Lambda, Y, A_d, beta_d) of the last intervals
    age: float                       # since the last event, or gap [s]
    total: float                     # since the start [s]
    deaf: float                      # the filters hold what is not known for so long [s]
    fitted: bool                     # the last inversion could be used
    filters: tuple                   # (of y, of Gamma, of the columns of Lambda, carried) by output
    last_columns: tuple              # Gamma and Lambda's columns at the newest sample
    origin: tuple                    # columns at the last event: derivatives count from there
    p: tuple                         # of least squares
    power: float                     # mean square of its residual
    conventions: tuple
    scatters: tuple


def implicit_stage(error: float, slope: float, h: float, gain: float, alpha: float
                   ) -> tuple[float, float]:
    """One super-twisting stage: (error left, slope), from the error of the prediction."""
    size, most = abs(error), h * h * alpha
    if size <= most:
        return 0.0, slope + error / h
    sign = 1.0 if error > 0.0 else -1.0
    root = 0.5 * (math.sqrt(h * h * gain * gain + 4.0 * (size - most)) - h * gain)
    return sign * root * root, slope + sign * h * alpha


def explicit_stage(error: float, slope: float, h: float, gain: float, alpha: float
                   ) -> tuple[float, float]:
    """The same by forward Euler: `error` is that before the step, and so is what it returns."""
    sign = 1.0 if error > 0.0 else -1.0 if error < 0.0 else 0.0
    return error, slope + sign * h * alpha


def build(gains: Gains, circle: Circle) -> SwitchedFunctions:
    """The functions of the observer of this model; `circle` is that of every output.

    Raises
    ------
    UsageError : a model that is not right, or whose rank is never reached with these `steps`.
    """
    model = load(gains.model)
    if gains.discrete != 'copy':
        check(model, gains.steps)
    p, m, period = len(model.indices), model.size, float(circle.period)
    outputs = range(p)
    scale = gains.bound_scale
    stages = [[(LAMBDA * math.sqrt(scale * bound), ALPHA * scale * bound) for bound in own]
              for own in model.bounds]
    implicit = gains.form == 'implicit'
    regression = gains.discrete == 'regression'
    columns = [tuple(-math.comb(k, i + 1) * gains.filter_rate ** (i + 1) for i in range(k))
               for k in model.indices]
    made = [companion(k) for k in model.indices]
    free, wide = algebra(m), [algebra(k) for k in model.indices]
    orders = model.orders or tuple((0,) * (m + 1) for _ in outputs)
    ends, indices = model.ends, model.indices
    if any(order > 1 or order >= k for own, k in zip(orders, indices) for order in own):
        raise UsageError("model: 'orders' may be 0, or 1 where the chain is longer than 1")

    def design() -> tuple:
        return ()

    def prepare(design: tuple, dt: float) -> tuple:
        return (dt, tuple((made[i].rows(f, columns[i]), g0, g1) for i, (f, g0, g1) in enumerate(
            made[i].series(columns[i], gains.filter_rate, dt) for i in outputs)))

    def signals(y: tuple, u: tuple, zeta: tuple) -> tuple:
        """For each output: Gamma, then the columns of Lambda (or what they are derivatives of)."""
        if model.basis is not None:
            return tuple(tuple(float(x) for x in row) for row in model.basis(y, u))
        return tuple((float(g), *map(float, row))
                     for g, row in zip(model.gamma(zeta, u), model.lam(zeta, u)))

    def chains(state: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
        zeta: list[float] = []
        for i in outputs:
            zeta += [state.y[i], *state.zt[i][:-1]]
        return tuple(zeta), tuple(zt[-1] for zt in state.zt)

    def resting(i: int, value: float) -> tuple[float, ...]:
        """The filter of output i, settled on a constant."""
        return (*(0.0,) * (indices[i] - 1), -value / columns[i][-1])

    def init(measurement: tuple, design: tuple) -> _State:
        y = tuple(map(float, measurement))
        zero = tuple((0.0,) * k for k in indices)
        nothing = (0.0,) * m
        u = (0.0,) * len(model.probe(0.0))
        zeta = tuple(x for i in outputs for x in (y[i], *(0.0,) * (indices[i] - 1)))
        first = signals(y, u, zeta)
        return _State(
            tuple((y[i], *(0.0,) * (indices[i] - 1)) for i in outputs), zero, zero, y, u, nothing,
            nothing, y, (), 0.0, 0.0, FORGOTTEN / gains.filter_rate, False,
            tuple((resting(i, y[i]), (0.0,) * indices[i],
                   tuple((0.0,) * indices[i] for _ in range(m)), (0.0,) * indices[i])
                  for i in outputs),
            first, first, vague(), 0.0, tuple(map(begin, y)), tuple(map(begin_scatter, y)))

    def vague() -> tuple:
        return tuple(tuple(VAGUE if i == j else 0.0 for j in range(m)) for i in range(m))

    def climb(i: int, state: Any, jump: float, h: float) -> tuple:
        """(zh, zt, errors) of output i after the step-by-step stages (22)."""
        zh, zt, errors = list(state.zh[i]), list(state.zt[i]), list(state.errors[i])
        open_gate, signal = True, state.y[i] + jump
        for j, (gain, alpha) in enumerate(stages[i]):
            if not open_gate:
                break
            if implicit:
                ahead = zh[j] + h * zt[j]
                left, zt[j] = implicit_stage(signal - ahead, zt[j], h, gain, alpha)
                zh[j] = signal - left
            else:
                before = state.y[i] if j == 0 else state.zt[i][j - 1]
                left, slope = explicit_stage(before - zh[j], zt[j], h, gain, alpha)
                root = math.sqrt(abs(left))
                zh[j] += h * (zt[j] + gain * (root if left > 0.0 else -root))
                zt[j] = slope
            errors[j] = left
            open_gate = abs(left) < gains.gate
            signal = zt[j]
        return tuple(zh), tuple(zt), tuple(errors)

    def step(state: Any, coefficients: tuple, design: tuple, measurement: tuple, given: tuple
             ) -> _State:
        h, filters_of = coefficients
        u = tuple(map(float, given))
        jumps = tuple(wrap(float(measurement[i]) - state.conventions[i][0], period)
                      for i in outputs)
        climbed = [climb(i, state, jumps[i], h) for i in outputs]
        y = tuple(state.y[i] + jumps[i] for i in outputs)
        state = state._replace(
            zh=tuple(c[0] for c in climbed), zt=tuple(c[1] for c in climbed),
            errors=tuple(c[2] for c in climbed), u=u, age=state.age + h, total=state.total + h,
            deaf=max(0.0, state.deaf - h),
            conventions=tuple(follow(state.conventions[i], float(measurement[i]), period)
                              for i in outputs),
            scatters=tuple(follow_scatter(state.scatters[i], float(measurement[i]), h, period)
                           for i in outputs))
        return learn(state, y, jumps, filters_of, h) if regression else state._replace(y=y)

    def learn(state: Any, y: tuple, jumps: tuple, filters_of: tuple, h: float) -> _State:
        """Filter everything and take the rows into least squares."""
        # the input was u all the time, so the columns run from (y before, u) to (y now, u)
        from_zeta = chains(state)[0]
        before = (signals(state.y, state.u, from_zeta) if model.basis is not None
                  else state.last_columns)
        state = state._replace(y=y)
        now = signals(y, state.u, chains(state)[0])
        z, q, power, filters = state.z, state.p, state.power, []
        ready = state.deaf <= 0.0
        keep = math.exp(-h / gains.memory) if gains.memory > 0.0 else 1.0
        for i in outputs:
            left, add = made[i].left, wide[i].add
            f, g0, g1 = filters_of[i]
            of_y, of_gamma, of_columns, carried = state.filters[i]

            def fed(row: tuple, start: float, end: float, left: Callable = left,
                    add: Callable = add, f: tuple = f, g0: tuple = g0, g1: tuple = g1) -> tuple:
                return add(add(left(row, f), start, g0), end - start, g1)

            of_y = fed(of_y, y[i] - jumps[i], y[i])
            of_gamma = fed(of_gamma, before[i][0], now[i][0])
            shift = [state.origin[i][j + 1] if orders[i][j + 1] else 0.0 for j in range(m)]
            of_columns = tuple(fed(of_columns[j], before[i][j + 1] - shift[j],
                                   now[i][j + 1] - shift[j]) for j in range(m))
            carried = left(carried, f)
            filters.append((of_y, of_gamma, of_columns, carried))
            k = indices[i]
            rows = tuple(of_columns[j][k - 1 - orders[i][j + 1]] for j in range(m))
            target = (y[i] + wide[i].dot(columns[i], of_y)
                      - of_gamma[k - 1 - orders[i][0]] - carried[k - 1])
            if ready:
                residual = target - free.dot(rows, z)
                direction = free.apply(q, rows)
                spread = keep + free.dot(rows, direction)
                z = free.add(z, residual / spread, direction)
                q = free.rank_one(q, 1.0 / keep, -1.0 / (keep * spread), direction)
                power += 0.02 * (residual * residual / spread - power)
        return state._replace(z=z, p=q, power=power, filters=tuple(filters), last_columns=now)

    def jump(state: Any, event: tuple) -> _State:
        """At a switching instant; `event` is (mode, v)."""
        mode, v = event
        zeta, theta = chains(state)
        known = model.transition(mode)
        shown = discrete(state)[0]
        if known is None:
            return carry(state)._replace(history=(), predicted=shown, p=vague(), age=0.0,
                                         y_at=state.y, fitted=False)
        a, beta = np.array(known), np.array(model.offset(mode, v, state.y_at))
        row = (np.array(model.lam(zeta, state.u)),
               np.array(theta) - np.array(model.gamma(zeta, state.u)), a, beta,
               settled(state) and gates_open(state))
        history = (*state.history, row)[-(gains.steps + 1):]
        old, fitted = np.array(shown), False
        if gains.discrete == 'inversion':
            old, fitted = inverted(history, old)
        new = tuple((a @ old + beta).tolist())
        after = carry(state)._replace(
            history=history, predicted=new, z=tuple((a @ np.array(state.z) + beta).tolist()),
            age=0.0, y_at=state.y, fitted=fitted,
            p=tuple(map(tuple, (a @ np.array(state.p) @ a.T).tolist())))
        return after if gains.reset == 'none' else moved(after, tuple(old.tolist()), new)

    def inverted(history: tuple, fallback: Any) -> tuple[Any, bool]:
        """(Z(k), it could be used), k the interval that ends, from the last N + 1 by (28)."""
        if len(history) <= gains.steps or not all(row[4] for row in history):
            return fallback, False
        matrix, rest = np.eye(m), np.zeros(m)
        blocks, right, at = [], [], (matrix, rest)
        for lam, y, a, beta, _ in history:
            blocks.append(lam @ matrix)
            right.append(y - lam @ rest)
            at = (matrix, rest)
            matrix, rest = a @ matrix, a @ rest + beta
        stacked = np.vstack(blocks)
        u, values, vt = np.linalg.svd(stacked, full_matrices=False)
        if len(values) < m or values[-1] <= gains.singular_value:
            return fallback, False
        first = vt.T @ ((u.T @ np.concatenate(right)) / values)
        return at[0] @ first + at[1], True

    def moved(state: Any, old: tuple, new: tuple) -> _State:
        """The reset (13): x does not jump, so zeta does; both kinds of states move with it."""
        zeta, theta = chains(state)
        after = model.zeta(model.state(zeta, old), new)
        ending = tuple(theta)
        if gains.reset == 'all':
            lam = np.array(model.lam(after, state.u))
            ending = tuple((np.array(model.gamma(after, state.u)) + lam @ np.array(new)).tolist())
        zh, zt = [], []
        for i in outputs:
            first = ends[i] + 1 - indices[i]
            change = [after[first + j] - zeta[first + j] for j in range(indices[i])]
            zh.append((state.zh[i][0], *(state.zh[i][j] + change[j]
                                         for j in range(1, indices[i]))))
            zt.append((*(after[first + j] for j in range(1, indices[i])), ending[i]))
        return state._replace(zh=tuple(zh), zt=tuple(zt))

    def carry(state: Any) -> _State:
        """From now on the filters of Lambda begin anew; what they hold goes on with the old Z.

        Where that is not known, learning waits until they have forgotten it.
        """
        filters, z = [], state.z
        for i in outputs:
            of_y, of_gamma, of_columns, carried = state.filters[i]
            add = wide[i].add
            for j in range(m):
                column = of_columns[j]
                if orders[i][j + 1]:  # as if the derivative had been filtered
                    fed = state.last_columns[i][j + 1] - state.origin[i][j + 1]
                    column = add(made[i].after(column, columns[i]), fed,
                                 (1.0, *(0.0,) * (indices[i] - 1)))
                carried = add(carried, z[j], column)
            filters.append((of_y, of_gamma, tuple((0.0,) * indices[i] for _ in range(m)),
                            carried))
        deaf = state.deaf if certain(state) else FORGOTTEN / gains.filter_rate
        return state._replace(filters=tuple(filters), origin=state.last_columns, deaf=deaf)

    def gates_open(state: Any) -> bool:
        return all(abs(e) < gains.gate for errors in state.errors for e in errors[:-1])

    def settled(state: Any) -> bool:
        return state.age > gains.settle

    def certain(state: Any) -> bool:
        """Least squares knows Z."""
        most = CERTAIN * max(abs(x) for x in state.z)
        return state.deaf <= 0.0 and max(sigmas(state)) <= most

    def sigmas(state: Any) -> tuple[float, ...]:
        return tuple(math.sqrt(max(0.0, state.power * state.p[j][j])) for j in range(m))

    def discrete(state: Any) -> tuple[tuple[float, ...], tuple[float, ...], bool]:
        if not regression:
            return state.predicted, (math.nan,) * m, state.fitted or gains.discrete == 'copy'
        if not settled(state) or state.deaf > 0.0:
            return state.predicted, (math.inf,) * m, False
        return state.z, sigmas(state), certain(state)

    def states(state: Any) -> tuple[float, ...]:
        return model.state(chains(state)[0], discrete(state)[0])

    def given_outputs(state: Any, measurement: tuple) -> list[tuple[float, float]]:
        return [(present(state.conventions[i], state.zh[i][0], period, float(circle.unwrap)),
                 state.zt[i][0]) for i in outputs]

    def status(state: Any) -> int:
        if state.total <= min(gains.settle, 0.3) or not gates_open(state):
            return INITIALISING
        return TRACKING if state.age > 0.0 else COASTING

    def output(state: Any, coefficients: tuple, design: tuple, measurement: tuple,
               given: tuple) -> tuple:
        position, velocity = given_outputs(state, measurement)[0]
        return position, velocity, math.nan, status(state)

    def stddev(state: Any, coefficients: tuple, design: tuple) -> tuple[float, float]:
        floor = gains.quantum * gains.quantum / 12.0
        variance = (gains.noise * gains.noise + floor if gains.noise is not None
                    else max(state.scatters[0][0], floor))
        sigma = math.sqrt(variance)
        return sigma, math.sqrt(scale * model.bounds[0][0] * sigma)

    def resume(state: Any, coefficients: tuple, design: tuple, measurement: tuple) -> _State:
        """After a gap: positions from the measurement, speeds and Z kept, filters anew."""
        fresh = init(measurement, design)
        y = tuple(state.y[i] + wrap(float(measurement[i]) - state.conventions[i][0], period)
                  for i in outputs)
        return fresh._replace(
            zh=tuple((y[i], *state.zh[i][1:]) for i in outputs), zt=state.zt, y=y, u=state.u,
            z=discrete(state)[0], predicted=discrete(state)[0], y_at=y, p=state.p,
            filters=tuple((resting(i, y[i]), *fresh.filters[i][1:]) for i in outputs),
            conventions=tuple(follow(state.conventions[i], float(measurement[i]), period)
                              for i in outputs),
            scatters=tuple(resume_scatter(state.scatters[i], float(measurement[i]))
                           for i in outputs))

    def finite(measurement: tuple) -> bool:
        return len(measurement) == p and all(is_angle(x) for x in measurement)

    return SwitchedFunctions(
        design, prepare, init, step, output, stddev, resume, lambda dt: None, lambda dt: 0.0,
        finite, (0.0,) * p, (0.0,) * len(model.probe(0.0)), jump, states=states,
        outputs=given_outputs, discrete=discrete, chains=chains)


__all__ = ['OBSERVER', 'Gains', 'SwitchedFunctions', 'SwitchedModel', 'build']

OBSERVER = Observer(
    name='switched', summary='hybrid observer of systems that known events switch',
    gains=Gains, build=build,
    reference='Barbot, Djemai, Manamanni (2007): State observer and observability conditions for a '
              'class of hybrid continuous-discrete dynamic system', kind='switched')
