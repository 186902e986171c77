# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What every observer of a single angle but `edge_adaptive` shares: noise, low-speed bound, lock.

A core that was astray for too long starts again. So does one whose lock returned at another speed:
every speed + n 2 pi/dt fits the samples as well, and a shaft does not change by half of that while
the lock is in doubt; nor does a start know of more than pi/dt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from estimator_pkg.circle import Circle, is_next_count, wrap
from estimator_pkg.estimate import COASTING, INITIALISING, TRACKING, Deviation, Estimate
from estimator_pkg.observers.angle.starts import (
    LASTS,
    LEARNT,
    REST_GATE,
    REST_SAMPLES,
    REST_TIME,
    Start,
    follow_start,
    rest,
    set_start,
    start_deviation,
)
from estimator_pkg.observers.contract import Observer
from estimator_pkg.parameters import parameter
from estimator_pkg.record import record
from estimator_pkg.sensor.convention import Convention, begin_convention, follow_convention, present
from estimator_pkg.sensor.outliers import OUTLIER_GATE, Outliers, believed
from estimator_pkg.sensor.quantum import FINEST_QUANTUM

MEMORY = 400.0  # samples over which the innovation's power is averaged
STILL = 8.0  # equal readings in a row that show that the noise is less than a quantum
UNCHANGED_SIGMAS = 4.0  # standard deviations of noise that may have kept a reading unchanged
FRESH = 4.0  # samples that the power weighs when a start has settled
OUTSIDE_PART = 0.125  # an innovation beyond this part of a turn is no noise: lock is doubted
LOCK_SAMPLES = 3.5  # a lock takes more samples than these
# A fifth of the velocity error where a ramp begins or ends, in acceleration/pace: order 3 ...
LAG_3 = 0.2
LAG_2 = 0.36  # ... and order 2, which lags throughout the ramp
START_READINGS = 8.0  # changed readings after which a start has shown its noise
SHORT = 32.0  # samples over which they are averaged until the start is over
CALMED = 16.0  # times the recent power: what raised the mean, an outlier, is over
SURGE = 2.0  # times its mean, by chance the recent power of the innovation is no larger
UNBOUNDED = 1e200  # a noise gain beyond it: no gap, but a sample time too long for the core
PACE = 0.8  # of the cube root of (velocity noise gain)/dt: the pace of a tracking loop
THIRD = 1.0 / 3.0
LEAST_GAP = 0.2  # [s] a gap is at least so long
RESIDUE = 1e-9  # [rad] a smaller step is rounding and not the quantum
SAME_STEP_TOLERANCE = 1e-3  # of a step: two that differ by less differ by their last digits
COARSEST = 2.0**-23  # resolution of a float32, of its value: a reading is no finer than known
DOUBLE_EPSILON = 2.0**-52  # the same of a double
# in doubt, and outside for this long [s] in all (never less than it takes to settle): the observer
# starts again
DOUBT_LIMIT = 0.5


@dataclass(frozen=True)
class AngleGains:
    """The parameters that all angle-only observers share."""

    quantum: float = parameter(
        0.0,
        unit='rad',
        range=(0.0, 10.0),
        structural=False,
        description='smallest step of the measurement (2 pi / counts); 0: not known',
    )
    noise: float | None = parameter(
        None,
        unit='rad',
        range=(1e-12, 10.0),
        description='standard deviation of the measurement noise without quantisation; '
        'automatic: estimated from the innovation',
    )
    low_speed_bound: bool = parameter(
        True,
        unit='',
        description='limit |velocity| to (last change) / (time since it), in the output only',
    )


@record
class SharedDesign:
    """What the gains imply whatever the sample time is."""

    period: float  # wrap period [rad]; 0: none
    unwrap: bool  # turns are counted from the first sample
    quantum: float  # [rad]; 0: not known
    variance: float  # of the measurement noise and the quantisation [rad^2]; 0: estimated
    floor: float  # variance of the quantisation [rad^2]
    settle: float  # time without a doubt after which a start, or a doubt, has settled [s]
    low_speed_bound: bool  # the speed is clamped to the low-speed bound
    lost_after: float  # time astray until the observer starts again [s]
    restarts: bool  # False: the core is left alone whatever becomes of its lock
    lag: float  # see `starts.start_deviation`


@record
class Reading:
    """What the readings and the innovations have shown of the sensor."""

    change: float  # size of the last change of the reading [rad]
    since: float  # time since it [s]
    smallest: float  # smallest change seen [rad]; 0: none
    recent: float  # recent power of the innovation [rad^2]
    power: float  # mean power of the innovation [rad^2]
    count: float  # samples that it stands for


