# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The options of a comparison."""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

import numpy as np

from estimator_pkg.bags.log_file import Columns
from estimator_pkg.bags.unpacking import UNPACK_LIMIT
from estimator_pkg.errors import UsageError
from estimator_pkg.evaluation.entries import Entry

MEASUREMENT = '/joint_states'
TRUTH = '/ground_truth/joint_states'
ESTIMATE = 'estimate'  # last part of an estimate topic's name
AUTO, SMOOTHER = 'auto', 'smoother'


@dataclass(frozen=True)
class Options:
    """What is compared, and how.

    measurement, truth : topics; None: the usual ones.
    angle : ``TOPIC:FIELD``, a measured number, used instead of joint states.
    estimates : topics; empty: every JointState whose name ends in '/estimate'.
    observers : observers to run on the measurement; empty: use recorded estimates.
    skip : time ignored at the beginning [s].
    wrap_period : of the positions [rad]; 0: none.
    correct_reference : remove the truth's own lag and bias first; None: its lag, if it is
        certainly late (`evaluation.reference.late`).
    reference : 'auto': the truth, or the off-line smoother without one; 'truth' or 'smoother':
        only this one.
    unpack_limit : of the bags, see `estimator_pkg.bags.reader.open_bag`.
    motion_hz : highest frequency at which the joints move [Hz]; None: not known.
    columns : of logs; None: the bags are bags.
    """

    measurement: str | None = None
    truth: str | None = None
    estimates: tuple[str, ...] = ()
    observers: tuple[Entry, ...] = ()
    skip: float = 0.0
    wrap_period: float = 2.0 * np.pi
    correct_reference: bool | None = None
    reference: str = AUTO
    angle: str | None = None
    unpack_limit: int = UNPACK_LIMIT
    motion_hz: float | None = None
    columns: Columns | None = None


def truth_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--truth``, see `Options`."""
    parser.add_argument(
        '--truth', metavar='TOPIC', help=f'JointState with the true velocities (default {TRUTH})'
    )


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
        default=2.0 * math.pi,
        metavar='RAD',
        help='period of the positions; 0 for prismatic joints (default 2 pi)',
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
    if not (math.isfinite(period) and period >= 0.0):
        raise UsageError(f'--wrap-period is {period:g} rad: it must be 0 or more')
    if hz is not None and not (math.isfinite(hz) and hz > 0.0):
        raise UsageError(f'--motion-hz is {hz:g} Hz: it must be above 0')
