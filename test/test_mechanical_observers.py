"""geso, hgo, ehgo and smo: steps, gains, limits, standard deviations, trouble."""

from __future__ import annotations

import math

import numpy as np
import pytest

from estimator_pkg import observers
from estimator_pkg.driver.compiled import available, compiled
from estimator_pkg.driver.joint import Joint, JointSettings
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.models.mechanics import load
from estimator_pkg.models.motion import make_plant
from estimator_pkg.observers import mechanical_gains, smo
from estimator_pkg.observers.circle import Circle
from estimator_pkg.observers.contract import COASTING, INITIALISING, NOT_OBSERVABLE, TRACKING
from estimator_pkg.observers.mechanical_algebra import mechanical_algebra
from estimator_pkg.observers.mechanical_flow import make_flow
from estimator_pkg.observers.mechanical_noise import discrete, exponential
from estimator_pkg.parameters import build

NAMES = ('geso', 'hgo', 'ehgo', 'smo')
MODELS = ('single_joint', 'cart_pendulum', 'robotic_leg')
FAST = ('pendulum_inertia=1', 'pendulum_moment=0.9', 'moving_mass=1', 'gravity=1')


def made(name, circle=None, **values):
    """The functions of an observer of mechanisms."""
    record = observers.find(name)
    gains = build(record.gains, values)
    return record.build(gains, circle or Circle())


def driven(functions, dt, stamps, readings, inputs=None):
    """(velocities, statuses, last state) of a run, without the driver's guard."""
    design = functions.design()
    coefficients = functions.prepare(design, dt)
    state = functions.init(readings[0], design)
    velocities, statuses = [], []
    for k in range(1, stamps):
        u = inputs[k - 1] if inputs is not None else (0.0,) * max(1, functions.mechanics.inputs)
        state = functions.step(state, coefficients, design, readings[k], u)
        _, velocity, _, status = functions.output(state, coefficients, design, readings[k], u)
        velocities.append(velocity)
        statuses.append(status)
    return np.array(velocities), statuses, state


def motion(model, assignments, q, v, dt, count, inputs=None):
    """(positions, velocities) as lists of tuples."""
    mechanics = load(model, assignments)
    plant = make_plant(mechanics)
    positions, speeds = [], []
    for k in range(count):
        positions.append(q)
        speeds.append(v)
        u = inputs[k] if inputs is not None else (0.0,) * max(1, mechanics.inputs)
        q, v = plant(mechanics.values, q, v, u, dt, 4)
    return positions, np.array(speeds)


# The exact step

@pytest.mark.parametrize('n', (1, 2, 3, 5))
@pytest.mark.parametrize('diagonal, damped, disturbed', [
    (True, False, False), (False, True, False), (True, True, True), (False, False, True)])
@pytest.mark.parametrize('dt', (1e-3, 0.1, 3.0))
def test_flow_is_the_matrix_exponential(n, diagonal, damped, disturbed, dt):
    expm = pytest.importorskip('scipy.linalg').expm
    random = np.random.default_rng(n)
    calm, psi, weights = (random.normal(size=(n, n)) for _ in range(3))
    L = np.diag(random.uniform(5.0, 15.0, n))
    if not diagonal:
        L = L + 0.3 * random.normal(size=(n, n))
    b = np.diag(random.uniform(20.0, 100.0, n)) @ calm.T
    damping, gain_d = 0.1 * weights * damped, 2.0 * weights * disturbed
    e, p, d, f, r = (random.normal(size=n) for _ in range(5))
    nought = np.zeros((n, n))
    matrix = np.block([[-L, calm, nought], [-b, -damping, psi.T * disturbed],
                       [-gain_d, nought, nought]])
    whole = np.zeros((3 * n + 1, 3 * n + 1))
    whole[:-1, :-1], whole[:-1, -1] = matrix, np.concatenate([-r, f, np.zeros(n)])
    wanted = (expm(whole * dt) @ np.concatenate([e, p, d * disturbed, [1.0]]))[:-1]

    def rows(values):
        return tuple(map(tuple, values.tolist()))

    flow = make_flow(n, diagonal=diagonal, damped=damped, disturbed=disturbed)
    found = flow(tuple(e), tuple(p), tuple(d) if disturbed else (), rows(calm), rows(psi), rows(b),
                 tuple(np.diag(L)) if diagonal else rows(L), rows(damping), rows(gain_d),
                 tuple(f), tuple(r), dt)
    assert found[3]
    x = np.concatenate([found[0], found[1], found[2] if disturbed else np.zeros(n)])
    np.testing.assert_allclose(x, wanted, rtol=0.0, atol=1e-11 * np.max(np.abs(wanted)))


