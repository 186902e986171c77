# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The shared part of all observers of mechanisms: domain of the model, status, convention.

A measurement is the vector of all positions, shape (n,) [rad or m]. The input, shape (m,), acted
from the previous sample to this one. An observer is a subclass with `advance`: one step of the
model, corrected by the innovation. It computes with arrays that it never changes in place.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from estimator_pkg.circle import LARGEST, Circle
from estimator_pkg.estimate import COASTING, INITIALISING, NOT_OBSERVABLE, TRACKING
from estimator_pkg.models.mechanics import Array, Mechanics, apply
from estimator_pkg.observers.mechanism import gains as mechanical_gains
from estimator_pkg.observers.mechanism.flow import balance, flow
from estimator_pkg.observers.mechanism.friction import resist
from estimator_pkg.observers.mechanism.noise import NoiseGains, StandardDeviations, noise_gains
from estimator_pkg.observers.mechanism.parameters import (
    AT_MEASUREMENT,
    LINEAR,
    PAPER_FORM,
    MechanicalGains,
    per_joint,
)
from estimator_pkg.sensor.convention import Convention, begin_convention, follow_convention, present

OUTSIDE_PART = 0.125  # an innovation beyond this part of a turn is not noise: the lock is in doubt
DOUBT_LIMIT = 0.5  # s in doubt after which the observer starts again
COAST = 0.2  # s without input or outside the domain after which the state is not observable
POWER_MEMORY = 400.0  # samples over which the innovation's power is averaged
DRIFT_MEMORY = 20.0  # slowest time constants over which the power of its slow part is averaged
START_SETTLING = 4.0  # time constants of the slowest pole until a start has settled

NO_REASON, OUT_OF_DOMAIN, NO_INPUT, FAR_OFF, NOT_FINITE = range(5)  # why a sample is not valid


class Core(NamedTuple):
    """The observer's own state, shape (..., n) each."""

    e: Array  # estimate minus measurement [rad or m]
    x: Array  # momenta (geso) or velocities
    d: Array  # disturbances (geso, hgo, ehgo) or the acceleration of the model (smo)
    v: Array  # velocities [rad/s or m/s]
    innovation: Array  # [rad or m]


class State:
    """An observer after a sample; arrays have one number per position.

    Attributes
    ----------
    measurement : the last one. conventions : of the positions.
    squares : mean squares of the innovation. drift : its slow part. drift_squares : mean squares of
        that. held, held_squares : the same of the injection of smo, over its limit.
    valid_time, invalid_time : since the last sample that was not valid, and of such samples [s].
    reason : why the last sample was not valid, as NO_INPUT.
    """

    core: Core
    measurement: Array
    squares: Array
    drift: Array
    drift_squares: Array
    held: Array
    held_squares: Array
    status, reason = INITIALISING, NO_REASON
    valid_time = invalid_time = 0.0

    def __init__(self, n: int) -> None:
        self.conventions = [Convention() for _ in range(n)]

    def take(self, other: State) -> None:
        """Copy another state."""
        conventions = self.conventions
        vars(self).update(vars(other))
        self.conventions = conventions
        for mine, its in zip(conventions, other.conventions):
            mine.take(its)


