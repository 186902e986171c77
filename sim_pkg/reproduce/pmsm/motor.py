# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Bosso et al. (2020): exact signals of the motor, and the observers in continuous time.

The paper states neither profile, load nor start: those here are in docs/papers/pmsm.md.
"""

from __future__ import annotations

import cmath
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from estimator_pkg.observers.pmsm.equations import reflect
from estimator_pkg.observers.pmsm.identifier import shift, solve
from estimator_pkg.observers.pmsm.state import Core, Registers
from sim_pkg.pmsm.profiles import P1, Profile

# Table 1
RESISTANCE, INDUCTANCE, FLUX, POLE_PAIRS = 0.06, 33.75e-6, 1.9e-3, 7
INERTIA, LOAD = 2.5e-5, 2.5e-7  # kg m^2; N m s^2 (quadratic, ours: the paper names none)
K_P, K_I, K_ETA, GAMMA, CLOCK, PERIODS = 2.18e4, 9.34e3, 95.7, 4582.0, 200.0, 2

CONTINUOUS, HYBRID, IDENTIFIER = 'continuous', 'hybrid', 'identifier'

# name: (direction, eta0 [deg], xi0 [1/Wb])
STARTS = {'A': (1, 0.0, 0.0), 'C': (1, 90.0, -526.3158), 'D': (-1, 179.0, 526.3158)}

THRESHOLD = 4.0 * math.sqrt(GAMMA)  # a larger error of x is replaced [1/Wb]
LOG, FINE = 20000, 100000  # Hz: rows of a run; grid on which the signals are interpolated
TOLERANCE = 1e-5  # relative, of the solver
DURATION, LAST, LEAST = 0.70, 0.1, 0.020  # of a run, of its end, to count as settled [s]


class Signals(NamedTuple):
    """Arrays of shape (n,): electrical angle [rad] and speed [rad/s], current [A], voltage [V]."""

    time: NDArray[np.float64]
    theta: NDArray[np.float64]
    omega: NDArray[np.float64]
    current: NDArray[np.complex128]
    voltage: NDArray[np.complex128]


def signals(
    times: NDArray[np.float64], direction: int = 1, profile: Profile | None = None
) -> Signals:
    """Return the exact steady solution of (1) along a profile, with i_d = 0.

    Parameters
    ----------
    times : s, shape (n,).
    direction : -1 negates every speed.
    profile : None: P1.
    """
    motion = (profile or Profile(P1)).at(times)
    speed = direction * motion.speed
    theta = POLE_PAIRS * direction * motion.angle
    omega = POLE_PAIRS * speed
    torque_constant = 1.5 * POLE_PAIRS * FLUX
    rise = direction * motion.acceleration
    iq = (INERTIA * rise + LOAD * speed * np.abs(speed)) / torque_constant
    diq = (INERTIA * direction * motion.jerk + 2.0 * LOAD * np.abs(speed) * rise) / torque_constant
    frame = np.exp(1j * theta)
    voltage = frame * (
        1j * (RESISTANCE * iq + INDUCTANCE * diq + omega * FLUX) - INDUCTANCE * omega * iq
    )
    return Signals(np.asarray(times), theta, omega, frame * 1j * iq, voltage)


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


def emf(h: complex, z: complex) -> complex:
    """Return y = C[z] J h [V]."""
    return z * (1j * h)


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


class Run(NamedTuple):
    """A run: truth and estimates at the log times."""

    truth: Signals
    h: NDArray[np.complex128]
    z: NDArray[np.complex128]
    x: NDArray[np.float64]


class Clock:
    """The jumps (16), (25), (26) at the clock's ticks; (26) decides after the registers shift."""

    def __init__(self, variant: str) -> None:
        self.variant, self.registers, self.count = variant, Registers(), 0

    def tick(
        self, i: complex, h: complex, z: complex, x: float, area: complex
    ) -> tuple[complex, complex, complex, float]:
        """Return (i, h, z, x) after a tick; `area` is the integral of the back-EMF before it."""
        self.count += 1
        if self.variant == IDENTIFIER:
            y = emf(h, z)
            shift(self.registers, PERIODS, y.real, y.imag, abs(h), area.real, area.imag)
            found = solve(self.registers, PERIODS)[0]
            if self.count > PERIODS + 1 and abs(x - found) > THRESHOLD:
                x = found
        core = core_of(i, h, z)
        if self.variant != CONTINUOUS and reflect(core):
            i, h, z = vectors_of(core)
        return i, h, z, x


