# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One joint: an observer with its gains, the guard, and counts of all samples."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver import batch as batches
from estimator_pkg.driver.compiled import longest_dt
from estimator_pkg.driver.guard import (
    DROPPED,
    DUPLICATE,
    LONGEST_FIRST,
    NEW_STARTS,
    SLOW_STREAM,
    USED,
    VERDICTS,
    GuardSettings,
    limits,
)
from estimator_pkg.driver.sensor_map import FIELDS, correction_of, make_mapped, placed
from estimator_pkg.driver.sensor_marks import Errors, Learner
from estimator_pkg.driver.track import field_of, make_track, replaced
from estimator_pkg.observers.circle import Circle, nearest_turn
from estimator_pkg.observers.contract import STATUS_NAMES, Functions, Observer, Past
from estimator_pkg.parameters import structural

_is_running, _mean_dt, _state, _coefficients, _repeats, _queue, _last_ns, _reading = map(
    field_of,
    ('running', 'mean_dt', 'state', 'coefficients', 'repeats', 'queue', 'last_ns', 'reading'),
)

SHARED = (
    'functions',
    '_ways',
    '_design',
    'longest_dt',
)  # these depend on the gains and the wrap period


@dataclass(frozen=True)
class JointSettings(GuardSettings):
    """Parameters per joint in addition to the observer's gains."""

    wrap_period: float = structural(
        2.0 * math.pi,
        unit='rad',
        range=(0.0, 1e6),
        description='period after which the reading repeats; 0: prismatic or multi-turn joint, '
        'without wrapping',
    )
    unwrap: bool = structural(
        False, description='count turns from the first sample and publish a multi-turn position'
    )


NONE, LEARN = 'none', 'learn'  # of the parameter sensor_map
IN_BURSTS = 0.5  # evidence of a queue that the status reports
PART = 65_536  # samples after which a batch looks for what was learnt


@dataclass(frozen=True)
class SensorSettings(JointSettings):
    """Parameters per joint of observers that take single angles."""

    sensor_map: str = structural(
        LEARN,
        choices=(NONE, LEARN),
        description='learn: errors of the sensor that repeat each turn (eccentricity, misplaced '
        'edges, edges that come late) are learnt while the joint turns, and taken out of its '
        'readings where that is proven to help',
    )


