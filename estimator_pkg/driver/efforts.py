"""Known inputs: which effort acted from one sample to the next.

Efforts come in the messages of the positions or on a topic of their own, as commands, which act
from their stamp on, or as measurements, which acted since the one before. No ROS here: the live
node and replay feed it the same messages.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from estimator_pkg.driver.joint import JointSettings
from estimator_pkg.errors import UsageError
from estimator_pkg.messages import multi_array
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import Decoder
from estimator_pkg.parameters import parameter

JOINT_STATE, ARRAY = 'JointState', 'Float64MultiArray'

Command = tuple[int, Sequence[str], Sequence[float]]  # (stamp [ns], names, efforts)


class EffortCommands:
    """Decodes a stream of them.

    Parameters
    ----------
    kind : JOINT_STATE (efforts by name) or ARRAY (numbers alone; they have no stamp).
    orders : names that the numbers of an array may stand for; its length says which.
    by_publisher : the stamp is the time at which a message was sent, as it is of every array.
    """

    def __init__(self, kind: str, orders: Sequence[Sequence[str]], by_publisher: bool) -> None:
        self._names = {len(names): tuple(names) for names in orders} if kind == ARRAY else None
        self._by_publisher = by_publisher
        self._layout = Decoder().layout

    def decode(self, raw: bytes, sent_ns: int) -> Command:
        """The command in `raw`, which was sent at `sent_ns`.

        Raises
        ------
        MalformedMessageError : no such message, or an array of another length.
        """
        if self._names is not None:
            numbers = multi_array.numbers(raw)
            names = self._names.get(len(numbers))
            if names is None:
                raise MalformedMessageError(
                    f'{len(numbers)} numbers, where there are '
                    f'{" or ".join(map(str, self._names))} joints'
                )
            return sent_ns, names, numbers
        layout = self._layout(raw)
        efforts = layout.numbers(raw, 2)
        if len(efforts) != len(layout.names):
            raise MalformedMessageError(f'{len(layout.names)} names, but {len(efforts)} efforts')
        return sent_ns if self._by_publisher else layout.stamp_ns(raw), layout.names, efforts


FIELD, COMMAND = 'joint_states', 'effort_command'  # where efforts come from
COMMANDED, MEASURED = 'commanded', 'measured'  # what they are
REMEMBERED = 4096  # efforts kept of each input
LONGEST = 10 * 10**9  # ns between two samples or efforts that belong together
LARGEST = 1e9  # N m, N, V or A: an input beyond it is garbage


@dataclass(frozen=True)
class DrivenSettings(JointSettings):
    """What is set per joint, or per system, of observers that know the input."""

    effort_is: str | None = parameter(
        None,
        unit='',
        kind=str,
        choices=(COMMANDED, MEASURED),
        structural=True,
        description='commanded: an effort acts from its stamp until that of the next one; '
        'measured: it acted from the stamp before until its own. Automatic: measured in '
        'joint_states, commanded in effort_command',
    )
    input_unit: str = parameter(
        '',
        unit='',
        choices=('N m', 'newton', 'V', 'A'),
        structural=True,
        formerly={'N': 'newton'},
        description="unit of the model's input, which is effort times input_scale; it is told with "
        'the status and stands in the units of identified parameters; empty: unknown',
    )
    input_scale: tuple[float, ...] = parameter(
        (1.0,),
        unit='',
        kind=list,
        range=(-1e9, 1e9),
        description='the effort of the topics times this is the input of the model, for all '
        'inputs or each; a negative one turns the sense round',
    )
    input_delay: tuple[float, ...] = parameter(
        (0.0,),
        unit='s',
        kind=list,
        range=(0.0, 1.0),
        description='how long after its stamp an effort acts, for all inputs or each',
    )
    input_timeout: float = parameter(
        0.5,
        unit='s',
        range=(0.001, 3600.0),
        description='an effort_command older than this no longer acts: without another one there '
        'is no input',
    )

    def check_inputs(self, count: int, owner: str) -> None:
        """What a range cannot say; raises UsageError if these are not for so many inputs."""
        for name in ('input_scale', 'input_delay'):
            given = len(getattr(self, name))
            if given not in (1, count):
                raise UsageError(
                    f"{owner}: '{name}' has {given} numbers for {count} "
                    f'input{"" if count == 1 else "s"}'
                )


class Inputs:
    """Inputs over time, each held until the next.

    Parameters
    ----------
    count : how many there are.
    """

    def __init__(self, count: int) -> None:
        self._steps: list[deque[tuple[int, float]]] = [
            deque(maxlen=REMEMBERED) for _ in range(count)
        ]

    def __len__(self) -> int:
        return len(self._steps)

    def add(self, index: int, stamp_ns: int, value: float) -> None:
        """From `stamp_ns` on input `index` has this value."""
        steps = self._steps[index]
        while steps and steps[-1][0] >= stamp_ns:  # a clock that jumped, or a correction
            steps.pop()
        steps.append((stamp_ns, value))

    def mean(
        self, begin_ns: int, end_ns: int, oldest_ns: int, delays_ns: Sequence[int] = (0,)
    ) -> tuple[float, ...]:
        """The mean of each over an interval; nan where nothing was in force at its begin.

        Parameters
        ----------
        oldest_ns : how long an input stays in force [ns].
        delays_ns : how much earlier than the interval they must have come, for all or each.
        """
        if len(delays_ns) == 1:
            delays_ns = (delays_ns[0],) * len(self._steps)
        return tuple(
            self._mean(steps, begin_ns - delay, end_ns - delay, oldest_ns)
            for steps, delay in zip(self._steps, delays_ns)
        )

    @staticmethod
    def _mean(steps: deque[tuple[int, float]], begin_ns: int, end_ns: int, oldest_ns: int) -> float:
        while len(steps) > 1 and steps[1][0] <= begin_ns:
            steps.popleft()
        if (
            not steps
            or steps[0][0] > begin_ns
            or end_ns - steps[0][0] > oldest_ns + (end_ns - begin_ns)
        ):
            return math.nan
        if end_ns <= begin_ns or len(steps) == 1 or steps[1][0] >= end_ns:
            return steps[0][1]  # as it is, without a rounding error
        total, since, value = 0.0, begin_ns, steps[0][1]
        for stamp_ns, following in steps:
            if stamp_ns <= begin_ns:
                continue
            if stamp_ns >= end_ns:
                break
            total += value * (stamp_ns - since)
            since, value = stamp_ns, following
        return (total + value * (end_ns - since)) / (end_ns - begin_ns)

    def clear(self) -> None:
        """Forget everything."""
        for steps in self._steps:
            steps.clear()


class Acting:
    """What acts on a joint or system, whose samples and efforts it is told of.

    Parameters
    ----------
    count : how many inputs there are.
    source : FIELD (each sample brings its efforts) or COMMAND (they come by `command`).
    settings : of the joint; what is not structural in them may change from sample to sample.
    """

    def __init__(self, count: int, source: str, settings: DrivenSettings) -> None:
        self._source = source
        self._measured = (
            settings.effort_is or (MEASURED if source == FIELD else COMMANDED)
        ) == MEASURED
        self._inputs = Inputs(count)
        self._last_ns = [0] * count  # of the effort before

    def command(self, place: int, stamp_ns: int, effort: float) -> None:
        """An effort came by its own topic; one that is not finite is none."""
        if self._source == COMMAND and math.isfinite(effort):
            self._put(place, stamp_ns, effort)

    def given(
        self, before_ns: int, stamp_ns: int, efforts: Sequence[float], settings: DrivenSettings
    ) -> tuple[float, ...]:
        """The mean input from the sample before to this one; nan where it is not known, or where it
        is beyond `LARGEST`.

        Parameters
        ----------
        before_ns : stamp of the sample before; 0: there was none.
        efforts : those that came with the sample, one per input; nan: none. Not used where they
            come by a topic of their own.
        """
        scales, delays = settings.input_scale, settings.input_delay
        field = self._source == FIELD
        behind_ns = before_ns - stamp_ns
        in_order = not 0 <= behind_ns <= settings.reorder_window * 1e9  # else it is dropped
        if field and self._measured and not any(delays):
            values: Sequence[float] = efforts
        else:
            if not 0 < stamp_ns - before_ns < LONGEST:
                before_ns = stamp_ns
            delays_ns = [round(delay * 1e9) for delay in delays]
            oldest_ns = round(settings.input_timeout * 1e9) + (max(delays_ns) if field else 0)
            if field and self._measured and in_order:
                self._came(before_ns, efforts)
            values = self._inputs.mean(before_ns, stamp_ns, oldest_ns, delays_ns)
            if field and not self._measured and in_order:
                self._came(stamp_ns, efforts)
        if len(scales) == 1:
            scales = scales * len(values)
        return tuple(
            [
                given if -LARGEST < (given := value * scale) < LARGEST else math.nan
                for value, scale in zip(values, scales)
            ]
        )

    def _came(self, since_ns: int, efforts: Sequence[float]) -> None:
        for place, effort in enumerate(efforts):
            if math.isfinite(effort):
                self._inputs.add(place, since_ns, effort)

    def _put(self, place: int, stamp_ns: int, effort: float) -> None:
        before_ns, self._last_ns[place] = self._last_ns[place], stamp_ns
        since_ns = stamp_ns
        if self._measured and 0 < stamp_ns - before_ns < LONGEST:
            since_ns = before_ns
        self._inputs.add(place, since_ns, effort)

    def clear(self) -> None:
        """Forget everything."""
        self._inputs.clear()
        self._last_ns = [0] * len(self._inputs)
