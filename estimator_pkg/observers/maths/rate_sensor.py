# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A rate from another sensor of the joint, whose bias the angle shows.

    x' = r w + b + noise,   b' = random walk,   y = x + noise,   v = r w + b

The value w drives the filter, as a gyro drives that of an attitude (Farrenkopf, "Analytic
steady-state accuracy solutions for two common spacecraft attitude estimators", J. Guidance and
Control 1(4), 1978). Between two values w is a straight line.

The speed has the filtered value: level and slope, with the gain K = P/S. The variance S = P + R of
the innovations is measured (Mehra 1970), and R follows from third differences of the values. After
the newest value the speed goes on with the slope; its variance grows by the slope's error x age.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from estimator_pkg.circle import wrap
from estimator_pkg.sensor.scatter import Scatter, begin_scatter, follow_scatter, resume_scatter

UNKNOWN_BIAS = 0.5  # standard deviation of the bias before the first angle [rad/s]
BIAS_WALK = 3e-4  # of the bias [rad/s per square root of a second]
SLOPE_TIME = 0.01  # time over which the slope of the values is averaged [s]
MEMORY = 200.0  # values over which the innovations are averaged
LEAST_GAIN = 0.3  # of a value: R and S are not known better
PROPORTIONAL = 0.8  # squared correlation of two speeds, one of which is a multiple of the other
SAME_RATIO = 0.25  # a multiple that differs less is no other ratio


class Angle(NamedTuple):
    """A reading of the joint's angle [rad], and its variance [rad^2]."""

    stamp_ns: int
    angle: float
    variance: float


def reach(age: float) -> float:
    """Return the time that an error of the slope acts, with the age of the slope itself [s].

    The slope is that of `SLOPE_TIME` before; meanwhile it changes, half of the age later.
    """
    return age * (1.0 + 0.5 * age / SLOPE_TIME)


