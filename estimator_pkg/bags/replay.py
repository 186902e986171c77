# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator replay``: the estimates of a live node, computed from a bag."""

from __future__ import annotations

import argparse
import re
import sys
import time
from contextlib import nullcontext
from typing import Any

import numpy as np

from estimator_pkg import interrupts
from estimator_pkg.bags import log_file, unpacking
from estimator_pkg.bags.feeding import answers, in_order
from estimator_pkg.bags.reader import Bag, open_bag
from estimator_pkg.bags.wiring import Setup, parameters, requested, wired
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.cli import Command, add_set
from estimator_pkg.errors import UsageError
from estimator_pkg.messages.block import Block
from estimator_pkg.optional import Lazy
from estimator_pkg.parameters import parse_assignments
from estimator_pkg.printable import show
from estimator_pkg.progress import progress
from estimator_pkg.streams.angle import AngleSettings
from estimator_pkg.streams.contract import Answers, Request, Stream
from estimator_pkg.streams.history import GAP

qos = Lazy('estimator_pkg.bags.qos')


class ReplayWriter:
    """Writes copied topics of a bag, and the outputs of a stream that are wanted.

    Parameters
    ----------
    node : name of the node, before those of its outputs.
    copy : topics of `bag` to copy; None: all.

    Attributes
    ----------
    topics : names of the new topics. copied : names of the copied ones.
    """

    def __init__(
        self, bag: Bag, writer: BagWriter, stream: Stream, node: str, copy: list[str] | None
    ) -> None:
        self._writer = writer
        outputs = [(f'{node}/{each.name}', each.type) for each in stream.outputs]
        self.topics = [name for (name, _), made in zip(outputs, stream.wanted) if made]
        for name in copy or ():
            bag.require(name)
        chosen = set(bag.topics if copy is None else copy)
        for name in sorted(chosen & set(self.topics)):
            show(
                f'{name} of {bag.path} is not copied: replay writes its own (give the node another '
                'name with --name NODE)',
                file=sys.stderr,
            )
        self.copied = chosen - set(self.topics)
        self._copies = {
            name: writer.add(topic) for name, topic in bag.topics.items() if name in self.copied
        }
        self._own = {
            number: writer.add_topic(name, kind, qos.profile(depth=50))
            for number, (name, kind) in enumerate(outputs)
            if stream.wanted[number]
        }

    def write(self, names: list[str], block: Block, made: list[Answers]) -> None:
        """Write the copied messages of a block, and each answer behind its message.

        Parameters
        ----------
        names : the bag's topics, in the order of the block's topic numbers.
        """
        number = np.array([self._copies.get(name, -1) for name in names])
        answered = [(self._own[each.output], each) for each in made]
        self._writer.write_block(in_order(block, number[block.topic], answered))


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
        node = f'/{(parsed.name or stream.NODE).strip("/")}'
        with (
            interrupts.gently(),
            BagWriter(parsed.out) if parsed.out is not None else nullcontext() as writer,
        ):
            output, interrupted = None, False
            if parsed.smoothed and not any(each.extra for each in stream.outputs):
                raise UsageError(f'--smoothed is for observers of single angles, not {stream.NODE}')
            stream.wanted[:] = [
                writer is not None and (parsed.smoothed or not each.extra)
                for each in stream.outputs
            ]
            if writer is not None:
                output = ReplayWriter(bag, writer, stream, node, parsed.copy)
            read = {topic.name for topic in setup.topics} | (output.copied if output else set())
            with progress('replay', sum(bag.topics[name].count for name in read)) as advance:
                for names, block in bag.blocks(read):
                    made = answers(stream, names, block)
                    if output is not None:
                        output.write(names, block, made)
                    advance(len(block))
                    interrupted = bool(interrupts.came())
                    if interrupted:
                        break
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
            'written': output.topics if output else [],
            'ok': bool(stream.answered),
            'interrupted': interrupted,
            'warnings': bag.warnings,
            'elapsed_s': time.perf_counter() - begun,
        }
    _print(result)
    return result


def _setup(bag: Bag, parsed: argparse.Namespace, columns: log_file.Columns | None) -> Setup:
    """Return the requested stream, parameters and topics.

    Raises
    ------
    UserError, UsageError : something does not exist, or a parameter is wrong.
    """
    assignments = parse_assignments(parsed.set)
    stream = requested(bag, parsed.observer, parsed.params, assignments, parsed.name)
    values = parameters(stream, parsed.params, assignments, parsed.observer, parsed.name)
    if columns is not None and columns.prismatic and stream.WRAPS:
        values.setdefault('wrap_period', 0.0)
    return wired(
        stream, bag, values, Request(parsed.measurement, parsed.angle, tuple(parsed.joint))
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
