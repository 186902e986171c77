# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The edge-aware adaptive observer: a Kalman filter of an angle for which nothing need be tuned.

    a' = -a/FADE + w,  v' = a,  x' = v,       w white jerk of a density that is found on line

What differs from a Kalman filter (`covariance`) is what it makes of a reading
(`interval`: a count is an interval, an edge is a time), how fast it listens
(`bandwidth`), that it learns its sensor (`sensor`) and how it starts (`start`). The
one thing a user says is the quantum, and even that is checked. The derivation is in
docs/observers/edge_adaptive.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from estimator_pkg.observers.angle.core import LOST_AFTER, OUTSIDE, is_angle
from estimator_pkg.observers.angle.edge.bandwidth import (
    STEADY,
    Band,
    Laws,
    after_manoeuvre,
    began,
    begin_band,
    follow_band,
    follow_sway,
    sums_alone,
)
from estimator_pkg.observers.angle.edge.clock import (
    APART,
    REPEATS,
    UNEVEN,
    UNKNOWN,
    Clock,
    elapsed,
    repeats,
    resumed,
    waiting,
)
from estimator_pkg.observers.angle.edge.covariance import (
    Covariance,
    corrected,
    manoeuvred,
    predicted,
    swayed,
    widened,
)
from estimator_pkg.observers.angle.edge.interval import HELD, NOTHING, cell, interval, within
from estimator_pkg.observers.angle.edge.sensor import (
    FINEST,
    FIRST_STEPS,
    JUMP,
    OUTLIER,
    RESIDUE,
    ROUNDING,
    TOO_LARGE,
    TOO_SMALL,
    Sensor,
    Steps,
    aged,
    agreement,
    begin_sensor,
    counted_as,
    first_step,
    follow_noise,
    follow_sensor,
    follow_steps,
    paced,
    quantum_of,
    shows_quantum,
    vibration,
    with_noise,
)
from estimator_pkg.observers.angle.edge.start import (
    RECENT,
    RESTS,
    SETTLES,
    START,
    UNSURE,
    Doubt,
    Motion,
    doubted,
    doubted_in_noise,
    later,
    settled,
    started,
    stood,
    unseen,
)
from estimator_pkg.observers.circle import Circle, wrap
from estimator_pkg.observers.contract import (
    COASTING,
    INITIALISING,
    TRACKING,
    Functions,
    Observer,
)
from estimator_pkg.observers.convention import begin, follow, present
from estimator_pkg.parameters import parameter

# The constants, all of them; docs/observers/edge_adaptive.md says where each comes from.
RATE = 0.3  # of the slow law: log density per unit of its product and of filter memory
SLACK = {'smooth': 0.6, 'balanced': 0.3, 'fast': 0.0}  # of that product
SHARE = 0.2  # memory of the slow law's low-pass, over the filter's
SIGMAS = 3.0  # slack of the cumulative sums; prediction this far outside its cell is held
ALARM = 12.0  # of the cumulative sums: four samples of twice the slack
BLUR = 0.03  # quanta: no edge is known better; and either end of an interval, of its width
LONGEST = 2.0  # [s] longest memory; the start's too
FADE = 0.3  # [s] memory of the acceleration
MEMORY = 32.0  # samples: memory of the noise, and of the innovations' size
EXPECTED = 0.01  # of the density that explains a manoeuvre: the least after it, without noise
STRAY = 2.0  # quanta: beyond them one sample alone is never believed
CONFIRMED = 4.0  # samples after which a start, a gap or a doubt has settled
CALM = 0.5  # of its variance the speed keeps at least, however small the innovations are

UNIT = 1.0  # [rad] quantum while none is known: before the first step all is relative to it
RESTED = 0.7  # of a cell's variance: a prediction this vague has seen no edge for long
SLIGHT = 0.3  # a rise of the log density by less changes next to nothing of the update
PLAIN = 4.0 * BLUR * BLUR  # square quanta: a noise above it is more than the blur of the edges
LEAST_PART = 0.05  # of its variance an innovation has at least, were it to count in sigmas

