# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The reference runs of Bosso et al. (2020): exact signals, the observer in continuous time by RK4.

Motor, profile and starts are those of the tables in docs/papers/pmsm.md.
"""

from __future__ import annotations

import cmath
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.engine.calls import run
from estimator_pkg.observers.pmsm.equations import reflect
from estimator_pkg.observers.pmsm.identifier import shift, solve
from estimator_pkg.observers.pmsm.state import Core, Registers
from estimator_pkg.record import record
from sim_pkg.pmsm.profiles import P1, Profile

# Table 1
RESISTANCE, INDUCTANCE, FLUX, POLE_PAIRS = 0.06, 33.75e-6, 1.9e-3, 7
INERTIA, LOAD = 2.5e-5, 2.5e-7  # kg m^2; N m s^2 (quadratic, ours: the paper names none)
K_P, K_I, K_ETA, GAMMA, CLOCK, PERIODS = 2.18e4, 9.34e3, 95.7, 4582.0, 200.0, 2

CONTINUOUS, HYBRID, ID_PRE, ID_POST, ID_EARLY = range(5)
OBSERVERS = ('cont', 'hyb', 'id_pre', 'id_post', 'id_early')

# name: (direction, eta0 [deg], xi0 [1/Wb])
STARTS = {
    'A': (1, 0.0, 0.0),
    'B': (1, 179.0, 526.3158),
    'C': (1, 90.0, -526.3158),
    'D': (-1, 179.0, 526.3158),
    'E': (1, 90.0, 1500.0),
    'F': (1, 90.0, 300.0),
    'G': (1, -90.0, 2500.0),
}

THRESHOLD = 4.0 * math.sqrt(GAMMA)  # a larger error of x is replaced [1/Wb]
STEP = 2e-6  # s, of the Runge-Kutta solution
LOG_EVERY = 25  # steps
DURATION = 0.70  # s


@record
class Observed:
    """The observer's state, see `estimator_pkg.observers.pmsm.equations`."""

    i: complex
    h: complex
    z: complex
    x: float
    integral: complex  # of the back-EMF since the last clock tick
    count: int  # ticks
    jumps: int  # reflections
    fires: int  # replacements of x
    core: Core  # what the jump needs
    registers: Registers


Vectors = NDArray[np.complex128]


class Signals(NamedTuple):
    """Arrays of shape (n,): electrical angle [rad] and speed [rad/s], current [A], voltage [V]."""

    time: NDArray[np.float64]
    theta: NDArray[np.float64]
    omega: NDArray[np.float64]
    current: NDArray[np.complex128]
    voltage: NDArray[np.complex128]


def signals(
    times: NDArray[np.float64],
    direction: int = 1,
    profile: Profile | None = None,
    extra_iq: float | None = None,
) -> Signals:
    """Return the exact steady solution of (1) along a profile, with i_d = 0.

    Parameters
    ----------
    times : s, shape (n,).
    direction : -1 negates every speed.
    profile : None: P1.
    extra_iq : constant i_q [A] instead of the one that inertia and load require.
    """
    motion = (profile or Profile(P1)).at(times)
    speed = direction * motion.speed
    theta = POLE_PAIRS * direction * motion.angle
    omega = POLE_PAIRS * speed
    if extra_iq is None:
        torque_constant = 1.5 * POLE_PAIRS * FLUX
        rise = direction * motion.acceleration
        iq = (INERTIA * rise + LOAD * speed * np.abs(speed)) / torque_constant
        diq = (
            INERTIA * direction * motion.jerk + 2.0 * LOAD * np.abs(speed) * rise
        ) / torque_constant
    else:
        iq, diq = np.full(len(theta), extra_iq), np.zeros(len(theta))
    frame = np.exp(1j * theta)
    voltage = frame * (
        1j * (RESISTANCE * iq + INDUCTANCE * diq + omega * FLUX) - INDUCTANCE * omega * iq
    )
    return Signals(np.asarray(times), theta, omega, frame * 1j * iq, voltage)


def thinned(exact: Signals, every: int) -> Signals:
    """Return every n-th row (`every`)."""
    return Signals(
        exact.time[::every],
        exact.theta[::every],
        exact.omega[::every],
        exact.current[::every],
        exact.voltage[::every],
    )


def start_frame(theta0: float, omega0: float, eta0_deg: float) -> complex:
    """Return z at the start: arg z = arg zeta_chi - eta0."""
    turned = theta0 + (math.pi if omega0 < 0.0 else 0.0) - math.radians(eta0_deg)
    return cmath.exp(1j * turned)


def core_of(i: complex, h: complex, z: complex, current: complex = 0j) -> Core:
    """Return the numbers of the observer for these vectors."""
    core = Core()
    core.i1, core.i2, core.h1, core.h2 = i.real, i.imag, h.real, h.imag
    core.z1, core.z2 = z.real, z.imag
    core.i_alpha, core.i_beta = current.real, current.imag
    return core


