# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The drive in closed loop: motor, inverter, sensors and controller, sample by sample.

`make_loop` combines the parts into one function over a chunk of samples, which Numba can compile.
The feedback of the controller's angle and speed is an argument: the true ones (`sensored`), or
those of an observer (`sim_pkg.pmsm.sensorless`), which runs as plain Python.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.compiled import available, compiled
from sim_pkg.joints.sensor import random_stream
from sim_pkg.pmsm.control import Control, current_control, speed_control
from sim_pkg.pmsm.inverter import dead_time_error, switch
from sim_pkg.pmsm.parameters import PmsmParameters
from sim_pkg.pmsm.plant import Plant, move
from sim_pkg.pmsm.profiles import Profile

CHUNK = 0.01  # simulated time per chunk; the temperature is updated once per chunk [s]


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


def make_loop(feedback: Callable[..., tuple], switched: bool) -> Callable[..., tuple]:
    """Return the function that simulates a drive over a chunk of samples.

    Parameters
    ----------
    feedback : a function with the arguments of `sensored`.
    switched : simulate the switching edges of the bridge instead of the mean voltage.
    """

    def loop(
        state: tuple,
        plant: Plant,
        control: Control,
        drive: tuple,
        noise: NDArray[np.float64],
        reference: NDArray[np.float64],
        acceleration: NDArray[np.float64],
        load: NDArray[np.float64],
        samples: NDArray[np.float64],
        truth: NDArray[np.float64],
    ) -> tuple:
        (current, theta, speed), (older, acted, active), controller = state
        folded, steering, frame_before, forced_before = controller
        step, limit, dead, offset, delay = drive
        period, dc, poles = control.period, control.dc_voltage, control.poles
        for k in range(len(reference)):
            back = complex(math.cos(theta), -math.sin(theta))
            read = complex(
                quantised(current.real + noise[k][0], step, limit),
                quantised(current.imag + noise[k][1], step, limit),
            )
            angle, omega, forced = feedback(read, acted, theta, speed, poles, reference[k])
            if forced != 0.0:
                i_q = forced
            else:
                if forced_before != 0.0:
                    # bumpless takeover: rotate the current loop's integral into the new frame,
                    # start the speed loop's integral at the present torque
                    turn = frame_before - angle
                    folded = folded * complex(math.cos(turn), math.sin(turn))
                    flowing = read * complex(math.cos(angle), -math.sin(angle))
                    steering = control.torque_constant * flowing.imag
                i_q, steering = speed_control(
                    reference[k], acceleration[k], omega / poles, steering, control
                )
            following, folded = current_control(read, i_q, angle, omega, folded, control)
            frame_before = angle + omega * period
            forced_before = forced
            if delay == 0:
                reported = acted
            elif delay == 1:
                reported = active
            elif delay == 2:
                reported = following
            else:
                reported = older
            row, true = samples[k], truth[k]
            row[0], row[1], row[2], row[3] = read.real, read.imag, reported.real, reported.imag
            true[0], true[1], true[2] = speed, theta, plant.flux
            true[3], true[4] = (current * back).imag, reference[k]
            # advance to the next sample: the rest of this carrier period, the start of the next
            if switched:
                current, theta, speed = switch(
                    current, theta, speed, load[k], plant, active, dc, dead, period, offset, 1.0
                )
                current, theta, speed = switch(
                    current, theta, speed, load[k], plant, following, dc, dead, period, 0.0, offset
                )
            else:
                lost = complex(0.0, 0.0)
                if dead > 0.0:
                    lost = dead_time_error(current, dc, dead)
                current, theta, speed = move(
                    current, active - lost, theta, speed, load[k], plant, (1.0 - offset) * period
                )
                if offset > 0.0:
                    current, theta, speed = move(
                        current, following - lost, theta, speed, load[k], plant, offset * period
                    )
            older, acted, active = acted, active, following
        controller = folded, steering, frame_before, forced_before
        return (current, theta, speed), (older, acted, active), controller

    return loop


class Drive:
    """A simulated drive: an endless source of chunks of samples.

    Parameters
    ----------
    parameters : motor, load, inverter, sensors, controller.
    seed : random seed of the current noise.
    feedback : of the controller.
    profile : reference of the speed; None: that of the parameters.
    start_speed : mechanical speed at the start [rad/s]; None: that of the profile.
    fast : compile, if Numba is installed; None: if the feedback is `sensored`.
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
        fast: bool | None = None,
    ) -> None:
        self.parameters = parameters
        self.profile = profile or parameters.motion()
        self._random = random_stream(seed, 'current')
        self._control = parameters.control()
        loop = make_loop(feedback, parameters.inverter == 'switched')
        self.fast = feedback is sensored and available() if fast is None else fast
        self._loop = compiled(loop) if self.fast else loop
        self.count = 0
        speed = float(self.profile.at(np.zeros(1)).speed[0]) if start_speed is None else start_speed
        zero = complex(0.0, 0.0)
        plant = parameters.plant()
        # as if it had run without current so far: the voltage equals the back-EMF
        omega = plant.poles * speed
        voltage = [
            1j
            * omega
            * plant.flux
            * np.exp(1j * (theta + (part - 0.5) * omega * parameters.period))
            for part in (-1.0, 0.0, 1.0)
        ]
        if feedback is not sensored:
            voltage = [zero] * 3
        older, acted, active = map(complex, voltage)
        controller = zero, 0.0, theta, 0.0
        self._state: tuple = ((zero, theta, speed), (older, acted, active), controller)
        bits, full_scale = parameters.adc_bits, parameters.adc_range
        self._drive = (
            2.0 * full_scale / 2**bits if bits else 0.0,
            full_scale,
            parameters.dead_time * parameters.sample_rate,
            parameters.sampling_offset,
            parameters.voltage_delay,
        )

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
            columns = (noise, motion.speed, motion.acceleration, load)
            given = columns if self.fast else [column.tolist() for column in columns]
            self._state = self._loop(
                self._state, parameters.plant(warmed), self._control, self._drive, *given, *record
            )
            records.append(record)
            self.count += size
            count -= size
        return Record(
            np.concatenate([record.samples for record in records]),
            np.concatenate([record.truth for record in records]),
        )

    def chunks(self, size: int) -> Iterator[Record]:
        """Yield chunks of `size` samples, without end."""
        while True:
            yield self.run(size)
