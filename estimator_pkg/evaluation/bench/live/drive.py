"""What `pmsm_observer` costs and how late its estimates are, on batches of 200 samples.

    python -m estimator_pkg.evaluation.bench.live.drive
"""

from __future__ import annotations

import json
import statistics
import sys
import time
from contextlib import ExitStack

import numpy as np
import psutil

from estimator_pkg.evaluation.bench.drive import MOTOR, RATE, simulate
from estimator_pkg.evaluation.bench.live.processes import (
    cpu,
    process,
    result,
)
from estimator_pkg.nodes.domain import free_domain
from estimator_pkg.nodes.runtime import run as run_node

MODULE = 'estimator_pkg.nodes.pmsm_observer'
FEEDER = 'estimator_pkg.evaluation.bench.live.drive'
ROWS = 200
EMPTY = 50     # batches without a row that are sent first
LATENCY = 2.0  # [ms] from a batch's arrival to its estimates, at the median
# (sample rate [Hz], compiled, part of a core that it may take)
CASES = ((20000.0, True, 0.10), (5000.0, False, 0.20), (20000.0, False, 0.45))


def measure(rate: float, fast: bool, allowed: float, seconds: float = 8.0) -> dict:
    """Load of the node on one core, and how long after a batch's arrival its estimate leaves.

    `leaves_ms` is the median time from sending a batch to having its estimate (`round_trip_ms`)
    less that of batches without a row (`transport_ms`), which the node answers at once. `step_ms`
    is the mean that the node itself measures in its callback, with whatever interrupts it.
    """
    domain = free_domain()
    values = {**MOTOR, 'compile': fast}
    extra = ['--ros-args']
    for name, value in values.items():
        extra += ['-p', f'{name}:={str(value).lower()}']
    with ExitStack() as stack:
        node = stack.enter_context(process('node', domain=domain, extra=tuple(extra),
                                           module=MODULE))
        meter = psutil.Process(node.pid)
        feeder = stack.enter_context(process('node', domain=domain, module=FEEDER,
                                             extra=('feed', str(rate), str(seconds))))
        assert feeder.stdout is not None
        feeder.stdout.readline()  # it has begun
        before, begun = cpu(meter), time.perf_counter()
        time.sleep(0.9 * seconds)
        load = (cpu(meter) - before) / (time.perf_counter() - begun)
        said = result(feeder)
    return {'rate_hz': rate, 'compiled': fast, 'load': load, 'allowed': allowed, **said,
            'ok': load <= allowed and said['answered'] == said['sent'],
            'in_time': said['leaves_ms'] <= LATENCY}



def feed(rate: float, seconds: float) -> None:
    """Publishes batches as a drive would; ends with how many were answered and how soon."""
    begun_at: list[float] = []
    trips: list[float] = []
    steps: list[float] = []

    def make():
        import threading

        import rclpy
        from diagnostic_msgs.msg import DiagnosticArray
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Float64MultiArray

        from estimator_pkg.messages import drive_samples

        node = rclpy.create_node('benchmark_drive')
        publisher = node.create_publisher(Float64MultiArray, 'drive_samples', 50)

        def answered(raw: bytes) -> None:
            trips.append(time.perf_counter() - begun_at[len(trips)])

        def diagnosed(message: DiagnosticArray) -> None:
            for status in message.status:
                if status.name == '/pmsm_observer':
                    mean = {item.key: item.value for item in status.values}['step_time_mean_us']
                    if float(mean) > 0.0:
                        steps.append(1e-3 * float(mean))

        node.create_subscription(JointState, '/pmsm_observer/estimate', answered, 500, raw=True)
        node.create_subscription(DiagnosticArray, '/diagnostics', diagnosed, 10)
        every = round(RATE / rate)
        signal = simulate({'publish_rate': rate, 'profile': 'ramps',
                                       'profile_time': 1.0}, seconds)
        assert every >= 1

        def play() -> None:
            while not publisher.get_subscription_count():
                time.sleep(0.02)
            time.sleep(1.0)  # for the connection of the answers
            nothing = drive_samples.encode(np.zeros(0, np.int64), np.zeros((0, 4)))
            for _ in range(EMPTY):
                begun_at.append(time.perf_counter())
                publisher.publish(nothing)
                time.sleep(ROWS / rate)
            time.sleep(0.2)
            print('started', flush=True)
            begun, begun_ns = time.perf_counter(), time.time_ns()
            shift = begun_ns - int(signal.stamps[0])
            for index, start in enumerate(range(0, len(signal.stamps) - ROWS + 1, ROWS)):
                raw = drive_samples.encode(signal.stamps[start:start + ROWS] + shift,
                                           signal.samples[start:start + ROWS])
                wait = begun + (index + 1) * ROWS / rate - time.perf_counter()
                if wait > 0.0:
                    time.sleep(wait)
                begun_at.append(time.perf_counter())
                publisher.publish(raw)
            time.sleep(1.5)
            rclpy.try_shutdown()

        threading.Thread(target=play, daemon=True).start()
        return node

    run_node(make, [])
    transport, full = (1e3 * statistics.median(part) for part in (trips[:EMPTY], trips[EMPTY:]))
    print(json.dumps({'sent': len(begun_at), 'answered': len(trips), 'round_trip_ms': full,
                      'transport_ms': transport, 'leaves_ms': full - transport,
                      'step_ms': statistics.median(steps)}), flush=True)


if __name__ == '__main__':
    if sys.argv[1:2] == ['feed']:
        feed(float(sys.argv[2]), float(sys.argv[3]))
    else:
        print(json.dumps([measure(*case) for case in CASES], indent=2))
