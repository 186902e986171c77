# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A base on wheels: twist and pose with covariances, from its wheels and a gyro.

    v = (vr + vl) / 2,   w = (vr - vl) / b,   vl = rl wl,   vr = rr wr

The pose follows arcs of constant twist. Its covariance grows by the variance of each arc (Chong and
Kleeman 1997), and by constant errors, which are states of one filter with the pose: the wheels turn
the base by r I + b T + g W + e D in a window, I is the integral of the gyro, T the time, W the
change of its value, D the distance. r is the true over the given track, -b / r the bias, g / r the
delay, e the difference of the radii over the track. s is the error of the mean radius. Windows in
which wheels and gyro agree teach r, b, g and e. Where they do not agree, wheels slip.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UsageError
from estimator_pkg.observers.angle.edge import observer as edge_adaptive
from estimator_pkg.parameters import structural
from estimator_pkg.sensor.scatter import Scatter, begin_scatter, follow_scatter

LEARNING_WINDOW = 0.5  # shortest time over which gyro and wheels are compared to learn [s]
PROOF_WINDOWS, PROOF_TURN = 4, 0.2  # windows and turns [rad] that agree, before the gyro is used
RELEARNT_AFTER = 10  # windows in a row that do not agree, after which the gyro is learnt again
PRIOR_DEVIATIONS = (0.1, 1.0, 0.02, 0.005)  # of track, bias [rad/s], delay [s] and radii
ERROR_WALK = np.array([1e-6, 1e-8, 0.0, 0.0, 0.0])  # of the constant errors: variances per second
GATE = 25.0  # squared deviations of a window that does not agree
SLIP_BEGINS, SLIP_ENDS = 0.05, 0.25  # time without, and with agreement [s]
STANDSTILL = 2.0  # the gyro contradicts wheels at rest for so long [s]: its bias has changed
GYRO_SILENT = 0.5  # time without a value, after which the gyro is silent [s]
STUCK_VALUES = 25  # equal values of a gyro that contradicts the wheels, after which it is stuck
SIDE_CORRELATION = 0.5  # of the errors of two speeds of a side: 0 to 0.5 in simulation
NOTICE_INTERVAL = 10.0  # shortest time between two notices of slip [s]
PREDICTION_WEIGHT = 0.02  # of one value in the mean square error of its prediction by the wheels
GYRO_QUEUE = 4096  # values of the gyro that wait for the wheels at most
SMALL_TURN = 1e-4  # angle [rad] below which an arc is its series

