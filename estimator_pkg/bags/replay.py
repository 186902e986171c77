"""``velocity_estimator replay``: the estimates that a live node would have given, from a bag."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator_pkg import observers, params_file
from estimator_pkg.bags import drive_replay, mechanical_replay
from estimator_pkg.bags.block import Block
from estimator_pkg.bags.estimates import Encoded, messages
from estimator_pkg.bags.estimation import GAP, Estimated, Estimation
from estimator_pkg.bags.output import Output
from estimator_pkg.bags.reader import Bag, open_bag
from estimator_pkg.bags.samples import AngleField, JointStates, Source
from estimator_pkg.bags.selection import measurement_topic
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.cli import Command
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.errors import UsageError, UserError, suggestion
from estimator_pkg.messages.joint_state import TYPE, Encoder
from estimator_pkg.nodes.settings import ANGLE, NodeSettings
from estimator_pkg.parameters import build, declared, parse_assignments
from estimator_pkg.progress import progress

NAME = 'joint_observer'


@dataclass(frozen=True)
class Plan:
    """What is to be replayed, checked."""

    settings: NodeSettings
    configuration: Configuration
    topic: str
    source: Source


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    parser.add_argument('bag', metavar='BAG', help='rosbag2 folder, .mcap or .db3 file')
    parser.add_argument('--out', metavar='BAG',
                        help='bag to write: the topics of BAG and the estimates; without it, only '
                             'the summary is printed')
    parser.add_argument('--observer', metavar='NAME',
                        help="which observer ('velocity_estimator list'); default: that of "
                             f'--params, else {NodeSettings.observer}')
    parser.add_argument('--params', metavar='YAML', help='parameter file of the node')
    parser.add_argument('--set', metavar='KEY=VALUE', action='append', default=[],
                        help='set a parameter (may be repeated)')
    parser.add_argument('--joint', metavar='NAME', action='append', default=[],
                        help='estimate this joint only (may be repeated); with --angle: what the '
                             'joint is called')
    parser.add_argument('--measurement', metavar='TOPIC',
                        help='joint states to take; default: the only ones that are neither truth '
                             'nor estimate, else /joint_states')
    parser.add_argument('--angle', metavar='TOPIC:FIELD',
                        help='take one joint from a number in messages of any type, as in '
                             "/odom:pose.pose.orientation.yaw or /encoder:data; set wrap_period=0 "
                             'for what does not wrap')
    parser.add_argument('--name', metavar='NODE',
                        help='name of the node, in the topics of the estimates (default '
                             f'{NAME}, of a drive {drive_replay.NAME})')
    parser.add_argument('--copy', metavar='TOPIC', nargs='*',
                        help='copy only these topics of BAG (or none); default: all')


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Replays and says what happened to the samples."""
    if mechanical_replay.wanted(parsed):
        return mechanical_replay.run(parsed)
    begun = time.perf_counter()
    with open_bag(parsed.bag) as bag:
        if drive_replay.wanted(bag, parsed.observer, parsed.params):
            result = drive_replay.run(bag, parsed)
            _print(result)
            return result
        parsed.name = parsed.name or NAME
        plan = make_plan(bag, parsed)
        estimation = Estimation(plan.configuration, plan.settings.only,
                                messages=bag.topics[plan.topic].count)
        with (BagWriter(parsed.out) if parsed.out else nullcontext()) as writer:
            with progress('replay', bag.topics[plan.topic].count) as advance:
                output = None
                if writer is not None:
                    node = f'/{parsed.name.strip("/")}'
                    output = _Output(bag, writer, parsed.copy, {
                        f'{node}/estimate': TYPE, f'{node}/estimate_stddev': TYPE})
                done = 0
                for names, block, groups in estimates(bag, plan, estimation,
                                                      output.copied if output else set()):
                    if output is not None:
                        output.write(names, block, groups)
                    advance(estimation.messages - done)
                    done = estimation.messages
            _check_joints(bag, plan, estimation)
        result = {'bag': str(parsed.bag), 'out': parsed.out, **summary(plan, estimation),
                  'written': output.topics if output else [], 'warnings': bag.warnings,
                  'elapsed_s': time.perf_counter() - begun}
    _print(result)
    return result


def make_plan(bag: Bag, parsed: argparse.Namespace) -> Plan:
    """The observer with its parameters, and where the measurement is.

    Raises
    ------
    UserError, UsageError : something is not there, or a parameter is wrong.
    """
    values = params_file.load(parsed.params, parsed.name) if parsed.params else {}
    values.update(parse_assignments(parsed.set))
    if parsed.observer:
        values['observer'] = parsed.observer
    topic, _, path = (parsed.angle or '').partition(':')
    if parsed.angle:
        if not topic or not path:
            raise UsageError(f"--angle '{parsed.angle}' is not TOPIC:FIELD")
        if parsed.measurement:
            raise UsageError('give either --angle or --measurement')
    common, overrides = params_file.split(params_file.of_this_node(values))
    of_node = {name: common.pop(name) for name in declared(NodeSettings) if name in common}
    if parsed.angle:
        of_node['input'] = ANGLE
        of_node['angle_type'] = 'Float64'  # whatever it is, the bag says
    if parsed.joint:
        of_node['joints'] = parsed.joint
        if of_node.get('input') == ANGLE:
            if len(parsed.joint) > 1:
                raise UsageError('an angle belongs to one joint: give --joint once')
            of_node['angle_joint'] = parsed.joint[0]
    settings = build(NodeSettings, of_node)
    observer = observers.find(settings.observer)
    if observer.kind != 'angle':
        raise UsageError(f"observer '{observer.name}' does not work from an angle alone")
    _check_known(common, Configuration(observer).parameters())
    settings.check()
    configuration = Configuration(observer, settings.implied(common), overrides)
    for joint in ('', *configuration.overrides):
        configuration.for_joint(joint)
    if settings.input != ANGLE:
        name = measurement_topic(bag, parsed.measurement)
        return Plan(settings, configuration, name,
                    JointStates(settings.stamp_source == 'publisher'))
    found = bag.require(topic or parsed.measurement or '/angle')
    source = AngleField(found, path or 'data', settings.angle_joint, settings.raw_angle)
    if source.is_integer and settings.counts_per_revolution <= 0.0:
        raise UsageError(f"'{path or 'data'}' of {found.name} is a whole number, so it carries "
                         "counts: set 'counts_per_revolution'")
    return Plan(settings, configuration, found.name, source)


