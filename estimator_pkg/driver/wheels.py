# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A base on wheels: twist and pose with covariances, from its wheels and a gyro.

    v = (vr + vl) / 2,   w = (vr - vl) / b,   vl = rl wl,   vr = rr wr

The pose follows the arc of constant twist exactly (SE(2)). Its covariance has three parts: errors
that add up with the distance (Chong and Kleeman 1997), constant ones (radius, track, bias), which
grow along the path, and that of the newest positions, which does not grow.
The heading of the wheels is the angle that the gyro's learner compares with (`sensor.source`): it
finds the bias, and as its ratio by how much the track is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.circle import nearest_turn
from estimator_pkg.observers.angle.edge import observer as edge_adaptive
from estimator_pkg.sensor.source import (
    BIAS,
    RATIO,
    X,
    Source,
    agree,
    begin_source,
    follow_source,
    forget_source,
    meet_angle,
    resume_source,
    speed_of,
    variance_of_speed,
)

UNSURE = 0.2  # deviation of the ratio of track to gyro before the first value
WALK = 1e-3  # of this ratio [per square root of a second]
SLIPS = 0.05  # time without agreement after which wheels slip [s]
HOLDS = 0.25  # time of agreement after which they do not slip any more [s]
SILENT = 0.5  # time without a value, after which the gyro is silent [s]
STUCK = 25  # equal values of a gyro that contradicts the wheels, after which it is stuck
STANDS = 2.0  # time at standstill for which a gyro contradicts, after which its bias is another [s]
OFTEN = 10.0  # shortest time between two notices of slip [s]
QUEUE = 4096  # values of the gyro that wait for the wheels at most
SMALL = 1e-4  # angle [rad] below which an arc is its series

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
    """The wheels and where they are.

    left, right : names of the joints. steering : of the steering joint; '': none.
    radius : of the left and right wheels [m]. track : distance of their contacts, of skid steering
        the effective one [m]. wheelbase : of a steered base [m].
    radius_stddev, track_stddev : of both, relative.
    travel_noise : deviation of what a wheel travels on 1 m [m]; it grows with the root.
    """

    left: tuple[str, ...]
    right: tuple[str, ...]
    radius: tuple[float, float]
    track: float
    steering: str = ''
    wheelbase: float = 0.0
    radius_stddev: float = 0.0
    track_stddev: float = 0.0
    travel_noise: float = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        """All joints."""
        return (*self.left, *self.right, *([self.steering] if self.steering else ()))


class Moving(NamedTuple):
    """The newest estimate of a joint [rad, rad/s, rad/s^2], and its standard deviations."""

    position: float
    velocity: float
    acceleration: float
    position_stddev: float
    velocity_stddev: float


class Side(NamedTuple):
    """What the wheels of one side travel: speed [m/s], its variance, their contradiction [m/s]."""

    speed: float
    variance: float
    apart: float
    acceleration: float
    position_variance: float


class Rate(NamedTuple):
    """A yaw rate [rad/s] and its variance."""

    value: float
    variance: float


def side(joints: list[Moving], radius: float) -> Side:
    """Return what the wheels of one side travel; wheels that contradict each other slip."""
    count = len(joints)
    speed = radius * sum(each.velocity for each in joints) / count
    variance = sum((radius * each.velocity_stddev) ** 2 for each in joints) / count**2
    apart = 0.0
    if count == 2:
        difference = radius * (joints[1].velocity - joints[0].velocity)
        if not agree(difference, 0.0, count**2 * variance):
            apart = abs(difference)
    return Side(
        speed,
        variance + 0.25 * apart * apart,
        apart,
        radius * sum(each.acceleration for each in joints) / count,
        sum((radius * each.position_stddev) ** 2 for each in joints) / count**2,
    )


def fused(one: Rate, other: Rate) -> Rate:
    """Return the mean of two independent rates, by their variances."""
    total = one.variance + other.variance
    if total <= 0.0:
        return Rate(0.5 * (one.value + other.value), 0.0)
    share = other.variance / total
    return Rate(
        share * one.value + (1.0 - share) * other.value, one.variance * other.variance / total
    )


