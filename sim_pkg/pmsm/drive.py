# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The drive in closed loop: motor, inverter, sensors and controller, sample by sample.

The controller gets its angle and speed from a feedback: the true ones (`sensored`), in the engine,
or those of an observer (`sim_pkg.pmsm.sensorless`), in plain Python.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.engine import calls
from estimator_pkg.record import record
from sim_pkg.joints.sensor import random_stream
from sim_pkg.pmsm.control import Control, current_control, speed_control
from sim_pkg.pmsm.inverter import dead_time_error, switch
from sim_pkg.pmsm.parameters import PmsmParameters
from sim_pkg.pmsm.plant import Plant, move
from sim_pkg.pmsm.profiles import Profile

CHUNK = 0.01  # simulated time per chunk; the temperature is updated once per chunk [s]


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
    frame_before: float  # angle of the controller's frame [rad]
    forced_before: float  # i_q [A]


@record
class Parts:
    """ADC and inverter."""

    step: float  # of the ADC [A]; 0: none
    limit: float  # its range [A]
    dead: float  # dead time, in periods
    offset: float  # of the samples, in periods
    delay: int  # of the reported voltage, in samples
    switched: bool  # simulate the edges of the bridge instead of the mean voltage


class Record(NamedTuple):
    """The signals of a chunk of n samples.

    samples : shape (n, 4): measured current [A] and reported voltage [V], alpha and beta.
    truth : shape (n, 5): mechanical speed [rad/s], electrical angle [rad, unwrapped], flux [Wb],
        i_q [A], reference of the mechanical speed [rad/s].
    """

    samples: NDArray[np.float64]
    truth: NDArray[np.float64]


def sensored(
    current: complex, voltage: complex, theta: float, speed: float, poles: float, reference: float
) -> tuple[float, float, float]:
    """Return the feedback of an ideal sensor: (electrical angle, electrical speed, forced i_q).

    A forced current other than 0 replaces the speed control.
    """
    return theta, poles * speed, 0.0


def quantised(value: float, step: float, limit: float) -> float:
    """Return the value as an ADC with this step and range reports it; step 0: unchanged."""
    if step <= 0.0:
        return value
    if value > limit:
        value = limit
    elif value < -limit:
        value = -limit
    return step * math.floor(value / step + 0.5)


def measured(state: State, parts: Parts, noise_alpha: float, noise_beta: float) -> complex:
    """Return the current that the drive measures [A]."""
    return complex(
        quantised(state.current.real + noise_alpha, parts.step, parts.limit),
        quantised(state.current.imag + noise_beta, parts.step, parts.limit),
    )


def advance(
    state: State,
    plant: Plant,
    control: Control,
    parts: Parts,
    k: int,
    read: complex,
    angle: float,
    omega: float,
    forced: float,
    reference: Array,
    acceleration: Array,
    load: Array,
    samples: Array,
    truth: Array,
) -> None:
    """Control, write row k of the arrays, and move the drive to the next sample.

    Parameters
    ----------
    read : measured current [A]. angle, omega, forced : from the feedback, see `sensored`.
    reference, acceleration, load : shape (n,). samples, truth : the rows of `Record`, shape (n m,).
    """
    period, dc, dead, offset = control.period, control.dc_voltage, parts.dead, parts.offset
    if forced != 0.0:
        i_q = forced
    else:
        if state.forced_before != 0.0:
            # bumpless takeover: rotate the current loop's integral into the new frame, start the
            # speed loop's integral at the present torque
            turn = state.frame_before - angle
            state.folded = state.folded * complex(math.cos(turn), math.sin(turn))
            flowing = read * complex(math.cos(angle), -math.sin(angle))
            state.steering = control.torque_constant * flowing.imag
        i_q, state.steering = speed_control(
            reference[k], acceleration[k], omega / control.poles, state.steering, control
        )
    following, state.folded = current_control(read, i_q, angle, omega, state.folded, control)
    state.frame_before = angle + omega * period
    state.forced_before = forced
    if parts.delay == 0:
        reported = state.acted
    elif parts.delay == 1:
        reported = state.active
    elif parts.delay == 2:
        reported = following
    else:
        reported = state.older
    current, theta, speed = state.current, state.theta, state.speed
    samples[4 * k], samples[4 * k + 1] = read.real, read.imag
    samples[4 * k + 2], samples[4 * k + 3] = reported.real, reported.imag
    truth[5 * k], truth[5 * k + 1], truth[5 * k + 2] = speed, theta, plant.flux
    truth[5 * k + 3] = (current * complex(math.cos(theta), -math.sin(theta))).imag
    truth[5 * k + 4] = reference[k]
    # advance to the next sample: the rest of this carrier period, the start of the next
    active, brake = state.active, load[k]
    if parts.switched:
        current, theta, speed = switch(
            current, theta, speed, brake, plant, active, dc, dead, period, offset, 1.0
        )
        current, theta, speed = switch(
            current, theta, speed, brake, plant, following, dc, dead, period, 0.0, offset
        )
    else:
        lost = 0j
        if dead > 0.0:
            lost = dead_time_error(current, dc, dead)
        current, theta, speed = move(
            current, active - lost, theta, speed, brake, plant, (1.0 - offset) * period
        )
        if offset > 0.0:
            current, theta, speed = move(
                current, following - lost, theta, speed, brake, plant, offset * period
            )
    state.current, state.theta, state.speed = current, theta, speed
    state.older, state.acted, state.active = state.acted, active, following


