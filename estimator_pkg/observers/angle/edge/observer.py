# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The edge-aware adaptive observer: a Kalman filter of an angle for which nothing need be tuned.

    a' = -a/FADE + w,  v' = a,  x' = v,       w white jerk of a density that is found on line

What differs from a Kalman filter (`covariance`) is what it makes of a reading (`interval`: a count
is an interval, an edge is a time; `update`), how fast it listens (`bandwidth`), that it learns its
sensor (`quantum`, `sensor`) and its stamps (`clock`), and how it starts (`start`). The one thing a
user says is the quantum, and even that is checked. The derivation is in
docs/observers/edge_adaptive_theory.md, whose headings are those of `step`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from estimator_pkg.circle import Circle, is_angle, is_next_count, wrap
from estimator_pkg.observers.angle.edge.bandwidth import (
    Band,
    Sway,
    begin_band,
    begin_sums,
    follow_sway,
)
from estimator_pkg.observers.angle.edge.constants import (
    CONFIRMED,
    MEMORY,
    PLAIN,
    RATIO,
    REPEATS,
    RESTED,
    SIGMAS,
)
from estimator_pkg.observers.angle.edge.covariance import (
    Coefficients,
    add_manoeuvre,
    add_sway,
    correct_covariance,
    let_fade,
    predict_covariance,
    set_covariance,
)
from estimator_pkg.observers.angle.edge.interval import NOTHING, interval
from estimator_pkg.observers.angle.edge.motion import Motion
from estimator_pkg.observers.angle.edge.preference import Other, predict_other, ratios, set_alike
from estimator_pkg.observers.angle.edge.sigma import deviation, fastest  # noqa: F401
from estimator_pkg.observers.angle.edge.start import (
    LAST,
    RECENT,
    RESTS,
    SETTLES,
    UNSURE,
    Doubt,
    begin_line,
    doubt_in_noise,
    doubt_overdue,
    doubt_speed,
    pass_time,
    set_doubt,
    settle,
    stand,
)
from estimator_pkg.observers.angle.edge.update import update
from estimator_pkg.observers.contract import COASTING, INITIALISING, TRACKING, Estimate, Observer
from estimator_pkg.observers.contract import no_limit as limits  # noqa: F401
from estimator_pkg.observers.maths.covariance import Covariance
from estimator_pkg.observers.maths.informing import ANGLE, RATE, Told, told
from estimator_pkg.parameters import parameter
from estimator_pkg.record import record
from estimator_pkg.sensor.convention import Convention, begin, follow, present
from estimator_pkg.sensor.noise import (
    OUTLIER,
    Sensor,
    age_noise,
    begin_differences,
    begin_sensor,
    first_step,
    follow_sensor,
)
from estimator_pkg.sensor.quantum import (
    JUMP,
    UNIT,
    Steps,
    begin_steps,
    follow_steps,
    is_residue,
    misfit,
    quantum_of,
    search,
    shows_quantum,
)
from estimator_pkg.sensor.sampling import (
    BELIEVED,
    EVEN,
    UNEVEN,
    Clock,
    begin_clock,
    elapsed,
    is_repeat,
    resume_clock,
)

LOST_AFTER = 0.5  # [s] in doubt, and outside for so long in all: the observer starts again
OUTSIDE = 0.125  # an innovation beyond this part of a turn is no reading of this shaft
HASTY = 4.0  # first sample times: where the second is longer, the stamps of the first were wrong

SINGLE_ANGLE = True
EDGES = True
TURNS = True
DRIVEN = False


@dataclass(frozen=True)
class Gains:
    """Parameters of `edge_adaptive`."""

    quantum: float = parameter(
        0.0,
        unit='rad',
        range=(0.0, 10.0),
        structural=False,
        description='smallest step of the measurement (2 pi / counts); 0: found from the smallest '
        'step seen',
    )
    prefer: str = parameter(
        'balanced',
        unit='',
        choices=('smooth', 'balanced', 'fast'),
        among=('smooth', 'balanced', 'fast'),
        description='smooth: half the variance at about twice the delay; fast: half the delay at '
        'about twice the variance',
        equation='density of the jerk: an eighth, once or eight times the one that is found',
    )


