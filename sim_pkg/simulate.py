# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator simulate``: write a bag with measurement and truth, fixed by its seed."""

from __future__ import annotations

import argparse
import math
from collections import Counter
from typing import Any

from estimator_pkg import registry
from estimator_pkg.cli import Command, add_set
from estimator_pkg.errors import UsageError
from estimator_pkg.parameters import build, declared, parse_assignments
from estimator_pkg.printable import show
from sim_pkg.contract import FOREVER, RunSettings, Simulator

START_NS = 1_000_000_000 * 1_000_000_000  # start time of every simulated bag (in 2001)
DURATION = 10.0  # default [s]
LONGEST = 1e7  # [s]
NOT_IN_BAGS = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        'plant', metavar='PLANT', help="a simulator ('velocity_estimator list simulators')"
    )
    parser.add_argument('--out', metavar='BAG', required=True, help='folder of the bag to make')
    parser.add_argument(
        '--duration', metavar='S', type=float, help=f'simulated seconds (default {DURATION:g})'
    )
    parser.add_argument(
        '--seed', metavar='N', type=int, help=f'random seed (default {RunSettings().seed})'
    )
    parser.add_argument('--params', metavar='YAML', help='parameter file of its node')
    add_set(parser, 'set a parameter (may be repeated)')


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Simulate, write the bag, print a summary; return it as a dictionary."""
    simulator: Simulator = registry.find(registry.SIMULATORS, parsed.plant)
    values = {**_from_file(parsed.params, simulator), **parse_assignments(parsed.set)}
    in_file = {
        name: values.pop(name)
        for name in declared(RunSettings)
        if name in values and name not in declared(simulator.parameters)
    }
    settings = build(
        RunSettings, {**in_file, **({} if parsed.seed is None else {'seed': parsed.seed})}
    )
    duration = parsed.duration
    if duration is None:
        duration = DURATION if settings.duration == FOREVER else settings.duration
    if not (math.isfinite(duration) and 0.0 < duration <= LONGEST):
        raise UsageError(f'--duration {duration:g}: it must be above 0 and at most {LONGEST:g} s')
    parameters: Any = build(simulator.parameters, values, owner=f"simulator '{simulator.name}'")
    counts, written = write_bag(simulator, parameters, duration, settings.seed, parsed.out)
    ended = written < duration
    show(
        f'{parsed.out}: {written:g} s of {simulator.name}, seed {settings.seed}'
        + (f'; interrupted: {duration:g} s were requested' if ended else '')
    )
    for topic in simulator.topics(parameters):
        of = 'truth' if topic.truth else 'measurement'
        show(f'  /{topic.name}  {counts[topic.name]} messages of {topic.type} ({of})')
    return {
        'bag': parsed.out,
        'simulator': simulator.name,
        'duration': written,
        'interrupted': ended,
        'seed': settings.seed,
        'topics': {
            f'/{topic.name}': {
                'type': topic.type,
                'truth': topic.truth,
                'messages': counts[topic.name],
            }
            for topic in simulator.topics(parameters)
        },
    }


def write_bag(
    simulator: Simulator, parameters: Any, duration: float, seed: int, path: str
) -> tuple[Counter[str], float]:
    """Simulate into a new bag; an interrupt closes it with the messages written so far.

    Parameters
    ----------
    parameters : an instance of ``simulator.parameters``.
    duration : s.
    path : folder of the bag; it must not exist.

    Returns
    -------
    The number of messages per topic, and the simulated seconds.

    Raises
    ------
    UserError : `path` exists or cannot be written.
    KeyboardInterrupt : interrupted before the first message.
    """
    from estimator_pkg import interrupts
    from estimator_pkg.bags.writer import BagWriter
    from estimator_pkg.progress import progress

    counts: Counter[str] = Counter()
    done_ns = 0
    with (
        interrupts.gently(),
        BagWriter(path) as bag,
        progress('simulating', round(duration * 1e3)) as advance,
    ):
        for topic in simulator.topics(parameters):
            bag.add_topic(f'/{topic.name}', topic.type)
        for chunk in simulator.generate(parameters, duration, seed):
            for message in chunk:
                bag.write(f'/{message.topic}', START_NS + message.due_ns, message.encode(START_NS))
                counts[message.topic] += 1
            if chunk:
                passed = max(0, (chunk[-1].due_ns - done_ns) // 1_000_000)
                done_ns += passed * 1_000_000
                advance(passed)
            if interrupts.came():
                if not counts:
                    raise KeyboardInterrupt
                return counts, chunk[-1].due_ns * 1e-9 if chunk else done_ns * 1e-9
    return counts, duration


def _from_file(path: str | None, simulator: Simulator) -> dict[str, Any]:
    """Return the parameters in a file, without those that only a live node has."""
    if path is None:
        return {}
    from estimator_pkg.params_file import load

    return {
        name: value
        for name, value in load(path, f'{simulator.name}_sim').items()
        if not name.startswith(NOT_IN_BAGS)
    }


COMMAND = Command(
    'simulate a plant: a bag with measurement and truth',
    arguments,
    run,
    examples=(
        (
            'encoder --out sine --duration 5 --set profile=sine --set rate=1000',
            'an encoder of 4096 counts at 1 kHz',
        ),
        ('pendulum --out swing --seed 3', 'a pendulum with another random seed'),
    ),
)
