# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The nodes pmsm_observer and pmsm_sim in processes of their own, over real DDS."""

import shlex
import time
from pathlib import Path

import dds
import numpy as np
import pytest
from answers import estimated

from estimator_pkg.bags.reader import open_bag
from estimator_pkg.messages import drive_samples
from estimator_pkg.messages.joint_state import Decoder
from sim_pkg.pmsm.simulator import SIMULATOR, PmsmSimulatorParameters

OBSERVER = 'estimator_pkg.nodes.executables pmsm_observer'
SIMULATION = 'sim_pkg.nodes.executables pmsm_sim'
PARAMS = Path(__file__).resolve().parents[2] / 'config' / 'pmsm_observer.yaml'
BEGIN = 1_700_000_000_000_000_000  # [ns]


def node(name):
    """pmsm_observer under a name and topics of its own."""
    remap = f'__node:={name}', f'drive_samples:=/{name}/samples'
    return dds.NodeProcess(OBSERVER, *dds.ros_args(remap=remap, file=PARAMS))


class Drive:
    """A running pmsm_observer as a test sees it."""

    def __init__(self, probe, name):
        from diagnostic_msgs.msg import DiagnosticArray
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Float64MultiArray

        self.probe = probe
        self.estimates, self.samples, self.status = [], [], None
        hear, self._decode = probe.node.create_subscription, Decoder().decode
        self.publisher = probe.node.create_publisher(Float64MultiArray, f'/{name}/samples', 100)
        self.subscriptions = [
            hear(JointState, f'/{name}/estimate', self._estimated, 1000, raw=True),
            hear(DiagnosticArray, f'/{name}/status', self._said, dds.latched()),
            hear(Float64MultiArray, f'/{name}/estimate_samples', self._sampled, 1000, raw=True),
        ]

    def _estimated(self, raw):
        self.estimates.append(self._decode(raw))

    def _sampled(self, raw):
        self.samples.append(drive_samples.decode(raw))

    def _said(self, message):
        self.status = message.status[0]

    def __enter__(self):
        self.probe.until(
            lambda: (
                self.publisher.get_subscription_count()
                and all(s.get_publisher_count() for s in self.subscriptions)
            )
        )
        self.probe.spin(0.5)  # both sides of every connection
        return self

    def __exit__(self, *error):
        for each in self.subscriptions:
            self.probe.node.destroy_subscription(each)
        self.probe.node.destroy_publisher(self.publisher)

    def feed(self, found):
        """Publish batches, a few ahead of the node at most."""
        due = len(self.estimates)
        for count, batch in enumerate(found):
            self.publisher.publish(drive_samples.encode(batch.stamps_ns, batch.values))
            self.probe.executor.spin_once(timeout_sec=0.0)
            self.probe.until(lambda at=due + count - 3: len(self.estimates) >= at)
        self.probe.until(lambda: len(self.estimates) >= due + len(found))

    def says(self, text):
        self.probe.until(lambda: self.status is not None and text in self.status.message)


def batches():
    """Half a second of batches of a 5 kHz drive, as decoded."""
    parameters = PmsmSimulatorParameters(
        publish_rate=5000.0, batch=50, current_noise=0.05, profile='constant'
    )
    return [
        drive_samples.decode(message.encode(BEGIN))
        for chunk in SIMULATOR.generate(parameters, 0.5, 1)
        for message in chunk
        if message.topic == 'drive_samples'
    ]


