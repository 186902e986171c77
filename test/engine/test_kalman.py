# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A whole filter: the textbook's Kalman filter of constant acceleration, with a guard."""

import math
import shutil

import numpy as np
import pytest
from engine_build import build, write

pytestmark = pytest.mark.skipif(shutil.which('gcc') is None, reason='needs gcc')
TEXT = '''
    """The Kalman filter of constant acceleration:  a' = w,  v' = a,  x' = v."""
    import math

    import numpy as np
    from numpy.typing import NDArray

    from estimator_pkg.record import record

    UNKNOWN = 1e6  # [rad/s^2] squared


    @record
    class Design:
        density: float  # q of the white jerk [(rad/s^3)^2 s]
        variance: float  # R of a reading [rad^2]
        period: float  # of the angle [rad]
        gap: float  # [s] without a reading: start again


    @record
    class Motion:
        """What is estimated."""

        position: float  # x [rad]
        velocity: float  # v [rad/s]
        acceleration: float  # a [rad/s^2]


    @record
    class Covariance:
        p00: float
        p01: float
        p02: float
        p11: float
        p12: float
        p22: float


    @record
    class State:
        motion: Motion
        p: Covariance
        samples: int
        last_ns: int
        dropped: int


    def wrap(angle: float, period: float) -> float:
        """Return the angle within half a period."""
        return angle - period * math.floor(angle / period + 0.5)


    def predict_motion(motion: Motion, dt: float) -> None:
        """(K1) x <- x + v dt + a dt^2/2,  v <- v + a dt."""
        motion.position += dt * (motion.velocity + 0.5 * dt * motion.acceleration)
        motion.velocity += dt * motion.acceleration


    def predict_covariance(p: Covariance, q: float, dt: float) -> None:
        """(K2) P <- F P F' + q [[dt^5/20, dt^4/8, dt^3/6], [., dt^3/3, dt^2/2], [., ., dt]]."""
        h = 0.5 * dt
        p02 = p.p02 + dt * p.p12
        p.p00 += dt * (2.0 * p.p01 + dt * (p.p11 + p02 - h * p.p12 + 0.5 * h * dt * p.p22))
        p.p01 += dt * (p.p11 + p02 + h * (p.p12 + dt * p.p22))
        p.p02 = p02 + h * dt * p.p22
        p.p11 += dt * (2.0 * p.p12 + dt * p.p22)
        p.p12 += dt * p.p22
        noise = q * dt
        p.p22 += noise
        for part in (2.0, 3.0):
            noise *= dt
            if part == 2.0:
                p.p12 += noise / part
            else:
                p.p11 += noise / part
                p.p02 += noise / 6.0
        p.p01 += noise * dt / 8.0
        p.p00 += noise * dt * dt / 20.0


    def correct(motion: Motion, p: Covariance, innovation: float, variance: float) -> None:
        """(K3) S = P00 + R,  K = P H'/S;  (K4) x <- x + K e;  (K5) P <- (1 - K H) P."""
        S = p.p00 + variance
        K0, K1, K2 = p.p00 / S, p.p01 / S, p.p02 / S
        motion.position += K0 * innovation
        motion.velocity += K1 * innovation
        motion.acceleration += K2 * innovation
        p.p22, p.p12, p.p11 = p.p22 - K2 * p.p02, p.p12 - K1 * p.p02, p.p11 - K1 * p.p01
        p.p02, p.p01, p.p00 = p.p02 - K0 * p.p02, p.p01 - K0 * p.p01, p.p00 - K0 * p.p00


    def start(state: State, design: Design, measurement: float) -> None:
        """Position from the reading; speed and acceleration are not known."""
        fresh = Motion()
        fresh.position = measurement
        state.motion.take(fresh)
        p = state.p
        p.p00, p.p11, p.p22 = design.variance, 1e4, UNKNOWN
        p.p01 = p.p02 = p.p12 = 0.0
        state.samples = 1


    def update(state: State, design: Design, stamp_ns: int, measurement: float) -> bool:
        """Take one reading through guard and filter; return True if it was used."""
        if not math.isfinite(measurement) or stamp_ns <= state.last_ns:
            state.dropped += 1
            return False
        dt = 1e-9 * (stamp_ns - state.last_ns)
        state.last_ns = stamp_ns
        if state.samples == 0 or dt > design.gap:
            start(state, design, measurement)
            return True
        predict_motion(state.motion, dt)
        predict_covariance(state.p, design.density, dt)
        innovation = wrap(measurement - state.motion.position, design.period)
        correct(state.motion, state.p, innovation, design.variance)
        state.samples += 1
        return True


    def batch(
        state: State,
        design: Design,
        stamps: NDArray[np.int64],
        readings: NDArray[np.float64],
        velocity: NDArray[np.float64],
        used: NDArray[np.bool_],
        count: int,
    ) -> int:
        n = 0
        for k in range(count):
            used[k] = update(state, design, stamps[k], readings[k])
            velocity[k] = state.motion.velocity if used[k] else math.nan
            n += int(used[k])
        return n
'''


@pytest.mark.long
def test_a_kalman_filter_is_equal_to_the_last_bit(tmp_path):
    kalman = write(tmp_path, 'textbook_kalman', TEXT)
    text, library = build(tmp_path, ('textbook_kalman', 'batch', {}, 'kalman_batch'))
    rng, count = np.random.default_rng(1), 20_000
    stamps = np.cumsum(rng.integers(900_000, 1_100_000, count)) + 1_000_000_000
    stamps[5000:] += 300_000_000  # a gap
    stamps[7000:7010] -= 50_000_000  # late ones
    readings = np.round(np.sin(1.3e-8 * stamps) / 0.0015) * 0.0015 + 2e-9 * stamps
    readings = (readings + np.pi) % (2 * np.pi) - np.pi
    readings[[100, 9000]] = np.nan, np.inf
    design = kalman.Design()
    design.density, design.variance, design.period, design.gap = 1e3, 1.9e-7, 2 * math.pi, 0.2

    state, velocity, used = kalman.State(), [0.0] * count, [False] * count
    columns = stamps.tolist(), readings.tolist(), velocity, used
    taken = kalman.batch(state, design, *columns, count)

    records = np.zeros(1, kalman.State.dtype), np.zeros(1, kalman.Design.dtype)
    design.write(records[1][0])
    out = np.zeros(count), np.zeros(count, bool)
    pointers = [array.ctypes.data for array in (*records, stamps, readings, *out)]
    assert library.kalman_batch(*pointers, count) == taken > count - 100
    assert repr(kalman.State.read(records[0][0])) == repr(state)
    assert out[0].tobytes() == np.array(velocity).tobytes() and out[1].tolist() == used
    assert state.dropped > 2
    assert '    double S = p->p00 + variance;\n    double K0 = p->p00 / S;\n' in text
    assert 'static const double UNKNOWN = 1000000.0;  // [rad/s^2] squared\n' in text
