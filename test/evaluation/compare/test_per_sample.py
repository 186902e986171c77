# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Drives with the truth of every sample in the bag are judged and tuned sample by sample."""

import json

import numpy as np
import pytest

from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.series import at_stamps
from estimator_pkg.cli import main
from estimator_pkg.messages import drive_samples

MOTOR = [
    word
    for pair in ('resistance=0.06', 'inductance=33.75e-6', 'flux=1.9e-3', 'pole_pairs=7')
    for word in ('--set', pair)
]
SAMPLES = '/ground_truth/samples'


@pytest.fixture(scope='module')
def drive(tmp_path_factory):
    """0.15 s at 20 kHz: fifteen batches; and the same with its estimates."""
    folder = tmp_path_factory.mktemp('per_sample')
    bag, out = str(folder / 'bag'), str(folder / 'out')
    simulated = 'simulate pmsm --duration 0.15 --seed 1 --set current_noise=0.05 --out'
    assert main([*simulated.split(), bag]) == 0
    assert main(['replay', bag, *MOTOR, '--observer', 'pmsm', '--out', out]) == 0
    return folder


def compared(tmp_path, bag, *words):
    """(what was the truth, what was found by joint)."""
    out = tmp_path / 'out.json'
    assert main(['evaluate', str(bag), *words, '--json', str(out)]) == 0
    found = json.loads(out.read_text())['bags'][str(bag)]
    (estimates,) = found['estimates'].values()
    return found['truth'], estimates['joints']


def table(bag, topic):
    batches = [drive_samples.decode(bytes(message.raw)) for message in bag.messages([topic])]
    return (
        np.concatenate([each.stamps_ns for each in batches]),
        np.concatenate([each.values for each in batches]),
    )


def test_every_sample_is_compared(drive, tmp_path):
    with open_bag(drive / 'out') as bag:
        stamps, found = table(bag, '/pmsm_observer/estimate_samples')
        true_stamps, true = table(bag, SAMPLES)
    valid = found[:, 3] == 1.0
    error = found[valid, 1] - true[np.searchsorted(true_stamps, stamps[valid]), 1]
    recorded = compared(tmp_path, drive / 'out')
    run = compared(tmp_path, drive / 'bag', '--observer', 'pmsm', *MOTOR)
    for truth, joints in (recorded, run):
        assert truth.endswith(f'and {SAMPLES}')
        one = joints['motor_electrical']
        assert one['matched'] == {
            'estimates': len(error),
            'compared': len(error),
            'interpolated': 0,
            'unmatched': 0,
        }
        assert one['velocity']['rms'] == pytest.approx(np.sqrt(np.mean(error**2)))
        assert joints['motor']['matched']['compared'] <= 15
        assert 0.5 < one['coverage_95'] <= 1.0  # of the last of every batch
    assert len(error) > 2500


def test_another_truth_is_taken_as_it_is(drive, tmp_path):
    for bag, words in (('out', []), ('bag', ['--observer', 'pmsm', *MOTOR])):
        truth, joints = compared(
            tmp_path, drive / bag, '--truth', '/ground_truth/joint_states', *words
        )
        assert truth == '/ground_truth/joint_states'
        assert joints['motor_electrical']['matched']['compared'] <= 15


@pytest.mark.parametrize('serialization', ['cdr', 'json'])
def test_a_bag_that_holds_something_else_there_is_one_line(serialization, drive, tmp_path, capsys):
    """Batches of another shape, and batches that are not CDR, which would decode all the same."""
    from estimator_pkg.bags.writer import BagWriter
    from estimator_pkg.messages import multi_array

    with open_bag(drive / 'bag') as bag, BagWriter(tmp_path / 'bag') as made:
        for topic in bag.topics.values():
            form = serialization if topic.name == SAMPLES else 'cdr'
            made.add_topic(topic.name, topic.type, serialization=form)
        for message in bag.messages(list(bag.topics)):
            raw = bytes(message.raw)
            if message.topic == SAMPLES and serialization == 'cdr':
                raw = multi_array.encode(np.zeros((2, 3)), drive_samples.LABELS)
            made.write(message.topic, message.log_ns, raw)
    assert main(['evaluate', str(tmp_path / 'bag'), '--observer', 'pmsm', *MOTOR]) == 1
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1 and SAMPLES in said[0]


def test_values_at_stamps():
    found = at_stamps(np.array([5, 1, 9, 3]), np.array([3, 5]), np.array([30.0, 50.0]))
    assert np.array_equal(found, [50.0, np.nan, np.nan, 30.0], equal_nan=True)
    assert np.isnan(at_stamps(np.array([1]), np.zeros(0, np.int64), np.zeros(0))).all()
