"""Sensorless speed, angle and flux of a permanent-magnet motor (Bosso, Azzollini, Tilli, 2020).

A sample is (i_alpha, i_beta, u_alpha, u_beta): the current at the stamp and the mean voltage over
the interval that ends at it. The robust form adds to the paper what a drive needs: it waits while
the rotor is not observable, and finds it again from the direction and the turning of the back-EMF.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from estimator_pkg.models.motor import POWER_INVARIANT
from estimator_pkg.observers.circle import Circle, wrap
from estimator_pkg.observers.contract import (
    INITIALISING,
    NOT_OBSERVABLE,
    TRACKING,
    Functions,
    Observer,
)
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
LARGEST = 1e6       # A or V: beyond it a sample is garbage
SPEED_CLIP = 2e4    # rad/s, electrical: a back-EMF that turns faster is noise

TURN = 2.0 * math.pi

Sample = tuple[float, float, float, float]


@dataclass(frozen=True)
class DriveFunctions(Functions):
    """The functions of an observer of kind 'drive', which knows more than a position.

    Attributes
    ----------
    electrical : (state, coefficients, design) -> (electrical angle [rad], electrical speed [rad/s],
        flux linkage [Wb], 1.0 where it counts or 0.0); nan where it is withheld.
    electrical_stddev : (state, coefficients, design) -> one standard deviation of these three.
    speed_bound : (state, coefficients, design) -> mechanical speed that is not exceeded where the
        rotor is not observable [rad/s]; inf where nothing is known.
    reasons : (state) -> bits of `pmsm_watch.REASONS`.
    coast : (state, coefficients, design, measurement, gap) -> state. After a gap of known length.
    """

    electrical: Callable[..., tuple] = None  # type: ignore[assignment]
    electrical_stddev: Callable[..., tuple] = None  # type: ignore[assignment]
    speed_bound: Callable[..., float] = None  # type: ignore[assignment]
    reasons: Callable[[tuple], int] = None  # type: ignore[assignment]
    coast: Callable[..., tuple] = None  # type: ignore[assignment]


def finite(measurement: Sample) -> bool:
    """False where one of the four numbers is NaN, infinite or beyond any drive."""
    i_alpha, i_beta, u_alpha, u_beta = measurement
    return (-LARGEST < i_alpha < LARGEST and -LARGEST < i_beta < LARGEST
            and -LARGEST < u_alpha < LARGEST and -LARGEST < u_beta < LARGEST)


def build(gains: Gains, circle: Circle) -> DriveFunctions:
    """The functions of the sensorless observer at these gains."""
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

    def design() -> tuple:
        low, high = flux_range(gains)
        nominal = float(gains.flux or 0.0)
        start = nominal if gains.initial_flux is None else gains.initial_flux
        least = gains.emf_min if gains.emf_min is not None else nominal * EMF_SPEED
        noise = gains.current_noise
        guess = NOISE_GUESS * nominal / float(gains.inductance or 1.0)
        return (tuned.k_p, tuned.k_i, tuned.k_eta, tuned.gamma, float(gains.resistance or 0.0),
                float(gains.inductance or 0.0), tuned.epsilon, float(gains.clock_rate),
                4.0 * math.sqrt(tuned.gamma), 1.0 / high, 1.0 / low, low, high,
                float(least), 2.0 * gains.resistance_error * float(gains.resistance or 0.0),
                1.0 / start if start > 0.0 else 0.0, float(gains.pole_pairs or 1), gains.hold,
                2.0 * math.pi * gains.speed_filter_hz,
                noise * noise if noise is not None else 0.0, guess * guess,
                float(circle.period) if not circle.unwrap else 0.0, gains.second_period)

    def prepare(design: tuple, dt: float) -> tuple:
        k_p, k_i, resistance, inductance, epsilon = (design[0], design[1], design[4], design[5],
                                                     design[6])
        scheme = prepare_scheme(resistance, inductance, k_p, k_i, dt)
        noise = prepare_noise(resistance, inductance, k_p, k_i, scheme)
        fast = max(FAST, 5.0 * epsilon)
        slow = max(SLOW, 5.0 * fast)
        return (scheme, noise, slow, (low_pass_weight(1.0 / fast, dt),
                                      low_pass_weight(1.0 / slow, dt),
                                      low_pass_weight(1.0 / NOISE_MEMORY, dt)),
                low_pass_weight(design[18], dt), design[19] * noise[1])

    def take(measurement: Sample) -> tuple[complex, complex]:
        """Current and voltage as amplitude-invariant vectors."""
        i_alpha, i_beta, u_alpha, u_beta = measurement
        if scale != 1.0:
            return (complex(i_alpha * scale, i_beta * scale),
                    complex(u_alpha * scale, u_beta * scale))
        return complex(i_alpha, i_beta), complex(u_alpha, u_beta)

    def init(measurement: Sample, design: tuple) -> tuple:
        current, voltage = take(measurement)
        zero = complex(0.0, 0.0)
        return ((current, zero, complex(1.0, 0.0), design[15], current, zero),
                (zero, 0.0, 1.0, 0),      # integral of y, clock, length of this period, ticks
                blank_registers, begin_watch(design[20]),
                (0.0, 0.0),               # speed output [rad/s], travelled electrical angle [rad]
                (dead, 0.0),              # time and angle that y turned since it is large enough
                no_voltages)              # voltages reported of late, newest last

    def tick(i: complex, h: complex, z: complex, x: float, integral: complex, ticks: int,
             registers: tuple, least: float, design: tuple) -> tuple:
        """A tick of the clock: the identifier, then the reset of the frame."""
        event = 0
        if identifies:
            size = abs(h)
            registers = shift(registers, emf(h, z), size, integral)
            ticks += 1
            if robust and size < least:
                ticks = 0
            if ticks > count + 1:
                found, travelled, rest, total = solve(registers)
                if abs(x - found) > design[8] and (not robust or credible(
                        registers, found, travelled, rest, total, CHORD, REST, design[9],
                        design[10], least)):
                    x = found
                    event = RESET
                    if robust:  # a sound flux and a sound direction: begin aligned
                        i, h, z = aligned(i, h, z, h)
        if resets and wants_reflection(h):
            i, h, z = reflect(i, h, z)
            event = RESET
        return i, h, z, x, registers, ticks, event

    def lock_on(core: tuple, watch: tuple, turned: float, design: tuple) -> tuple:
        """(i, h, z, x, watch): the frame on the back-EMF as averaged, xi signed as it turned."""
        i, h, z, x = core
        level, mean_h, rate, slip, power, idle, calm, reasons = watch
        size = abs(mean_h)
        if x != 0.0 and size > 0.0:
            i, h, z = aligned(i, h, z, mean_h)
            most = abs(x)
            if most > design[10]:  # run away: from the start again
                most = design[15] if design[15] > 0.0 else design[10]
            x = most if turned > 0.0 else -most
            mean_h = complex(0.0, -size)
        return i, h, z, x, (level, mean_h, rate, 0.0, power, idle, calm, reasons)

    def step(state: tuple, coefficients: tuple, design: tuple, measurement: Sample,
             given: float) -> tuple:
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
            i, h, z, x, frame = advance(i, h, z, x, before, current, voltage, scheme, design[2],
                                        design[3], 0.0)
            travel += frame * dt
        innovation = z.conjugate() * current - i
        new_y = emf(h, z)
        area, turned = turned_emf(y, new_y, dt)
        integral += area
        tick_time = design[7] * dt
        rho += tick_time
        event = 0
        if rho + 0.5 * tick_time >= span:
            if searching:
                ticks = 0
                if identifies:
                    registers = shift(registers, new_y, abs(h), integral)
            else:
                least = least_emf(watch[4], current, noise[0], noise[1], design[13], design[14])
                i, h, z, x, registers, ticks, event = tick(i, h, z, x, integral, ticks, registers,
                                                           least, design)
                travel += wrap(rotor_angle(z, x) - travel, TURN)
            integral = complex(0.0, 0.0)
            rho = 0.0
            if robust:
                span = design[22] if span == 1.0 else 1.0
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
                     noise, window, dt, known, design[13], design[14], design[9], design[10],
                     SEARCHING if robust else 0)
        return ((i, h, z, x, current, new_y), (integral, rho, span, ticks), registers, watch,
                (velocity, travel), clear, voltages)

    def status(watch: tuple, design: tuple) -> int:
        if watch[7] & BLIND:
            return NOT_OBSERVABLE
        if watch[7] or watch[6] < design[17]:
            return INITIALISING
        return TRACKING

    def output(state: tuple, coefficients: tuple, design: tuple, measurement: Sample,
               given: float) -> tuple:
        said = status(state[3], design)
        if said == NOT_OBSERVABLE:
            return math.nan, math.nan, math.nan, said
        core, out = state[0], state[4]
        travel = out[1] + wrap(rotor_angle(core[2], core[3]) - out[1], TURN)
        return wrap(travel / design[16], design[21]), out[0] / design[16], math.nan, said

    def electrical(state: tuple, coefficients: tuple, design: tuple
                   ) -> tuple[float, float, float, float]:
        core = state[0]
        flux = flux_linkage(core[3], design[11], design[12])
        said = status(state[3], design)
        if said == NOT_OBSERVABLE:
            return math.nan, math.nan, flux, 0.0
        return (rotor_angle(core[2], core[3]), state[4][0], flux, 1.0 if said == TRACKING else 0.0)

    def electrical_stddev(state: tuple, coefficients: tuple, design: tuple
                          ) -> tuple[float, float, float]:
        noise, watch = coefficients[1], state[3]
        x = state[0][3]
        of_angle, of_speed, of_xi = deviations(
            watch[4] / noise[1], watch[0], x, design[2], design[3], design[4], design[5],
            design[6], design[18], coefficients[0][0], noise)
        if status(watch, design) == NOT_OBSERVABLE:
            # nothing is known of the angle; the speed is evenly spread within its bound
            of_angle = math.pi / math.sqrt(3.0)
            of_speed = speed_bound(state, coefficients, design) * design[16] / math.sqrt(3.0)
        flux = flux_linkage(x, design[11], design[12])
        return of_angle, of_speed, of_xi * flux * flux

    def stddev(state: tuple, coefficients: tuple, design: tuple) -> tuple[float, float]:
        of_angle, of_speed, of_flux = electrical_stddev(state, coefficients, design)
        return of_angle / design[16], of_speed / design[16]

    def speed_bound(state: tuple, coefficients: tuple, design: tuple) -> float:
        noise, watch = coefficients[1], state[3]
        if watch[7] & BLIND != LOW_EMF:
            return math.inf
        least = LEAVES * least_emf(watch[4], state[0][4], noise[0], noise[1], design[13],
                                   design[14])
        if watch[0] > least:
            least = watch[0]
        return least / (flux_linkage(state[0][3], design[11], design[12]) * design[16])

    def coast(state: tuple, coefficients: tuple, design: tuple, measurement: Sample, gap: float
              ) -> tuple:
        """After `gap` [s] without samples: flux and speed are kept, the rotor is found again."""
        core, clock, registers, watch, out, clear, voltages = state
        current, voltage = take(measurement)
        turned = out[0] * gap
        z = core[2] * complex(math.cos(turned), math.sin(turned))
        zero = complex(0.0, 0.0)
        level, mean_h, rate, slip, power, idle, calm, reasons = watch
        return ((z.conjugate() * current, core[1], z, core[3], current, zero),
                (zero, 0.0, 1.0, 0), registers,
                (level, mean_h, rate, slip, power, idle, 0.0, reasons | SEARCHING),
                (out[0], out[1] + turned), (dead, 0.0), voltages)

    def resume(state: tuple, coefficients: tuple, design: tuple, measurement: Sample) -> tuple:
        return coast(state, coefficients, design, measurement, 0.0)

    def limits(dt: float) -> str | None:
        top = (gains.speed_max or 0.0) * float(gains.pole_pairs or 1)
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
        speed_bound=speed_bound, reasons=lambda state: state[3][7], coast=coast)


OBSERVER = Observer(
    name='pmsm', summary='sensorless speed, angle and flux of a permanent-magnet motor',
    gains=Gains, build=build, reference='Bosso, Azzollini, Tilli (2020), (5), (16), (25), (26)',
    kind='drive')
