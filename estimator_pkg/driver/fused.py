# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A joint whose speed other sensors measure in addition to its angle.

The observer has the angle alone. Each source has a filter of its bias, and the speed is the mean of
what the observer and the sources show, weighted with their inverse variances. Values and readings
act in the order of their stamps, whatever order they arrive in: a value waits for a reading that is
not older, and a reading for a value. The newest value is carried forward to the newest reading.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Any

from estimator_pkg.driver.configuration import AS_ANGLE, SourceSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.estimate import TRACKING
from estimator_pkg.observers.maths.rate_sensor import Angle, Comparison, RateSensor
from estimator_pkg.sensor.scatter import Scatter, begin_scatter, follow_scatter

SILENT = 0.5  # age of the newest value at which a source is silent [s]
PATIENCE = 2.0  # time in which its first value has to come [s]
GATE, CLIP = 5.0, 25.0  # of the mean NIS, and of a single one: a glitch is no contradiction
SPEED_GATE = 25.0  # of the squared difference of two speeds, for a sample; 5 standard deviations
NIS_TIME, NIS_READINGS = 0.1, 10.0  # the NIS is averaged over the longer of them [s]
NAMING = 0.4  # time for which speeds are compared, to name what is wrong [s]
PROBATION, LONGEST_PROBATION = 0.5, 16.0  # agreement before it informs [s]; doubled each time
MEAN = 0.01  # weight of one sample in a mean over the last 100
WAITING = 4096  # values or readings that wait at most


class Source:
    """A source of one joint.

    Attributes
    ----------
    used : True while it informs. notices : new texts for the user.
    """

    def __init__(self, name: str, settings: SourceSettings, joint: Joint) -> None:
        self.name, self.used, self.notices = name, False, list[str]()
        self._settings, self._period = settings, joint.settings.wrap_period
        own = joint.observer, joint.observer.gains(), joint.settings
        self._encoder = Joint(*own) if settings.kind == AS_ANGLE else None
        self._reason, self._named = 'no value yet', ''
        self._share, self._proof = 0.0, PROBATION
        self.restart()

    def restart(self) -> None:
        """Start as if no value and no reading had come."""
        self.filter = RateSensor(self._settings.ratio, self._period)
        self._values = deque[tuple[int, float, float]](maxlen=WAITING)
        self._angles = deque[Angle](maxlen=WAITING)
        self._newest_ns = self._first_ns = self._agrees_ns = self._doubted_ns = 0
        self._nis, self._comparison = 0.0, Comparison(self._settings.ratio)
        self.used = False

    def receive(self, stamp_ns: int, value: float) -> None:
        """Queue a value for the joint's readings."""
        stamp_ns -= round(self._settings.delay * 1e9)
        if stamp_ns < self._newest_ns - round(SILENT * 1e9):  # the clock jumped
            self.restart()
        if not math.isfinite(value) or stamp_ns <= self._newest_ns:
            return
        self._newest_ns, variance, encoder = stamp_ns, 0.0, self._encoder
        if encoder is not None:
            if not encoder.update(stamp_ns, value) or encoder.estimate()[3] != TRACKING:
                return
            value, variance = encoder.estimate()[1], encoder.stddev()[1] ** 2
        self._values.append((stamp_ns, value, variance))

    def measure(
        self, angle: Angle, speed: float, sigma: float, mean_dt: float
    ) -> tuple[float, float] | None:
        """Return the joint's speed [rad/s] and its variance by the source; None: it is not used.

        Parameters
        ----------
        angle : the newest. speed, sigma : from the angle alone, and its deviation [rad/s].
        mean_dt : between readings [s].
        """
        self._first_ns = self._first_ns or angle.stamp_ns
        self._angles.append(angle)
        self._take_values(angle, speed, sigma, min(mean_dt / NIS_TIME, 1.0 / NIS_READINGS))
        found, age = None, (angle.stamp_ns - self.filter.stamp_ns) * 1e-9
        if age > SILENT:
            self._note_silence(angle.stamp_ns)
        else:
            v, variance = self.filter.speed(age)
            if self._doubted_ns:
                self._comparison.add(v, speed, sigma)
                self._name_fault(angle.stamp_ns)
            elif angle.stamp_ns - self._agrees_ns >= self._proof * 1e9:
                self.used = True
                self._report('', 'agrees again and is used')
                if (v - speed) ** 2 < SPEED_GATE * (variance + sigma * sigma):
                    found = v, variance
        informs = found is not None and found[1] < sigma * sigma
        self._share += MEAN * (informs - self._share)
        return found

    def _take_values(self, now: Angle, speed: float, sigma: float, weight: float) -> None:
        """Filter values and angles up to this angle, in the order of their stamps."""
        while self._values and self._values[0][0] <= now.stamp_ns:
            stamp_ns, value, variance = self._values.popleft()
            angles = []
            while self._angles and self._angles[0].stamp_ns <= stamp_ns:
                angles.append(self._angles.popleft())
            if self.filter.stamp_ns and not self._doubted_ns:
                for nis in self.filter.take(stamp_ns, value, angles, variance):
                    self._nis += weight * (min(nis, CLIP) - self._nis)
                if self._nis > GATE:
                    self._doubt(now.stamp_ns)
            if not self.filter.stamp_ns or self._doubted_ns:
                age = (now.stamp_ns - stamp_ns) * 1e-9
                at = now.angle - speed * age
                self.filter.start(stamp_ns, value, at, now.variance + (sigma * age) ** 2)
                self._agrees_ns, self._nis = stamp_ns, 0.0

    def _doubt(self, now_ns: int) -> None:
        """Withhold the source, with a new filter, and begin to compare the speeds."""
        if self.used:
            self._proof = min(2.0 * self._proof, LONGEST_PROBATION)
        self._doubted_ns, self.used = now_ns, False
        self.filter = RateSensor(self._settings.ratio, self._period)
        self._comparison = Comparison(self._settings.ratio)

    def _name_fault(self, now_ns: int) -> None:
        """Report what is wrong, once the speeds have been compared for long enough."""
        if now_ns - self._doubted_ns >= NAMING * 1e9:
            self._doubted_ns, self._agrees_ns, text = 0, now_ns, self._comparison.text()
            self._report(' '.join(text.split()[:2]), f'withheld: {text}')

    def _note_silence(self, now_ns: int) -> None:
        """Stop the filter, and report a source without values that are new enough."""
        if self.filter.stamp_ns:
            self._first_ns, self.filter.stamp_ns, self.used = self.filter.stamp_ns, 0, False
        elif now_ns - self._first_ns < PATIENCE * 1e9:
            return
        topic, passed = self._settings.topic or self.name, (now_ns - self._first_ns) * 1e-9
        text = f'silent: no value on {topic} for {passed:.1f} s; check topic, field and publisher'
        ahead = (self._newest_ns - now_ns) * 1e-9
        if self._newest_ns and abs(ahead) > PATIENCE:
            text += f', and its clock: its newest stamp is {ahead:+.1f} s from that of the angle'
        self._report('silent', text)

    def _report(self, kind: str, reason: str) -> None:
        """Keep why the source does not inform; tell the user if the kind of reason changes."""
        if kind != self._named:
            self.notices.append(f'{self.name} {"is " * bool(kind)}{reason}')
        self._named, self._reason = kind, reason

    def text(self) -> str:
        """Return its state, for people."""
        if not self.used:
            return self._reason
        b, P = self.filter.z[1], self.filter.P[1, 1]
        return (
            f'used, informs in {100.0 * self._share:.0f} of 100 samples, '
            f'bias {b:.4g} +- {math.sqrt(P):.1g} rad/s'
        )