def arc(distance: float, turn: float) -> tuple[float, float, float, float]:
    """Return the displacement of an arc in the frame of its start, and its change with `turn`.

    Returns
    -------
    forward and left over `distance`, and the derivatives of both by the turn [1/rad].
    """
    if abs(turn) < SMALL:
        return 1.0 - turn * turn / 6.0, 0.5 * turn, -turn / 3.0, 0.5 - turn * turn / 8.0
    sine, cosine = math.sin(turn), math.cos(turn)
    forward, left = sine / turn, (1.0 - cosine) / turn
    return forward, left, (cosine - forward) / turn, (sine - left) / turn


class Pose:
    """The pose in the plane: x [m], y [m], yaw [rad], and what its covariance consists of.

    Attributes
    ----------
    walked : covariance of errors that add up, shape (3, 3).
    constant : effect of one deviation of each constant error, shape (3, k).
    """

    def __init__(self, constants: int) -> None:
        self.x = self.y = self.yaw = 0.0
        self.walked: Array = np.zeros((3, 3))
        self.constant: Array = np.zeros((3, constants))

    def move(self, distance: float, turn: float, walk: Array, constant: Array) -> None:
        """Follow an arc.

        Parameters
        ----------
        walk : covariance of distance and turn, shape (2, 2).
        constant : by how much one deviation of each constant error changes them, shape (2, k).
        """
        forward, left, forward_by, left_by = arc(distance, turn)
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        dx = distance * (cosine * forward - sine * left)
        dy = distance * (sine * forward + cosine * left)
        follow = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        by = np.array(
            [
                [
                    cosine * forward - sine * left,
                    distance * (cosine * forward_by - sine * left_by),
                ],
                [
                    sine * forward + cosine * left,
                    distance * (sine * forward_by + cosine * left_by),
                ],
                [0.0, 1.0],
            ]
        )
        self.walked = follow @ self.walked @ follow.T + by @ walk @ by.T
        self.constant = follow @ self.constant + by @ constant
        self.x, self.y, self.yaw = self.x + dx, self.y + dy, self.yaw + turn

    def covariance(self, newest: Array) -> Array:
        """Return the covariance; `newest` : that of distance and turn of the newest positions."""
        along = np.array([[math.cos(self.yaw), 0.0], [math.sin(self.yaw), 0.0], [0.0, 1.0]])
        found: Array = self.walked + self.constant @ self.constant.T + along @ newest @ along.T
        return found


