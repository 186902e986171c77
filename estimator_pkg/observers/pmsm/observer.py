# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Sensorless speed, angle and flux of a permanent-magnet motor (Bosso, Azzollini, Tilli, 2020).

A sample is (i_alpha, i_beta, u_alpha, u_beta): the current at the stamp and the mean voltage over
the interval that ends at the stamp. The robust form extends the paper: it waits while the rotor is
not observable, and finds it again from the direction and the rotation of the back-EMF.
"""

from __future__ import annotations

import math
from typing import Any

from estimator_pkg.models.motor import POWER_INVARIANT, check_motor
from estimator_pkg.observers.circle import Circle, wrap
from estimator_pkg.observers.contract import INITIALISING, NOT_OBSERVABLE, TRACKING, Observer
from estimator_pkg.observers.maths.tracking import natural_frequency
from estimator_pkg.observers.pmsm.drive import DriveFunctions, Sample, finite
from estimator_pkg.observers.pmsm.equations import (
    aligned,
    emf,
    flux_linkage,
    phase_signs,
    reflect,
    rotor_angle,
    wants_reflection,
)
from estimator_pkg.observers.pmsm.gains import Gains
from estimator_pkg.observers.pmsm.identifier import credible, empty_registers, shift, solve
from estimator_pkg.observers.pmsm.noise import deviations, prepare_noise
from estimator_pkg.observers.pmsm.ripple import NO_RIPPLES, follow_ripples, ripple_variances
from estimator_pkg.observers.pmsm.scheme import advance, turned_emf
from estimator_pkg.observers.pmsm.state import (
    DAMPING,
    Coefficients,
    Design,
    State,
    design_of,
    prepare_coefficients,
)
from estimator_pkg.observers.pmsm.watch import (
    BLIND,
    LEAVES,
    LOW_EMF,
    RESET,
    SEARCHING,
    begin_watch,
    least_emf,
    look,
)

CHORD = 0.3  # gates of the identifier, see `credible`
REST = 0.25
SPEED_CLIP = 2e4  # rad/s, electrical: a back-EMF that turns faster is noise
BEYOND = 1e15  # V and 1/Wb: larger states have diverged
TURN = 2.0 * math.pi


def build(gains: Gains, circle: Circle) -> DriveFunctions:
    """Return the functions of the sensorless observer with these gains.

    `design` is a `Design`, `coefficients` are `Coefficients` and `state` is a `State`. The
    functions close over the structure only, so that new gains need no new compilation.

    Raises
    ------
    UsageError : motor data are missing, or the gains cannot work.
    """
    design_of(gains, circle)  # raises UsageError if the gains cannot work
    poles = check_motor(gains, 'pmsm')[3]
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
    when_blind = SEARCHING if robust else 0

    def design() -> Design:
        return design_of(gains, circle)

    def prepare(design: Any, dt: float) -> Coefficients:
        return prepare_coefficients(design, dt, when_blind)

    def take(measurement: Sample) -> tuple[complex, complex]:
        """Return current and voltage as amplitude-invariant vectors."""
        i_alpha, i_beta, u_alpha, u_beta = measurement
        if scale != 1.0:
            return (
                complex(i_alpha * scale, i_beta * scale),
                complex(u_alpha * scale, u_beta * scale),
            )
        return complex(i_alpha, i_beta), complex(u_alpha, u_beta)

    def init(measurement: Sample, design: Any) -> State:
        current, voltage = take(measurement)
        zero = complex(0.0, 0.0)
        return (
            (current, zero, complex(1.0, 0.0), design.xi_start, current, zero),
            (zero, 0.0, 1.0, 0),
            blank_registers,
            begin_watch(design.noise_guess),
            (0.0, 0.0, 0.0),
            (design.dead, 0.0),
            no_voltages,
            NO_RIPPLES,
        )

    def tick(
        i: complex,
        h: complex,
        z: complex,
        x: float,
        integral: complex,
        ticks: int,
        registers: tuple,
        least: float,
        design: Any,
    ) -> tuple:
        """Run one clock tick: the identifier, then the reset of the frame."""
        event = 0
        if identifies:
            size = abs(h)
            registers = shift(registers, emf(h, z), size, integral)
            ticks += 1
            if ticks > count + 1:
                found, travelled, rest, total = solve(registers)
                if abs(x - found) > design.threshold and (
                    not robust
                    or credible(
                        registers,
                        found,
                        travelled,
                        rest,
                        total,
                        CHORD,
                        REST,
                        design.xi_low,
                        design.xi_high,
                        least,
                    )
                ):
                    x = found
                    event = RESET
                    if robust:  # flux and direction are credible: align the frame
                        i, h, z = aligned(i, h, z, h)
        if resets and wants_reflection(h):
            i, h, z = reflect(i, h, z)
            event = RESET
        return i, h, z, x, registers, ticks, event

    def lock_on(core: tuple, watch: tuple, turned: float, design: Any) -> tuple:
        """Return (i, h, z, x, watch) aligned with the averaged back-EMF, xi signed as it turned."""
        i, h, z, x = core
        level, mean_h, rate, slip, power, idle, calm, reasons = watch
        size = abs(mean_h)
        if x != 0.0 and size > 0.0:
            i, h, z = aligned(i, h, z, mean_h)
            most = abs(x)
            if most > design.xi_high:  # xi has diverged: take its initial value
                most = design.xi_start if design.xi_start > 0.0 else design.xi_high
            x = most if turned > 0.0 else -most
            mean_h = complex(0.0, -size)
        return i, h, z, x, (level, mean_h, rate, 0.0, power, idle, calm, reasons)

    def step(
        state: Any, coefficients: Any, design: Any, measurement: Sample, known_input: float
    ) -> State:
        core, clock, registers, watch, out, clear, voltages, ripples = state
        i, h, z, x, before, y = core
        integral, rho, span, ticks = clock
        level, mean_h, rate, slip, power, idle, calm, last = watch
        velocity, slope, travel = out
        clear_time, clear_angle = clear
        (
            dt,
            scheme,
            noise,
            watching,
            emf_of_noise,
            window,
            low_pass,
            pace,
            k_eta,
            gamma,
            standing,
            dead_time,
            of_ripple,
        ) = coefficients
        i_alpha, i_beta, u_alpha, u_beta = measurement
        current, voltage = complex(i_alpha, i_beta), complex(u_alpha, u_beta)
        if scale != 1.0:
            current, voltage = scale * current, scale * voltage
        if kept > 0:
            voltages = voltages[1:] + (voltage,)
            voltage = voltages[kept - late]
            if part > 0.0:
                voltage = (1.0 - part) * voltage + part * voltages[0]
        if dead_time > 0.0:
            voltage -= dead_time * phase_signs(before + current)
        if standing != 0.0:
            voltage *= complex(1.0, -standing * velocity)
        if not robust and not (abs(x) < BEYOND and abs(h) < BEYOND):
            return init(measurement, design)  # the printed equations do not bound xi_hat: restart
        searching = robust and last & SEARCHING != 0
        if searching:  # xi is frozen, the frame turns at the speed of the back-EMF
            turning = rate if -SPEED_CLIP < rate < SPEED_CLIP else 0.0
            i, h, z, frozen, frame = advance(
                i, h, z, 0.0, before, current, voltage, scheme, 0.0, 0.0, turning
            )
        else:  # the flow (16)
            i, h, z, x, frame = advance(
                i, h, z, x, before, current, voltage, scheme, k_eta, gamma, 0.0
            )
            travel += frame * dt
        innovation = z.conjugate() * current - i  # i_tilde
        new_y = emf(h, z)
        area, turned = turned_emf(y, new_y, dt)
        integral += area
        rho += pace  # Lambda dt
        event = 0
        if rho + 0.5 * pace >= span:  # the jump of (16), at the end of the clock period
            z *= 1.0 / abs(z)
            if searching:
                ticks = 0
                if identifies:
                    registers = shift(registers, new_y, abs(h), integral)
            else:
                least = least_emf(power, current, emf_of_noise, design.emf_min, design.drop)
                flowed = x
                i, h, z, x, registers, ticks, event = tick(
                    i, h, z, x, integral, ticks, registers, least, design
                )
                if robust and x != flowed:  # the averages belong to the old frame: reset them
                    watch = (level, complex(0.0, -level), rate, 0.0, power, idle, calm, last)
                travel += wrap(rotor_angle(z, x) - travel, TURN)
            integral = complex(0.0, 0.0)
            rho = 0.0
            if robust:
                span = design.second_period if span == 1.0 else 1.0
        if searching:
            event = SEARCHING
            slope = 0.0
            if last & BLIND:
                clear = (design.dead, 0.0)
                velocity = 0.0
            else:
                if clear_time < 0.0:
                    turned = velocity * dt  # with the speed before a gap; 0 after a standstill
                travel += turned
                clear_angle = clear_angle + turned if clear_time >= 0.0 else 0.0
                clear_time += dt
                clear = (clear_time, clear_angle)
                if clear_time >= window:
                    i, h, z, x, watch = lock_on((i, h, z, x), watch, clear_angle, design)
                    velocity = abs(h) * x
                    travel += wrap(rotor_angle(z, x) - travel, TURN)
                    clear = (design.dead, 0.0)
                    event = RESET
            speed = abs(h) * x
        else:
            speed = abs(h) * x  # omega_hat
            f11, f12, f21, f22 = low_pass
            if f21 != 0.0:
                # filter the speed of the frame, not |h| x: its integral is the angle, so the
                # current noise in it is above the low-pass
                lag = velocity - frame
                velocity = frame + f11 * lag + f12 * slope
                slope = f21 * lag + f22 * slope
                if last == 0 and calm >= design.hold:  # a start is no ripple
                    ripples = follow_ripples(ripples, of_ripple, frame - velocity, new_y)
            else:
                velocity = speed
        watch = look(
            watch, event, h, speed, turned / dt, innovation, before, current, voltage, x, watching
        )
        return (
            (i, h, z, x, current, new_y),
            (integral, rho, span, ticks),
            registers,
            watch,
            (velocity, slope, travel),
            clear,
            voltages,
            ripples,
        )

    def status_of(reasons: int, calm: float, design: Any) -> int:
        if reasons & BLIND:
            return NOT_OBSERVABLE
        if reasons or calm < design.hold:
            return INITIALISING
        return TRACKING

    def reasons_of(state: Any) -> int:
        core, clock, registers, watch, out, clear, voltages, ripples = state
        level, mean_h, rate, slip, power, idle, calm, reasons = watch
        return reasons

    def output(
        state: Any, coefficients: Any, design: Any, measurement: Sample, known_input: float
    ) -> tuple:
        core, clock, registers, watch, out, clear, voltages, ripples = state
        i, h, z, x, current, y = core
        level, mean_h, rate, slip, power, idle, calm, reasons = watch
        velocity, slope, travel = out
        status = status_of(reasons, calm, design)
        if status == NOT_OBSERVABLE:
            return math.nan, math.nan, math.nan, status
        travel += wrap(rotor_angle(z, x) - travel, TURN)
        position = wrap(travel / design.pole_pairs, design.period)
        return position, velocity / design.pole_pairs, math.nan, status

    def row(
        state: Any, coefficients: Any, design: Any
    ) -> tuple[float, float, float, float, int, int]:
        core, clock, registers, watch, out, clear, voltages, ripples = state
        i, h, z, x, current, y = core
        level, mean_h, rate, slip, power, idle, calm, reasons = watch
        velocity, slope, travel = out
        flux = flux_linkage(x, design.flux_low, design.flux_high)
        if reasons & BLIND:
            return math.nan, math.nan, flux, 0.0, NOT_OBSERVABLE, reasons
        if reasons or calm < design.hold:
            return rotor_angle(z, x), velocity, flux, 0.0, INITIALISING, reasons
        return rotor_angle(z, x), velocity, flux, 1.0, TRACKING, reasons

    def electrical(state: Any, coefficients: Any, design: Any) -> tuple[float, float, float, float]:
        angle, speed, flux, valid, status, reasons = row(state, coefficients, design)
        return angle, speed, flux, valid

    def electrical_stddev(state: Any, coefficients: Any, design: Any) -> tuple[float, float, float]:
        core, clock, registers, watch, out, clear, voltages, ripples = state
        i, h, z, x, current, y = core
        level, mean_h, rate, slip, power, idle, calm, reasons = watch
        noise = prepare_noise(
            design.inductance, design.k_p, design.k_i, coefficients.scheme, level * x
        )
        of_h, of_innovation, of_integral = noise
        variance = design.noise_power if design.noise_power > 0.0 else power / of_innovation
        of_angle, of_speed, of_xi = deviations(
            variance,
            level,
            x,
            design.k_eta,
            design.gamma,
            design.resistance,
            design.inductance,
            design.epsilon,
            design.natural,
            DAMPING,
            coefficients.dt,
            noise,
        )
        ripple_of_angle, ripple_of_speed = ripple_variances(
            ripples, abs(level * x), design.natural, DAMPING
        )
        of_angle = math.sqrt(of_angle * of_angle + ripple_of_angle)
        of_speed = math.sqrt(of_speed * of_speed + ripple_of_speed)
        if reasons & BLIND:
            # angle unknown: uniform over a turn; speed uniform within its bound
            of_angle = math.pi / math.sqrt(3.0)
            of_speed = speed_bound(state, coefficients, design) * design.pole_pairs / math.sqrt(3.0)
        flux = flux_linkage(x, design.flux_low, design.flux_high)
        return of_angle, of_speed, of_xi * flux * flux

    def stddev(state: Any, coefficients: Any, design: Any) -> tuple[float, float]:
        of_angle, of_speed, of_flux = electrical_stddev(state, coefficients, design)
        return of_angle / design.pole_pairs, of_speed / design.pole_pairs

    def speed_bound(state: Any, coefficients: Any, design: Any) -> float:
        core, clock, registers, watch, out, clear, voltages, ripples = state
        i, h, z, x, current, y = core
        level, mean_h, rate, slip, power, idle, calm, reasons = watch
        if reasons & BLIND != LOW_EMF:
            return math.inf
        least = LEAVES * least_emf(
            power, current, coefficients.emf_of_noise, design.emf_min, design.drop
        )
        if level > least:
            least = level
        flux = flux_linkage(x, design.flux_low, design.flux_high)
        return least / (flux * design.pole_pairs)

    def coast(state: Any, coefficients: Any, design: Any, measurement: Sample, gap: float) -> State:
        """Continue after `gap` [s] without samples: keep flux and speed, search the rotor again."""
        core, clock, registers, watch, out, clear, voltages, ripples = state
        i, h, z, x, before, y = core
        level, mean_h, rate, slip, power, idle, calm, reasons = watch
        velocity, slope, travel = out
        current, voltage = take(measurement)
        zero = complex(0.0, 0.0)
        return (
            (z.conjugate() * current, h, z, x, current, zero),
            (zero, 0.0, 1.0, 0),
            registers,
            (level, mean_h, rate, slip, power, idle, 0.0, reasons | SEARCHING),
            (velocity, 0.0, travel + velocity * gap),
            (design.dead, 0.0),
            voltages,
            ripples,
        )

    def resume(state: Any, coefficients: Any, design: Any, measurement: Sample) -> State:
        return coast(state, coefficients, design, measurement, 0.0)

    def limits(dt: float) -> str | None:
        top = (gains.speed_max or 0.0) * poles
        if top * dt <= math.pi:
            return None
        return (
            f'at {1.0 / dt:.0f} Hz the rotor turns more than half an electrical turn per '
            f'sample at speed_max = {gains.speed_max:g} rad/s: sample at {top / math.pi:.0f} Hz '
            'at least'
        )

    def group_delay(dt: float) -> float:
        if gains.speed_filter_hz <= 0.0:
            return 0.0  # the flux estimate compensates the lag of the back-EMF (epsilon)
        return 2.0 * DAMPING / natural_frequency(gains.speed_filter_hz, DAMPING)

    return DriveFunctions(
        design,
        prepare,
        init,
        step,
        output,
        stddev,
        resume,
        limits,
        group_delay,
        finite=finite,
        blank=(0.0, 0.0, 0.0, 0.0),
        row=row,
        electrical=electrical,
        electrical_stddev=electrical_stddev,
        speed_bound=speed_bound,
        reasons=reasons_of,
        coast=coast,
    )


OBSERVER = Observer(
    name='pmsm',
    summary='sensorless speed, angle and flux of a permanent-magnet motor',
    gains=Gains,
    build=build,
    reference='Bosso, Azzollini, Tilli (2020), (5), (16), (25), (26)',
    kind='drive',
)
