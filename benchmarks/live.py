# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``--part live``: the nodes over real DDS, next to a node that only republishes.

A null node takes and publishes the same types on the same executor. Costs are those of node and
null node at the same time, starts and latencies those of each alone, in turn. All are processes in
a ROS domain of their own; the part needs ROS and psutil.
"""

from __future__ import annotations

import importlib.util
import json
import math
import signal
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from types import MappingProxyType
from typing import Any, NamedTuple

from benchmarks import outside
from benchmarks.drive import MOTOR
from benchmarks.timing import not_run, row
from estimator_pkg.errors import UserError
from estimator_pkg.progress import progress

Rows = list[dict[str, Any]]
Measured = dict[str, dict[str, Any]]

JOINTS, CURRENTS, BATCHES = 'joints', 'currents', 'batches'
COUNT, BATCH = 7, 200  # joints of a message, samples of a batch
SIZE = {JOINTS: COUNT, CURRENTS: 1, BATCHES: BATCH}
HERTZ = {JOINTS: 1000.0, CURRENTS: 1000.0, BATCHES: 100.0}
LONGEST = 8.0  # [s] to wait for a first estimate
LOSSES = ((1000.0, 7), (2000.0, 7), (5000.0, 7), (5000.0, 150))  # [Hz], joints
LOSSLESS = 2000.0  # [Hz] up to which nothing may be lost


class Subject(NamedTuple):
    """A measured node: kind of its input, parameters.

    cost, median, late : largest ratio to the null node of CPU per message, of the median latency,
    and of that at 99 %; of observers in plain Python, and of one with two messages a sample, the
    last is what is reached (1.5 to 1.65) and a margin. None: no requirement.
    first : longest time to the first estimate [s]; None: not measured.
    deviation : somebody receives the standard deviations, too.
    """

    kind: str = JOINTS
    parameters: Mapping[str, Any] = MappingProxyType({})
    cost: float | None = None
    median: float | None = None
    late: float | None = 2.0
    first: float | None = math.inf
    deviation: bool = False


# `mechanical_observer` and `switched_observer` take one of the joints, the others all.
ONE = {'joints': '[joint_0]'}
WHEELS = {'radius': '[0.1]', 'track': 0.5, 'wheels_left': '[joint_0]', 'wheels_right': '[joint_1]'}
NODES = {
    'joint_observer': Subject(cost=1.2, median=1.15, late=1.3),
    'joint_observer, deviation': Subject(cost=1.6, late=None, first=None, deviation=True),
    'adaptive_observer': Subject(),
    'mechanical_observer': Subject(parameters=ONE, late=1.3),
    'switched_observer': Subject(parameters=ONE),
    'wheel_odometry': Subject(parameters=WHEELS),
    'pmsm_observer': Subject(CURRENTS, {**MOTOR, 'input': 'current_voltage'}, first=None),
    'pmsm_observer, batches': Subject(BATCHES, MOTOR, late=None, first=2.0),
}
NULL = {kind: f'null_{kind}' for kind in HERTZ}
START = {'estimate': ('process start to first estimate', 's')}
LATENCY = {
    'median_ms': ('stamp to receipt, median', 'ms'),
    'late_ms': ('stamp to receipt, 99 %', 'ms'),
}


def live(quick: bool = False) -> Rows:
    """Return rows: CPU per message, losses, starts and latencies; raise UserError."""
    for needed in ('rclpy', 'psutil'):
        if importlib.util.find_spec(needed) is None:
            raise UserError(f'{needed} is not installed')
    started = [name for name, node in NODES.items() if node.first is not None]
    return [
        *(made for name in NODES for made in costs(name)),
        *(made for case in LOSSES for made in losses(*case)),
        *in_turn(start, START, 1 if quick else 5, started),
        *in_turn(latency, LATENCY, 1 if quick else 3, [*started, 'pmsm_observer']),
    ]


@contextmanager
def process(*words: str, domain: int) -> Iterator[subprocess.Popen]:
    """Run ``python -m`` with these words, as a process that ends with the block."""
    from estimator_pkg.ros.runtime import prepare_environment

    prepare_environment()
    where = outside()
    where['env'] |= {'ROS_DOMAIN_ID': str(domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    child = subprocess.Popen(
        [sys.executable, '-m', *words],
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        **where,
    )
    try:
        yield child
    finally:
        if child.poll() is None:
            child.send_signal(signal.SIGINT)
        try:
            child.wait(10)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


def node(name: str) -> list[str]:
    """Return the words that start one of `NODES`, or a null node."""
    if name in NULL.values():
        return ['benchmarks.roles', 'null', kind_of(name)]
    parameters = NODES[name].parameters.items()
    pairs = [word for key, value in parameters for word in ('-p', f'{key}:={value}')]
    return ['estimator_pkg.nodes.executables', executable(name), '--ros-args', *pairs]


def executable(name: str) -> str:
    """Return the name of the node's executable, which is its name in the graph."""
    return name.partition(',')[0]