class Gyro:
    """A gyro that is compared with the wheels.

    Attributes
    ----------
    source : what is learnt of it. used : True while it tells the yaw rate. said : why it does not.
    slips : what was seen while wheels slip; '': they do not. contradicts : now.
    slipped : number of slips. notices : new texts for the user.
    """

    def __init__(self, ratio: float, delay: float) -> None:
        self._ratio = ratio
        self.source = Source()
        begin_source(self.source, 1.0, delay)
        self._queue: list[tuple[int, float]] = []
        self._learns = self.used = self.contradicts = False
        self._equal = 0  # values in a row
        self._doubt = self._agreed = self._stood = 0.0  # times [s]
        self._begun_ns = self._noticed_ns = 0
        self.said, self.slips, self.slipped = 'no value yet', '', 0
        self.notices: list[str] = []

    def hear(self, stamp_ns: int, value: float) -> None:
        """Take a value; it counts from the next message of the wheels on."""
        if math.isfinite(value) and stamp_ns > self.source.stamp_ns:
            self._queue.append((stamp_ns, self._ratio * value))
            del self._queue[:-QUEUE]

    def _follow(self, until_ns: int) -> None:
        taken = 0
        for stamp_ns, value in self._queue:
            if stamp_ns > until_ns:
                break
            taken += 1
            if stamp_ns > self.source.stamp_ns:
                self._equal = self._equal + 1 if value == self.source.value else 0
                follow_source(self.source, stamp_ns, value, math.nan, 0.0)
        del self._queue[:taken]

    def _off(self, said: str) -> None:
        """Use the gyro no more."""
        if self.used:
            self.notices.append(f'the gyro is not used: {said}')
        self.used, self.said, self.slips = False, said, ''
        self._doubt = 0.0

    def tell(
        self, stamp_ns: int, heading: float, turned: float, wheels: Rate, bend: float, still: bool
    ) -> Rate | None:
        """Return the yaw rate by the gyro; None: it is not known.

        Parameters
        ----------
        heading, turned : by the wheels, and the variance of its newest position [rad, rad^2].
        wheels : the rate by the wheels. bend : its change [rad/s^2].
        still : the wheels stand.
        """
        before = self.source.stamp_ns
        self._follow(stamp_ns)
        source = self.source
        if not source.stamp_ns:
            return None
        since = (stamp_ns - source.stamp_ns) * 1e-9
        if since > SILENT:
            self._off('silent')
            self._learns = False
            return None
        if not self._learns:
            forget_source(source, heading)
            source.p[X][X] += turned
            source.p[RATIO][RATIO] = UNSURE * UNSURE
            self._learns = True
            return None
        step = (source.stamp_ns - before) * 1e-9
        told, variance = speed_of(source, since, bend), variance_of_speed(source)
        if agree(told, wheels.value, variance + wheels.variance):
            self._doubt = max(0.0, self._doubt - 0.2 * step)
            self._agreed, self._stood = self._agreed + step, 0.0
            self.contradicts = bool(self.slips)
        else:
            self.contradicts = True
            self._doubt, self._agreed = self._doubt + step, 0.0
            self._stood = self._stood + step if still else 0.0
        if self._stood > STANDS:  # wheels that stand do not slip: the bias is another one
            self._stood, self._learns = 0.0, False
            self._off('it does not show the standstill of the wheels: its bias is learnt again')
            return None
        if self._equal >= STUCK and self._agreed == 0.0:
            self._off(f'stuck at {source.value:.4g} rad/s, the wheels show {wheels.value:.4g}')
            self._rest(heading, turned)
            return None
        fits = True
        if self._doubt == 0.0 and not self.slips:
            fits = meet_angle(source, stamp_ns, heading, heading, 0.0, turned, 0.0)
        if not fits or self._doubt > 0.0 or self.slips:
            self._rest(heading, turned)
        self._watch(stamp_ns, told, wheels.value, math.sqrt(variance), fits)
        if not self.used and (self._doubt == 0.0 or self.slips):
            self.used, self.said = True, ''
        ratio = source.known[RATIO]
        return Rate(told / ratio, source.variance + source.p[BIAS][BIAS] / (ratio * ratio))

    def _rest(self, heading: float, turned: float) -> None:
        """Learn nothing from this heading, and go on from it."""
        resume_source(self.source, heading)
        self.source.p[X][X] += turned

    def _watch(self, stamp_ns: int, told: float, rolled: float, sigma: float, fits: bool) -> None:
        """Note where slip begins and ends."""
        if not self.slips and (self._doubt > SLIPS or not fits):
            self._begun_ns, self.slipped, self._agreed = stamp_ns, self.slipped + 1, 0.0
            self.slips = (
                f'the wheels turn the base at {rolled:.4g} rad/s, the gyro at {told:.4g} '
                f'+- {sigma:.1g}'
            )
            if (stamp_ns - self._noticed_ns) * 1e-9 > OFTEN:
                self._noticed_ns = stamp_ns
                self.notices.append(f'slip: {self.slips}')
        elif self.slips and self._agreed > HOLDS:
            self.slips, self._doubt = '', 0.0

    def walk(self, variance: float, dt: float) -> None:
        """Let the heading of the wheels be less sure by this [rad^2], after a time [s]."""
        self.source.p[X][X] += variance
        self.source.p[RATIO][RATIO] += WALK * WALK * dt

    def text(self, track: float) -> str:
        """Return what is known of it, for people; `track` : that of the user [m]."""
        if not self._learns:
            return self.said
        known, p = self.source.known, self.source.p
        return (
            f'{self.said or "used"}, bias {known[BIAS]:.4g} +- {math.sqrt(p[BIAS][BIAS]):.1g} '
            f'rad/s, track by it {track * known[RATIO]:.4g} +- '
            f'{track * math.sqrt(p[RATIO][RATIO]):.1g} m'
        )


