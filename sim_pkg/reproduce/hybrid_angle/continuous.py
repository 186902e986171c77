"""Figures 4 and 5 of the hybrid-angle paper: plant (1) and observer (3) with their jumps.

Runge-Kutta of order four at a fixed step. Jumps are tested after each step, in the order plant J1,
observer J1, observer J2, until none applies (the paper leaves the order open). The code runs as
plain Python: compiling it for each injection takes as long as running it for all figures.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.observers.angle.hybrid import injections
from estimator_pkg.observers.angle.hybrid.continuous import (
    POTENTIALS,
    TURN,
    first_jump,
    in_first_jump_set,
    in_second_jump_set,
    make_flow,
    make_lyapunov,
    observer_gains,
)
from estimator_pkg.observers.circle import wrap
from sim_pkg.joints import profiles
from sim_pkg.reproduce import splitmix

Array = NDArray[np.floating[Any]]

STEP = 1e-4  # integration step [s]
DURATION = 8.0  # duration of Figures 4 and 5 [s]
STEPS = round(DURATION / STEP)
NOISE_HOLD = 10  # steps for which a noise value is constant: 1 ms
NOISE_REACH = math.radians(15.0)  # largest noise [rad]
MARGIN = math.radians(5.0)  # delta_pi
K1, K2 = 6.0, 5.0  # the paper's k_v and k_p


class Trace(NamedTuple):
    """A simulation; arrays of shape (STEPS,), row i at the start of step i, after all jumps.

    Attributes
    ----------
    time : s.
    true_velocity, velocity : of the plant and of the observer [rad/s].
    output_error : y minus the estimated position, wrapped [rad].
    position_error : true minus estimated position, wrapped [rad].
    lyapunov : V of the errors [rad^2].
    flow_change : change of V in step i while flowing [rad^2].
    reset_change : change of V at the observer's J2 jumps after step i; nan without a jump.
    wrap_change : change of V at the J1 jumps after step i; nan without a jump.
    resets : number of J2 jumps after step i.
    """

    time: Array
    true_velocity: Array
    velocity: Array
    output_error: Array
    position_error: Array
    lyapunov: Array
    flow_change: Array
    reset_change: Array
    wrap_change: Array
    resets: Array

    @property
    def velocity_error(self) -> Array:
        """True minus estimated velocity [rad/s]."""
        return self.true_velocity - self.velocity

    def reset_times(self) -> Array:
        """Return the times of the observer's J2 jumps [s]."""
        return self.time[self.resets > 0] + STEP


def make_simulation(name: str) -> Callable[..., None]:
    """Return the loop over steps for the injection `name`, in the subset that Numba compiles."""
    flow = make_flow(injections.BUILT_IN[name])
    lyapunov = make_lyapunov(POTENTIALS[name])

    def simulate(
        gains: tuple[float, float, float],
        margin: float,
        step: float,
        speed: Array,
        noise: Array,
        velocity: Array,
        output_error: Array,
        position_error: Array,
        value: Array,
        flow_change: Array,
        reset_change: Array,
        wrap_change: Array,
        resets: Array,
    ) -> None:
        """Fill the arrays from `velocity` on; all of shape (n,).

        gains : l1, l2, saturation limit. speed : true velocity at half steps, shape (2 n + 1,).
        noise : measurement noise in each step, shape (n,) [rad].
        """
        half = 0.5 * step
        true, position, speed_hat = 0.0, 0.0, 0.0
        before = lyapunov(true - position, speed[0] - speed_hat, gains[1], gains[2])
        for i in range(len(noise)):
            w = noise[i]
            v0, v1, v2 = speed[2 * i], speed[2 * i + 1], speed[2 * i + 2]
            velocity[i] = speed_hat
            output_error[i] = wrap(true + w - position, TURN)
            position_error[i] = wrap(true - position, TURN)
            value[i] = before

            p1, a1 = flow(position, speed_hat, true + w, gains)
            p2, a2 = flow(position + half * p1, speed_hat + half * a1, true + half * v0 + w, gains)
            p3, a3 = flow(position + half * p2, speed_hat + half * a2, true + half * v1 + w, gains)
            p4, a4 = flow(position + step * p3, speed_hat + step * a3, true + step * v1 + w, gains)
            true += step / 6.0 * (v0 + 4.0 * v1 + v2)
            position += step / 6.0 * (p1 + 2.0 * p2 + 2.0 * p3 + p4)
            speed_hat += step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)

            after = lyapunov(true - position, v2 - speed_hat, gains[1], gains[2])
            flow_change[i] = after - before
            before = after
            jumping = True
            while jumping:
                jumping = False
                if in_first_jump_set(true + w, margin):
                    true = first_jump(true)
                    jumping = True
                if in_first_jump_set(position, margin):
                    position = first_jump(position)
                    jumping = True
                if jumping:
                    after = lyapunov(true - position, v2 - speed_hat, gains[1], gains[2])
                    wrap_change[i] = after - before
                    before = after
                if in_second_jump_set(true + w - position, margin):
                    position = true + w
                    jumping = True
                    resets[i] += 1.0
                    after = lyapunov(true - position, v2 - speed_hat, gains[1], gains[2])
                    reset_change[i] = after - before
                    before = after

    return simulate


@lru_cache
def figure_4(injection: str, *, k1: float = K1, k2: float = K2, margin: float = MARGIN) -> Trace:
    """Simulate Figure 4: no noise, epsilon 0.7 s, M = 1 rad.

    Parameters
    ----------
    margin : delta_pi [rad]; if it is smaller than any step, J2 never applies.
    """
    return _run(injection, (*observer_gains(k1, k2, 0.7), 1.0), margin, np.zeros(STEPS))


@lru_cache
def figure_5(injection: str, seed: int) -> Trace:
    """Simulate Figure 5: +-15 degrees of uniform noise, epsilon 0.1 s, M = 0.03 rad.

    Parameters
    ----------
    seed : seed of the splitmix64 stream. The paper states neither distribution nor bandwidth.
    """
    held = splitmix.uniforms(seed, STEPS // NOISE_HOLD, NOISE_REACH)
    return _run(
        injection, (*observer_gains(K1, K2, 0.1), 0.03), MARGIN, np.repeat(held, NOISE_HOLD)
    )


def _run(injection: str, gains: tuple[float, float, float], margin: float, noise: Array) -> Trace:
    half_steps = np.asarray(0.5 * STEP * np.arange(2 * STEPS + 1), np.float64)
    speed = profiles.figure_4()(half_steps)[1]
    out = [np.zeros(STEPS) for _ in range(5)]
    out += [np.full(STEPS, np.nan), np.full(STEPS, np.nan), np.zeros(STEPS)]
    # lists contain Python floats, which are several times faster than numpy's
    make_simulation(injection)(gains, margin, STEP, speed.tolist(), noise.tolist(), *out)
    return Trace(half_steps[:-1:2], speed[:-1:2], *out)
