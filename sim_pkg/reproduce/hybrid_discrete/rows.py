"""Rows of the hybrid paper: its example (B1 to B3) and the gripper joint (C)."""

from __future__ import annotations

import numpy as np

from estimator_pkg.models import gripper
from sim_pkg.reproduce.contract import AT_LEAST, AT_MOST, PERCENT, Part, Reference, Values, family
from sim_pkg.reproduce.hybrid_discrete.runs import GRIPS_AT, example, grip, plant

TRAJECTORY = {
    0.5: ((1.199458, -0.339095, 1.438488, 2.697046), (1.45, -0.05, 0.38)),
    1.0: ((1.599477, -0.826917, 3.714690, 2.675047), (2.304458, -0.295, 1.110488)),
    2.0: ((2.832161, -3.372946, 3.791968, -7.740110), (7.264123, -0.821478, 3.797737)),
    5.0: ((3.087851, -9.201672, 2.531517, -5.541215), (7.030729, -2.058817, -0.500132)),
    20.0: ((3.071312, -8.706833, 3.052841, -8.594280), (8.734506, -1.927146, 1.172436)),
}

B1 = tuple(
    Reference(f'B1 {t:g} s {name}{i + 1}', 'of the trajectory', value, 1e-5)
    for t, (x, z) in TRAJECTORY.items()
    for name, values in (('x', x), ('z', z))
    for i, value in enumerate(values)
)


def b1_values() -> Values:
    """The values of B1."""
    model, times, states, z = plant(1e-3)
    for t in TRAJECTORY:
        i = round(t / 1e-3)
        for name, row in (('x', states[i]), ('z', z[i])):
            for j, value in enumerate(row):
                yield f'B1 {t:g} s {name}{j + 1}', value


# B2: times until the errors stay below (.05, 1, .05, 1), in the first interval and from the fourth

WHAT = ('zeta2', 'theta1', 'zeta4', 'theta2')
FIRST = (0.009, 0.086, 0.010, 0.085)
TIMES = {
    'none': (0.032, 0.170, 0.068, 0.302),
    'states': (0.000, 0.079, 0.000, 0.008),
    'all': (0.000, 0.000, 0.000, 0.000),
}
FINE, COARSE = 1e-4, 1e-3  # [s]
AT_1_MS = {
    'first interval': (0.008, 0.082, 0.007, 0.084),
    'reset states': (0.000, 0.077, 0.000, 0.007),
}
EXPLICIT = {'first interval': (0.010, 0.325, 0.010, 0.086), 'reset none': (0.033, 0.5, 0.069, 0.30)}
STARTS = {(0.5, -0.5, 0.5): 8.3e-6, (2.0, -2.0, 2.0): 3.6e-5}

