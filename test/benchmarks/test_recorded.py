# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The table of all observers on the bags of this repository, held by two-sided bounds.

Bounds guard against change. Fresh ones:

    python -m benchmarks.accuracy bags > test/recordings_bounds.yaml
"""

from pathlib import Path

import pytest
import yaml

from benchmarks.accuracy import bounds, judge, run
from benchmarks.recorded import RAW, recordings, with_truth
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.compare.evaluate import evaluate
from estimator_pkg.evaluation.entries import at_defaults
from estimator_pkg.evaluation.options import Options
from estimator_pkg.observers import DEFAULT

HERE = Path(__file__).resolve().parents[1]
BAGS = HERE.parent / 'bags'
BOUNDS = yaml.safe_load((HERE / 'recordings_bounds.yaml').read_text())
PENDULUMS = sorted(path.parent for path in BAGS.glob('dfki_*/*/metadata.yaml'))
ONE_KHZ = 'gravity_compensation_1000hz/pendulum'
# What brings each drive's velocity to the position's, and how late it is, as bags/README.md says.
DRIVE_BIAS = {'dfki_simple_pendulum': -0.011, 'dfki_double_pendulum': 0.0055}


@pytest.fixture(scope='module')
def measured():
    return {(row['stream'], row['observer']): row for row in run(with_truth(BAGS))}


@pytest.mark.long
@pytest.mark.parametrize(
    ('case', 'observer'),
    [(case, observer) for case, bounds in BOUNDS.items() for observer in bounds],
)
def test_no_worse_than_its_bound_and_no_better_than_half_of_it(measured, case, observer):
    row, (rms, largest) = measured[case, observer], BOUNDS[case][observer]
    assert judge(row['rms'], rms) == '', 'rms'
    assert judge(row['max_abs'], largest) == '', 'largest error'


@pytest.mark.long
def test_every_case_has_a_bound(measured):
    assert set(measured) == {
        (case, observer) for case, bounds in BOUNDS.items() for observer in bounds
    }
    assert {observer for _, observer in measured} >= {entry.label for entry in at_defaults()}
    assert len({case for case, _ in measured}) >= 11


def test_a_bound_is_two_sided():
    assert judge(1.0, 1.0) == '' and judge(0.5, 1.0) == ''
    assert 'worse' in judge(1.01, 1.0)
    assert 'worse' in judge(float('nan'), 1.0)
    assert 'better' in judge(0.49, 1.0)


def pendulums(measured):
    names = {bag.name for bag in PENDULUMS}
    return sorted({case for case, _ in measured if case.split('/')[0] in names})


@pytest.mark.long
@pytest.mark.parametrize('observer, most', [(DEFAULT, 1.05), ('hybrid_angle', 1.1)])
def test_it_is_hardly_worse_than_constant_acceleration(measured, observer, most):
    assert len(pendulums(measured)) == 10
    for case in pendulums(measured):
        own, rival = (measured[case, name]['rms'] for name in (observer, 'kalman acceleration'))
        assert own <= most * rival, case


@pytest.mark.parametrize('observer', [DEFAULT, 'hybrid_angle'])
@pytest.mark.long
def test_it_has_at_most_half_the_error_of_the_difference_at_1_khz(measured, observer):
    own, difference = (measured[ONE_KHZ, name]['rms'] for name in (observer, RAW.label))
    assert own <= 0.5 * difference


@pytest.mark.long
@pytest.mark.parametrize('bag', PENDULUMS, ids=lambda bag: bag.name)
def test_the_drives_own_bias_lag_and_noise_are_found(bag):
    found = evaluate(str(bag), Options(observers=(RAW,)))
    for known in found.truth.references.values():
        bias = DRIVE_BIAS[bag.parent.name]
        assert known.bias == pytest.approx(bias, abs=4.0 * known.bias_stddev)
        assert known.bias_stddev < 0.006
        if 'rest' in bag.name:
            assert known.lag_s != known.lag_s  # nan: nothing moves
        else:
            assert 0.0 < known.lag_s < 1.5e-3
            assert known.lag_stddev < 0.5e-3
            assert known.slope == pytest.approx(1.0, abs=0.004)
        if 'system_identification' not in bag.name:  # which shakes too much to tell
            assert 0.05 < known.noise < 0.12


def test_new_bounds_are_above_what_was_measured_and_a_folder_without_bags_is_named(tmp_path):
    row = {'stream': 'a/b', 'observer': 'pll', 'rms': 1.0, 'max_abs': 2.0}
    assert bounds([row]) == {'a/b': {'pll': [1.15, 2.3]}}
    with pytest.raises(UserError, match='contains no bag'):
        recordings(tmp_path)
