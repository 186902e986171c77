# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Wheel odometry: twist and pose of a base from its wheels and a gyro, with covariances.

    v = (vr + vl) / 2,   w = (vr - vl) / b                                                    (1)
    x' = v cos(yaw),   y' = v sin(yaw),   yaw' = w                                            (2)

Two paths are followed: one by the wheels, one with the yaw rate of the gyro. While both agree, a
Kalman filter corrects the second one and the gyro's bias by the turns of the wheels, and it is
published. Cumulative sums of its normalised innovations (Page 1954) detect a contradiction. Then
nothing is learnt, and the middle of both is published with the covariance union (Uhlmann 2003):

    u = (x1 + x2) / 2,   U = P1 + P2 + (x1 - x2) (x1 - x2)' / 4                               (3)
"""

from __future__ import annotations

import math
from collections import deque
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimator_pkg.observers.angle.edge import EdgeAdaptive
from estimator_pkg.parameters import structural
from estimator_pkg.sensor.scatter import Scatter, begin_scatter, follow_scatter

WINDOW = 0.25  # time over which the turns of wheels and gyro are compared [s]
CUSUM_SLACK, CUSUM_ALARM = 0.5, 10.0  # [deviations]: a false alarm in some hours
LEARNING_GATE = 9.0  # squared deviations of a window that teaches the bias
RATE_GATE = 25.0  # squared deviations of two rates that contradict each other
UNKNOWN_BIAS = 0.05  # standard deviation of the bias before the first value [rad/s]
BIAS_WALK = 3e-4  # of the bias [rad/s per square root of a second]
STAMP_ERROR = 0.01  # of the gyro's stamps, and of the wheels' delay [s]
GYRO_SILENT, GYRO_ABSENT = 0.5, 3.0  # times without a value, and without the first one [s]
STUCK_VALUES = 25  # equal values of a gyro that contradicts the wheels
STANDSTILL = 2.0  # the gyro turns for so long while the wheels stand [s]
UNIT_TIME, UNIT_TURNS = 2.0, 0.05  # time [s] and sum of squared turns [rad^2] that show it
CONTRADICTION = 'wheels and gyro contradict: slip, gyro, or wheels_left/right'
UNIT = 'it is in another unit'


class WheelObserver(EdgeAdaptive):
    """`edge_adaptive` on each wheel."""

    name = 'wheel_odometry'
    kind = 'wheels'
    summary = 'edge_adaptive on the wheels of a base: odometry with covariances, slip named'
    reference = 'docs/wheel_odometry.md: Chong and Kleeman 1997, Borenstein and Feng 1996'

    @classmethod
    def bound(cls, gains: Any) -> type[EdgeAdaptive]:
        """Return the observer of a wheel."""
        return EdgeAdaptive


Array = NDArray[np.float64]


@dataclass(frozen=True)
class Geometry:
    """The base, and how well it is known."""

    radius: tuple[float, ...] | None = structural(
        None,
        kind=list,
        unit='m',
        range=(1e-4, 100.0),
        description='radius of the wheels, or of those on the left and on the right; must be set',
    )
    track: float | None = structural(
        None,
        unit='m',
        range=(1e-3, 100.0),
        description='effective distance of left and right wheels, with skid steering 1.2 to 2 '
        'times the geometric one; must be set',
    )
    radius_stddev: float = structural(
        0.0, range=(0.0, 1.0), description='standard deviation of each radius, relative; 0: exact'
    )
    track_stddev: float = structural(
        0.0, range=(0.0, 1.0), description='standard deviation of the track, relative; 0: exact'
    )
    travel_noise: float = structural(
        0.003,
        unit='m',
        range=(0.0, 1.0),
        description='standard deviation of the distance of a wheel on 1 m of ground; it grows with '
        'the root of the distance',
    )


X, Y, YAW, BIAS, LEFT, RIGHT, TRACK, SLIP, STATES = range(9)
POSE, RADII = slice(X, BIAS), slice(LEFT, TRACK)


def arc(distance: float, turn: float, yaw: float) -> tuple[Array, Array]:
    """Return an arc's x, y, yaw, and its derivatives by distance and turn, shape (3, 2).

    The chord is exact; its derivative by the turn is that of a small one.
    """
    chord, middle = float(np.sinc(turn / (2.0 * math.pi))), yaw + 0.5 * turn
    c, s = chord * math.cos(middle), chord * math.sin(middle)
    by = np.array([[c, -0.5 * distance * s], [s, 0.5 * distance * c], [0.0, 1.0]])
    return np.array([distance * c, distance * s, turn]), by


class Path:
    """A path, and the constant errors that act along all of it.

    Attributes
    ----------
    x : x [m], y [m], yaw [rad], bias of the gyro [rad/s]; then zeros for the relative errors of
        left radius, right radius and track, and for slip. p : covariance, shape (8, 8).
    """

    def __init__(self, stddevs: Array) -> None:
        self.x, self.p = np.zeros(STATES), np.diag(stddevs**2)

    def move(self, moved: Array, by: Array, noise: Array) -> None:
        """Follow an arc (Chong and Kleeman 1997).

        Parameters
        ----------
        moved : distance [m] and turn [rad]. by : their derivatives by the state, shape (2, 8).
        noise : their covariance.
        """
        step, on = arc(moved[0], moved[1], self.x[YAW])
        f = np.eye(STATES)
        f[:YAW, YAW] = -step[1], step[0]
        f[POSE] += on @ by
        self.p = f @ self.p @ f.T
        self.p[POSE, POSE] += on @ noise @ on.T
        self.x[POSE] += step

    def learn(self, h: Array, innovation: float, noise: float) -> None:
        """Correct pose and bias by a measurement h x; consider the rest (Schmidt 1966)."""
        gain = self.p @ h / (h @ self.p @ h + noise)
        gain[LEFT:] = 0.0
        keep = np.eye(STATES) - np.outer(gain, h)
        self.x += gain * innovation
        self.p = keep @ self.p @ keep.T + noise * np.outer(gain, gain)

    def set_bias(self, bias: float = 0.0, variance: float = UNKNOWN_BIAS**2) -> None:
        """Replace what is learnt of the bias."""
        self.p[BIAS] = self.p[:, BIAS] = 0.0
        self.x[BIAS], self.p[BIAS, BIAS] = bias, variance


class Gyro:
    """The values of a gyro, brought to the times of the wheels' messages.

    Attributes
    ----------
    stamp_ns : of the newest value; 0: none. equal : number of equal values in a row.
    rate, variance : at the newest message [rad/s].
    turn, noise : its integral since the message before [rad], and its variance.
    """

    def __init__(self) -> None:
        self._queue, self._scatter = deque[tuple[int, float]](maxlen=4096), Scatter()
        self.stamp_ns = self.equal = 0
        self._value = self._angle = self._at = self._spacing = 0.0

    def receive(self, stamp_ns: int, value: float) -> None:
        """Take a value [rad/s]; it counts from the next message of the wheels on."""
        if math.isfinite(value):
            self._queue.append((stamp_ns, value))

    def follow(self, stamp_ns: int, dt: float, acceleration: float) -> None:
        """Take the values up to a message of the wheels.

        Parameters
        ----------
        dt : since the message before [s]. acceleration : of the yaw, by the wheels [rad/s^2].
        """
        while self._queue and self._queue[0][0] <= stamp_ns:
            self._take(*self._queue.popleft())
        ahead = (stamp_ns - self.stamp_ns) * 1e-9
        self.rate = self._value + acceleration * ahead
        self.variance = self._scatter.variance + (acceleration * (ahead + STAMP_ERROR)) ** 2
        before, self._at = self._at, self._angle + 0.5 * (self._value + self.rate) * ahead
        self.turn, self.noise = self._at - before, self._scatter.variance * self._spacing * dt

    def _take(self, stamp_ns: int, value: float) -> None:
        dt = (stamp_ns - self.stamp_ns) * 1e-9
        if dt <= 0.0:
            return
        if dt > GYRO_SILENT:
            begin_scatter(self._scatter, value)
            self._angle = self._at = 0.0
        else:
            follow_scatter(self._scatter, value, dt, math.inf)
            self._angle += 0.5 * (self._value + value) * dt
            self._spacing = dt
        self.equal = self.equal + 1 if value == self._value else 0
        self.stamp_ns, self._value = stamp_ns, value


class WheelOdometry:
    """The base: pass it the joints of each message, read twist and pose.

    Attributes
    ----------
    gyro : None: there is none. rejected : why it is not used; '': it is used.
    pose, covariance : x [m], y [m], yaw [rad], shapes (3,), (3, 3).
    twist, twist_covariance : x [m/s], yaw [rad/s], shapes (2,), (2, 2).
    doubt : wheels and gyro contradict each other. doubts : number of times. notices : new texts.
    """

    def __init__(self, geometry: Geometry, gyro: bool, period: float, outage: float) -> None:
        """`period` : of the angles [rad], 0: none. outage : longest gap [s]."""
        self._geometry, self._period, self._outage = geometry, period, outage
        self._track = geometry.track or math.nan
        self._radii = np.ones(2) * (geometry.radius or math.nan)
        self._to_base = np.array([[0.5, 0.5], np.array([-1.0, 1.0]) / self._track])  # (1)
        radii, track = (geometry.radius_stddev,) * 2, geometry.track_stddev
        self._stddevs = np.array([0.0, 0.0, 0.0, UNKNOWN_BIAS, *radii, track, 1.0])
        self.gyro = Gyro() if gyro else None
        self.notices, self.doubts = list[str](), 0
        self.reset()

    def reset(self) -> None:
        """Begin at pose zero; the bias of the gyro is forgotten."""
        self._by_wheels, self._by_gyro = Path(self._stddevs), Path(self._stddevs)
        self.pose, self.covariance = np.zeros(3), np.zeros((3, 3))
        self.twist, self.twist_covariance = np.zeros(2), np.zeros((2, 2))
        self._joints: Array | None = None
        self._stamp_ns, self.doubt, self.rejected = 0, False, ''
        self._cusum, self._agreed_ns = np.zeros(2), 0  # of both signs; when it was zero
        self._known_ns, self._known = 0, UNKNOWN_BIAS**2  # last standstill; the bias's variance
        self._standing, self._products = 0.0, np.zeros(3)
        self._window = np.zeros(9)  # time, sides, turn by the gyro, its noise; rate and ends before

    def update(self, stamp_ns: int, ages: ArrayLike, wheels: ArrayLike) -> None:
        """Take the newest estimate of each wheel.

        Parameters
        ----------
        stamp_ns : of the newest one. ages : before this stamp [s], shape (n,).
        wheels : position [rad], velocity, acceleration (nan: unknown), and standard deviations of
            position and velocity, left wheels first, shape (n, 5).
        """
        joints, ages = np.nan_to_num(wheels), np.asarray(ages)
        joints[:, 0] += joints[:, 1] * ages
        joints[:, 1] += joints[:, 2] * ages
        joints[:, 3:] = np.hypot(joints[:, 3:], joints[:, [4, 2]] * ages[:, None])
        if stamp_ns < self._stamp_ns:  # the clock was set back
            self._joints, self.gyro = None, self.gyro and Gyro()
            self._window[:] = 0.0
        if self._joints is None:
            self._stamp_ns = self._agreed_ns = self._known_ns = stamp_ns
        dt, self._stamp_ns = (stamp_ns - self._stamp_ns) * 1e-9, stamp_ns
        to_base, (sides, ground) = self._to_base, self._travelled(joints, dt)
        _, speeds, accelerations, positions, sigmas = (
            self._radii * joints.reshape(2, -1, 5).mean(axis=1).T
        )  # as if the errors of wheels on one side were equal
        walk, ends = (to_base * each @ to_base.T for each in (ground, positions**2))
        by = self._by_geometry(speeds)
        self.twist = to_base @ speeds
        self.twist_covariance = to_base * sigmas**2 @ to_base.T + by * self._stddevs**2 @ by.T
        self._by_wheels.move(to_base @ sides, self._by_geometry(sides), walk)
        if self.gyro is not None:
            self._follow_gyro(self.gyro, dt, sides, walk, ends, to_base[1] @ accelerations)
        self.pose, self.covariance = self._union()
        on = arc(0.0, 0.0, self.pose[YAW])[1]
        self.covariance += on @ ends @ on.T  # the newest positions: their errors do not add up

    def _since(self, stamp_ns: int) -> float:
        """Return the time since a stamp [s]."""
        return (self._stamp_ns - stamp_ns) * 1e-9

    def _travelled(self, joints: Array, dt: float) -> tuple[Array, Array]:
        """Return what left and right wheels travel [m], and its variances by the ground."""
        before, self._joints = self._joints, joints
        if before is None:
            return np.zeros(2), np.zeros(2)
        turned = joints[:, 0] - before[:, 0]
        if self._period:
            expected = 0.5 * (joints[:, 1] + before[:, 1]) * dt
            turned += self._period * np.round((expected - turned) / self._period)
        sides = self._radii * turned.reshape(2, -1).mean(axis=1)
        ground = self._geometry.travel_noise**2 * np.abs(sides)
        if dt > self._outage and self._period:
            self.notices.append(f'no wheel for {dt:.3g} s: turns in it are not in the pose')
            ground += (self._radii * self._period) ** 2
        return sides, ground

    def _by_geometry(self, sides: Array) -> Array:
        """Return the derivatives of distance and turn by the state, shape (2, 8)."""
        by = np.zeros((2, STATES))
        by[:, RADII] = self._to_base * sides
        by[1, TRACK] = -self._to_base[1] @ sides
        return by

    def _follow_gyro(
        self, gyro: Gyro, dt: float, sides: Array, walk: Array, ends: Array, acceleration: float
    ) -> None:
        """Follow the path by the gyro, and correct the twist, which is that by the wheels.

        Parameters
        ----------
        sides : travelled by the wheels [m]. walk, ends : covariances of distance and turn by the
        ground, and by the newest positions. acceleration : of the yaw [rad/s^2].
        """
        gyro.follow(self._stamp_ns, dt, acceleration)
        silent = self._since(gyro.stamp_ns or self._known_ns)
        if silent > (GYRO_SILENT if gyro.stamp_ns else GYRO_ABSENT):
            self._reject(f"it is silent for {silent:.2g} s: check 'gyro_topic'")
        if silent > GYRO_SILENT or not gyro.stamp_ns:
            self._window[:] = 0.0
            self._continue_by_wheels()
            return
        path, twist, covariance = self._by_gyro, self.twist, self.twist_covariance
        by_wheels, of_wheels = float(twist[1]), float(covariance[1, 1])
        apart = by_wheels - (gyro.rate - path.x[BIAS])
        if not self.rejected:
            by = self._by_geometry(sides)
            by[0, SLIP] = 0.5 * self._track * apart * dt * self.doubt  # wheels of one side slip
            by[1] = 0.0
            by[1, BIAS] = -dt
            moved = np.array([sides.mean(), gyro.turn - path.x[BIAS] * dt])
            path.move(moved, by, np.diag([walk[0, 0], gyro.noise]))
            of_gyro = gyro.variance + path.p[BIAS, BIAS]
            covariance[0, 1] = covariance[1, 0] = 0.0
            if self.doubt or apart**2 > RATE_GATE * (of_wheels + of_gyro):  # (3)
                twist[1] -= 0.5 * apart
                covariance[1, 1] = of_wheels + of_gyro + 0.25 * apart**2
                covariance[0, 0] += (0.5 * self._track * apart) ** 2
            else:
                gain = of_wheels / (of_wheels + of_gyro)
                twist[1] -= gain * apart
                since = max(self._since(self._agreed_ns), WINDOW)
                drift = (self._by_wheels.x[YAW] - path.x[YAW]) / since  # not yet detected
                covariance[1, 1] = gain * of_gyro + drift**2
        self._window[:6] += dt, *sides, gyro.turn, walk[1, 1], gyro.noise
        if self._window[0] >= WINDOW:
            self._compare(gyro, by_wheels, np.diag(ends))
        if not 0.0 < self._window[0] < WINDOW:
            self._window = np.array([0.0] * 6 + [by_wheels, *np.diag(ends)])

    def _compare(self, gyro: Gyro, rate: float, ends: Array) -> None:
        """Compare the turns of wheels and gyro in a window; learn if they agree.

        Parameters
        ----------
        rate, ends : at the end of the window: yaw rate by the wheels [rad/s]; variances of distance
            and turn by the newest positions.
        """
        path, (time, *sides, by_gyro, walk, white, rate_before) = self._by_gyro, self._window[:7]
        distance, turn = self._to_base @ sides
        ends = ends + self._window[7:]
        noise = walk + white + ends[1] + (STAMP_ERROR * (rate - rate_before)) ** 2
        still = distance**2 < 9.0 * ends[0] and turn**2 < 9.0 * ends[1]
        h = -self._by_geometry(np.array(sides))[1]
        h[BIAS] = time
        path.p[BIAS, BIAS] += BIAS_WALK**2 * time
        innovation = by_gyro - turn - h @ path.x
        z = innovation / math.sqrt(h @ path.p @ h + noise)
        if still and z**2 > LEARNING_GATE and not self.rejected:
            # The bias has changed at an unknown time since the last standstill.
            half = 0.5 * innovation / time * self._since(self._known_ns)
            path.x[YAW] -= half
            path.p[YAW, YAW] += half**2
            path.set_bias()
            innovation = by_gyro - turn
            z = innovation / math.sqrt(h @ path.p @ h + noise)
        agrees = z**2 < LEARNING_GATE
        self._cusum = np.clip(self._cusum + (z, -z) - CUSUM_SLACK, 0.0, CUSUM_ALARM)
        if agrees and not self.rejected:
            if not self.doubt or still:
                path.learn(h, innovation, noise)
            if still:
                self._cusum[:] = 0.0
                self._known_ns, self._known = self._stamp_ns, path.p[BIAS, BIAS]
        self._standing = self._standing + time if still and not agrees else 0.0
        if self._standing > STANDSTILL:
            self._reject(f'it turns at {by_gyro / time:.3g} rad/s while the wheels stand')
        if gyro.equal >= STUCK_VALUES and not agrees:
            self._reject(f'it is stuck at {gyro.rate:.3g} rad/s')
        self._decide(turn, by_gyro, time)

    def _decide(self, turn: float, by_gyro: float, time: float) -> None:
        """Begin or end a contradiction or a rejection, after these turns [rad] in a time [s]."""
        path, highest = self._by_gyro, self._cusum.max()
        if self.rejected:
            if highest == 0.0 and not self.rejected.startswith(UNIT):
                self.rejected = ''
                self._continue_by_wheels()
        elif highest == 0.0:
            if self.doubt:
                path.x[POSE], path.p[POSE, POSE] = self._union()
            self._by_wheels = deepcopy(path)
            self.doubt, self._agreed_ns = False, self._stamp_ns
        elif highest >= CUSUM_ALARM and not self.doubt:
            self.doubt, self.doubts, self._products = True, self.doubts + 1, np.zeros(3)
            known = self._known + BIAS_WALK**2 * self._since(self._known_ns)
            path.set_bias(path.x[BIAS], known)  # what moving wheels taught is in doubt, too
            self.notices.append(
                f'{CONTRADICTION} (the wheels turn the base at {turn / time:.3g} rad/s, the gyro '
                f'at {by_gyro / time:.3g})'
            )
        if self.doubt:
            self._products += turn**2, turn * by_gyro, by_gyro**2
            of_wheels, product, of_gyro = self._products
            alike = product**2 > 0.9 * of_wheels * of_gyro
            if alike and of_wheels > UNIT_TURNS and self._since(self._agreed_ns) > UNIT_TIME:
                ratio = product / of_wheels
                if abs(abs(math.log(abs(ratio))) - math.log(math.degrees(1.0))) < 0.3:
                    self._reject(
                        f'{UNIT}: it shows {ratio:.3g} times the turns of the wheels: check '
                        "'gyro_ratio'"
                    )

    def _union(self) -> tuple[Array, Array]:
        """Return pose and covariance, by (3) in a contradiction."""
        wheels, path = self._by_wheels, self._by_gyro
        if self.gyro is None or self.rejected:
            return wheels.x[POSE].copy(), wheels.p[POSE, POSE].copy()
        apart, covariance = wheels.x[POSE] - path.x[POSE], path.p[POSE, POSE]
        if not self.doubt:
            return path.x[POSE].copy(), covariance + np.outer(apart, apart)
        covariance = covariance + wheels.p[POSE, POSE] + 0.25 * np.outer(apart, apart)
        return path.x[POSE] + 0.5 * apart, covariance

    def _reject(self, why: str) -> None:
        """Use the wheels alone, until the gyro agrees with them again."""
        if not self.rejected:
            self.rejected, self.doubt = why, False
            self._cusum[:] = CUSUM_ALARM
            self._continue_by_wheels()
            self.notices.append(f'the gyro is not used: {why}')

    def _continue_by_wheels(self) -> None:
        """Continue the path by the gyro at that of the wheels, with an unknown bias."""
        self._by_gyro, self._agreed_ns = deepcopy(self._by_wheels), self._stamp_ns
        self._by_gyro.set_bias()

    def text(self) -> str:
        """Return pose, contradictions and what is known of the gyro, for people."""
        if not self._stamp_ns:
            return 'no message has had all wheels yet'
        x, y, yaw = self.pose.tolist()
        found = f'x {x:.4g} m, y {y:.4g} m, yaw {yaw:.4g} rad'
        if self.gyro is None:
            return found
        found += f'; contradictions {self.doubts}'
        if self.rejected:
            return f'{found}; the gyro is not used: {self.rejected}'
        if self.doubt:
            return f'{found}; now: {CONTRADICTION}'
        bias, sigma = self._by_gyro.x[BIAS], math.sqrt(self._by_gyro.p[BIAS, BIAS])
        return f'{found}; gyro used, bias {bias:.4g} +- {sigma:.1g} rad/s'
