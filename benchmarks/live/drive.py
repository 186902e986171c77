# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Cost of `pmsm_observer` and latency of its estimates, on batches of 200 samples.

python -m benchmarks.live.drive          # batches
python -m benchmarks.live.drive topics   # one message per sample on current and voltage
"""

from __future__ import annotations

import json
import statistics
import sys
import threading
import time
from contextlib import ExitStack

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
from estimator_pkg.messages import drive_samples, vector3
from estimator_pkg.ros.domain import free_domain

MODULE = 'estimator_pkg.nodes.executables pmsm_observer'
FEEDER = 'benchmarks.live.drive'
ROWS = 200
EMPTY = 50  # batches without a row that are sent first
LATENCY = 2.0  # allowed median time from a batch's arrival to its estimates [ms]
CASES = ((20000.0, 0.10),)  # (sample rate [Hz], allowed fraction of a core)


def measure(rate: float, allowed: float, seconds: float = 8.0) -> dict:
    """Return the node's load of a core, and the time from a batch's arrival to its estimate.

    `leaves_ms` is the median time from sending a batch to receiving its estimate (`round_trip_ms`)
    minus that of batches without a row (`transport_ms`), which the node answers at once. `step_ms`
    is the mean that the node itself measures in its callback, interruptions included.
    """
    domain = free_domain()
    words = [word for name, value in MOTOR.items() for word in ('-p', f'{name}:={value}')]
    with ExitStack() as stack:
        node = stack.enter_context(
            process('node', domain=domain, module=MODULE, extra=('--ros-args', *words))
        )
        meter = psutil.Process(node.pid)
        feeder = stack.enter_context(
            process('node', domain=domain, module=FEEDER, extra=('feed', str(rate), str(seconds)))
        )
        assert feeder.stdout is not None
        feeder.stdout.readline()  # it has started
        before, begun = cpu(meter), time.perf_counter()
        time.sleep(0.9 * seconds)
        load = (cpu(meter) - before) / (time.perf_counter() - begun)
        answers = result(feeder)
    return {
        'rate_hz': rate,
        'load': load,
        'allowed': allowed,
        **answers,
        'ok': load <= allowed and answers['answered'] == answers['sent'],
        'in_time': answers['leaves_ms'] <= LATENCY,
    }


class Feeder(Node):
    """Publishes batches as a drive does, and records when each leaves and when its answer arrives.

    Parameters
    ----------
    rate : rate of the samples [Hz]. seconds : duration.

    Attributes
    ----------
    sent, answered : times, batch by batch [s]; the first `EMPTY` ones have no row.
    steps : the node's own mean times of a step [ms], from its diagnostics.
    """

    def __init__(self, rate: float, seconds: float) -> None:
        super().__init__('benchmark_drive')
        self.sent: list[float] = []
        self.answered: list[float] = []
        self.steps: list[float] = []
        self._period = ROWS / rate
        self._signal = simulate(
            {'publish_rate': rate, 'profile': 'ramps', 'profile_time': 1.0}, seconds
        )
        self._publisher = self.create_publisher(Float64MultiArray, 'drive_samples', 50)
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
            if status.name == '/pmsm_observer':
                mean = {item.key: item.value for item in status.values}['step_time_mean_us']
                if float(mean) > 0.0:
                    self.steps.append(1e-3 * float(mean))

    def _send(self, raw: bytes) -> None:
        self.sent.append(time.perf_counter())
        self._publisher.publish(raw)

    def _play(self) -> None:
        while not self._publisher.get_subscription_count():
            time.sleep(0.02)
        time.sleep(1.0)  # for the connection of the answers
        nothing = drive_samples.encode(np.zeros(0, np.int64), np.zeros((0, 4)))
        for _ in range(EMPTY):
            self._send(nothing)
            time.sleep(self._period)
        time.sleep(0.2)
        print('started', flush=True)
        stamps, samples = self._signal.stamps, self._signal.samples
        begun = time.perf_counter()
        stamps = stamps + (time.time_ns() - int(stamps[0]))
        for index, start in enumerate(range(0, len(stamps) - ROWS + 1, ROWS)):
            raw = drive_samples.encode(stamps[start : start + ROWS], samples[start : start + ROWS])
            wait = begun + (index + 1) * self._period - time.perf_counter()
            if wait > 0.0:
                time.sleep(wait)
            self._send(raw)
        time.sleep(1.5)
        rclpy.try_shutdown()


def feed(rate: float, seconds: float) -> None:
    """Feed a node; print the number of answered batches and their latency."""
    made: list[Feeder] = []

    def make() -> Feeder:
        made.append(Feeder(rate, seconds))
        return made[0]

    run_node(make, [])
    feeder = made[0]
    trips = [1e3 * (came - left) for left, came in zip(feeder.sent, feeder.answered)]
    transport, full = statistics.median(trips[:EMPTY]), statistics.median(trips[EMPTY:])
    print(
        json.dumps(
            {
                'sent': len(feeder.sent),
                'answered': len(feeder.answered),
                'round_trip_ms': full,
                'transport_ms': transport,
                'leaves_ms': full - transport,
                'step_ms': statistics.median(feeder.steps),
            }
        ),
        flush=True,
    )


TOPICS = (500.0, 1000.0, 2000.0, 4000.0)  # rates of separate topics [Hz]


class TopicsFeeder(Node):
    """Publishes each sample on current and voltage, and stops after `seconds`.

    Attributes
    ----------
    sent : number of samples. used : of these, samples that the node has used; from its diagnostics.
    """

    def __init__(self, rate: float, seconds: float) -> None:
        super().__init__('benchmark_drive')
        self.sent = self.used = 0
        self._rate, self._seconds = rate, seconds
        self._publishers = [
            self.create_publisher(Vector3Stamped, name, 50) for name in ('current', 'voltage')
        ]
        self.create_subscription(DiagnosticArray, '/diagnostics', self._diagnosed, 10)
        threading.Thread(target=self._play, daemon=True).start()

    def _diagnosed(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == '/pmsm_observer: motor':
                self.used = int({item.key: item.value for item in status.values}['used'])

    def _play(self) -> None:
        signal = simulate(
            {'publish_rate': self._rate, 'profile': 'ramps', 'profile_time': 1.0}, self._seconds
        )
        while not all(each.get_subscription_count() for each in self._publishers):
            time.sleep(0.02)
        time.sleep(1.0)
        print('started', flush=True)
        begun, first = time.perf_counter(), time.time_ns() - int(signal.stamps[0])
        for stamp, sample in zip((signal.stamps + first).tolist(), signal.samples.tolist()):
            wait = begun + self.sent / self._rate - time.perf_counter()
            if wait > 0.0:
                time.sleep(wait)
            for k, publisher in enumerate(self._publishers):
                publisher.publish(vector3.encode(stamp, '', sample[2 * k], sample[2 * k + 1]))
            self.sent += 1
        time.sleep(2.5)
        rclpy.try_shutdown()


def feed_topics(rate: float, seconds: float) -> None:
    """Feed a node with separate topics; print the numbers of sent and used samples."""
    made: list[TopicsFeeder] = []

    def make() -> TopicsFeeder:
        made.append(TopicsFeeder(rate, seconds))
        return made[0]

    run_node(make, [])
    print(json.dumps({'sent': made[0].sent, 'used': made[0].used}), flush=True)


def measure_topics(rate: float, seconds: float = 8.0) -> dict:
    """Return the node's load of a core and the used samples, with separate topics."""
    domain = free_domain()
    words = [word for name, value in MOTOR.items() for word in ('-p', f'{name}:={value}')]
    words += ['-p', 'input:=current_voltage']
    with ExitStack() as stack:
        node = stack.enter_context(
            process('node', domain=domain, module=MODULE, extra=('--ros-args', *words))
        )
        meter = psutil.Process(node.pid)
        arguments = ('feed_topics', str(rate), str(seconds))
        feeder = stack.enter_context(process('node', domain=domain, module=FEEDER, extra=arguments))
        assert feeder.stdout is not None
        feeder.stdout.readline()  # it has started
        before, begun = cpu(meter), time.perf_counter()
        time.sleep(0.9 * seconds)
        load = (cpu(meter) - before) / (time.perf_counter() - begun)
        return {'rate_hz': rate, 'load': load, **result(feeder)}


if __name__ == '__main__':
    if sys.argv[1:2] == ['feed']:
        feed(float(sys.argv[2]), float(sys.argv[3]))
    elif sys.argv[1:2] == ['feed_topics']:
        feed_topics(float(sys.argv[2]), float(sys.argv[3]))
    elif sys.argv[1:2] == ['topics']:
        print(json.dumps([measure_topics(rate) for rate in TOPICS], indent=2))
    else:
        print(json.dumps([measure(*case) for case in CASES], indent=2))
