# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What every angle-only observer shares: noise, low-speed bound, status, convention.

An angle-only observer is a small core (a prediction and a correction by the wrapped innovation);
`around` puts the shared part around it and gives the `Functions` of the contract.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from estimator_pkg.observers.angle.late_stamps import BEYOND, begin_clock, follow_clock, make_retake
from estimator_pkg.observers.angle.starts import (
    BAND,
    LASTS,
    LEARNT,
    RECENT,
    RESTED,
    NoiseGains,
    Pace,
    StartFunctions,
    first_start,
    linear_pace,
    make_start,
)
from estimator_pkg.observers.circle import Circle, is_angle, is_next_count, wrap
from estimator_pkg.observers.contract import COASTING, INITIALISING, TRACKING, Functions
from estimator_pkg.observers.convention import begin, follow, present
from estimator_pkg.parameters import parameter

MEMORY = 400.0  # samples over which the innovation's power is averaged
STILL = 8.0  # equal readings in a row that show that the noise is less than a quantum
SURELY = 4.0  # standard deviations of noise that may have kept a reading unchanged
FRESH = 4.0  # samples that the power weighs when a start has settled
OUTSIDE = 0.125  # an innovation beyond this part of a turn is no noise: lock is doubted
CONFIRMED = 3.5  # a lock takes more samples than these
# A fifth of the velocity error where a ramp begins or ends, in acceleration/pace: order 3 ...
LAG_3 = 0.2
LAG_2 = 0.36  # ... and order 2, which lags throughout the ramp
ENOUGH = 8.0  # changed readings after which a start has shown its noise
SHORT = 32.0  # samples over which they are averaged until the start is over
CALMED = 16.0  # times the recent power: what raised the mean, an outlier, is over
SURGE = 2.0  # times its mean, by chance the recent power of the innovation is no larger
UNBOUNDED = 1e200  # a noise gain beyond it: no gap, but a sample time too long for the core
GAP = 0.2  # [s] a gap is at least so long
RESIDUE = 1e-9  # [rad] a smaller step is rounding and not the quantum
SAME = 1e-3  # of a step: two that differ by less differ by their last digits
COARSEST = 2.0**-23  # resolution of a float32, of its value: a reading is no finer than known
FINEST = 2.0**-52  # the same of a double
# in doubt, and outside for this long [s] in all (never less than it takes to settle): the observer
# starts again
LOST_AFTER = 0.5

# (size of the last change [rad], time since it [s], smallest change seen [rad], recent power of the
# innovation [rad^2])
Reading = tuple[float, float, float, float]
# (status, time since the last doubt [s], time outside since the lock was in doubt [s], speed before
# the doubt [rad/s], 0 at a start)
Lock = tuple[int, float, float, float]


class Design(NamedTuple):
    """What the gains imply whatever the sample time is."""

    core: tuple  # of the core
    quantum: float  # [rad]; 0: not known
    variance: float  # of the measurement noise and the quantisation [rad^2]; 0: estimated
    floor: float  # variance of the quantisation [rad^2]
    settle: float  # time without a doubt after which a start, or a doubt, has settled [s]
    low_speed_bound: float  # 1.0: the speed is clamped to the low-speed bound; else 0.0
    lost_after: float  # time astray until the observer starts again [s]


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


