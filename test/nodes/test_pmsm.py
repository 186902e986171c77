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

from estimator_pkg import cli
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.messages import drive_samples, vector3
from estimator_pkg.messages.joint_state import Decoder
from estimator_pkg.streams.drive import DriveStream
from sim_pkg.pmsm.simulator import SIMULATOR, PmsmSimulatorParameters

OBSERVER = 'estimator_pkg.nodes.executables pmsm_observer'
SIMULATION = 'sim_pkg.nodes.executables pmsm_sim'
PARAMS = Path(__file__).resolve().parents[2] / 'config' / 'pmsm_observer.yaml'
BEGIN = 1_700_000_000_000_000_000  # [ns]
MOTOR = {'resistance': 0.06, 'inductance': 33.75e-6, 'flux': 1.9e-3, 'pole_pairs': 7}


def node(name, *, params=PARAMS, **values):
    """pmsm_observer under a name and topics of its own."""
    remap = (
        f'__node:={name}',
        f'drive_samples:=/{name}/samples',
        f'current:=/{name}/current',
        f'voltage:=/{name}/voltage',
    )
    return dds.NodeProcess(
        OBSERVER,
        *dds.ros_args(
            *(
                f'{key}:={str(value).lower() if isinstance(value, bool) else value}'
                for key, value in values.items()
            ),
            remap=remap,
            file=params,
        ),
    )


class Drive:
    """A running pmsm_observer as a test sees it."""

    def __init__(self, probe, name, vectors=False):
        from diagnostic_msgs.msg import DiagnosticArray
        from geometry_msgs.msg import Vector3Stamped
        from rclpy.qos import DurabilityPolicy, QoSProfile
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Float64MultiArray

        self.probe, self.name = probe, f'/{name}'
        self.estimates, self.samples, self.status = [], [], None
        self.raw_estimates, self.raw_samples = [], []
        make, hear = probe.node.create_publisher, probe.node.create_subscription
        self._decode = Decoder().decode
        if vectors:
            self.publishers = [
                make(Vector3Stamped, f'/{name}/{each}', 100) for each in ('current', 'voltage')
            ]
        else:
            self.publishers = [make(Float64MultiArray, f'/{name}/samples', 100)]
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.subscriptions = [
            hear(JointState, f'/{name}/estimate', self._estimated, 1000, raw=True),
            hear(DiagnosticArray, f'/{name}/status', self._said, latched),
        ]
        if not vectors:
            self.subscriptions.append(
                hear(Float64MultiArray, f'/{name}/estimate_samples', self._sampled, 1000, raw=True)
            )

    def _estimated(self, raw):
        self.raw_estimates.append(raw)
        self.estimates.append(self._decode(raw))

    def _sampled(self, raw):
        self.raw_samples.append(raw)
        self.samples.append(drive_samples.decode(raw))

    def _said(self, message):
        self.status = message.status[0]

    def __enter__(self):
        self.probe.until(
            lambda: (
                all(p.get_subscription_count() for p in self.publishers)
                and all(s.get_publisher_count() for s in self.subscriptions)
            )
        )
        self.probe.spin(0.5)  # both sides of every connection
        return self

    def __exit__(self, *error):
        for each in self.subscriptions:
            self.probe.node.destroy_subscription(each)
        for each in self.publishers:
            self.probe.node.destroy_publisher(each)

    def feed(self, messages, *, answered=True, unused=0):
        """Publish (which publisher, bytes), a few ahead of the node at most.

        Parameters
        ----------
        unused : how many of them are not answered, because no sample of them is used.
        """
        due = len(self.estimates) - unused
        for count, (which, raw) in enumerate(messages):
            self.publishers[which].publish(raw)
            self.probe.executor.spin_once(timeout_sec=0.0)
            if answered is True:
                self.probe.until(lambda at=due + count - 3: len(self.estimates) >= at)
        if answered is True:
            self.probe.until(lambda: len(self.estimates) >= due + count + 1)

    def values(self):
        return {item.key: item.value for item in self.status.values}

    def says(self, text):
        self.probe.until(lambda: self.status is not None and text in self.status.message)


def batches(duration=0.3, begin=BEGIN, **values):
    """Batches of a 5 kHz drive; (measurement, truth) as decoded."""
    parameters = PmsmSimulatorParameters(
        **{'publish_rate': 5000.0, 'batch': 50, 'current_noise': 0.05, **values}
    )
    measured, true = [], []
    for chunk in SIMULATOR.generate(parameters, duration, 1):
        for message in chunk:
            if message.topic == 'drive_samples':
                measured.append(drive_samples.decode(message.encode(begin)))
            elif message.topic == 'ground_truth/samples':
                true.append(drive_samples.decode(message.encode(begin)))
    return measured, true


