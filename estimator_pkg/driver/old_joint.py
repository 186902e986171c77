# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One joint: an observer with its gains, the guard, and counts of all samples."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver import batch as batches
from estimator_pkg.driver.compiled import longest_dt
from estimator_pkg.driver.configuration import LEARN, NONE, JointSettings
from estimator_pkg.driver.guard import (
    DROPPED,
    DUPLICATE,
    LONGEST_FIRST,
    NEW_STARTS,
    SLOW_STREAM,
    USED,
    VERDICTS,
    limits,
)
from estimator_pkg.driver.queues import note_on_queue
from estimator_pkg.driver.repeats import note_on_repeats
from estimator_pkg.driver.sensor_blocks import Learner
from estimator_pkg.driver.sensor_map import FIELDS, correction_of, make_mapped, placed
from estimator_pkg.driver.sensor_marks import Errors
from estimator_pkg.driver.track import field_of, make_track, replaced
from estimator_pkg.driver.turns import Turns
from estimator_pkg.observers.circle import Circle, nearest_turn
from estimator_pkg.observers.contract import STATUS_NAMES, Functions, Observer

_is_running, _mean_dt, _state, _coefficients, _repeats, _queue, _last_ns, _reading = map(
    field_of,
    ('running', 'mean_dt', 'state', 'coefficients', 'repeats', 'queue', 'last_ns', 'reading'),
)

SHARED = ('functions', '_ways', '_design', 'longest_dt')  # these depend on gains and circle