@dataclass(frozen=True)
class AngleCore:
    """The part that differs between angle-only observers. All but `design` compile.

    design : () -> design of the core, a NamedTuple.
    settle : time after which a start, or a doubt, has settled [s].
    prepare : (design, dt) -> coefficients of the core.
    init : (measurement, design) -> state of the core.
    correct : (state, coefficients, measurement) -> (state, innovation [rad]). While no speed is
        known (second sample) there is no prediction, and the innovation is 0. It is infinite where
        the core has given up its speed and starts again.
    estimate : (state) -> (position, velocity, acceleration or nan).
    resume : (state, measurement) -> state with this position and the same speed.
    noise_gains : (state, coefficients) -> variances of position, velocity and innovation, each per
        unit variance of white measurement noise.
    turns : see `Functions`.
    restarts : False where the core must be left alone whatever becomes of its lock.
    pace : (state, coefficients, dt) -> how fast errors of a start decay [1/s]; None: that of a
        linear loop, see `linear_pace`.
    lag : standard deviation of the velocity error at the begin and the end of a ramp of speed, in
        acceleration/pace: a fifth of the error itself, so that five cover it.
    """

    design: Callable[[], tuple]
    settle: float
    prepare: Callable[[Any, float], tuple]
    init: Callable[[float, Any], tuple]
    correct: Callable[[tuple, tuple, float], tuple]
    estimate: Callable[[tuple], tuple[float, float, float]]
    resume: Callable[[tuple, float], tuple]
    noise_gains: NoiseGains
    limits: Callable[[float], str | None]
    group_delay: Callable[[float], float]
    turns: bool = False
    restarts: bool = True
    pace: Pace | None = None
    lag: float = LAG_3


def variance_floor(quantum: float) -> float:
    """Return the variance of a uniform quantisation error [rad^2]."""
    return quantum * quantum / 12.0


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
    return ((change if change > quantum else quantum) + SURELY * math.sqrt(variance)) / since


def follow_lock(lock: Lock, size: float, outside: float, dt: float, design: Design) -> Lock:
    """Return the lock after an innovation of this `size` [rad], `dt` [s] after the last.

    One beyond `outside` [rad] throws doubt on the lock; `design.settle` and four samples without
    another one restore it. Outside for longer than `design.lost_after`, it is lost.
    """
    status, clear, astray, trusted = lock
    if size == math.inf:
        return (INITIALISING, 0.0, 0.0, 0.0)
    if size > outside:
        astray += dt
        if astray > design.lost_after:
            return (INITIALISING, 0.0, astray, 0.0)
        return (COASTING if status != INITIALISING else INITIALISING, 0.0, astray, trusted)
    clear += dt
    if clear >= design.settle and clear > CONFIRMED * dt:
        return (TRACKING, clear, 0.0, trusted)
    return (status, clear, astray, trusted)


def least_variance(reading: Reading, last: float, dt: float, noisy_start: bool) -> float:
    """Return the least variance of the noise [rad^2] where no quantum is known.

    Parameters
    ----------
    last : the last reading [rad].
    noisy_start : a start is in force that has not shown its noise yet.
    """
    change, since, smallest, _ = reading
    if smallest == 0.0:
        return variance_floor(COARSEST * (1.0 + abs(last)))
    if noisy_start:
        return variance_floor(smallest if smallest > RESIDUE else change)
    if since <= STILL * dt:
        finest = FINEST * (smallest + abs(last))
        return finest * finest / 12.0
    return smallest * smallest / MEMORY


def around(core: AngleCore, gains: AngleGains, circle: Circle) -> Functions:
    """Return the contract's functions for an angle-only observer made of `core`.

    State: (core's state; convention; reading, see `Reading`; noise: (power of the innovation
    [rad^2], samples it stands for); lock, see `Lock`; start, see `starts`; stamps, see
    `late_stamps`). Coefficients: (those of the core, dt [s]).

    A core that was astray for too long starts again. So does one whose lock returned at another
    speed: every speed + n 2 pi/dt fits the samples as well, and a shaft does not change by half of
    that while the lock is in doubt; nor does a start know of more than pi/dt.
    """
    prepare_core, noise_gains, period = core.prepare, core.noise_gains, float(circle.period)

    def prepare(design: Design, dt: float) -> tuple:
        return (prepare_core(design.core, dt), dt)

    start = make_start(
        core.estimate, noise_gains, core.pace or linear_pace(noise_gains), core.lag, period
    )
    init = _make_init(core)
    clamped = _make_clamped(noise_gains)
    scaled = _make_scaled(core, start, prepare, clamped)

    def stddev(state: tuple, coefficients: tuple, design: tuple) -> tuple[float, float]:
        return scaled(state, coefficients, design, 1.0)

    return Functions(
        _make_design(core, gains),
        prepare,
        init,
        _make_step(core, start, prepare, period),
        _make_output(core.estimate, clamped, period, float(circle.unwrap)),
        stddev,
        _make_resume(core, period),
        core.limits,
        core.group_delay,
        is_angle,
        restart=_make_restart(init, period),
        scaled=scaled,
        late=late,
        turns=core.turns,
    )