@record
class Design:
    """What the gains imply whatever the sample time is."""

    period: float  # wrap period [rad]; 0: none
    half_turn: float  # [rad]; inf: there is no circle
    outside: float  # innovation that is no reading of this shaft [rad]; inf: there is no circle
    unwrap: bool  # turns are counted from the first sample
    quantum: float  # as given [rad]; 0: not known
    ratio: float  # density of the published filter, over that of the first; see `preference`
    log_ratio: float
    of_angle: float  # variance of the published angle, over that of the first filter
    of_speed: float  # the same of the speed


@record
class Reading:
    """One reading, as the parts of a step pass it on."""

    angle: float  # [rad]
    change: float  # since the reading before [rad]
    counted: float  # the same, without a correction of the reading [rad]
    further: float  # by how much its cell reaches further than a quantum [rad]
    passed: float  # time since the last reading that was used [s]
    held: float  # time for which the readings before it repeated [s]
    first: bool  # nothing has moved before
    starting: bool  # the speed is in doubt
    unsure: float  # variance of the speed in doubt, before this reading [(rad/s)^2]
    warm: bool  # the noise is known: the first motion is long ago
    evidence: float  # that the sensor has another clock, before this reading
    extent: float  # range of all readings before [rad]
    rested: float  # time for which the reading had not changed [s]
    stepped: float  # change of the reading before [rad]
    moved: float  # what the prediction moves in this sample [rad]
    ahead: float  # change beyond that [rad]
    off: float  # innovation: distance from the predicted angle [rad]


@record
class Lock:
    """Whether the readings are those of the shaft."""

    status: int
    count: float  # samples since a start, a gap or a doubt
    astray: float  # time for which the readings were far off [s]


@record
class State:
    """What is known of the motion, the bandwidth, the sensor, its stamps and the start."""

    motion: Motion
    p: Covariance
    band: Band
    sway: Sway
    sensor: Sensor
    steps: Steps
    clock: Clock
    convention: Convention
    lock: Lock
    doubt: Doubt
    other: Other
    reading: Reading
    told: Told  # by another sensor


def design(gains: Gains, circle: Circle) -> Design:
    """Return what follows from the gains whatever the sample time is."""
    made, period = Design(), float(circle.period)
    made.period, made.unwrap = period, circle.unwrap
    made.half_turn = 0.5 * period if period > 0.0 else math.inf
    made.outside = OUTSIDE * period if period > 0.0 else math.inf
    made.quantum = float(gains.quantum)
    made.ratio, made.of_angle, made.of_speed = ratios(RATIO[gains.prefer])
    made.log_ratio = math.log(made.ratio)
    return made


def group_delay(design: Design, dt: float) -> float:
    """Return nan: it follows from the motion."""
    return math.nan


def why(state: State, design: Design) -> str:
    """Return what a person should know of the given quantum, or ''."""
    return misfit(state.steps, design.quantum)


def is_reading(measurement: float) -> bool:
    """Return False for NaN, infinities and numbers that no encoder gives [rad or m]."""
    return is_angle(measurement)


def lateness(state: State) -> float:
    """Return by how much the last stamp is taken to be wrong [s]; 0: it is believed."""
    return state.clock.late


def prepare(coefficients: Coefficients, design: Design, dt: float) -> None:
    """Set what follows from dt [s]."""
    square = dt * dt
    cube = square * dt
    coefficients.dt = dt
    coefficients.half = 0.5 * square
    coefficients.q11 = cube / 3.0
    coefficients.q01 = 0.125 * cube * dt
    coefficients.q00 = 0.05 * cube * square


def start(observer: Any, state: State, design: Design, measurement: float) -> None:
    """Set the state after the first sample [rad]."""
    blank = State()
    state.take(blank)
    begin(state.convention, measurement)
    begin_steps(state.steps)
    begin_sensor(state.sensor, design.quantum if design.quantum > 0.0 else UNIT)
    set_doubt(state.doubt, 0.0, LAST, 0.0, 0.0)
    begin_clock(state.clock)
    begin_motion_at(state, measurement)