PART = 65_536  # samples after which a batch looks for what was learnt


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
    compiled = None
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
        self._circle = _circle(settings)
        self._turns: Turns | None = None
        self._structure(gains, twin)
        self._begin()
        self.verdict = DUPLICATE
        self._measurement: Any = self.functions.blank
        self._known_input: Any = self.functions.no_input

    def _structure(self, gains: Any, twin: Joint | None) -> None:
        self.gains, circle = gains, self._circle
        if twin is not None and twin.gains == gains and twin._circle == circle:
            for name in SHARED:
                setattr(self, name, getattr(twin, name))
        else:
            self.functions = self.observer.build(gains, circle)
            period = circle.period if self.functions.of_angles else None
            track = make_track(self.functions, period)
            turn = self.settings.wrap_period if self.functions.of_angles else 0.0
            mapped = make_mapped(track, turn) if turn else track
            self._ways = (
                (*track, batches.make_batch(track)),
                (*mapped, batches.make_batch(mapped)),
            )
            self._design = self.functions.design()
            self.longest_dt = longest_dt(self.functions.limits)
        self._limits = limits(self.settings, self.longest_dt)
        self._choose()

    def _choose(self) -> None:
        """Use the functions that fit the track."""
        way = self._ways[len(self._track) > FIELDS]
        self._blank, self._advance, self._read, self._deviation, self._batch = way

    def _begin(self) -> None:
        """Start as if no sample had come."""
        circle = _circle(self.settings)
        if circle != self._circle:
            self._circle = circle
            self._structure(self.gains, None)
        turns = Turns(circle.period)
        wraps = self.functions.turns and circle.period > 0.0 and not circle.unwrap
        self._turns = turns if wraps else None
        self._low, self._high = turns.usual  # readings that show nothing new
        self._track = self._blank(self._design)
        self._choose()
        self._begin_to_learn()

    def _begin_to_learn(self) -> None:
        """Learn the sensor from the next sample on: its quantum, and its errors."""
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

    def group_delay(self, dt: float) -> float:
        """Return the delay of the velocity at low frequency [s] at this dt [s]; nan: not known."""
        return self.functions.group_delay(dt)

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

    def limit(self, dt: float) -> str | None:
        """Return why the gains cannot work at this sample time [s]; None: they can."""
        return self.functions.limits(dt)

    @property
    def design(self) -> Any:
        """For `goes_on_with`."""
        return self.functions

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
        if self._turns is not None and not self._low <= measurement <= self._high:
            self._follow_turns(self._turns.after(stamp_ns, measurement))
        self._track, verdict = self._advance(
            self._track, self._design, self._limits, stamp_ns, measurement, known_input
        )
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

    def _follow_turns(self, turns: Turns) -> None:
        """Go on without a circle where the sensor counts turns, and with one where it does not."""
        known, self._turns = self._turns, None if turns.wraps else turns
        self._low, self._high = turns.usual
        if known is None or turns.counts == known.counts:
            return
        self._circle = Circle(0.0) if turns.counts else _circle(self.settings)
        self._structure(self.gains, None)
        self._track = replaced(self._track, dt_ns=0)  # the next sample computes the coefficients

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
        """Return the errors that `sensor_map` takes out now; see `Shaft.errors`."""
        if self.learner is None:
            return lambda angles, speeds: np.zeros(len(angles))
        return self.learner.shaft.errors(heading)

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
        count = len(stamps)
        samples = batches.Samples(
            stamps,
            measurements,
            np.zeros(count) if known_input is None else known_input,
            batches.empty(count),
        )
        at = 0
        while at < count:
            at = self._block(samples, at, count, fast)
        used = samples.out.used
        if used.any():
            last = count - 1 - int(np.argmax(used[::-1]))
            self.stamp_ns, self._measurement, self._known_input = samples.row(last)
        return samples.out

    def _block(self, samples: batches.Samples, at: int, end: int, fast: bool | None) -> int:
        """Take the samples from `at` on in a batch; return the row after the last one.

        It ends at the latest at `end`, and where what is taken out of the readings changes.
        """
        learner, before, known = self.learner, self._track, self._turns
        if learner is not None:
            learner.left = self._left
            end = min(end, at + (learner.room if len(before) > FIELDS else PART))
        if known is not None:
            ahead = samples.stamps[at:end], samples.measurements[at:end]
            turns, rows, change = known.after_all(*ahead)
            if rows == 0:
                self._follow_turns(change)
                return at
            end = at + rows
        part = samples.part(slice(at, end))
        fast = self.pays(len(samples.stamps)) if fast is None else fast
        self._batched(part, fast)
        if learner is not None:
            out = part.out
            count = learner.follow(part.stamps, part.measurements, out.verdict, out.velocity)
            self._left = learner.left
            if 0 < count < end - at:  # the rows after it are taken again, in the next block
                self._track, part = before, samples.part(slice(at, at + count))
                self._batched(part, fast)
            if count:
                self._track = placed(self._track, learner)
                self._choose()
        self._count(part.out.verdict)
        if known is not None:
            if len(part.stamps) < rows:  # fewer were taken
                turns, _, _ = known.after_all(part.stamps, part.measurements)
            self._follow_turns(turns)
        return at + len(part.stamps)

    def pays(self, count: int) -> bool:
        """Return True if this many samples take less time in compiled code."""
        return batches.pays(self._batch, count)

    def _batched(self, samples: batches.Samples, fast: bool) -> None:
        """Take these samples in a batch."""
        self._track = batches.run(
            self._batch, self._track, self._design, self._limits, samples, fast=fast
        )

    def _count(self, verdicts: NDArray[np.int8]) -> None:
        """Count the verdicts on the samples of a batch, shape (n,)."""
        for verdict, count in enumerate(np.bincount(verdicts).tolist()):
            self.counts[verdict] += count
        self.verdict = int(verdicts[-1])

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

    def samples(self) -> dict[str, Any]:
        """Return the numbers of samples: received, used, dropped by reason."""
        return {'received': self.received, 'used': self.used, 'dropped': self.dropped()}

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
        said = note_on_repeats(_repeats(self._track))
        if not said and self.functions.why is not None and self.running:
            said = self.functions.why(self.state, self._design)
        if not said and self.settings.unwrap and self._count_new_starts() > self._new_starts:
            said = 'turns may have been lost in an outage or a clock jump (~/reset restarts them)'
        said = said or note_on_queue(_queue(self._track))
        return said or ('' if self.learner is None else self.learner.shaft.text())

    @property
    def needs_motion(self) -> bool:
        """True while there is no estimate because the joint moves too little."""
        return False

    def _count_new_starts(self) -> int:
        return sum(self.counts[verdict] for verdict in NEW_STARTS)


def _circle(settings: JointSettings) -> Circle:
    return Circle(settings.wrap_period, settings.unwrap)


def _quantum(gains: Any) -> float:
    """Return the quantum of a single angle that gains declare [rad]; 0: none is known."""
    quantum = getattr(gains, 'quantum', None)
    return float(quantum) if isinstance(quantum, (int, float)) else 0.0


def _shape(state: Any) -> Any:
    """Return the nested lengths of a state's tuples."""
    return tuple(map(_shape, state)) if isinstance(state, tuple) else ()
