# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Ways to sample the observer, for the comparison: Euler, Runge-Kutta, and scheme X with variants.

The observer itself uses `pmsm.scheme.advance` (X, voltage rotated, two passes); `exponential_step`
here is the same function with these choices as arguments.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.engine.calls import run
from estimator_pkg.observers.pmsm.scheme import prepare_scheme, turned_emf
from estimator_pkg.observers.pmsm.state import Scheme
from sim_pkg.reproduce.pmsm.reference import (
    CLOCK,
    GAMMA,
    INDUCTANCE,
    K_ETA,
    K_I,
    K_P,
    RESISTANCE,
    Observed,
    Run,
    Signals,
    Vectors,
    emf,
    runge_kutta_step,
    signals,
    slope,
    start_state,
    tick,
)

(EULER_INSTANT, EULER_MEAN, RK4_MEAN, RK4_LINEAR, X_HELD, X_TURNED, X_ONE_PASS) = range(7)
NAMES = (
    'Euler inst-held',
    'Euler avg-u',
    'RK4 held avg-u',
    'RK4 i,u lerp inst',
    'X zoh-ab',
    'X rot-avg',
    'X rot-avg 1 pass',
)
DIVERGED = 1e6  # V or 1/Wb
FINE = 200000.0  # rate of the sums for mean voltages [Hz]


def _held_voltage(voltage, speed, turn, scheme):
    """Return the exact effect on i and h of a voltage that is constant in the static frame.

    The integral of exp(A0 (dt - s)) exp(-j w s) is (A0 + j w)^-1 (E - exp(-j w dt)).

    Parameters
    ----------
    voltage : in the frame at the start of the sample [V].
    turn : exp(j w dt).
    """
    rate = -(RESISTANCE / INDUCTANCE + K_P)
    turning = complex(0.0, speed)
    a, b, c, d = turning + rate, 1.0 / INDUCTANCE, -K_I, turning
    det = a * d - b * c
    inverse = det.conjugate() * (1.0 / (det.real * det.real + det.imag * det.imag))
    drive = voltage * (1.0 / INDUCTANCE)
    first = (scheme.e11 - turn.conjugate()) * drive
    second = scheme.e21 * drive
    return inverse * (d * first - b * second), inverse * (a * second - c * first)


def exponential_step(i, h, z, x, before, now, voltage, scheme, held, passes):
    """Step as `pmsm.scheme.advance`, with its choices as arguments.

    Parameters
    ----------
    held : the mean voltage is constant in the static frame, instead of turning with the rotor.
    passes : iterations over the frame speed.
    """
    s, dt = scheme, scheme.dt
    back = z.conjugate()
    start = back * before
    first = abs(h) * x + K_ETA * h.real
    speed = first
    new_i, new_h, new_x, turn = i, h, x, complex(1.0, 0.0)
    for _ in range(passes):
        turn = complex(math.cos(speed * dt), math.sin(speed * dt))
        end = back * turn.conjugate() * now
        u = held_i = held_h = 0j
        if held:
            held_i, held_h = _held_voltage(back * voltage, speed, turn, scheme)
        else:
            angle = 0.5 * speed * dt
            sinc = math.sin(angle) / angle if angle != 0.0 else 1.0
            middle = complex(math.cos(angle), -math.sin(angle))
            u = back * middle * voltage * (1.0 / max(0.2, sinc))
        change = end - start
        back_turn = complex(0.0, -speed)
        new_i = (
            s.e11 * i
            + s.e12 * h
            + s.iu * u
            + s.ia * start
            + s.idd * change
            + back_turn * (s.iw * start + s.idw * change)
            + held_i
        )
        new_h = (
            s.e21 * i
            + s.e22 * h
            + s.hu * u
            + s.ha * start
            + s.hdd * change
            + back_turn * (s.hw * start + s.hdw * change)
            + held_h
        )
        new_x = x + 0.5 * GAMMA * dt * (h.real + new_h.real)
        speed = 0.5 * (first + abs(new_h) * new_x + K_ETA * new_h.real)
    new_z = z * turn
    return new_i, new_h, new_z * (1.0 / abs(new_z)), new_x


