# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One joint: an observer with its gains, the guard, and counts of all samples.

A reading and a known input are numbers (an angle) or vectors (the positions of a mechanism, the
outputs of a switched system, currents and voltages of a drive); so is what is estimated of them.
Each sample goes the same way, in `driver.channel`: the guard judges its stamp and reading, the
observer takes a step, the verdict is counted. Then `estimate` and `stddev` are those of that
sample, `why` says what the status means, and a stream answers (`streams.answer`). A family adds
what comes before a sample (pairing, events, the input) and after it (evidence, electrical numbers).

The numbers are a record. With the engine they are in an array that compiled code updates; without
it they are an object that the same functions update as plain Python, as always where a reading is a
vector that the user's model makes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.circle import Circle, nearest_turn
from estimator_pkg.driver import channel
from estimator_pkg.driver.batch import Estimates, empty
from estimator_pkg.driver.channel import Frame, use_frame
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.counts import Counted
from estimator_pkg.engine.calls import Memory, functions_of
from estimator_pkg.estimate import STATUS_NAMES
from estimator_pkg.observers.contract import Observer
from estimator_pkg.record import values
from estimator_pkg.sensor.faults import KINDS, LASTING, LASTING_NS, note_on_faults, text_of
from estimator_pkg.sensor.guard import DUPLICATE, Limits, limits, longest_dt
from estimator_pkg.sensor.holds import note_on_repeats
from estimator_pkg.sensor.sample_time import note_on_stamps
from estimator_pkg.sensor.turns import begin_turns

TYPICAL_DT = 1e-3  # [s]
LOST_TURNS = 'turns may have been lost in an outage or a clock jump (~/reset restarts them)'


class Tried:
    """What gains imply, tried at a typical sample time.

    Raises
    ------
    ArithmeticError, ValueError : it cannot be computed.
    """

    def __init__(self, module: Any, gains: Any, circle: Circle) -> None:
        self._module, self.design = module, module.design(gains, circle)
        module.prepare(module.Coefficients(), self.design, TYPICAL_DT)

    def limits(self, dt: float) -> str | None:
        """Return why the gains cannot work at this sample time [s]; None: they can."""
        reason: str | None = self._module.limits(self.design, dt)
        return reason