def late(state: tuple) -> float:
    """Return by how much the last stamp is taken to be wrong [s]; 0: it is believed."""
    _, _, _, _, _, _, (_, _, lateness, _) = state
    return lateness


def _make_design(core: AngleCore, gains: AngleGains) -> Callable[[], Design]:
    def design() -> Design:
        floor = variance_floor(gains.quantum)
        return Design(
            core=core.design(),
            quantum=float(gains.quantum),
            variance=gains.noise * gains.noise + floor if gains.noise is not None else 0.0,
            floor=floor,
            settle=float(core.settle),
            low_speed_bound=float(gains.low_speed_bound),
            lost_after=max(LOST_AFTER, float(core.settle)),
        )

    return design


def _make_init(core: AngleCore) -> Callable[[float, Design], tuple]:
    init_core = core.init

    def init(measurement: float, design: Design) -> tuple:
        inner = init_core(measurement, design.core)
        return (
            inner,
            begin(measurement),
            (0.0, 0.0, 0.0, design.floor),
            (design.floor, 1.0),
            (INITIALISING, 0.0, 0.0, 0.0),
            first_start(measurement),
            begin_clock(inner),
        )

    return init


def _half_turn(period: float) -> float:
    """Return half a turn [rad]; inf without a circle."""
    return 0.5 * period if period > 0.0 else math.inf


def _outside(period: float) -> float:
    """Return the innovation [rad] beyond which the lock is doubted; inf without a circle."""
    return OUTSIDE * period if period > 0.0 else math.inf


def _make_step(
    core: AngleCore, starts: StartFunctions, prepare: Callable[[Any, float], tuple], period: float
) -> Callable[..., tuple]:
    correct, retake, relock = (
        core.correct,
        make_retake(prepare, core.correct),
        _make_relock(core, period),
    )
    at_rest, in_force = starts.at_rest, starts.in_force
    half, outside = _half_turn(period), _outside(period)

    def step(
        state: tuple, coefficients: tuple, design: Design, measurement: float, known_input: float
    ) -> tuple:
        (
            before,
            convention,
            (change, since, smallest, recent),
            (power, count),
            lock,
            start,
            stamps,
        ) = state
        of_core, dt = coefficients
        last, _, _, _, _ = convention
        status, _, _, _ = lock
        clock, _, _, decay, _, _ = start
        mean_dt, taken_dt, late, _ = stamps
        inner, innovation = correct(before, of_core, measurement)
        if dt != mean_dt or taken_dt != 0.0:
            if late == 0.0 and innovation * innovation <= BEYOND * recent:
                stamps = follow_clock(stamps, dt)
            else:
                inner, innovation, coefficients, stamps = retake(
                    stamps,
                    recent if status != INITIALISING else math.inf,
                    before,
                    design,
                    measurement,
                    inner,
                    innovation,
                    coefficients,
                )
                of_core, dt = coefficients
        square, usual = innovation * innovation, recent
        inside = -outside <= innovation <= outside
        if not inside:
            quantum = design.quantum if design.quantum > 0.0 else smallest
            inside = quantum > 0.0 and is_next_count(innovation, quantum, period)
        if inside:
            recent += (square - recent) / RECENT
        if measurement == last:
            if clock > 0.0:
                start = in_force(start, 0.0, since, min(power, usual), coefficients, inner)
            since += dt
        else:
            moved = measurement - last
            if not -half <= moved < half:
                moved = wrap(moved, period)
            if clock > 0.0:
                bend = abs(abs(moved) - change)  # steps of a start that skips counts
                smallest = bend if SAME * smallest + RESIDUE < bend < smallest else smallest
                start = in_force(start, moved, 0.0, min(power, usual), coefficients, inner)
            elif clock < 0.0 or since >= RESTED or moved * moved <= BAND * usual:
                start = at_rest(start, measurement, moved, since, usual, coefficients, inner)
            change, since = abs(moved), 0.0
            if 0.0 < change < smallest or smallest == 0.0:
                smallest = change
            convention = follow(convention, measurement, period)
        reading = (change, since, smallest, recent)
        if inside and status == TRACKING:
            clock, _, _, decayed, _, _ = start
            if clock > 0.0:
                if decayed < LEARNT:
                    return (inner, convention, reading, (power, count), lock, start, stamps)
                if decay < LEARNT:
                    count = ENOUGH
                if since > 0.0:
                    count = max(ENOUGH, 0.75 * count)  # coarse: the readings show no noise
                elif count < SHORT:
                    count += 1.0
            elif since == 0.0 and power > CALMED * usual:
                count = RECENT
            elif count < MEMORY:
                count += 1.0
            power += (square - power) / count
            return (inner, convention, reading, (power, count), lock, start, stamps)
        if status == INITIALISING:
            if inside:
                power += (square - power) / FRESH
            count = FRESH
        size = 0.0 if inside else abs(innovation)
        inner, lock = relock(lock, before, inner, size, dt, mean_dt, design, measurement)
        return (inner, convention, reading, (power, count), lock, start, stamps)

    return step