class MechanismObserver:
    """An observer of a mechanism with its gains.

    Parameters
    ----------
    gains : of the observer. circle : whether turns are counted; the model has the periods.

    Attributes
    ----------
    settle : time of valid samples until the estimate is valid [s].
    lag : delay at low frequency of motion that the model does not predict [s].
    longest : sample time from which on the gains cannot work [s].

    Raises
    ------
    UserError, UsageError : the model or the gains cannot work.
    """

    settle = longest = math.inf
    lag = 0.0

    def __init__(self, gains: MechanicalGains, mechanics: Mechanics, circle: Circle) -> None:
        self.mechanics, n = mechanics, mechanics.degrees
        self.paper = gains.form == PAPER_FORM
        self.at_measurement = gains.schedule == AT_MEASUREMENT
        self.linear_hold = gains.hold == LINEAR and not self.paper
        self.periods, self.unwrap = np.array(mechanics.periods), circle.unwrap
        self._turns = np.where(self.periods > 0.0, self.periods, math.inf)
        self._deviations = StandardDeviations(
            mechanics,
            per_joint('noise', gains.noise, n),
            per_joint('quantum', gains.quantum, n),
            self.noise_gains,
            self.linear,
            by_size=self.by_size,
            measured=gains.noise is None,
        )

    def _settle_with(self, slowest: float) -> None:
        """Set the time of a start by the slowest pole [1/s]."""
        self.settle = float(START_SETTLING / slowest) if slowest > 0.0 else math.inf
        self.lost_after = max(DOUBT_LIMIT, min(self.settle, 10.0 * DOUBT_LIMIT))

    # What an observer defines

    by_size = False  # the deviations depend on the size of the innovation

    def advance(self, core: Core, before: Array, moved: Array, u: Array, dt: float) -> Core | None:
        """Return the state after one sample; None where the model is not valid.

        Parameters
        ----------
        before, moved : the previous measurement, and its change, on any turn.
        """
        raise NotImplementedError

    def propagated(self, core: Core, at: Array) -> Array:
        """Return the velocities at the positions `at`, without input or innovation."""
        return core.v

    def linear(self, at: Array, power: Array) -> tuple[Array, Array]:
        """Return (A, V) of the error: (e, x, d)' = A (e, x, d), and velocities = V x, frozen `at`.

        Parameters
        ----------
        power : mean squares of the innovation.
        """
        raise NotImplementedError

    def noise_gains(self, at: Array, power: Array, dt: float) -> NoiseGains:
        """Return the variances of estimate and innovation."""
        raise NotImplementedError

    def late(self, core: Core, dt: float) -> Array:
        """Return by how much the velocities are wrong because a step of dt [s] delays them."""
        return np.zeros_like(core.v)

    def describe(self, dt: float) -> dict[str, Any]:
        """Return properties of the gains by name; `gains.MEANINGS` has their titles and units."""
        raise NotImplementedError

    # What all observers share

    def start(self, state: State, measurement: Any) -> None:
        """Set every field, after the first sample."""
        y = state.measurement = np.array(measurement, float)
        state.squares = state.drift = state.drift_squares = np.zeros(len(y))
        for convention, reading in zip(state.conventions, y.tolist()):
            begin_convention(convention, reading)
        self._begin(state, NO_REASON)

    def _begin(self, state: State, reason: int) -> None:
        """Begin at rest at the measurement."""
        state.core = Core(*[np.zeros(self.mechanics.degrees)] * 5)
        state.status, state.reason = INITIALISING, reason
        state.valid_time = state.invalid_time = 0.0

    @np.errstate(all='ignore')  # what is not finite is found below
    def step(self, state: State, dt: float, measurement: Any, known_input: Any) -> None:
        """Take one sample, `dt` [s] after the last one."""
        y, u = np.array(measurement, float), np.array(known_input, float)
        before, moved = state.measurement, self._wrapped(y - state.measurement)
        self._follow(state, y)
        if not is_finite(u):
            self._fault(state, dt, NO_INPUT)
            return
        after = self.advance(state.core, before, moved, u, dt)
        if after is None:
            self._fault(state, dt, OUT_OF_DOMAIN)
        elif not (is_finite(after.e) and is_finite(after.v)):
            self._begin(state, NOT_FINITE)
        else:
            state.core = after
            if (np.abs(after.e) > OUTSIDE_PART * self._turns).any():
                self._doubt(state, dt)
            else:
                self._accept(state, dt)

    def _wrapped(self, change: Array) -> Array:
        """Return changes of position [rad or m], without whole turns."""
        return change - self.periods * np.floor(change / self._turns + 0.5)

    def _follow(self, state: State, y: Array) -> None:
        state.measurement = y
        for convention, reading, period in zip(state.conventions, y.tolist(), self.periods):
            follow_convention(convention, reading, period)

    def _accept(self, state: State, dt: float) -> None:
        """Follow the status and the power of the innovation after a valid sample."""
        state.valid_time += dt
        if state.valid_time >= self.settle:
            state.status, state.invalid_time = TRACKING, 0.0
        state.reason = NO_REASON
        memory = min(state.valid_time, POWER_MEMORY * dt)
        innovation, corner = state.core.innovation, self._drift(dt)[0]
        state.squares = state.squares + dt / memory * (innovation**2 - state.squares)
        state.drift = state.drift + corner * (innovation - state.drift)
        if state.status == TRACKING:  # the transient of the start is not an error of the model
            weight = self._slowly(state, dt)
            state.drift_squares = state.drift_squares + weight * (
                state.drift**2 - state.drift_squares
            )

    def _drift(self, dt: float) -> tuple[float, float]:
        """Return of the slow part: weight of a sample, and memory of its power [s]."""
        corner = START_SETTLING * dt / self.settle
        memory = max(POWER_MEMORY * dt, DRIFT_MEMORY * self.settle / START_SETTLING)
        return corner / (1.0 + corner), memory

    def _slowly(self, state: State, dt: float) -> float:
        """Return the weight of a sample in the power of a slow part, since the start settled."""
        since = max(state.valid_time - self.settle, 0.0) + dt
        return dt / min(since, self._drift(dt)[1])

    def _doubt(self, state: State, dt: float) -> None:
        """Follow the status after an innovation that is too large."""
        state.invalid_time += dt
        state.valid_time, state.reason = 0.0, FAR_OFF
        if state.invalid_time > self.lost_after:
            self._begin(state, FAR_OFF)
        elif state.status in (TRACKING, COASTING):
            state.status = COASTING
        else:
            state.status = INITIALISING

    def _fault(self, state: State, dt: float, reason: int) -> None:
        """Keep the motion, without an update; take the position from the measurement."""
        state.invalid_time += dt
        state.reason = reason
        self._coast(state)
        if state.invalid_time > COAST:
            state.valid_time, state.status = 0.0, NOT_OBSERVABLE
        elif state.status == TRACKING:
            state.status = COASTING

    def _coast(self, state: State) -> None:
        core = state.core
        velocity = self.propagated(core, state.measurement)
        state.core = core._replace(e=np.zeros_like(core.e), v=velocity)

    @np.errstate(all='ignore')
    def resume(self, state: State, measurement: Any) -> None:
        """Go on after a gap: position from the measurement, motion kept."""
        self._follow(state, np.array(measurement, float))
        self._coast(state)
        if state.status == TRACKING:
            state.status = COASTING
        state.reason, state.valid_time, state.invalid_time = NO_REASON, 0.0, 0.0

    def restart(self, state: State, measurement: Any) -> None:
        """Start again after an outage; the turns that were counted stay."""
        self._begin(state, NO_REASON)
        self._follow(state, np.array(measurement, float))

    def estimate(self, state: State) -> tuple[list[float], list[float]]:
        """Return positions, in the convention of the measurement, and velocities."""
        at = (state.measurement + state.core.e).tolist()
        shown = zip(state.conventions, at, self.periods.tolist())
        return [present(*each, self.unwrap) for each in shown], state.core.v.tolist()

    def deviations(self, state: State, dt: float) -> tuple[list[float], list[float]]:
        """Return the standard deviations of all positions and of all velocities."""
        corner = self._drift(dt)[0]
        of_white = corner / (2.0 - corner)
        powers = state.squares, state.drift_squares
        return self._deviations(state.measurement, *powers, of_white, self.late(state.core, dt), dt)

    def place(self, core: Core, before: Array, moved: Array) -> Array:
        """Return the positions at which a step evaluates the model."""
        if not self.at_measurement:
            return before + core.e
        return before + 0.5 * moved if self.linear_hold else before

    def limits(self, dt: float) -> str | None:
        """Return None, or why these gains cannot work at this dt [s], with the limit."""
        if dt < self.longest:
            return None
        if self.paper:
            return (
                f'forward Euler (form: paper) is unstable at a sample time of {dt:.4g} s: these '
                f'gains need less than {self.longest:.4g} s; use form: exact or lower gains'
            )
        return (
            f'the gains are far too fast for a sample time of {dt:.4g} s: these need less than '
            f'{self.longest:.4g} s; lower bandwidth_hz'
        )

    def group_delay(self, dt: float) -> float:
        """Return the delay of the velocity at low frequency [s]."""
        return self.lag + (0.0 if self.linear_hold else 0.5 * dt)

    def why(self, state: State) -> str:
        """Return why the estimate is not published, in words, or ''."""
        mechanics = self.mechanics
        model, complaint = mechanics.name, mechanics.complaint
        if state.reason == OUT_OF_DOMAIN:
            return f"outside the domain of model '{model}': the last velocity is kept" + (
                f' ({complaint})' if complaint else ''
            )
        if state.reason == NO_INPUT:
            needed = ', '.join(mechanics.joints[index] for index in mechanics.actuated)
            return f"no effort for {needed}, which model '{model}' needs"
        if state.reason == FAR_OFF:
            return 'the positions are far from those that the model predicts with these inputs'
        if state.reason == NOT_FINITE:
            return f"model '{model}' is not finite at these positions" + (
                f': {complaint}' if complaint else ''
            )
        if state.status == INITIALISING:
            return (
                f'settling: {state.valid_time:.2g} s of {self.settle:.3g} s, four times the '
                'slowest time constant'
            )
        return ''


