# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A joint that is measured by further sensors in addition to its angle.

Two joints run on the same samples: one on the angle alone, the other also fuses the sources. A
source is fused only while it agrees with the angle alone; else the fused joint
continues as a copy of the other one, so that no error of a source stays in it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from estimator_pkg.circle import nearest_turn, wrap
from estimator_pkg.driver.configuration import AS_ACCELERATION, AS_ANGLE, SourceSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.estimate import TRACKING
from estimator_pkg.observers.maths.informing import FUSE_ACCELERATION, FUSE_RATE
from estimator_pkg.sensor.source import (
    BIAS,
    SCALE,
    SHIFT,
    SourceFilter,
    X,
    agree,
    begin_source,
    correct_by_angle,
    follow_source,
    forget_source,
    noise_variance,
    resume_source,
    speed_of,
    variance_of_speed,
)

DOUBTED = 0.25  # time without agreement after which a source is withheld [s]
PLAY = 0.8  # the same of a second encoder, which backlash moves [s]
FADING = 0.2  # time of doubt that each second of agreement takes back [s]
PROBATION, LONGEST_PROBATION = 1.0, 64.0  # agreement before it informs [s]; doubled each time
SOURCE_SILENT = 0.5  # time without a value after which it is silent [s]
BACKLASH_MEMORY = 0.5  # part of the backlash that is remembered from one reversal to the next
LONGEST_AGE = 2.0  # sample times after which a value is not used
VARIANCE_GAIN = 4.0  # times the variance of the speed from the angle alone, to be worth it
SOURCE_QUEUE = 4096  # values that wait for a reading at most


