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
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from estimator_pkg.observers.angle.core import LOST_AFTER, OUTSIDE
from estimator_pkg.observers.angle.edge.bandwidth import STEADY, follow_sway
from estimator_pkg.observers.angle.edge.clock import (
    BELIEVED,
    EVEN,
    UNEVEN,
    UNKNOWN,
    elapsed,
    repeats,
    resumed,
    waiting,
)
from estimator_pkg.observers.angle.edge.constants import (
    CONFIRMED,
    FADE,
    MEMORY,
    PLAIN,
    RATIO,
    REPEATS,
    SIGMAS,
)
from estimator_pkg.observers.angle.edge.covariance import Covariance, predicted, swayed
from estimator_pkg.observers.angle.edge.interval import HELD, NOTHING, interval
from estimator_pkg.observers.angle.edge.past import make_again
from estimator_pkg.observers.angle.edge.preference import ALIKE, beside, informed, ratios
from estimator_pkg.observers.angle.edge.quantum import (
    FIRST_STEPS,
    JUMP,
    UNIT,
    misfit,
    quantum_of,
    search,
    shows_quantum,
    with_jump,
)
from estimator_pkg.observers.angle.edge.sensor import (
    OUTLIER,
    aged,
    begin_sensor,
    follow_sensor,
    with_noise,
)
from estimator_pkg.observers.angle.edge.sigma import fastest, make_stddev
from estimator_pkg.observers.angle.edge.start import (
    RECENT,
    RESTS,
    SETTLES,
    START,
    UNSURE,
    after_jump,
    doubted,
    doubted_in_noise,
    first_state,
    later,
    motion_began,
    overdue,
    rescaled,
    settled,
    stirred,
    straight_line,
)
from estimator_pkg.observers.angle.edge.update import update
from estimator_pkg.observers.circle import Circle, is_angle, is_next_count, wrap
from estimator_pkg.observers.contract import COASTING, INITIALISING, TRACKING, Functions, Observer
from estimator_pkg.observers.convention import begin, follow, present
from estimator_pkg.parameters import parameter

HASTY = 4.0  # first sample times: where the second is longer, the stamps of the first were wrong
# (status, samples since a start, a gap or a doubt, time [s] for which the readings were far off)
Lock = tuple[int, float, float]


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


class Design(NamedTuple):
    """What the gains imply whatever the sample time is."""

    quantum: float  # as given [rad]; 0: not known
    ratio: float  # density of the published filter, over that of the first; see `preference`
    of_angle: float  # variance of the published angle, over that of the first filter
    of_speed: float  # the same of the speed


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
    sensor = begin_sensor(design.quantum if design.quantum > 0.0 else UNIT)
    return first_state(measurement, sensor, FIRST_STEPS, begin(measurement), START, UNKNOWN)


def without_reading(state: tuple, coefficients: tuple, design: Design) -> tuple:
    """Return the state one sample later, predicted alone: the reading is an old one."""
    (x, v, a, idle), p, band, sensor, steps, convention, lock, sway, doubt, clock, other = state
    dt, half_square, kept, _, _, _ = coefficients
    density, _, _, _, _, _, _, _, _ = band
    motion = (x + v * dt + a * half_square, v + a * dt, kept * a, idle + dt)
    p = predicted(p, density, coefficients)
    if design.ratio != 1.0:
        other = beside(other, p, design.ratio * density, coefficients, 0.0, dt)
    clock = waiting(clock, dt)
    return (motion, p, band, sensor, steps, convention, lock, sway, doubt, clock, other)


def coasting(lock: Lock) -> Lock:
    """Return the lock after a reading that is not believed."""
    status, _, astray = lock
    return (COASTING if status != INITIALISING else status, 0.0, astray)


def settling(lock: Lock, p: Covariance, dt: float, floor: float) -> Lock:
    """Return the lock after one more believed reading of a start, a gap or a doubt.

    Parameters
    ----------
    floor : twelve times the variance of a reading [rad^2].
    """
    status, count, astray = lock
    _, _, _, p11, _, _ = p
    count += 1.0
    if count >= CONFIRMED and p11 * dt * dt < floor:
        return (TRACKING, count, 0.0)
    return (status, count, astray)