@record
class Lock:
    """Whether the core follows the shaft."""

    status: int
    clear: float  # time since the last doubt [s]
    astray: float  # time outside since the lock was in doubt [s]
    trusted: float  # speed before the doubt [rad/s]; 0 at a start


def variance_floor(quantum: float) -> float:
    """Return the variance of a uniform quantisation error [rad^2]."""
    return quantum * quantum / 12.0


def variance_of(gains: AngleGains) -> float:
    """Return the variance of a measurement [rad^2] as far as the gains tell; 0: not at all."""
    variance = variance_floor(gains.quantum)
    return variance if gains.noise is None else variance + gains.noise * gains.noise


def set_shared(
    design: SharedDesign,
    gains: AngleGains,
    circle: Circle,
    settle: float,
    lag: float,
    restarts: bool = True,
) -> None:
    """Set what the gains imply; `settle` [s], `lag` and `restarts` as in `SharedDesign`."""
    design.period, design.unwrap = float(circle.period), circle.unwrap
    design.quantum, design.floor = float(gains.quantum), variance_floor(gains.quantum)
    if gains.noise is not None:
        design.variance = gains.noise * gains.noise + design.floor
    design.settle = float(settle)
    design.low_speed_bound = gains.low_speed_bound
    design.lost_after = max(DOUBT_LIMIT, float(settle))
    design.restarts, design.lag = restarts, lag


def believe(state: Any, shared: SharedDesign, measurement: float, dt: float) -> float:
    """Return the measurement [rad], or what is taken in its place; see `sensor.outliers`."""
    core, reading = state.core, state.reading
    if state.lock.status == INITIALISING:
        return measurement
    ahead = core.velocity * dt
    if core.acceleration == core.acceleration:
        ahead += 0.5 * core.acceleration * dt * dt
    quantum = shared.quantum if shared.quantum > 0.0 else reading.smallest
    power = quantum * quantum + reading.recent
    expected = core.position + ahead
    return believed(state.doubt, measurement, expected, ahead, dt, power, shared.period)


def learn(
    observer: Any,
    state: Any,
    coefficients: Any,
    design: Any,
    measurement: float,
    innovation: float,
    speed: float,
) -> None:
    """Learn from a sample and its innovation [rad]: a start, the noise, the lock.

    Parameters
    ----------
    speed : the core's before this sample [rad/s].
    """
    reading, lock, start, dt = state.reading, state.lock, state.start, coefficients.dt
    inside = is_inside(innovation, reading, design.shared)
    square, usual, decay = innovation * innovation, reading.recent, start.decay
    if inside:
        reading.recent += (square - usual) / REST_SAMPLES
    if measurement == state.convention.last:
        if start.clock > 0.0:
            power = min(reading.power, usual)
            follow_start(
                observer, start, state.core, coefficients, design, 0.0, reading.since, power, dt
            )
        reading.since += dt
    else:
        change_reading(observer, state, coefficients, design, measurement, usual)
    if inside and lock.status == TRACKING:
        if start.clock > 0.0:
            if start.decay < LEARNT:
                return
            if decay < LEARNT:
                reading.count = START_READINGS
            if reading.since > 0.0:
                reading.count = max(
                    START_READINGS, 0.75 * reading.count
                )  # coarse: they show no noise
            elif reading.count < SHORT:
                reading.count += 1.0
        elif reading.since == 0.0 and reading.power > CALMED * usual:
            reading.count = REST_SAMPLES
        elif reading.count < MEMORY:
            reading.count += 1.0
        reading.power += (square - reading.power) / reading.count
        return
    if lock.status == INITIALISING:
        if inside:
            reading.power += (square - reading.power) / FRESH
        reading.count = FRESH
    size = 0.0 if inside else abs(innovation)
    relock(observer, state, design, measurement, size, speed, dt)