B2 = (
    *family(
        'B2 first interval',
        'time until an error stays small, implicit 0.1 ms [s]',
        dict(zip(WHAT, FIRST)),
        6e-4,
    ),
    *(
        reference
        for reset, values in TIMES.items()
        for reference in family(
            f'B2 reset {reset}',
            'worst such time after an event, intervals 3 to 39 [s]',
            dict(zip(WHAT, values)),
            6e-4,
        )
    ),
    *family(
        'B2 Z',
        'largest entry of |Zhat - Z|, implicit 0.1 ms',
        {'k=2': 1.3e-5, 'k=2..40': 1.14e-3},
        5.0,
        PERCENT,
        {'k=2': 'Fig. 4: after a few steps'},
    ),
    *family('B2 Z at 1 ms', 'the same at 1 ms', {'k=2': 1.3e-4, 'k=2..40': 1.14e-2}, 5.0, PERCENT),
    *(
        reference
        for name, values in AT_1_MS.items()
        for reference in family(
            f'B2 {name} at 1 ms',
            'time until an error stays small, implicit 1 ms [s]',
            dict(zip(WHAT, values)),
            1.1e-3,
        )
    ),
    *family(
        'B2 x error at 1 ms',
        'largest error of a state from 1 s on, implicit 1 ms',
        {'x2': 2.5e-2, 'x4': 1.5e-2},
        5.0,
        PERCENT,
    ),
    *(
        Reference(
            f'B2 Z from {start}',
            'largest entry of |Zhat - Z| at k = 2, implicit 0.1 ms',
            value,
            5.0,
            PERCENT,
        )
        for start, value in STARTS.items()
    ),
    *(
        reference
        for name, values in EXPLICIT.items()
        for reference in family(
            f'B2 {name}, explicit',
            'time until an error stays small, forward Euler 0.1 ms [s]',
            dict(zip(WHAT, values)),
            25.0,
            PERCENT,
        )
    ),
    *family(
        'B2 Z, explicit',
        'largest entry of |Zhat - Z|, forward Euler 0.1 ms',
        {'k=2': 3.8e-2, 'k=2..40': 1.2},
        25.0,
        PERCENT,
    ),
    *family(
        'B2 x error, no reset',
        'largest error of a state from 1 s on',
        {'x2': 3.4, 'x4': 3.4},
        5.0,
        PERCENT,
    ),
    *family(
        'B2 x error',
        'largest error of a state from 1 s on',
        {'x2': 2.5e-3, 'x4': 1.5e-3},
        5.0,
        PERCENT,
    ),
    *family(
        'B2 Zhat(2)',
        'the first that is learnt',
        {'z1': 2.30445, 'z2': -0.29499, 'z3': 1.11049},
        1e-5,
    ),
    *family(
        'B2 copy',
        'largest entry of |Zhat - Z| from A_d and beta_d alone',
        {'k=0': 0.5, 'k=1': 0.45, 'k=2': 0.105, 'k=3': 0.0305},
        1e-4,
    ),
    *family(
        'B2 copy',
        'largest entry of |Zhat - Z| from A_d and beta_d alone',
        {'k=10': 8.5e-5, 'k=20': 5.6e-9},
        1.0,
        PERCENT,
    ),
    Reference(
        'B2 explicit 1 ms Z',
        'largest entry of |Zhat - Z|, forward Euler (it chatters)',
        0.5,
        kind=AT_LEAST,
    ),
)


def b2_values() -> Values:
    """The values of B2."""
    for reset in TIMES:
        run = example(FINE, reset=reset)
        for name, value in zip(WHAT, run.settling(3, 39, FINE)):
            yield f'B2 reset {reset} {name}', value
        late = np.abs(run.state_error[round(1.0 / FINE) :]).max(axis=0)
        if reset == 'none':
            for name, value in zip(WHAT, run.settling(0, 0, FINE)):
                yield f'B2 first interval {name}', value
            yield 'B2 x error, no reset x2', late[1]
            yield 'B2 x error, no reset x4', late[3]
        if reset == 'all':
            yield 'B2 x error x2', late[1]
            yield 'B2 x error x4', late[3]
            yield 'B2 Z k=2', run.discrete_error[2]
            yield 'B2 Z k=2..40', run.discrete_error[2:].max()
            for j in range(3):
                yield f'B2 Zhat(2) z{j + 1}', run.z_hat[2, j]
    for start in STARTS:
        yield f'B2 Z from {start}', example(FINE, start=start, events=2).discrete_error[2]
    chattering = example(FINE, form='explicit', reset='none')
    for name, first, last in (('first interval', 0, 0), ('reset none', 3, 39)):
        for what, value in zip(WHAT, chattering.settling(first, last, FINE)):
            yield f'B2 {name}, explicit {what}', value
    yield 'B2 Z, explicit k=2', chattering.discrete_error[2]
    yield 'B2 Z, explicit k=2..40', chattering.discrete_error[2:].max()
    states = example(COARSE, reset='states')
    for name, first, last in (('first interval', 0, 0), ('reset states', 3, 39)):
        for what, value in zip(WHAT, states.settling(first, last, COARSE)):
            yield f'B2 {name} at 1 ms {what}', value
    late = np.abs(states.state_error[round(1.0 / COARSE) :]).max(axis=0)
    yield 'B2 x error at 1 ms x2', late[1]
    yield 'B2 x error at 1 ms x4', late[3]
    coarse = example(COARSE)
    yield 'B2 Z at 1 ms k=2', coarse.discrete_error[2]
    yield 'B2 Z at 1 ms k=2..40', coarse.discrete_error[2:].max()
    copied = example(COARSE, discrete='copy').discrete_error
    for k in (0, 1, 2, 3, 10, 20):
        yield f'B2 copy k={k}', copied[k]
    explicit = example(COARSE, form='explicit')
    yield 'B2 explicit 1 ms Z', explicit.discrete_error[2:].max()