# what the noise of the readings is like
PLAIN_EDGES = 0  # less than the blur of the edges
NOISY = 1  # more
FLICKER = 2  # it crosses an edge more often than the angle does


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
        description='what to give way to where noise and delay are at odds',
        equation='slack of the bandwidth law: 0.6, 0.3 or 0',
    )


class Design(NamedTuple):
    """What the gains imply whatever the sample time is."""

    quantum: float  # as given [rad]; 0: not known
    laws: tuple[float, float, float, float, float, float]  # constants; the fields of `Laws`


def prepare(design: Design, dt: float) -> tuple:
    """Return what depends on dt alone; see `predicted`."""
    square = dt * dt
    cube = square * dt
    return (
        dt,
        0.5 * square,
        FADE / (FADE + dt),
        cube / 3.0,
        0.125 * cube * dt,
        0.05 * cube * square,
    )


def init(measurement: float, design: Design) -> tuple:
    """Return the state after the first sample [rad]; see `build`."""
    quantum = design.quantum if design.quantum > 0.0 else UNIT
    return first_state(
        measurement,
        begin_sensor(quantum, BLUR),
        FIRST_STEPS,
        begin(measurement),
        START,
        UNKNOWN,
    )


def first_state(
    measurement: float, sensor: Sensor, steps: Steps, convention: tuple, doubt: Doubt, clock: Clock
) -> tuple:
    """Return the state of a start at this measurement [rad], with this knowledge of the sensor."""
    quantum, _, _, _, _, _, _, _, _, _, _ = sensor
    return (
        (measurement, 0.0, 0.0, 0.0),
        (quantum * quantum / 12.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        begin_band(0.0),
        sensor,
        steps,
        convention,
        (INITIALISING, 1.0, 0.0),
        STEADY,
        doubt,
        clock,
    )


def rescaled(
    p: Covariance, band: Band, sensor: Sensor, quantum: float, first: bool
) -> tuple[Covariance, Band, Sensor]:
    """Return covariance, band and sensor where the quantum in use becomes `quantum` [rad].

    They stay as they were in quanta; but a finer quantum makes the estimate no surer.

    Parameters
    ----------
    first : this is the first step of all, and everything was relative to `UNIT`.
    """
    used, noise, scatter, residual, step, dt, change, since, bend, lasting, pace = sensor
    density, low, variance, up, down, up_time, down_time, squares = band
    scale = quantum * quantum / (used * used)
    band = (density * scale, low, variance, up, down, up_time, down_time, squares)
    if first:
        noise *= scale
        lasting *= scale
        sensor = (used, noise, scatter, residual, step, dt, change, since, bend, lasting, pace)
    if scale > 1.0 or first:
        p00, p01, p02, p11, p12, p22 = p
        p = (scale * p00, scale * p01, scale * p02, scale * p11, scale * p12, scale * p22)
    return p, band, sensor


def after_jump(
    jump: float, last: float, dt: float, given: float, period: float
) -> tuple[Motion, Covariance, Band, Sensor, Steps, Doubt]:
    """Return what is known where a `jump` [rad] was confirmed: all before it was residue.

    Parameters
    ----------
    last : the reading after the jump [rad].
    given : quantum as the user gave it [rad]; 0: not known.
    """
    steps = follow_steps(FIRST_STEPS, jump, 0.0, dt, 0.0, given, math.inf)
    quantum = quantum_of(steps, given)
    p, band = stood(quantum, BLUR, LONGEST)
    return (
        (last - 0.5 * jump, 0.0, 0.0, 0.0),  # at the edge
        p,
        band,
        first_step(quantum, BLUR, jump, dt),
        steps,
        doubted(quantum, dt, period, 0.0, 0.0),
    )


def straight_line(
    measurement: float,
    change: float,
    dt: float,
    sensor: Sensor,
    period: float,
    band: Band,
    doubt: Doubt,
) -> tuple[Motion, Covariance, Band, Sensor, Doubt]:
    """Return what two readings show, `change` [rad] and `dt` [s] after each other.

    Only the bandwidth stays, where the joint started from a rest. Third differences across the
    start are neither noise nor vibration, so the sensor's means start again.
    """
    quantum, noise, _, _, _, _, _, _, _, _, pace = sensor
    was, _, _, _, _, _, _, _ = band
    _, to_settle, since, age = doubt
    motion, p, band = started(measurement, change, dt, quantum, noise, period, LONGEST)
    if to_settle == UNSURE:
        density, low, variance, up, down, up_time, down_time, squares = band
        density = was if was > density else density
        band = (density, low, variance, up, down, up_time, down_time, squares)
        doubt = (0.0, SETTLES, since, age)
        sensor = paced(first_step(quantum, BLUR, change, dt), pace)
    return motion, p, band, sensor, doubt


def manoeuvre(p: Covariance, d: float, date: float, quantum: float, noise: int) -> Covariance:
    """Return the covariance where the fast law dates a manoeuvre that explains `d` [rad].

    Parameters
    ----------
    date : time since the manoeuvre began [s].
    noise : `PLAIN_EDGES`, `NOISY` or `FLICKER`.
    """
    p00, _, _, p11, _, _ = p
    if noise == FLICKER and -STRAY * quantum < d < STRAY * quantum and p11 > 0.0:
        # flicker that begins again: it moved in all the time that is remembered
        date = max(date, math.sqrt(p00 / p11))
    return manoeuvred(p, d, date)


def update(
    worth: tuple[int, float, float],
    deviations: tuple[float, float],
    p: Covariance,
    band: Band,
    sensor: Sensor,
    noise_is: int,
    idle: float,
    dt: float,
    laws: tuple,
    warm: bool,
) -> tuple[bool, tuple[float, float, float], Covariance, Band, Sensor]:
    """Return the measurement update for an informative reading.

    Parameters
    ----------
    worth : (kind, centre [rad], half width [rad]), what the reading shows; see `interval`.
    deviations : of the reading from the predicted angle, and of its change from the predicted
        motion [rad]; see `interval`.
    noise_is : `PLAIN_EDGES`, `NOISY` or `FLICKER`.
    idle : time since the last informative reading [s].

    Returns
    -------
    Whether it is believed, correction of (x, v, a), covariance, band, sensor.
    """
    kind, centre, half = worth
    quantum, noise, scatter, _, _, _, _, _, _, _, _ = sensor
    p00, p01, p02, _, _, _ = p
    flickers = noise_is == FLICKER
    # the interval meets the Gaussian: S = P_00 + R, the mean d, f = 1 - left
    r = noise + 16.0 * BLUR * BLUR * half * half
    s = p00 + r
    d, left = within(centre, half, math.sqrt(s))
    f = 1.0 - left
    z = d / math.sqrt(s * (f if f > LEAST_PART else LEAST_PART))
    beyond = z > ALARM or z < -ALARM
    if beyond:
        z = ALARM if z > 0.0 else -ALARM
    # the slow law and the fast law; a vibration needs a density of its own
    least = (quantum * quantum + 12.0 * noise) / LONGEST**5
    if not flickers:
        shaken = vibration(sensor) if warm else 0.0
        if shaken > least:
            least = shaken
    listening, growth, date, product = follow_band(band, z, f * p00 / s, idle, least, laws)
    if beyond and date == 0.0 and (d > STRAY * quantum or d < -STRAY * quantum):
        # one sample alone: the sums and their dates alone keep it, for the next to confirm
        return False, (0.0, 0.0, 0.0), p, sums_alone(band, listening), sensor
    score = d * d / s - f
    if growth > 0.0:
        p = widened(p, growth)
        p00, p01, p02, _, _, _ = p
        s = p00 + r
    if date > 0.0 or growth > SLIGHT:  # the same reading is worth more to a vaguer prediction
        if date > 0.0:
            date = began(date, dt, noise_is != PLAIN_EDGES, SIGMAS, ALARM)
            if warm and not flickers:
                hidden, share = 0.5 * quantum, EXPECTED  # a cell may hide it
                if noise_is == NOISY:
                    hidden, share = hidden + SIGMAS * math.sqrt(scatter), 1.0
                most = 20.0 * (scatter + quantum * quantum) / dt**5  # as in `vibration`
                listening = after_manoeuvre(listening, abs(d) - hidden, date, share, most)
            p = manoeuvre(p, d, date, quantum, noise_is)
            p00, p01, p02, _, _, _ = p
        if not flickers:
            off, ahead = deviations
            edges = math.sqrt(noise)
            kind, centre, half = interval(off, ahead, quantum, p00, edges, SIGMAS * edges)
        r = noise + 16.0 * BLUR * BLUR * half * half
        s = p00 + r
        d, left = within(centre, half, math.sqrt(s))
    # the noise follows the score: flicker shows it from either side alike; elsewhere what is
    # correlated is motion
    _, low, variance, _, _, _, _, _ = band
    if low * low < variance if flickers else kind != HELD and (score < 0.0 or product < 1.0):
        most = noise if flickers and scatter < noise else scatter
        likelier = follow_noise(noise, score * noise / s, most, quantum, MEMORY, BLUR)
        if likelier != noise:
            sensor = with_noise(sensor, likelier)
    ratio = d / s  # K d = P_.0 d/S
    shift = (p00 * ratio, p01 * ratio, p02 * ratio)
    if kind != HELD:  # that an edge did not come moves the estimate, but is no reading
        p = corrected(p, r, left)
    return True, shift, p, listening, sensor


def fastest(sensor: Sensor, excess: float) -> float:
    """Return the largest speed [rad/s] that an unchanged reading allows.

    Parameters
    ----------
    excess : by how much the present cell is larger than a quantum [rad]; below 0: smaller.
    """
    quantum, noise, _, _, _, _, change, since, _, _, _ = sensor
    way = (change if change > quantum else quantum) + 2.0 * SIGMAS * math.sqrt(noise)
    return (way + excess if excess > 0.0 else way) / since


def why(state: tuple, design: Any) -> str:
    """Return what a person should know of the given quantum, or ''."""
    _, _, _, _, steps, _, _, _, _, _ = state
    given, found = design.quantum, quantum_of(steps, 0.0)
    judged = agreement(steps, given)
    if judged == TOO_LARGE:
        return (
            f'quantum {given:.4g} is too large: steps of {found:.4g} were seen, which is '
            'used instead'
        )
    if judged == TOO_SMALL:
        return (
            f'quantum {given:.4g} is too small: no step below {found:.4g} was seen, which '
            'is used instead'
        )
    return ''


def build(gains: Gains, circle: Circle) -> Functions:
    """Return the functions at these gains.

    State: motion: (position [rad], velocity, acceleration, time since an informative reading [s]);
    covariance; band (see `bandwidth`); sensor, steps (see `sensor`); convention;
    lock: (status, samples since a start, a gap or a doubt, time [s] for which the readings were far
    off); sway (see `bandwidth`); doubt (see `start`); clock (see `clock`).
    """
    period = float(circle.period)

    def design() -> Design:
        laws = Laws(RATE, SLACK[gains.prefer], SHARE, SIGMAS, ALARM, MEMORY)
        return Design(
            float(gains.quantum),
            (laws.rate, laws.slack, laws.share, laws.sigmas, laws.alarm, laws.memory),
        )

    return Functions(
        design,
        prepare,
        init,
        _make_step(period),
        _make_output(period, float(circle.unwrap)),
        _make_stddev(period),
        _make_resume(period),
        lambda dt: None,
        lambda dt: math.nan,
        is_angle,
        why=why,
        restart=_make_restart(period),
    )


def _make_step(period: float) -> Callable[..., tuple]:
    outside = OUTSIDE * period if period > 0.0 else math.inf

    def step(
        state: tuple, coefficients: tuple, design: Design, measurement: float, known_input: float
    ) -> tuple:
        motion, p, band, sensor, steps, convention, lock, sway, doubt, clock = state
        x, v, a, idle = motion
        quantum, noise, scatter, _, stepped, _, size, rested, _, _, pace = sensor
        last, low, high, _, _ = convention
        _, to_settle, since, age = doubt
        _, uneven, held, _, apart = clock
        dt, _, _, _, _, _ = coefficients
        change = measurement - last
        if change + change >= period or change + change < -period:
            change = wrap(change, period)
        # a reading that repeats an old one, and the first one after it
        passed = held + dt
        if change == 0.0 and abs(v) * dt > REPEATS * quantum:
            status, _, _ = lock
            _, _, _, p11, _, _ = p
            if status == TRACKING and repeats(clock, dt, pace, v, a, p11):
                _, half_square, kept, _, _, _ = coefficients
                density, _, _, _, _, _, _, _ = band
                motion = (x + v * dt + a * half_square, v + a * dt, kept * a, idle + dt)
                p, clock = predicted(p, density, coefficients), waiting(clock, dt)
                return (motion, p, band, sensor, steps, convention, lock, sway, doubt, clock)
        if held > 0.0 or apart > 0.0:
            clock = resumed(clock, change, passed, pace, v)
        # a stamp that is wrong
        if uneven > 0.0 or dt > (1.0 + UNEVEN) * pace or dt < (1.0 - UNEVEN) * pace:
            taken, clock = elapsed(clock, dt, pace, change + last - x, v, a, p, quantum, noise)
            if taken != dt:
                dt, passed = taken, passed + taken - dt
                coefficients = prepare(design, dt)
        # residue: was the last step a glitch, or the first real one?
        doubted_so_far = to_settle > 0.0
        if doubted_so_far:
            doubt = later(doubt, dt)
            smallest, candidate, shown, least, left, finer, jump = steps
            if jump * (change + 0.5 * jump) > 0.0:  # it lasts
                motion, p, band, sensor, steps, doubt = after_jump(
                    jump, last, dt, design.quantum, period
                )
                x, v, a, idle = motion
                quantum, noise, scatter, _, stepped, _, size, rested, _, _, pace = sensor
            elif jump != 0.0:  # a glitch
                change += jump
                steps = (smallest, candidate, shown, least, left, finer, 0.0)
            _, to_settle, since, age = doubt
        # the search for the quantum: in the readings as they came, without a correction
        first = False
        if change != 0.0 and shows_quantum(steps, change + known_input, size, rested, quantum):
            first, counted = low == high, change + known_input
            extent = abs(measurement) + abs(last)
            least = ROUNDING * extent if first and design.quantum == 0.0 else RESIDUE * quantum
            if -least <= counted <= least or -FINEST < counted < FINEST:
                measurement, change, first = last, 0.0, False  # residue: the reading before is used
            else:
                steps = follow_steps(steps, counted, size, rested, extent, design.quantum, scatter)
                used, quantum = quantum, quantum_of(steps, design.quantum)
                if quantum != used:
                    p, band, sensor = rescaled(p, band, sensor, quantum, first)
        sensor = follow_sensor(sensor, change, passed, quantum, MEMORY, BLUR)
        if known_input != 0.0 and change != 0.0:
            sensor = counted_as(sensor, change + known_input)
        if apart > APART:
            sensor = aged(sensor, v)
        _, noise, scatter, _, _, _, _, _, _, _, _ = sensor
        convention = follow(convention, measurement, period)
        status, count, astray = lock
        _, _, _, p11, _, _ = p
        if (
            p11 == 0.0
            or (doubted_so_far and stepped * change > 0.0 and to_settle == UNSURE)
            or (first and design.quantum == 0.0 and rested <= CONFIRMED * dt)
        ):
            # no speed is known: the second reading, the second that moves on after a rest, or the
            # first that moves so early that it shows the quantum alone
            motion, p, band, sensor, doubt = straight_line(
                measurement, change, passed, sensor, period, band, doubt
            )
            lock = (status, count + 1.0, astray)
            return (motion, p, band, sensor, steps, convention, lock, STEADY, doubt, clock)
        # prediction: a' = -a/FADE + w, v' = a, x' = v
        _, half_square, kept, _, _, _ = coefficients
        density, _, _, _, _, _, _, _ = band
        moved = v * dt + a * half_square
        ahead = change - moved
        if held > 0.0:  # and moved while the reading repeated
            ahead -= (v - 0.5 * a * held) * held
        off = measurement - x - moved
        if off + off >= period or off + off < -period:
            off = wrap(off, period)
        v += a * dt
        a *= kept
        p = predicted(p, density, coefficients)
        square = quantum * quantum
        mean_sway, _, _ = sway
        if mean_sway > 0.0:
            swing = mean_sway - square / 6.0 - 2.0 * noise
            if swing > 0.0:
                p = swayed(p, swing, dt)
        p00, _, _, _, _, _ = p
        idle += dt
        starts = (
            rested > 0.0
            and change != 0.0
            and rested > MEMORY * dt
            and noise <= PLAIN * square
            and (first or 12.0 * p00 > RESTED * square)
        )
        if starts:
            doubted_so_far = False
            doubt = doubted(
                quantum, dt, period, 0.0 if first else since, age if rested < RESTS else 0.0
            )
        if off > outside or off < -outside:
            # an eighth of a turn off: no reading of this shaft, or not of this speed
            astray += dt
            if astray > LOST_AFTER:
                return first_state(measurement, sensor, steps, convention, doubt, clock)
            motion = (measurement - off, v, a, idle)
            lock = (COASTING if status != INITIALISING else status, 0.0, astray)
            return (motion, p, band, sensor, steps, convention, lock, sway, doubt, clock)
        half, calm = 0.5 * quantum, sway
        if count > 0.0:
            sway = follow_sway(sway, ahead, OUTLIER * (scatter + square), MEMORY)
        else:  # it moved away from a reading that was not believed
            sway = (mean_sway, 0.0, 0.0)
        noisy = noise > PLAIN * square
        if noisy and not starts:
            doubt = doubted_in_noise(doubt, off, v, quantum, noise, dt, period)
        if not noisy and change * stepped < 0.0 and -half < moved < half:
            mean_sway, _, _ = sway
            if mean_sway <= 0.0:
                # a reading that the next undoes: its noise is as unknown as an angle in its cell
                noise, noisy = square / 12.0, True
                sensor = with_noise(sensor, noise)
        # what an edge shows
        kind, worth, noise_is = NOTHING, (NOTHING, 0.0, half), PLAIN_EDGES
        if noisy:
            noise_is = FLICKER if moved * moved < noise < half * half else NOISY
        if (
            noise_is == FLICKER
        ):  # noise crosses an edge more often than the angle: no edge is a time
            worth = cell(off, quantum, p00, SIGMAS * math.sqrt(noise))
            kind, _, _ = worth
        # most readings are plainly no news: no edge, and none was expected
        elif ahead > half or ahead < -half or off > half or off < -half or 12.0 * p00 > square:
            edges = math.sqrt(noise)
            hold = SIGMAS * edges
            if known_input > 0.0 and change == 0.0:  # the cell is so much larger than a quantum
                hold += known_input
            worth = interval(off, ahead, quantum, p00, edges, hold)
            kind, _, _ = worth
        if kind != NOTHING:
            believed, (dx, dv, da), p, band, sensor = update(
                worth,
                (off, ahead),
                p,
                band,
                sensor,
                noise_is,
                idle,
                dt,
                design.laws,
                since >= RECENT,
            )
            idle = 0.0
            if not believed:
                if quantum != design.quantum and abs(change) > JUMP * (high - low):
                    # what moved before was residue, or this is a glitch: the next reading decides
                    smallest, candidate, shown, least, left, finer, _ = steps
                    steps = (smallest, candidate, shown, least, left, finer, change)
                    doubt = doubted(quantum, dt, period, 0.0, 0.0)
                motion = (measurement - off, v, a, idle)
                lock = (COASTING if status != INITIALISING else status, 0.0, astray)
                return (motion, p, band, sensor, steps, convention, lock, calm, doubt, clock)
            off -= dx
            v += dv
            a += da
            turn = (v + v) * dt
            if (turn > period or turn < -period) and period > 0.0:
                # faster than half a turn per sample: lock was lost
                return first_state(measurement, sensor, steps, convention, doubt, clock)
        if doubted_so_far and change != 0.0:
            doubt = settled(doubt, v, change, rested, dt, square, noise)
        if status != TRACKING:
            _, _, _, p11, _, _ = p
            count += 1.0
            if count >= CONFIRMED and p11 * dt * dt < square + 12.0 * noise:
                status, astray = TRACKING, 0.0
            lock = (status, count, astray)
        motion = (measurement - off, v, a, idle)
        return (motion, p, band, sensor, steps, convention, lock, sway, doubt, clock)

    return step


def _make_output(period: float, unwrap: float) -> Callable[..., tuple]:
    def output(
        state: tuple, coefficients: tuple, design: Design, measurement: float, known_input: float
    ) -> tuple:
        (x, v, a, _), _, _, sensor, _, convention, (status, _, _), _, _, _ = state
        _, _, _, _, _, _, _, since, _, _, _ = sensor
        if since > 0.0:
            most = fastest(sensor, known_input)
            v = most if v > most else -most if v < -most else v
        return (present(convention, x, period, unwrap), v, a, status)

    return output


def _make_stddev(period: float) -> Callable[..., tuple[float, float]]:
    def stddev(state: tuple, coefficients: tuple, design: Design) -> tuple[float, float]:
        (x, v, a, _), p, band, sensor, _, convention, _, _, doubt, _ = state
        p00, _, _, p11, _, _ = p
        _, _, _, up, down, _, _, squares = band
        quantum, noise, _, _, _, _, _, unchanged, _, _, _ = sensor
        reading, low, high, _, _ = convention
        of_doubt, _, _, age = doubt
        dt, _, _, _, _, _ = coefficients
        starting = 0.0 < age < RECENT
        floor = quantum * quantum / 12.0  # where in its count the encoder changes is not known
        if design.quantum == 0.0 and low == high:  # nothing moved: no quantum is known
            return math.inf, math.inf
        variance = p11 * (squares if squares > CALM else CALM)
        if p11 <= 0.0:
            variance, _, _, _ = doubted(quantum, dt, period, 0.0, 0.0)
        else:
            variance += of_doubt
        if up > 0.0 or down > 0.0:  # the cumulative sums doubt it: a motion may begin
            deviation = reading - x
            if deviation + deviation >= period or deviation + deviation < -period:
                deviation = wrap(deviation, period)
            rate = deviation / dt
            if starting or abs(rate) > abs(v):  # it may have begun in the last quarter of a sample
                variance += 16.0 * rate * rate
        if starting:
            variance += unseen(a, quantum, noise, dt, age)
        sigma = math.sqrt(variance)
        if unchanged > 0.0:
            most = fastest(sensor, 0.0)
            sigma = most if sigma > most else sigma
        return math.sqrt(p00 + floor if p00 > 0.0 else floor), sigma

    return stddev


def _make_resume(period: float) -> Callable[..., tuple]:
    def resume(state: tuple, coefficients: tuple, design: Design, measurement: float) -> tuple:
        (_, v, _, _), p, band, sensor, steps, convention, lock, _, doubt, clock = state
        _, _, _, p11, _, p22 = p
        density, _, _, _, _, _, _, squares = band
        quantum, noise, scatter, _, _, _, _, _, _, _, _ = sensor
        smallest, candidate, shown, least, left, finer, _ = steps
        status, _, astray = lock
        _, _, since, _ = doubt
        _, uneven, _, longest, apart = clock
        return (
            (measurement, v, 0.0, 0.0),
            (quantum * quantum / 12.0, 0.0, 0.0, p11, 0.0, p22),
            (density, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, squares),
            (quantum, noise, scatter, 0.0, 0.0, 0.0, 0.0, 0.0, math.inf, 0.0, 0.0),
            (smallest, candidate, shown, least, left, finer, 0.0),
            follow(convention, measurement, period),
            (COASTING if status == TRACKING else status, 0.0, astray),
            STEADY,
            (v * v, SETTLES, since, 0.0),
            (0.0, uneven, 0.0, longest, apart),
        )

    return resume


def _make_restart(period: float) -> Callable[..., tuple]:
    def restart(state: tuple, coefficients: tuple, design: Design, measurement: float) -> tuple:
        _, _, _, _, steps, convention, _, _, _, _ = state  # steps: what is known of the quantum
        quantum = quantum_of(steps, design.quantum)
        return first_state(
            measurement,
            begin_sensor(quantum if quantum > 0.0 else UNIT, BLUR),
            steps,
            follow(convention, measurement, period),
            START,
            UNKNOWN,
        )

    return restart


OBSERVER = Observer(
    name='edge_adaptive',
    summary='finds bandwidth and noise by itself: say how many counts the '
    'encoder has, or not even that',
    gains=Gains,
    build=build,
    reference='docs/observers/edge_adaptive.md: edges as times, truncated Gaussians, innovation '
    'correlation (Mehra 1970), cumulative sums (Page 1954)',
    gives_acceleration=lambda gains: True,
)