@pytest.mark.parametrize('size', (1, 2, 3, 6))
def test_algebra_solves(size):
    random = np.random.default_rng(size)
    root = random.normal(size=(size, size))
    matrix, x = root @ root.T + np.eye(size), random.normal(size=size)
    found = mechanical_algebra(size).solve(tuple(map(tuple, matrix.tolist())), tuple(x.tolist()))
    np.testing.assert_allclose(matrix @ np.array(found), x, atol=1e-12)


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('form', ('exact', 'paper'))
@pytest.mark.skipif(not available(), reason='needs numba')
def test_plain_and_compiled_agree_step_by_step(name, model, form):
    functions = made(name, model=model, form=form)
    design = functions.design()
    coefficients = functions.prepare(design, 1e-3)
    state = functions.init(functions.blank, design)
    step = compiled(functions.step)
    random = np.random.default_rng(0)
    y = np.array(functions.blank)
    for _ in range(60):
        y = y + 1e-3 * random.normal(size=len(y))
        u = tuple(random.normal(size=functions.mechanics.inputs).tolist())
        plain = functions.step(state, coefficients, design, tuple(y.tolist()), u)
        twin = step(state, coefficients, design, tuple(y.tolist()), u)
        for part, other in ((plain[0], twin[0]), (plain[3], twin[3]), (plain[4], twin[4])):
            np.testing.assert_allclose(np.hstack(part), np.hstack(other), rtol=1e-12, atol=1e-13)
        state = plain


def test_exact_step_needs_no_small_dt():
    """Gains far beyond dt K < L: Euler is refused with the limit, the exact step is stable."""
    gains = {'L': [50.0, 80.0], 'Gamma': [400.0, 150.0], 'model': 'cart_pendulum'}
    euler = made('geso', form='paper', **gains)
    words = euler.limits(1.0 / 112.0)
    assert 'form: exact' in words and 'less than' in words
    assert made('geso', **gains).limits(1.0) is None
    limit = float(words.split('less than ')[1].split(' ')[0])
    assert euler.limits(0.999 * limit) is None and euler.limits(1.001 * limit) is not None
    positions, truth = motion('cart_pendulum', (), (math.pi - 0.4, 0.0), (0.0, 0.2), 1.0 / 112.0,
                              400)
    velocities, _, _ = driven(made('geso', **gains), 1.0 / 112.0, 400, positions)
    assert np.max(np.abs(velocities[200:] - truth[201:])) < 0.03


def test_error_of_geso_is_linear_at_any_speed():
    """At 40 rad/s and strong coupling, GESO beats HGO by far more than 10 times (spec 5.3)."""
    dt, count = 1e-4, 20000
    positions, truth = motion('cart_pendulum', FAST, (1.37, -0.1), (40.0, 0.35), dt, count)
    found = {}
    for name, gains in (('geso', {'Gamma': [70.0]}), ('hgo', {'K': [70.0]})):
        functions = made(name, model='cart_pendulum', model_parameters=list(FAST), L=[10.0],
                         **gains)
        velocities, _, _ = driven(functions, dt, count, positions)
        error = (velocities - truth[1:])[15000:]
        found[name] = math.sqrt(np.mean(np.sum(error ** 2, axis=1)))
    assert found['hgo'] > 10.0 * found['geso']
    assert found['geso'] < 0.05


# Frequency response, about a frozen configuration

@pytest.mark.parametrize('name', ('geso', 'hgo', 'ehgo'))
@pytest.mark.parametrize('form, hold', [('exact', 'linear'), ('exact', 'previous'),
                                        ('paper', 'previous')])
