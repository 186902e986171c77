# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A joint of which other sensors tell something, too.

Two joints run on the same samples: one on the angle alone, the other is also informed by the
sources. A source informs only while it agrees with the angle alone; else the informed joint goes on
as the other one, so that a wrong source does not stay in it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from estimator_pkg.circle import nearest_turn
from estimator_pkg.driver.configuration import AS_ACCELERATION, AS_ANGLE
from estimator_pkg.driver.joint import Joint
from estimator_pkg.estimate import TRACKING
from estimator_pkg.observers.maths.informing import ACCELERATION, RATE
from estimator_pkg.sensor.source import (
    BIAS,
    RATIO,
    SHIFT,
    Source,
    agree,
    begin_source,
    follow_source,
    forget_source,
    meet_angle,
    resume_source,
    speed_of,
    variance_of_speed,
    white,
)

DOUBTED = 0.25  # time without agreement after which a source is withheld [s]
FADING = 0.2  # time of doubt that a time of agreement takes back, over it
PLAY = 0.8  # the same of a second encoder [s]
PROOF, LONGEST_PROOF = (
    1.0,
    64.0,
)  # time for which it agrees before it informs [s]: doubled each time
SILENT = 0.5  # time without a value, after which it is silent [s]
OLD = 2.0  # sample times after which a value tells nothing any more
BETTER = 4.0  # times the variance of the speed from the angle alone, to be worth it
QUEUE = 4096  # values that wait for a reading at most


@dataclass(frozen=True)
class Telling:
    """What a user says of a source.

    kind : 'rate', 'angle' or 'acceleration'. ratio : of the joint's motion to the value; 0: learnt.
    delay : of the value behind the angle [s]; below 0: learnt.
    """

    name: str
    kind: str
    ratio: float
    delay: float


