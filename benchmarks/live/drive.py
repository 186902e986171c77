# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Load of `pmsm_observer`, and latency of its estimates.

The samples come in batches of 200, or one a message on current and voltage.
"""

from __future__ import annotations

import json
import statistics
import sys
import threading
import time
from contextlib import ExitStack
from typing import Any

from estimator_pkg.ros.runtime import run as run_node  # first: rclpy reads it  # isort: skip

import numpy as np
import psutil
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3Stamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from benchmarks.drive import MOTOR, simulate
from benchmarks.live.processes import cpu, process, result
from benchmarks.timing import not_run, row
from estimator_pkg.messages import drive_samples, vector3
from estimator_pkg.ros.domain import free_domain

MODULE = 'estimator_pkg.nodes.executables pmsm_observer'
BATCHES, TOPICS = 'batches', 'topics'
ROWS = 200
LATENCY = 2.0  # allowed median time from sending a batch to receiving its estimate [ms]
LOAD = 0.10  # allowed fraction of a core
RATE = 20000.0  # of samples in batches [Hz]
RATES = (500.0, 1000.0, 2000.0, 4000.0)  # of separate topics [Hz]


def rows() -> list[dict[str, Any]]:
    """Return load, unused samples and latency with batches, then load and unused with topics."""
    found, what = [], 'sent to estimate received'
    for kind, rate in ((BATCHES, RATE), *((TOPICS, each) for each in RATES)):
        made, batched = measure(kind, rate), kind == BATCHES
        at = f'pmsm_observer at {rate:g} Hz {"in batches" if batched else "on two topics"}'
        load, unused = made['load'], made['samples'] - made['used']
        found.append(row(f'{at}: load of a core', load, '', limit=LOAD if batched else None))
        found.append(row(f'{at}: samples not used', unused, '', limit=0 if batched else None))
        if batched and 'round_trip_ms' in made:
            late = made['round_trip_ms']
            found.append(row(f'{at}: {what}, median', late, 'ms', limit=LATENCY))
        elif batched:
            found.append(not_run(f'{at}: {what}', 'no batch was answered'))
    return found


def measure(kind: str, rate: float, seconds: float = 8.0) -> dict:
    """Return the node's load of a core, and the numbers of samples sent and used.

    With batches also `round_trip_ms`: the median time from sending one to receiving its estimate.
    """
    domain = free_domain()
    words = [word for name, value in MOTOR.items() for word in ('-p', f'{name}:={value}')]
    if kind == TOPICS:
        words += ['-p', 'input:=current_voltage']
    with ExitStack() as stack:

        def start(module: str, *extra: str):
            return stack.enter_context(process('node', domain=domain, module=module, extra=extra))

        meter = psutil.Process(start(MODULE, '--ros-args', *words).pid)
        feeder = start(__name__, kind, str(rate), str(seconds))
        feeder.stdout.readline()  # it has started
        before, begun = cpu(meter), time.perf_counter()
        time.sleep(0.9 * seconds)
        load = (cpu(meter) - before) / (time.perf_counter() - begun)
        return {'load': load, **result(feeder)}


class Feeder(Node):
    """Publishes as a drive does, and records when each batch leaves and when its answer arrives.

    Parameters
    ----------
    kind : BATCHES or TOPICS. rate : rate of the samples [Hz]. seconds : duration.

    Attributes
    ----------
    sent, answered : times, batch by batch [s].
    samples : number of samples sent. used : of these, samples that the node has used.
    """

    def __init__(self, kind: str, rate: float, seconds: float) -> None:
        super().__init__('benchmark_drive')
        self.sent: list[float] = []
        self.answered: list[float] = []
        self.samples = self.used = 0
        self._rate, self._rows = rate, ROWS if kind == BATCHES else 1
        self._signal = simulate(
            {'publish_rate': rate, 'profile': 'ramps', 'profile_time': 1.0}, seconds
        )
        names = ('current', 'voltage')
        if kind == BATCHES:
            self._outputs = [self.create_publisher(Float64MultiArray, 'drive_samples', 50)]
        else:
            self._outputs = [self.create_publisher(Vector3Stamped, name, 50) for name in names]
        self.create_subscription(
            JointState,
            '/pmsm_observer/estimate',
            lambda raw: self.answered.append(time.perf_counter()),
            500,
            raw=True,
        )
        self.create_subscription(DiagnosticArray, '/diagnostics', self._diagnosed, 10)
        threading.Thread(target=self._play, daemon=True).start()

    def _diagnosed(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == '/pmsm_observer: motor':
                self.used = int({item.key: item.value for item in status.values}['used'])

    def _send(self, stamps: np.ndarray, samples: np.ndarray) -> None:
        self.samples += len(stamps)
        if self._rows == 1:
            (stamp,), (sample,) = stamps.tolist(), samples.tolist()
            for k, output in enumerate(self._outputs):
                output.publish(vector3.encode(stamp, '', sample[2 * k], sample[2 * k + 1]))
            return
        raw = drive_samples.encode(stamps, samples)
        self.sent.append(time.perf_counter())
        self._outputs[0].publish(raw)

    def _play(self) -> None:
        while not all(each.get_subscription_count() for each in self._outputs):
            time.sleep(0.02)
        stamps, samples = self._signal.stamps, self._signal.samples
        stamps = stamps + (time.time_ns() - int(stamps[0]))
        at, count = 0, self._rows
        while count > 1 and not self.answered and at < 500:  # until the answers are connected
            self._send(stamps[at : at + 1], samples[at : at + 1])
            time.sleep(count / self._rate)
            at += 1
        time.sleep(1.0)
        self.sent.clear()
        self.answered.clear()
        print('started', flush=True)
        begun = time.perf_counter()
        for number, start in enumerate(range(at, len(stamps) - count + 1, count), 1):
            wait = begun + number * count / self._rate - time.perf_counter()
            if wait > 0.0:
                time.sleep(wait)
            self._send(stamps[start : start + count], samples[start : start + count])
        time.sleep(2.5)
        rclpy.try_shutdown()


def feed(kind: str, rate: float, seconds: float) -> None:
    """Feed a node; print the numbers of samples and the latency of batches."""
    made: list[Feeder] = []

    def make() -> Feeder:
        made.append(Feeder(kind, rate, seconds))
        return made[0]

    run_node(make, [])
    feeder = made[0]
    found: dict[str, float] = {'samples': feeder.samples, 'used': feeder.used}
    trips = [1e3 * (came - left) for left, came in zip(feeder.sent, feeder.answered)]
    if trips:
        found['round_trip_ms'] = statistics.median(trips)
    print(json.dumps(found), flush=True)


if __name__ == '__main__':
    feed(sys.argv[1], float(sys.argv[2]), float(sys.argv[3]))