@pytest.mark.parametrize('hertz', (0.5, 3.0, 10.0, 40.0))
def test_frequency_response_is_the_closed_form(name, form, hold, hertz):
    """From the pendulum's angle to its velocity, gain within 5 % and phase within 3 degrees."""
    dt = 1e-3
    functions = made(name, model='cart_pendulum', form=form, hold=hold, bandwidth_hz=8.0,
                     model_parameters=['gravity=0'], operating_point=[0.6, 0.0])
    at = np.array([0.6, 0.0])
    matrix, shown = functions.core.linear(at, np.zeros(2))
    step, arrival = discrete(matrix, 2, dt, euler=form == 'paper',
                             linear_hold=form == 'exact' and hold == 'linear')
    z = np.exp(2j * math.pi * hertz * dt)
    response = np.linalg.solve(np.eye(len(step)) - step / z, arrival[:, 0] * (1.0 - 1.0 / z))
    wanted = (shown @ response[2:4])[0]
    count = round((1.0 + 3.0 / hertz) / dt)
    size = 1e-6
    wave = size * np.exp(2j * math.pi * hertz * dt * np.arange(count))
    readings = [(0.6 + value.imag, 0.0) for value in wave]
    velocities, _, _ = driven(functions, dt, count, readings)
    last = round(2.0 / hertz / dt)
    part, carrier = velocities[-last:, 0], wave[-last:] / size
    fit = np.linalg.lstsq(np.column_stack([carrier.imag, carrier.real]), part, rcond=None)[0]
    found = complex(fit[0], fit[1]) / size
    assert abs(abs(found) / abs(wanted) - 1.0) < 0.05
    assert abs(math.degrees(np.angle(found / wanted))) < 3.0


@pytest.mark.parametrize('name', ('geso', 'hgo', 'ehgo'))
def test_bandwidth_is_the_minus_3_db_frequency(name):
    """From true to estimated velocity, for motion that the model does not foresee."""
    functions = made(name, model='single_joint', bandwidth_hz=12.0, damping=0.8)
    matrix, shown = functions.core.linear(np.zeros(1), np.zeros(1))
    s = 2j * math.pi * 12.0
    arrival = np.zeros(len(matrix))
    arrival[0] = -1.0
    gain = (shown @ np.linalg.solve(s * np.eye(len(matrix)) - matrix, arrival)[1:2])[0]
    # e' holds the rate of the measurement, so the transfer is from velocity
    assert abs(gain) == pytest.approx(math.sqrt(0.5), rel=1e-6)


# Gains

def test_gamma_follows_from_k_at_the_operating_point():
    functions = made('geso', model='robotic_leg', L=[1.2, 2.0, 2.0], K=[3.9, 2.5, 1.3])
    K = np.array(functions.describe(1e-3)['K'])
    np.testing.assert_allclose(K, np.diag([3.9, 2.5, 1.3]), atol=1e-12)
    other = functions.describe(1e-3)
    assert other['slowest_pole_over_range'] > 0.0
    assert other['noise_figure'][0] == pytest.approx(3.9 ** 2 / 2.4)
    assert other['dt_K_below_L']


@pytest.mark.parametrize('name, values, words', [
    ('geso', {'L': [10.0], 'Gamma': [-3.0]}, "'Gamma' is not positive definite"),
    ('geso', {'L': [-10.0], 'Gamma': [3.0]}, 'not Hurwitz'),
    ('geso', {'L': [10.0]}, "needs 'Gamma' or 'K'"),
    ('geso', {'L': [10.0, 2.0, 3.0], 'Gamma': [1.0]}, 'takes 1, 2 or 4'),
    ('geso', {'L': [10.0], 'Gamma': [1.0, 2.0, 0.0, 1.0]}, 'not symmetric'),
    ('geso', {'L': [10.0], 'Gamma': [1.0], 'K': [1.0]}, 'not both'),
    ('geso', {'operating_point': [1.0]}, 'operating_point'),
    ('hgo', {'L': [10.0], 'K': [-70.0]}, 'does not decay'),
    ('hgo', {'h': [1.0, 2.0, 3.0]}, "'hgo' takes 2"),
    ('ehgo', {'h': [1.0, 1.0, 4.0]}, 'do not make the error decay'),
    ('smo', {'L': [1.0]}, "no 'L'")])
def test_wrong_gains_are_refused_in_one_line(name, values, words):
    with pytest.raises(UsageError) as error:
        made(name, model='cart_pendulum', **values)
    assert words in str(error.value)


def test_geso_of_a_curved_mechanism_offers_hgo():
    with pytest.raises(UserError, match="use the observer 'hgo'"):
        made('geso', model='own_models:TwoLinks')
    assert made('hgo', model='own_models:TwoLinks').mechanics.degrees == 2