def change_reading(
    observer: Any, state: Any, coefficients: Any, design: Any, measurement: float, usual: float
) -> None:
    """Take a reading that changed; `usual`: recent power of the innovations before it [rad^2]."""
    core, reading, start, dt = state.core, state.reading, state.start, coefficients.dt
    period = design.shared.period
    half = 0.5 * period if period > 0.0 else math.inf
    moved = measurement - state.convention.last
    if not -half <= moved < half:
        moved = wrap(moved, period)
    if start.clock > 0.0:
        bend = abs(abs(moved) - reading.change)  # steps of a start that skips counts
        if SAME_STEP_TOLERANCE * reading.smallest + RESIDUE < bend < reading.smallest:
            reading.smallest = bend
        power = min(reading.power, usual)
        follow_start(observer, start, core, coefficients, design, moved, 0.0, power, dt)
    elif start.clock < 0.0 or reading.since >= REST_TIME or moved * moved <= REST_GATE * usual:
        since = reading.since
        rest(observer, start, core, coefficients, design, measurement, moved, since, usual, dt)
    reading.change = abs(moved) if abs(moved) > FINEST_QUANTUM else FINEST_QUANTUM
    reading.since = 0.0
    if reading.change < reading.smallest or reading.smallest == 0.0:
        reading.smallest = reading.change
    follow_convention(state.convention, measurement, period)


def is_inside(innovation: float, reading: Reading, design: SharedDesign) -> bool:
    """Return True if an innovation [rad] may be noise, or the next count of a coarse sensor."""
    outside = OUTSIDE_PART * design.period if design.period > 0.0 else math.inf
    if -outside <= innovation <= outside:
        return True
    quantum = design.quantum if design.quantum > 0.0 else reading.smallest
    return quantum > 0.0 and is_next_count(innovation, quantum, design.period)


def unlock(lock: Lock) -> None:
    """Set the lock of a start."""
    lock.status = INITIALISING
    lock.clear = lock.astray = lock.trusted = 0.0


def relock(
    observer: Any, state: Any, design: Any, measurement: float, size: float, speed: float, dt: float
) -> None:
    """Follow the lock where it is in doubt or not settled yet; a core that is lost begins again.

    Parameters
    ----------
    size : of the innovation [rad]. speed : the core's before this sample [rad/s].
    dt : time since the last sample [s].
    """
    core, lock, shared = state.core, state.lock, design.shared
    if lock.status == TRACKING:
        lock.clear, lock.astray, lock.trusted = 0.0, 0.0, speed
    follow_lock(lock, size, dt, shared)
    if shared.restarts:
        turn = shared.period if shared.period > 0.0 else math.inf
        leap = abs(core.velocity - lock.trusted)
        lost = lock.astray > shared.lost_after or leap * dt > turn
        if lock.status == TRACKING:
            lost = lost or leap * dt > 0.5 * turn
        if lost:
            observer.begin(core, design, measurement)
            unlock(lock)


def follow_lock(lock: Lock, size: float, dt: float, design: SharedDesign) -> None:
    """Follow the lock after an innovation of this `size` [rad], `dt` [s] after the last.

    One beyond an eighth of a turn throws doubt on it; `design.settle` and four samples without
    another one restore it. Outside for longer than `design.lost_after`, it is lost.
    """
    if size == math.inf:
        unlock(lock)
    elif size > (OUTSIDE_PART * design.period if design.period > 0.0 else math.inf):
        lock.astray += dt
        lock.clear = 0.0
        if lock.astray > design.lost_after:
            lock.status, lock.trusted = INITIALISING, 0.0
        elif lock.status != INITIALISING:
            lock.status = COASTING
    else:
        lock.clear += dt
        if lock.clear >= design.settle and lock.clear > LOCK_SAMPLES * dt:
            lock.status, lock.astray = TRACKING, 0.0


def low_speed_bound(change: float, since: float, quantum: float, variance: float) -> float:
    """Return the largest speed [rad/s] that a reading unchanged for `since` [s] allows; inf: any.

    A shaft turning faster would have changed the reading by now, unless noise kept it unchanged:
    SURELY standard deviations are added. No bound where the noise is larger than a quantum, because
    then an unchanged reading shows nothing. A stream that repeats every second sample is not slowed
    before it is recognised: its change spans two samples.

    Parameters
    ----------
    change : size of the last change of the reading [rad].
    quantum : smallest step of the reading [rad]; 0: none is known, and there is no bound.
    variance : of the measurement noise, without quantisation [rad^2].
    """
    if since <= 0.0 or quantum <= 0.0 or variance > quantum * quantum:
        return math.inf
    return (
        (change if change > quantum else quantum) + UNCHANGED_SIGMAS * math.sqrt(variance)
    ) / since