def why(state: tuple, design: Any) -> str:
    """Return what a person should know of the given quantum, or ''."""
    _, _, _, _, steps, _, _, _, _, _, _ = state
    return misfit(steps, design.quantum)


def build(gains: Gains, circle: Circle) -> Functions:
    """Return the functions at these gains.

    State: motion: (position [rad], velocity, acceleration, time since an informative reading [s]);
    covariance; band (see `bandwidth`); sensor (see `sensor`); steps (see `quantum`); convention;
    lock, see `Lock`; sway (see `bandwidth`); doubt (see `start`); clock (see `clock`); other (see
    `preference`).
    """
    period = float(circle.period)
    stddev, scaled = make_stddev(period)
    step = _make_step(period)
    return Functions(
        lambda: Design(float(gains.quantum), *ratios(RATIO[gains.prefer])),
        prepare,
        init,
        step,
        _make_output(period, float(circle.unwrap)),
        stddev,
        _make_resume(period),
        lambda dt: None,
        lambda dt: math.nan,
        is_angle,
        why=why,
        edges=True,
        restart=_make_restart(period),
        scaled=scaled,
        late=late,
        again=make_again(prepare, step, period),
        turns=True,
    )


def late(state: tuple) -> float:
    """Return by how much the last stamp is taken to be wrong [s]; 0: it is believed."""
    _, _, _, _, _, _, _, _, _, (lateness, _, _, _, _, _), _ = state
    return lateness