def received(name: str, estimates: bool = True) -> str:
    """Return what the role `listen` receives of a node: nothing, estimates, or deviations too."""
    return str(int(estimates) + (name in NODES and NODES[name].deviation))


def kind_of(name: str) -> str:
    """Return the kind of a node's input."""
    return name.removeprefix('null_') if name in NULL.values() else NODES[name].kind


def result(child: subprocess.Popen, timeout: float = 60.0) -> dict[str, Any]:
    """Return the JSON in the last line that a role printed, after it has ended; raise UserError."""
    role = ' '.join(map(str, child.args[2:]))  # type: ignore[index]  # a list: see `process`
    try:
        output, _ = child.communicate(timeout=timeout)
        found: dict[str, Any] = json.loads(output.splitlines()[-1])
        return found
    except subprocess.TimeoutExpired as error:
        raise UserError(f'{role} did not end within {timeout:g} s: try again') from error
    except (IndexError, json.JSONDecodeError) as error:
        raise UserError(f'{role} ended without a result: try again') from error


def measure(
    names: Sequence[str],
    rate: float = 0.0,
    seconds: float = 5.0,
    size: int = 0,
    estimates: bool = True,
) -> Measured:
    """Run nodes of one kind together on one stream.

    Parameters
    ----------
    rate, size : of the messages [Hz]; 0: those of the kind. estimates : somebody receives them.

    Returns
    -------
    By node: published, answered, cpu [us per message], median_ms and late_ms (latencies), counters
    (of its diagnostics).
    """
    import psutil

    from estimator_pkg.ros.domain import free_domain

    def cpu(meter: psutil.Process) -> float:
        times = meter.cpu_times()
        return times.user + times.system

    kind, domain = kind_of(names[0]), free_domain()
    rate, size = rate or HERTZ[kind], size or SIZE[kind]
    with ExitStack() as stack:

        def start(*words: str) -> Any:
            return stack.enter_context(process(*words, domain=domain))

        meters = {name: psutil.Process(start(*node(name)).pid) for name in names}
        listeners = {
            name: start('benchmarks.roles', 'listen', executable(name), received(name, estimates))
            for name in names
        }
        for listener in listeners.values():
            listener.stdout.readline()  # it listens
        words = kind, str(rate), str(seconds + 2.0), str(size), str(len(names))
        player = start('benchmarks.roles', 'play', *words)
        player.stdout.readline()
        time.sleep(1.0)
        before, begun = {name: cpu(meter) for name, meter in meters.items()}, time.perf_counter()
        time.sleep(seconds)
        messages = rate * (time.perf_counter() - begun)
        used = {name: 1e6 * (cpu(meters[name]) - before[name]) / messages for name in names}
        published = result(player)['published']
        time.sleep(2.5)  # the diagnostics that count the last message come every second
        found = {}
        for name, listener in listeners.items():
            listener.send_signal(signal.SIGINT)
            own = result(listener)
            answered = own['answered'] / published
            used[name] /= answered or 1.0
            found[name] = {'published': published, 'cpu': used[name], **own}
        return found