def sampled(
    state: Observed,
    scheme: Scheme,
    way: int,
    count: int,
    current: Vectors,
    instant: Vectors,
    mean: Vectors,
    dt: float,
    period: int,
    kind: int,
    out_h: Vectors,
    out_z: Vectors,
    out_x: NDArray[np.float64],
) -> None:
    """Run at one sample rate; rows after it diverged are left as they are.

    Parameters
    ----------
    way : one of the schemes above.
    current, instant : at the samples, shape (count,) [A], [V].
    mean : mean voltage over the interval before each sample [V].
    period : samples between clock ticks.
    out_h, out_z, out_x : shape (count,).
    """
    i, h, z, x = state.i, state.h, state.z, state.x
    y = emf(h, z)
    out_h[0], out_z[0], out_x[0] = h, z, x
    for k in range(1, count):
        if way >= X_HELD:
            passes = 1 if way == X_ONE_PASS else 2
            i, h, z, x = exponential_step(
                i, h, z, x, current[k - 1], current[k], mean[k], scheme, way == X_HELD, passes
            )
        else:
            c0 = c1 = c2 = current[k - 1]
            u0 = u1 = u2 = mean[k]
            if way == EULER_INSTANT:
                u0 = instant[k - 1]
            elif way == RK4_LINEAR:
                c2, u0, u2 = current[k], instant[k - 1], instant[k]
                c1, u1 = 0.5 * (c0 + c2), 0.5 * (u0 + u2)
            if way == EULER_INSTANT or way == EULER_MEAN:
                of_i, of_h, of_z, of_x = slope(i, h, z, x, c0, u0)
                i, h, z, x = i + dt * of_i, h + dt * of_h, z + dt * of_z, x + dt * of_x
            else:
                i, h, z, x, _area = runge_kutta_step(i, h, z, x, c0, c1, c2, u0, u1, u2, dt)
            if not (
                -DIVERGED < h.real < DIVERGED
                and -DIVERGED < h.imag < DIVERGED
                and -DIVERGED < x < DIVERGED
                and -10.0 < z.real < 10.0
                and -10.0 < z.imag < 10.0
                and -DIVERGED < i.real < DIVERGED
                and -DIVERGED < i.imag < DIVERGED
            ):
                return
            z = z * (1.0 / abs(z))
        new_y = emf(h, z)
        area_alpha, area_beta, _ = turned_emf(y.real, y.imag, new_y.real, new_y.imag, dt)
        state.integral += complex(area_alpha, area_beta)
        y = new_y
        if k % period == 0:
            state.i, state.h, state.z, state.x = i, h, z, x
            tick(state, kind)
            i, h, z, x = state.i, state.h, state.z, state.x
        out_h[k], out_z[k], out_x[k] = h, z, x


class Samples(NamedTuple):
    """Truth at the samples and the mean voltage over the interval before each [V]."""

    truth: Signals
    mean: NDArray[np.complex128]


def drive_samples(rate: float, direction: int = 1) -> Samples:
    """Return the exact signals as a drive publishes them at `rate` [Hz]."""
    count = round(0.70 * rate)
    parts = max(1, round(FINE / rate))
    truth = signals(np.arange(count + 1, dtype=np.float64) / rate, direction)
    middles = (np.arange(count * parts, dtype=np.float64) + 0.5) / (rate * parts)
    means = signals(middles, direction).voltage.reshape(count, parts).mean(axis=1)
    return Samples(truth, np.concatenate((truth.voltage[:1], means)))


def sampled_run(
    samples: Samples, rate: float, way: int, kind: int, eta0_deg: float, xi0: float
) -> Run:
    """Run one observer with one sampling scheme."""
    truth = samples.truth
    count = len(truth.time)
    logs = np.full(count, np.nan + 0j), np.full(count, np.nan + 0j), np.full(count, np.nan)
    state, scheme = start_state(truth, eta0_deg, xi0), Scheme()
    prepare_scheme(scheme, RESISTANCE, INDUCTANCE, K_P, K_I, 1.0 / rate)
    columns, period = (truth.current, truth.voltage, samples.mean), round(rate / CLOCK)
    run(sampled, state, scheme, way, count, *columns, 1.0 / rate, period, kind, *logs)
    return Run(truth, *logs, state.jumps, state.fires)
