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
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.selection import measured_topics
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
from estimator_pkg.evaluation.tuning import live, output
from estimator_pkg.evaluation.tuning.objective import PREFERENCES, Compared
from estimator_pkg.evaluation.tuning.records import TuningRecord, records
from estimator_pkg.evaluation.tuning.settings import settings
from estimator_pkg.evaluation.tuning.tune import (
    DEFAULT,
    Tuned,
    best_linear,
    kept,
    replaces_default,
    tune,
)
from estimator_pkg.evaluation.workers import workers
from estimator_pkg.parameters import declared
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
    observer = sought = parsed.observer or _of_measurement(parsed, columns)
    any_linear = parsed.observer is None and observer == DEFAULT
    if any_linear and (parsed.search or parsed.params or parsed.apply):
        raise UsageError(
            '--search, --params and --apply are for one observer: name it with --observer'
        )
    chosen = settings(parsed, observer)
    destination.check(parsed.out)
    if parsed.apply:  # before anything is recorded or searched
        with live.remote(parsed.apply, observer):
            pass
    options = options_of(parsed, [chosen.entry], columns)
    left_out: list[LeftOut] = []
    tuned: list[Tuned] = []
    with contextlib.ExitStack() as stack:
        run_many = stack.enter_context(workers(parsed.jobs, parsed.scheduler))
        if parsed.live is not None:
            parsed.bags = [stack.enter_context(recorded(parsed, observer))]

        def of(paths: Sequence[str], held_out: float) -> list[TuningRecord]:
            more = chosen.entry, options, held_out, tuple(parsed.joint)
            parts = on_each(run_many, records, expanded(paths), *more, left_out=left_out)
            return [record for part in parts for record in part]

        seen = of(parsed.bags, 0.0 if parsed.judge else parsed.held_out)
        judged = of(parsed.judge, 0.0)
        searched = {Path(each.bag).resolve() for each in seen}
        for each in judged:
            if Path(each.bag).resolve() in searched:
                raise UsageError(
                    f'--judge {each.bag}: the gains are tuned on this recording: name another'
                )
        groups = _by_joint(seen, observer) if parsed.per_joint else {'': seen}
        usable = [record for record in seen if not record.why]
        any_linear = any_linear and bool(usable)
        if any_linear:
            sought = best_linear(usable, chosen)
            chosen = settings(parsed, sought)
            show(f'{sought} is the best linear observer here: it is tuned')
        for joint, group in groups.items():
            of_joint = [each for each in judged if not joint or each.label == joint]
            if judged and not of_joint:
                raise UserError(f"no recording of --judge has a joint '{joint}'")
            of_joint = [each for each in of_joint if not each.why]
            try:
                tuned.append(tune(joint, group, of_joint, chosen, run_many, any_linear))
            except KeyboardInterrupt:  # before this joint's first trial
                if not tuned:
                    raise
                interrupts.finish()
                break
            if tuned[-1].interrupted:
                break
    found = tuned
    notes = [f'{record.bag}: not used: {record.why}' for record in seen if record.why]
    notes += dict.fromkeys(f'{record.bag}: {note}' for record in seen for note in record.notes)
    observer = sought
    versus = [Compared(**each.versus) for each in tuned if each.versus]
    if any_linear and not replaces_default(versus):
        observer = DEFAULT
        chosen = settings(parsed, observer)
        found = [kept(each.joint, groups[each.joint], each.against or each.why) for each in tuned]
        notes.append(f'the file has {observer} as it is')
    show(*output.described(tuned, notes, options.wrap_period))
    wiring, stream = seen[0].seen.recording.setup, streams.of_observer(observer)
    held = wiring.input | dict(chosen.entry.values)
    if stream.WRAPS and options.wrap_period != WRAP_PERIOD:
        held.setdefault(PERIOD_KEY, options.wrap_period)
    whole_file.write_text(Path(parsed.out), output.as_yaml(chosen, held, found, wiring.remaps))
    show(f'gains: {parsed.out}', *started(stream.NODE, parsed.out, wiring.remaps))
    if parsed.apply:
        changed = live.apply(parsed.apply, output.node_values(found), observer)
        show(f'set on {parsed.apply}: {", ".join(changed) or "nothing, the defaults stay"}')
    return {
        'observer': observer,
        'sought': sought,
        'preference': chosen.preference,
        'out': parsed.out,
        'notes': notes,
        'left_out': {each.path: each.why for each in left_out},
        'tuned': [asdict(each) for each in tuned],
    }


def _of_measurement(parsed: argparse.Namespace, columns: log_file.Columns | None) -> str:
    """Return the observer of the first bag's measurement: that of a drive, else the default."""
    if parsed.bags and not (parsed.angle or parsed.measurement):
        first = expanded(parsed.bags)[0].path
        with open_bag(first, parsed.unpack_limit, columns) as bag:
            topics, joints = bag.topics, bool(measured_topics(bag))
        for stream in streams.every():
            if stream.recognises(topics.__contains__, joints):
                return str(declared(stream.SETTINGS)['observer'].default)
    return DEFAULT


def recorded(parsed: argparse.Namespace, observer: str) -> Any:
    """Record the observer's topics from the live graph; return a context with the bag's path."""
    named = parsed.measurement or (parsed.angle or '').partition(':')[0]
    topics = (named,) if named else streams.of_observer(observer).USUAL
    return live.recorded(topics, parsed.truth or TRUTH, parsed.live)


def _by_joint(found: Sequence[TuningRecord], observer: str) -> dict[str, list[TuningRecord]]:
    """Return the records that get gains of their own, by joint; raise UsageError, UserError."""
    groups: dict[str, list[TuningRecord]] = {}
    for record in found:
        if record.label is None:
            raise UsageError(
                f"--per-joint: '{observer}' estimates its joints together, so they share its "
                'gains: omit --per-joint'
            )
        if not record.label:  # 'per_joint..gain' is no parameter
            raise UserError(
                f"--per-joint: {record.bag} has a joint without a name, '', which has no gains "
                'of its own: select others with --joint, or omit --per-joint'
            )
        groups.setdefault(record.label, []).append(record)
    return groups


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