class SecondSensor:
    """One source of one joint.

    Attributes
    ----------
    source : its estimated bias, ratio and delay. used : True while it informs.
    reason : why it does not inform; '' while it does.
    notices : new texts for the user.
    variance : of the value that `measure` returned last; nan: it returned None.
    """

    def __init__(self, name: str, settings: SourceSettings, own: Joint | None) -> None:
        self.name, self.settings, self._own = name, settings, own
        self.source = SourceFilter()
        begin_source(self.source, settings.ratio, settings.delay)
        self._queue: list[tuple[int, float]] = []
        self._doubt, self._proof, self._agrees_ns = 0.0, PROBATION, 0
        self._knows = self.used = False
        self._sense = self._shift = self._turned = self._way = self._backlash = 0.0
        self.reason, self.notices = 'no value yet', list[str]()
        self.variance = math.nan

    def receive(self, stamp_ns: int, value: float) -> None:
        """Queue a value for the joint's next reading."""
        if math.isfinite(value) and stamp_ns > self.source.stamp_ns:
            self._queue.append((stamp_ns, value))
            del self._queue[:-SOURCE_QUEUE]

    def _follow(self, until_ns: int) -> None:
        """Filter the queued values up to this time [ns]."""
        source = self.source
        late = 0
        for stamp_ns, value in self._queue:
            if stamp_ns > until_ns:
                break
            late += 1
            if stamp_ns <= source.stamp_ns:
                continue
            moved, variance = math.nan, 0.0
            if self._own is not None:  # an angle: its displacement and its speed
                before = self._own.estimate()[0] if self._own.running else math.nan
                if not self._own.update(stamp_ns, value):
                    continue
                position, value, _, status = self._own.estimate()
                variance = self._own.stddev()[1] ** 2
                if status != TRACKING or not 0.0 < variance < math.inf or math.isnan(before):
                    source.stamp_ns = 0
                    continue
                period = self._own.settings.wrap_period
                moved = (
                    nearest_turn(position - before, 0.0, period) if period else position - before
                )
                self._play(moved, value, variance, period)
            follow_source(source, stamp_ns, value, moved, variance)
        del self._queue[:late]

    def _play(self, moved: float, speed: float, variance: float, period: float) -> None:
        """Measure the backlash between two encoders: their shift from one reversal to the next.

        Parameters
        ----------
        moved : displacement of the source since its last value. speed, variance : of the source.
        period : wrap period [rad]; 0: none.
        """
        source, known = self.source, self.source.known
        if speed * self._sense <= 0.0 and speed * speed > 4.0 * variance:
            shift = known[X] - self._turned
            width = abs(wrap(shift - self._shift, period))
            width -= math.sqrt(source.readings)  # what readings alone shift
            self._backlash = max(width, BACKLASH_MEMORY * self._backlash) if self._sense else 0.0
            self._sense, self._shift, self._way = math.copysign(1.0, speed), shift, 0.0
        self._turned += known[SCALE] * moved
        self._way += abs(known[SCALE] * moved)

    def measure(
        self, alone: Joint, fused: float, acceleration: float, stamp_ns: int, reading: float
    ) -> float | None:
        """Return the joint's speed [rad/s] (or acceleration) by the source; None: it is not used.

        Parameters
        ----------
        alone : the joint on its angle alone. fused : fused speed [rad/s].
        acceleration : of the joint [rad/s^2]. reading : of its angle [rad].
        """
        self._follow(stamp_ns)
        self.variance = math.nan
        source = self.source
        angle, speed, _, status = alone.estimate()
        if status != TRACKING or source.stamp_ns == 0:
            self._knows = False
            return None
        since = (stamp_ns - source.stamp_ns) * 1e-9
        if since > SOURCE_SILENT and self.used:
            self.used, self.reason = False, 'silent'
            self.notices.append(
                f'{self.name} is silent for {since:.2g} s and is not used: check its publisher'
            )
        if not source.news or since > LONGEST_AGE * source.dt:
            return None
        sigma_x, sigma_v = alone.stddev()
        if math.isinf(sigma_x + sigma_v):  # the angle alone does not know yet
            return None
        if self.settings.kind == AS_ACCELERATION:
            return self._accelerate(speed, fused, sigma_v * sigma_v, stamp_ns)
        if not self._knows:
            source.readings = max(source.readings, sigma_x * sigma_x)
            forget_source(source, angle)
            self._sense = 0.0
            if self._own is not None:
                source.p[BIAS][BIAS] = 0.0  # encoders do not drift
            self._knows, self._agrees_ns, source.news = True, stamp_ns, False
            return None
        if self._way < self._backlash:  # between the two encoders: it shows nothing of the joint
            resume_source(source, angle)
            source.news = False
            return None
        fits = correct_by_angle(
            source,
            stamp_ns,
            reading,
            angle,
            speed * alone.mean_dt,
            sigma_x * sigma_x,
            alone.settings.wrap_period,
        )
        measured = speed_of(source, since, acceleration)
        variance = variance_of_speed(source)
        plays = self._own is not None  # backlash lies between two encoders: both may be right
        if plays and not fits:
            resume_source(source, angle)
        if not agree(measured, speed, variance + sigma_v * sigma_v):
            self._doubt += source.dt
            resume_source(source, angle)
            if self._doubt < (PLAY if plays else DOUBTED):
                return None
        elif fits:
            self._doubt = max(0.0, self._doubt - FADING * source.dt)
        if (not fits and not plays) or self._doubt >= (PLAY if plays else DOUBTED):
            self._withhold(
                f'it measures {measured:.4g} rad/s, the angle shows {speed:.4g} +- {sigma_v:.2g} '
                'rad/s',
                stamp_ns,
            )
            return None
        agreed = (stamp_ns - self._agrees_ns) * 1e-9
        proven = self.used or agreed >= self._proof
        if not proven or variance * VARIANCE_GAIN > sigma_v * sigma_v:
            if proven and not self.used and not self.reason.startswith('withheld'):
                self.reason = (
                    f'not used: standard deviation {math.sqrt(variance):.2g} rad/s, that of the '
                    f'angle alone is {sigma_v:.2g} rad/s'
                )
            return None
        if self.reason.startswith(('withheld', 'silent')):
            self.notices.append(f'{self.name} agrees again and is used')
        elif agreed > LONGEST_PROBATION:
            self._proof = PROBATION
        self.used, self.reason, self.variance = True, '', variance
        return measured

    def _accelerate(
        self, alone: float, fused: float, variance: float, stamp_ns: int
    ) -> float | None:
        """Return the acceleration by the source while the fused speed agrees with the angle.

        Parameters
        ----------
        alone, fused : speed from the angle alone, and fused [rad/s]. variance : of the former.
        """
        source = self.source
        source.news = False
        if not self._knows:
            source.known[SCALE], self._knows, self._agrees_ns = self.settings.ratio, True, stamp_ns
        self._doubt = max(0.0, self._doubt - FADING * source.dt)
        apart = self.used and not agree(alone, fused, variance)
        if apart:  # shows late, as the fused joint continues from the angle alone
            self._doubt += DOUBTED / 3.0
        if self._doubt >= DOUBTED:
            self._withhold(
                f'with it the speed is {fused:.4g} rad/s, the angle shows {alone:.4g} rad/s',
                stamp_ns,
            )
        if apart or (stamp_ns - self._agrees_ns) * 1e-9 < self._proof or not self._knows:
            return None
        self.used, self.reason, self.variance = True, '', noise_variance(source)
        return source.known[SCALE] * source.value

    def _withhold(self, seen: str, stamp_ns: int) -> None:
        """Stop using the source until it has agreed for `_proof` seconds."""
        if self.used:
            self.notices.append(
                f'{self.name} is withheld: {seen}; check its joint, sign, ratio and stamps'
            )
            self.reason, self._proof = (
                f'withheld: {seen}',
                min(2.0 * self._proof, LONGEST_PROBATION),
            )
        elif not self.reason.startswith('withheld'):
            self.reason = f'not used: {seen}'
        self._knows = self.used = False
        self._doubt, self.variance = 0.0, math.nan

    def learnt(self) -> dict[str, tuple[float, float, str]]:
        """Return the learnt quantities by name: value, standard deviation, unit."""
        known, p = self.source.known, self.source.p
        ratio, shift = known[SCALE], known[SHIFT]
        if ratio == 0.0:  # nothing is known yet
            return {}
        found = {
            'bias': (known[BIAS], p[BIAS][BIAS], ' rad/s'),
            'ratio': (ratio, p[SCALE][SCALE], ''),
            'delay': (shift / ratio, p[SHIFT][SHIFT] / (ratio * ratio), ' s'),
        }
        return {k: (value, math.sqrt(p), unit) for k, (value, p, unit) in found.items() if p > 0.0}

    def text(self) -> str:
        """Return its state and the learnt quantities, for people."""
        if not self._knows:
            return self.reason
        learnt = [f'{k} {v:.4g} +- {s:.1g}{unit}' for k, (v, s, unit) in self.learnt().items()]
        return ', '.join([self.reason or 'used', *learnt])