def _make_step(period: float) -> Callable[..., tuple]:
    half_turn = 0.5 * period if period > 0.0 else math.inf
    outside = OUTSIDE * period if period > 0.0 else math.inf

    def step(
        state: tuple, coefficients: tuple, design: Design, measurement: float, known_input: float
    ) -> tuple:
        motion, p, band, sensor, steps, convention, lock, sway, doubt, clock, other = state
        last, low, high, _, _ = convention
        dt, half_square, kept, _, _, _ = coefficients
        change = measurement - last
        if not -half_turn <= change < half_turn:
            change = wrap(change, period)
        # Residue: was the last step a glitch, or the first real one?
        unsure, to_settle, since, _, _, _ = doubt
        starting = to_settle > 0.0
        if starting:
            doubt = later(doubt, dt)
            _, _, _, _, _, _, jump = steps
            if jump * (change + 0.5 * jump) > 0.0:  # it lasts
                motion, p, band, sensor, steps, doubt = after_jump(
                    jump, last, dt, design.quantum, period
                )
                other = ALIKE
            elif jump != 0.0:  # a glitch
                change, steps = change + jump, with_jump(steps, 0.0)
            unsure, to_settle, since, _, _, _ = doubt
        x, v, a, idle = motion
        quantum, _, _, _, stepped, previous, size, rested, _, _, pace = sensor
        status, count, astray = lock
        _, uneven, held, _, evidence, _ = clock
        # Repeated readings
        if change == 0.0 and abs(v) * dt > REPEATS * quantum and repeats(state, dt):
            return without_reading(state, coefficients, design)
        passed = held + dt  # since the last reading that was used
        if held > 0.0 or evidence > 0.0:
            clock = resumed(clock, change, passed, pace, v)
        # Wrong stamps
        if uneven > 0.0 or dt > (1.0 + UNEVEN) * pace or dt < (1.0 - UNEVEN) * pace:
            taken, clock = elapsed(clock, dt, pace, change + last - x, motion, p, sensor)
            if taken != dt:
                dt, passed = taken, passed + taken - dt
                coefficients = prepare(design, dt)
                _, half_square, kept, _, _, _ = coefficients
        # Search for the quantum: in the readings as they came, without a correction
        first, counted = change != 0.0 and low == high, change + known_input
        if change != 0.0 and shows_quantum(steps, counted, size, rested, quantum):
            extent = abs(measurement) + abs(last)
            moved, steps, found = search(steps, counted, extent, design.quantum, sensor, first)
            if found != quantum:
                p, band, sensor = rescaled(p, band, sensor, found, first)
                quantum, other = found, ALIKE
            if not moved:  # residue: the reading before is used again
                measurement, change, first = last, 0.0, False
        # Noise and vibration
        believed_for = count if status == COASTING else math.inf
        sensor = follow_sensor(sensor, change, counted, passed, quantum, believed_for)
        if evidence > BELIEVED:
            sensor = aged(sensor, v)
        _, noise, scatter, _, _, _, _, _, _, _, _ = sensor
        convention = follow(convention, measurement, period)
        # A start: the second reading, the third where that came too soon, the second that moves on
        # after a rest, or the first that moves so early that it shows the quantum alone
        _, _, p02, p11, _, _ = p
        if (
            p11 == 0.0
            or (p02 == 0.0 == pace and dt > HASTY * previous > 0.0)
            or (starting and stepped * change > 0.0 and to_settle == UNSURE)
            or (first and design.quantum == 0.0 and rested <= CONFIRMED * dt)
        ):
            motion, p, band, sensor, doubt = straight_line(
                measurement, change, passed, sensor, period, band, doubt
            )
            lock = (status, count + 1.0, astray)
            return (motion, p, band, sensor, steps, convention, lock, STEADY, doubt, clock, ALIKE)
        # Prediction: a' = -a/FADE + w, v' = a, x' = v
        density, _, _, _, _, _, _, _, _ = band
        moved = v * dt + a * half_square
        ahead = change - moved
        if held > 0.0:  # and moved while the reading repeated
            ahead -= (v - 0.5 * a * held) * held
        off = measurement - x - moved
        if off + off >= period or off + off < -period:
            off = wrap(off, period)
        v += a * dt
        a *= kept
        idle += dt
        p = predicted(p, density, coefficients)
        square = quantum * quantum
        mean_sway, _, _ = sway
        swing = lasted = 0.0
        if mean_sway > 0.0:
            lasted = dt if dt > EVEN * pace else pace  # readings in bursts are not that near
            swing = mean_sway - square / 6.0 - 2.0 * noise
            p = swayed(p, swing, lasted)
        if design.ratio == 1.0:
            other = ALIKE
        else:
            other = beside(other, p, design.ratio * density, coefficients, swing, lasted)
        usual = pace if 0.0 < pace < dt else dt  # samples may have been lost
        if change != 0.0 and rested > MEMORY * usual:  # a rest ends: the speed is in doubt
            doubt, begins = stirred(doubt, sensor, p, rested, dt, first, period)
            starting = starting and not begins
        # An eighth of a turn off: no reading of this shaft, or not of this speed
        if (off > outside or off < -outside) and not is_next_count(off, quantum, period):
            astray += dt
            p00, _, _, _, _, _ = p
            if astray > LOST_AFTER or SIGMAS * SIGMAS * p00 > outside * outside:
                return first_state(measurement, sensor, steps, convention, doubt, clock)
            motion, lock = (measurement - off, v, a, idle), coasting((status, count, astray))
            return (motion, p, band, sensor, steps, convention, lock, sway, doubt, clock, other)
        # Sway, unless it moved away from a reading that was not believed
        before, sway = sway, follow_sway(sway, ahead, OUTLIER * (scatter + square), count > 0.0)
        # Noise that hides single edges
        p00, _, _, _, _, _ = p
        half, noisy = 0.5 * quantum, noise > PLAIN * square
        if noisy:
            doubt = doubted_in_noise(doubt, off, v, quantum, noise, dt, period)
        elif change * stepped < 0.0 and -half < moved < half:
            mean_sway, _, _ = sway
            if mean_sway <= 0.0:
                # a reading that the next undoes: its noise is as unknown as an angle in its cell
                noise, noisy = square / 12.0, True
                sensor = with_noise(sensor, noise)
        # What an edge shows; most readings are plainly no news: no edge, and none was expected
        flickers = noisy and moved * moved < noise < half * half
        inside = -half <= ahead <= half and -half <= off <= half
        if not inside or flickers or 12.0 * p00 > square:
            # the cell of an unchanged reading may reach further than a quantum; by a quarter of
            # what is known of that either end may be wrong
            further = known_input if change == 0.0 else 0.0
            deviations = (off + 0.5 * further, ahead, quantum + 1.5 * abs(further))
            centre, _, size = deviations
            news = interval(centre, ahead, size, p00, noise, flickers)
            kind, _, _ = news
            if kind != NOTHING:
                warm = since >= RECENT
                believed, shift, p, band, sensor, heard = update(
                    news, deviations, p, band, sensor, flickers, idle, dt, warm
                )
                idle = 0.0
                if not believed:
                    if quantum != design.quantum and abs(change) > JUMP * (high - low):
                        # what moved before was residue, or this is a glitch: the next reading
                        # decides
                        steps = with_jump(steps, change)
                        doubt = doubted(quantum, dt, period, 0.0, 0.0)
                    motion, lock = (measurement - off, v, a, idle), coasting(lock)
                    return (
                        motion,
                        p,
                        band,
                        sensor,
                        steps,
                        convention,
                        lock,
                        before,
                        doubt,
                        clock,
                        other,
                    )
                _, _, _, _, _, _, manoeuvre = heard
                if manoeuvre and RESTS * abs(v) < quantum:
                    doubt = motion_began(doubt, dt)
                dx, dv, da = shift
                if kind == HELD:
                    doubt = overdue(doubt, dv)
                off -= dx
                v += dv
                a += da
                if design.ratio != 1.0:
                    other = informed(other, heard, shift, design.ratio)
                if (v + v) * dt > period > 0.0 or (v + v) * dt < -period < 0.0:
                    # faster than half a turn per sample: lock was lost
                    return first_state(measurement, sensor, steps, convention, doubt, clock)
        if change != 0.0 and unsure > 0.0:
            doubt = overdue(doubt, 0.0)
        if starting and change != 0.0:
            doubt = settled(doubt, v, change, rested, dt, square, noise)
        if status != TRACKING:
            lock = settling(lock, p, dt, square + 12.0 * noise)
        motion = (measurement - off, v, a, idle)
        return (motion, p, band, sensor, steps, convention, lock, sway, doubt, clock, other)

    return step


