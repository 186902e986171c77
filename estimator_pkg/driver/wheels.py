# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A base on wheels: twist and pose with covariances, from its wheels and a gyro.

    v = (vr + vl) / 2,   w = (vr - vl) / b,   vl = rl wl,   vr = rr wr

The pose follows the arc of constant twist exactly. Its covariance has three parts: errors that add
up with the distance (Chong and Kleeman 1997), constant ones (radii, track, bias), which grow along
the path, and that of the newest positions, which does not grow.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.circle import nearest_turn
from estimator_pkg.errors import UsageError
from estimator_pkg.observers.angle.edge import observer as edge_adaptive
from estimator_pkg.parameters import structural
from estimator_pkg.sensor.scatter import Scatter, begin_scatter, follow_scatter
from estimator_pkg.sensor.source import agree

WINDOW = 0.5  # shortest time over which gyro and wheels are compared to learn [s]
PROOF = 4  # windows that agree before the gyro is used
LIMIT = 10  # windows in a row that do not agree, after which the gyro is learnt again
UNKNOWN = (0.2, 1.0, 0.02)  # deviations of ratio, bias [rad/s] and delay [s] before the first
WALK = (1e-3, 1e-4, 0.0, 0.0)  # of what is learnt [per square root of a second]
GATE = 25.0  # squared deviations of a window that does not agree
SLIPS, AGREES = 0.05, 0.25  # time without, and with agreement, after which slip begins, ends [s]
STANDS = 2.0  # time for which the gyro contradicts wheels that stand: its bias is another one [s]
SILENT = 0.5  # time without a value, after which the gyro is silent [s]
STUCK = 25  # equal values of a gyro that contradicts the wheels, after which it is stuck
OFTEN = 10.0  # shortest time between two notices of slip [s]
MEMORY = 0.02  # weight of one value in the mean square error of its prediction by the wheels
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
        None,
        unit='m',
        range=(1e-3, 100.0),
        description='distance of the contacts of left and right wheels; must be set',
    )
    slip_factor: float = structural(
        1.0,
        range=(0.1, 10.0),
        description='effective over geometric track: 1.2 to 2 of skid steering, 1 of other bases',
    )
    steering: str = structural(
        '',
        description='name of the steering joint of an Ackermann base, positive to the left; the '
        'wheels are then the rear ones. Automatic: not steered',
    )
    wheelbase: float | None = structural(
        None,
        unit='m',
        range=(1e-3, 100.0),
        description='distance between front and rear axle; must be set if steering is',
    )
    radius_stddev: float = structural(
        0.0, range=(0.0, 1.0), description='standard deviation of each radius, relative to it'
    )
    track_stddev: float = structural(
        0.0,
        range=(0.0, 1.0),
        description='standard deviation of the effective track, relative to it',
    )
    steering_stddev: float = structural(
        0.001,
        unit='rad',
        range=(0.0, 1.0),
        description='standard deviation of the zero of the steering joint',
    )
    travel_noise: float = structural(
        0.003,
        unit='m',
        range=(0.0, 1.0),
        description='standard deviation of what a wheel travels on 1 m of ground, beyond what it '
        'turns; it grows with the root of the distance, and is part of the covariance of the pose',
    )

    def check(self) -> None:
        """Raise UsageError for a base that is none."""
        for name, example in (('radius', '[0.05]'), ('track', '0.3'), ('wheelbase', '0.3')):
            if getattr(self, name) is None and (name != 'wheelbase' or self.steering):
                why = ", and 'steering' needs it" if name == 'wheelbase' else ''
                raise UsageError(f"parameter '{name}' is not set{why}: set it [m], as in {example}")
        if len(self.wheels_left) != len(self.wheels_right) or len(self.wheels_left) > 2:
            raise UsageError(
                f"'wheels_left' has {len(self.wheels_left)} names and 'wheels_right' "
                f'{len(self.wheels_right)}: set one or two for each side, as many on both'
            )
        if '' in self.names or len(set(self.names)) < len(self.names):
            raise UsageError(
                f'the joints of the base are {", ".join(map(repr, self.names))}: each needs a name '
                "of its own in 'wheels_left', 'wheels_right' and 'steering'"
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
        """The matrix from what left and right travel to distance and turn of the base."""
        return np.array([[0.5, 0.5], np.array([-1.0, 1.0]) / self.effective_track])

    def constant(self, sides: Array, turn: float) -> Array:
        """Return what one deviation of each radius and of the track changes, shape (2, 3).

        Parameters
        ----------
        sides : what left and right travel, or their speeds. turn : of the base, or its rate.
        """
        by_track = np.array([[0.0], [turn * self.track_stddev]])
        return np.hstack([self.twist * (sides * self.radius_stddev), by_track])


class Moving(NamedTuple):
    """The newest estimate of a joint [rad, rad/s, rad/s^2], and its standard deviations."""

    position: float
    velocity: float
    acceleration: float
    position_stddev: float
    velocity_stddev: float


class Rate(NamedTuple):
    """A yaw rate [rad/s] and its variance."""

    value: float
    variance: float

    def agrees(self, other: Rate) -> bool:
        """Return True if both may be the same."""
        return agree(self.value, other.value, self.variance + other.variance)

    def fused(self, other: Rate) -> Rate:
        """Return the mean of two independent rates, by their variances."""
        total = self.variance + other.variance
        share = other.variance / total if total > 0.0 else 0.5
        value = share * self.value + (1.0 - share) * other.value
        return Rate(value, share * self.variance)


class Rolled(NamedTuple):
    """What the wheels show in a message.

    dt : since the one before [s]. speed : [m/s]. turn : since the one before [rad]. walk, newest :
    variances of the turn by uneven ground, and by the newest positions [rad^2]. rate : of yaw.
    bend : its change [rad/s^2]. still : they stand.
    """

    dt: float
    speed: float
    turn: float
    walk: float
    newest: float
    rate: Rate
    bend: float
    still: bool


def arc(distance: float, turn: float, yaw: float) -> tuple[Array, Array]:
    """Return the displacement of an arc (x, y, yaw), and its derivatives by distance and turn."""
    if abs(turn) < SMALL:
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


class Pose:
    """The pose in the plane: x [m], y [m], yaw [rad], and what its covariance consists of.

    Attributes
    ----------
    walked : covariance of errors that add up, shape (3, 3).
    constant : effect of one deviation of each constant error, shape (3, 4).
    learnt : covariance with what is learnt of a gyro, shape (3, 4).
    """

    def __init__(self) -> None:
        self.values: Array = np.zeros(3)
        self.walked: Array = np.zeros((3, 3))
        self.constant: Array = np.zeros((3, 4))
        self.learnt: Array = np.zeros((3, 4))

    def move(self, moved: Array, walk: Array, constant: Array, by_learnt: Array, p: Array) -> None:
        """Follow an arc.

        Parameters
        ----------
        moved : distance and turn. walk : their covariance, shape (2, 2).
        constant : by how much one deviation of each constant error changes them, shape (2, 4).
        by_learnt : their derivatives by what is learnt, shape (2, 4). p : covariance of this.
        """
        step, by = arc(moved[0], moved[1], self.values[2])
        follow = np.array([[1.0, 0.0, -step[1]], [0.0, 1.0, step[0]], [0.0, 0.0, 1.0]])
        learnt, by_learnt = follow @ self.learnt, by @ by_learnt
        both = learnt @ by_learnt.T
        self.walked = follow @ self.walked @ follow.T + by @ walk @ by.T
        self.walked += both + both.T + by_learnt @ p @ by_learnt.T
        self.constant = follow @ self.constant + by @ constant
        self.learnt = learnt + by_learnt @ p
        self.values = self.values + step

    def covariance(self, newest: Array) -> Array:
        """Return the covariance; `newest` : that of distance and turn of the newest positions."""
        _, by = arc(0.0, 0.0, self.values[2])
        found: Array = self.walked + self.constant @ self.constant.T + by @ newest @ by.T
        return found


class Gyro:
    """A gyro that is compared with the wheels, over windows.

    In a window the wheels turn the base by r I + b T + g W + e D: I is the integral of the gyro, T
    the time, W the change of its value, D the distance. A Kalman filter learns (r, b, g, e): r is
    the true over the given track, -b / r the bias, g / r the delay, e the difference of the radii
    over the track.

    Attributes
    ----------
    known, p : the four, and their covariance. proven : True once windows agree.
    kept : factor of the covariance of others with the four in the newest message, shape (4, 4).
    used : True while it tells the yaw rate. said : why it does not.
    contradicts : wheels and gyro do not agree. slips : what was seen then; '': they agree.
    turn, variance : of the base since the message before, by it [rad, rad^2].
    by_learnt : derivatives of this turn by the four.
    notices : new texts for the user.
    """

    def __init__(self, ratio: float, delay: float, geometry: Geometry) -> None:
        self._ratio = ratio
        self._track = geometry.effective_track
        radii = math.sqrt(2.0) * geometry.radius_stddev / self._track
        self._first = np.array([*UNKNOWN, radii])
        if delay >= 0.0:
            self._first[2] = 0.0
        self._delay = max(delay, 0.0)
        self._scatter = Scatter()
        self._queue: list[tuple[int, float]] = []
        self._stamp_ns, self._value, self._dt = 0, 0.0, 0.0
        self._bend = self._wrong = 0.0  # [rad/s^2], mean square [(rad/s)^2]
        self._equal = 0  # values in a row
        self._sums = self._here = np.zeros(4)  # I, T, W and D, at the newest value and message
        self.used, self.said, self.slips = False, 'no value yet', ''
        self.turn, self.variance, self.notices = 0.0, 0.0, list[str]()
        self.by_learnt = np.zeros(4)
        self._forget()

    def _forget(self) -> None:
        """Begin to learn."""
        self.known, self.p = np.array([1.0, 0.0, self._delay, 0.0]), np.diag(self._first**2)
        self.kept = np.zeros((4, 4))
        self.proven, self._fits, self._misses = False, 0, 0  # windows in a row
        self._rest()

    def _rest(self) -> None:
        """Begin a window at the next message."""
        self._window: tuple[Array, float] | None = None  # `_here` at its start, and `newest`
        self._turned = self._walked = 0.0  # by the wheels in the window, and its variance
        self.slips, self.contradicts = '', False
        self._doubt = self._agreed = self._contrary = 0.0  # times [s]

    def _off(self, said: str) -> None:
        """Use the gyro no more."""
        if self.used:
            self.notices.append(f'the gyro is not used: {said}')
        self.used, self.said = False, said
        self._rest()

    def hear(self, stamp_ns: int, value: float) -> None:
        """Take a value; it counts from the next message of the wheels on."""
        if math.isfinite(value):
            self._queue.append((stamp_ns, self._ratio * value))
            del self._queue[:-QUEUE]

    def tell(self, stamp_ns: int, rolled: Rolled) -> Rate | None:
        """Return the yaw rate by the gyro; None: it is not known."""
        self.kept = np.eye(4)
        self._follow(stamp_ns)
        ahead = (stamp_ns - self._stamp_ns) * 1e-9
        if self._dt == 0.0 or ahead > SILENT:
            if self._stamp_ns and ahead > SILENT:
                self._off('silent')
            return None
        (r, b, g, _), white = self.known, self._scatter.variance
        self._bend = bend = rolled.bend / r
        self._sums[1:] += rolled.dt, 0.0, rolled.speed * rolled.dt
        here, now = self._sums.copy(), self._value + bend * ahead
        here[0] += 0.5 * (self._value + now) * ahead
        here[2] = now
        step, self._here = here - self._here, here
        self.turn = float(step[:3] @ self.known[:3]) / r
        self.by_learnt = step * (0.0, 1.0 / r, 1.0 / r, 0.0)
        self.variance = white * self._dt * rolled.dt
        blurred = max(0.0, self._wrong - 2.0 * white) * (ahead / self._dt) ** 2
        unsure = float(self.p[1, 1] + bend * bend * self.p[2, 2]) / (r * r)
        told = Rate(now + (b + g * bend) / r, white + blurred + unsure)
        wheels = self.corrected(rolled.rate, rolled.speed)
        if self.used and not self._watch(told, wheels, rolled):
            return None
        if self.contradicts:
            self._window = None
        else:
            self._learn(rolled, white)
        if self.proven and self._equal < STUCK:
            self.used, self.said = True, ''
        return told if self.used else None

    def _follow(self, until_ns: int) -> None:
        """Take the values up to this time [ns]."""
        taken = 0
        for stamp_ns, value in self._queue:
            if stamp_ns > until_ns:
                break
            taken += 1
            dt = (stamp_ns - self._stamp_ns) * 1e-9
            if dt <= 0.0:
                continue
            if self._stamp_ns == 0 or dt > SILENT:
                begin_scatter(self._scatter, value)
                self._wrong = self._dt = 0.0
                self._rest()
            else:
                follow_scatter(self._scatter, value, dt, math.inf)
                change = value - self._value
                self._equal = self._equal + 1 if change == 0.0 else 0
                self._wrong += MEMORY * ((change - self._bend * dt) ** 2 - self._wrong)
                self._sums[0] += 0.5 * (self._value + value) * dt
                self._dt = dt
            self._stamp_ns, self._value = stamp_ns, value
        del self._queue[:taken]

    def _watch(self, told: Rate, wheels: Rate, rolled: Rolled) -> bool:
        """Note where slip begins and ends; return False if the gyro is wrong."""
        dt, agrees = rolled.dt, told.agrees(wheels)
        seen = (
            f'the wheels turn the base at {wheels.value:.4g} rad/s, the gyro at {told.value:.4g} '
            f'+- {math.sqrt(told.variance):.1g}'
        )
        self._agreed = self._agreed + dt if agrees else 0.0
        self._doubt = max(0.0, self._doubt + (-0.2 * dt if agrees else dt))
        self._contrary = self._contrary + dt if rolled.still and not agrees else 0.0
        if not agrees and self._equal >= STUCK:
            self._off(f'stuck, {seen}')
        elif self._contrary > STANDS:
            self._off(f'{seen}, at standstill: its bias is learnt again')
            self._forget()
        elif self.slips and self._agreed > AGREES:
            self.slips, self._doubt = '', 0.0
        elif self._doubt > SLIPS and not self.slips:
            self.slips = seen
        self.contradicts = not agrees or bool(self.slips)
        return self.used

    def _learn(self, rolled: Rolled, white: float) -> None:
        """Continue the window, and learn at its end."""
        if self._window is not None:
            newest, h = self._window[1], self._here - self._window[0]
            self._turned, self._walked = self._turned + rolled.turn, self._walked + rolled.walk
            if h[1] < WINDOW:
                return
            self.p += np.diag(WALK) ** 2 * h[1]
            c, innovation = self.p @ h, self._turned - float(h @ self.known)
            s = float(h @ c) + newest + rolled.newest + self._walked
            s += self.known[0] ** 2 * white * self._dt * h[1]
            if innovation * innovation <= GATE * s:
                self.known, self.p = self.known + c * (innovation / s), self.p - np.outer(c, c / s)
                self.kept = np.eye(4) - np.outer(h, c / s)
                self._fits, self._misses = self._fits + 1, 0
                self.proven = self.proven or self._fits >= PROOF
            else:
                self._fits, self._misses = 0, self._misses + 1
                self._doubt, self._agreed = 2.0 * SLIPS, -WINDOW
                if self._misses >= LIMIT:
                    self._off(
                        f'its turn in {h[1]:.2g} s and that of the wheels differ by '
                        f'{abs(innovation):.2g} rad'
                    )
                    self._forget()
        self._window = self._here, rolled.newest
        self._turned = self._walked = 0.0

    def corrected(self, rate: Rate, speed: float) -> Rate:
        """Return the rate of the wheels by what is learnt."""
        r, _, _, e = self.known
        value = (rate.value - e * speed) / r
        unsure = float(self.p[0, 0] * value * value + self.p[3, 3] * speed * speed)
        return Rate(value, (rate.variance + unsure) / (r * r))

    def text(self) -> str:
        """Return what is known of it, for people."""
        (r, b, g, _), s = self.known, np.sqrt(np.diag(self.p))
        if not self.proven:
            return self.said or 'not used yet: it is compared with the wheels'
        return (
            f'{self.said or "used"}, bias {-b / r:.4g} +- {s[1] / r:.1g} rad/s, delay {g / r:.4g} '
            f'+- {s[2] / r:.1g} s, effective track '
            f'{self._track * r:.4g} +- {self._track * s[0]:.1g} m'
        )


class Base:
    """The base: pass it the joints of each message, read twist and pose.

    Attributes
    ----------
    gyro : None: there is none. pose : the newest. covariance : of it, shape (3, 3).
    twist, twist_covariance : x [m/s], yaw [rad/s], shape (2, 2).
    slips : what is seen while wheels slip; '': they do not. slipped : number of slips.
    notices : new texts for the user.
    """

    def __init__(self, geometry: Geometry, gyro: Gyro | None, period: float, outage: float) -> None:
        self.geometry, self.gyro = geometry, gyro
        self._period, self._outage = period, outage
        self.notices, self.slipped, self._noticed_ns = list[str](), 0, 0
        self.reset()

    def reset(self) -> None:
        """Go on at pose zero."""
        self.pose, self.slips = Pose(), ''
        self.covariance, self.twist_covariance = np.zeros((3, 3)), np.zeros((2, 2))
        self.twist: tuple[float, float] | None = None
        self._joints: dict[str, Moving] = {}
        self._stamp_ns = 0
        self._seen = 0.0  # for how long slip is seen [s]

    def _side(self, now: Mapping[str, Moving], k: int, dt: float) -> tuple[float, ...]:
        """Return what the wheels of one side do.

        Returns
        -------
        speed [m/s], its variance, acceleration [m/s^2], variance of the newest position [m^2], half
        the speed by which wheels contradict each other, path since the message before [m], its
        variance.
        """
        geometry = self.geometry
        radius = (geometry.radius or (math.nan,))[-k]
        names = (geometry.wheels_left, geometry.wheels_right)[k]
        joints, count = [now[name] for name in names], len(names)
        path = walk = 0.0
        for name, joint in zip(names, joints):
            if name in self._joints:
                before = self._joints[name]
                expected = 0.5 * (joint.velocity + before.velocity) * dt
                moved = nearest_turn(joint.position - before.position, expected, self._period)
                unseen = radius * self._period if dt > self._outage else 0.0
                path += radius * moved / count
                walk += unseen**2 + geometry.travel_noise**2 * abs(radius * moved)
        apart = radius * (joints[-1].velocity - joints[0].velocity)
        sigmas = [radius * each.velocity_stddev for each in joints]
        return (
            radius * sum(each.velocity for each in joints) / count,
            (sum(sigmas) / count) ** 2,  # wheels of a side lag alike
            radius * sum(each.acceleration for each in joints) / count,
            (radius * sum(each.position_stddev for each in joints) / count) ** 2,
            0.0 if agree(apart, 0.0, sum(sigmas) ** 2) else 0.5 * abs(apart),
            path,
            walk / count,  # and share the ground
        )

    def update(self, stamp_ns: int, now: Mapping[str, Moving]) -> None:
        """Take the joints of one message."""
        geometry, gyro, by = self.geometry, self.gyro, self.geometry.twist
        dt = (stamp_ns - self._stamp_ns) * 1e-9 if self._joints else 0.0
        sides = np.array([self._side(now, k, dt) for k in (0, 1)])
        speeds, variances, bends, positions, apart, paths, walks = sides.T
        (speed, rate), (_, bend), (distance, turn) = by @ speeds, by @ bends, by @ paths
        newest = by * positions @ by.T
        walk = by * walks @ by.T if self._joints else newest  # zero is at the true positions
        constant, by_learnt, p = geometry.constant(paths, turn), np.zeros((2, 4)), np.zeros((4, 4))
        scale = geometry.constant(speeds, rate)
        covariance = by * variances @ by.T + scale @ scale.T
        unsure = np.abs(by) @ apart  # deviations of twist by slip
        said = f'wheels of one side differ by {2.0 * max(apart):.3g} m/s' if apart.any() else ''
        if dt > self._outage and self._period:
            self.notices.append(f'no wheel for {dt:.3g} s: turns in it are not in the pose')
        told, wheels = None, Rate(rate, covariance[1, 1])
        if gyro is not None:
            rolled = Rate(rate, float(by[1] ** 2 @ variances))
            still = bool((speeds**2 < 9.0 * variances).all())
            told = gyro.tell(
                stamp_ns, Rolled(dt, speed, turn, walk[1, 1], newest[1, 1], rolled, bend, still)
            )
            self.pose.learnt = self.pose.learnt @ gyro.kept
            if gyro.proven:
                wheels = gyro.corrected(rolled, speed)
        if geometry.steering:
            steered = self._steered(now[geometry.steering], speed, covariance[0, 0])
            if steered.agrees(wheels):
                wheels = wheels.fused(steered)
            elif told is None:
                said = said or (
                    f'the wheels turn the base at {wheels.value:.3g} rad/s, the steering at '
                    f'{steered.value:.3g}'
                )
                unsure[1] += 0.5 * abs(steered.value - wheels.value)
                mean = 0.5 * (steered.value + wheels.value)
                wheels = Rate(mean, steered.variance + wheels.variance)
        found, slid = wheels, unsure * dt
        if gyro is not None and gyro.proven:
            r, _, _, e = gyro.known
            turn, walk, share = (turn - e * distance) / r, walk / np.outer((1, r), (1, r)), 1.0
            if told is not None:
                found = told if gyro.contradicts else wheels.fused(told)
                share = gyro.variance / (gyro.variance + walk[1, 1]) if gyro.variance > 0.0 else 0.0
                if gyro.contradicts:  # one side slips alone, or the gyro is wrong
                    share, said = 0.0, gyro.slips or said
                    half = 0.5 * abs(told.value - wheels.value)
                    unsure += half * geometry.effective_track, half
                    slid = np.array([unsure[0] * dt, 0.0])
            constant[1], p = 0.0, gyro.p
            by_learnt[1] = share * np.array([-turn / r, 0.0, 0.0, -distance / r])
            by_learnt[1] += (1.0 - share) * gyro.by_learnt
            turn = share * turn + (1.0 - share) * gyro.turn
            walk = walk * np.outer((1.0, share), (1.0, share))
            walk[1, 1] += (1.0 - share) ** 2 * gyro.variance
        if found is not wheels or geometry.steering:
            covariance[0, 1] = covariance[1, 0] = 0.0
        covariance[1, 1] = found.variance
        self.twist = speed, found.value
        self.twist_covariance = covariance + np.outer(unsure, unsure)
        constant = np.column_stack([constant, slid])
        self.pose.move(np.array([distance, turn]), walk, constant, by_learnt, p)
        self.covariance = self.pose.covariance(newest)
        self._note(stamp_ns, dt, said)
        self._joints, self._stamp_ns = dict(now), stamp_ns

    def text(self) -> str:
        """Return pose, slips and what is known of the gyro, for people."""
        x, y, yaw = self.pose.values
        gyro = '' if self.gyro is None else f'; gyro {self.gyro.text()}'
        slips = f'; now: {self.slips}' if self.slips else ''
        return f'x {x:.4g} m, y {y:.4g} m, yaw {yaw:.4g} rad; slips {self.slipped}{slips}{gyro}'

    def _steered(self, steering: Moving, speed: float, variance: float) -> Rate:
        """Return the yaw rate by speed and steering; `variance` : of the speed."""
        length = self.geometry.wheelbase or math.nan
        tangent = math.tan(steering.position) / length
        by_angle = speed * (1.0 / length + tangent * tangent * length)
        unsure = steering.position_stddev**2 + self.geometry.steering_stddev**2
        return Rate(speed * tangent, tangent * tangent * variance + by_angle * by_angle * unsure)

    def _note(self, stamp_ns: int, dt: float, said: str) -> None:
        """Note what is seen of slip."""
        self._seen = self._seen + dt if said else 0.0
        said = said if self._seen > SLIPS else ''
        if said and not self.slips:
            self.slipped += 1
            if (stamp_ns - self._noticed_ns) * 1e-9 > OFTEN:
                self._noticed_ns = stamp_ns
                self.notices.append(f'slip: {said}')
        self.slips = said