def _make_relock(core: AngleCore, period: float) -> Callable[..., tuple[tuple, Lock]]:
    init_core, estimate, restarts = core.init, core.estimate, core.restarts
    half, outside = _half_turn(period), _outside(period)

    def relock(
        lock: Lock,
        before: tuple,
        inner: tuple,
        size: float,
        dt: float,
        mean_dt: float,
        design: Design,
        measurement: float,
    ) -> tuple[tuple, Lock]:
        """Return the core's state and the lock, where it is in doubt or not settled yet.

        Parameters
        ----------
        before, inner : the core's state before and after this sample.
        size : of the innovation [rad].
        """
        status, _, _, _ = lock
        if status == TRACKING:
            _, speed, _ = estimate(before)
            lock = (TRACKING, 0.0, 0.0, speed)
        lock = follow_lock(lock, size, outside, dt, design)
        if restarts:
            status, _, astray, trusted = lock
            _, speed, _ = estimate(inner)
            lost = astray > design.lost_after or abs(speed - trusted) * mean_dt > 2.0 * half
            if status == TRACKING:
                lost = lost or abs(speed - trusted) * dt > half
            if lost:
                return init_core(measurement, design.core), (INITIALISING, 0.0, 0.0, 0.0)
        return inner, lock

    return relock


def _make_clamped(noise_gains: NoiseGains) -> Callable[..., float]:
    def clamped(
        speed: float, inner: tuple, reading: Reading, coefficients: tuple, design: Design
    ) -> float:
        """Return `speed` [rad/s] clamped to the low-speed bound."""
        change, since, smallest, recent = reading
        if abs(speed) * since <= change:
            return speed
        of_core, dt = coefficients
        quantum = design.quantum if design.quantum > 0.0 else smallest
        if design.variance > 0.0:
            variance = design.variance - design.floor
        elif since > STILL * dt:
            variance = 0.0
        else:
            _, _, of_innovation = noise_gains(inner, of_core)
            variance = recent / of_innovation - variance_floor(quantum)
            variance = variance if variance > 0.0 else 0.0
        bound = low_speed_bound(change, since, quantum, variance)
        return bound if speed > bound else -bound if speed < -bound else speed

    return clamped


