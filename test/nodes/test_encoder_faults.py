# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Faults of an encoder, live: named in ~/status and on the terminal, covered by the deviation."""

import dds
import numpy as np
from sensor_msgs.msg import JointState

from estimator_pkg.messages.joint_state import Decoder

MODULE = 'estimator_pkg.nodes.executables joint_observer'
QUANTUM = 2.0 * np.pi / 4096
COUNT, ONSET, SPEED = 1500, 1200, 10.3  # SPEED: counts per sample of 2 ms
NAMED = {
    'fine': '',
    'shaken': 'a reading of 0 rad was ',
    'slipped': 'the reading jumped by 0.76',
    'frozen': 'the readings stopped at 7.',
}


def readings():
    """Return the angles of a joint without a fault and of three with one, shape (COUNT, 4)."""
    counts = np.floor(100.0 + SPEED * np.arange(COUNT)[:, None] + np.zeros(len(NAMED)))
    counts[ONSET, 1] = 0
    counts[ONSET:, 2] += 500
    counts[ONSET:, 3] = counts[ONSET - 1, 3]
    return (counts % 4096) * QUANTUM


def test_each_fault_is_named_and_covered(probe):
    words = dds.ros_args('timeout:=60.0', remap=('__ns:=/e', '__node:=o'))  # notes are kept
    deviations, decode = [], Decoder().decode
    with (
        dds.NodeProcess(MODULE, *words) as process,
        dds.Observer(probe, '/e/o', '/e/joint_states') as live,
    ):
        wide = probe.node.create_subscription(
            JointState,
            '/e/o/estimate_stddev',
            lambda raw: deviations.append(decode(raw)),
            1000,
            raw=True,
        )
        live.connect()
        probe.until(wide.get_publisher_count)
        answers = live.feed(
            live.encode(10**18 + 2_000_000 * k, [*NAMED], row.tolist())
            for k, row in enumerate(readings())
        )
        probe.until(lambda: len(deviations) >= len(answers))
        for text in filter(None, NAMED.values()):
            process.prints(text)
        probe.until(
            lambda: all(NAMED[name] in live.statuses[name].message for name in NAMED),
            lambda: live.statuses,
        )
        for name in ('shaken', 'slipped'):
            process.prints(f"the sensor of '{name}' on /e/joint_states may be faulty: ")
    assert "'fine'" not in process.output
    truth = SPEED * QUANTUM / 2e-3
    for answer, deviation in zip(answers[ONSET:], deviations[ONSET:]):
        off = np.abs(np.array(answer.velocities) - truth)
        assert np.all(off <= 3.0 * np.array(deviation.velocities)), off