def _make_output(period: float, unwrap: float) -> Callable[..., tuple]:
    def output(
        state: tuple, coefficients: tuple, design: Design, measurement: float, known_input: float
    ) -> tuple:
        (x, v, a, _), _, _, sensor, _, convention, (status, _, _), _, _, _, other = state
        dx, dv, da, _ = other
        x, v, a = x + dx, v + dv, a + da
        _, _, _, _, _, _, _, since, _, _, _ = sensor
        if since > 0.0:
            most = fastest(sensor, known_input)
            v = most if v > most else -most if v < -most else v
        return (present(convention, x, period, unwrap), v, a, status)

    return output


def _make_resume(period: float) -> Callable[..., tuple]:
    def resume(state: tuple, coefficients: tuple, design: Design, measurement: float) -> tuple:
        (_, v, _, _), p, band, sensor, steps, convention, lock, _, doubt, clock, _ = state
        _, _, _, p11, _, p22 = p
        density, _, _, _, _, _, _, squares, quiet = band
        quantum, noise, scatter, _, _, _, _, _, _, _, _ = sensor
        smallest, candidate, shown, least, left, finer, _ = steps
        status, _, astray = lock
        _, _, since, _, _, _ = doubt
        _, uneven, _, longest, evidence, _ = clock
        return (
            (measurement, v, 0.0, 0.0),
            (quantum * quantum / 12.0, 0.0, 0.0, p11, 0.0, p22),
            (density, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, squares, quiet),
            (quantum, noise, scatter, 0.0, 0.0, 0.0, 0.0, 0.0, math.inf, 0.0, 0.0),
            (smallest, candidate, shown, least, left, finer, 0.0),
            follow(convention, measurement, period),
            (COASTING if status == TRACKING else status, 0.0, astray),
            STEADY,
            (v * v, SETTLES, since, 0.0, 0.0, 0.0),
            (0.0, uneven, 0.0, longest, evidence, 0.0),
            ALIKE,
        )

    return resume


def _make_restart(period: float) -> Callable[..., tuple]:
    def restart(state: tuple, coefficients: tuple, design: Design, measurement: float) -> tuple:
        _, _, _, _, steps, convention, _, _, _, _, _ = state  # steps: what is known of the quantum
        quantum = quantum_of(steps, design.quantum)
        return first_state(
            measurement,
            begin_sensor(quantum if quantum > 0.0 else UNIT),
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
