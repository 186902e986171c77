# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The mathematics of the sensorless observer: jump, exponential, scheme X, identifier, noise."""

import cmath
import math

import numpy as np
import pytest
from scipy.linalg import expm

from estimator_pkg.observers.maths.clarke import clarke, phases
from estimator_pkg.observers.pmsm import identifier
from estimator_pkg.observers.pmsm.drive import DriveSample
from estimator_pkg.observers.pmsm.equations import emf, reflect
from estimator_pkg.observers.pmsm.identifier import credible, shift, solve
from estimator_pkg.observers.pmsm.scheme import advance, exponential, prepare_scheme, turned_emf
from estimator_pkg.observers.pmsm.state import Design, Registers, Scheme
from sim_pkg.reproduce.pmsm.motor import core_of, vectors_of

R, L, FLUX = 0.06, 33.75e-6, 1.9e-3
K_P, K_I, K_ETA, GAMMA = 2.18e4, 9.34e3, 95.7, 4582.0


def unit(degrees):
    return cmath.exp(1j * math.radians(degrees))


def test_a_reset_mirrors_eta_and_leaves_the_static_frame_alone():
    random = np.random.default_rng(1)
    for _ in range(200):
        z, rotor = unit(random.uniform(0, 360)), unit(random.uniform(0, 360))
        chi = random.uniform(0.1, 9.0)
        i = complex(*random.normal(size=2))
        h = -1j * chi * z.conjugate() * rotor
        core = core_of(i, h, z)
        y, reset = emf(core), reflect(core)
        new_i, new_h, new_z = vectors_of(core)
        eta, new_eta = z.conjugate() * rotor, new_z.conjugate() * rotor
        if eta.real <= 0.0:
            assert abs(new_eta + eta.conjugate()) < 1e-12  # eta+ = -F eta
            assert reset
        else:
            assert not reset and (new_i, new_h, new_z) == (i, h, z)
        # the misprinted row (h+ = G_f i) would change these
        assert abs(new_z * new_i - z * i) < 1e-12
        assert abs(new_z * new_h - z * h) < 1e-12
        assert emf(core) == pytest.approx(y, abs=1e-12)
        assert complex(*y) == pytest.approx(z * (1j * h), abs=1e-12)
    nothing = core_of(1j, 0j, 1 + 0j)
    assert reflect(nothing) and vectors_of(nothing) == (1j, 0j, 1 + 0j)


@pytest.mark.parametrize('dt', [1e-6, 5e-5, 1e-3])
@pytest.mark.parametrize('k_p', [2.18e4, 300.0, 6e5])
def test_the_exponential_is_exact(dt, k_p):
    """Complex, nearly equal and real eigenvalues."""
    a = np.array([[-(R / L + k_p), 1.0 / L], [-K_I, 0.0]])
    ours = np.array(exponential(a[0, 0], a[0, 1], a[1, 0], 0.0, dt)).reshape(2, 2)
    assert np.allclose(ours, expm(a * dt), rtol=1e-10, atol=1e-13 * np.abs(expm(a * dt)).max())


@pytest.mark.parametrize('k_p', [1e6, 1e9])
def test_the_exponential_of_a_strongly_damped_system_does_not_overflow(k_p):
    """cosh(k_p dt/2) is beyond every float; the system is slow and fast, and stable."""
    a = np.array([[-k_p, 3e4], [-9e3, 0.0]])
    ours = np.array(exponential(a[0, 0], a[0, 1], a[1, 0], 0.0, 0.01)).reshape(2, 2)
    slow = -3e4 * 9e3 / k_p * 0.01  # what is left: the slow pole
    assert ours[1, 1] == pytest.approx(math.exp(slow), rel=1e-3)
    assert np.all(np.isfinite(ours)) and abs(ours[0, 0]) < 1e-3


def scheme_of(dt):
    scheme = Scheme()
    prepare_scheme(scheme, R, L, K_P, K_I, dt)
    return scheme