def begin_motion_at(state: State, measurement: float) -> None:
    """Begin at this measurement [rad], with what is known of sensor, stamps and doubts."""
    motion, quantum = state.motion, state.sensor.quantum
    motion.angle = measurement
    motion.velocity = motion.acceleration = motion.idle = 0.0
    set_covariance(state.p, quantum * quantum / 12.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    begin_band(state.band, 0.0)
    state.lock.status, state.lock.count, state.lock.astray = INITIALISING, 1.0, 0.0
    forget_sway(state)
    set_alike(state.other)


def forget_sway(state: State) -> None:
    """Forget what the readings moved by beyond the prediction."""
    state.sway.mean = state.sway.last = state.sway.before = 0.0


def restart(
    observer: Any, state: State, coefficients: Coefficients, design: Design, measurement: float
) -> None:
    """Start again after an outage or a jump of the clock: what is known of the quantum stays."""
    quantum = quantum_of(state.steps, design.quantum)
    begin_sensor(state.sensor, quantum if quantum > 0.0 else UNIT)
    follow(state.convention, measurement, design.period)
    set_doubt(state.doubt, 0.0, LAST, 0.0, 0.0)
    begin_clock(state.clock)
    begin_motion_at(state, measurement)


def resume(
    observer: Any, state: State, coefficients: Coefficients, design: Design, measurement: float
) -> None:
    """Go on after a gap [rad], whose length is in the coefficients.

    What moved in it is a manoeuvre as old as the gap; where more than half a turn may have passed
    the speed stays as it was, in doubt.
    """
    motion, p, sensor, clock = state.motion, state.p, state.sensor, state.clock
    quantum, v, dt = sensor.quantum, motion.velocity, coefficients.dt
    off = measurement - motion.angle
    if not -design.half_turn <= off < design.half_turn:
        off = wrap(off, design.period)
    off -= v * dt
    set_covariance(p, quantum * quantum / 12.0, 0.0, 0.0, p.p11, 0.0, p.p22)
    variance = v * v
    motion.angle, motion.acceleration, motion.idle = measurement, 0.0, 0.0
    if abs(v) * dt < design.half_turn:  # the reading shows how far it moved
        add_manoeuvre(p, off, dt)
        ratio = off / (p.p00 + sensor.noise)
        motion.velocity += p.p01 * ratio
        motion.acceleration = p.p02 * ratio
        correct_covariance(p, quantum * quantum / 12.0 + sensor.noise, 0.0)
        variance = off * off / (dt * dt)
    begin_sums(state.band)
    begin_differences(sensor)
    state.steps.jump = 0.0
    follow(state.convention, measurement, design.period)
    if state.lock.status == TRACKING:
        state.lock.status = COASTING
    state.lock.count = 0.0
    forget_sway(state)
    set_doubt(state.doubt, variance, SETTLES, state.doubt.since, 0.0)
    clock.late = clock.held = 0.0
    clock.grew = False
    set_alike(state.other)


def step(
    observer: Any,
    state: State,
    coefficients: Coefficients,
    design: Design,
    measurement: float,
    known_input: float,
) -> None:
    """Take one reading [rad]: what it is, when it came, what it shows."""
    reading, dt = state.reading, coefficients.dt
    state.told.now = False
    if not receive(state, design, measurement, known_input, dt):
        predict_alone(state, coefficients, design)
        return
    clock, pace, taken = state.clock, state.sensor.pace, dt
    if clock.uneven > 0.0 or dt > (1.0 + UNEVEN) * pace or dt < (1.0 - UNEVEN) * pace:
        moved = reading.change + state.convention.last - state.motion.angle
        taken = elapsed(clock, dt, moved, state.motion, state.p, state.sensor)
    if taken == dt:
        listen(state, coefficients, design)
    else:  # the stamp was wrong
        reading.passed = reading.passed + taken - dt
        evenly = Coefficients()
        prepare(evenly, design, taken)
        listen(state, evenly, design)


def receive(
    state: State, design: Design, measurement: float, known_input: float, dt: float
) -> bool:
    """Note what a reading is; return False if it is an old one, published again.

    Residue: a jump far beyond the range of all readings before was a glitch if the next reading
    undoes it, else the first real step.
    """
    reading, motion, sensor = state.reading, state.motion, state.sensor
    steps, clock, last = state.steps, state.clock, state.convention.last
    change = measurement - last
    if not -design.half_turn <= change < design.half_turn:
        change = wrap(change, design.period)
    starting = state.doubt.to_settle > 0.0
    lasts = starting and steps.jump * (change + 0.5 * steps.jump) > 0.0
    if starting and not lasts and steps.jump != 0.0:
        change += steps.jump
    if change == 0.0 and not lasts and abs(motion.velocity) * dt > REPEATS * sensor.quantum:
        tracking = state.lock.status == TRACKING
        if is_repeat(clock, motion, state.p, sensor.pace, tracking, dt):
            return False
    if starting:
        pass_time(state.doubt, dt)
        if lasts:
            believe_jump(state, design, last, dt)
        else:
            steps.jump = 0.0
    reading.angle, reading.change, reading.further = measurement, change, known_input
    reading.unsure, reading.starting = state.doubt.variance, starting
    reading.warm, reading.evidence = state.doubt.since >= RECENT, clock.evidence
    reading.extent = state.convention.high - state.convention.low
    reading.rested, reading.stepped = sensor.since, sensor.step
    reading.held = clock.held
    reading.passed = clock.held + dt
    if clock.held > 0.0 or clock.evidence > 0.0:
        resume_clock(clock, change, reading.passed, sensor.pace, motion.velocity)
    return True


def believe_jump(state: State, design: Design, last: float, dt: float) -> None:
    """Begin with the jump before this reading as the first step: all before it was residue.

    Parameters
    ----------
    last : the reading after the jump [rad].
    """
    steps, motion, jump = state.steps, state.motion, state.steps.jump
    begin_steps(steps)
    follow_steps(steps, jump, 0.0, dt, 0.0, design.quantum, math.inf)
    quantum = quantum_of(steps, design.quantum)
    motion.angle = last - 0.5 * jump  # at the edge
    motion.velocity = motion.acceleration = motion.idle = 0.0
    stand(state.p, state.band, quantum)
    first_step(state.sensor, quantum, jump, dt)
    doubt_speed(state.doubt, max(quantum, abs(jump)), dt, 0.0, 0.0)
    set_alike(state.other)


def predict_alone(state: State, coefficients: Coefficients, design: Design) -> None:
    """Predict one sample on, without a reading."""
    motion, density = state.motion, state.band.density
    dt, v, a = coefficients.dt, motion.velocity, motion.acceleration
    let_fade(coefficients, a, state.p.p22)
    motion.angle = motion.angle + v * dt + a * coefficients.half
    motion.velocity += a * dt
    motion.acceleration = coefficients.kept * a
    motion.idle += dt
    predict_covariance(state.p, density, coefficients)
    if design.ratio != 1.0:
        predict_other(state.other, state.p, design.ratio * density, coefficients, 0.0, dt)
    state.clock.held += dt


def listen(state: State, coefficients: Coefficients, design: Design) -> None:
    """Take a reading whose time is known: learn the sensor, predict, and meet the reading."""
    reading, dt = state.reading, coefficients.dt
    pace, previous = state.sensor.pace, state.sensor.dt
    learn_sensor(state, design)
    unknown = reading.starting or reading.first or state.p.p02 == 0.0
    if unknown and shows_line(state, design, dt, pace, previous):
        begin_with_line(state, design)
        return
    predict(state, coefficients, design, pace)
    usual = pace if 0.0 < pace < dt else dt  # samples may have been lost
    if reading.change != 0.0 and reading.rested > MEMORY * usual:
        stir(state, design, dt)  # a rest ends: the speed is in doubt
    off, quantum = reading.off, state.sensor.quantum
    if (off > design.outside or off < -design.outside) and not is_next_count(
        off, quantum, design.period
    ):
        stray(state, design, dt)
    else:
        meet(state, design, dt)


def learn_sensor(state: State, design: Design) -> None:
    """Learn quantum, noise and vibration, in the readings as they came, without a correction."""
    reading, sensor, steps, convention = state.reading, state.sensor, state.steps, state.convention
    quantum, change, last = sensor.quantum, reading.change, convention.last
    reading.first = change != 0.0 and convention.low == convention.high
    reading.counted = change + reading.further
    if change != 0.0 and shows_quantum(steps, reading.counted, sensor.size, sensor.since, quantum):
        extent = abs(reading.angle) + abs(last)
        if is_residue(reading.counted, extent, design.quantum, quantum, reading.first):
            reading.angle, reading.change, reading.first = last, 0.0, False  # it is used again
        else:
            found = search(steps, reading.counted, extent, design.quantum, sensor)
            if found != quantum:
                rescale(state, found, reading.first)
                quantum = found
                set_alike(state.other)
    believed = state.lock.count if state.lock.status == COASTING else math.inf
    follow_sensor(sensor, reading.change, reading.counted, reading.passed, quantum, believed)
    if reading.evidence > BELIEVED:
        age_noise(sensor, state.motion.velocity)
    follow(convention, reading.angle, design.period)


def rescale(state: State, quantum: float, first: bool) -> None:
    """Use another quantum [rad] from now on.

    Covariance, band and sensor stay as they were in quanta, but a finer quantum makes no estimate
    surer.

    Parameters
    ----------
    first : this is the first step of all, and everything was relative to `UNIT`.
    """
    p, sensor = state.p, state.sensor
    used, noise = sensor.quantum, sensor.noise
    scale = quantum * quantum / (used * used)
    if noise > PLAIN * used * used:  # what is known stays as it was in noise
        scale = (quantum * quantum + 12.0 * noise) / (used * used + 12.0 * noise)
    state.band.density *= scale
    if first:
        sensor.noise *= scale
        sensor.lasting *= scale
    if scale > 1.0 or first:
        p.p00 *= scale
        p.p01 *= scale
        p.p02 *= scale
        p.p11 *= scale
        p.p12 *= scale
        p.p22 *= scale


def shows_line(state: State, design: Design, dt: float, pace: float, previous: float) -> bool:
    """Return True if this reading shows the line of a start.

    The second reading; the third where that came too soon; the second that moves on after a rest;
    or the first that moves so early that it shows the quantum alone.

    Parameters
    ----------
    pace, previous : mean sample time, and the sample time before this one [s].
    """
    reading, p = state.reading, state.p
    return (
        p.p11 == 0.0
        or (p.p02 == 0.0 and pace == 0.0 and dt > HASTY * previous and previous > 0.0)
        or (
            reading.starting
            and reading.stepped * reading.change > 0.0
            and state.doubt.to_settle == UNSURE
        )
        or (reading.first and design.quantum == 0.0 and reading.rested <= CONFIRMED * dt)
    )


def begin_with_line(state: State, design: Design) -> None:
    """Begin with the line through this reading and the one before.

    Only the bandwidth stays, where the joint started from a rest. Third differences across the
    start are neither noise nor vibration, so the sensor's means start again.
    """
    reading, sensor, band, doubt = state.reading, state.sensor, state.band, state.doubt
    rests, density, pace = doubt.to_settle == UNSURE, band.density, sensor.pace
    if rests:
        first_step(sensor, sensor.quantum, reading.change, reading.passed)
        sensor.pace = pace
    begin_line(
        state.motion,
        state.p,
        band,
        reading.angle,
        reading.change,
        reading.passed,
        sensor.quantum,
        sensor.noise,
    )
    if rests:
        band.density = density if density > band.density else band.density
        set_doubt(doubt, 0.0, SETTLES, doubt.since, doubt.age)
    state.lock.count += 1.0
    forget_sway(state)
    set_alike(state.other)


def predict(state: State, coefficients: Coefficients, design: Design, pace: float) -> None:
    """Predict motion and covariance: a' = -a/FADE + w, v' = a, x' = v.

    Parameters
    ----------
    pace : mean sample time before this one [s].
    """
    motion, p, sensor, reading = state.motion, state.p, state.sensor, state.reading
    dt, v, a, density = coefficients.dt, motion.velocity, motion.acceleration, state.band.density
    let_fade(coefficients, a, p.p22)
    moved = v * dt + a * coefficients.half
    ahead = reading.change - moved
    if reading.held > 0.0:  # and moved while the reading repeated
        ahead -= (v - 0.5 * a * reading.held) * reading.held
    off = reading.angle - motion.angle - moved
    if off + off >= design.period or off + off < -design.period:
        off = wrap(off, design.period)
    reading.moved, reading.ahead, reading.off = moved, ahead, off
    motion.velocity += a * dt
    motion.acceleration = a * coefficients.kept
    motion.idle += dt
    predict_covariance(p, density, coefficients)
    swing = lasted = 0.0
    if state.sway.mean > 0.0:
        lasted = dt if dt > EVEN * pace else pace  # readings in bursts are not that near
        swing = state.sway.mean - sensor.quantum * sensor.quantum / 6.0 - 2.0 * sensor.noise
        add_sway(p, swing, lasted)
    if design.ratio != 1.0:
        predict_other(state.other, p, design.ratio * density, coefficients, swing, lasted)
    elif state.other.apart:
        set_alike(state.other)


def stir(state: State, design: Design, dt: float) -> None:
    """Doubt the speed at the first changed reading after a rest.

    Not where noise hides single edges (see `doubt_in_noise`), and where the angle is known too
    well: an edge came meanwhile, that noise took back.
    """
    reading, doubt, quantum = state.reading, state.doubt, state.sensor.quantum
    square = quantum * quantum
    if state.sensor.noise <= PLAIN * square and (
        reading.first or 12.0 * state.p.p00 > RESTED * square
    ):
        since = 0.0 if reading.first else doubt.since
        age = doubt.age if reading.rested < RESTS else 0.0
        doubt_speed(doubt, max(quantum, abs(reading.change)), dt, since, age)
        reading.starting = False


def coast(lock: Lock) -> None:
    """Follow a reading that is not believed."""
    if lock.status != INITIALISING:
        lock.status = COASTING
    lock.count = 0.0


def stray(state: State, design: Design, dt: float) -> None:
    """Take a reading an eighth of a turn off: none of this shaft, or not of this speed."""
    lock, reading = state.lock, state.reading
    lock.astray += dt
    outside = design.outside
    if lock.astray > LOST_AFTER or SIGMAS * SIGMAS * state.p.p00 > outside * outside:
        begin_motion_at(state, reading.angle)
        return
    state.motion.angle = reading.angle - reading.off
    coast(lock)


def meet(state: State, design: Design, dt: float) -> None:
    """Take a reading of this shaft: sway, noise that hides single edges, and what an edge shows."""
    reading, motion, p, sensor = state.reading, state.motion, state.p, state.sensor
    sway, lock, quantum, off = state.sway, state.lock, sensor.quantum, reading.off
    mean, last, before, square = sway.mean, sway.last, sway.before, quantum * quantum
    # unless it moved away from a reading that was not believed
    follow_sway(sway, reading.ahead, OUTLIER * (sensor.scatter + square), lock.count > 0.0)
    half, noisy = 0.5 * quantum, sensor.noise > PLAIN * square
    if noisy:
        doubt_in_noise(state.doubt, off, motion.velocity, quantum, sensor.noise, dt)
    elif reading.change * reading.stepped < 0.0 and -half < reading.moved < half:
        if sway.mean <= 0.0:
            # a reading that the next undoes: its noise is as unknown as an angle in its cell
            sensor.noise, noisy = square / 12.0, True
    noise = sensor.noise
    flickers = noisy and reading.moved * reading.moved < noise < half * half
    # most readings are plainly no news: no edge, and none was expected
    inside = -half <= reading.ahead <= half and -half <= off <= half
    if not inside or flickers or 12.0 * p.p00 > square:
        if not hear(state, design, dt, flickers):
            sway.mean, sway.last, sway.before = mean, last, before
            return
        if motion.idle == 0.0 and abs(2.0 * motion.velocity) * dt > design.period > 0.0:
            begin_motion_at(state, reading.angle)  # faster than half a turn per sample: lost
            return
    if reading.change != 0.0 and reading.unsure > 0.0:
        doubt_overdue(state.doubt, 0.0)
    if reading.starting and reading.change != 0.0:
        settle(state.doubt, motion.velocity, reading.change, reading.rested, dt, square, noise)
    if lock.status != TRACKING:
        settle_lock(lock, p.p11, dt, square + 12.0 * noise)
    motion.angle = reading.angle - reading.off


def hear(state: State, design: Design, dt: float, flickers: bool) -> bool:
    """Take what a reading may show of the angle; return False if it is not believed.

    The cell of an unchanged reading may reach further than a quantum; by a quarter of what is known
    of that either end may be wrong.
    """
    reading, sensor = state.reading, state.sensor
    quantum = sensor.quantum
    further = reading.further if reading.change == 0.0 else 0.0
    off, size = reading.off + 0.5 * further, quantum + 1.5 * abs(further)
    kind, centre, half = interval(off, reading.ahead, size, state.p.p00, sensor.noise, flickers)
    if kind == NOTHING:
        return True
    if update(state, design, kind, centre, half, off, size, flickers, dt):
        return True
    if quantum != design.quantum and abs(reading.change) > JUMP * reading.extent:
        # what moved before was residue, or this is a glitch: the next reading decides
        state.steps.jump = reading.change
        doubt_speed(state.doubt, max(quantum, abs(reading.change)), dt, 0.0, 0.0)
    state.motion.angle = reading.angle - reading.off
    state.motion.velocity -= state.motion.acceleration * dt  # it is not extrapolated meanwhile
    coast(state.lock)
    return False


def inform(
    state: State,
    coefficients: Coefficients,
    design: Design,
    kind: int,
    value: float,
    variance: float,
) -> None:
    """Take what another sensor tells of the present motion; see `maths.informing`."""
    motion = state.motion
    if state.lock.status != TRACKING:
        return
    y = motion.velocity if kind == RATE else motion.angle if kind == ANGLE else motion.acceleration
    x, v, a = told(state.p, state.told, kind, value - y, variance)
    motion.angle += x
    motion.velocity += v
    motion.acceleration += a
    set_alike(state.other)


def settle_lock(lock: Lock, p11: float, dt: float, floor: float) -> None:
    """Take one more believed reading of a start, a gap or a doubt.

    Parameters
    ----------
    p11 : variance of the speed. floor : twelve times the variance of a reading [rad^2].
    """
    lock.count += 1.0
    if lock.count >= CONFIRMED and p11 * dt * dt < floor:
        lock.status, lock.astray = TRACKING, 0.0


def estimate(
    observer: Any,
    out: Estimate,
    state: State,
    coefficients: Coefficients,
    design: Design,
    measurement: float,
    known_input: float,
) -> None:
    """Set the estimate; the known input is by how much a cell reaches further than a quantum."""
    motion, other, sensor = state.motion, state.other, state.sensor
    v = motion.velocity + other.v
    if sensor.since > 0.0 and not state.told.now:
        most = fastest(sensor, known_input)
        v = most if v > most else -most if v < -most else v
    angle = motion.angle + other.x
    out.position = present(state.convention, angle, design.period, design.unwrap)
    out.velocity, out.acceleration = v, motion.acceleration + other.a
    out.status = state.lock.status


OBSERVER = Observer(
    name='edge_adaptive',
    summary='finds bandwidth and noise by itself: say how many counts the '
    'encoder has, or not even that',
    gains=Gains,
    reference='docs/observers/edge_adaptive.md: edges as times, truncated Gaussians, innovation '
    'correlation (Mehra 1970), cumulative sums (Page 1954)',
    gives_acceleration=lambda gains: True,
)