def encoded(found):
    return [(0, drive_samples.encode(batch.stamps_ns, batch.values)) for batch in found]


def test_live_recorded_replayed_the_same_and_truthful(probe, tmp_path):
    """The real simulator at 20 kHz; `record` beside it; replay of the bag identical."""
    live_equals_replay(tmp_path, 2.0, probe)


@pytest.mark.slow
def test_ten_seconds_at_20_khz_without_loss(probe, tmp_path):
    live_equals_replay(tmp_path, 10.0, probe)


def live_equals_replay(tmp_path, seconds, probe):
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
            '--ros-args',
            '-p',
            f'duration:={seconds}',
            '-p',
            'wait_for_subscribers:=2',
            '-p',
            'wait_for_truth_subscribers:=1',
            '-p',
            'current_noise:=0.1',
            '-p',
            'profile:=ramps',
            '-p',
            'profile_time:=1.0',
        ) as simulator:
            assert simulator.ends() == 0, simulator.output
        assert 'messages, ' in simulator.output
        time.sleep(0.5)
        record.signal(2)
        assert record.ends() == 0, record.output
    with open_bag(out) as bag:
        count = round(seconds * 100)
        assert {bag.topics[f'/{topic}'].count for topic in topics} == {count}  # nothing lost
        recorded = {
            topic: [bytes(m.raw) for m in bag.messages([topic])]
            for topic in ('/pmsm_observer/estimate', '/pmsm_observer/estimate_samples')
        }
        true = [drive_samples.decode(bytes(m.raw)) for m in bag.messages(['/ground_truth/samples'])]
    found = [drive_samples.decode(raw) for raw in recorded['/pmsm_observer/estimate_samples']]
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
    assert (
        cli.main(['replay', str(out), '--params', str(PARAMS), '--out', str(tmp_path / 'again')])
        == 0
    )
    with open_bag(tmp_path / 'again') as bag:
        for topic, raws in recorded.items():
            assert [bytes(m.raw) for m in bag.messages([topic])] == raws, topic


def test_lost_repeated_and_late_batches_bad_rows_and_another_layout(probe):
    measured, true = batches(0.5, profile='constant', speed_rpm=3000.0)
    names = encoded(measured)
    bad = measured[20].values.copy()
    bad[3, 1] = np.nan
    names[20] = (0, drive_samples.encode(measured[20].stamps_ns, bad))
    order = [*range(26), 28, 27, 28, *range(29, 35), *range(38, 50)]  # 26 is lost, 35 to 37 too
    with node('pmsm_faults') as process, Drive(probe, 'pmsm_faults') as drive:
        drive.feed([names[index] for index in order], unused=2)
        drive.publishers[0].publish(names[49][1].replace(b'channel', b'columns'))
        drive.probe.spin(0.3)  # a wrong answer to it would come now
        drive.says('tracking')
        received = 50 * len(order)
        drive.probe.until(lambda: drive.values()['received'] == str(received))
        values = drive.values()
        assert process.alive
    assert len(drive.estimates) == len(order) - 2 and len(drive.samples) == len(order)
    assert (values['dropped.duplicate'], values['dropped.late'], values['dropped.non_finite']) == (
        '50',
        '50',
        '1',
    )
    assert values['used'] == str(received - 101)
    assert values['events.gap'] == '2' and values['events.clock_jump'] == '0'
    reported = np.concatenate([batch.values for batch in drive.samples])
    stamps = np.concatenate([batch.stamps_ns for batch in drive.samples])
    truth = np.concatenate([batch.values for batch in true])
    at = np.searchsorted(np.concatenate([batch.stamps_ns for batch in true]), stamps)
    valid = reported[:, 3] == 1.0
    error = np.angle(np.exp(1j * (reported[valid, 0] - truth[at[valid], 0])))
    assert np.degrees(np.abs(error)).max() < 3.0 and valid.mean() > 0.7
    dropped = order.index(27)
    assert not drive.samples[dropped].values[:, 3].any()
    ends = [estimate.stamp_ns for estimate in drive.estimates]
    assert ends == sorted(ends) and measured[27].stamps_ns[-1] not in ends
    assert drive.estimates[-1].names == ('motor', 'motor_electrical')
    assert drive.estimates[-1].stamp_ns == stamps[-1]
    assert drive.estimates[-1].velocities[0] == pytest.approx(100.0 * np.pi, rel=0.02)
    # replay gives the same bytes: it asks the same stream
    again = DriveStream.of(MOTOR)
    answers = [again.feed(0, names[index][1], 0)[0] for index in order]
    assert [answer[0] for answer in answers if 0 in answer] == drive.raw_estimates
    assert [answer[3] for answer in answers] == drive.raw_samples