def vectors_of(core: Core) -> tuple[complex, complex, complex]:
    """Return (i, h, z)."""
    return complex(core.i1, core.i2), complex(core.h1, core.h2), complex(core.z1, core.z2)


def emf(h, z):
    """Return y = C[z] J h [V]."""
    return z * (1j * h)


def start_state(exact: Signals, eta0_deg: float, xi0: float) -> Observed:
    """Return the observer at the start of a run."""
    state = Observed()
    state.z, state.x = start_frame(exact.theta[0], exact.omega[0], eta0_deg), float(xi0)
    state.i = state.z.conjugate() * complex(exact.current[0])
    return state


def tick(state: Observed, kind: int) -> None:
    """Apply a clock tick.

    (26) can be read in three ways: id_post decides after the registers shift, id_pre before (and
    counts one tick less), id_early as id_post but one tick earlier.
    """
    core, registers, h = state.core, state.registers, state.h
    state.count += 1
    count = state.count
    if kind >= ID_PRE:
        before, _, _, _ = solve(registers, PERIODS)
        y, area = emf(h, state.z), state.integral
        shift(registers, PERIODS, y.real, y.imag, abs(h), area.real, area.imag)
        found, _, _, _ = solve(registers, PERIODS)
        if kind == ID_PRE:
            found, count = before, count - 1
        if count > PERIODS + (0 if kind == ID_EARLY else 1) and abs(state.x - found) > THRESHOLD:
            state.x = found
            state.fires += 1
    if kind >= HYBRID:
        core.i1, core.i2, core.h1, core.h2 = state.i.real, state.i.imag, h.real, h.imag
        core.z1, core.z2 = state.z.real, state.z.imag
        if reflect(core):
            state.i, state.h = complex(core.i1, core.i2), complex(core.h1, core.h2)
            state.z = complex(core.z1, core.z2)
            state.jumps += 1
    state.integral = 0j


def flow(i, h, z, x, current, voltage, resistance, inductance, k_p, k_i, k_eta, gamma):
    """Return the time derivatives of (i, h, z, x): the flow of (5) and (16).

    Parameters
    ----------
    current, voltage : measured stator current [A] and voltage [V] in the static frame.
    """
    back = z.conjugate()
    i_frame = back * current
    error = i_frame - i
    turning = complex(0.0, abs(h) * x + k_eta * h.real)  # the speed of the frame
    # the rotation acts on the measured current, so that the fast error system is linear
    d_i = (
        (h + back * voltage - resistance * i) * (1.0 / inductance) - turning * i_frame + k_p * error
    )
    return d_i, k_i * error, turning * z, gamma * h.real


def slope(i, h, z, x, current, voltage):
    """Return the derivatives (5) of the observer's state, with the paper's numbers."""
    return flow(i, h, z, x, current, voltage, RESISTANCE, INDUCTANCE, K_P, K_I, K_ETA, GAMMA)


def runge_kutta_step(i, h, z, x, c0, c1, c2, u0, u1, u2, dt):
    """Return (i, h, z, x) after a step of RK4, and the integral of the back-EMF over it.

    Currents c and voltages u are those at the start, the middle and the end of the step.
    """
    a_i, a_h, a_z, a_x = slope(i, h, z, x, c0, u0)
    a_n = emf(h, z)
    half = 0.5 * dt
    p, q, r, s = i + half * a_i, h + half * a_h, z + half * a_z, x + half * a_x
    b_i, b_h, b_z, b_x = slope(p, q, r, s, c1, u1)
    b_n = emf(q, r)
    p, q, r, s = i + half * b_i, h + half * b_h, z + half * b_z, x + half * b_x
    c_i, c_h, c_z, c_x = slope(p, q, r, s, c1, u1)
    c_n = emf(q, r)
    p, q, r, s = i + dt * c_i, h + dt * c_h, z + dt * c_z, x + dt * c_x
    d_i, d_h, d_z, d_x = slope(p, q, r, s, c2, u2)
    d_n = emf(q, r)
    sixth = dt / 6.0
    i = i + sixth * (a_i + 2.0 * b_i + 2.0 * c_i + d_i)
    h = h + sixth * (a_h + 2.0 * b_h + 2.0 * c_h + d_h)
    z = z + sixth * (a_z + 2.0 * b_z + 2.0 * c_z + d_z)
    x = x + sixth * (a_x + 2.0 * b_x + 2.0 * c_x + d_x)
    return i, h, z, x, sixth * (a_n + 2.0 * b_n + 2.0 * c_n + d_n)


