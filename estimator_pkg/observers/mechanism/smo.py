# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""SMO: sliding-mode observers of a mechanism.

super_twisting (Davila, Fridman, Levant; (22) of the paper), with e = y - x1h:
    x1h' = x2h + 1.5 sqrt(mu |e|) sgn e,   x2h' = model + 1.1 mu sgn e
uniform (Cruz-Zavala, Moreno, Fridman; the robotic leg's of section 5.2):
    x1h' = x2h + k1 (m1 |e|^(1/2) + m2 |e|^(3/2)) sgn e
    x2h' = model + k2 (m1^2/2 sgn e + 2 m1 m2 e + 3/2 m2^2 |e|^2 sgn e)

They are exact after a finite time while the error of the model's acceleration is less than 1.1 mu
(k2 m1^2/2 for uniform), and fail beyond it. There is no matrix exponential for
injections with a sign, so the default form makes an implicit step, which does not chatter. It has a
closed form for super_twisting; for uniform Newton's method converges monotonically.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator_pkg.circle import Circle
from estimator_pkg.estimate import TRACKING
from estimator_pkg.models.load import load
from estimator_pkg.models.mechanics import Array, solved
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.maths.describing import Describing, describing
from estimator_pkg.observers.maths.steady_noise import steady_covariance
from estimator_pkg.observers.mechanism.friction import resist
from estimator_pkg.observers.mechanism.noise import NoiseGains, per_noise, variances
from estimator_pkg.observers.mechanism.observer import Core, MechanismObserver, State
from estimator_pkg.observers.mechanism.parameters import MechanicalGains, per_joint
from estimator_pkg.parameters import parameter, structural

MISFIT = 0.5  # rms injection, slowly averaged, over its limit: the model does not fit
NEWTON = 60  # most steps of Newton's method; from above it converges monotonically


def noise_variances(
    pairs: Sequence[Describing], damping: Array, dt: float, *, implicit: bool, linear_hold: bool
) -> NoiseGains:
    """Return variances of estimate and innovation, per noise variance and from the remnants.

    Parameters
    ----------
    pairs : describing functions, one pair per position.
    damping : -M^-1 D, shape (n, n) [1/s].
    dt : sample time [s].
    implicit, linear_hold : the kind of step.
    """
    n = len(pairs)
    eye, zeros = np.eye(n), np.zeros((n, n))
    # transition of the velocity over a sample by damping
    glide = np.linalg.inv(eye - dt * damping) if implicit else eye + dt * damping
    position = np.diag([pair.position for pair in pairs])
    velocity = np.diag([pair.velocity for pair in pairs])
    # the state is (offset e, velocity, noise of the previous sample); `seen` is the innovation
    if implicit:
        ahead = dt * glide
        seen = np.hstack([eye, ahead, eye if linear_hold else zeros])
        of_noise = -eye if linear_hold else zeros
        offset = position @ seen
        entering = position @ of_noise
        if not linear_hold:
            offset = offset + np.hstack([zeros, zeros, eye])
            entering = entering - eye
        speed = np.hstack([zeros, glide, zeros]) - dt * velocity @ seen
        of_speed = -dt * velocity @ of_noise
    else:
        seen, of_noise = np.hstack([eye, zeros, zeros]), zeros
        offset = np.hstack([eye - dt * position, dt * eye, eye])
        entering = -eye
        speed = np.hstack([-dt * velocity, glide, zeros])
        of_speed = zeros
    transition = np.vstack([offset, speed, np.zeros((n, 3 * n))])
    arrival = np.vstack([entering, of_speed, eye])
    remnant = np.zeros((3 * n, 3 * n))
    turn = np.diag([1.0, -dt]) if implicit else np.diag([-dt, -dt])
    for index, pair in enumerate(pairs):
        rows = np.ix_((index, n + index), (index, n + index))
        remnant[rows] = turn @ pair.remnant @ turn
    shown = np.hstack([eye, zeros, eye])  # error of the estimate: offset plus noise of y
    speeds = np.hstack([zeros, eye, zeros])
    outputs = shown, speeds, seen
    of_position, of_velocity, of_innovation = per_noise(transition, arrival, outputs)
    chatter = steady_covariance(transition, remnant)
    own = (variances(rows, chatter) for rows in outputs)
    return NoiseGains(of_position, of_velocity, of_innovation + of_noise**2, *own)


SUPER_TWISTING, UNIFORM = 'super_twisting', 'uniform'
POSITION_GAIN, VELOCITY_GAIN = 1.5, 1.1  # of (22)
LEAST_POWER = 1e-18  # smallest mean squared innovation for the describing functions [rad^2 or m^2]


@dataclass(frozen=True)
class Gains(MechanicalGains):
    """Parameters of `smo`."""

    variant: str = structural(
        SUPER_TWISTING,
        choices=(SUPER_TWISTING, UNIFORM),
        description='injections of the sliding mode: those of super_twisting, or uniform ones',
    )
    mu: tuple[float, ...] = parameter(
        (10.0,),
        unit='rad/s^2 or m/s^2',
        kind=list,
        range=(1e-9, 1e9),
        search=(0.1, 1e4),
        description='super_twisting: about the largest acceleration that the model does not '
        'predict; one number for all positions, or one each',
    )
    k1: tuple[float, ...] = parameter(
        (1.0,), kind=list, range=(1e-9, 1e9), description='uniform: gain of the position'
    )
    k2: tuple[float, ...] = parameter(
        (1.0,), kind=list, range=(1e-9, 1e9), description='uniform: gain of the velocity'
    )
    mu1: float = parameter(
        1.86, range=(1e-9, 1e6), description='uniform: gain of the root and of the sign'
    )
    mu2: float = parameter(
        0.303, range=(0.0, 1e6), description='uniform: gain of the powers 3/2 and 2'
    )


class Smo(MechanismObserver):
    """SMO with its gains; see `MechanismObserver`.

    Both variants have injections of one form, with coefficients of shape (n,):

        one(e) = (a1 |e|^(1/2) + a3 |e|^(3/2)) sgn e,  two(e) = (b0 + b1 |e| + b2 |e|^2) sgn e
    """

    by_size = True

    def __init__(self, gains: Gains, circle: Circle) -> None:
        mechanics = load(gains.model, gains.model_parameters)
        super().__init__(gains, mechanics, circle)
        n = mechanics.degrees
        if gains.variant == SUPER_TWISTING:  # (22)
            mu = np.array(per_joint('mu', gains.mu, n))
            first, second = POSITION_GAIN * np.sqrt(mu), VELOCITY_GAIN * mu
            self.one, self.two = np.stack([first, 0.0 * mu]), np.stack([second, 0.0 * mu, 0.0 * mu])
        else:
            k1, k2 = (np.array(per_joint(k, getattr(gains, k), n)) for k in ('k1', 'k2'))
            m1, m2 = gains.mu1, gains.mu2
            self.one = np.stack([k1 * m1, k1 * m2])
            self.two = np.stack([k2 * 0.5 * m1 * m1, k2 * 2.0 * m1 * m2, k2 * 1.5 * m2 * m2])
        self.acceleration_limit = self.two[0]
        self._settle_with(4.0 * float(np.min(self.acceleration_limit)))

    def injections(self, e: Array, joint: Any = slice(None)) -> tuple[Array, Array]:
        """Return one(e) and two(e) of all positions, or of one [rad or m]."""
        (a1, a3), (b0, b1, b2) = self.one[:, joint], self.two[:, joint]
        size, sign = np.abs(e), np.sign(e)
        root = np.sqrt(size)
        return (a1 * root + a3 * root * size) * sign, (b0 + b1 * size + b2 * size * size) * sign

    def implicit(self, free: Array, h: float, joint: Any = slice(None)) -> tuple[Array, Array]:
        """Return (e, two(e)) after an implicit step of h [s]: e + h one(e) + h^2 two(e) = free.

        While |free| <= h^2 b0 it slides: e is zero, and h^2 two = free. Else it is a quartic in
        sqrt|e|.
        """
        (a1, a3), (b0, b1, b2) = self.one[:, joint], self.two[:, joint]
        size, sign = np.abs(free), np.sign(free)
        over = np.maximum(size - h * h * b0, 0.0)
        c1, c2, c3, c4 = h * a1, 1.0 + h * h * b1, h * a3, h * h * b2
        half = 0.5 * c1  # of the quadratic, from above: no difference of nearly equal numbers
        root = over / (half + np.sqrt(half * half + c2 * over))
        for _ in range(NEWTON if np.any(c4 > 0.0) else 0):
            value = root * (c1 + root * (c2 + root * (c3 + root * c4))) - over
            slope = c1 + root * (2.0 * c2 + root * (3.0 * c3 + root * 4.0 * c4))
            root = root - value / slope
            if np.all(value <= 1e-16 * root * slope):
                break
        e = root * root
        two = np.where(over > 0.0, (b0 + b1 * e + b2 * e * e) * sign, free / (h * h))
        return e * sign, two

    def advance(self, core: Core, before: Array, moved: Array, u: Array, dt: float) -> Core | None:
        """Return the state after one sample; None where the model is not valid."""
        at, (e, v) = self.place(core, before, moved), (core.e, core.v)
        if not self.mechanics.admits(at):
            return None
        if self.paper:
            one, two = self.injections(e)
            f = self.mechanics.acceleration(at, v, u)
            e = innovation = e + dt * (v - one) - moved
        else:
            f = self._braked(at, v, u, dt)
            within, after = (moved, 0.0) if self.linear_hold else (0.0, moved)
            innovation = e + dt * (v + dt * f) - within
            e, two = self.implicit(innovation, dt)
            e = e - after
        v = v + dt * (f - two)
        return Core(e, v, f, v, innovation)

    def start(self, state: State, measurement: Any) -> None:
        """Set every field, after the first sample."""
        super().start(state, measurement)
        state.held = state.held_squares = np.zeros(len(state.measurement))

    def _accept(self, state: State, dt: float) -> None:
        """Follow status and powers, and for how long the injection is at its limit."""
        super()._accept(state, dt)
        corner = self._drift(dt)[0]
        of_limit = np.clip(state.core.innovation / (dt * dt * self.acceleration_limit), -1.0, 1.0)
        state.held = state.held + corner * (of_limit - state.held)
        if state.status == TRACKING:
            weight = self._slowly(state, dt)
            state.held_squares = state.held_squares + weight * (state.held**2 - state.held_squares)

    def why(self, state: State) -> str:
        """Return why the estimate is not published, or that the model does not fit, or ''."""
        held = np.sqrt(state.held_squares)
        worst = int(np.argmax(held))
        if state.status != TRACKING or not held[worst] > MISFIT:
            return super().why(state)
        unit = 'rad/s^2' if self.periods[worst] > 0.0 else 'm/s^2'
        return (
            f"model '{self.mechanics.name}' does not fit: its acceleration of "
            f'{self.mechanics.joints[worst]} is often wrong by more than '
            f'{self.acceleration_limit[worst]:.3g} {unit}, the most that these gains correct: '
            "increase them, or correct model and effort ('velocity_estimator identify')"
        )

    def late(self, core: Core, dt: float) -> Array:
        """Return the errors of a step with one velocity: it is that of the middle of the sample."""
        return 0.5 * dt * core.d

    def group_delay(self, dt: float) -> float:
        """Return the delay of the velocity at low frequency [s]."""
        return super().group_delay(dt) + 0.5 * dt

    def _braked(self, at: Array, v: Array, u: Array, dt: float) -> Array:
        """Return the mean acceleration over dt [s]: (M + dt D) a = force - C v - D v.

        It is implicit in the damping, explicit in the other forces.
        """
        force, damping = resist(self.mechanics, at, v, u, dt)
        force = force - self.mechanics.coriolis(at, v) - damping @ v
        return solved(self.mechanics.inertia(at) + dt * damping, force[:, None])[:, 0]

    def _described(self, power: Array, dt: float) -> list[Describing]:
        """Return a pair per position: of an implicit step of dt [s]; 0: of the injections."""
        pairs = []
        for i, square in enumerate(power.tolist()):

            def inject(e: Array, i: int = i) -> tuple[Array, Array]:
                return self.implicit(e, dt, i) if dt > 0.0 else self.injections(e, i)

            pairs.append(describing(inject, math.sqrt(max(square, LEAST_POWER))))
        return pairs

    def _damping(self, at: Array) -> Array:
        return -solved(self.mechanics.inertia(at), self.mechanics.damping(at))

    def noise_gains(self, at: Array, power: Array, dt: float) -> NoiseGains:
        """Return the variances of estimate and innovation at this innovation."""
        pairs = self._described(power, 0.0 if self.paper else dt)
        return noise_variances(
            pairs, self._damping(at), dt, implicit=not self.paper, linear_hold=self.linear_hold
        )

    def linear(self, at: Array, power: Array) -> tuple[Array, Array]:
        """Return (A, V) with the describing functions at this innovation, in continuous time."""
        L, K = np.array([pair[:2] for pair in self._described(power, 0.0)]).T
        one = np.eye(len(L))
        return np.block([[-np.diag(L), one], [-np.diag(K), self._damping(at)]]), one

    def describe(self, dt: float) -> dict[str, Any]:
        """Return properties of the gains by name."""
        limit = self.acceleration_limit
        return {'acceleration_limit': limit.tolist(), 'chattering': (dt * limit).tolist()}


class SmoObserver(Observer):
    """The entry point of `smo`."""

    name = 'smo'
    summary = 'sliding-mode observer of any mechanism with known model and input'
    reference = (
        'Davila, Fridman, Levant (2005) and Cruz-Zavala, Moreno, Fridman (2010); (22) of '
        'Aranovskiy et al. (IJC 2019)'
    )
    kind = 'mechanical'
    gains = Gains
    plan = Smo