OBSERVER = replace(
    edge_adaptive.OBSERVER,
    name='wheel_odometry',
    kind='wheels',
    summary='edge_adaptive on the wheels of a base: odometry with covariances, slip named',
    reference='docs/wheel_odometry.md: Chong and Kleeman 1997, Borenstein and Feng 1996',
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Geometry:
    """The wheels and where they are."""

    wheels_left: tuple[str, ...] = structural(
        ('wheel_left_joint',), description='names of the wheel joints on the left, one or two'
    )
    wheels_right: tuple[str, ...] = structural(
        ('wheel_right_joint',), description='names of the wheel joints on the right, as many'
    )
    radius: tuple[float, ...] | None = structural(
        None,
        kind=list,
        unit='m',
        range=(1e-4, 100.0),
        description='radius of the wheels, or of those on the left and on the right; must be set',
    )
    track: float | None = structural(
        None, unit='m', range=(1e-3, 100.0), description='from left to right wheels; must be set'
    )
    slip_factor: float = structural(
        1.0, range=(0.1, 10.0), description='effective over geometric track: skid steering 1.2 to 2'
    )
    steering: str = structural(
        '', description='steering joint of an Ackermann base, positive to the left; automatic: none'
    )
    wheelbase: float | None = structural(
        None, unit='m', range=(1e-3, 100.0), description='from front to rear axle, if steered'
    )
    radius_stddev: float = structural(
        0.0, range=(0.0, 1.0), description='of each radius, relative; 0: exact, with a gyro 0.005'
    )
    track_stddev: float = structural(
        0.0, range=(0.0, 1.0), description='of the track, relative; 0: exact, with a gyro 0.1'
    )
    steering_stddev: float = structural(
        0.001, unit='rad', range=(0.0, 1.0), description='of the zero of the steering joint'
    )
    travel_noise: float = structural(
        0.003,
        unit='m',
        range=(0.0, 1.0),
        description='standard deviation of the distance of a wheel on 1 m of ground; it grows with '
        'the root of the distance',
    )

    def check(self) -> None:
        """Raise UsageError for a base that is none."""
        for name, example in (('radius', '[0.05]'), ('track', '0.3'), ('wheelbase', '0.3')):
            if getattr(self, name) is None and (name != 'wheelbase' or self.steering):
                why = ", and 'steering' needs it" if name == 'wheelbase' else ''
                raise UsageError(f"parameter '{name}' is not set{why}: set it [m], as in {example}")
        left, right = len(self.wheels_left), len(self.wheels_right)
        if left != right or left > 2 or '' in self.names or len(set(self.names)) < len(self.names):
            raise UsageError(
                f"'wheels_left' has {left} names and 'wheels_right' {right} of the joints "
                f'{", ".join(map(repr, self.names))}: set one or two for each side, as many on '
                'both, each another joint'
            )
        if len(self.radius or ()) > 2:
            raise UsageError(
                f"'radius' has {len(self.radius or ())} numbers: set one, or left and right"
            )

    @property
    def names(self) -> tuple[str, ...]:
        """All joints."""
        steering = (self.steering,) if self.steering else ()
        return (*self.wheels_left, *self.wheels_right, *steering)

    @property
    def effective_track(self) -> float:
        """The track with which the base turns [m]."""
        return (self.track or math.nan) * self.slip_factor

    @property
    def twist(self) -> Array:
        """Distance and turn of the base by what left and right travel, shape (2, 2)."""
        return np.array([[0.5, 0.5], np.array([-1.0, 1.0]) / self.effective_track])


class Rate(NamedTuple):
    """A yaw rate [rad/s] and its variance."""

    value: float
    variance: float

    def agrees(self, other: Rate) -> bool:
        """Return True if both may be the same."""
        return (self.value - other.value) ** 2 < GATE * (self.variance + other.variance)

    def fused(self, other: Rate) -> Rate:
        """Return the mean of two independent rates, by their variances."""
        total = self.variance + other.variance
        share = other.variance / total if total > 0.0 else 0.5
        return Rate(share * self.value + (1.0 - share) * other.value, share * self.variance)


def arc(distance: float, turn: float, yaw: float) -> tuple[Array, Array]:
    """Return an arc's x, y, yaw, and its derivatives by distance and turn, shape (3, 2)."""
    if abs(turn) < SMALL_TURN:
        forward, left = 1.0 - turn * turn / 6.0, 0.5 * turn
        forward_by, left_by = -turn / 3.0, 0.5 - turn * turn / 8.0
    else:
        sine, cosine = math.sin(turn), math.cos(turn)
        forward, left = sine / turn, (1.0 - cosine) / turn
        forward_by, left_by = (cosine - forward) / turn, (sine - left) / turn
    c, s = math.cos(yaw), math.sin(yaw)
    along, across = c * forward - s * left, s * forward + c * left
    by = [
        [along, distance * (c * forward_by - s * left_by)],
        [across, distance * (s * forward_by + c * left_by)],
        [0.0, 1.0],
    ]
    return np.array([distance * along, distance * across, turn]), np.array(by)


class Learnt(NamedTuple):
    """Constant errors of the base and its gyro."""

    r: float  # true over given track
    b: float  # -r times the bias of the gyro [rad/s]
    g: float  # r times its delay [s]
    e: float  # difference of the radii over the track [1/m]
    s: float  # error of the mean radius, relative


class PoseFilter:
    """Pose and constant errors, with one covariance.

    Attributes
    ----------
    x : x [m], y [m], yaw [rad], r, b [rad/s], g [s], e [1/m], s, and 0 with variance 1, which
    carries the error by slip. p : covariance, shape (9, 9).
    """

    def __init__(self, geometry: Geometry, gyro: bool) -> None:
        of_track, bias, delay, of_radius = PRIOR_DEVIATIONS if gyro else (0.0, 0.0, 0.0, 0.0)
        track, of_track = geometry.effective_track, geometry.track_stddev or of_track
        half = 0.5 * (geometry.radius_stddev or of_radius) ** 2
        self._quarter = 0.25 * track**2
        self._prior = np.diag([of_track**2 + half, bias**2, delay**2, 4 * half / track**2, half])
        self._prior[0, 4] = self._prior[4, 0] = -half
        self.x, self.p = np.zeros(9), np.zeros((9, 9))
        self.p[8, 8] = 1.0
        self.forget()

    @property
    def pose(self) -> Array:
        """The newest pose: x [m], y [m], yaw [rad]."""
        return self.x[:3]

    @property
    def learnt(self) -> Learnt:
        """The constant errors."""
        return Learnt(*self.x[3:8].tolist())

    def forget(self) -> None:
        """Forget what is learnt."""
        self.p[3:8] = self.p[:, 3:8] = 0.0
        self.x[3:8], self.p[3:8, 3:8] = Learnt(1.0, 0.0, 0.0, 0.0, 0.0), self._prior

    def start(self) -> None:
        """Go on at pose zero."""
        self.x[:3] = self.p[:3] = self.p[:, :3] = 0.0

    def corrected(self, moved: Array) -> tuple[Array, Array]:
        """Return distance and turn by what is learnt, and derivatives by the state, (2, 9).

        Parameters
        ----------
        moved : both by the parameters; or speed and rate.
        """
        (distance, turn), (r, _, _, e, s) = moved, self.learnt
        found = np.array([distance * (1 + s) - self._quarter * e * turn, (turn - e * distance) / r])
        by = np.zeros((2, 9))
        by[0, 6:8] = -self._quarter * turn, distance
        by[1, 3], by[1, 6] = -found[1] / r, -distance / r
        return found, by

    def move(self, moved: Array, by: Array, walk: Array) -> None:
        """Follow an arc: distance and turn, their derivatives by the state, their covariance."""
        step, on = arc(moved[0], moved[1], self.pose[2])
        f = np.eye(9)
        f[:2, 2] = -step[1], step[0]
        f[:3] += on @ by
        self.p = f @ self.p @ f.T
        self.p[:3, :3] += on @ walk @ on.T
        self.x[:3] += step

    def learn(self, window: Array, noise: float) -> bool:
        """Learn from I, T, W, D and the turn of the wheels; return False if they do not agree.

        The pose does not jump: its gain is zero (Schmidt 1966).
        """
        h, gain = np.zeros(9), np.zeros(9)
        h[3:7] = window[:4]
        self.p[range(3, 8), range(3, 8)] += ERROR_WALK * window[1]
        innovation, c = window[4] - h @ self.x, self.p @ h
        s = h @ c + noise
        if innovation * innovation > GATE * s:
            return False
        gain[3:8] = c[3:8] / s
        keep = np.eye(9) - np.outer(gain, h)
        self.x += gain * innovation
        self.p = keep @ self.p @ keep.T + np.outer(gain, gain) * noise
        return True


class Gyro:
    """The values of a gyro, brought to the times of the wheels' messages.

    Attributes
    ----------
    now : value at the newest message, with its bias [rad/s]. ahead : its time from the newest value
    [s]. white, blur : variances of a value and of the acceleration. spacing : time between values
    [s].
    step : integral I [rad], time T [s], change W [rad/s] since the message before.
    equal : number of equal values in a row.
    """

    def __init__(self, ratio: float) -> None:
        self._ratio = ratio
        self.restart()

    def restart(self) -> None:
        """Begin without a value."""
        self._scatter, self._queue = Scatter(), deque[tuple[int, float]](maxlen=GYRO_QUEUE)
        self._stamp_ns, self._value, self._integral = 0, 0.0, 0.0
        self._acceleration = self._wrong = 0.0  # [rad/s^2], mean square [(rad/s)^2]
        self._here: tuple[float, float] | None = None  # integral and value at the newest message
        self.now = self.ahead = self.white = self.blur = self.spacing = 0.0
        self.step, self.equal = np.zeros(3), 0

    def receive(self, stamp_ns: int, value: float) -> None:
        """Take a value; it counts from the next message of the wheels on."""
        if math.isfinite(value):
            self._queue.append((stamp_ns, self._ratio * value))

    def follow(self, stamp_ns: int, dt: float, acceleration: float) -> bool:
        """Take the values up to a message of the wheels; return False if it is silent.

        Parameters
        ----------
        dt : since the message before [s]. acceleration : change of the yaw rate [rad/s^2].
        """
        while self._queue and self._queue[0][0] <= stamp_ns:
            self._take(*self._queue.popleft())
        self.ahead = ahead = (stamp_ns - self._stamp_ns) * 1e-9
        before, self._here = self._here, None
        if self.spacing == 0.0 or ahead > GYRO_SILENT:
            return False
        self._acceleration, self.white = acceleration, self._scatter.variance
        self.blur = max(0.0, self._wrong - 2.0 * self.white) / self.spacing**2
        self.now = self._value + acceleration * ahead
        self._here = here = self._integral + 0.5 * (self._value + self.now) * ahead, self.now
        if before is None:
            return False
        self.step = np.array([here[0] - before[0], dt, here[1] - before[1]])
        return True

    def _take(self, stamp_ns: int, value: float) -> None:
        dt = (stamp_ns - self._stamp_ns) * 1e-9
        if dt <= 0.0:
            return
        if self._stamp_ns == 0 or dt > GYRO_SILENT:
            begin_scatter(self._scatter, value)
            self._wrong = self.spacing = 0.0
        else:
            follow_scatter(self._scatter, value, dt, math.inf)
            change = value - self._value
            self.equal = self.equal + 1 if change == 0.0 else 0
            self._wrong += PREDICTION_WEIGHT * (
                (change - self._acceleration * dt) ** 2 - self._wrong
            )
            self._integral += 0.5 * (self._value + value) * dt
            self.spacing = dt
        self._stamp_ns, self._value = stamp_ns, value


class WheelOdometry:
    """The base: pass it the joints of each message, read twist and pose.

    Attributes
    ----------
    gyro : None: there is none. used : the gyro is used. pose, covariance : shapes (3,), (3, 3).
    twist, twist_covariance : x [m/s], yaw [rad/s], shape (2, 2); twist is None at the start.
    slips : what is seen while wheels slip; '': they do not. slipped : number of slips.
    notices : new texts for the user.
    """

    def __init__(self, geometry: Geometry, gyro: float, period: float, outage: float) -> None:
        """`gyro` : its ratio, 0: there is none. period : of angles. outage : longest gap [s]."""
        self._geometry, self._period, self._outage = geometry, period, outage
        self.gyro = Gyro(gyro) if gyro else None
        self._filter = PoseFilter(geometry, gyro != 0.0)
        count, radii = len(geometry.wheels_left), geometry.radius or (math.nan,)
        self._by_wheel = np.zeros((2, len(geometry.names)))  # what both sides travel [m/rad]
        self._by_wheel[0, :count] = radii[0] / count
        self._by_wheel[1, count : 2 * count] = radii[-1] / count
        self._to, self._squared = geometry.twist, self._by_wheel**2
        self.notices, self.slipped, self._noticed_ns = list[str](), 0, -(10**18)
        self.used, self._why = False, 'not used yet: it is compared with the wheels in turns'
        self._fits, self._proof = 0, 0.0  # windows in a row; turns in them [rad]
        self.reset()

    def reset(self) -> None:
        """Go on at pose zero; what is learnt stays."""
        self._filter.start()
        self.covariance, self.twist_covariance = np.zeros((3, 3)), np.zeros((2, 2))
        self.twist: tuple[float, float] | None = None
        self._joints: Array | None = None
        self._window: Array | None = None  # I, T, W, D, turn of the wheels, its variance
        self._stamp_ns, self.slips = 0, ''
        self._doubt = self._agreed = self._contrary = 0.0  # times [s]

    @property
    def pose(self) -> Array:
        """The newest pose: x [m], y [m], yaw [rad]."""
        return self._filter.pose

    def update(self, stamp_ns: int, joints: Array) -> None:
        """Take the joints of one message.

        Parameters
        ----------
        joints : position [rad], velocity, acceleration, and standard deviations of position and
            velocity of each joint of `Geometry.names`, shape (n, 5).
        """
        geometry, kept, to = self._geometry, self._filter, self._to
        before, self._joints = self._joints, joints
        if stamp_ns < self._stamp_ns:  # the clock was set back
            before = None
            if self.gyro is not None:
                self.gyro.restart()
        dt = 0.0 if before is None else (stamp_ns - self._stamp_ns) * 1e-9
        self._stamp_ns = stamp_ns
        _, speeds, accelerations, position_sigmas, sigmas = (self._by_wheel @ joints).T
        sigmas = np.sqrt(
            SIDE_CORRELATION * sigmas**2
            + (1 - SIDE_CORRELATION) * (self._squared @ joints[:, 4] ** 2)
        )
        newest = to * position_sigmas**2 @ to.T
        turned, walk = np.zeros(len(joints)), position_sigmas**2  # a start is at the true positions
        if before is not None:
            turned += joints[:, 0] - before[:, 0]
            if self._period:
                expected = 0.5 * (joints[:, 1] + before[:, 1]) * dt
                turned += self._period * np.round((expected - turned) / self._period)
            walk = geometry.travel_noise**2 * np.abs(self._by_wheel * turned).sum(axis=1)
        if dt > self._outage and self._period:
            self.notices.append(f'no wheel for {dt:.3g} s: turns in it are not in the pose')
            walk += (self._by_wheel.sum(axis=1) * self._period) ** 2
        walk = to * walk @ to.T
        wheel_displacement = to @ self._by_wheel @ turned
        (speed, rate), by = kept.corrected(to @ speeds)
        covariance = by @ kept.p @ by.T + self._learnt(to * sigmas**2 @ to.T)
        wheels, slip_reason = Rate(rate, covariance[1, 1]), ''
        turns = f'the wheels turn the base at {rate:.4g} rad/s'
        by_gyro, found, slip_spread = None, wheels, np.zeros(2)
        if self.gyro is not None:
            still = bool((speeds**2 < 9.0 * sigmas**2).all())
            by_gyro = self._gyro_rate(
                dt, wheels, to[1] @ accelerations / kept.learnt.r, still, turns
            )
            contradicts = by_gyro is not None and (self.slips != '' or not by_gyro.agrees(wheels))
            self._learn(None if contradicts else wheel_displacement, walk[1, 1], newest[1, 1])
        same_side_difference = np.ptp(
            joints[: 2 * len(geometry.wheels_left), 1].reshape(2, -1), axis=1
        )
        same_side_difference *= self._by_wheel.max(axis=1) * len(geometry.wheels_left)
        if (same_side_difference > 10.0 * sigmas).any():
            slip_reason = f'wheels of one side differ by {max(same_side_difference):.3g} m/s'
            slip_spread = 0.5 * np.abs(to) @ same_side_difference
        if geometry.steering:
            steered = self._steered(joints[-1], speed, covariance[0, 0])
            found = wheels.fused(steered)
            if by_gyro is None and not steered.agrees(wheels):
                slip_reason = slip_reason or f'{turns}, the steering at {steered.value:.3g}'
                found = Rate(0.5 * (steered.value + rate), steered.variance + wheels.variance)
                slip_spread[1] += 0.5 * abs(steered.value - rate)
        moved, by = kept.corrected(wheel_displacement)
        walk = self._learnt(walk)
        if by_gyro is not None and self.gyro is not None:
            found, share = by_gyro.fused(wheels), 0.0  # of the turn by the wheels
            white = self.gyro.white * self.gyro.spacing * dt
            if contradicts:  # one side slips alone, or the gyro is wrong
                found, half = by_gyro, 0.5 * abs(by_gyro.value - rate)
                slip_spread += half * geometry.effective_track, half
                if not by_gyro.agrees(wheels):
                    slip_reason = f'{turns}, the gyro at {by_gyro.value:.4g}'
            elif white > 0.0:
                share = white / (white + walk[1, 1])
            r, b, g = kept.learnt[:3]
            moved[1] = share * moved[1] + (1 - share) * (self.gyro.step @ (1.0, b / r, g / r))
            by[1] *= share
            by[1, 4:6] += (1 - share) * self.gyro.step[1:] / r
            walk *= np.outer((1.0, share), (1.0, share))
            walk[1, 1] += (1 - share) ** 2 * white
        if found is not wheels:
            covariance[0, 1] = covariance[1, 0] = 0.0
            covariance[1, 1] = found.variance
        self.twist = speed, found.value
        self.twist_covariance = covariance + np.outer(slip_spread, slip_spread)
        by[:, 8] = slip_spread * dt * (1.0, float(by_gyro is None))
        kept.move(moved, by, walk)
        on = arc(0.0, 0.0, kept.pose[2])[1]
        self.covariance = kept.p[:3, :3] + on @ self._learnt(newest) @ on.T
        self._note(dt, slip_reason)

    def _learnt(self, covariance: Array) -> Array:
        """Return a covariance of distance and turn by the wheels, by what is learnt."""
        by = (1.0, self._filter.learnt.r)
        return covariance / np.outer(by, by)

    def _gyro_rate(
        self, dt: float, wheels: Rate, acceleration: float, still: bool, turns: str
    ) -> Rate | None:
        """Return the rate by the gyro, None if it is not used."""
        gyro, p, (r, b, g) = self.gyro, self._filter.p, self._filter.learnt[:3]
        assert gyro is not None
        if not gyro.follow(self._stamp_ns, dt, acceleration):
            self._window = None
            self._disable_gyro('silent')
            return None
        unsure = float(p[4, 4] + acceleration * acceleration * p[5, 5]) / (r * r)
        unsure += gyro.white + gyro.blur * (gyro.ahead + g / r) ** 2
        by_gyro = Rate(gyro.now + (b + g * acceleration) / r, unsure)
        agrees = by_gyro.agrees(wheels)
        self._contrary = self._contrary + dt if still and not agrees else 0.0
        if not agrees and gyro.equal >= STUCK_VALUES:
            self._disable_gyro(f'stuck at {gyro.now:.4g}, {turns}')
        elif self._contrary > STANDSTILL:
            self._disable_gyro(f'it is at {by_gyro.value:.4g} rad/s and the wheels stand')
        return by_gyro if self.used else None

    def _disable_gyro(self, why: str, always: bool = False) -> None:
        """Use the gyro no more, until it agrees again; `always`: also one that is not used yet."""
        if self.used or (always and self._why != why):
            self.notices.append(f'the gyro is not used: {why}')
            self._filter.forget()
            self.used, self._why, self._fits, self._proof, self._window = False, why, 0, 0.0, None

    def _learn(self, wheel_displacement: Array | None, walk: float, newest: float) -> None:
        """Continue the window, and learn at its end; `wheel_displacement` : None: wheels slip."""
        gyro, window, self._window = self.gyro, self._window, None
        assert gyro is not None
        if wheel_displacement is None:
            return
        if window is not None:
            self._window = window = window + np.array([*gyro.step, *wheel_displacement, walk])
            if window[1] < LEARNING_WINDOW:
                return
            white = self._filter.learnt.r**2 * gyro.white * gyro.spacing * window[1]
            fits = self._filter.learn(window, window[5] + newest + white)
            self._fits = max(1, self._fits + 1) if fits else min(-1, self._fits - 1)
            self._proof = self._proof + abs(window[4]) if fits else 0.0
            if (
                self._fits >= PROOF_WINDOWS
                and self._proof > PROOF_TURN
                and gyro.equal < STUCK_VALUES
            ):
                self.used, self._why = True, 'used'
            elif self._fits <= -RELEARNT_AFTER:
                self._disable_gyro(
                    'its turns and those of the wheels do not agree: check its sign', True
                )
        self._window = np.array([0.0, 0.0, 0.0, 0.0, 0.0, newest])

    def _steered(self, steering: Array, speed: float, variance: float) -> Rate:
        """Return the yaw rate by speed and steering; `variance` : of the speed."""
        length = self._geometry.wheelbase or math.nan
        tangent = math.tan(steering[0]) / length
        by_angle = speed * (1.0 / length + tangent * tangent * length)
        unsure = steering[3] ** 2 + self._geometry.steering_stddev**2
        return Rate(speed * tangent, tangent * tangent * variance + by_angle * by_angle * unsure)

    def _note(self, dt: float, slip_reason: str) -> None:
        """Note where slip begins and ends."""
        self._agreed = 0.0 if slip_reason else self._agreed + dt
        self._doubt = max(0.0, self._doubt + (dt if slip_reason else -0.2 * dt))
        if self._agreed > SLIP_ENDS:
            self.slips, self._doubt = '', 0.0
        elif self._doubt > SLIP_BEGINS and not self.slips:
            self.slips, self.slipped = slip_reason, self.slipped + 1
            if (self._stamp_ns - self._noticed_ns) * 1e-9 > NOTICE_INTERVAL:
                self._noticed_ns = self._stamp_ns
                self.notices.append(f'slip: {slip_reason}')

    def text(self) -> str:
        """Return pose, slips and what is known of the gyro, for people."""
        if self.twist is None:
            return 'no message has had all joints yet'
        x, y, yaw, r, b, g = (*self.pose, *self._filter.learnt[:3])
        slips = f'; now: {self.slips}' if self.slips else ''
        gyro = '' if self.gyro is None else f'; gyro {self._why}'
        if self.used:
            of_r, of_b, of_g = np.sqrt(np.diag(self._filter.p)[3:6])
            track = self._geometry.effective_track
            gyro += (
                f', bias {-b / r:.4g} +- {of_b / r:.1g} rad/s, delay {g / r:.4g} +- {of_g / r:.1g} '
                f's, effective track {track * r:.4g} +- {track * of_r:.1g} m'
            )
        return f'x {x:.4g} m, y {y:.4g} m, yaw {yaw:.4g} rad; slips {self.slipped}{slips}{gyro}'