def runge_kutta(
    state: Observed,
    count: int,
    current: Vectors,
    voltage: Vectors,
    dt: float,
    period: int,
    kind: int,
    log_every: int,
    out_h: Vectors,
    out_z: Vectors,
    out_x: NDArray[np.float64],
) -> None:
    """Run RK4 with inputs exact at the stages; ticks at integer multiples of `period` steps.

    Parameters
    ----------
    current, voltage : on a grid of half steps, shape (2 count + 1,).
    out_h, out_z, out_x : h, z and x every `log_every` steps, after the tick; row 0 is the start.
    """
    out_h[0], out_z[0], out_x[0] = state.h, state.z, state.x
    for k in range(count):
        c0, c1, c2 = current[2 * k], current[2 * k + 1], current[2 * k + 2]
        u0, u1, u2 = voltage[2 * k], voltage[2 * k + 1], voltage[2 * k + 2]
        state.i, state.h, state.z, state.x, area = runge_kutta_step(
            state.i, state.h, state.z, state.x, c0, c1, c2, u0, u1, u2, dt
        )
        state.integral += area
        state.z = state.z * (1.0 / abs(state.z))
        if (k + 1) % period == 0:
            tick(state, kind)
        if (k + 1) % log_every == 0:
            row = (k + 1) // log_every
            out_h[row], out_z[row], out_x[row] = state.h, state.z, state.x


class Run(NamedTuple):
    """A logged run: truth at the log times, estimates, numbers of reflections and replacements."""

    truth: Signals
    h: NDArray[np.complex128]
    z: NDArray[np.complex128]
    x: NDArray[np.float64]
    jumps: int
    fires: int


def reference_run(exact: Signals, kind: int, eta0_deg: float, xi0: float) -> Run:
    """Run one observer on exact signals on a grid of half steps."""
    count = (len(exact.time) - 1) // 2
    rows = count // LOG_EVERY + 1
    logs = np.zeros(rows, complex), np.zeros(rows, complex), np.zeros(rows)
    state = start_state(exact, eta0_deg, xi0)
    steps = STEP, round(1.0 / (CLOCK * STEP))
    run(runge_kutta, state, count, exact.current, exact.voltage, *steps, kind, LOG_EVERY, *logs)
    return Run(thinned(exact, 2 * LOG_EVERY), *logs, state.jumps, state.fires)


def exact_grid(direction: int = 1) -> Signals:
    """The exact signals of P1 on the half-step grid of `reference_run`."""
    times = 0.5 * STEP * np.arange(round(2.0 * DURATION / STEP) + 1, dtype=np.float64)
    return signals(times, direction)


class Errors(NamedTuple):
    """Errors over a run: speed [relative], rotor angle [rad], xi [relative], back-EMF [V]."""

    speed: NDArray[np.float64]
    angle: NDArray[np.float64]
    xi: NDArray[np.float64]
    emf: NDArray[np.complex128]
    emf_relative: NDArray[np.float64]


def errors(run: Run) -> Errors:
    """The errors of a run at its log times."""
    truth = run.truth
    sign = np.sign(truth.omega)
    chi = np.abs(truth.omega) * FLUX
    xi = sign / FLUX
    estimate = np.abs(run.h) * run.x
    flip = np.where(run.x < 0.0, -1.0, 1.0)
    angle = np.angle(run.z * flip * np.exp(-1j * truth.theta))
    eta = run.z.conjugate() * sign * np.exp(1j * truth.theta)
    wrong = -1j * chi * eta - run.h
    return Errors(
        (estimate - truth.omega) / np.abs(truth.omega),
        angle,
        (run.x - xi) / np.abs(xi),
        wrong,
        np.abs(wrong) / chi,
    )


def settling(
    times: NDArray[np.float64], error: NDArray[np.float64], bound: float, least: float = 0.020
) -> float:
    """Return the first log time [ms] from which |error| <= bound to the end; nan: never.

    nan also if that is less than `least` [s] before the end.

    Parameters
    ----------
    times : shape (n,), increasing [s].
    error : shape (n,), in the unit of `bound`.
    """
    with np.errstate(invalid='ignore'):
        outside = np.flatnonzero(~(np.abs(error) <= bound))
    first = 0 if len(outside) == 0 else outside[-1] + 1
    if first >= len(times) or times[-1] - times[first] < least:
        return math.nan
    return 1e3 * float(times[first])


def settle_times(run: Run) -> dict[str, float]:
    """Return the five settling times of the tables [ms]; nan: never."""
    found, times = errors(run), run.truth.time
    return {
        't_w': settling(times, found.speed, 0.02),
        't_th5': settling(times, found.angle, math.radians(5.0)),
        't_th1': settling(times, found.angle, math.radians(1.0)),
        't_xi': settling(times, found.xi, 0.02),
        't_h': settling(times, found.emf_relative, 0.02),
    }
