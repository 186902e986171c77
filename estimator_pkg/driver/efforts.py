# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Known inputs: the effort that acts from one sample to the next.

Efforts come in the messages of the positions or on a topic of their own, as commands, which act
from their stamp on, or as measurements, which acted since the one before. No ROS here: the live
node and replay feed it the same messages.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.errors import UsageError
from estimator_pkg.parameters import parameter, structural

EFFORT_FIELD, EFFORT_COMMAND = 'joint_states', 'effort_command'  # sources of efforts
COMMANDED, MEASURED = 'commanded', 'measured'  # kinds of efforts
STORED_EFFORTS = 4096  # number of stored efforts of each input
LONGEST_RELATED_NS = 10 * 10**9  # longest time between related samples or efforts [ns]
LARGEST_INPUT = 1e9  # largest valid input [N m, N, V or A]
NO_EFFORT = "publish the effort, too, or set 'input: effort_command'"  # what to do without one


@dataclass(frozen=True)
class DrivenSettings(JointSettings):
    """Parameters per joint, or per system, of observers with a known input."""

    effort_is: str | None = structural(
        None,
        kind=str,
        choices=(COMMANDED, MEASURED),
        description='commanded: an effort acts from its stamp to that of the next one; '
        'measured: it acted from the previous stamp to its own. Automatic: measured in '
        'joint_states, commanded in effort_command',
    )
    input_unit: str = structural(
        '',
        choices=('N m', 'newton', 'V', 'A'),
        description="unit of the model's input, which is effort times input_scale; it is part of "
        'the status and of the units of identified parameters; empty: unknown',
    )
    input_scale: tuple[float, ...] = parameter(
        (1.0,),
        kind=list,
        range=(-1e9, 1e9),
        description="factor from the topic's effort to the model's input, for all inputs or each; "
        'a negative value reverses the sign',
    )
    input_delay: tuple[float, ...] = parameter(
        (0.0,),
        unit='s',
        kind=list,
        range=(0.0, 1.0),
        description='delay from the stamp of an effort to its action, for all inputs or each',
    )
    input_timeout: float = parameter(
        0.5,
        unit='s',
        range=(0.001, 3600.0),
        description='an effort_command older than this is no longer valid; without a valid one '
        'there is no input',
    )

    def check_inputs(self, count: int, owner: str) -> None:
        """Raise UsageError unless scales and delays fit this number of inputs."""
        for name in ('input_scale', 'input_delay'):
            length = len(getattr(self, name))
            if length not in (1, count):
                right = '1 input: set 1' if count == 1 else f'{count} inputs: set 1 or {count}'
                raise UsageError(f"{owner}: '{name}' has {length} numbers for {right}")