class Teller:
    """One source of one joint.

    Attributes
    ----------
    source : what is learnt of it. used : True while it informs.
    said : why it does not, or what was seen when it was withheld; '' while it informs.
    notices : new texts for the user.
    """

    def __init__(self, telling: Telling, own: Joint | None) -> None:
        self.telling, self._own = telling, own
        self.source = Source()
        begin_source(self.source, telling.ratio, telling.delay)
        self._queue: list[tuple[int, float]] = []
        self._doubt, self._proof, self._agrees_ns = 0.0, PROOF, 0
        self._knows = self.used = False
        self.said, self.notices = 'no value yet', list[str]()
        self.variance = math.nan  # of what it told last; nan: nothing

    def hear(self, stamp_ns: int, value: float) -> None:
        """Take a value; it counts from the joint's next reading on."""
        if math.isfinite(value) and stamp_ns > self.source.stamp_ns:
            self._queue.append((stamp_ns, value))
            del self._queue[:-QUEUE]

    def _follow(self, until_ns: int) -> None:
        """Take the values up to this time [ns]."""
        source = self.source
        late = 0
        for stamp_ns, value in self._queue:
            if stamp_ns > until_ns:
                break
            late += 1
            if stamp_ns <= source.stamp_ns:
                continue
            moved, variance = math.nan, 0.0
            if self._own is not None:  # an angle: what it moves, and how fast
                before = self._own.estimate()[0] if self._own.running else math.nan
                if not self._own.update(stamp_ns, value):
                    continue
                position, value, _, status = self._own.estimate()
                variance = self._own.stddev()[1] ** 2
                if status != TRACKING or not variance > 0.0 or math.isnan(before):
                    source.stamp_ns = 0
                    continue
                period = self._own.settings.wrap_period
                moved = (
                    nearest_turn(position - before, 0.0, period) if period else position - before
                )
            follow_source(source, stamp_ns, value, moved, variance)
        del self._queue[:late]

    def tell(
        self, alone: Joint, fused: float, acceleration: float, stamp_ns: int, reading: float
    ) -> float | None:
        """Return the speed [rad/s] that the source tells at a reading [rad]; None: nothing.

        The variance is in `variance` then.
        """
        self._follow(stamp_ns)
        self.variance = math.nan
        source = self.source
        angle, speed, _, status = alone.estimate()
        if status != TRACKING or source.stamp_ns == 0:
            self._knows = False
            return None
        since = (stamp_ns - source.stamp_ns) * 1e-9
        if since > SILENT and self.used:
            self.used, self.said = False, 'silent'
            self.notices.append(f'{self.telling.name} is silent for {since:.2g} s')
        if not source.news or since > OLD * source.dt:
            return None
        sigma_x, sigma_v = alone.stddev()
        if self.telling.kind == AS_ACCELERATION:
            return self._accelerate(speed, fused, sigma_v * sigma_v, stamp_ns)
        if not self._knows:
            source.readings = max(source.readings, sigma_x * sigma_x)
            forget_source(source, angle)
            if self._own is not None:
                source.p[BIAS][BIAS] = 0.0  # encoders do not drift
            self._knows, self._agrees_ns, source.news = True, stamp_ns, False
            return None
        fits = meet_angle(
            source,
            stamp_ns,
            reading,
            angle,
            speed * alone.mean_dt,
            sigma_x * sigma_x,
            alone.settings.wrap_period,
        )
        told = speed_of(source, since, acceleration)
        variance = variance_of_speed(source)
        plays = self._own is not None  # backlash lies between two encoders: both may be right
        if plays and not fits:
            resume_source(source, angle)
        if not agree(told, speed, variance + sigma_v * sigma_v):
            self._doubt += source.dt
            resume_source(source, angle)
            if self._doubt < (PLAY if plays else DOUBTED):
                return None
        elif fits:
            self._doubt = max(0.0, self._doubt - FADING * source.dt)
        if (not fits and not plays) or self._doubt >= (PLAY if plays else DOUBTED):
            self._withhold(
                f'it says {told:.4g} rad/s, the angle {speed:.4g} +- {sigma_v:.2g}', stamp_ns
            )
            return None
        agreed = (stamp_ns - self._agrees_ns) * 1e-9
        if (agreed < self._proof and not self.used) or variance * BETTER > sigma_v * sigma_v:
            return None  # unproven, or less sure than the angle
        if not self.used and self._proof > PROOF:
            self.notices.append(f'{self.telling.name} agrees again and is used')
        elif agreed > LONGEST_PROOF:
            self._proof = PROOF
        self.used, self.said, self.variance = True, '', variance
        return told

    def _accelerate(
        self, alone: float, fused: float, variance: float, stamp_ns: int
    ) -> float | None:
        """Return the acceleration that the source tells, as long as the speed stays right.

        Parameters
        ----------
        alone, fused : speed from the angle alone, and informed [rad/s]. variance : of the former.
        """
        source = self.source
        source.news = False
        if not self._knows:
            source.known[RATIO], self._knows, self._agrees_ns = self.telling.ratio, True, stamp_ns
        self._doubt = max(0.0, self._doubt - FADING * source.dt)
        apart = self.used and not agree(alone, fused, variance)
        if apart:  # which takes a while to show, and begins again from the angle alone
            self._doubt += DOUBTED / 3.0
        if self._doubt >= DOUBTED:
            self._withhold(
                f'with it the speed is {fused:.4g} rad/s, of the angle {alone:.4g}', stamp_ns
            )
        if apart or (stamp_ns - self._agrees_ns) * 1e-9 < self._proof or not self._knows:
            return None
        self.used, self.said, self.variance = True, '', white(source)
        return source.known[RATIO] * source.value

    def _withhold(self, seen: str, stamp_ns: int) -> None:
        """Use the source no more until it has agreed for a while."""
        if self.used:
            self.notices.append(f'{self.telling.name} is withheld: {seen}')
            self.said, self._proof = f'withheld: {seen}', min(2.0 * self._proof, LONGEST_PROOF)
        elif not self.said.startswith('withheld'):
            self.said = f'not used: {seen}'
        self._knows = self.used = False
        self._doubt, self.variance = 0.0, math.nan

    def learnt(self) -> dict[str, tuple[float, float, str]]:
        """Return what was learnt by name: value, standard deviation, unit."""
        known, p = self.source.known, self.source.p
        ratio, shift = known[RATIO], known[SHIFT]
        found = {
            'bias': (known[BIAS], p[BIAS][BIAS], ' rad/s'),
            'ratio': (ratio, p[RATIO][RATIO], ''),
            'delay': (shift / ratio, p[SHIFT][SHIFT] / (ratio * ratio), ' s'),
        }
        return {k: (value, math.sqrt(p), unit) for k, (value, p, unit) in found.items() if p > 0.0}

    def text(self) -> str:
        """Return what is known of the source, for people."""
        if not self._knows:
            return self.said
        learnt = [f'{k} {v:.4g} +- {s:.1g}{unit}' for k, (v, s, unit) in self.learnt().items()]
        return ', '.join([self.said or 'used', *learnt])