def run_sensored(
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
    """Simulate `count` samples with the feedback `sensored`; noise has the shape (count, 2)."""
    for k in range(count):
        read = measured(state, parts, noise[2 * k], noise[2 * k + 1])
        angle, omega, forced = sensored(
            read, state.acted, state.theta, state.speed, control.poles, reference[k]
        )
        advance(
            state,
            plant,
            control,
            parts,
            k,
            read,
            angle,
            omega,
            forced,
            reference,
            acceleration,
            load,
            samples,
            truth,
        )


class Drive:
    """A simulated drive: an endless source of chunks of samples.

    Parameters
    ----------
    parameters : motor, load, inverter, sensors, controller.
    seed : random seed of the current noise.
    feedback : of the controller.
    profile : reference of the speed; None: that of the parameters.
    start_speed : mechanical speed at the start [rad/s]; None: that of the profile.
    """

    def __init__(
        self,
        parameters: PmsmParameters,
        seed: int = 0,
        *,
        feedback: Callable[..., tuple] = sensored,
        profile: Profile | None = None,
        start_speed: float | None = None,
        theta: float = 0.0,
    ) -> None:
        self.parameters = parameters
        self.profile = profile or parameters.motion()
        self._random = random_stream(seed, 'current')
        self._control = parameters.control()
        self._feedback = feedback
        self.count = 0
        speed = float(self.profile.at(np.zeros(1)).speed[0]) if start_speed is None else start_speed
        plant, state = parameters.plant(), State()
        # as if it had run without current so far: the voltage equals the back-EMF
        omega = plant.poles * speed
        if feedback is sensored:
            state.older, state.acted, state.active = (
                1j * omega * plant.flux * cmath.exp(1j * (theta + part * omega * parameters.period))
                for part in (-1.5, -0.5, 0.5)
            )
        state.theta, state.speed, state.frame_before = theta, speed, theta
        self._state, self._parts = state, Parts()
        bits, full_scale = parameters.adc_bits, parameters.adc_range
        self._parts.step = 2.0 * full_scale / 2**bits if bits else 0.0
        self._parts.limit = full_scale
        self._parts.dead = parameters.dead_time * parameters.sample_rate
        self._parts.offset = parameters.sampling_offset
        self._parts.delay = parameters.voltage_delay
        self._parts.switched = parameters.inverter == 'switched'

    def run(self, count: int) -> Record:
        """Return the next `count` samples."""
        parameters = self.parameters
        records = []
        chunk = max(1, round(CHUNK * parameters.sample_rate))
        while count > 0:
            size = min(count, chunk - self.count % chunk)
            times = (self.count + np.arange(size, dtype=np.float64)) * parameters.period
            motion = self.profile.at(times)
            warmed = (self.count - self.count % chunk) * parameters.period
            noise = parameters.current_noise * self._random.standard_normal((size, 2))
            load = np.where(times >= parameters.load_step_time, parameters.load_step, 0.0)
            record = Record(np.empty((size, 4)), np.empty((size, 5)))
            columns = (motion.speed, motion.acceleration, load)
            drive = self._state, parameters.plant(warmed), self._control, self._parts
            if self._feedback is sensored:
                calls.run(run_sensored, *drive, size, noise, *columns, *record)
            else:
                self._run_plainly(drive, noise, columns, record)
            records.append(record)
            self.count += size
            count -= size
        return Record(
            np.concatenate([record.samples for record in records]),
            np.concatenate([record.truth for record in records]),
        )

    def _run_plainly(self, drive: Any, noise: Array, columns: Any, record: Record) -> None:
        """As `run_sensored`, with the feedback."""
        state, plant, control, parts = drive
        reference, *others = (column.tolist() for column in columns)
        rows = [array.reshape(-1) for array in record]
        for k, errors in enumerate(noise.tolist()):
            read = measured(state, parts, *errors)
            known = state.acted, state.theta, state.speed, plant.poles, reference[k]
            fed: Any = self._feedback(read, *known)
            rest: list[Any] = [*fed, reference, *others, *rows]
            advance(state, plant, control, parts, k, read, *rest)

    def chunks(self, size: int) -> Iterator[Record]:
        """Yield chunks of `size` samples, without end."""
        while True:
            yield self.run(size)