class Acting:
    """The input of a joint or system, from its samples and efforts.

    Parameters
    ----------
    count : number of inputs.
    source : EFFORT_FIELD (each sample has efforts) or EFFORT_COMMAND (they arrive by `command`).
    settings : of the joint; those that are not structural may change between samples.
    """

    def __init__(self, count: int, source: str, settings: DrivenSettings) -> None:
        self._source = source
        self._measured = (
            settings.effort_is or (MEASURED if source == EFFORT_FIELD else COMMANDED)
        ) == MEASURED
        # (since when, value) of each input: constant until the next
        self._steps: list[deque[tuple[int, float]]] = [
            deque(maxlen=STORED_EFFORTS) for _ in range(count)
        ]
        self._last_ns = [0] * count  # stamp of the previous effort
        self._unknown_ns = 0  # stamp of the newest sample, if its input was not known

    def command(self, place: int, stamp_ns: int, effort: float) -> None:
        """Take an effort from its own topic; one that is not finite is ignored."""
        if self._source == EFFORT_COMMAND and math.isfinite(effort):
            before_ns, self._last_ns[place] = self._last_ns[place], stamp_ns
            since_ns = _related(before_ns, stamp_ns) if self._measured else stamp_ns
            self._add(place, since_ns, effort)

    def known_input(
        self, before_ns: int, stamp_ns: int, efforts: Sequence[float], settings: DrivenSettings
    ) -> tuple[float, ...]:
        """Return the mean input since the previous sample; nan if unknown or above `LARGEST_INPUT`.

        Parameters
        ----------
        before_ns : stamp of the previous used sample; 0: none. A later one without a known input
            takes its place, so that what was not known is not waited for.
        efforts : those of the sample, one per input; nan: none. Unused if they have a topic of
            their own.
        """
        scales, delays = settings.input_scale, settings.input_delay
        field = self._source == EFFORT_FIELD
        behind_ns = before_ns - stamp_ns
        if field and self._measured and not any(delays):
            values: Sequence[float] = efforts
        elif field and 0 <= behind_ns <= settings.reorder_window * 1e9:
            # The guard drops it, or finds that the clock jumped, and uses no input for either.
            values = efforts
        else:
            before_ns = _related(before_ns and max(before_ns, self._unknown_ns), stamp_ns)
            delays_ns = [round(delay * 1e9) for delay in delays]
            oldest_ns = round(settings.input_timeout * 1e9) + (max(delays_ns) if field else 0)
            if len(delays_ns) == 1:
                delays_ns = delays_ns * len(self._steps)
            if field and self._measured:
                self._came(before_ns, efforts)
            values = [
                _mean(steps, before_ns - delay, stamp_ns - delay, oldest_ns)
                for steps, delay in zip(self._steps, delays_ns)
            ]
            if field and not self._measured:
                self._came(stamp_ns, efforts)
            self._unknown_ns = 0 if all(map(math.isfinite, values)) else stamp_ns
        if len(scales) == 1:
            scales = scales * len(values)
        return tuple(
            [
                u if -LARGEST_INPUT < (u := value * scale) < LARGEST_INPUT else math.nan
                for value, scale in zip(values, scales)
            ]
        )

    @property
    def is_unknown(self) -> bool:
        """True if no effort_command was valid at the newest sample."""
        return self._unknown_ns != 0

    def why_unknown(self) -> str:
        """Return why the input of the newest sample is not known, with its remedy."""
        if self._source == EFFORT_FIELD:
            return 'its effort is not a number'
        if not all(self._last_ns):
            return 'no effort_command is valid for it: none had its name, check the names there'
        older = 1e-9 * (self._unknown_ns - min(self._last_ns))
        return (
            f'no effort_command is valid for it: the last one is {abs(older):.4g} s '
            f'{"older" if older > 0.0 else "newer"} than the position, check rate and clocks of '
            'both, or input_timeout'
        )

    def _came(self, since_ns: int, efforts: Sequence[float]) -> None:
        for place, effort in enumerate(efforts):
            if math.isfinite(effort):
                self._add(place, since_ns, effort)

    def _add(self, place: int, since_ns: int, effort: float) -> None:
        steps = self._steps[place]
        while steps and steps[-1][0] >= since_ns:  # a clock that jumped, or a correction
            steps.pop()
        steps.append((since_ns, effort))

    def clear(self) -> None:
        """Remove all inputs."""
        for steps in self._steps:
            steps.clear()
        self._unknown_ns = 0
        self._last_ns = [0] * len(self._steps)


def _mean(steps: deque[tuple[int, float]], begin_ns: int, end_ns: int, oldest_ns: int) -> float:
    """Return the mean of an input over an interval; nan if none was valid at its start.

    An input stays valid for `oldest_ns` [ns]. What ended before the interval is removed.
    """
    while len(steps) > 1 and steps[1][0] <= begin_ns:
        steps.popleft()
    if not steps or steps[0][0] > begin_ns or begin_ns - steps[0][0] > oldest_ns:
        return math.nan
    if end_ns <= begin_ns or len(steps) == 1 or steps[1][0] >= end_ns:
        return steps[0][1]  # exact, without a rounding error
    acting = [step for step in steps if step[0] < end_ns]
    ends_ns = [since for since, _ in acting[1:]] + [end_ns]
    total, since_ns = 0.0, begin_ns
    for (_, value), until_ns in zip(acting, ends_ns):
        total += value * (until_ns - since_ns)
        since_ns = until_ns
    return total / (end_ns - begin_ns)


def _related(before_ns: int, stamp_ns: int) -> int:
    """Return the previous stamp; `stamp_ns` if there is none (0) or it is not shortly before."""
    return before_ns if before_ns and 0 < stamp_ns - before_ns < LONGEST_RELATED_NS else stamp_ns
