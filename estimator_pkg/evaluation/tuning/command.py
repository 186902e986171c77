# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator tune``: find gains from data, and write a YAML that the node loads."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from estimator_pkg import destination, interrupts, streams, whole_file
from estimator_pkg.bags import log_file, unpacking
from estimator_pkg.cli import Command, add_set
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.evaluation.compare.many import LeftOut, expanded, on_each
from estimator_pkg.evaluation.options import (
    AUTO,
    MEASUREMENT,
    PERIOD_KEY,
    SMOOTHER,
    TRUTH,
    WRAP_PERIOD,
    joint_arguments,
    options_of,
    truth_argument,
    window_arguments,
    worker_arguments,
)
from estimator_pkg.evaluation.text import started
from estimator_pkg.evaluation.tuning import any_observer, live, output
from estimator_pkg.evaluation.tuning.objective import PREFERENCES
from estimator_pkg.evaluation.tuning.records import TuningRecord, records
from estimator_pkg.evaluation.tuning.seek import Tuned, kept, seek
from estimator_pkg.evaluation.tuning.settings import TuneSettings, tune_settings
from estimator_pkg.evaluation.workers import workers
from estimator_pkg.printable import show

DEFAULT_TRIALS = 40


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        'bags', nargs='*', metavar='BAG', help='bags to tune on, folders with bags in them, or logs'
    )
    parser.add_argument(
        '--live',
        type=float,
        metavar='SECONDS',
        help='instead of bags: record the measurement from the live graph for SECONDS',
    )
    parser.add_argument(
        '--apply', metavar='NODE', help='set the gains on this running node (default: set nothing)'
    )
    parser.add_argument(
        '--observer',
        metavar='NAME',
        help='observer to tune (default: the best linear one; if its tuned gains do not beat the '
        'default observer, the file has the latter. For currents and voltages: pmsm)',
    )
    parser.add_argument('--out', required=True, metavar='YAML', help='parameter file to write')
    parser.add_argument(
        '--prefer',
        choices=tuple(PREFERENCES),
        default='balanced',
        help='trade-off: low noise (smooth), low delay (fast), or mainly the error (balanced, '
        'the default)',
    )
    parser.add_argument(
        '--weights',
        metavar='E,D,N',
        help='instead of --prefer: weights of rms error, error by delay, and noise (all in rad/s)',
    )
    parser.add_argument(
        '--search',
        action='append',
        default=[],
        metavar='GAIN=LOW:HIGH',
        help='search this gain in this range (or NAME=ONE|OTHER for a choice); '
        "repeatable (default: the observer's own search ranges)",
    )
    parser.add_argument(
        '--params',
        metavar='YAML',
        help="parameter file of the observer's node: its parameters are fixed",
    )
    add_set(parser, 'fix this parameter; repeatable')
    parser.add_argument(
        '--joint', action='append', default=[], metavar='NAME', help='only this joint; repeatable'
    )
    parser.add_argument(
        '--per-joint',
        action='store_true',
        help='separate gains for each joint, instead of common ones',
    )
    parser.add_argument(
        '--held-out',
        type=float,
        default=0.3,
        metavar='PART',
        help='fraction at the end of each record that is held out for validation (default 0.3)',
    )
    parser.add_argument(
        '--judge',
        action='append',
        default=[],
        metavar='BAG',
        help='validate the gains on this recording, or folder of recordings, instead of '
        'held-out parts of BAG; repeatable',
    )
    parser.add_argument(
        '--trials',
        type=int,
        default=DEFAULT_TRIALS,
        metavar='N',
        help=f'number of trials (default {DEFAULT_TRIALS})',
    )
    parser.add_argument('--seed', type=int, default=0, help='random seed of the search (default 0)')
    parser.add_argument(
        '--measurement',
        metavar='TOPIC',
        help=f"topic of the measurement (default {MEASUREMENT}, or the observer's own)",
    )
    log_file.arguments(parser)
    truth_argument(parser)
    parser.add_argument(
        '--reference', choices=(AUTO, 'truth', SMOOTHER), default=AUTO, help='as in evaluate'
    )
    parser.add_argument(
        '--correct-reference',
        action=argparse.BooleanOptionalAction,
        default=True,
        help="remove the truth's own lag and bias first (default)",
    )
    window_arguments(parser)
    joint_arguments(parser)
    unpacking.arguments(parser)
    worker_arguments(parser)


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Search, validate on held-out data, write; return the results."""
    columns = log_file.columns(parsed)
    any_linear = parsed.observer is None and _usual(parsed, columns) == any_observer.DEFAULT
    tuning = tune_settings(parsed)
    out = Path(parsed.out)
    destination.check(out)
    if parsed.apply:  # before anything is recorded or searched
        with live.remote(parsed.apply, parsed.observer):
            pass
    options = options_of(parsed, [tuning.entry], columns)
    left_out: list[LeftOut] = []
    with contextlib.ExitStack() as stack:
        run_many = stack.enter_context(workers(parsed.jobs, parsed.scheduler))
        if parsed.live is not None:
            parsed.bags = [stack.enter_context(_recorded(parsed, tuning))]

        def of(paths: Sequence[str], held_out: float) -> list[TuningRecord]:
            more = tuning.entry, options, held_out, tuple(parsed.joint)
            parts = on_each(run_many, records, expanded(paths), *more, left_out=left_out)
            return [record for part in parts for record in part]

        seen = of(parsed.bags, 0.0 if parsed.judge else parsed.held_out)
        judged = of(parsed.judge, 0.0)
        for path in {Path(each.bag).resolve() for each in seen}:
            if path in {Path(each.bag).resolve() for each in judged}:
                raise UsageError(
                    f'--judge {path}: the gains are tuned on this recording: name another'
                )
        groups = _groups(seen, tuning, parsed.per_joint)
        usable = [record for record in seen if not record.why]
        if any_linear and usable:
            parsed.observer = any_observer.best_linear(usable, tuning)
            tuning = tune_settings(parsed)
            show(f'{parsed.observer} is the best linear observer here: it is tuned')
        tuned: list[Tuned] = []
        for joint, chosen in groups.items():
            fit = [record for record in chosen if not record.why]
            if not fit:
                why = '; '.join(dict.fromkeys(record.why for record in chosen))
                tuned.append(kept(joint, chosen, why))
                continue
            try:
                tuned.append(seek(joint, fit, _of(judged, joint), tuning, run_many, any_linear))
            except KeyboardInterrupt:  # before this joint's first trial
                if not tuned:
                    raise
                interrupts.finish()
                break
            if tuned[-1].interrupted:
                break
    sought, written, notes = parsed.observer, tuned, _notes(seen)
    if any_linear and usable:
        pairs = [any_observer.Compared(**each.versus) for each in tuned if each.versus]
        if not any_observer.replaces_default(pairs):
            parsed.observer = any_observer.DEFAULT
            tuning = tune_settings(parsed)
            written = [
                kept(each.joint, groups[each.joint], each.against or each.why) for each in tuned
            ]
            notes.append(f'the file has {parsed.observer} as it is')
    show(*output.described(tuned, notes, options.wrap_period))
    wiring = seen[0].seen.recording.setup
    held = wiring.input | tuning.held
    stream = streams.of_observer(parsed.observer)
    if stream.WRAPS and options.wrap_period != WRAP_PERIOD:
        held.setdefault(PERIOD_KEY, options.wrap_period)
    whole_file.write_text(out, output.as_yaml(tuning, held, written, wiring.remaps))
    show(f'gains: {out}', *started(stream.NODE, parsed.out, wiring.remaps))
    if parsed.apply:
        values = output.node_values(written)
        changed = live.apply(parsed.apply, values, tuning.gains, parsed.observer) if values else []
        show(f'set on {parsed.apply}: {", ".join(changed) or "nothing, the defaults stay"}')
    return {
        'observer': parsed.observer,
        'sought': sought,
        'preference': tuning.preference,
        'out': str(out),
        'notes': notes,
        'left_out': {each.path: each.why for each in left_out},
        'tuned': [asdict(each) for each in tuned],
    }


def _usual(parsed: argparse.Namespace, columns: log_file.Columns | None) -> str:
    """Set the observer that is not named, and return it; raise UsageError."""
    parsed.observer = any_observer.DEFAULT
    if parsed.bags and not (parsed.angle or parsed.measurement):
        first = expanded(parsed.bags)[0].path
        parsed.observer = any_observer.usual(first, parsed.unpack_limit, columns)
    if parsed.observer == any_observer.DEFAULT and (parsed.search or parsed.params or parsed.apply):
        raise UsageError(
            '--search, --params and --apply are for one observer: name it with --observer'
        )
    return str(parsed.observer)


def _recorded(parsed: argparse.Namespace, tuning: TuneSettings) -> Any:
    """Record the observer's topics from the live graph; return a context with the bag's path."""
    named = parsed.measurement or (parsed.angle or '').partition(':')[0]
    usual = streams.of_observer(tuning.entry.observer).USUAL
    return live.recorded((named,) if named else usual, parsed.truth or TRUTH, parsed.live)


def _groups(
    found: Sequence[TuningRecord], tuning: TuneSettings, per_joint: bool
) -> dict[str, list[TuningRecord]]:
    """Return the groups of records that get separate gains, by joint; '': all joints."""
    if not per_joint:
        return {'': list(found)}
    groups: dict[str, list[TuningRecord]] = {}
    for record in found:
        if record.label is None:
            raise UsageError(
                f"--per-joint: '{tuning.entry.observer}' estimates its joints together, so they "
                'share its gains: omit --per-joint'
            )
        if not record.label:  # 'per_joint..gain' is no parameter
            raise UserError(
                f"--per-joint: {record.bag} has a joint without a name, '', which has no gains "
                'of its own: select others with --joint, or omit --per-joint'
            )
        groups.setdefault(record.label, []).append(record)
    return groups


def _of(judged: Sequence[TuningRecord], joint: str) -> list[TuningRecord]:
    """Return the records for validating a group; raise UserError if there are none."""
    found = [record for record in judged if not joint or record.label == joint]
    if judged and not found:
        raise UserError(f"no recording of --judge has a joint '{joint}'")
    return [record for record in found if not record.why]


def _notes(seen: Sequence[TuningRecord]) -> list[str]:
    """Return notes on the bags for the user."""
    found = [f'{record.bag}: not used: {record.why}' for record in seen if record.why]
    found += dict.fromkeys(f'{record.bag}: {note}' for record in seen for note in record.notes)
    by_bag: dict[str, list[str]] = {}
    for record in seen:
        by_bag.setdefault(record.bag, []).extend(record.joints)
    sets = {tuple(sorted(joints)) for joints in by_bag.values()}
    if len(sets) < 2:
        return found
    return found + [
        'the bags have different joints ('
        + '; '.join(', '.join(joints) for joints in sorted(sets))
        + '): every joint has the same weight; --joint selects one, --per-joint tunes each '
        'separately'
    ]


COMMAND = Command(
    'find gains from recorded bags, for a YAML that the node loads',
    arguments,
    run,
    examples=(
        (
            'bags/dfki_simple_pendulum/sac_200hz_multiturn --observer kalman --out params.yaml',
            'gains for the node, validated on the last 30 % of the bag',
        ),
        (
            'BAG --observer hybrid_angle --search bandwidth_hz=10:100 --prefer fast '
            '--out params.yaml',
            'less delay, within a range',
        ),
        (
            '--live 20 --observer kalman --out params.yaml --apply /joint_observer',
            'record the running robot, then set the gains of its node',
        ),
    ),
)
