"""Replay for observers of mechanisms: the messages of the live node, in the order of the bag."""

from __future__ import annotations

import argparse
import contextlib
import time
from contextlib import nullcontext
from typing import Any

from estimator_pkg import observers, params_file
from estimator_pkg.bags import qos
from estimator_pkg.bags.reader import Bag, open_bag
from estimator_pkg.bags.selection import measurement_topic
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.driver.mechanism import (
    COMMAND,
    MechanismBank,
    MechanismConfiguration,
)
from estimator_pkg.errors import UsageError, UserError, suggestion
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import TYPE, Decoder, Encoder
from estimator_pkg.nodes.mechanical_settings import MechanicalNodeSettings
from estimator_pkg.parameters import build, declared, parse_assignments
from estimator_pkg.progress import progress

NAME = 'mechanical_observer'
OF_EVERY_NODE = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')


def plan(values: dict[str, Any]) -> tuple[MechanicalNodeSettings, MechanismBank]:
    """The settings of the node and its mechanisms, from parameters as of its file.

    Raises
    ------
    UserError, UsageError : a parameter is wrong, or a model cannot be used.
    """
    common, overrides = params_file.split(
        {name: value for name, value in values.items() if not name.startswith(OF_EVERY_NODE)})
    settings = build(MechanicalNodeSettings,
                     {name: common.pop(name) for name in declared(MechanicalNodeSettings)
                      if name in common})
    observer = settings.find_observer()
    known = MechanismConfiguration(observer).parameters()
    for name in common:
        if name not in known:
            raise UsageError(f"unknown parameter '{name}': "
                             f'{suggestion(name, {**known, **declared(MechanicalNodeSettings)})}')
    return settings, MechanismBank(MechanismConfiguration(observer, common, overrides),
                                   settings.mechanisms, settings.input)


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Replays and says what happened to the samples (the arguments are those of `replay`)."""
    begun = time.perf_counter()
    name = parsed.name or NAME
    values = params_file.load(parsed.params, name) if parsed.params else {}
    values.update(parse_assignments(parsed.set))
    if parsed.observer:
        values['observer'] = parsed.observer
    if parsed.angle or parsed.joint:
        raise UsageError('--angle and --joint are for observers of single angles: name the joints '
                         "of a mechanism with --set 'joints=[...]'")
    settings, bank = plan(values)
    with open_bag(parsed.bag) as bag:
        topic = measurement_topic(bag, parsed.measurement)
        command = '/effort_command'
        if settings.input == COMMAND:
            bag.require(command, [TYPE])
        with (BagWriter(parsed.out) if parsed.out else nullcontext()) as writer:
            out = _Output(bag, writer, f'/{name.strip("/")}', parsed.copy) if writer else None
            counts = _replay(bag, bank, settings, topic, command, out)
        _check(bag, bank, topic, counts)
        result = {
            'bag': str(parsed.bag), 'out': parsed.out, 'observer': settings.observer,
            'measurement': topic, 'messages': counts, 'warnings': bag.warnings,
            'written': out.topics if out else [],
            'joints': {mechanism.name: {
                'received': mechanism.received, 'used': mechanism.used,
                'dropped': mechanism.dropped(), 'events': mechanism.events(),
                'incomplete': mechanism.incomplete, 'why': mechanism.why(),
                'rate_hz': 1.0 / mechanism.mean_dt if mechanism.mean_dt > 0.0 else None}
                for mechanism in bank.joints.values()},
            'elapsed_s': time.perf_counter() - begun}
    _print(result)
    return result


def _replay(bag: Bag, bank: MechanismBank, settings: MechanicalNodeSettings, topic: str,
            command: str, out: _Output | None) -> dict[str, int]:
    layouts = {topic: Decoder().layout, command: Decoder().layout}
    by_publisher = settings.stamp_source == 'publisher'
    listened = {topic, command} if settings.input == COMMAND else {topic}
    counts = {'received': 0, 'malformed': 0, 'estimates': 0}
    with progress('replay', bag.topics[topic].count) as advance:
        for message in bag.messages(listened | (out.copied if out else set())):
            if out is not None and message.topic in out.copied:
                out.copy(message)
            if message.topic not in listened:
                continue
            try:
                layout = layouts[message.topic](message.raw)
                positions, efforts = layout.numbers(message.raw, 0), layout.numbers(message.raw, 2)
            except MalformedMessageError:
                counts['malformed'] += 1
                continue
            stamp_ns = message.publish_ns if by_publisher else layout.stamp_ns(message.raw)
            if message.topic == command:
                bank.command(stamp_ns, layout.names, efforts)
                continue
            counts['received'] += 1
            valid = bank.update(stamp_ns, layout.names, positions, efforts)
            counts['estimates'] += bool(valid)
            if out is not None:
                out.write(message.log_ns, stamp_ns, layout.frame_id, valid, bank)
            advance(1)
    return counts


class _Output:
    """Writes the copied topics with the estimates among them."""

    def __init__(self, bag: Bag, writer: BagWriter, node: str, copy: list[str] | None) -> None:
        self._writer = writer
        self.topics = [f'{node}/estimate', f'{node}/estimate_stddev']
        for name in copy or ():
            bag.require(name)
        wanted = set(bag.topics if copy is None else copy) - set(self.topics)
        self.copied = {name for name in wanted if bag.topics[name].serialization == 'cdr'}
        for name in bag.topics:
            if name in self.copied:
                topic = bag.topics[name]
                writer.add_topic(name, topic.type, topic.qos, definition=topic.definition,
                                 definition_format=topic.definition_format,
                                 type_hash=topic.type_hash)
        for name in self.topics:
            writer.add_topic(name, TYPE, qos.profile(depth=50))
        self._encoders = Encoder(), Encoder()

    def copy(self, message: Any) -> None:
        """A message of the bag, as it is."""
        self._writer.write(message.topic, message.log_ns, message.raw, message.publish_ns)

    def write(self, log_ns: int, stamp_ns: int, frame_id: str, valid: list[Any],
              bank: MechanismBank) -> None:
        """The estimates that a message gave."""
        names = [each.name for each in valid]
        pairs = bank.stddevs(names)
        self._writer.write(self.topics[0], log_ns, self._encoders[0].encode(
            stamp_ns, frame_id, names, [each.position for each in valid],
            [each.velocity for each in valid]))
        self._writer.write(self.topics[1], log_ns, self._encoders[1].encode(
            stamp_ns, frame_id, names, [pair[0] for pair in pairs], [pair[1] for pair in pairs]))


def _check(bag: Bag, bank: MechanismBank, topic: str, counts: dict[str, int]) -> None:
    """A mechanism that never became complete is a mistake in the names, or in the inputs."""
    for mechanism in bank.joints.values():
        if mechanism.received == 0:
            raise UserError(f"topic '{topic}' of {bag.path} never has all joints of mechanism "
                            f"'{mechanism.name}' ({', '.join(mechanism.names)}): name them with "
                            "the parameter 'joints'")
    if not counts['estimates']:
        why = '; '.join(filter(None, (mechanism.why() for mechanism in bank.joints.values())))
        bag.warn(f'no estimate was given: {why}' if why else 'no estimate was given')


def _print(result: dict[str, Any]) -> None:
    counts = result['messages']
    print(f"{result['bag']}: {result['observer']} on {result['measurement']}, "
          f"{counts['received']} messages, {counts['estimates']} with estimates"
          + (f", {counts['malformed']} malformed" if counts['malformed'] else ''))
    for name, mechanism in result['joints'].items():
        rate = f"{mechanism['rate_hz']:.4g} Hz" if mechanism['rate_hz'] else 'rate unknown'
        dropped = ', '.join(f'{kind} {count}' for kind, count in {
            **mechanism['dropped'], **mechanism['events']}.items())
        print(f"  {name}: received {mechanism['received']}, used {mechanism['used']}; {rate}"
              + (f'; {dropped}' if dropped else '')
              + (f"; incomplete {mechanism['incomplete']}" if mechanism['incomplete'] else '')
              + (f"; {mechanism['why']}" if mechanism['why'] else ''))
    if result['out']:
        print(f"{result['out']}: {', '.join(result['written'])}")
    print(f"{result['elapsed_s']:.2f} s")


def wanted(parsed: argparse.Namespace) -> bool:
    """True if the observer that is asked for is one of mechanisms."""
    name = parsed.observer
    if not name and parsed.params:
        for node in (NAME, parsed.name or NAME):
            with contextlib.suppress(UsageError):  # said where the file is used
                name = params_file.load(parsed.params, node).get('observer') or name
    if not name:
        name = parse_assignments(parsed.set).get('observer')
    return isinstance(name, str) and observers.find(name).kind == 'mechanical'