@pytest.mark.parametrize('seconds', [2.0, pytest.param(10.0, marks=pytest.mark.slow)])
def test_nothing_is_lost_at_20_khz_and_the_estimates_are_right(seconds, probe, tmp_path):
    """The real simulator, recorded."""
    topics = (
        'drive_samples',
        'ground_truth/samples',
        'ground_truth/joint_states',
        'ground_truth/flux_linkage',
        'pmsm_observer/estimate',
        'pmsm_observer/estimate_samples',
    )
    out = tmp_path / 'bag'
    with (
        dds.NodeProcess(OBSERVER, '--ros-args', '--params-file', str(PARAMS)) as observer,
        dds.NodeProcess('estimator_pkg.cli', 'record', *topics, '--out', str(out)) as record,
    ):
        observer.prints("estimates 'motor'")
        record.prints('recording /pmsm_observer/estimate_samples')
        with dds.NodeProcess(
            SIMULATION,
            *dds.ros_args(
                f'duration:={seconds}',
                'wait_for_subscribers:=2',
                'wait_for_truth_subscribers:=1',
                'current_noise:=0.1',
                'profile:=ramps',
                'profile_time:=1.0',
            ),
        ) as simulator:
            assert simulator.ends() == 0, simulator.output
        assert 'messages, ' in simulator.output
        time.sleep(0.5)
        record.signal(2)
        assert record.ends() == 0, record.output
    with open_bag(out) as bag:
        count = round(seconds * 100)
        assert {bag.topics[f'/{topic}'].count for topic in topics} == {count}  # nothing lost
        found, true = (
            [drive_samples.decode(bytes(message.raw)) for message in bag.messages([topic])]
            for topic in ('/pmsm_observer/estimate_samples', '/ground_truth/samples')
        )
    stamps = np.concatenate([batch.stamps_ns for batch in found])
    assert np.array_equal(stamps, np.concatenate([batch.stamps_ns for batch in true]))
    assert set(np.diff(stamps)) == {50_000}
    reported = np.concatenate([batch.values for batch in found])
    truth = np.concatenate([batch.values for batch in true])
    late = stamps - stamps[0] >= 100_000_000  # converged within 100 ms of simulated time
    assert reported[late, 3].all()
    angle = np.angle(np.exp(1j * (reported[late, 0] - truth[late, 0])))
    assert np.abs(np.degrees(angle)).max() < 2.0
    speed = (reported[late, 1] - truth[late, 1]) / truth[late, 1]
    assert np.abs(speed).max() < 0.03
    assert np.abs(reported[late, 2] / 1.9e-3 - 1.0).max() < 0.02


def test_gains_change_live_and_reset_starts_again(probe):
    from rcl_interfaces.srv import SetParametersAtomically
    from rclpy.parameter import Parameter
    from std_srvs.srv import Trigger

    def change(**values):
        request = SetParametersAtomically.Request()
        request.parameters = [
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
        ]
        return probe.call(
            SetParametersAtomically, '/pmsm_live/set_parameters_atomically', request
        ).result

    measured = batches()
    with node('pmsm_live'), Drive(probe, 'pmsm_live') as drive:
        drive.feed(measured[:20])
        assert estimated(drive.estimates[-1])
        assert change(speed_filter_hz=50, relative_bandwidth=0.1).successful
        drive.feed(measured[20:22])
        assert estimated(drive.estimates[-1])  # the state was kept
        for values, said in (
            ({'resistance': 0.1}, 'read-only'),
            ({'epsilon': 0.05}, 'too slow'),
            ({'speed_filter_hz': -1.0}, 'outside'),
            ({'clock_rate': 5000.0}, 'too fast'),
            ({'speed_max': 5000.0}, 'half an electrical turn'),
        ):
            refused = change(**values)
            assert not refused.successful and said in refused.reason, refused.reason
        assert probe.call(Trigger, '/pmsm_live/reset', Trigger.Request()).success
        drive.feed(measured[22:23])
        assert not estimated(drive.estimates[-1])
        drive.feed(measured[23:])
        assert estimated(drive.estimates[-1])


def test_a_change_while_20_khz_stream_loses_nothing(probe):
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter

    with node('pmsm_changed') as observer, Drive(probe, 'pmsm_changed') as drive:
        observer.prints("estimates 'motor'")
        with dds.NodeProcess(
            SIMULATION,
            *shlex.split(
                '--ros-args -p duration:=2.0 -p wait_for_subscribers:=1 -p '
                'profile:=constant -r drive_samples:=/pmsm_changed/samples'
            ),
        ) as simulator:
            for count, (name, value) in enumerate(
                (('speed_filter_hz', 200.0), ('epsilon', 1e-4), ('dead_time_voltage', 0.0))
            ):
                probe.until(lambda at=30 + 40 * count: len(drive.estimates) >= at)
                request = SetParameters.Request(
                    parameters=[Parameter(name, value=value).to_parameter_msg()]
                )
                reply = probe.call(SetParameters, '/pmsm_changed/set_parameters', request)
                assert reply.results[0].successful
            drive.says('tracking')  # half a second after the last batch it is lost
            assert simulator.ends() == 0, simulator.output
        probe.until(lambda: len(drive.estimates) >= 200)
    assert len(drive.estimates) == 200
    assert all(map(estimated, drive.estimates[20:]))
    stamps = np.concatenate([batch.stamps_ns for batch in drive.samples])
    assert set(np.diff(stamps)) == {50_000}
