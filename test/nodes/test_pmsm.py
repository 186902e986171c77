# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The nodes pmsm_observer and pmsm_sim in processes of their own, over real DDS."""

import time
from pathlib import Path

import dds
import numpy as np
import pytest

from estimator_pkg.bags.reader import open_bag
from estimator_pkg.messages import drive_samples

OBSERVER = 'estimator_pkg.nodes.executables pmsm_observer'
SIMULATION = 'sim_pkg.nodes.executables pmsm_sim'
PARAMS = Path(__file__).resolve().parents[2] / 'config' / 'pmsm_observer.yaml'


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
