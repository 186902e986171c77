"""Replay of a drive: what `pmsm_observer` would have answered to the batches of a bag."""

from __future__ import annotations

import argparse
import time
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator_pkg import observers, params_file
from estimator_pkg.bags.block import Block
from estimator_pkg.bags.estimates import Encoded
from estimator_pkg.bags.output import Output
from estimator_pkg.bags.reader import Bag, Topic
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.drive_stream import Answer, DriveStream
from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.messages import drive_samples, vector3
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.nodes.pmsm_settings import CURRENT_VOLTAGE, DRIVE_SAMPLES, KIND, PmsmSettings
from estimator_pkg.parameters import build, declared, parse_assignments
from estimator_pkg.progress import progress

NAME = 'pmsm_observer'
TRUE = '/ground_truth/'
INPUTS = {DRIVE_SAMPLES: (('/drive_samples', drive_samples.TYPE),),
          CURRENT_VOLTAGE: (('/current', vector3.TYPE), ('/voltage', vector3.TYPE))}


def wanted(bag: Bag, observer: str | None, params: str | None) -> bool:
    """True if a drive is to be replayed: by the observer named, or by what the bag carries."""
    if observer:
        return observers.find(observer).kind == KIND
    if params:
        try:
            named = params_file.load(params, NAME).get('observer')
        except UsageError:
            named = None
        if named:
            return observers.find(named).kind == KIND
    names = {topic.name for topic in bag.topics.values() if topic.count}
    joints = any(topic.type == JOINT_STATE and not topic.name.startswith(TRUE)
                 and '/estimate' not in topic.name for topic in bag.topics.values())
    return not joints and any(all(name in names for name, _ in topics)
                              for topics in INPUTS.values())


@dataclass(frozen=True)
class Plan:
    """What is to be replayed, checked."""

    settings: PmsmSettings
    stream: DriveStream
    topics: tuple[Topic, ...]


def make_plan(bag: Bag, parsed: argparse.Namespace) -> Plan:
    """The motor with its parameters, and its topics.

    Raises
    ------
    UserError, UsageError : a topic is not there, or a parameter is wrong.
    """
    if parsed.angle:
        raise UsageError('--angle is not for drives')
    values = params_file.load(parsed.params, parsed.name) if parsed.params else {}
    values.update(parse_assignments(parsed.set))
    values = params_file.of_this_node(values)
    if parsed.observer:
        values['observer'] = parsed.observer
    if parsed.joint:
        if len(parsed.joint) > 1:
            raise UsageError('a drive has one joint: give --joint once')
        values['joint'] = parsed.joint[0]
    if 'input' not in values and not parsed.measurement:
        batches = bag.topics.get(INPUTS[DRIVE_SAMPLES][0][0])
        if (batches is None or not batches.count) and all(
                name in bag.topics for name, _ in INPUTS[CURRENT_VOLTAGE]):
            values['input'] = CURRENT_VOLTAGE
    of_node = {name: values.pop(name) for name in declared(PmsmSettings) if name in values}
    settings = build(PmsmSettings, of_node)
    settings.check()
    observer = settings.find()
    known = {**Configuration(observer).parameters(), **declared(PmsmSettings)}
    for name in values:
        if name not in known:
            raise UsageError(f"unknown parameter '{name}': {suggestion(name, known)}")
    stream = settings.stream(Configuration(observer, values))
    needed = INPUTS[settings.input]
    if parsed.measurement:
        if len(needed) > 1:
            raise UsageError('--measurement is for batches: currents and voltages are read from '
                             f'{needed[0][0]} and {needed[1][0]}')
        needed = ((parsed.measurement, needed[0][1]),)
    return Plan(settings, stream, tuple(bag.require(name, [kind]) for name, kind in needed))


def run(bag: Bag, parsed: argparse.Namespace) -> dict[str, Any]:
    """Replays and says what happened to the samples."""
    begun = time.perf_counter()
    parsed.name = parsed.name or NAME
    plan = make_plan(bag, parsed)
    node = f'/{parsed.name.strip("/")}'
    types = {f'{node}/estimate': JOINT_STATE, f'{node}/estimate_stddev': JOINT_STATE,
             f'{node}/flux_linkage': vector3.TYPE}
    if plan.settings.input == DRIVE_SAMPLES:
        types[f'{node}/estimate_samples'] = drive_samples.TYPE
    plan.stream.stddev_wanted = plan.stream.flux_wanted = True
    plan.stream.joint.warm_up()
    count = sum(topic.count for topic in plan.topics)
    with (BagWriter(parsed.out) if parsed.out else nullcontext()) as writer, \
            progress('replay', count) as advance:
        output = Output(bag, writer, parsed.copy, types) if writer is not None else None
        copied = output.copied if output is not None else set()
        for names, block in bag.blocks({topic.name for topic in plan.topics} | copied):
            before = plan.stream.messages
            made = _answers(names, block, plan, output)
            if output is not None:
                output.write_among(names, block, made)
            advance(plan.stream.messages - before)
    result = {'bag': str(parsed.bag), 'out': parsed.out, **summary(plan),
              'written': output.topics if output else [], 'warnings': bag.warnings,
              'elapsed_s': time.perf_counter() - begun}
    return result


def _answers(names: list[str], block: Block, plan: Plan, output: Output | None) -> Encoded:
    """The answers to a block's messages, one by one as they would have come."""
    made = Encoded(block)
    inputs = {names.index(topic.name): index for index, topic in enumerate(plan.topics)
              if topic.name in names}
    stream = plan.stream
    for row in np.flatnonzero(np.isin(block.topic, list(inputs))).tolist():
        raw = block.data[block.start[row]:block.end[row]].tobytes()
        answers: list[Answer]
        try:
            if plan.settings.input == DRIVE_SAMPLES:
                answers = [stream.batch(raw)]
            elif inputs[int(block.topic[row])] == 0:
                answers = stream.current(raw)
            else:
                answers = stream.voltage(raw)
        except MalformedMessageError:
            continue
        if output is None:
            continue
        for answer in answers:
            # in the order in which the node publishes them
            parts = (answer.estimate, answer.stddev, answer.flux, answer.samples)
            for number, part in enumerate(parts):
                if part is not None:
                    made.add(output.own[number], number + 1, np.array([row]),
                             np.frombuffer(part, np.uint8)[None])
    return made


def summary(plan: Plan) -> dict[str, Any]:
    """What happened to every message and every sample."""
    stream, joint = plan.stream, plan.stream.joint
    unused = {'empty': stream.empty, 'malformed': stream.malformed,
              'unpaired': stream.pairs.unpaired,
              'unbalanced': stream.phases.unbalanced if stream.phases is not None else 0}
    return {
        'observer': joint.observer.name,
        'measurement': ' and '.join(topic.name for topic in plan.topics),
        'messages': {'received': stream.messages, 'used': stream.messages - sum(unused.values()),
                     'dropped': {kind: count for kind, count in unused.items() if count}},
        'joints': {plan.settings.joint: {
            'received': joint.received, 'used': joint.used, 'dropped': joint.dropped(),
            'events': joint.events(), 'status_s': {
                status: count * joint.mean_dt for status, count in stream.statuses.items()},
            'rate_hz': 1.0 / joint.mean_dt if joint.mean_dt > 0.0 else None,
            'why': joint.why() or ('' if joint.used else stream.why_silent())}}}