def _make_output(
    estimate: Callable[[tuple], tuple[float, float, float]],
    clamped: Callable[..., float],
    period: float,
    unwrap: float,
) -> Callable[..., tuple]:
    def output(
        state: tuple, coefficients: tuple, design: Design, measurement: float, known_input: float
    ) -> tuple:
        inner, convention, (change, since, smallest, recent), _, (status, _, _, _), _, _ = state
        position, velocity, acceleration = estimate(inner)
        if since > 0.0 and design.low_speed_bound > 0.0:
            change += abs(known_input)  # the cell reaches so much further than a quantum
            reading = (change, since, smallest, recent)
            velocity = clamped(velocity, inner, reading, coefficients, design)
        return (present(convention, position, period, unwrap), velocity, acceleration, status)

    return output


def _make_scaled(
    core: AngleCore,
    starts: StartFunctions,
    prepare: Callable[[Design, float], tuple],
    clamped: Callable[..., float],
) -> Callable[[tuple, tuple, Any, float], tuple[float, float]]:
    noise_gains, estimate, of_start = core.noise_gains, core.estimate, starts.deviation

    def scaled(
        state: tuple, coefficients: tuple, design: Design, scale: float
    ) -> tuple[float, float]:
        inner, convention, reading, (power, count), _, start, (_, taken_dt, _, _) = state
        _, since, smallest, recent = reading
        clock, _, _, _, _, _ = start
        _, quantum, variance, floor, _, low_speed_bound, _ = design
        if taken_dt != 0.0:
            coefficients = prepare(design, taken_dt)
        of_core, dt = coefficients
        of_position, of_velocity, of_innovation = noise_gains(inner, of_core)
        if variance == 0.0:
            variance = power / of_innovation
            if variance < floor:
                variance = floor
            elif floor == 0.0:
                last, _, _, _, _ = convention
                noisy_start = 0.0 < clock < LASTS
                least = least_variance(reading, last, dt, noisy_start)
                if variance < least:
                    variance = least
        if clock <= 0.0:
            surge = recent / of_innovation - SURGE * variance
            if surge > 0.0:  # the innovation shows a lag now
                variance += surge
        of_position *= variance
        of_velocity *= variance * scale * scale
        if clock > 0.0:  # its terms contain the lag, which is what the scale is for elsewhere
            of_position += recent
            _, speed, _ = estimate(inner)
            if quantum == 0.0:
                quantum = smallest
            since_start = of_start(start, speed, dt, quantum)
            of_velocity += since_start * since_start
        sigma = math.sqrt(of_velocity)
        if since > 0.0 and low_speed_bound > 0.0:
            sigma = clamped(sigma, inner, reading, coefficients, design)
        return math.sqrt(of_position), sigma

    return scaled


def _make_resume(core: AngleCore, period: float) -> Callable[..., tuple]:
    estimate, noise_gains, resume_core = core.estimate, core.noise_gains, core.resume

    def resume(state: tuple, coefficients: tuple, design: Design, measurement: float) -> tuple:
        inner, convention, (_, _, smallest, recent), noise, lock, start, stamps = state
        of_core, dt = coefficients
        last, _, _, _, _ = convention
        status, _, astray, trusted = lock
        mean_dt, _, _, other = stamps
        _, speed, _ = estimate(inner)
        if status == TRACKING:
            lock = (COASTING, 0.0, 0.0, speed)
        else:
            lock = (status, 0.0, astray, trusted)
        moved = wrap(measurement - last, period)
        _, of_velocity, _ = noise_gains(inner, of_core)
        if of_velocity < UNBOUNDED:
            start = (dt, measurement, 0.0, 0.0, 0.0, abs(speed) + abs(moved) / GAP)
        return (
            resume_core(inner, measurement),
            follow(convention, measurement, period),
            (0.0, 0.0, smallest, recent),
            noise,
            lock,
            start,
            (mean_dt, 0.0, 0.0, other),
        )

    return resume


def _make_restart(init: Callable[[float, Design], tuple], period: float) -> Callable[..., tuple]:
    def restart(state: tuple, coefficients: tuple, design: Design, measurement: float) -> tuple:
        _, convention, _, _, _, _, _ = state
        inner, _, reading, noise, lock, start, stamps = init(measurement, design)
        convention = follow(convention, measurement, period)
        return (inner, convention, reading, noise, lock, start, stamps)

    return restart