def clamped(observer: Any, speed: float, state: Any, coefficients: Any, design: Any) -> float:
    """Return `speed` [rad/s] clamped to the low-speed bound."""
    reading, shared = state.reading, design.shared
    if abs(speed) * reading.since <= reading.change:
        return speed
    quantum = shared.quantum if shared.quantum > 0.0 else reading.smallest
    if shared.variance > 0.0:
        variance = shared.variance - shared.floor
    elif reading.since > STILL * coefficients.dt:
        variance = 0.0
    else:
        of_position, of_velocity, of_innovation = observer.noise_gains(
            state.core, coefficients, design
        )
        variance = reading.recent / of_innovation - variance_floor(quantum)
        variance = variance if variance > 0.0 else 0.0
    bound = low_speed_bound(reading.change, reading.since, quantum, variance)
    return bound if speed > bound else -bound if speed < -bound else speed


def least_variance(reading: Reading, last: float, dt: float, starting: bool) -> float:
    """Return the least variance of the noise [rad^2] where no quantum is known.

    Parameters
    ----------
    last : the last reading [rad].
    starting : a start is in force that has not shown its noise yet.
    """
    if reading.smallest == 0.0:
        return variance_floor(COARSEST * (1.0 + abs(last)))
    if starting:
        return variance_floor(reading.smallest if reading.smallest > RESIDUE else reading.change)
    if reading.since <= STILL * dt:
        finest = DOUBLE_EPSILON * (reading.smallest + abs(last))
        return finest * finest / 12.0
    return reading.smallest * reading.smallest / MEMORY


def begin_motion(observer: Any, state: Any, design: Any, measurement: float) -> None:
    """Begin at a measurement [rad]: what is known of the convention stays."""
    floor = design.shared.floor
    observer.begin(state.core, design, measurement)
    reading = state.reading
    reading.change = reading.since = reading.smallest = 0.0
    reading.recent = reading.power = floor
    reading.count = 1.0
    unlock(state.lock)
    set_start(state.start, -REST_TIME, measurement, 0.0, 0.0, 0.0, 0.0)
    state.doubt.far = 0
    state.doubt.off = state.doubt.reading = state.doubt.waited = 0.0


