# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The same messages through the real node over real DDS and through replay."""

import math
import shlex
from collections import Counter

import dds
import pytest

from estimator_pkg import cli
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.messages.joint_state import Decoder, Encoder

MODULE = 'estimator_pkg.nodes.executables joint_observer'
FAULTS = [
    'noise=0.0005',
    'sampling_jitter=0.0004',
    'dropped=0.02',
    'repeated=0.02',
    'duplicated=0.02',
    'outliers=0.002',
    'outlier_size=3.13',
    'gap_every=0.7',
    'gap_length=0.25',
    'burst_every=0.9',
    'eccentricity=0.002',
]
PARAMETERS = """/**:
  ros__parameters:
    observer: hybrid_angle
    quantum: 0.0015339
    per_joint.b: {bandwidth_hz: 100, unwrap: true}
"""


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    """A bag of two joints with every fault, and with what no simulator makes behind it."""
    from estimator_pkg.bags.writer import BagWriter

    path = tmp_path_factory.mktemp('bags')
    faults = [word for fault in FAULTS for word in ('--set', fault)]
    assert (
        cli.main(
            [
                'simulate',
                'encoder',
                '--out',
                str(path / 'made'),
                *shlex.split('--duration 2 --seed 5'),
                '--set',
                'joints=[a, b]',
                *faults,
            ]
        )
        == 0
    )
    with open_bag(path / 'made') as bag, BagWriter(path / 'bag') as writer:
        writer.add_topic('/joint_states', 'sensor_msgs/msg/JointState')
        raws = []
        for message in bag.messages(['/joint_states']):
            raws.append((message.log_ns, bytes(message.raw)))
        last, raw = raws[-1]
        raws += [(last + i * 1_000_000, odd) for i, odd in enumerate(odd_messages(raw), 1)]
        for log_ns, raw in raws:
            writer.write('/joint_states', log_ns, raw)
    return path / 'bag', [raw for _, raw in raws]


def odd_messages(raw):
    """Bad values and stamps, joints that come and go, a clock that jumps back."""
    stamp, encode = Decoder().decode(raw).stamp_ns, Encoder().encode

    def at(milliseconds, names, positions):
        return encode(stamp + milliseconds * 1_000_000, 'tool', names, positions)

    yield from (
        at(1, ['a', 'b'], [math.nan, 1.0]),
        at(2, ['b', 'a'], [1.0, math.inf]),
        at(2, ['a', 'b'], [1.0, 1.0]),
        at(1, ['a', 'b'], [1.0, 1.0]),
        at(3, [], []),
        at(3, ['a', 'b'], [1.0]),
        encode(0, '', ['a'], [1.0]),
        at(10**9, ['a'], [1.0]),
        at(4, ['a'], [1.001]),
    )
    for i in range(300):
        yield at(5 + i, ['c', 'a'], [0.001 * i, 1.0 + 0.002 * i])
    for i in range(300):  # the bag loops
        yield at(i - 5000, ['b'], [0.003 * i])


def test_replay_equals_the_live_node(recording, probe, tmp_path):
    bag, raws = recording
    file, out = tmp_path / 'params.yaml', tmp_path / 'out'
    file.write_text(PARAMETERS)
    assert cli.main(['replay', str(bag), '--params', str(file), '--out', str(out)]) == 0
    with open_bag(out) as replayed:
        estimates, deviations = (
            [(message.log_ns, bytes(message.raw)) for message in replayed.messages([topic])]
            for topic in ('/joint_observer/estimate', '/joint_observer/estimate_stddev')
        )
        answers, unanswered = Counter(log_ns for log_ns, _ in estimates), set()
        for k, message in enumerate(replayed.messages(['/joint_states'])):
            if answers[message.log_ns]:
                answers[message.log_ns] -= 1
            else:
                unanswered.add(k)
    live = run_live(file, raws, unanswered, probe)
    assert live == ([raw for _, raw in estimates], [raw for _, raw in deviations])
    assert len(estimates) > len(raws) // 2  # there was something to compare


def run_live(file, raws, unanswered, probe):
    """The bytes that the node answered to each message: estimates, standard deviations."""
    from sensor_msgs.msg import JointState

    deviations = []
    with dds.NodeProcess(MODULE, *dds.ros_args(file=file)) as process, dds.Observer(probe) as live:
        listener = probe.node.create_subscription(
            JointState, '/joint_observer/estimate_stddev', deviations.append, 1000, raw=True
        )
        try:
            live.connect()
            probe.until(listener.get_publisher_count)
            probe.spin(0.3)
            live.feed(raws, unanswered)
            probe.until(lambda: len(deviations) >= len(live.answers))
        finally:
            probe.node.destroy_subscription(listener)
    assert 'Traceback' not in process.output
    return live.raw_answers, deviations