class RateSensor:
    """A Kalman filter of z = (x, b): the angle by the sensor [rad], and its bias [rad/s].

    Parameters
    ----------
    ratio : r, the joint's motion over that of the sensor. period : wrap period [rad]; 0: none.

    Attributes
    ----------
    z, P : the state and its covariance.
    value, stamp_ns : w, the newest value [its unit], and its time; 0: none yet.
    """

    def __init__(self, ratio: float, period: float) -> None:
        self.ratio, self.period = ratio, period
        self.z, self.P = np.zeros(2), np.diag([0.0, UNKNOWN_BIAS**2])
        self.value, self.stamp_ns = 0.0, 0
        self._noise, self._R = Scatter(), 0.0  # of the values
        self._level, self._slope, self._K = 0.0, 0.0, 1.0  # [its unit], [per second], gain
        self._count = self._S = self._reach = 0.0  # of the innovations: number and mean squares

    def start(self, stamp_ns: int, value: float, angle: float, variance: float) -> None:
        """Start at a value, with the joint's angle then [rad] and its variance [rad^2]."""
        self.z[0] = angle
        self.P = np.diag([variance, self.P[1, 1]])
        self.value, self.stamp_ns, self._slope = value, stamp_ns, 0.0
        self._level, self._K = value, 1.0
        if self._count:
            resume_scatter(self._noise, value)
        else:
            begin_scatter(self._noise, value)

    def take(
        self, stamp_ns: int, value: float, angles: Iterable[Angle], variance: float = 0.0
    ) -> list[float]:
        """Take a value, and the angles between the last value and this one; return their NIS.

        Parameters
        ----------
        variance : of the value; 0: estimated from the scatter of the values.
        """
        dt = (stamp_ns - self.stamp_ns) * 1e-9
        follow_scatter(self._noise, value, dt, math.inf)
        self._R = variance or self._noise.variance
        begin, found = 0.0, []
        for each in angles:
            end = (each.stamp_ns - self.stamp_ns) * 1e-9
            self._predict(begin, end, value, dt)
            found.append(self._correct(each.angle, each.variance))
            begin = end
        self._predict(begin, dt, value, dt)
        self._filter(value, dt)
        self.value, self.stamp_ns = value, stamp_ns
        return found

    def _predict(self, begin: float, end: float, value: float, dt: float) -> None:
        """Move x by the values, from `begin` to `end` after the last of them [s].

        The next value comes `dt` after it.
        """
        passed, slope = end - begin, (value - self.value) / dt
        moved = self.ratio * (self.value + 0.5 * slope * (begin + end)) * passed
        bent = self.slope_variance * dt * dt / 12.0  # of the motion between two values
        F = np.array([[1.0, passed], [0.0, 1.0]])
        Q = np.array([(self.noise_variance + bent) * dt, BIAS_WALK**2]) * passed
        self.z = F @ self.z + (moved, 0.0)
        self.P = F @ self.P @ F.T + np.diag(Q)

    def _correct(self, angle: float, R: float) -> float:
        """Correct by an angle [rad]; return its normalised innovation squared."""
        H = np.array([1.0, 0.0])
        nu = angle - float(H @ self.z)
        if self.period:
            nu = wrap(nu, self.period)
        S = float(H @ self.P @ H) + R
        K = self.P @ H / S
        self.z = self.z + K * nu
        self.P = self.P - np.outer(K, H @ self.P)
        return nu * nu / S

    def _filter(self, value: float, dt: float) -> None:
        """Correct level and slope by a value."""
        predicted = self._level + self._slope * dt
        nu = value - predicted
        self._count = min(self._count + 1.0, MEMORY)
        self._S += (nu * nu - self._S) / self._count
        self._reach += (reach(dt) ** 2 - self._reach) / self._count
        self._K = max(1.0 - self._R / self._S, LEAST_GAIN) if self._S > 0.0 else 1.0
        self._level = predicted + self._K * nu
        self._slope += nu / max(dt, SLOPE_TIME)

    @property
    def noise_variance(self) -> float:
        """Variance of a value's noise, as a speed of the joint [(rad/s)^2]."""
        return self.ratio * self.ratio * self._R

    @property
    def slope_variance(self) -> float:
        """Variance of the slope's error, as an acceleration of the joint [(rad/s^2)^2]."""
        mean = (self._S - self._R - self._K * self._R) / self._reach if self._count else 0.0
        return self.ratio * self.ratio * max(mean, 0.0)

    def speed(self, age: float) -> tuple[float, float]:
        """Return the joint's speed [rad/s] and its variance, `age` [s] after the newest value."""
        v = self.ratio * (self._level + self._slope * age) + float(self.z[1])
        variance = self._K * self.noise_variance + float(self.P[1, 1])
        return v, variance + self.slope_variance * reach(age) ** 2


class Comparison:
    """Least squares of the joint's speed over that by a sensor, which name what is wrong with it.

    Parameters
    ----------
    ratio : of the sensor, as it is set.
    """

    def __init__(self, ratio: float) -> None:
        self.ratio = ratio
        self._mm = self._mv = self._vv = self._largest = 0.0
        self._pair = math.nan, math.nan, math.nan

    def add(self, measured: float, speed: float, sigma: float) -> None:
        """Take a speed by the sensor and by the angle, with the latter's deviation [rad/s]."""
        self._mm += measured * measured
        self._mv += measured * speed
        self._vv += speed * speed
        if abs(measured - speed) >= self._largest * sigma:
            self._largest = abs(measured - speed) / sigma
            self._pair = measured, speed, sigma

    def text(self) -> str:
        """Return what is wrong with the sensor."""
        measured, speed, sigma = self._pair
        said = (
            f'it measured {measured:.4g} rad/s, the angle showed {speed:.4g} +- {sigma:.2g} rad/s'
        )
        if self._mv * self._mv > PROPORTIONAL * self._mm * self._vv:
            factor = self._mv / self._mm
            if abs(factor + 1.0) < SAME_RATIO:
                return f'its sign is reversed ({said})'
            if abs(factor - 1.0) > SAME_RATIO:
                times = f'it measures {1.0 / factor:.3g} times the speed of the angle'
                return f'its ratio is about {self.ratio * factor:.3g} ({times})'
        return f'it contradicts the angle ({said}); check its joint, ratio and delay'