class LinearObserver(Observer):
    """What all observers of a single angle but `edge_adaptive` inherit.

    Such an observer is a small core: a prediction, and a correction by the wrapped innovation. It
    has the record `Core` and defines `design`, `prepare`, `correct` and `noise_gains`, and `begin`
    and `resume_core` where its core is more than a position and a speed.
    """

    SINGLE_ANGLE = True
    TURNS = True

    @record
    class State:
        """The core, and what is shared around it."""

        core: observer.Core  # type: ignore[name-defined]  # noqa: F821  (bound by the observer's module)
        convention: Convention
        reading: Reading
        lock: Lock
        start: Start
        doubt: Outliers

    @staticmethod
    def begin(core: Any, design: Any, measurement: float) -> None:
        """Begin at a measurement [rad], without a speed."""
        core.position, core.velocity, core.acceleration = measurement, 0.0, math.nan

    @staticmethod
    def resume_core(core: Any, design: Any, measurement: float) -> None:
        """Go on after a gap: at the measurement [rad], with the speed as it was."""
        core.position = measurement

    @staticmethod
    def correct(core: Any, coefficients: Any, design: Any, measurement: float) -> float:
        """Take a measurement [rad]; return the innovation [rad]."""
        raise NotImplementedError

    @staticmethod
    def noise_gains(core: Any, coefficients: Any, design: Any) -> tuple[float, float, float]:
        """Return variances of position, velocity [1/s^2], innovation per unit variance of noise."""
        raise NotImplementedError

    @staticmethod
    def pace(observer: Any, core: Any, coefficients: Any, design: Any, dt: float) -> float:
        """Return how fast the errors of a tracking loop decay [1/s].

        It follows from what the loop makes of noise. A loop whose poles are all at w lets through a
        velocity variance of 1/4 (order 2) to 7/4 (order 3) of w^3 dt per unit variance of white
        noise.
        """
        of_position, of_velocity, of_innovation = observer.noise_gains(core, coefficients, design)
        return PACE * math.pow(of_velocity / dt, THIRD)

    @staticmethod
    def start(observer: Any, state: Any, design: Any, measurement: float) -> None:
        """Set the state after the first sample [rad]."""
        begin_convention(state.convention, measurement)
        begin_motion(observer, state, design, measurement)

    @staticmethod
    def restart(
        observer: Any, state: Any, coefficients: Any, design: Any, measurement: float
    ) -> None:
        """Start again after an outage or a jump of the clock: the turns counted stay."""
        follow_convention(state.convention, measurement, design.shared.period)
        begin_motion(observer, state, design, measurement)

    @staticmethod
    def resume(
        observer: Any, state: Any, coefficients: Any, design: Any, measurement: float
    ) -> None:
        """Go on after a gap [rad]: with the speed as it was, in doubt."""
        lock = state.lock
        if lock.status == TRACKING:
            lock.status, lock.astray, lock.trusted = COASTING, 0.0, state.core.velocity
        lock.clear = 0.0
        speed, period, dt = state.core.velocity, design.shared.period, coefficients.dt
        moved = wrap(measurement - state.convention.last, period)
        of_position, of_velocity, of_innovation = observer.noise_gains(
            state.core, coefficients, design
        )
        if of_velocity < UNBOUNDED:
            kept = abs(speed) + abs(moved) / LEAST_GAP
            set_start(state.start, dt, measurement, 0.0, 0.0, 0.0, kept)
        observer.resume_core(state.core, design, measurement)
        follow_convention(state.convention, measurement, period)
        state.reading.change = state.reading.since = 0.0
        state.doubt.far = 0

    @staticmethod
    def step(
        observer: Any,
        state: Any,
        coefficients: Any,
        design: Any,
        measurement: float,
        known_input: float,
    ) -> None:
        """Take one sample [rad]: correct the core, learn the noise, follow the lock."""
        core = state.core
        speed, dt = core.velocity, coefficients.dt
        off = measurement - core.position - speed * dt
        if off * off > OUTLIER_GATE * state.reading.recent and design.shared.restarts:
            taken = believe(state, design.shared, measurement, dt)
            if taken != measurement:
                observer.correct(core, coefficients, design, taken)
                if not is_inside(state.doubt.off, state.reading, design.shared):
                    relock(observer, state, design, measurement, abs(state.doubt.off), speed, dt)
                return
        else:
            state.doubt.far = 0
        innovation = observer.correct(core, coefficients, design, measurement)
        learn(observer, state, coefficients, design, measurement, innovation, speed)

    @staticmethod
    def estimate(
        observer: Any,
        out: Estimate,
        state: Any,
        coefficients: Any,
        design: Any,
        measurement: float,
        known_input: float,
    ) -> None:
        """Set the estimate."""
        core, reading, shared = state.core, state.reading, design.shared
        velocity = core.velocity
        if reading.since > 0.0 and shared.low_speed_bound:
            velocity = clamped(observer, velocity, state, coefficients, design)
        out.position = present(state.convention, core.position, shared.period, shared.unwrap)
        out.velocity = velocity
        out.acceleration = core.acceleration
        out.status = state.lock.status

    @staticmethod
    def deviation(
        observer: Any, out: Deviation, state: Any, coefficients: Any, design: Any, scale: float
    ) -> None:
        """Set one standard deviation of position and velocity, the latter times `scale`."""
        reading, shared, start = state.reading, design.shared, state.start
        dt, clock = coefficients.dt, start.clock
        of_position, of_velocity, of_innovation = observer.noise_gains(
            state.core, coefficients, design
        )
        variance = shared.variance
        if variance == 0.0:
            variance = reading.power / of_innovation
            if variance < shared.floor:
                variance = shared.floor
            elif shared.floor == 0.0:
                starting = 0.0 < clock < LASTS
                least = least_variance(reading, state.convention.last, dt, starting)
                variance = least if variance < least else variance
        if clock <= 0.0:
            surge = reading.recent / of_innovation - SURGE * variance
            if surge > 0.0:  # the innovation shows a lag now
                variance += surge
        of_position *= variance
        of_velocity *= variance * scale * scale
        if clock > 0.0:  # its terms contain the lag, which is what the scale is for elsewhere
            of_position += reading.recent
            quantum = shared.quantum if shared.quantum > 0.0 else reading.smallest
            of_start = start_deviation(start, state.core.velocity, dt, quantum, shared.lag)
            of_velocity += of_start * of_start
        sigma = math.sqrt(of_velocity)
        if reading.since > 0.0 and shared.low_speed_bound:
            sigma = clamped(observer, sigma, state, coefficients, design)
        if state.doubt.far == 1:  # what was read lies within two deviations
            of_doubt = 0.25 * state.doubt.off * state.doubt.off
            of_position += of_doubt
            sigma = math.sqrt(sigma * sigma + of_doubt / (dt * dt))
        out.position = math.sqrt(of_position)
        out.velocity = sigma