class Motion(NamedTuple):
    """Twist of the base: x [m/s], yaw [rad/s]; covariance of both, shape (2, 2)."""

    speed: float
    rate: float
    covariance: Array


RADIUS, TRACK, OF_BIAS, OF_SLIP = range(4)  # constant errors


class Base:
    """The base: pass it the joints of each message, read twist and pose.

    Attributes
    ----------
    gyro : None: there is none. pose, motion : the newest; motion None: not all wheels are tracked.
    slips : what was seen while wheels slip; '': they do not. notices : new texts for the user.
    """

    def __init__(self, geometry: Geometry, gyro: Gyro | None, period: float, outage: float) -> None:
        self.geometry, self.gyro = geometry, gyro
        self._period, self._outage = period, outage
        self.notices: list[str] = []
        self.reset()

    def reset(self) -> None:
        """Go on at pose zero."""
        self.pose, self.motion, self.slips = Pose(4), None, ''
        self._newest: Array = np.zeros((2, 2))
        self._joints: dict[str, Moving] = {}
        self._stamp_ns = 0
        self._heading = 0.0  # by the wheels
        self._told = 0.0  # by the gyro, before

    def _travelled(self, now: Mapping[str, Moving], dt: float) -> tuple[float, float, float, float]:
        """Return what left and right wheels travelled [m], and the variance of each [m^2]."""
        found, variances = [], []
        geometry = self.geometry
        lost = self._period > 0.0 and dt > self._outage
        for names, radius in zip((geometry.left, geometry.right), geometry.radius):
            total = variance = 0.0
            for name in names:
                joint, before = now[name], self._joints[name]
                expected = 0.5 * (joint.velocity + before.velocity) * dt
                moved = nearest_turn(joint.position - before.position, expected, self._period)
                turn = radius * self._period if lost else 0.0
                total += radius * moved
                variance += turn * turn + geometry.travel_noise**2 * abs(radius * moved)
            found.append(total / len(names))
            variances.append(variance / len(names) ** 2)
        if lost:
            self.notices.append(f'no wheel for {dt:.3g} s: turns in it are not in the pose')
        return found[0], found[1], variances[0], variances[1]

    def update(self, stamp_ns: int, now: Mapping[str, Moving]) -> None:
        """Take the joints of one message."""
        geometry, track = self.geometry, self.geometry.track
        left = side([now[name] for name in geometry.left], geometry.radius[0])
        right = side([now[name] for name in geometry.right], geometry.radius[1])
        of_wheels = spread(left.variance, right.variance, track)
        speed = 0.5 * (left.speed + right.speed)
        rolled = Rate((right.speed - left.speed) / track, float(of_wheels[1, 1]))
        newest = spread(left.position_variance, right.position_variance, track)
        dt = (stamp_ns - self._stamp_ns) * 1e-9
        distance = turn = 0.0
        walk: Array = newest  # at the start: the pose is zero at the true positions
        if self._joints:
            s_left, s_right, q_left, q_right = self._travelled(now, dt)
            distance, turn = 0.5 * (s_left + s_right), (s_right - s_left) / track
            walk = spread(q_left, q_right, track)
        said = ''
        if left.apart or right.apart:
            said = f'wheels of one side differ by {max(left.apart, right.apart):.3g} m/s'
        constant = np.zeros((2, 4))
        constant[0, RADIUS] = distance * geometry.radius_stddev
        rate = rolled
        if geometry.steering:
            rate, said = self._steered(now[geometry.steering], speed, of_wheels[0, 0], rolled, said)
        self._heading += turn
        told = None
        if self.gyro is not None:
            if self._joints:
                self.gyro.walk(float(walk[1, 1]), dt)
            told = self.gyro.tell(
                stamp_ns,
                self._heading,
                float(newest[1, 1]),
                rolled,
                (right.acceleration - left.acceleration) / track,
                left.speed**2 < 9.0 * left.variance and right.speed**2 < 9.0 * right.variance,
            )
            said = self.gyro.slips or said
        scale = 0.0  # variance of the wheels' turn, relative
        if told is None or self.gyro is None:
            scale = geometry.track_stddev**2 + geometry.radius_stddev**2
            constant[1, RADIUS] = turn * geometry.radius_stddev
            constant[1, TRACK] = turn * geometry.track_stddev
            apart = abs(rate.value - rolled.value) if said and geometry.steering else 0.0
        else:
            rate, turn, apart = self._informed(told, rate, turn, dt, walk, constant)
        sidewise = 0.5 * apart * track  # error of the speed if one side slips alone
        constant[0, OF_SLIP] = sidewise * dt if self._joints else 0.0
        covariance = np.array(of_wheels)
        covariance[0, 0] += (geometry.radius_stddev * speed) ** 2 + sidewise**2
        if rate is not rolled:
            covariance[0, 1] = covariance[1, 0] = 0.0
        covariance[1, 1] = rate.variance + scale * rate.value**2
        self.motion = Motion(speed, rate.value, covariance)
        self.pose.move(distance, turn, walk, constant)
        if said and not self.slips and self.gyro is None:
            self.notices.append(f'slip: {said}')
        self.slips = said
        self._newest, self._joints, self._stamp_ns = newest, dict(now), stamp_ns

    def _steered(
        self, steering: Moving, speed: float, variance: float, rolled: Rate, said: str
    ) -> tuple[Rate, str]:
        """Return the yaw rate by rear wheels and steering, and what was seen of slip."""
        tangent = math.tan(steering.position) / self.geometry.wheelbase
        by = speed * (1.0 / self.geometry.wheelbase + tangent * tangent * self.geometry.wheelbase)
        steered = Rate(
            speed * tangent, tangent**2 * variance + (by * steering.position_stddev) ** 2
        )
        if agree(steered.value, rolled.value, steered.variance + rolled.variance):
            return fused(rolled, steered), said
        said = said or (
            f'the wheels turn the base at {rolled.value:.3g} rad/s, the steering at '
            f'{steered.value:.3g}'
        )
        apart = steered.value - rolled.value
        mean = 0.5 * (steered.value + rolled.value)
        return Rate(mean, steered.variance + rolled.variance + 0.25 * apart * apart), said

    def _informed(
        self, told: Rate, rate: Rate, turn: float, dt: float, walk: Array, constant: Array
    ) -> tuple[Rate, float, float]:
        """Return yaw rate, turn, and how far wheels and gyro are apart while wheels slip [rad/s].

        Parameters
        ----------
        told : by the gyro. rate, turn : by the wheels, in whose scale they are.
        walk, constant : see `Pose.move`; they are changed.
        """
        gyro = self.gyro
        assert gyro is not None
        source = gyro.source
        ratio = source.known[RATIO]
        unsure = math.sqrt(source.p[RATIO][RATIO]) / ratio
        rolled, turn = rate.value / ratio, turn / ratio
        own = told.variance * dt * dt
        if gyro.contradicts:
            apart, share = abs(told.value - rolled), 0.0
            rate = Rate(told.value, told.variance + 0.25 * apart * apart)
        else:
            apart = 0.0
            wheels = Rate(rolled, rate.variance / ratio**2 + (unsure * rolled) ** 2)
            rate = fused(wheels, told)
            total = float(walk[1, 1]) / ratio**2 + own  # turns walk by this: the surer one counts
            share = own / total if total > 0.0 else 1.0
        by_gyro = 0.5 * (told.value + self._told) * dt if self._joints else 0.0
        self._told = told.value
        walk[1, 1] = share**2 * walk[1, 1] / ratio**2 + (1.0 - share) ** 2 * own
        walk[0, 1] = walk[1, 0] = share * walk[0, 1] / ratio
        constant[1, TRACK] = share * unsure * turn
        constant[1, OF_BIAS] = (1.0 - share) * math.sqrt(source.p[BIAS][BIAS]) * dt / ratio
        return rate, share * turn + (1.0 - share) * by_gyro, apart

    def covariance(self) -> Array:
        """Return the covariance of the pose."""
        return self.pose.covariance(self._newest)


def spread(left: float, right: float, track: float) -> Array:
    """Return the covariance of v and w of two sides with these variances."""
    across = (right - left) / (2.0 * track)
    return np.array([[0.25 * (left + right), across], [across, (left + right) / track**2]])