def test_remark_5_needs_its_weight():
    """-L Hurwitz and not positive: without P0 the printed injection is unstable, with it stable."""
    L, calm = np.array([[-0.5, 2.0], [-2.0, 1.0]]), np.diag([10.0, 1.0])
    P0 = mechanical_gains.lyapunov_weight(L)
    assert np.linalg.eigvalsh(P0 @ L + L.T @ P0)[0] > 0.0

    def worst(weight):
        return -mechanical_gains.slowest_pole(
            np.block([[-L, calm], [-calm.T @ weight, np.zeros((2, 2))]]))

    assert worst(np.eye(2)) > 0.2 and worst(P0) < -0.1
    np.testing.assert_array_equal(mechanical_gains.lyapunov_weight(np.diag([3.0, 4.0])), np.eye(2))


def test_guaranteed_rate_holds_and_the_printed_one_does_not():
    """Proposition 4.1 with b = 0.9: dW/dt <= -c4 |e|^2 with k0; with k1 in its place it fails."""
    mechanics = load('cart_pendulum', FAST)
    L, gamma = np.eye(2) * 10.0, np.eye(2) * 70.0
    speed, step = 3.0, 1e-6
    angles = np.linspace(-math.pi, math.pi, 61)
    from estimator_pkg.models import check

    def calm(angle):
        return check.factors(mechanics, np.array([angle, 0.0]))[0]

    rates = [speed * (calm(a + step) - calm(a - step)) / (2.0 * step) for a in angles]
    sizes = np.array([np.linalg.svd(calm(a), compute_uv=False) for a in angles])
    k0, k1 = sizes[:, 1].min(), sizes[:, 0].max()
    k2 = max(np.linalg.norm(rate, 2) for rate in rates)

    def worst(found):
        value = -math.inf
        for angle, rate in zip(angles, rates):
            m = calm(angle)
            a = np.block([[-L, m], [-gamma @ m.T, np.zeros((2, 2))]])
            for sign in (1.0, -1.0):
                p = np.block([[found.c1 * np.eye(2), -m], [-m.T, found.c1 * np.linalg.inv(gamma)]])
                p_rate = np.block([[np.zeros((2, 2)), -sign * rate],
                                   [-sign * rate.T, np.zeros((2, 2))]])
                w = 0.5 * (p @ a + a.T @ p + p_rate)
                value = max(value, np.linalg.eigvalsh(w + found.c4 * np.eye(4))[-1])
        return value

    assert worst(mechanical_gains.guaranteed_rate(L, gamma, k0, k1, k2)) <= 1e-9
    printed = mechanical_gains.guaranteed_rate(L, gamma, k1, k1, k2)
    assert worst(printed) > 0.0


def test_an_unknown_constant_force_is_found():
    """With a disturbance state, a constant force that the model does not know leaves no error."""
    dt, count = 1e-3, 4000
    inputs = [(0.2,)] * count
    positions, truth = motion('single_joint', ('inertia=0.1', 'damping=0.5'), (0.0,), (0.0,), dt,
                              count, inputs)
    error = {}
    for hertz in (0.0, 2.0):
        functions = made('geso', model='single_joint', model_parameters=['inertia=0.1',
                                                                         'damping=0.5'],
                         bandwidth_hz=5.0, disturbance_hz=hertz)
        velocities, _, _ = driven(functions, dt, count, positions, [(0.0,)] * count)
        error[hertz] = abs(velocities[-1, 0] - truth[-1, 0])
    assert error[0.0] > 0.03
    assert error[2.0] < 0.01 * error[0.0]


# Sliding modes

@pytest.mark.parametrize('step, inject', [(smo.implicit_twisting, smo.twisting),
                                          (smo.implicit_uniform, smo.uniform)])
@pytest.mark.parametrize('free', (-2.0, -1e-3, 1e-9, 0.3))
def test_implicit_step_solves_its_equation(step, inject, free):
    h, first, second, m1, m2 = 1e-2, 1.5, 2.2, 1.86, 0.303
    e, two = step(free, h, first, second, m1, m2)
    if e == 0.0:
        held = second if step is smo.implicit_twisting else second * 0.5 * m1 * m1
        assert abs(two) <= held and h * h * two == pytest.approx(free)
        return
    one, again = inject(e, first, second, m1, m2)
    assert again == pytest.approx(two)
    assert e + h * one + h * h * two == pytest.approx(free, rel=1e-9)


