# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The drive in closed loop: motor, inverter, sensors and controller, sample by sample.

The controller has the true angle and speed.
"""

from __future__ import annotations

import cmath
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.engine import calls
from estimator_pkg.record import record
from sim_pkg.joints.sensor import random_stream
from sim_pkg.pmsm.control import Control, current_control, speed_control
from sim_pkg.pmsm.inverter import dead_time_error
from sim_pkg.pmsm.parameters import PmsmParameters
from sim_pkg.pmsm.plant import Plant, move
from sim_pkg.pmsm.profiles import Profile

Array = NDArray[np.float64]


@record
class State:
    """The drive at a sample."""

    current: complex  # [A]
    theta: float  # electrical angle [rad]
    speed: float  # mechanical [rad/s]
    older: complex  # voltages [V] of the period before the last, ...
    acted: complex  # ... of the last, ...
    active: complex  # ... and of the next
    folded: complex  # integral of the current loop [V]
    steering: float  # and of the speed loop [N m]


@record
class Parts:
    """ADC and inverter."""

    step: float  # of the ADC [A]; 0: none
    limit: float  # its range [A]
    dead: float  # dead time, in periods
    delay: int  # of the reported voltage, in samples


class Record(NamedTuple):
    """The signals of a chunk of n samples.

    samples : shape (n, 4): measured current [A] and reported voltage [V], alpha and beta.
    truth : shape (n, 5): mechanical speed [rad/s], electrical angle [rad, unwrapped], flux [Wb],
        i_q [A], reference of the mechanical speed [rad/s].
    """

    samples: NDArray[np.float64]
    truth: NDArray[np.float64]


def quantised(value: float, step: float, limit: float) -> float:
    """Return the value as an ADC with this step and range reports it; step 0: unchanged."""
    if step <= 0.0:
        return value
    if value > limit:
        value = limit
    elif value < -limit:
        value = -limit
    return step * math.floor(value / step + 0.5)


def simulate(
    state: State,
    plant: Plant,
    control: Control,
    parts: Parts,
    count: int,
    noise: Array,
    reference: Array,
    acceleration: Array,
    load: Array,
    samples: Array,
    truth: Array,
) -> None:
    """Simulate `count` samples: control, write a row of the arrays, move to the next sample.

    Parameters
    ----------
    noise : of the measured currents, shape (n, 2) [A]. reference, acceleration, load : shape (n,).
    samples, truth : the rows of `Record`.
    """
    period, dc, dead = control.period, control.dc_voltage, parts.dead
    for k in range(count):
        current, theta, speed, active = state.current, state.theta, state.speed, state.active
        omega = control.poles * speed
        read = complex(
            quantised(current.real + noise[2 * k], parts.step, parts.limit),
            quantised(current.imag + noise[2 * k + 1], parts.step, parts.limit),
        )
        i_q, state.steering = speed_control(
            reference[k], acceleration[k], omega / control.poles, state.steering, control
        )
        following, state.folded = current_control(read, i_q, theta, omega, state.folded, control)
        if parts.delay == 0:
            reported = state.acted
        elif parts.delay == 1:
            reported = active
        elif parts.delay == 2:
            reported = following
        else:
            reported = state.older
        samples[4 * k], samples[4 * k + 1] = read.real, read.imag
        samples[4 * k + 2], samples[4 * k + 3] = reported.real, reported.imag
        truth[5 * k], truth[5 * k + 1], truth[5 * k + 2] = speed, theta, plant.flux
        truth[5 * k + 3] = (current * complex(math.cos(theta), -math.sin(theta))).imag
        truth[5 * k + 4] = reference[k]
        lost = 0j
        if dead > 0.0:
            lost = dead_time_error(current, dc, dead)
        current, theta, speed = move(current, active - lost, theta, speed, load[k], plant, period)
        state.current, state.theta, state.speed = current, theta, speed
        state.older, state.acted, state.active = state.acted, active, following


class Drive:
    """A simulated drive: an endless source of samples.

    Parameters
    ----------
    parameters : motor, load, inverter, sensors, controller.
    seed : random seed of the current noise.
    profile : reference of the speed, with which it starts; None: that of the parameters.
    """

    def __init__(
        self, parameters: PmsmParameters, seed: int = 0, *, profile: Profile | None = None
    ) -> None:
        self.parameters = parameters
        self.profile = profile or parameters.motion()
        self._random = random_stream(seed, 'current')
        self._plant, self._control = parameters.plant(), parameters.control()
        self._state, self._parts = State(), Parts()
        self.count = 0
        self._state.speed = float(self.profile.at(np.zeros(1)).speed[0])
        # as if it had run without current so far: the voltage equals the back-EMF
        omega = self._plant.poles * self._state.speed
        self._state.older, self._state.acted, self._state.active = (
            1j * omega * self._plant.flux * cmath.exp(1j * part * omega * parameters.period)
            for part in (-1.5, -0.5, 0.5)
        )
        bits, full_scale = parameters.adc_bits, parameters.adc_range
        self._parts.step = 2.0 * full_scale / 2**bits if bits else 0.0
        self._parts.limit = full_scale
        self._parts.dead = parameters.dead_time * parameters.sample_rate
        self._parts.delay = parameters.voltage_delay

    def run(self, count: int) -> Record:
        """Return the next `count` samples."""
        parameters = self.parameters
        times = (self.count + np.arange(count, dtype=np.float64)) * parameters.period
        motion = self.profile.at(times)
        noise = parameters.current_noise * self._random.standard_normal((count, 2))
        load = np.where(times >= parameters.load_step_time, parameters.load_step, 0.0)
        record = Record(np.empty((count, 4)), np.empty((count, 5)))
        drive = self._state, self._plant, self._control, self._parts
        columns = motion.speed, motion.acceleration, load
        calls.run(simulate, *drive, count, noise, *columns, *record)
        self.count += count
        return record
