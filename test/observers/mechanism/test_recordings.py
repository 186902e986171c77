# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Two-sided bounds of the observers of mechanisms on recorded pendulums, as a user replays them.

The reference is the drive's own velocity as it is, with its noise of 0.06 to 0.11 rad/s and its
lag: these bounds guard against change. Better than half of one fails too, so that none goes stale.
"""

import math
from pathlib import Path

import numpy as np
import pytest

from estimator_pkg import cli
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.series import joint_series

BAGS = Path(__file__).parents[3] / 'bags'
SKIPPED = 2 * 10**9  # ns at the begin

SIMPLE = (
    'dfki_simple_pendulum/sac_200hz_multiturn',
    ['joints=[pendulum]', "model_parameters=['inertia=0.17','gravity=3.6','coulomb=0.1']"],
)
# what `identify` finds on dfki_double_pendulum/sys_id_500hz
DOUBLE = (
    'dfki_double_pendulum/trajectory_665hz',
    [
        'model=two_links',
        "model_parameters=['shoulder_inertia=0.142','elbow_inertia=0.0345','coupling=0.0369',"
        "'shoulder_gravity=3.89','elbow_gravity=1.2','shoulder_damping=0.041','elbow_damping=0.001',"
        "'shoulder_coulomb=0.18','elbow_coulomb=0.118','coulomb_speed=0.05']",
    ],
)
CASES = [  # recording and model, observer, its parameters, largest rms error of each joint [rad/s]
    (SIMPLE, 'geso', ['bandwidth_hz=20', 'disturbance_hz=2'], (0.216,)),
    (SIMPLE, 'hgo', ['bandwidth_hz=20'], (0.214,)),
    (SIMPLE, 'ehgo', ['bandwidth_hz=20'], (0.233,)),
    (SIMPLE, 'smo', ['mu=[60]'], (0.229,)),
    (DOUBLE, 'hgo', ['bandwidth_hz=70', 'disturbance_hz=4'], (0.11, 0.108)),
    (DOUBLE, 'ehgo', ['bandwidth_hz=40'], (0.152, 0.134)),
    (DOUBLE, 'smo', ['mu=[100, 100]'], (0.136, 0.118)),
]
QUICK = (4,)  # the others take long, and run with the slow ones


@pytest.mark.long
@pytest.mark.parametrize(
    'recording, observer, values, bounds',
    [
        pytest.param(*case, marks=[pytest.mark.slow] * (n not in QUICK))
        for n, case in enumerate(CASES)
    ],
    ids=[f'{case[0][0].partition("/")[2]}-{case[1]}' for case in CASES],
)
def test_errors_stay_within_two_sided_bounds(recording, observer, values, bounds, tmp_path):
    path, common = recording
    words = [word for value in (*common, *values) for word in ('--set', value)]
    out = str(tmp_path / 'out')
    assert cli.main(['replay', str(BAGS / path), '--observer', observer, *words, '--out', out]) == 0
    with open_bag(out) as bag:
        found = joint_series(bag, '/mechanical_observer/estimate')
        truth = joint_series(bag, '/ground_truth/joint_states')
    assert len(found) == len(bounds)
    for bound, (name, series) in zip(bounds, found.items()):
        late = series.stamps_ns > series.stamps_ns[0] + SKIPPED
        true = truth[name]
        order = np.argsort(true.stamps_ns, kind='stable')
        at = order[np.searchsorted(true.stamps_ns[order], series.stamps_ns[late])]
        assert np.array_equal(true.stamps_ns[at], series.stamps_ns[late])
        rms = math.sqrt(np.mean((series.velocity[late] - true.velocity[at]) ** 2))
        assert 0.5 * bound < rms < bound, f'{name}: {rms}'
