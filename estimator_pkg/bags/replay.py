# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator replay``: the estimates of a live node, computed from a bag."""

from __future__ import annotations

import argparse
import re
import sys
import time
from contextlib import nullcontext, suppress
from typing import Any

import numpy as np

from estimator_pkg import interrupts, params_file, streams
from estimator_pkg.bags import log_file, unpacking
from estimator_pkg.bags.reader import Bag, open_bag
from estimator_pkg.bags.selection import measured_topics
from estimator_pkg.bags.wiring import Setup, answers, in_order, parameters, wired
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.cli import Command, add_set
from estimator_pkg.errors import UsageError
from estimator_pkg.optional import Lazy
from estimator_pkg.parameters import parse_assignments
from estimator_pkg.printable import show
from estimator_pkg.progress import progress
from estimator_pkg.streams.angle import AngleSettings
from estimator_pkg.streams.contract import Request, Stream
from estimator_pkg.streams.history import GAP

qos = Lazy('estimator_pkg.bags.qos')


NODE_NAME = re.compile(r'/?([A-Za-z_]\w*/)*[A-Za-z_]\w*', re.ASCII)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument('bag', metavar='BAG', help='rosbag2 folder, .mcap or .db3 file, or a log')
    parser.add_argument(
        '--out',
        metavar='BAG',
        help='bag to write: the topics of BAG and the estimates; without it, replay prints only '
        'the summary',
    )
    parser.add_argument(
        '--observer',
        metavar='NAME',
        help="observer to run ('velocity_estimator list'); default: that of --params, else "
        f'{AngleSettings.observer}, or a drive observer if the bag has only drive topics',
    )
    parser.add_argument(
        '--params',
        metavar='YAML',
        help='parameter file of the node; not used if it names another observer than --observer',
    )
    add_set(parser, 'set a parameter (may be repeated)')
    parser.add_argument(
        '--joint',
        metavar='NAME',
        action='append',
        default=[],
        help='estimate this joint only (may be repeated); with --angle, or for a drive: name of '
        'the joint',
    )
    parser.add_argument(
        '--measurement',
        metavar='TOPIC',
        help='topic of joint states; default: the only one that is neither truth nor estimate, '
        'else /joint_states',
    )
    log_file.arguments(parser)
    parser.add_argument(
        '--name',
        metavar='NODE',
        help='name of the node, in the topics of the estimates (default: that of the live node of '
        'the observer)',
    )
    parser.add_argument(
        '--copy',
        metavar='TOPIC',
        nargs='*',
        help='copy only these topics of BAG, or none (default: all)',
    )
    parser.add_argument(
        '--smoothed',
        action='store_true',
        help='also write ~/smoothed and ~/smoothed_stddev, which have the lag smoothing_lag',
    )
    unpacking.arguments(parser)


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Replay; print and return what happened to the samples."""
    begun = time.perf_counter()
    if parsed.name is not None and not NODE_NAME.fullmatch(parsed.name):
        raise UsageError(
            f"--name '{parsed.name}' is not a node name: use letters, digits and '_', with a "
            "namespace if needed, as in 'arm/observer'"
        )
    columns = log_file.columns(parsed)
    with open_bag(parsed.bag, parsed.unpack_limit, columns) as bag:
        setup = _setup(bag, parsed, columns)
        stream = setup.start()
        if parsed.smoothed and not any(each.extra for each in stream.outputs):
            raise UsageError(f'--smoothed is for observers of single angles, not {stream.NODE}')
        stream.wanted[:] = [
            parsed.out is not None and (parsed.smoothed or not each.extra)
            for each in stream.outputs
        ]
        node = f'/{(parsed.name or stream.NODE).strip("/")}'
        names = [f'{node}/{each.name}' for each in stream.outputs]
        written = [name for name, wanted in zip(names, stream.wanted) if wanted]
        copied = _copied(bag, parsed.copy, written) if parsed.out is not None else []
        with (
            interrupts.gently(),
            BagWriter(parsed.out) if parsed.out is not None else nullcontext() as writer,
        ):
            copies, own = {}, {}
            if writer is not None:
                copies = {name: writer.add(bag.topics[name]) for name in copied}
                for number, (name, each) in enumerate(zip(names, stream.outputs)):
                    if stream.wanted[number]:
                        own[number] = writer.add_topic(name, each.type, qos.profile(depth=50))
            read = {topic.name for topic in setup.topics} | set(copied)
            with progress('replay', sum(bag.topics[name].count for name in read)) as advance:
                for topics, block in bag.blocks(read):
                    made = answers(stream, topics, block)
                    if writer is not None:
                        number_of = np.array([copies.get(name, -1) for name in topics])
                        answered = [(own[each.output], each) for each in made]
                        writer.write_block(in_order(block, number_of[block.topic], answered))
                    advance(len(block))
                    if interrupts.came():
                        break
            interrupted = bool(interrupts.came())
            if interrupted:
                bag.warn('interrupted: the rest of the bag was not replayed')
            else:
                for warning in stream.end(str(bag.path)):
                    bag.warn(warning)
                if not stream.answered:
                    why = stream.why()
                    bag.warn(f'{bag.path}: no estimate was made' + (why and f': {why}'))
        result = {
            'bag': str(parsed.bag),
            'out': parsed.out,
            'observer': stream.observer.name,
            'measurement': ' and '.join(topic.name for topic in setup.topics),
            **stream.summary(),
            'written': written,
            'ok': bool(stream.answered),
            'interrupted': interrupted,
            'warnings': bag.warnings,
            'elapsed_s': time.perf_counter() - begun,
        }
    _print(result)
    return result


def _copied(bag: Bag, named: list[str] | None, written: list[str]) -> list[str]:
    """Return the topics to copy, in the bag's order: those named (None: all), but none of ours."""
    for name in named or ():
        bag.require(name)
    for name in sorted(set(bag.topics if named is None else named) & set(written)):
        show(
            f'{name} of {bag.path} is not copied: replay writes its own (give the node another '
            'name with --name NODE)',
            file=sys.stderr,
        )
    return [name for name in bag.topics if (named is None or name in named) and name not in written]


