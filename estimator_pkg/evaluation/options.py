# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What `evaluate`, `doctor` and `tune` compare, and the options that they share."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import params_file
from estimator_pkg.bags.log_file import Columns
from estimator_pkg.bags.unpacking import UNPACK_LIMIT
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.evaluation.entries import Entry

MEASUREMENT = '/joint_states'
TRUTH = '/ground_truth/joint_states'
ESTIMATE = 'estimate'  # last part of an estimate topic's name
AUTO, SMOOTHER = 'auto', 'smoother'
WRAP_PERIOD = 2.0 * math.pi  # the default [rad]
PERIOD_KEY = 'wrap_period'
PARSED = (  # arguments of a command that are options by the same name
    *('measurement', 'truth', 'angle', 'begin', 'end', 'correct_reference', 'reference'),
    *('unpack_limit', 'motion_hz'),
)


@dataclass(frozen=True)
class Options:
    """What is compared, and how.

    measurement, truth : topics; None: the usual ones.
    estimates : topics; empty: every JointState whose name ends in '/estimate'.
    observers : observers to run on the measurement; empty: use recorded estimates.
    begin, end : part of the record that is judged, since the first sample [s].
    wrap_period : of the positions [rad]; 0: none. own_periods : of joints that have their own.
    correct_reference : remove the truth's own lag and bias first; None: its lag, if it is
        certainly late (`evaluation.reference.late`).
    reference : 'auto': the truth, or the off-line smoother without one; 'truth' or 'smoother':
        only this one.
    angle : ``TOPIC:FIELD``, a measured number, used instead of joint states.
    unpack_limit : of the bags, see `estimator_pkg.bags.reader.open_bag`.
    motion_hz : highest frequency at which the joints move [Hz]; None: not known.
    columns : of logs; None: the bags are bags.
    """

    measurement: str | None = None
    truth: str | None = None
    estimates: tuple[str, ...] = ()
    observers: tuple[Entry, ...] = ()
    begin: float = 0.0
    end: float = math.inf
    wrap_period: float = WRAP_PERIOD
    correct_reference: bool | None = None
    reference: str = AUTO
    angle: str | None = None
    unpack_limit: int = UNPACK_LIMIT
    motion_hz: float | None = None
    columns: Columns | None = None
    own_periods: Mapping[str, float] = field(default_factory=dict)

    def period(self, joint: str) -> float:
        """Return the wrap period of this joint [rad]; 0: none."""
        return self.own_periods.get(joint, self.wrap_period)

    def within(self, stamps_ns: NDArray[np.int64], start_ns: int) -> NDArray[np.bool_]:
        """Return which stamps are of the part that is judged, shape (n,); see `in_window`."""
        return in_window(stamps_ns, start_ns, self.begin, self.end)


def truth_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--truth``, see `Options`."""
    parser.add_argument(
        '--truth', metavar='TOPIC', help=f'JointState with the true velocities (default {TRUTH})'
    )


def window_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options ``--from`` and ``--to``, see `Options`."""
    of = 'since the first sample'
    for name, dest, default, side in (
        ('--from', 'begin', 0.0, f'before S seconds {of}'),
        ('--to', 'end', math.inf, f'after S seconds {of}'),
    ):
        parser.add_argument(
            name, dest=dest, type=float, default=default, metavar='S', help=f'ignore what is {side}'
        )


def check_window(parsed: argparse.Namespace) -> None:
    """Raise UsageError for a wrong value of `window_arguments`."""
    if not 0.0 <= parsed.begin < math.inf:
        raise UsageError(f'--from is {parsed.begin:g} s: it must be 0 or more')
    if not parsed.end > parsed.begin:
        raise UsageError(f'--to is {parsed.end:g} s: it must be above --from, {parsed.begin:g} s')