class FusedJoint:
    """A `Joint` that other sensors inform; all other attributes are those of the angle alone."""

    compiled = memory = None  # its messages are taken one by one

    def __init__(
        self,
        observer: Any,
        gains: Any,
        settings: Any,
        sources: Sequence[tuple[int, str, SourceSettings]],
    ):
        self.alone = Joint(observer, gains, settings)
        self.fused = Joint(observer, gains, settings)
        self.sensors = {
            number: SecondSensor(
                name,
                each,
                Joint(observer, observer.gains(), settings) if each.kind == AS_ANGLE else None,
            )
            for number, name, each in sources
        }
        self._variance = math.nan  # of the speed by all sources that inform

    def __getattr__(self, name: str) -> Any:
        return getattr(self.alone, name)

    def receive(self, number: int, stamp_ns: int, value: float) -> None:
        """Take a value of a source."""
        if number in self.sensors:
            self.sensors[number].receive(stamp_ns, value)

    def update(self, stamp_ns: int, measurement: float, known_input: float = 0.0) -> bool:
        """See `Joint`."""
        used = self.alone.update(stamp_ns, measurement)
        self.fused.update(stamp_ns, measurement)
        if not used:
            return False
        weight, came, fused_any = 0.0, False, False  # weight: sum of 1/variance
        reading = self.alone.in_estimate_convention(measurement)
        acceleration = self.alone.estimate()[2]
        fused = self.fused.estimate()[1]
        acceleration = acceleration if math.isfinite(acceleration) else 0.0
        for sensor in self.sensors.values():
            before = sensor.source.stamp_ns
            value = sensor.measure(self.alone, fused, acceleration, stamp_ns, reading)
            judged = sensor.source.stamp_ns != before and not sensor.source.news
            came = came or judged or not sensor.used
            if value is not None:
                rate = sensor.settings.kind != AS_ACCELERATION
                self._inform(FUSE_RATE if rate else FUSE_ACCELERATION, value, sensor.variance)
                weight += rate / sensor.variance
                fused_any = True
        self._variance = 1.0 / weight if weight > 0.0 else math.nan
        if came and not fused_any:
            self._go_on_alone()
        return True

    def _inform(self, kind: int, value: float, variance: float) -> None:
        fused = self.fused
        if fused.memory is not None:
            fused.compiled.inform(fused.memory.pointer, kind, value, variance)
        else:
            fused.plain.inform(fused.module, fused._channel, kind, value, variance)

    def _go_on_alone(self) -> None:
        """Continue the fused joint as a copy of the other one."""
        if self.fused.memory is not None:
            self.fused.memory.array[:] = self.alone.memory.array
        else:
            self.fused._channel.take(self.alone._channel)

    def estimate(self) -> tuple[float, float, float, int]:
        """See `Joint`."""
        return self.fused.estimate()

    def stddev(self) -> tuple[float, float]:
        """See `Joint`; fused, the variance is that of sources and angle combined."""
        position, velocity = self.fused.stddev()
        if self._variance >= 0.0:
            alone = self.alone.stddev()[1]
            velocity = alone * math.sqrt(self._variance / (self._variance + alone * alone))
        return position, velocity

    def samples(self) -> dict[str, Any]:
        """See `Joint`; in addition the state of each source."""
        states = {each.name: each.text() for each in self.sensors.values()}
        return {**self.alone.samples(), 'sources': states}

    def set_gains(self, gains: Any) -> None:
        """See `Joint`."""
        self.alone.set_gains(gains)
        self.fused.set_gains(gains)

    def set_settings(self, settings: Any) -> None:
        """See `Joint`."""
        self.alone.set_settings(settings)
        self.fused.set_settings(settings)

    def reset(self) -> None:
        """See `Joint`; bias, ratio and delay of the sources stay."""
        self.alone.reset()
        self.fused.reset()

    def warm_up(self) -> None:
        """See `Joint`."""
        self.alone.warm_up()