def test_smo_is_exact_below_its_bound_and_fails_beyond():
    dt, count = 1e-3, 3000
    time = dt * np.arange(count)
    for acceleration, good in ((5.0, True), (20.0, False)):
        functions = made('smo', model='single_joint', mu=[10.0])
        readings = [(x,) for x in (0.5 * acceleration * np.minimum(time, 2.0) ** 2).tolist()]
        velocities, _, _ = driven(functions, dt, 2000, readings,
                                  [(0.0,)] * count)
        error = abs(velocities[-1, 0] - acceleration * time[1999])
        assert (error < 0.02 * acceleration) == good


# Trouble

def leg(**values):
    """An observer of the leg."""
    return made('geso', model='robotic_leg', bandwidth_hz=5.0, **values)


def test_leaving_the_domain_coasts_and_is_never_infinite():
    dt = 1e-3
    functions = leg()
    angle = 2.6 + 1.0 * dt * np.arange(1000)   # passes pi at 0.54 s
    readings = [(2.0, float(a), 0.4) for a in angle]
    velocities, statuses, state = driven(functions, dt, 1000, readings, [(0.0, 0.0)] * 1000)
    assert np.all(np.isfinite(velocities))
    outside = np.abs(np.sin(angle[1:])) <= 0.02
    assert outside.sum() > 20
    assert all(statuses[k] != TRACKING for k in np.flatnonzero(outside))
    assert COASTING in statuses or NOT_OBSERVABLE in statuses or INITIALISING in statuses
    assert np.max(np.abs(velocities[:, 1])) < 20.0


def test_standing_at_the_singularity_is_not_observable():
    functions = leg()
    _, statuses, state = driven(functions, 1e-3, 600, [(2.0, math.pi, 0.4)] * 600,
                                [(0.0, 0.0)] * 600)
    assert statuses[-1] == NOT_OBSERVABLE
    assert 'outside the domain' in functions.why(state, functions.design())


def test_missing_effort_coasts_and_then_withholds():
    functions = made('geso', model='cart_pendulum', bandwidth_hz=10.0)
    readings = [(0.1, 0.0)] * 1600
    inputs = [(0.0,)] * 1000 + [(math.nan,)] * 600
    velocities, statuses, state = driven(functions, 1e-3, 1600, readings, inputs)
    assert statuses[990] == TRACKING
    assert statuses[1005] == COASTING
    assert statuses[-1] == NOT_OBSERVABLE
    assert np.all(np.isfinite(velocities))
    assert 'no effort for cart' in functions.why(state, functions.design())
    design = functions.design()
    coefficients = functions.prepare(design, 1e-3)
    for _ in range(1000):
        state = functions.step(state, coefficients, design, (0.1, 0.0), (0.0,))
    assert functions.output(state, coefficients, design, (0.1, 0.0), (0.0,))[3] == TRACKING


def test_far_off_positions_start_the_observer_again():
    functions = made('hgo', model='single_joint', bandwidth_hz=0.05)
    readings = [(0.0,)] * 10 + [(1.5,)] * 11000
    _, statuses, _ = driven(functions, 1e-3, len(readings), readings)
    assert statuses[20] != TRACKING


def test_wrapping_joints_wrap_and_sliding_ones_do_not():
    dt, count = 1e-3, 4000
    functions = made('geso', model='cart_pendulum', model_parameters=list(FAST), bandwidth_hz=5.0)
    positions, truth = motion('cart_pendulum', FAST, (0.0, 0.0), (9.0, 4.0), dt, count)
    wrapped = [((q1 + math.pi) % (2.0 * math.pi) - math.pi, q2) for q1, q2 in positions]
    velocities, statuses, state = driven(functions, dt, count, wrapped)
    assert np.max(np.abs(velocities[2000:] - truth[2001:])) < 0.05
    design = functions.design()
    shown = functions.output(state, functions.prepare(design, dt), design, wrapped[-1], (0.0,))[0]
    assert shown[0] == pytest.approx(wrapped[-1][0], abs=0.01)
    assert positions[-1][1] > 5.0 and shown[1] == pytest.approx(positions[-1][1], abs=0.01)


# Standard deviations

@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('form', ('exact', 'paper'))
def test_stddev_is_the_scatter_of_the_estimate(name, form):
    dt, count, noise = 2e-3, 20000, (1e-3, 4e-4)
    own = {'mu': [3.0]} if name == 'smo' else {'bandwidth_hz': 8.0}
    functions = made(name, model='cart_pendulum', form=form, model_parameters=['gravity=0'], **own)
    random = np.random.default_rng(5)
    readings = [(0.6 + x, y) for x, y in (random.normal(size=(count, 2)) * noise).tolist()]
    velocities, _, state = driven(functions, dt, count, readings)
    design = functions.design()
    told = functions.stddev(state, functions.prepare(design, dt), design)[1]
    spread = np.std(velocities[5000:], axis=0)
    np.testing.assert_allclose(told, spread, rtol=0.12)