class Joint(Counted):
    """A joint's observer, live: pass it samples, read its estimate.

    Parameters
    ----------
    observer : the observer.
    gains : an instance of ``observer.gains``.
    settings : wrap period, gaps, reordering.

    Attributes
    ----------
    longest_dt : sample time from which on the gains are unstable [s].
    size : how many estimates it gives.
    compiled : the engine's functions for the observer; None: plain Python.
    memory : the record that they update.
    """

    longest_dt: float
    size = 1
    plain: Any = channel  # the module of the record and of its functions
    _lasting: Mapping[int, int] = {}  # newest stamp of each lasting fault, by kind [ns]

    def __init__(self, observer: type[Observer], gains: Any, settings: JointSettings) -> None:
        self.observer, self.settings, self.gains = observer, settings, gains
        self.module = self._module_of(gains)
        plain = self.module.runs_plain(gains)
        self.compiled: Any = None if plain else functions_of(self.module)
        self._channel = self.plain.Channel.of(self.module)()
        self.memory: Any = None if self.compiled is None else Memory(type(self._channel))
        self.reset_count = 0
        self._faults_before = [0] * len(KINDS)
        self._new_starts = 0  # their number at the last reset
        self._use_gains()
        self._reset_channel()

    def _module_of(self, gains: Any) -> Any:
        return self.observer.bound(gains)

    def _another(self) -> Joint:
        """Return a new joint like this one."""
        return type(self)(self.observer, self.gains, self.settings)

    @property
    def channel(self) -> Any:
        """The joint's numbers; with the engine a copy of them."""
        if self.memory is not None:
            return type(self._channel).read(self.memory.array[0])
        return self._channel

    @property
    def view(self) -> Any:
        """The joint's numbers, to be read: each when it is named."""
        if self.memory is not None:
            return type(self._channel).view(self.memory.array[0])
        return self._channel

    @contextmanager
    def _changing(self) -> Iterator[Any]:
        """Give the joint's numbers, to be changed."""
        channel = self.channel
        yield channel
        if self.memory is not None:
            channel.write(self.memory.array[0])

    def _use_gains(self) -> None:
        """Set what the gains and settings imply."""
        with self._changing() as channel:
            period = self.settings.wrap_period
            frames = (
                (channel.wrapped, Circle(period, self.settings.unwrap)),
                (channel.counted, Circle(0.0)),
            )
            for frame, circle in frames:
                if circle.period == period or self._counts_turns:
                    self._set_frame(frame, circle)
            now = channel.counted if channel.turns.counts else channel.wrapped
            self.longest_dt = now.longest_dt
            channel.limits.take(self._limits(self.settings, now.longest_dt, now.period))
            use_frame(channel, now)

    def _limits(self, settings: JointSettings, longest_dt: float, period: float) -> Limits:
        quantum = getattr(self.gains, 'quantum', 0.0) if self.module.SINGLE_ANGLE else 0.0
        return limits(settings, longest_dt, period, quantum)

    @property
    def _counts_turns(self) -> bool:
        """True if the joint may go on without a circle."""
        return (
            bool(self.module.TURNS and self.settings.wrap_period > 0.0) and not self.settings.unwrap
        )

    def _set_frame(self, frame: Frame, circle: Circle) -> None:
        design = self.module.design(self.gains, circle)
        made: Any = frame
        made.design.take(design)
        frame.longest_dt = longest_dt(lambda dt: self.module.limits(design, dt))
        frame.period = float(circle.period)

    def _reset_channel(self) -> None:
        """Start as if no sample had come."""
        with self._changing() as channel:
            begin_turns(channel.turns, self.settings.wrap_period if self._counts_turns else 0.0)
            channel.stamp_ns, channel.verdict = 0, DUPLICATE
            self.plain.reset_channel(self.module, channel)

    def set_gains(self, gains: Any) -> None:
        """Use other gains from the next sample on; the state is kept.

        The caller must ensure that no structural parameter changes.
        """
        self.gains = gains
        self._use_gains()

    def try_step(self, design: Any) -> None:
        """Take a step with another design and a copy of the state.

        Raises
        ------
        ArithmeticError, ValueError : it fails.
        """
        channel = type(self._channel)()
        channel.take(self.channel)
        channel.design.take(getattr(design, 'design', design))
        state, coefficients = channel.track.state, channel.track.coefficients
        if channel.track.clock.running:
            self.module.prepare(
                coefficients, channel.design, channel.track.clock.mean_dt or TYPICAL_DT
            )
            self.module.step(
                self.module,
                state,
                coefficients,
                channel.design,
                channel.measurement,
                channel.known_input,
            )
            self.plain.write_estimate(self.module, channel)

    def set_settings(self, settings: JointSettings) -> None:
        """Use other guard settings from the next sample on; the state is kept."""
        self.settings = settings
        with self._changing() as channel:
            now = channel.limits
            now.take(self._limits(settings, now.longest_dt, now.period))

    def numbers(self) -> tuple[Any, ...]:
        """Return all that samples have changed, as plain data."""
        channel = values(type(self._channel), self.channel)
        return channel, self.reset_count, self._faults_before, self._new_starts

    def set_numbers(self, numbers: tuple[Any, ...]) -> None:
        """Continue from the `numbers` of a joint with the same gains and settings."""
        channel, self.reset_count, self._faults_before, self._new_starts = numbers
        with self._changing() as own:
            own.take(type(self._channel).made(channel))

    def reset(self) -> None:
        """Reset the observer to its start; the counters continue."""
        self._reset_channel()
        self._lasting = {}
        self.reset_count += 1
        self._new_starts = self.new_starts()

    def warm_up(self) -> None:
        """Take samples with another joint and discard them, so that everything is imported.

        Raises
        ------
        ArithmeticError, ValueError : the gains give no estimates.
        """
        other, (measurement, known_input) = self._another(), self._at_rest()
        for k in range(1, 4):
            other.update(k * 1_000_000, measurement, known_input)
        other.estimate()
        other.stddev()

    def _at_rest(self) -> tuple[Any, Any]:
        """Return a valid reading and a known input."""
        return 0.0, 0.0

    def update(self, stamp_ns: int, measurement: Any, known_input: Any = 0.0) -> bool:
        """Take one sample; return True if it was used, False if it was dropped (and counted)."""
        if self.memory is not None:
            verdict = self.compiled.take(self.memory.pointer, stamp_ns, measurement, known_input)
        else:
            verdict = self.plain.take(
                self.module, self._channel, stamp_ns, measurement, known_input
            )
        return bool(verdict < DUPLICATE)

    def estimate(self) -> tuple[Any, Any, Any, int]:
        """Return (position, velocity, acceleration or nan, status) at the last used sample.

        Lists where the reading is a vector; nan before the first sample and if misconfigured.
        """
        if self.memory is not None:
            self.compiled.write_estimate(self.memory.pointer)
            return self.memory.array['estimate'][0].item()
        self.plain.write_estimate(self.module, self._channel)
        out = self._channel.estimate
        return out.position, out.velocity, out.acceleration, out.status

    def stddev(self) -> tuple[Any, Any]:
        """Return the standard deviations of position and velocity; nan before the first sample.

        Lists where the reading is a vector.
        """
        if not self.running:
            return math.nan, math.nan
        if self.memory is not None:
            self.compiled.write_deviation(self.memory.pointer)
            return self.memory.array['deviation'][0].item()
        self.plain.write_deviation(self.module, self._channel)
        out = self._channel.deviation
        return out.position, out.velocity

    def run(
        self,
        stamps: NDArray[np.int64],
        measurements: NDArray[np.float64],
        known_input: NDArray[np.float64] | None = None,
    ) -> Estimates:
        """Take many samples; return all estimates, equal to those sample by sample.

        Parameters
        ----------
        stamps : shape (n,), int64 nanoseconds, as received.
        measurements : shape (n,) [rad or m].
        known_input : shape (n,), known input; None: zero.
        """
        count = len(stamps)
        given = np.zeros(count) if known_input is None else known_input
        out = empty(count)
        self._batch(stamps, (measurements, given), out)
        return out

    def _batch(
        self,
        stamps: NDArray[np.int64],
        samples: Sequence[NDArray[np.float64]],
        out: Sequence[NDArray[Any]],
    ) -> None:
        """Take many samples; set the arrays that the channel's `batch` sets."""
        count = len(stamps)
        columns = [np.ascontiguousarray(each, np.float64) for each in samples]
        columns.insert(0, np.ascontiguousarray(stamps, np.int64))
        if self.memory is not None:
            self.compiled.run(self.memory.pointer, count, *columns, *out)
            return
        # lists contain Python numbers, which are several times faster than NumPy's
        rows, found = ([each.ravel().tolist() for each in of] for of in (columns, out))
        self.plain.batch(self.module, self._channel, count, *rows, *found)
        for target, column in zip(out, found):
            target[...] = np.reshape(column, target.shape)

    def estimates(self) -> list[tuple[float, float, float, int]]:
        """Return `estimate` as one row for each number that is estimated."""
        *columns, status = self.estimate()
        return [(*row, status) for row in self._rows(columns)]

    def deviations(self) -> list[tuple[float, float]]:
        """Return `stddev` as one row for each number that is estimated."""
        return self._rows(self.stddev())

    def _rows(self, columns: Sequence[Any]) -> list[Any]:
        return list(zip(*(c if isinstance(c, list) else [c] * self.size for c in columns)))

    def in_estimate_convention(self, position: float, index: int = 0) -> float:
        """Return a measured position in the convention of the estimate: with its turns, if any.

        Parameters
        ----------
        index : the place of this position where the reading is a vector.
        """
        if not self.settings.unwrap:
            return position
        near = self.estimate()[0]
        return nearest_turn(
            position, near[index] if isinstance(near, list) else near, self._turn(index)
        )

    def _turn(self, index: int) -> float:
        """Return the wrap period of a position; 0: none."""
        return self.settings.wrap_period

    def _value(self, *path: str) -> Any:
        """Return one of the joint's numbers, by the names of its fields."""
        if self.memory is not None:
            found = self.memory.array
            for name in path:
                found = found[name]
            return found[0].item() if found.ndim == 1 else found[0].tolist()
        value: Any = self._channel
        for name in path:
            value = getattr(value, name)
        return value

    @property
    def counts(self) -> list[int]:  # type: ignore[override]
        """Numbers of samples by verdict."""
        counts: list[int] = self._value('counts')
        return counts

    @property
    def verdict(self) -> int:
        """The verdict on the newest sample."""
        return int(self._value('verdict'))

    @property
    def stamp_ns(self) -> int:
        """Stamp of the newest sample that was used [ns]; 0: none."""
        return int(self._value('stamp_ns'))

    @property
    def running(self) -> bool:  # type: ignore[override]
        """True if a sample has arrived since the start or the last reset."""
        return bool(self._value('track', 'clock', 'running'))

    @property
    def last_ns(self) -> int:
        """The last stamp that the guard accepted [ns]."""
        return int(self._value('track', 'clock', 'last_ns'))

    @property
    def mean_dt(self) -> float:  # type: ignore[override]
        """Mean sample time [s]; 0 before the second sample."""
        return float(self._value('track', 'clock', 'mean_dt'))

    @property
    def state(self) -> Any:
        """The observer's state; with the engine a copy of it."""
        return self.channel.track.state

    @property
    def design(self) -> Any:
        """What the gains imply; with the engine a copy of it."""
        return self.channel.design

    def limit(self, dt: float) -> str | None:
        """Return why the gains cannot work at this sample time [s]; None: they can."""
        reason: str | None = self.module.limits(self.view.design, dt)
        return reason

    def group_delay(self, dt: float) -> float:
        """Return the delay of the velocity at low frequency [s] at this dt [s]; nan: not known."""
        return float(self.module.group_delay(self.view.design, dt))

    def why(self) -> str:
        """Return the meaning of the status, or another note for the user, as text."""
        channel, status = self.view, self.estimate()[3]
        clock = channel.track.clock
        if STATUS_NAMES[status] == 'misconfigured':
            return self.limit(clock.mean_dt) or ''
        note = note_on_repeats(channel.track.holds.most, clock.mean_dt)
        if not note and self._shows_faults:
            newest = note_on_faults(channel.faults, clock.last_ns)
            notes = dict.fromkeys([*self.lasting_faults().values(), newest])
            note = ', '.join(filter(None, notes))
        if not note and clock.running:
            note = self.module.why(channel.track.state, channel.design)
        if not note and self.settings.unwrap and self.new_starts() > self._new_starts:
            note = LOST_TURNS
        if not note and self._shows_faults:
            note = note_on_stamps(channel.track.sample_time)
        return note

    @property
    def _shows_faults(self) -> bool:
        """True if the channel looks for faults of the sensor."""
        return hasattr(self._channel, 'faults') and bool(self.module.SINGLE_ANGLE)

    def new_faults(self) -> dict[int, str]:
        """Return the faults of the sensor since the last call, as texts by kind."""
        if not self._shows_faults:
            return {}
        counts, before = self._value('faults', 'counts'), self._faults_before
        if counts == before:
            return {}
        self._faults_before = counts
        faults, new = self.view.faults, [k for k in range(len(KINDS)) if counts[k] > before[k]]
        self._lasting = {**self._lasting, **{k: self.last_ns for k in new if k in LASTING}}
        return {kind: text_of(faults, kind) for kind in new}

    def lasting_faults(self) -> dict[int, str]:
        """Return the faults that the sensor may still have, as texts by kind, until `reset` or
        until it was right for `LASTING_NS`; `new_faults` notes them.
        """
        if not self._lasting:
            return {}
        faults, now_ns = self.view.faults, self.last_ns
        return {
            kind: text_of(faults, kind)
            for kind, since_ns in self._lasting.items()
            if now_ns - since_ns < LASTING_NS
        }

    @property
    def needs_motion(self) -> bool:
        """True while there is no estimate because the joint moves too little."""
        return False
