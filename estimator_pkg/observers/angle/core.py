"""What every angle-only observer shares: noise, low-speed bound, status, convention.

An angle-only observer is a small core (a prediction and a correction by the wrapped innovation);
`around` puts the shared part around it and gives the `Functions` of the contract.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from estimator_pkg.observers.angle.late_stamps import (
    BEYOND,
    begin_clock,
    follow_clock,
    make_retake,
)
from estimator_pkg.observers.circle import Circle, wrap
from estimator_pkg.observers.contract import COASTING, INITIALISING, TRACKING, Functions
from estimator_pkg.observers.convention import begin, follow, present
from estimator_pkg.parameters import parameter

MEMORY = 400.0  # samples over which the innovation's power is averaged
RECENT = 32.0  # the same for the low-speed bound, which must soon know of a change
STILL = 8.0  # after so many equal readings the noise is surely less than a quantum
SURELY = 4.0  # standard deviations of noise that may have held a reading back
FRESH = 4.0  # samples that the power weighs when a start has settled
OUTSIDE = 0.125  # an innovation beyond this part of a turn is no noise: lock is doubted
LARGEST = 1e9  # beyond it [rad] a double does not tell 1e-7 rad apart: no reading, but garbage
CONFIRMED = 3.5  # a lock takes more samples than these
RESTED = 0.12  # [s] within the noise of one angle: the shaft rests, and may start
START = 0.25  # [s] that a start lasts at least, ...
DECAYED = 10.0  # ... and until the errors of the core have decayed by so many nepers
PACE = 0.8  # of the cube root of (velocity noise gain)/dt: the pace of a tracking loop
LAG_3 = 0.2  # a fifth of what a ramp's begin or end errs by, in acceleration/pace: order 3
LAG_2 = 0.36  # the same of order 2, which lags throughout
TAIL = 1.18  # of these nepers, where the polynomial before the exponential is generous
LEARNT = 6.0  # nepers after which innovations of a start speak of noise again
ENOUGH = 8.0  # changed readings after which a start has shown its noise
SHORT = 32.0  # samples over which they are averaged until the start is over
BEGUN = 0.75  # sample times by which motion may have begun after the last reading at rest
BAND = 10.0  # (3.2)^2: times the power of the innovations, off by more is no rest
LARGEST_GAIN = 8.0  # of innovations over readings, in noise power, but for a few first samples
SLOW = 0.125  # a joint at rest does not leave the noise in this part of the rest's time
UNBOUNDED = 1e200  # a noise gain beyond it: no gap, but a sample time too long for the core
GAP = 0.2  # [s] a gap is at least so long
RESIDUE = 1e-9  # [rad] a smaller step is rounding, no quantum
COARSEST = 2.0**-23  # resolution of a float32, of its value: a reading is no finer than known
FINEST = 2.0**-52  # the same of a double
LOST_AFTER = 0.5  # in doubt, and off for this long [s] in all (never less than it takes to
# settle): the observer starts again


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
        description='standard deviation of the measurement noise, quantisation apart; '
        'automatic: estimated from the innovation',
    )
    low_speed_bound: bool = parameter(
        True,
        unit='',
        description='hold |velocity| below (last change) / (time since it), on the output only',
    )


@dataclass(frozen=True)
class AngleCore:
    """The part that differs between angle-only observers. All but `design` compile.

    design : () -> design of the core (a tuple of floats).
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
    restarts : False where the core must be left alone whatever becomes of its lock.
    pace : (state, coefficients, dt) -> how fast errors of a start decay [1/s]; None: that of a
        linear loop, see `linear_pace`.
    lag : standard deviation of the velocity error at the begin and the end of a ramp of speed, in
        acceleration/pace: a fifth of the error itself, so that five cover it.
    """

    design: Callable[[], tuple]
    settle: float
    prepare: Callable[[tuple, float], tuple]
    init: Callable[[float, tuple], tuple]
    correct: Callable[[tuple, tuple, float], tuple]
    estimate: Callable[[tuple], tuple[float, float, float]]
    resume: Callable[[tuple, float], tuple]
    noise_gains: Callable[[tuple, tuple], tuple[float, float, float]]
    limits: Callable[[float], str | None]
    group_delay: Callable[[float], float]
    restarts: bool = True
    pace: Callable[[tuple, tuple, float], float] | None = None
    lag: float = LAG_3


def is_angle(measurement: float) -> bool:
    """False for NaN, infinities and numbers that no encoder gives [rad or m]."""
    return -LARGEST < measurement < LARGEST


def variance_floor(quantum: float) -> float:
    """Variance of a uniform quantisation error [rad^2]."""
    return quantum * quantum / 12.0


def low_speed_bound(change: float, since: float, quantum: float, variance: float) -> float:
    """The largest speed [rad/s] that a reading unchanged for `since` [s] allows; inf: no bound.

    A shaft turning faster would have changed the reading by now, unless noise held it back: so much
    is added. Off where the noise is larger than a quantum, because then an unchanged reading says
    nothing. A stream that repeats every second sample is not slowed while it is not recognised yet:
    its change spans two samples.

    Parameters
    ----------
    change : size of the last change of the reading [rad].
    quantum : smallest step of the reading [rad]; 0: none is known, and there is no bound.
    variance : of the measurement noise, quantisation apart [rad^2].
    """
    if since <= 0.0 or quantum <= 0.0 or variance > quantum * quantum:
        return math.inf
    return ((change if change > quantum else quantum) + SURELY * math.sqrt(variance)) / since


def _watch(
    lock: tuple[int, float, float, float],
    size: float,
    outside: float,
    dt: float,
    settle: float,
    lost: float,
) -> tuple[int, float, float, float]:
    """The lock after one sample; what `around` says of its four fields holds.

    An innovation of this `size` [rad] beyond `outside` [rad] throws doubt on the lock; `settle` [s]
    and four samples without another one restore it. Off for longer than `lost` [s], it is lost.
    """
    status, clear, astray, trusted = lock
    if size == math.inf:
        return (INITIALISING, 0.0, 0.0, 0.0)
    if size > outside:
        astray += dt
        if astray > lost:
            return (INITIALISING, 0.0, astray, 0.0)
        return (COASTING if status != INITIALISING else INITIALISING, 0.0, astray, trusted)
    clear += dt
    if clear >= settle and clear > CONFIRMED * dt:
        return (TRACKING, clear, 0.0, trusted)
    return (status, clear, astray, trusted)


def linear_pace(
    noise_gains: Callable[[tuple, tuple], tuple[float, float, float]],
) -> Callable[[tuple, tuple, float], float]:
    """How fast the errors of a tracking loop decay [1/s], from what it makes of noise.

    A loop whose poles are all at w lets through a velocity variance of 1/4 (order 2) to 7/4 (order
    3) of w^3 dt per unit variance of white noise.
    """

    def pace(inner: tuple, coefficients: tuple, dt: float) -> float:
        return PACE * (noise_gains(inner, coefficients)[1] / dt) ** (1.0 / 3.0)

    return pace


def around(core: AngleCore, gains: AngleGains, circle: Circle) -> Functions:
    """The contract's functions for an angle-only observer made of `core`.

    State: core's state; convention; reading: (size of its last change [rad], time since it [s],
    smallest change seen [rad], recent power of the innovation [rad^2]); noise: (power of the
    innovation [rad^2], samples it stands for); lock: (status, time since the last doubt [s], time
    it was off since the lock was in doubt [s], speed before the doubt [rad/s], 0 at a start);
    start: (clock [s], anchor: angle of the rest before [rad], nepers by which the core's errors
    decayed since then, angle travelled [rad], speed that was kept across a gap [rad/s]); stamps
    (see `late_stamps`).

    A start is the time after a shaft at rest began to move, or after a gap. The core still carries
    the old speed, so it errs by more than noise explains until its errors have decayed. `unsettled`
    is what this adds to the standard deviation; docs/coverage.md derives it. The clock is the time
    since the motion began while a start is in force, 0 in motion, and below 0 while the readings
    stay within the noise of one angle: minus the time at rest until the last change.

    A core that was astray for too long starts again. So does one whose lock returned at another
    speed: every speed + n 2 pi/dt fits the samples as well, and a shaft does not change by half of
    that while the lock is in doubt; nor does a start know of more than pi/dt.
    """
    prepare_core, init_core, correct = core.prepare, core.init, core.correct
    estimate, resume_core, noise_gains = core.estimate, core.resume, core.noise_gains
    restarts = core.restarts
    pace = core.pace if core.pace is not None else linear_pace(noise_gains)
    bent = 2.0 * core.lag
    half = 0.5 * circle.period if circle.period > 0.0 else math.inf
    period = float(circle.period)

    def design() -> tuple:
        floor = variance_floor(gains.quantum)
        known = gains.noise * gains.noise + floor if gains.noise is not None else 0.0
        outside = OUTSIDE * circle.period if circle.period > 0.0 else math.inf
        return (
            core.design(),
            float(circle.period),
            float(circle.unwrap),
            float(gains.quantum),
            known,
            floor,
            float(core.settle),
            outside,
            float(gains.low_speed_bound),
            max(LOST_AFTER, float(core.settle)),
        )

    def prepare(design: tuple, dt: float) -> tuple:
        return (prepare_core(design[0], dt), dt)

    def init(measurement: float, design: tuple) -> tuple:
        inner = init_core(measurement, design[0])
        return (
            inner,
            begin(measurement),
            (0.0, 0.0, 0.0, design[5]),
            (design[5], 1.0),
            (INITIALISING, 0.0, 0.0, 0.0),
            (-RESTED, measurement, 0.0, 0.0, 0.0),
            begin_clock(inner),
        )

    retake = make_retake(prepare, correct)

    def step(
        state: tuple, coefficients: tuple, design: tuple, measurement: float, given: float
    ) -> tuple:
        (
            inner,
            convention,
            (change, since, smallest, recent),
            (power, count),
            lock,
            start,
            stamps,
        ) = state
        before, clock = recent, start[0]
        inner, innovation = correct(inner, coefficients[0], measurement)
        if coefficients[1] != stamps[0] or stamps[1] != 0.0:
            if stamps[2] == 0.0 and innovation * innovation <= BEYOND * recent:
                stamps = follow_clock(stamps, coefficients[1])
            else:
                inner, innovation, coefficients, stamps = retake(
                    stamps,
                    recent if lock[0] != INITIALISING else math.inf,
                    state[0],
                    design,
                    measurement,
                    inner,
                    innovation,
                    coefficients,
                )
        square = innovation * innovation
        size = abs(innovation)
        outside = design[7]
        if size <= outside:
            recent += (square - recent) / RECENT
        if measurement == convention[0]:
            reading = (change, since + coefficients[1], smallest, recent)
            if clock > 0.0:
                start = started(start, 0.0, since, before, coefficients, inner)
        else:
            moved = measurement - convention[0]
            if not -half <= moved < half:
                moved = wrap(moved, period)
            if clock > 0.0:
                start = started(start, moved, 0.0, before, coefficients, inner)
            elif clock < 0.0 or since >= RESTED or moved * moved <= BAND * before:
                start = resting(start, measurement, moved, since, before, coefficients, inner)
            change = abs(moved)
            if 0.0 < change < smallest or smallest == 0.0:
                smallest = change
            reading = (change, 0.0, smallest, recent)
            convention = follow(convention, measurement, period)
        if lock[0] == TRACKING and size <= outside:
            if start[0] > 0.0:
                if start[2] < LEARNT:
                    return (inner, convention, reading, (power, count), lock, start, stamps)
                if state[5][2] < LEARNT:
                    count = ENOUGH
                if reading[1] > 0.0:
                    count = max(ENOUGH, 0.75 * count)  # coarse: the readings show no noise
                elif count < SHORT:
                    count += 1.0
            elif count < MEMORY:
                count += 1.0
            return (
                inner,
                convention,
                reading,
                (power + (square - power) / count, count),
                lock,
                start,
                stamps,
            )
        if lock[0] == INITIALISING:
            if size <= outside:
                power += (square - power) / FRESH
            count = FRESH
        elif lock[0] == TRACKING:
            lock = (TRACKING, 0.0, 0.0, estimate(state[0])[1])
        lock = _watch(lock, size, outside, coefficients[1], design[6], design[9])
        if restarts:
            lost = lock[2] > design[9]
            if lock[0] == TRACKING:
                lost = abs(estimate(inner)[1] - lock[3]) * coefficients[1] > half
            if lost:
                inner = init_core(measurement, design[0])
                lock = (INITIALISING, 0.0, 0.0, 0.0)
        return (inner, convention, reading, (power, count), lock, start, stamps)

    def resting(
        start: tuple,
        measurement: float,
        moved: float,
        since: float,
        power: float,
        coefficients: tuple,
        inner: tuple,
    ) -> tuple:
        """The start after a reading that `moved` [rad], `since` [s] unchanged; none is in force.

        power : recent one of the innovations [rad^2]; BAND times it is the noise of a rest.
        """
        clock, anchor, _, _, _ = start
        if clock == 0.0:
            anchor = measurement - moved
        off = measurement - anchor
        if not -half <= off < half:
            off = wrap(off, period)
        square, band, rested = off * off, BAND * power, since - clock
        if rested < RESTED:
            if square > band:
                return (0.0, measurement, 0.0, 0.0, 0.0)
        # of noise alone the innovations have more power than the readings
        elif (
            LARGEST_GAIN * square > band and square * noise_gains(inner, coefficients[0])[2] > band
        ):
            return (coefficients[1], anchor, 0.0, off, 0.0)
        return (-rested - coefficients[1], anchor + off / RECENT, 0.0, 0.0, 0.0)

    def started(
        start: tuple, moved: float, since: float, power: float, coefficients: tuple, inner: tuple
    ) -> tuple:
        """As `resting`, while a start is in force. It is over when it is old and its errors have
        decayed, when the shaft rests again, and when it only swayed.
        """
        clock, anchor, decay, travelled, kept = start
        if moved != 0.0:
            travelled += moved
            square, band = travelled * travelled, BAND * power
            if kept == 0.0 and square <= band:  # back where it was ...
                pushed = SLOW * RESTED * estimate(inner)[1]
                if decay < 1.0 or pushed * pushed <= band:  # ... and slow: it rests still
                    return (-RESTED, anchor, 0.0, 0.0, 0.0)
        elif since >= RESTED and decay >= LEARNT:
            return (0.0, anchor, 0.0, 0.0, 0.0)
        dt = coefficients[1]
        clock += dt
        decay += pace(inner, coefficients[0], dt) * dt
        if clock >= START and decay >= DECAYED:
            return (0.0, anchor, 0.0, 0.0, 0.0)
        return (clock, anchor, decay, travelled, kept)

    def unsettled(state: tuple, dt: float) -> float:
        """Standard deviation of the speed that a start adds [rad/s]: equations (1) and (2) of
        docs/coverage.md.
        """
        clock, _, decay, travelled, kept = state[5]
        mean = travelled / (clock - BEGUN * dt)
        scale = 2.0 * abs(mean)
        if kept > scale:
            scale = kept
        left = 0.5 * scale * (1.0 + decay * (1.0 + decay)) * math.exp(-TAIL * decay)
        bend = bent * abs(estimate(state[0])[1] - mean)
        if decay > 1.0:
            bend /= decay
        return math.sqrt(left * left + bend * bend)

    def bounded(state: tuple, coefficients: tuple, design: tuple, value: float) -> float:
        """`value` [rad/s] held within the low-speed bound."""
        change, since, smallest, recent = state[2]
        if abs(value) * since <= change:
            return value
        quantum = design[3] if design[3] > 0.0 else smallest
        if design[4] > 0.0:
            variance = design[4] - design[5]
        elif since > STILL * coefficients[1]:
            variance = 0.0
        else:
            variance = recent / noise_gains(state[0], coefficients[0])[2] - variance_floor(quantum)
            variance = variance if variance > 0.0 else 0.0
        bound = low_speed_bound(change, since, quantum, variance)
        return bound if value > bound else -bound if value < -bound else value

    def output(
        state: tuple, coefficients: tuple, design: tuple, measurement: float, given: float
    ) -> tuple:
        position, velocity, acceleration = estimate(state[0])
        if state[2][1] > 0.0 and design[8] > 0.0:
            velocity = bounded(state, coefficients, design, velocity)
        return (
            present(state[1], position, design[1], design[2]),
            velocity,
            acceleration,
            state[4][0],
        )

    def stddev(state: tuple, coefficients: tuple, design: tuple) -> tuple[float, float]:
        if state[6][1] != 0.0:
            coefficients = prepare(design, state[6][1])
        of_position, of_velocity, of_innovation = noise_gains(state[0], coefficients[0])
        reading = state[2]
        variance = design[4]
        if variance == 0.0:
            variance = state[3][0] / of_innovation
            if variance < design[5]:
                variance = design[5]
            elif design[5] == 0.0:
                least = reading[2] * reading[2] / MEMORY
                if reading[2] == 0.0:
                    least = variance_floor(COARSEST * (1.0 + abs(state[1][0])))
                elif state[5][0] > 0.0 and (state[5][2] < LEARNT or state[3][1] < 2.0 * ENOUGH):
                    least = variance_floor(reading[2] if reading[2] > RESIDUE else reading[0])
                elif reading[1] <= STILL * coefficients[1]:
                    least = variance_floor(FINEST * (reading[2] + abs(state[1][0])))
                if variance < least:
                    variance = least
        of_position *= variance
        of_velocity *= variance
        if state[5][0] > 0.0:
            of_position += reading[3]
            of_velocity += unsettled(state, coefficients[1]) ** 2
        sigma = math.sqrt(of_velocity)
        if reading[1] > 0.0 and design[8] > 0.0:
            sigma = bounded(state, coefficients, design, sigma)
        return math.sqrt(of_position), sigma

    def resume(state: tuple, coefficients: tuple, design: tuple, measurement: float) -> tuple:
        inner, convention, reading, power, lock, start, stamps = state
        speed = estimate(inner)[1]
        if lock[0] == TRACKING:
            lock = (COASTING, 0.0, 0.0, speed)
        else:
            lock = (lock[0], 0.0, lock[2], lock[3])
        moved = wrap(measurement - convention[0], design[1])
        if noise_gains(inner, coefficients[0])[1] < UNBOUNDED:
            start = (coefficients[1], measurement, 0.0, 0.0, abs(speed) + abs(moved) / GAP)
        return (
            resume_core(inner, measurement),
            follow(convention, measurement, design[1]),
            (0.0, 0.0, reading[2], reading[3]),
            power,
            lock,
            start,
            (stamps[0], 0.0, 0.0, stamps[3]),
        )

    def restart(state: tuple, coefficients: tuple, design: tuple, measurement: float) -> tuple:
        fresh = init(measurement, design)
        return (fresh[0], follow(state[1], measurement, design[1]), *fresh[2:])

    return Functions(
        design,
        prepare,
        init,
        step,
        output,
        stddev,
        resume,
        core.limits,
        core.group_delay,
        is_angle,
        restart=restart,
    )