def _check_known(values: dict[str, Any], of_observer: dict[str, Any]) -> None:
    known = {**of_observer, **declared(NodeSettings)}
    for name in values:
        if name not in known:
            raise UsageError(f"unknown parameter '{name}': {suggestion(name, known)}")


def estimates(bag: Bag, plan: Plan, estimation: Estimation, copied: set[str]
              ) -> Iterator[tuple[list[str], Block, list[Estimated]]]:
    """(topic names, block, estimates) over the bag; blocks hold the `copied` topics too."""
    for names, block in bag.blocks({plan.topic, *copied}):
        measured = block
        rows = None
        if copied:
            rows = np.flatnonzero(block.topic == names.index(plan.topic))
            measured = block.take(rows)
        groups, malformed = plan.source.samples(measured)
        found = estimation.update(groups, len(malformed))
        if rows is not None:
            found = [item._replace(samples=item.samples._replace(rows=rows[item.samples.rows]))
                     for item in found]
        yield names, block, found


class _Output(Output):
    """Writes the copied topics with the estimates among them."""

    _encoders = Encoder(), Encoder()

    def write(self, names: list[str], block: Block, groups: list[Estimated]) -> None:
        """The block's messages and its estimates."""
        made = Encoded(block)
        for group in groups:
            for kind in (0, 1):
                for rows, raw in messages(group, self._encoders[kind], stddev=kind == 1):
                    made.add(self.own[kind], kind + 1, rows, raw)
        self.write_among(names, block, made)


def _check_joints(bag: Bag, plan: Plan, estimation: Estimation) -> None:
    """The joints that the user named must be there."""
    if not estimation.seen:
        raise UserError(f"topic '{plan.topic}' of {bag.path} names no joint")
    there = ', '.join(sorted(estimation.seen))
    missing = [name for name in plan.settings.only if name not in estimation.seen]
    if missing and plan.settings.input != ANGLE:
        raise UserError(f"topic '{plan.topic}' of {bag.path} has no joint '{missing[0]}'; it has "
                        f'{there}')
    for name in plan.configuration.overrides:
        if name not in estimation.seen:
            bag.warn(f"parameters are given for a joint '{name}' that never came; {plan.topic} has "
                     f'{there}')


def summary(plan: Plan, estimation: Estimation) -> dict[str, Any]:
    """What happened to every message and every sample."""
    bank = estimation.bank
    unused = {'empty': bank.empty, 'mismatched': bank.mismatched,
              'malformed': estimation.malformed}
    return {
        'observer': plan.configuration.observer.name, 'measurement': plan.topic,
        'messages': {'received': estimation.messages,
                     'used': estimation.messages - sum(unused.values()),
                     'dropped': {kind: count for kind, count in unused.items() if count}},
        'joints': {name: {
            'received': joint.received, 'used': joint.used, 'dropped': joint.dropped(),
            'events': joint.events(),
            'status_s': dict(estimation.history[name].seconds),
            'rate_hz': 1.0 / joint.mean_dt if joint.mean_dt > 0.0 else None,
            'why': _why(joint)}
            for name, joint in bank.joints.items()}}


def _why(joint: Any) -> str:
    return (joint.functions.limits(joint.mean_dt) or '') if joint.mean_dt > joint.longest_dt else ''


def _print(result: dict[str, Any]) -> None:
    counts = result['messages']
    print(f"{result['bag']}: {result['observer']} on {result['measurement']}, "
          f"{counts['received']} messages{_kinds(counts['dropped'])}")
    for name, joint in result['joints'].items():
        rate = f"{joint['rate_hz']:.4g} Hz" if joint['rate_hz'] else 'rate unknown'
        print(f"  {name}: received {joint['received']}, used {joint['used']}"
              f"{_kinds(joint['dropped'])}{_kinds(joint['events'], 'events')}; {rate}; "
              + (', '.join(f'{status if status != GAP else "without samples"} {seconds:.3f} s'
                           for status, seconds in joint['status_s'].items()) or 'no time passed')
              + (f"; {joint['why']}" if joint['why'] else ''))
    if result['out']:
        print(f"{result['out']}: {', '.join(result['written'])}")
    print(f"{result['elapsed_s']:.2f} s")


def _kinds(counts: dict[str, int], what: str = 'dropped') -> str:
    if not counts:
        return ''
    return f', {what}: ' + ', '.join(f'{kind} {count}' for kind, count in counts.items())


COMMAND = Command('the estimates that a live node would give, from a bag', arguments, run)