def continuous_run(variant: str, direction: int, eta0_deg: float, xi0: float) -> Run:
    """Run an observer in continuous time: scipy's Runge-Kutta between the clock's ticks."""
    exact = signals(np.arange(round(DURATION * FINE) + 1) / FINE, direction)
    back = np.exp(-1j * exact.theta)  # in the rotor's frame the signals change slowly
    table = np.column_stack((exact.theta, exact.current * back, exact.voltage * back))
    rows, changes = table.tolist(), np.diff(table, axis=0, append=table[-1:]).tolist()

    def slope(t: float, state: NDArray[np.complex128]) -> list[complex]:
        place = min(int(t * FINE), len(rows) - 1)
        part = t * FINE - place
        angle, current, voltage = (a + part * b for a, b in zip(rows[place], changes[place]))
        turn = cmath.exp(1j * angle.real)
        i, h, z, x, _ = state.tolist()
        found = flow(
            i, h, z, x.real, turn * current, turn * voltage,
            RESISTANCE, INDUCTANCE, K_P, K_I, K_ETA, GAMMA,
        )  # fmt: skip
        return [*found, emf(h, z)]

    z, x = start_frame(exact.theta[0], exact.omega[0], eta0_deg), float(xi0)
    i, h, clock, logs = z.conjugate() * complex(exact.current[0]), 0j, Clock(variant), []
    times = np.arange(round(DURATION * LOG) + 1) / LOG
    for part in np.split(times[:-1], round(DURATION * CLOCK)):
        span = float(part[0]), float(part[0]) + 1.0 / CLOCK
        at = np.append(part, span[1])
        found = solve_ivp(slope, span, [i, h, z, x, 0j], rtol=TOLERANCE, atol=1e-8, t_eval=at)
        logs.append(found.y[1:4, :-1])
        i, h, z, end, area = found.y[:, -1].tolist()
        i, h, z, x = clock.tick(i, h, z / abs(z), end.real, area)
    found_h, found_z, found_x = np.concatenate(logs, axis=1)
    truth = signals(times[:-1], direction)
    return Run(truth, found_h, found_z, found_x.real)


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


def settling(times: NDArray[np.float64], error: NDArray[np.float64], bound: float) -> float:
    """Return the first log time [ms] from which |error| <= bound to the end; nan: never.

    nan also if that is less than LEAST before the end.

    Parameters
    ----------
    times : shape (n,), increasing [s].
    error : shape (n,), in the unit of `bound`.
    """
    with np.errstate(invalid='ignore'):
        outside = np.flatnonzero(~(np.abs(error) <= bound))
    first = 0 if len(outside) == 0 else outside[-1] + 1
    if first >= len(times) or times[-1] - times[first] < LEAST:
        return math.nan
    return 1e3 * float(times[first])


def settle_times(run: Run) -> dict[str, float]:
    """Return the settling times [ms] of speed (2 %), angle (5 degrees), xi and back-EMF (2 %)."""
    found, times = errors(run), run.truth.time
    return {
        'speed': settling(times, found.speed, 0.02),
        'angle': settling(times, found.angle, math.radians(5.0)),
        'xi': settling(times, found.xi, 0.02),
        'emf': settling(times, found.emf_relative, 0.02),
    }


def final_errors(run: Run) -> dict[str, float]:
    """Return the largest errors at the end: speed [%], angle [deg], xi [%], back-EMF [%]."""
    found, late = errors(run), slice(-round(LAST * LOG), None)
    return {
        'speed': 100.0 * float(np.abs(found.speed[late]).max()),
        'angle': math.degrees(float(np.abs(found.angle[late]).max())),
        'xi': 100.0 * float(np.abs(found.xi[late]).max()),
        'emf': 100.0 * float(found.emf_relative[late].max()),
    }


def drive_samples(direction: int = 1) -> tuple[Signals, NDArray[np.float64]]:
    """Return truth and samples as a drive publishes them at LOG Hz: currents, mean voltages.

    The samples have shape (n + 1, 4).
    """
    count, parts = round(DURATION * LOG), FINE // LOG
    truth = signals(np.arange(count + 1) / LOG, direction)
    middles = (np.arange(count * parts) + 0.5) / FINE
    means = signals(middles, direction).voltage.reshape(count, parts).mean(axis=1)
    mean = np.concatenate((truth.voltage[:1], means))
    return truth, np.column_stack((truth.current.real, truth.current.imag, mean.real, mean.imag))