def is_finite(x: Array) -> bool:
    """Return True if all |x_i| are below `LARGEST`."""
    return bool((np.abs(x) < LARGEST).all())


class LinearObserver(MechanismObserver):
    """An observer whose step is linear with the configuration frozen: geso, hgo, ehgo.

        e' = T x - L e - r        e = qh - y, r the rate of the measurement over the interval
        x' = f - F x + S d - B e
        d' = -E e                 the disturbance state

    T, f, F and S are the model's, L, B and E correct by the innovation. With z = (e, x, d) it is
    z' = A z + c. The form `exact` is its exponential over a sample, `paper` forward Euler.
    """

    L: Array
    E: Array | None = None

    def system(self, at: Array, core: Core, u: Array, dt: float) -> tuple[Array, Array]:
        """Return A and f [1/s] at the positions `at`."""
        raise NotImplementedError

    def joined(self, T: Any, B: Array, F: Any, S: Any) -> Array:
        """Return A, shape (..., 2 n, 2 n), or (..., 3 n, 3 n) with a disturbance state."""
        n = self.mechanics.degrees
        size = 2 * n if self.E is None else 3 * n
        A = np.zeros((*np.shape(F)[:-2], size, size))
        A[..., :n, :n] = -self.L
        A[..., :n, n : 2 * n] = T
        A[..., n : 2 * n, :n] = -B
        A[..., n : 2 * n, n : 2 * n] = -F
        if self.E is not None:
            A[..., n : 2 * n, 2 * n :] = S
            A[..., 2 * n :, :n] = -self.E
        return A

    def forces(self, at: Array, v: Array, u: Array, dt: float) -> tuple[Array, Array]:
        """Return the forces that are constant over a sample, and D."""
        if self.paper:
            return self.mechanics.force(at, v, u), self.mechanics.damping(at)
        return resist(self.mechanics, at, v, u, dt)

    def advance(self, core: Core, before: Array, moved: Array, u: Array, dt: float) -> Core | None:
        """Return the state after one sample; None where the model is not valid."""
        n, at = self.mechanics.degrees, self.place(core, before, moved)
        if not self.mechanics.admits(at):
            return None
        A, f = self.system(at, core, u, dt)
        z = np.concatenate([core.e, core.x, core.d][: A.shape[-1] // n], axis=-1)
        c = np.zeros_like(z)
        c[..., n : 2 * n] = f
        if self.linear_hold:
            c[..., :n] = -moved / dt
        z = z + dt * (apply(A, z) + c) if self.paper else flow(A, c, z, dt, self._scales)
        e = z[..., :n] if self.linear_hold else z[..., :n] - moved
        x, d = z[..., n : 2 * n], core.d if self.E is None else z[..., 2 * n :]
        return self.shown(Core(e, x, d, x, e), before + moved)

    def shown(self, core: Core, measurement: Array) -> Core | None:
        """Return the state with its velocities; None where the model is not valid."""
        return core

    def noise_gains(self, at: Array, power: Array, dt: float) -> NoiseGains:
        """Return the variances of estimate and innovation."""
        return noise_gains(*self.linear(at, power), dt, self.paper, self.linear_hold)

    def _use(self, points: list[Array], lag: float) -> None:
        """Set what the error systems at these points imply, the first the operating point."""
        n = self.mechanics.degrees
        self.systems = [self.linear(q, np.zeros(len(q)))[0] for q in points]
        self._scales = balance(self.systems[0], n)
        self._settle_with(mechanical_gains.slowest_pole(self.systems[0]))
        self.longest = (
            mechanical_gains.longest_euler(self.systems)
            if self.paper
            else mechanical_gains.longest_exact(self.systems, n)
        )
        self.lag = lag if self.E is None else 0.0