B3 = (
    *family(
        'B3 noise',
        'rms of the largest entry of |Zhat - Z|, k >= 4, implicit 1 ms',
        {'0': 0.002, '1e-06': 0.33, '1e-05': 0.48, '0.0001': 0.98, '0.001': 1.6},
        40.0,
        PERCENT,
    ),
    *family(
        'B3 noise, copy',
        'largest entry of |Zhat - Z| at k = 40',
        {'1e-06': 3e-6, '0.001': 3e-3},
        kind=AT_MOST,
    ),
)


def b3_values() -> Values:
    """The values of B3."""
    for noise in (0.0, 1e-6, 1e-5, 1e-4, 1e-3):
        error = example(COARSE, noise=noise).discrete_error[4:]
        yield f'B3 noise {noise:g}', np.sqrt(np.mean(np.square(error)))
        if noise in (1e-6, 1e-3):
            yield (
                f'B3 noise, copy {noise:g}',
                example(COARSE, noise=noise, discrete='copy').discrete_error[40],
            )


# C: relative error of Z, in % of the entry, on the gripper joint

GRIP_TIMES = (1.99, 2.5, 3.0, 3.99)  # [s]
CASCADE = {'discrete': 'inversion', 'steps': 3, 'settle': 0.0, 'virtual': 0.1}

C = (
    *family(
        'C cascade, flush, exact',
        'largest error of an entry of Z [%]',
        {f'{t:g} s': 3.0 for t in GRIP_TIMES},
        kind=AT_MOST,
    ),
    *family(
        'C cascade, no flush, exact',
        'largest error of an entry of Z [%]',
        {'2.4 s': 10.0},
        kind=AT_LEAST,
    ),
    *family(
        'C cascade, no flush, exact',
        'largest error of an entry of Z [%]',
        {'3 s': 3.0},
        kind=AT_MOST,
    ),
    *family(
        'C cascade, flush, 16 bit',
        'largest error of an entry of Z [%]',
        {'3 s': 10.0},
        kind=AT_LEAST,
    ),
    *family(
        'C regression, exact',
        'largest error of an entry of Z [%]',
        {f'{t:g} s': 3.0 for t in GRIP_TIMES},
        kind=AT_MOST,
    ),
    *family(
        'C regression, 16 bit',
        'largest error of an entry of Z [%]',
        {f'{t:g} s': 2.0 for t in GRIP_TIMES},
        kind=AT_MOST,
    ),
    *family(
        'C regression, 12 bit',
        'largest error of an entry of Z [%]',
        {f'{t:g} s': 5.0 for t in GRIP_TIMES},
        kind=AT_MOST,
    ),
    Reference(
        'C velocity',
        'rms velocity error in 0.5 s after the event over that before, 16 bit',
        2.0,
        kind=AT_MOST,
    ),
    Reference(
        'C not converged', 'time after the event without a converged Z, 16 bit [s]', 0.3, 2e-3
    ),
)


def _error(z: np.ndarray, t: float) -> float:
    """Largest relative error of an entry of Z at t [%]."""
    true = np.array(gripper.OPEN if t < GRIPS_AT else gripper.CLOSED)
    return float(100.0 * np.abs(z[round(t * 1e3)] / true - 1.0).max())


def c_values() -> Values:
    """The values of C."""
    exact = grip(0, **CASCADE)
    for t in GRIP_TIMES:
        yield f'C cascade, flush, exact {t:g} s', _error(exact.z, t)
    blind = grip(0, mode='same', **CASCADE)
    for t in (2.4, 3.0):
        yield f'C cascade, no flush, exact {t:g} s', _error(blind.z, t)
    yield 'C cascade, flush, 16 bit 3 s', _error(grip(65536, **CASCADE).z, 3.0)
    for name, counts in (('exact', 0), ('16 bit', 65536), ('12 bit', 4096)):
        run = grip(counts)
        for t in GRIP_TIMES:
            yield f'C regression, {name} {t:g} s', _error(run.z, t)
        if name == '16 bit':
            at = round(GRIPS_AT * 1e3)
            before, after = (
                np.sqrt(np.mean(np.square(part)))
                for part in (run.velocity_error[at - 500 : at], run.velocity_error[at : at + 500])
            )
            yield 'C velocity', after / before
            yield 'C not converged', 1e-3 * int(np.argmax(run.converged[at + 1 :]))


PARTS = (
    Part('B1', B1, b1_values),
    Part('B2', B2, b2_values),
    Part('B3', B3, b3_values),
    Part('C', C, c_values),
)