@pytest.mark.parametrize('values', [
    {'mu': [30.0]}, {'mu': [3000.0]}, {'mu': [3.0], 'hold': 'previous'},
    {'variant': 'uniform', 'k1': [5.0], 'k2': [20.0]}, {'mu': [300.0], 'form': 'paper'}],
    ids=('strong', 'one step', 'held', 'uniform', 'euler'))
@pytest.mark.skipif(not available(), reason='slow without numba')
def test_stddev_of_sliding_modes_holds_from_weak_to_strong(values):
    """Chattering and noise: from a filter of the noise to a sliding mode met in every sample."""
    dt, count, noise = 2e-3, 20000, 1e-3
    functions = made('smo', model='single_joint', **values)
    readings = [(x,) for x in (noise * np.random.default_rng(3).normal(size=count)).tolist()]
    design = functions.design()
    coefficients, state = functions.prepare(design, dt), functions.init(readings[0], design)
    step, velocities, positions = compiled(functions.step), [], []
    for reading in readings[1:]:
        state = step(state, coefficients, design, reading, (0.0,))
        velocities.append(state[0][3][0])
        positions.append(reading[0] + state[0][0][0])
    told = functions.stddev(state, coefficients, design)
    assert told[1][0] == pytest.approx(np.std(velocities[8000:]), rel=0.12)
    assert told[0][0] == pytest.approx(np.std(positions[8000:]), rel=0.12)


def test_noise_law():
    """var(vh) = s^2 dt K^2 / (2 L) where K dt << L << 1/dt."""
    functions = made('hgo', model='single_joint', L=[20.0], K=[100.0], noise=[1e-3])
    design, dt = functions.design(), 1e-4
    state = functions.init((0.0,), design)
    told = functions.stddev(state, functions.prepare(design, dt), design)[1][0]
    assert told == pytest.approx(1e-3 * math.sqrt(dt * 100.0 ** 2 / 40.0), rel=0.01)


def test_exponential():
    expm = pytest.importorskip('scipy.linalg').expm
    matrix = np.random.default_rng(1).normal(size=(6, 6)) * 3.0
    np.testing.assert_allclose(exponential(matrix), expm(matrix), rtol=1e-9)


# Through the driver, and with a user's model

def test_a_users_numpy_model_gives_the_same_as_the_built_in_one():
    record = observers.find('geso')
    numbers = ['pendulum_inertia=1', 'pendulum_moment=0.5', 'moving_mass=1', 'gravity=1']
    found = []
    for values in ({'model': 'own_models:CartPendulum'},
                   {'model': 'cart_pendulum', 'model_parameters': numbers}):
        joint = Joint(record, build(record.gains, {'bandwidth_hz': 5.0, **values}),
                      JointSettings())
        for k in range(200):
            joint.update(10 ** 12 + k * 10 ** 6, (0.3 + 1e-3 * k, 0.2), (0.4,))
        found.append(joint.estimate()[1])
    np.testing.assert_allclose(found[0], found[1], rtol=1e-6)


def test_the_driver_drops_numbers_that_are_no_readings():
    record = observers.find('hgo')
    joint = Joint(record, record.gains(model='cart_pendulum'), JointSettings())
    assert joint.update(10 ** 9, (0.0, 0.0), (0.0,))
    assert not joint.update(2 * 10 ** 9, (math.nan, 0.0), (0.0,))
    assert joint.dropped() == {'non_finite': 1}


def test_exact_step_is_of_second_order_in_fast_motion():
    """The model is evaluated half-way between samples: a quarter of the error at half the dt."""
    found = []
    for dt in (2e-3, 1e-3):
        count = round(6.0 / dt)  # the start is forgotten after 5 s
        positions, truth = motion('cart_pendulum', FAST, (1.37, -0.1), (12.0, 0.35), dt, count)
        functions = made('geso', model='cart_pendulum', model_parameters=list(FAST), L=[10.0],
                         Gamma=[70.0])
        velocities, _, _ = driven(functions, dt, count, positions)
        late = round(5.0 / dt)
        found.append(math.sqrt(np.mean((velocities - truth[1:])[late:] ** 2)))
    assert found[1] < 0.27 * found[0]