def test_the_status_says_what_is_wrong_with_the_input(probe):
    measured, _ = batches(0.2)
    dead = [batch._replace(values=batch.values * [1.0, 1.0, 0.0, 0.0]) for batch in measured]
    again, _ = batches(0.2, begin=BEGIN + 10**9)
    with node('pmsm_wrong', sample_period=2e-4), Drive(probe, 'pmsm_wrong') as drive:
        drive.feed(encoded(dead))
        drive.says('all voltages are zero: is the voltage connected?')
        assert drive.status.message.startswith('not observable')
        slow, _ = batches(0.2, begin=BEGIN + 2 * 10**9, publish_rate=2500.0)
        drive.feed(encoded(slow), unused=len(slow))
        drive.says('sample_period is 0.0002 s, but the stamps are 0.0004 s apart')
        assert drive.status.message.startswith('misconfigured')
        assert drive.estimates[-1].stamp_ns < slow[0].stamps_ns[0]
        later, _ = batches(0.2, begin=BEGIN + 3 * 10**9)
        drive.feed(encoded([*later, *again[:1]]))
        assert estimated(drive.estimates[-2])
        drive.says('lost')
    assert again


def vectors(found, shift=0, frame='alpha_beta'):
    """Messages for `current` and `voltage`, voltages `shift` ns later."""
    from estimator_pkg.observers.maths.clarke import phases

    for batch in found:
        for stamp, value in zip(batch.stamps_ns.tolist(), batch.values.tolist()):
            for which, two in ((0, value[:2]), (1, value[2:])):
                three = phases(*two) if frame == 'abc' else (*two, 0.0)
                yield which, vector3.encode(stamp + which * shift, 'stator', *three)


def test_currents_and_voltages_that_never_pair_are_distinguished(probe):
    measured, _ = batches(0.02)
    with (
        node('pmsm_apart', input='current_voltage'),
        Drive(probe, 'pmsm_apart', vectors=True) as drive,
    ):
        drive.feed(vectors(measured, shift=60_000), answered=False)
        drive.says('stamps differ by at least 6e-05 s: increase pair_tolerance')
        assert drive.status.message.startswith('lost')
        assert drive.estimates == []


def test_phases_with_a_neutral_are_reported(probe):
    measured, _ = batches(0.02)
    odd = []
    for which, raw in vectors(measured, frame='abc'):
        message = vector3.decode(raw)
        if which == 0:
            raw = vector3.encode(message.stamp_ns, '', message.x, message.y, message.z + 3.0)
        odd.append((which, raw))
    with (
        node('pmsm_neutral', input='current_voltage', frame='abc'),
        Drive(probe, 'pmsm_neutral', vectors=True) as drive,
    ):
        drive.feed(odd, answered=False)
        drive.says('the phase currents do not sum to zero')


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

    measured, _ = batches(0.5, profile='constant')
    with node('pmsm_live'), Drive(probe, 'pmsm_live') as drive:
        drive.feed(encoded(measured[:20]))
        assert estimated(drive.estimates[-1])
        assert change(speed_filter_hz=50, relative_bandwidth=0.1).successful
        drive.feed(encoded(measured[20:22]))
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
        drive.feed(encoded(measured[22:23]))
        assert not estimated(drive.estimates[-1])
        drive.feed(encoded(measured[23:]))
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
                (('speed_filter_hz', 200.0), ('epsilon', 1e-4), ('pwm_frequency', 2e4))
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


def test_the_simulator_live_is_the_simulated_one(probe):
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from std_msgs.msg import Float64MultiArray

    raws = []
    heard = probe.node.create_subscription(
        Float64MultiArray,
        '/live_sim/drive_samples',
        raws.append,
        QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT),
        raw=True,
    )
    with dds.NodeProcess(
        SIMULATION,
        *shlex.split(
            '--ros-args -r __ns:=/live_sim -p duration:=0.3 -p wait_for_subscribers:=1 -p seed:=7'
        ),
    ) as process:
        probe.until(lambda: len(raws) >= 30)
        assert process.ends() == 0, process.output
    probe.node.destroy_subscription(heard)
    found = [drive_samples.decode(raw) for raw in raws]
    shift = int(found[0].stamps_ns[0])
    expected = [
        drive_samples.decode(message.encode(shift))
        for chunk in SIMULATOR.generate(PmsmSimulatorParameters(), 0.3, 7)
        for message in chunk
        if message.topic == 'drive_samples'
    ]
    assert len(found) == len(expected) == 30
    for one, other in zip(found, expected):
        assert np.array_equal(one.stamps_ns, other.stamps_ns)
        assert np.array_equal(one.values, other.values)