def costs(name: str) -> Rows:
    """Return CPU per message [us] of one of `NODES` and of its null node, and their ratio."""
    of, null = NODES[name], NULL[NODES[name].kind]
    found = measure([name, null], seconds=10.0)
    title = f'{name}, CPU per message, {HERTZ[of.kind]:g} Hz, {SIZE[of.kind]} {of.kind}'
    for each, own in found.items():
        if not own['answered']:
            return [not_run(title, f'the listener received no answer of {each}')]
    mine, least = found[name]['cpu'], found[null]['cpu']
    return [
        row(title, mine, 'us'),
        row(f'{name}: null node at the same time', least, 'us'),
        row(f'{name} / null node', mine / least, 'times', limit=of.cost),
    ]


def losses(rate: float, joints: int) -> Rows:
    """Return the messages lost at `rate`, with the default QoS, and those not reported as lost.

    Lost are published messages that never reached the node's callback; reported is the number in
    the node's diagnostics.
    """
    name = f'lost at {rate:g} Hz, {joints} joints'
    (found,) = measure(['joint_observer'], rate, 3.0, joints, estimates=False).values()
    counters = found['counters']
    if 'messages_received' not in counters:
        return [not_run(name, 'no diagnostics of the node were received')]
    lost = found['published'] - int(counters['messages_received'])
    unreported = abs(lost - int(counters['lost_by_dds']))
    if rate <= LOSSLESS:
        return [row(name, lost, 'messages', limit=0)]
    return [
        row(name, lost, 'messages'),
        row(f'{name}, not reported', unreported, 'messages', limit=0),
    ]


def start(name: str) -> dict[str, float]:
    """Return the seconds to the node's first estimate; without one there is no key.

    An estimate is a message with a joint in it, of the null node any message.
    """
    from estimator_pkg.ros.domain import free_domain

    domain, of = free_domain(), kind_of(name)
    with ExitStack() as stack:
        rate = min(200.0, HERTZ[of])
        words = of, str(rate), str(10.0 + LONGEST), str(SIZE[of]), '0'
        player = stack.enter_context(process('benchmarks.roles', 'play', *words, domain=domain))
        listener = stack.enter_context(
            process('benchmarks.roles', 'listen', executable(name), '1', domain=domain)
        )
        output = listener.stdout
        assert output is not None and player.stdout is not None
        output.readline()
        player.stdout.readline()
        time.sleep(1.0)  # until the stream runs
        begun, found = time.time_ns(), list[str]()
        stack.enter_context(process(*node(name), domain=domain))
        reading = threading.Thread(target=lambda: found.append(output.readline()), daemon=True)
        reading.start()
        reading.join(LONGEST)
        return {'estimate': 1e-9 * (json.loads(found[0])['estimate'] - begun)} if found else {}


def latency(name: str) -> dict[str, float]:
    """Return median and 99 % of the latency of a node that has the machine to itself [ms]."""
    return measure([name])[name]


def in_turn(
    once: Callable[[str], dict[str, Any]],
    titles: dict[str, tuple[str, str]],
    rounds: int,
    subjects: Sequence[str],
) -> Rows:
    """Return for each node the medians over the rounds, and the ratio to its null node's."""
    null_of = {name: NULL[NODES[name].kind] for name in subjects}
    names = list(dict.fromkeys([*null_of.values(), *null_of]))
    found: dict[str, list[dict[str, float]]] = {name: [] for name in names}
    with progress(once.__name__, rounds * len(names)) as advance:
        for _ in range(rounds):
            for name in names:
                found[name].append(once(name))
                advance(1)
    made = []
    for name in names:
        for key, (title, unit) in titles.items():
            pairs = [
                (mine[key], null[key])
                for mine, null in zip(found[name], found[null_of.get(name, name)])
                if key in mine and key in null
            ]
            if not pairs:
                made.append(not_run(f'{name}: {title}', f'none within {LONGEST:g} s'))
                continue
            first = NODES[name].first if key == 'estimate' and name in NODES else None
            limit = first if first and math.isfinite(first) else None
            value = statistics.median(a for a, _ in pairs)
            made.append(row(f'{name}: {title}', value, unit, limit=limit))
            if name in null_of:
                ratio = statistics.median(mine / null for mine, null in pairs)
                node = NODES[name]
                most = {'late_ms': node.late, 'median_ms': node.median}.get(key)
                made.append(row(f'{name}: {title} / null node', ratio, 'times', limit=most))
    return made
