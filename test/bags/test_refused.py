# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Wrong options, and options that do not fit the bag: one line, and nothing is left."""

from pathlib import Path

import bag_making as make
import pytest

from estimator_pkg import cli
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.messages.joint_state import TYPE, Encoder

ROOT = Path(__file__).resolve().parents[2]
SIMULATED = ROOT / 'bags' / 'simulated'
STATES, TRUTH = '/joint_states', '/ground_truth/joint_states'


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """By name: joint states and texts; positions and their truth alone; those of the checkout."""
    folder = tmp_path_factory.mktemp('bags')
    encode = Encoder().encode
    with BagWriter(folder / 'bare') as bag:
        bag.add_topic(STATES, TYPE)
        bag.add_topic(TRUTH, TYPE)
        for i in range(400):
            stamp, angle = 10**18 + i * 2_000_000, [2e-3 * i]
            bag.write(STATES, stamp, encode(stamp, '', ['joint'], angle))
            bag.write(TRUTH, stamp, encode(stamp, '', ['joint'], angle, [1.0]))
    return {
        'texts': make.ours(folder / 'texts', make.content(400)),
        'bare': folder / 'bare',
        **{bag.name: bag for bag in SIMULATED.iterdir()},
    }


MOTOR = '--set resistance=0.06 --set inductance=33.75e-6 --set flux=1.9e-3 --set pole_pairs=7'
PMSM = f'--params {ROOT}/config/pmsm_observer.yaml'
WHEELS = '--observer wheel_odometry --set track=0.5'
BASE = f'{WHEELS} --set radius=[0.1]'
REPLAY = {  # by bag: options, what the line says, exit code
    'texts': [
        ('--observer finite_diference', "did you mean 'finite_difference'?", 2),
        ('--set bandwith_hz=3', "unknown parameter 'bandwith_hz': did you mean 'bandwidth_hz'?", 2),
        ('--set per_joint.a.bandwidth_hz=3', 'or use --observer hybrid_angle', 2),
        ('--observer pll --set bandwidth_hz=-3', "'bandwidth_hz' = -3 is outside", 2),
        ('--observer pll --set bandwidth_hz=fast', 'must be a number', 2),
        ('--set bandwidth_hz', 'is not key=value', 2),
        ('--set per_joint..prefer=fast', "the joint, as in 'per_joint.JOINT.prefer'", 2),
        (
            '--observer pll --set a.b.bandwidth_hz=3',
            "did you mean 'per_joint.a.b.bandwidth_hz'?",
            2,
        ),
        ('--set observer=[a]', 'it must be the name of an observer', 2),
        ('--name my-node', "--name 'my-node'", 2),
        ('--set stamp_source=clock', "'clock' is not one of header, publisher", 2),
        ('--set angle_sign=0', 'must be 1 or -1', 2),
        ('--measurement /nope', "has no topic '/nope': it has /chatter", 1),
        ('--measurement /chatter', 'select a number in it with --angle /chatter:FIELD', 1),
        ('--joint elbow', "has no joint 'elbow'; it has a, b", 1),
        ('--angle /joint_states', 'is incomplete: write it as TOPIC:FIELD', 2),
        ('--angle /joint_states:pose', "has no field 'pose'", 2),
        ('--angle /joint_states:header.stamp.sec', "set 'counts_per_revolution'", 2),
        ('--angle /joint_states:position[0] --measurement /joint_states', 'are both given', 2),
        ('--angle /joint_states:position[0] --joint a --joint b', 'one joint', 2),
        ('--params /nowhere.yaml', 'cannot read /nowhere.yaml', 1),
        ('--copy /nope', "has no topic '/nope'", 1),
    ],
    'bare': [
        ('--observer adaptive --smoothed', '--smoothed is for observers of single angles', 2),
        ('--observer adaptive --joint elbow', "'elbow'; it has joint", 1),
        ('--observer switched', 'with the effort that the model needs', 1),
    ],
    'drive_profile': [
        ('--observer pmsm', 'the motor data resistance, inductance, flux, pole_pairs', 2),
        (f'{PMSM} --set resistance=0', "'resistance' = 0 is outside", 2),
        (f'{PMSM} --set pole_pairs=2.5', 'whole number', 2),
        (f'{PMSM} --set resistanse=1', "did you mean 'resistance'?", 2),
        (f'{PMSM} --measurement /nothing', '/nothing', 1),
        (f'{PMSM} --set input=current_voltage', '/current', 1),
        (f'{PMSM} --angle /a:b', '--angle', 2),
        (f'{PMSM} --joint a --joint b', 'one joint', 2),
    ],
    'base_with_slip': [
        (WHEELS, "'radius' is not set", 2),
        (f'{BASE} --set gyro_topic=gyro', "'gyro' is not in", 2),
    ],
    'sine_12bit': [(BASE, "has no joint 'wheel_left_joint'", 1)],
}
LACKING = [  # command for the bag 'bare', its last line, exit code
    ('replay --observer adaptive', 'has no effort', 1),
    ('evaluate --observer geso', 'geso publishes no estimate: ', 1),
    (f'evaluate --observer pmsm {MOTOR}', "has no topic '/drive_samples'", 1),
    ('evaluate --observer geso --set modle=x', "did you mean 'model'?", 2),
    ('evaluate --observer pll --params /nowhere.yaml', 'cannot read /nowhere', 1),
    ('evaluate --set order=2', '--observer', 2),
]


@pytest.mark.parametrize(
    ('bag', 'words', 'said', 'code'), [(bag, *row) for bag, rows in REPLAY.items() for row in rows]
)
def test_replay_refuses_in_one_line_and_leaves_nothing(
    bag, words, said, code, bags, tmp_path, capsys
):
    out = ['--out', str(tmp_path / 'out')]
    assert cli.main(['replay', str(bags[bag]), *words.split(), *out]) == code
    error = capsys.readouterr().err
    assert said in error and error.count('\n') == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(('words', 'said', 'code'), LACKING)
def test_what_a_bag_lacks_is_named(words, said, code, bags, capsys):
    command, *options = words.split()
    assert cli.main([command, str(bags['bare']), *options]) == code
    assert said in capsys.readouterr().err.strip().splitlines()[-1]
