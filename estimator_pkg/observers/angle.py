"""What every angle-only observer shares: noise, low-speed bound, status, convention.

An angle-only observer is a small core (a prediction and a correction by the wrapped innovation);
`around` puts the shared part around it and gives the `Functions` of the contract.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from estimator_pkg.observers.circle import Circle, wrap
from estimator_pkg.observers.contract import COASTING, INITIALISING, TRACKING, Functions
from estimator_pkg.observers.convention import begin, follow, present
from estimator_pkg.parameters import parameter

MEMORY = 400.0      # samples over which the innovation's power is averaged
RECENT = 32.0       # the same for the low-speed bound, which must soon know of a change
STILL = 8.0         # after so many equal readings the noise is surely less than a quantum
SURELY = 4.0        # standard deviations of noise that may have held a reading back
FRESH = 4.0         # samples that the power weighs when a start has settled
OUTSIDE = 0.125     # an innovation beyond this part of a turn is no noise: lock is doubted
LARGEST = 1e9       # beyond it [rad] a double does not tell 1e-7 rad apart: no reading, but garbage
CONFIRMED = 3.5     # a lock takes more samples than these
LOST_AFTER = 0.5    # in doubt, and off for this long [s] in all (never less than it takes to
                    # settle): the observer starts again


@dataclass(frozen=True)
class AngleGains:
    """The parameters that all angle-only observers share."""

    quantum: float = parameter(
        0.0, unit='rad', range=(0.0, 10.0), structural=False,
        description='smallest step of the measurement (2 pi / counts); 0: not known')
    noise: float | None = parameter(
        None, unit='rad', range=(1e-12, 10.0),
        description='standard deviation of the measurement noise, quantisation apart; '
                    'unset: estimated from the innovation')
    low_speed_bound: bool = parameter(
        True, unit='', description='hold |velocity| below (last change) / (time since it), '
                                   'on the output only')


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


def _watch(lock: tuple[int, float, float, float], size: float, outside: float, dt: float,
           settle: float, lost: float) -> tuple[int, float, float, float]:
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


def around(core: AngleCore, gains: AngleGains, circle: Circle) -> Functions:
    """The contract's functions for an angle-only observer made of `core`.

    State: core's state; convention; reading: (size of its last change [rad], time since it [s],
    smallest change seen [rad], recent power of the innovation [rad^2]); (power of the innovation
    [rad^2], samples it stands for); lock: (status, time since the last doubt [s], time
    it was off since the lock was in doubt [s], speed before the doubt [rad/s], 0 at a start).

    A core that was astray for too long starts again. So does one whose lock returned at another
    speed: every speed + n 2 pi/dt fits the samples as well, and a shaft does not change by half of
    that while the lock is in doubt; nor does a start know of more than pi/dt.
    """
    prepare_core, init_core, correct = core.prepare, core.init, core.correct
    estimate, resume_core, noise_gains = core.estimate, core.resume, core.noise_gains
    restarts = core.restarts
    half = 0.5 * circle.period if circle.period > 0.0 else math.inf

    def design() -> tuple:
        floor = variance_floor(gains.quantum)
        known = gains.noise * gains.noise + floor if gains.noise is not None else 0.0
        outside = OUTSIDE * circle.period if circle.period > 0.0 else math.inf
        return (core.design(), float(circle.period), float(circle.unwrap), float(gains.quantum),
                known, floor, float(core.settle), outside, float(gains.low_speed_bound),
                max(LOST_AFTER, float(core.settle)))

    def prepare(design: tuple, dt: float) -> tuple:
        return (prepare_core(design[0], dt), dt)

    def init(measurement: float, design: tuple) -> tuple:
        return (init_core(measurement, design[0]), begin(measurement), (0.0, 0.0, 0.0, design[5]),
                (design[5], 1.0), (INITIALISING, 0.0, 0.0, 0.0))

    def step(state: tuple, coefficients: tuple, design: tuple, measurement: float,
             given: float) -> tuple:
        inner, convention, reading, (power, count), lock = state
        inner, innovation = correct(inner, coefficients[0], measurement)
        square = innovation * innovation
        size = abs(innovation)
        outside = design[7]
        recent = reading[3]
        if size <= outside:
            recent += (square - recent) / RECENT
        if measurement == convention[0]:
            reading = (reading[0], reading[1] + coefficients[1], reading[2], recent)
        else:
            change = abs(wrap(measurement - convention[0], design[1]))
            smallest = reading[2]
            if 0.0 < change < smallest or smallest == 0.0:
                smallest = change
            reading = (change, 0.0, smallest, recent)
            convention = follow(convention, measurement, design[1])
        if lock[0] == TRACKING and size <= outside:
            if count < MEMORY:
                count += 1.0
            return (inner, convention, reading, (power + (square - power) / count, count), lock)
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
        return (inner, convention, reading, (power, count), lock)

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

    def output(state: tuple, coefficients: tuple, design: tuple, measurement: float,
               given: float) -> tuple:
        position, velocity, acceleration = estimate(state[0])
        if state[2][1] > 0.0 and design[8] > 0.0:
            velocity = bounded(state, coefficients, design, velocity)
        return (present(state[1], position, design[1], design[2]), velocity, acceleration,
                state[4][0])

    def stddev(state: tuple, coefficients: tuple, design: tuple) -> tuple[float, float]:
        of_position, of_velocity, of_innovation = noise_gains(state[0], coefficients[0])
        variance = design[4]
        if variance == 0.0:
            variance = state[3][0] / of_innovation
            if variance < design[5]:
                variance = design[5]
        sigma = math.sqrt(of_velocity * variance)
        if state[2][1] > 0.0 and design[8] > 0.0:
            sigma = bounded(state, coefficients, design, sigma)
        return math.sqrt(of_position * variance), sigma

    def resume(state: tuple, coefficients: tuple, design: tuple, measurement: float) -> tuple:
        inner, convention, reading, power, lock = state
        if lock[0] == TRACKING:
            lock = (COASTING, 0.0, 0.0, estimate(inner)[1])
        else:
            lock = (lock[0], 0.0, lock[2], lock[3])
        return (resume_core(inner, measurement), follow(convention, measurement, design[1]),
                (0.0, 0.0, reading[2], reading[3]), power, lock)

    def restart(state: tuple, coefficients: tuple, design: tuple, measurement: float) -> tuple:
        fresh = init(measurement, design)
        return (fresh[0], follow(state[1], measurement, design[1]), fresh[2], fresh[3], fresh[4])

    return Functions(design, prepare, init, step, output, stddev, resume, core.limits,
                     core.group_delay, is_angle, restart=restart)