def sample_of(current, voltage):
    sample = DriveSample()
    sample.i_alpha, sample.i_beta = current.real, current.imag
    sample.u_alpha, sample.u_beta = voltage.real, voltage.imag
    return sample


def test_a_runaway_frame_stays_finite():
    scheme = scheme_of(5e-4)
    core, x = core_of(0j, 5.0 + 5.0j, 1.0 + 0.0j), 2500.0
    for k in range(5000):
        core.i_alpha, core.i_beta = 20.0 * unit(100.0 * k).real, 20.0 * unit(100.0 * k).imag
        now = sample_of(20.0 * unit(100.0 * (k + 1)), 5.0 + 0j)
        x, speed = advance(core, scheme, now, x, K_ETA, GAMMA, 0.0)
    assert all(math.isfinite(abs(value)) for value in (*vectors_of(core), x))


def test_the_integral_of_a_turning_emf_is_exact():
    for turn in (1e-7, 0.3, -2.5):
        before, omega = 3.0 * unit(20.0), turn / 1e-4
        now = before * cmath.exp(1j * turn)
        *area, turned = turned_emf(before.real, before.imag, now.real, now.imag, 1e-4)
        assert turned == pytest.approx(turn, rel=1e-6)
        assert abs(complex(*area) - (now - before) / (1j * omega)) < 1e-9
    zero = emf(core_of(0j, 0j, 1.0 + 0j))  # a back-EMF that begins has not turned: without -0.0
    assert turned_emf(*zero, 3.0, -2.0, 1e-4)[2] == 0.0
    assert turned_emf(*zero, *zero, 1e-4) == (0.0, 0.0, 0.0)


def ticks(omega, period, count=5, noise=0.0, seed=1):
    """Registers after `count` ticks of exact data at constant speed."""
    random = np.random.default_rng(seed)
    registers, chi = Registers(), abs(omega) * FLUX
    sign = 1.0 if omega > 0.0 else -1.0
    for k in range(count):
        y = sign * chi * cmath.exp(1j * omega * period * k)
        integral = (y - y * cmath.exp(-1j * omega * period)) / (1j * omega)
        y += complex(*random.normal(0.0, noise, 2))
        shift(registers, 2, y.real, y.imag, chi, integral.real, integral.imag)
    return registers


def gated(registers, lowest=200.0, highest=1500.0, least_emf=0.2):
    design = Design()
    design.periods, design.xi_low, design.xi_high = 2, lowest, highest
    return credible(registers, design, *solve(registers, 2), least_emf)


@pytest.mark.parametrize(
    ('gate', 'tight'),
    [
        ('', 0.0),
        ('CHORD', 1.3),
        ('FIT_RESIDUAL', 1e-4),
        ('lowest', 600.0),
        ('highest', 500.0),
        ('least_emf', 2.0),
    ],
)
def test_each_gate_refuses_what_it_is_for(gate, tight, monkeypatch):
    """Sound data passes all gates; then one of them is drawn tight."""
    found, more = ticks(1000.0, 5e-3, noise=0.05), {}
    if gate.isupper():
        monkeypatch.setattr(identifier, gate, tight)
    elif gate:
        more = {gate: tight}
    assert gated(found, **more) == (gate == '')


def test_the_gates_refuse_whole_turns_per_tick():
    """The printed identifier divides noise by nothing there."""
    for seed in range(50):
        found = ticks(2.0 * math.pi / 5e-3, 5e-3, noise=0.01, seed=seed)
        assert not gated(found)
    assert abs(solve(found, 2)[0] - 1.0 / FLUX) > 270.0


def test_clarke_is_amplitude_invariant_and_drops_the_common_part():
    angle = 0.7
    a, b, c = (3.0 * math.cos(angle - k * 2.0 * math.pi / 3.0) + 5.0 for k in range(3))
    vector = clarke(a, b, c)
    assert vector == pytest.approx((3.0 * math.cos(angle), 3.0 * math.sin(angle)))
    assert phases(*vector) == pytest.approx((a - 5.0, b - 5.0, c - 5.0))