class Informed:
    """A `Joint` that other sensors inform; what it does not define is that of the angle alone."""

    compiled = memory = None  # its messages are taken one by one

    def __init__(
        self, observer: Any, gains: Any, settings: Any, tellings: Sequence[tuple[int, Telling]]
    ):
        self.alone = Joint(observer, gains, settings)
        self.fused = Joint(observer, gains, settings)
        self.tellers = {
            number: Teller(
                each, Joint(observer, observer.gains(), settings) if each.kind == AS_ANGLE else None
            )
            for number, each in tellings
        }
        self._sure = math.nan  # variance of what the surest source told

    def __getattr__(self, name: str) -> Any:
        return getattr(self.alone, name)

    def hear(self, number: int, stamp_ns: int, value: float) -> None:
        """Take a value of a source."""
        if number in self.tellers:
            self.tellers[number].hear(stamp_ns, value)

    def update(self, stamp_ns: int, measurement: float, known_input: float = 0.0) -> bool:
        """See `Joint`."""
        used = self.alone.update(stamp_ns, measurement)
        self.fused.update(stamp_ns, measurement)
        if not used:
            return False
        sure, came, informed = 0.0, False, False  # 1/variance of the told speeds
        reading, acceleration = self.alone.written(measurement), self.alone.estimate()[2]
        fused = self.fused.estimate()[1]
        acceleration = acceleration if math.isfinite(acceleration) else 0.0
        for teller in self.tellers.values():
            before = teller.source.stamp_ns
            told = teller.tell(self.alone, fused, acceleration, stamp_ns, reading)
            came = came or teller.source.stamp_ns != before or not teller.used
            if told is not None:
                rate = teller.telling.kind != AS_ACCELERATION
                self._inform(RATE if rate else ACCELERATION, told, teller.variance)
                sure += rate / teller.variance
                informed = True
        self._sure = 1.0 / sure if sure > 0.0 else math.nan
        if came and not informed:
            self._go_on_alone()
        return True

    def _inform(self, kind: int, value: float, variance: float) -> None:
        fused = self.fused
        if fused.memory is not None:
            fused.compiled.inform(fused.memory.pointer, kind, value, variance)
        else:
            fused.plain.inform(fused.module, fused._channel, kind, value, variance)

    def _go_on_alone(self) -> None:
        """Continue the informed joint as the other one."""
        if self.fused.memory is not None:
            self.fused.memory.array[:] = self.alone.memory.array
        else:
            self.fused._channel.take(self.alone._channel)

    def estimate(self) -> tuple[float, float, float, int]:
        """See `Joint`."""
        return self.fused.estimate()

    def stddev(self) -> tuple[float, float]:
        """See `Joint`; informed, it is as sure as source and angle together."""
        position, velocity = self.fused.stddev()
        if self._sure >= 0.0:
            alone = self.alone.stddev()[1]
            velocity = alone * math.sqrt(self._sure / (self._sure + alone * alone))
        return position, velocity

    def set_gains(self, gains: Any) -> None:
        """See `Joint`."""
        self.alone.set_gains(gains)
        self.fused.set_gains(gains)

    def set_settings(self, settings: Any) -> None:
        """See `Joint`."""
        self.alone.set_settings(settings)
        self.fused.set_settings(settings)

    def reset(self) -> None:
        """See `Joint`; what was learnt of the sources stays."""
        self.alone.reset()
        self.fused.reset()

    def rehearse(self) -> None:
        """See `Joint`."""
        self.alone.rehearse()