class Joint:
    """A joint's observer, live: pass it samples, read its estimate.

    Parameters
    ----------
    observer : the observer.
    gains : an instance of ``observer.gains``.
    settings : wrap period, gaps, reordering.
    twin : a joint of the same observer; for equal gains both share its functions.
    """

    functions: Functions
    longest_dt: float
    _ways: tuple[tuple, tuple]  # functions of the track and its batch, without and with a map
    _blank: Callable[..., tuple]
    _advance: Callable[..., tuple]
    _read: Callable[..., tuple]
    _deviation: Callable[..., tuple]
    _batch: Callable[..., tuple]
    _design: tuple

    def __init__(
        self, observer: Observer, gains: Any, settings: JointSettings, twin: Joint | None = None
    ) -> None:
        self.observer = observer
        self.settings = settings
        self.counts = [0] * len(VERDICTS)
        self.stamp_ns = 0
        self.reset_count = 0
        self._new_starts = 0  # their number at the last reset
        self._track: tuple = ()
        self._structure(gains, twin)
        self._begin()
        self.verdict = DUPLICATE
        self._measurement: Any = self.functions.blank
        self._known_input: Any = self.functions.no_input

    def _structure(self, gains: Any, twin: Joint | None) -> None:
        self.gains = gains
        if (
            twin is not None
            and twin.gains == gains
            and all(
                getattr(twin.settings, name) == getattr(self.settings, name)
                for name in ('wrap_period', 'unwrap', 'sensor_map')
                if hasattr(self.settings, name)
            )
        ):
            for name in SHARED:
                setattr(self, name, getattr(twin, name))
            self._limits = limits(self.settings, self.longest_dt)
            self._choose()
            return
        self.functions = self.observer.build(
            gains, Circle(self.settings.wrap_period, self.settings.unwrap)
        )
        period = self.settings.wrap_period if self.observer.kind == 'angle' else None
        track = make_track(self.functions, period)
        mapped = make_mapped(track, period) if period else track
        self._ways = ((*track, batches.make_batch(track)), (*mapped, batches.make_batch(mapped)))
        self._choose()
        self._design = self.functions.design()
        self.longest_dt = longest_dt(self.functions.limits)
        self._limits = limits(self.settings, self.longest_dt)

    def _choose(self) -> None:
        """Use the functions that fit the track."""
        way = self._ways[len(self._track) > FIELDS]
        self._blank, self._advance, self._read, self._deviation, self._batch = way

    def _begin(self) -> None:
        """Start as if no sample had come."""
        self._track = self._blank(self._design)
        self._choose()
        self._begin_to_learn()

    def _begin_to_learn(self) -> None:
        """Learn the sensor from the next sample on: its quantum, and its errors."""
        self._past: Past = None if self.functions.again is None else ()
        period = self.settings.wrap_period
        learns = period and getattr(self.settings, 'sensor_map', NONE) == LEARN
        self.learner = (
            Learner(period, _quantum(self.gains), self.functions.edges) if learns else None
        )
        self._left = self.learner.left if self.learner else -1  # samples that it does not need

    def goes_on_with(self, functions: Functions) -> bool:
        """Return True if the state can be kept with the functions of other gains (tries a step).

        Raises
        ------
        ArithmeticError, ValueError : the functions fail with this state.
        """
        design = functions.design()
        if _shape(functions.init(functions.blank, design)) != _shape(
            self.functions.init(self.functions.blank, self._design)
        ):
            return False
        coefficients = functions.prepare(design, self.mean_dt or 1e-3)
        state = functions.step(
            self.state, coefficients, design, self._measurement, self._known_input
        )
        functions.output(state, coefficients, design, self._measurement, self._known_input)
        return True

    def set_gains(self, gains: Any, twin: Joint | None = None) -> None:
        """Use other gains from the next sample on; the state is kept.

        The caller must ensure that no structural parameter changes.

        Parameters
        ----------
        gains, twin : as of the class.
        """
        quantum = _quantum(self.gains)
        self._structure(gains, twin)
        if _quantum(gains) != quantum:  # another sensor: its map is another one
            self._track = self._track[:FIELDS]
            self._choose()
            self._begin_to_learn()
        # no sample time is 0 ns, so the next sample computes the coefficients anew
        self._track = replaced(self._track, dt_ns=0)

    def set_settings(self, settings: JointSettings) -> None:
        """Use other guard settings from the next sample on; the state is kept."""
        self.settings = settings
        self._limits = limits(settings, self.longest_dt)

    def rehearse(self) -> None:
        """Take samples and discard them, so that everything is created or imported in advance."""
        blank, advance, read, deviation, _ = self._ways[0]
        track, still = blank(self._design), self.functions.blank
        for k in range(1, 4):
            track, _ = advance(
                track, self._design, self._limits, k * 1_000_000, still, self.functions.no_input
            )
        read(track, self._design, self._limits, still, self.functions.no_input)
        deviation(track, self._design)

    def reset(self) -> None:
        """Reset the observer to its start; the counters continue."""
        self._begin()
        self.reset_count += 1
        self._new_starts = self._count_new_starts()

    def update(self, stamp_ns: int, measurement: Any, known_input: Any = 0.0) -> bool:
        """Take one sample; return True if it was used, False if it was dropped (and counted)."""
        before = self._track
        self._track, verdict = self._advance(
            before, self._design, self._limits, stamp_ns, measurement, known_input
        )
        if self._past is not None:
            self._track, self._past = self._again(before, self._track, self._past, verdict)
        self.verdict = verdict
        self.counts[verdict] += 1
        if verdict < DUPLICATE:
            self.stamp_ns = stamp_ns
            self._measurement = measurement
            self._known_input = known_input
            if self._left and verdict == USED:
                self._left -= 1
            else:
                self._learn(stamp_ns, measurement, verdict)
            return True
        return False

    def _again(self, before: tuple, track: tuple, past: tuple, verdict: int) -> tuple[tuple, Past]:
        """Return the track and the past (see `Functions.again`) after one sample.

        Parameters
        ----------
        before : the track before the sample.
        track : after it.
        """
        again, state = self.functions.again, _state(track)
        if again is None or len(track) > FIELDS:  # a sensor that is known so well
            return track, None
        if state is _state(before):
            return track, past
        if verdict != USED:  # a start, or a gap
            return track, ()
        left, after = again(
            past, _state(before), state, _coefficients(track), self._design, _reading(track), 0.0
        )
        return (track if after is state else replaced(track, state=after)), left

    def _learn(self, stamp_ns: int, measurement: float, verdict: int) -> None:
        """Pass a sample that was used to the learner."""
        learner = self.learner
        if learner is None or (self._left and not learner.awake):
            self._left -= 1
            return
        if not learner.awake:
            learner.look((stamp_ns,), (self.estimate()[1],))
        elif learner.note(stamp_ns, measurement, verdict):
            self._track = placed(self._track, learner)
            self._choose()
        self._left = learner.left

    def estimate(self) -> tuple[float, float, float, int]:
        """Return (position, velocity, acceleration or nan, status) at the last used sample."""
        return self._read(
            self._track, self._design, self._limits, self._measurement, self._known_input
        )

    def stddev(self) -> tuple[float, float]:
        """Return the standard deviations of position and velocity."""
        return self._deviation(self._track, self._design)

    def written(self, position: float) -> float:
        """Return a measured position in the convention of the estimate: with its turns, if any."""
        if not self.settings.unwrap:
            return position
        return nearest_turn(position, self.estimate()[0], self.settings.wrap_period)

    def correction(self) -> float:
        """Return what `sensor_map` adds to the newest reading [rad]."""
        return correction_of(self._track)

    def sensor_errors(self, heading: int) -> Errors:
        """Return the errors that `sensor_map` takes out now; see `Learner.errors`."""
        if self.learner is None:
            return lambda angles, speeds: np.zeros(len(angles))
        return self.learner.errors(heading)

    def run(
        self,
        stamps: NDArray[np.int64],
        measurements: NDArray[np.float64],
        known_input: NDArray[np.float64] | None = None,
        *,
        fast: bool | None = None,
    ) -> batches.Estimates:
        """Take many samples; return all estimates, equal to those sample by sample.

        Parameters
        ----------
        stamps : shape (n,), int64 nanoseconds, as received.
        measurements : shape (n,) [rad or m].
        known_input : shape (n,), known input; None: zero.
        fast : compile or not; None: if it pays.
        """
        out = self._estimates(stamps, measurements, known_input, fast)
        others = out.verdict[out.verdict != USED]
        self.counts[USED] += len(stamps) - len(others)
        for verdict, count in enumerate(np.bincount(others, minlength=len(VERDICTS))):
            self.counts[verdict] += int(count)
        if len(stamps):
            self.verdict = int(out.verdict[-1])
        if out.used.any():
            last = len(stamps) - 1 - int(np.argmax(out.used[::-1]))
            self.stamp_ns = int(stamps[last])
            self._measurement = float(measurements[last])
            self._known_input = (
                self.functions.no_input if known_input is None else float(known_input[last])
            )
        return out

    def _estimates(
        self,
        stamps: NDArray[np.int64],
        measurements: NDArray[np.float64],
        known_input: NDArray[np.float64] | None,
        fast: bool | None,
    ) -> batches.Estimates:
        fast = len(stamps) >= batches.COMPILE_FROM if fast is None else fast
        out, at, learner = batches.empty(len(stamps)), 0, self.learner
        changes = np.empty(0, np.intp)  # rows whose reading differs from the one before
        if self._past is not None:
            changes = 1 + np.flatnonzero(measurements[1:] != measurements[:-1])

        def take(track: tuple, rows: slice, fast: bool) -> tuple:
            """Fill these rows; return the track after them."""
            return batches.run(
                self._batch,
                track,
                self._design,
                self._limits,
                stamps[rows],
                measurements[rows],
                None if known_input is None else known_input[rows],
                fast=fast,
                out=out.part(rows),
            )[0]

        def run(end: int) -> tuple[tuple, Past]:
            """Fill the rows from `at` to `end`; return the track and the past after them."""
            track, past, i, waits = self._track, self._past, at, False
            while past is not None and i < end:
                same = bool(measurements[i] == _reading(track))
                if waits and same:  # no start before it changes
                    change = np.searchsorted(changes, i, side='right')
                    until = end if change == len(changes) else min(end, int(changes[change]))
                    track, i = take(track, slice(i, until), fast), until
                    continue
                taken = take(track, slice(i, i + 1), False)
                track, past = self._again(track, taken, past, int(out.verdict[i]))
                if track is not taken:
                    estimate = self._read(
                        track, self._design, self._limits, float(measurements[i]), 0.0
                    )
                    out.put(i, estimate, self._deviation(track, self._design))
                waits = same and past == () and out.verdict[i] == USED
                i += 1
            return take(track, slice(i, end), fast), past

        while at < len(stamps):
            end = len(stamps)
            if learner is not None:
                end = min(end, at + (learner.room if len(self._track) > FIELDS else PART))
            track, past = run(end)
            if learner is not None:
                used = out.part(slice(at, end)).used
                every = bool(used.all())
                kept = slice(at, end) if every else at + np.flatnonzero(used)  # a slice is no copy
                learner.left = self._left
                count = learner.follow(
                    stamps[kept], measurements[kept], out.verdict[kept], out.velocity[kept]
                )
                if 0 < count < np.count_nonzero(used):  # something else is taken out from there on
                    end = at + (count if every else int(np.flatnonzero(used)[count - 1]) + 1)
                    track, past = run(end)
                track = placed(track, learner) if count else track
                self._left = learner.left
            self._track, self._past = track, past
            self._choose()
            at = end
        return out

    @property
    def running(self) -> bool:
        """True if a sample has arrived since the start or the last reset."""
        return _is_running(self._track)

    @property
    def state(self) -> Any:
        """The observer's state."""
        return _state(self._track)

    @property
    def coefficients(self) -> Any:
        """The observer's coefficients at the last sample time."""
        return _coefficients(self._track)

    @property
    def last_ns(self) -> int:
        """The last stamp that the guard accepted [ns]."""
        return _last_ns(self._track)

    @property
    def mean_dt(self) -> float:
        """Mean sample time [s]; 0 before the second sample."""
        return _mean_dt(self._track)

    @property
    def silence(self) -> float:
        """Silence after which the joint is lost [s]; between two stamps it is an outage."""
        slowest = self.mean_dt
        if slowest == 0.0 and self.running:  # one sample does not show the rate
            slowest = LONGEST_FIRST / SLOW_STREAM
        return max(self.settings.timeout, self.settings.gap_max, SLOW_STREAM * slowest)

    @property
    def received(self) -> int:
        """Number of received samples, used and dropped."""
        return sum(self.counts)

    @property
    def used(self) -> int:
        """Number of samples that reached the observer."""
        return sum(self.counts[:DUPLICATE])

    def dropped(self) -> dict[str, int]:
        """Return the number of dropped samples by reason; reasons without any are omitted."""
        return {kind: count for kind, count in zip(DROPPED, self.counts[DUPLICATE:]) if count}

    def events(self) -> dict[str, int]:
        """Return the number of gaps, outages, clock jumps and stray stamps before used samples."""
        return {
            kind: count
            for kind, count in zip(VERDICTS[2:DUPLICATE], self.counts[2:DUPLICATE])
            if count
        }

    def why(self) -> str:
        """Return the meaning of the status, or another note for the user, as text."""
        status = self.estimate()[3]
        if STATUS_NAMES[status] == 'misconfigured':
            return self.functions.limits(self.mean_dt) or ''
        said = self._repeating()
        if not said and self.functions.why is not None and self.running:
            said = self.functions.why(self.state, self._design)
        if not said and self.settings.unwrap and self._count_new_starts() > self._new_starts:
            return 'turns may have been lost in an outage or a clock jump (~/reset restarts them)'
        if not said and _queue(self._track) > IN_BURSTS:
            return (
                'stamps come in bursts: samples that waited in a queue are taken at the mean '
                'sample time (stamp them where they are measured, or see stamp_repair)'
            )
        return said or ('' if self.learner is None else self.learner.text())

    def _repeating(self) -> str:
        """Return a note on repeated readings; '' without any."""
        times, *_ = _repeats(self._track)
        if not times:
            return ''
        return (
            f'the stream repeats its readings (up to {times} times each): the repeated '
            'ones are dropped'
        )

    def _count_new_starts(self) -> int:
        return sum(self.counts[verdict] for verdict in NEW_STARTS)


def _quantum(gains: Any) -> float:
    """Return the quantum that gains declare [rad]; 0: none is known."""
    return float(getattr(gains, 'quantum', 0.0) or 0.0)


def _shape(state: Any) -> Any:
    """Return the nested lengths of a state's tuples."""
    return tuple(map(_shape, state)) if isinstance(state, tuple) else ()