def in_window(
    stamps_ns: NDArray[np.int64], start_ns: int, begin: float, end: float
) -> NDArray[np.bool_]:
    """Return which stamps are from `begin` to `end` [s] since `start_ns`, shape (n,).

    Raises
    ------
    UserError : there is none.
    """
    if begin <= 0.0 and end == math.inf:
        return np.ones(len(stamps_ns), bool)
    time = (stamps_ns - start_ns) * 1e-9
    found = (time >= begin) & (time <= end)
    if not found.any():
        last = float(np.max(time, initial=0.0))
        raise UserError(
            f'no sample remains from {begin:g} to {min(end, last):g} s: the record has '
            f'{last:.4g} s, so change --from and --to'
        )
    return found


def worker_arguments(parser: argparse.ArgumentParser, jobs: str = 'local processes') -> None:
    """Add the options of `workers`; `jobs`: help of ``--jobs``."""
    parser.add_argument('--jobs', type=int, default=1, metavar='N', help=jobs)
    parser.add_argument(
        '--scheduler', metavar='ADDRESS', help='address of a Dask scheduler, used instead of --jobs'
    )


def joint_arguments(parser: argparse.ArgumentParser) -> None:
    """Add options that describe the joints to a command that ranks estimates."""
    parser.add_argument(
        '--wrap-period',
        type=float,
        metavar='RAD',
        help='period of the positions; 0 for prismatic joints (default: the parameter wrap_period, '
        'else 2 pi)',
    )
    parser.add_argument(
        '--motion-hz',
        type=float,
        metavar='HZ',
        help='highest frequency at which the joints move, for ranking without truth: faster '
        'oscillations of the readings are sensor errors (default: all of them are motion)',
    )


def check_joints(parsed: argparse.Namespace) -> None:
    """Raise UsageError for a wrong value of `joint_arguments`."""
    period, hz = parsed.wrap_period, parsed.motion_hz
    if period is not None and not (math.isfinite(period) and period >= 0.0):
        raise UsageError(f'--wrap-period is {period:g} rad: it must be 0 or more')
    if hz is not None and not (math.isfinite(hz) and hz > 0.0):
        raise UsageError(f'--motion-hz is {hz:g} Hz: it must be above 0')


def wrap_periods(
    requested: float | None, parameters: Sequence[Mapping[str, Any]]
) -> tuple[float, dict[str, float]]:
    """Return the wrap period of the joints, and those of joints that have their own [rad].

    Parameters
    ----------
    requested : of ``--wrap-period``; None: that of the parameters.
    parameters : of each observer, by name.

    Raises
    ------
    UsageError : two of them differ.
    """
    found: dict[str, dict[float, str]] = {'': {}}
    if requested is not None:
        found[''][requested] = '--wrap-period'
    for values in parameters:
        for name, value in values.items():
            joint, parameter = params_file.override(name)
            if parameter == PERIOD_KEY:
                found.setdefault(joint, {}).setdefault(float(value), f"parameter '{name}'")
    for each in found.values():
        if len(each) > 1:
            differ = ', but '.join(f'{name} is {period:g} rad' for period, name in each.items())
            raise UsageError(f'{differ}: joints have one wrap period, so omit one of the two')
    periods = {joint: next(iter(each)) for joint, each in found.items() if each}
    return periods.pop('', WRAP_PERIOD), periods


def options_of(
    parsed: argparse.Namespace,
    observers: Sequence[Entry],
    columns: Columns | None,
    estimates: Sequence[str] = (),
) -> Options:
    """Return the arguments of a command as `Options`.

    Raises
    ------
    UsageError : the observers have different wrap periods.
    """
    period, own_periods = wrap_periods(
        parsed.wrap_period, [dict(each.values) for each in observers]
    )
    return Options(
        estimates=tuple(estimates),
        observers=tuple(observers),
        wrap_period=period,
        own_periods=own_periods,
        columns=columns,
        **{name: getattr(parsed, name) for name in PARSED},
    )