class FusedJoint:
    """A `Joint` that sources inform; all other attributes are those of the angle alone.

    Attributes
    ----------
    alone : the joint on its angle alone. sources : by number.
    """

    compiled = memory = None  # its messages are taken one by one

    def __init__(
        self,
        observer: Any,
        gains: Any,
        settings: Any,
        sources: Sequence[tuple[int, str, SourceSettings]],
    ):
        self.alone = Joint(observer, gains, settings)
        self.sources = {number: Source(name, each, self.alone) for number, name, each in sources}
        self._scatter = Scatter()  # of the readings
        self._speed = self._sigma = math.nan  # with the sources [rad/s]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.alone, name)

    def receive(self, number: int, stamp_ns: int, value: float) -> None:
        """Take a value of a source."""
        if number in self.sources:
            self.sources[number].receive(stamp_ns, value)

    def update(self, stamp_ns: int, measurement: float, known_input: float = 0.0) -> bool:
        """See `Joint`."""
        before_ns, period = self.alone.stamp_ns, self.alone.settings.wrap_period
        if not self.alone.update(stamp_ns, measurement, known_input):
            return False
        if not 0 < before_ns < stamp_ns:  # the first one, or the clock jumped
            begin_scatter(self._scatter, measurement)
            for source in self.sources.values():
                source.restart()
        else:
            dt = (stamp_ns - before_ns) * 1e-9
            follow_scatter(self._scatter, measurement, dt, period or math.inf)
        _, self._speed, _, status = self.alone.estimate()
        _, self._sigma = self.alone.stddev()
        if status == TRACKING and 0.0 < self._sigma < math.inf:
            self._fuse(Angle(stamp_ns, measurement, self._scatter.variance))
        return True

    def _fuse(self, angle: Angle) -> None:
        """Weight the speeds by the angle and by the sources with their inverse variances."""
        speed, sigma = self._speed, self._sigma
        speeds = [(speed, sigma * sigma)]
        for source in self.sources.values():
            found = source.measure(angle, speed, sigma, self.alone.mean_dt)
            if found is not None:
                speeds.append(found)
        information = sum(1.0 / variance for _, variance in speeds)
        self._speed = sum(speed / variance for speed, variance in speeds) / information
        self._sigma = math.sqrt(1.0 / information)

    def estimate(self) -> tuple[float, float, float, int]:
        """See `Joint`; the speed is that with the sources."""
        position, speed, acceleration, status = self.alone.estimate()
        return position, self._speed if status == TRACKING else speed, acceleration, status

    def stddev(self) -> tuple[float, float]:
        """See `Joint`."""
        return self.alone.stddev()[0], self._sigma

    def samples(self) -> dict[str, Any]:
        """See `Joint`; in addition the state of each source."""
        states = {each.name: each.text() for each in self.sources.values()}
        return {**self.alone.samples(), 'sources': states}