def _setup(bag: Bag, parsed: argparse.Namespace, columns: log_file.Columns | None) -> Setup:
    """Return the requested stream, parameters and topics.

    Raises
    ------
    UserError, UsageError : something does not exist, or a parameter is wrong.
    """
    assignments = parse_assignments(parsed.set)
    stream = _stream(bag, parsed, assignments)
    values = parameters(stream, parsed.params, assignments, parsed.observer, parsed.name)
    if columns is not None and columns.prismatic and stream.WRAPS:
        values.setdefault('wrap_period', 0.0)
    return wired(
        stream, bag, values, Request(parsed.measurement, parsed.angle, tuple(parsed.joint))
    )


def _stream(bag: Bag, parsed: argparse.Namespace, assignments: dict[str, Any]) -> type[Stream]:
    """Return the stream of the observer that is named, else of the file, else of the topics."""
    named = parsed.observer or assignments.get('observer')
    if isinstance(named, str):
        return streams.of_observer(named)
    known = streams.every()
    if parsed.params:
        for stream in known:
            with suppress(UsageError):  # reported when the file is used
                section = params_file.load(parsed.params, parsed.name or stream.NODE)
                if isinstance(section.get('observer'), str):
                    return streams.of_observer(section['observer'])
        sections = params_file.section_names(parsed.params)
        if of_file := [stream for stream in known if stream.NODE in sections]:
            return of_file[0]
    joints = bool(measured_topics(bag, empty=True))
    return next(
        (stream for stream in known if stream.recognises(bag.has, joints)),
        streams.named(streams.USUAL),
    )


def _print(result: dict[str, Any]) -> None:
    counts = result['messages']
    show(
        f'{result["bag"]}: {result["observer"]} on {result["measurement"]}, '
        f'{counts["received"]} messages{_kinds(counts["dropped"])}'
        + (f', {counts["estimates"]} with estimates' if 'estimates' in counts else '')
        + (
            f', {counts["inputs_malformed"]} malformed messages on the inputs'
            if counts.get('inputs_malformed')
            else ''
        )
    )
    for name, joint in result['joints'].items():
        rate = f'{joint["rate_hz"]:.4g} Hz' if joint['rate_hz'] else 'rate unknown'
        show(
            f'  {name}: received {joint["received"]}, used {joint["used"]}'
            f'{_kinds(joint["dropped"])}{_kinds(joint["events"], "events")}; {rate}; '
            + (
                ', '.join(
                    f'{status if status != GAP else "without samples"} {seconds:.3f} s'
                    for status, seconds in joint['status_s'].items()
                )
                or 'no time passed'
            )
            + (f'; {joint["why"]}' if joint['why'] else '')
            + (f'; stamps {joint["stamps"]["stamp_repair"]}' if 'stamps' in joint else '')
            + ''.join(f'; {source} {text}' for source, text in joint.get('sources', {}).items())
        )
    if result['out']:
        show(f'{result["out"]}: {", ".join(result["written"])}')
    print(f'{result["elapsed_s"]:.2f} s')


def _kinds(counts: dict[str, int], what: str = 'dropped') -> str:
    if not counts:
        return ''
    return f', {what}: ' + ', '.join(f'{kind} {count}' for kind, count in counts.items())


COMMAND = Command(
    'compute the estimates of a live node from a bag',
    arguments,
    run,
    examples=(
        (
            'bags/dfki_simple_pendulum/sac_200hz_multiturn --out estimates',
            'the estimates of joint_observer, as a bag',
        ),
        (
            'BAG --observer kalman --params params.yaml --out estimates',
            'another observer, with the parameters of a node',
        ),
        (
            'bags/simulated/trapezoid_raw_counts --angle /angle:data '
            '--set counts_per_revolution=4096 --out estimates',
            'raw counts in messages of another type',
        ),
    ),
)
