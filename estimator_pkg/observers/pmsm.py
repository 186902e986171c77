"""Sensorless speed, angle and flux of a permanent-magnet motor (Bosso, Azzollini, Tilli, 2020).

A sample is (i_alpha, i_beta, u_alpha, u_beta): the current at the stamp and the mean voltage over
the interval that ends at it. The robust form adds to the paper what a drive needs: it waits while
the rotor is not observable, and finds it again from the direction and the turning of the back-EMF.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from estimator_pkg.models.motor import POWER_INVARIANT, check_motor
from estimator_pkg.observers.circle import Circle, wrap
from estimator_pkg.observers.contract import (
    INITIALISING,
    NOT_OBSERVABLE,
    TRACKING,
    Observer,
)
from estimator_pkg.observers.drive import DriveFunctions, Sample, finite
from estimator_pkg.observers.pmsm_equations import (
    aligned,
    emf,
    flux_linkage,
    reflect,
    rotor_angle,
    wants_reflection,
)
from estimator_pkg.observers.pmsm_gains import EMF_SPEED, NOISE_GUESS, Gains, flux_range, tuning
from estimator_pkg.observers.pmsm_identifier import credible, empty_registers, shift, solve
from estimator_pkg.observers.pmsm_noise import deviations, low_pass_weight, prepare_noise
from estimator_pkg.observers.pmsm_scheme import advance, prepare_scheme, turned_emf
from estimator_pkg.observers.pmsm_watch import (
    BLIND,
    LEAVES,
    LOW_EMF,
    RESET,
    SEARCHING,
    begin_watch,
    least_emf,
    look,
)

CHORD = 0.3         # gates of the identifier, see `credible`
REST = 0.25
FAST = 1e-3         # s, averages of the back-EMF
SLOW = 5e-3         # s, averages of speeds; also how long the turning is watched before locking on
NOISE_MEMORY = 0.03  # s, average of the innovation's power
SPEED_CLIP = 2e4    # rad/s, electrical: a back-EMF that turns faster is noise

TURN = 2.0 * math.pi


class Design(NamedTuple):
    """What the gains imply whatever the sample time is; SI, amplitude-invariant."""

    k_p: float
    k_i: float
    k_eta: float
    gamma: float
    resistance: float
    inductance: float
    epsilon: float
    clock_rate: float
    threshold: float       # of (26) [1/Wb]
    xi_low: float          # range of |xi| to believe [1/Wb]
    xi_high: float
    flux_low: float
    flux_high: float
    emf_min: float
    drop: float            # resistance by which the current may falsify the back-EMF [ohm]
    xi_start: float        # 0: unknown
    pole_pairs: float
    hold: float
    pole: float            # of the low-pass on the speed [1/s]
    noise_power: float     # of each current [A^2]; 0: to be estimated
    noise_guess: float
    period: float          # of the published position [rad]; 0: none
    second_period: float


class Coefficients(NamedTuple):
    """What the sample time implies: scheme X, noise gains, and weights of the averages."""

    scheme: tuple
    noise: tuple
    window: float          # s over which the turning is watched
    weights: tuple         # of the newest sample: back-EMF, speeds, power of the innovation
    smoothing: float       # the same of the speed output
    known: float           # power of the innovation where the noise is given, else 0 [A^2]


class State(NamedTuple):
    """The observer between two samples.

    core : i, h, z, xi_hat, the last current, y.
    clock : integral of y since the tick, clock, length of this period, ticks counted.
    registers : of the identifier.
    watch : see `pmsm_watch`.
    out : speed output [rad/s] and travelled angle [rad], electrical.
    clear : how long [s] and how far [rad] y has turned since it is large enough.
    voltages : reported of late, newest last.
    """

    core: tuple
    clock: tuple
    registers: tuple
    watch: tuple
    out: tuple
    clear: tuple
    voltages: tuple


def build(gains: Gains, circle: Circle) -> DriveFunctions:
    """The functions of the sensorless observer at these gains.

    Inside, `design` is a `Design`, `coefficients` are `Coefficients` and `state` is a `State`.
    """
    resistance, inductance, nominal, poles = check_motor(gains, 'pmsm')
    tuned = tuning(gains)
    robust = gains.form == 'robust'
    resets = gains.variant != 'continuous'
    identifies = gains.variant == 'identifier'
    count = gains.periods
    scale = 1.0 / POWER_INVARIANT if gains.scaling == 'power' else 1.0
    late = math.floor(gains.voltage_delay)
    part = gains.voltage_delay - late
    kept = late + 1 if part > 0.0 else late
    blank_registers = empty_registers(count)
    no_voltages = (complex(0.0, 0.0),) * (kept + 1)
    dead = -10.0 * tuned.epsilon  # s, until the back-EMF has forgotten where it started

    def design() -> Design:
        low, high = flux_range(gains)
        start = nominal if gains.initial_flux is None else gains.initial_flux
        least = nominal * EMF_SPEED if gains.emf_min is None else gains.emf_min
        return Design(
            k_p=tuned.k_p, k_i=tuned.k_i, k_eta=tuned.k_eta, gamma=tuned.gamma,
            resistance=resistance, inductance=inductance, epsilon=tuned.epsilon,
            clock_rate=gains.clock_rate, threshold=4.0 * math.sqrt(tuned.gamma),
            xi_low=1.0 / high, xi_high=1.0 / low, flux_low=low, flux_high=high, emf_min=least,
            drop=2.0 * gains.resistance_error * resistance,
            xi_start=1.0 / start if start > 0.0 else 0.0, pole_pairs=poles, hold=gains.hold,
            pole=2.0 * math.pi * gains.speed_filter_hz,
            noise_power=(gains.current_noise or 0.0) ** 2,
            noise_guess=(NOISE_GUESS * nominal / inductance) ** 2,
            period=0.0 if circle.unwrap else float(circle.period),
            second_period=gains.second_period)

    def prepare(design: Any, dt: float) -> Coefficients:
        scheme = prepare_scheme(design.resistance, design.inductance, design.k_p, design.k_i, dt)
        noise = prepare_noise(design.resistance, design.inductance, design.k_p, design.k_i, scheme)
        fast = max(FAST, 5.0 * design.epsilon)
        slow = max(SLOW, 5.0 * fast)
        weights = (low_pass_weight(1.0 / fast, dt), low_pass_weight(1.0 / slow, dt),
                   low_pass_weight(1.0 / NOISE_MEMORY, dt))
        return Coefficients(scheme, noise, slow, weights, low_pass_weight(design.pole, dt),
                            design.noise_power * noise[1])

    def take(measurement: Sample) -> tuple[complex, complex]:
        """Current and voltage as amplitude-invariant vectors."""
        i_alpha, i_beta, u_alpha, u_beta = measurement
        if scale != 1.0:
            return (complex(i_alpha * scale, i_beta * scale),
                    complex(u_alpha * scale, u_beta * scale))
        return complex(i_alpha, i_beta), complex(u_alpha, u_beta)

    def init(measurement: Sample, design: Any) -> State:
        current, voltage = take(measurement)
        zero = complex(0.0, 0.0)
        return State((current, zero, complex(1.0, 0.0), design.xi_start, current, zero),
                     (zero, 0.0, 1.0, 0), blank_registers, begin_watch(design.noise_guess),
                     (0.0, 0.0), (dead, 0.0), no_voltages)

    def tick(i: complex, h: complex, z: complex, x: float, integral: complex, ticks: int,
             registers: tuple, least: float, design: Any) -> tuple:
        """A tick of the clock: the identifier, then the reset of the frame."""
        event = 0
        if identifies:
            size = abs(h)
            registers = shift(registers, emf(h, z), size, integral)
            ticks += 1
            if ticks > count + 1:
                found, travelled, rest, total = solve(registers)
                if abs(x - found) > design.threshold and (not robust or credible(
                        registers, found, travelled, rest, total, CHORD, REST, design.xi_low,
                        design.xi_high, least)):
                    x = found
                    event = RESET
                    if robust:  # a sound flux and a sound direction: begin aligned
                        i, h, z = aligned(i, h, z, h)
        if resets and wants_reflection(h):
            i, h, z = reflect(i, h, z)
            event = RESET
        return i, h, z, x, registers, ticks, event

    def lock_on(core: tuple, watch: tuple, turned: float, design: Any) -> tuple:
        """(i, h, z, x, watch): the frame on the back-EMF as averaged, xi signed as it turned."""
        i, h, z, x = core
        level, mean_h, rate, slip, power, idle, calm, reasons = watch
        size = abs(mean_h)
        if x != 0.0 and size > 0.0:
            i, h, z = aligned(i, h, z, mean_h)
            most = abs(x)
            if most > design.xi_high:  # run away: from the start again
                most = design.xi_start if design.xi_start > 0.0 else design.xi_high
            x = most if turned > 0.0 else -most
            mean_h = complex(0.0, -size)
        return i, h, z, x, (level, mean_h, rate, 0.0, power, idle, calm, reasons)

    def step(state: Any, coefficients: Any, design: Any, measurement: Sample,
             given: float) -> State:
        core, clock, registers, watch, out, clear, voltages = state
        i, h, z, x, before, y = core
        integral, rho, span, ticks = clock
        velocity, travel = out
        scheme, noise, window, weights, smoothing, known = coefficients
        dt = scheme[0]
        current, voltage = take(measurement)
        if kept > 0:
            voltages = voltages[1:] + (voltage,)
            voltage = voltages[kept - late]
            if part > 0.0:
                voltage = (1.0 - part) * voltage + part * voltages[0]
        last = watch[7]
        searching = robust and last & SEARCHING != 0
        if searching:  # xi is frozen, the frame is led at the speed at which the back-EMF turns
            rate = watch[2]
            if not -SPEED_CLIP < rate < SPEED_CLIP:
                rate = 0.0
            i, h, z, held, frame = advance(i, h, z, 0.0, before, current, voltage, scheme, 0.0, 0.0,
                                           rate)
        else:
            i, h, z, x, frame = advance(i, h, z, x, before, current, voltage, scheme, design.k_eta,
                                        design.gamma, 0.0)
            travel += frame * dt
        innovation = z.conjugate() * current - i
        new_y = emf(h, z)
        area, turned = turned_emf(y, new_y, dt)
        integral += area
        tick_time = design.clock_rate * dt
        rho += tick_time
        event = 0
        if rho + 0.5 * tick_time >= span:
            if searching:
                ticks = 0
                if identifies:
                    registers = shift(registers, new_y, abs(h), integral)
            else:
                least = least_emf(watch[4], current, noise[0], noise[1], design.emf_min,
                                  design.drop)
                flowed = x
                i, h, z, x, registers, ticks, event = tick(i, h, z, x, integral, ticks, registers,
                                                           least, design)
                if robust and x != flowed:  # the averages of before say nothing of what is now
                    watch = (watch[0], complex(0.0, -watch[0]), watch[2], 0.0, watch[4], watch[5],
                             watch[6], watch[7])
                travel += wrap(rotor_angle(z, x) - travel, TURN)
            integral = complex(0.0, 0.0)
            rho = 0.0
            if robust:
                span = design.second_period if span == 1.0 else 1.0
        if searching:
            event = SEARCHING
            if last & BLIND:
                clear = (dead, 0.0)
                velocity = 0.0
            else:
                if clear[0] < 0.0:
                    turned = velocity * dt  # as it went on before a gap; 0 after a standstill
                travel += turned
                clear = (clear[0] + dt, clear[1] + turned if clear[0] >= 0.0 else 0.0)
                if clear[0] >= window:
                    i, h, z, x, watch = lock_on((i, h, z, x), watch, clear[1], design)
                    velocity = abs(h) * x
                    travel += wrap(rotor_angle(z, x) - travel, TURN)
                    clear = (dead, 0.0)
                    event = RESET
        speed = abs(h) * x
        if not searching:
            velocity += smoothing * (speed - velocity)
        watch = look(watch, event, h, speed, turned / dt, innovation, current, voltage, x, weights,
                     noise, window, dt, known, design.emf_min, design.drop, design.xi_low,
                     design.xi_high, SEARCHING if robust else 0)
        return State((i, h, z, x, current, new_y), (integral, rho, span, ticks), registers, watch,
                     (velocity, travel), clear, voltages)

    def status(watch: tuple, design: Any) -> int:
        if watch[7] & BLIND:
            return NOT_OBSERVABLE
        if watch[7] or watch[6] < design.hold:
            return INITIALISING
        return TRACKING

    def reasons_of(state: Any) -> int:
        return state.watch[7]

    def output(state: Any, coefficients: Any, design: Any, measurement: Sample,
               given: float) -> tuple:
        said = status(state.watch, design)
        if said == NOT_OBSERVABLE:
            return math.nan, math.nan, math.nan, said
        core, out = state.core, state.out
        travel = out[1] + wrap(rotor_angle(core[2], core[3]) - out[1], TURN)
        position = wrap(travel / design.pole_pairs, design.period)
        return position, out[0] / design.pole_pairs, math.nan, said

    def electrical(state: Any, coefficients: Any, design: Any
                   ) -> tuple[float, float, float, float]:
        core = state.core
        flux = flux_linkage(core[3], design.flux_low, design.flux_high)
        said = status(state.watch, design)
        if said == NOT_OBSERVABLE:
            return math.nan, math.nan, flux, 0.0
        return (rotor_angle(core[2], core[3]), state.out[0], flux, 1.0 if said == TRACKING else 0.0)

    def electrical_stddev(state: Any, coefficients: Any, design: Any
                          ) -> tuple[float, float, float]:
        noise, watch = coefficients.noise, state.watch
        x = state.core[3]
        of_angle, of_speed, of_xi = deviations(
            watch[4] / noise[1], watch[0], x, design.k_eta, design.gamma, design.resistance,
            design.inductance, design.epsilon, design.pole, coefficients.scheme[0], noise)
        if status(watch, design) == NOT_OBSERVABLE:
            # nothing is known of the angle; the speed is evenly spread within its bound
            of_angle = math.pi / math.sqrt(3.0)
            of_speed = speed_bound(state, coefficients, design) * design.pole_pairs / math.sqrt(3.0)
        flux = flux_linkage(x, design.flux_low, design.flux_high)
        return of_angle, of_speed, of_xi * flux * flux

    def stddev(state: Any, coefficients: Any, design: Any) -> tuple[float, float]:
        of_angle, of_speed, of_flux = electrical_stddev(state, coefficients, design)
        return of_angle / design.pole_pairs, of_speed / design.pole_pairs

    def speed_bound(state: Any, coefficients: Any, design: Any) -> float:
        noise, watch = coefficients.noise, state.watch
        if watch[7] & BLIND != LOW_EMF:
            return math.inf
        least = LEAVES * least_emf(watch[4], state.core[4], noise[0], noise[1], design.emf_min,
                                   design.drop)
        if watch[0] > least:
            least = watch[0]
        flux = flux_linkage(state.core[3], design.flux_low, design.flux_high)
        return least / (flux * design.pole_pairs)

    def coast(state: Any, coefficients: Any, design: Any, measurement: Sample,
              gap: float) -> State:
        """After `gap` [s] without samples: flux and speed are kept, the rotor is found again."""
        core, clock, registers, watch, out, clear, voltages = state
        current, voltage = take(measurement)
        turned = out[0] * gap
        z, zero = core[2], complex(0.0, 0.0)
        level, mean_h, rate, slip, power, idle, calm, reasons = watch
        return State((z.conjugate() * current, core[1], z, core[3], current, zero),
                     (zero, 0.0, 1.0, 0), registers,
                     (level, mean_h, rate, slip, power, idle, 0.0, reasons | SEARCHING),
                     (out[0], out[1] + turned), (dead, 0.0), voltages)

    def resume(state: Any, coefficients: Any, design: Any, measurement: Sample) -> State:
        return coast(state, coefficients, design, measurement, 0.0)

    def limits(dt: float) -> str | None:
        top = (gains.speed_max or 0.0) * poles
        if top * dt <= math.pi:
            return None
        return (f'at {1.0 / dt:.0f} Hz the rotor turns more than half an electrical turn per '
                f'sample at speed_max = {gains.speed_max:g} rad/s: at least {top / math.pi:.0f} Hz '
                'is needed')

    def group_delay(dt: float) -> float:
        pole = 2.0 * math.pi * gains.speed_filter_hz
        if pole <= 0.0:
            return 0.0  # the flux estimate makes up for the lag of the back-EMF (epsilon)
        left = math.exp(-pole * dt)
        return dt * left / (1.0 - left)

    return DriveFunctions(
        design, prepare, init, step, output, stddev, resume, limits, group_delay, finite=finite,
        blank=(0.0, 0.0, 0.0, 0.0), electrical=electrical, electrical_stddev=electrical_stddev,
        speed_bound=speed_bound, reasons=reasons_of, coast=coast)


OBSERVER = Observer(
    name='pmsm', summary='sensorless speed, angle and flux of a permanent-magnet motor',
    gains=Gains, build=build, reference='Bosso, Azzollini, Tilli (2020), (5), (16), (25), (26)',
    kind='drive')
