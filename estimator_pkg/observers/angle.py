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
OUTSIDE = 0.125     # an innovation beyond this part of a turn is no noise: lock is doubted
LOST_AFTER = 0.5    # doubted for this long [s], the estimate counts as initialising again


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
    settle : time after which a start has settled [s].
    prepare : (design, dt) -> coefficients of the core.
    init : (measurement, design) -> state of the core.
    correct : (state, coefficients, measurement) -> (state, innovation [rad]).
    estimate : (state) -> (position, velocity, acceleration or nan).
    resume : (state, measurement) -> state with this position and the same speed.
    noise_gains : (state, coefficients) -> variances of position, velocity and innovation, each per
        unit variance of white measurement noise.
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


def variance_floor(quantum: float) -> float:
    """Variance of a uniform quantisation error [rad^2]."""
    return quantum * quantum / 12.0


def low_speed_bound(change: float, since: float, quantum: float, power: float) -> float:
    """The largest speed [rad/s] that a reading unchanged for `since` [s] allows; inf: no bound.

    A shaft turning faster would have changed the reading by now. Off where the noise is larger
    than a quantum, because then an unchanged reading says nothing. A stream that repeats every
    second sample is not slowed: its change spans two samples.
    """
    step = change if change > quantum else quantum
    if since <= 0.0 or step <= 0.0 or power > step * step:
        return math.inf
    return step / since


def around(core: AngleCore, gains: AngleGains, circle: Circle) -> Functions:
    """The contract's functions for an angle-only observer made of `core`."""
    prepare_core, init_core, correct = core.prepare, core.init, core.correct
    estimate, resume_core, noise_gains = core.estimate, core.resume, core.noise_gains

    def design() -> tuple:
        floor = variance_floor(gains.quantum)
        known = gains.noise * gains.noise + floor if gains.noise is not None else 0.0
        lock = OUTSIDE * circle.period if circle.period > 0.0 else math.inf
        return (core.design(), float(circle.period), float(circle.unwrap), float(gains.quantum),
                known, floor, core.settle, lock, float(gains.low_speed_bound))

    def prepare(design: tuple, dt: float) -> tuple:
        return (prepare_core(design[0], dt), dt)

    def init(measurement: float, design: tuple) -> tuple:
        return (init_core(measurement, design[0]), begin(measurement),
                0.0, 0.0,           # last change [rad], time since it [s]
                design[5], 1.0,     # power of the innovation [rad^2], samples it stands for
                0.0, 0.0, 0.0)      # time since lock was doubted [s], time in doubt [s], locked

    def step(state: tuple, coefficients: tuple, design: tuple, measurement: float,
             given: float) -> tuple:
        inner, convention, change, since, power, count, clear, astray, locked = state
        inner_coefficients, dt = coefficients
        inner, innovation = correct(inner, inner_coefficients, measurement)
        if measurement == convention[0]:
            since += dt
        else:
            change = abs(wrap(measurement - convention[0], design[1]))
            since = 0.0
            convention = follow(convention, measurement, design[1])
        size = abs(innovation)
        if size > design[7]:
            clear = 0.0
        else:
            clear += dt
            if locked > 0.0:
                if count < MEMORY:
                    count += 1.0
                power += (innovation * innovation - power) / count
            else:
                power += 0.25 * (innovation * innovation - power)
        if clear >= design[6]:
            if locked == 0.0:
                count = 4.0  # what the start has left in the average weighs four samples
            locked = 1.0
            astray = 0.0
        elif locked > 0.0:
            astray += dt
            if astray > LOST_AFTER:
                locked = 0.0
        return (inner, convention, change, since, power, count, clear, astray, locked)

    def output(state: tuple, coefficients: tuple, design: tuple, measurement: float,
               given: float) -> tuple:
        inner, convention, change, since, power, count, clear, astray, locked = state
        position, velocity, acceleration = estimate(inner)
        if since > 0.0 and design[8] > 0.0:
            bound = low_speed_bound(change, since, design[3], power)
            if velocity > bound:
                velocity = bound
            elif velocity < -bound:
                velocity = -bound
        if locked == 0.0:
            status = INITIALISING
        elif astray > 0.0:
            status = COASTING
        else:
            status = TRACKING
        return (present(convention, position, design[1], design[2]), velocity, acceleration,
                status)

    def stddev(state: tuple, coefficients: tuple, design: tuple) -> tuple[float, float]:
        inner, convention, change, since, power, count, clear, astray, locked = state
        of_position, of_velocity, of_innovation = noise_gains(inner, coefficients[0])
        variance = design[4]
        if variance == 0.0:
            variance = power / of_innovation
            if variance < design[5]:
                variance = design[5]
        sigma = math.sqrt(of_velocity * variance)
        if since > 0.0 and design[8] > 0.0:
            bound = low_speed_bound(change, since, design[3], power)
            if sigma > bound:
                sigma = bound
        return math.sqrt(of_position * variance), sigma

    def resume(state: tuple, coefficients: tuple, design: tuple, measurement: float) -> tuple:
        inner, convention, change, since, power, count, clear, astray, locked = state
        return (resume_core(inner, measurement), follow(convention, measurement, design[1]),
                0.0, 0.0, power, count, 0.0, coefficients[1], locked)

    return Functions(design, prepare, init, step, output, stddev, resume, core.limits,
                     core.group_delay)
