# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""identify: the numbers of models from recordings, and from what cannot tell them."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from estimator_pkg import cli
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.evaluation.identify.data import MechanismSamples
from estimator_pkg.evaluation.identify.fit import fit
from estimator_pkg.evaluation.identify.model import unknowns
from estimator_pkg.messages.joint_state import Decoder
from estimator_pkg.models.load import load
from estimator_pkg.parameters import build
from sim_pkg.mechanisms import cart_pendulum, pendulum, robotic_leg
from sim_pkg.mechanisms.stream import MechanismParameters, stream

ROOT = Path(__file__).parents[3]
RECORDINGS = ROOT / 'bags'
CRANE = 'guide_crane:Crane'


@pytest.fixture
def crane(tmp_path, monkeypatch):
    """The example of docs/known_inputs.md in a module of its own."""
    guide = (ROOT / 'docs/known_inputs.md').read_text()
    (tmp_path / 'guide_crane.py').write_text(guide.split('```python\n')[1].split('```')[0])
    monkeypatch.syspath_prepend(tmp_path)
    return CRANE


def crane_blocks(seed, duration=4.0):
    """The crane driven by a few sines, encoders of 4096 counts and 0.1 mm."""
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, 3)

    def drive(time, y, v):
        return (
            float(np.sum(30.0 * np.sin(2.0 * math.pi * np.array([0.4, 0.9, 1.7]) * time + phases))),
        )

    return stream(
        load(CRANE),
        build(MechanismParameters, {'rate': 200.0, 'quantum': [2.0 * math.pi / 4096.0, 1e-4]}),
        (0.2, 0.0),
        (0.0, 0.0),
        drive,
        duration,
        seed,
    )


def recorded(blocks, periods, actuated):
    """What a simulator measures, as arrays."""
    decoder, rows = Decoder(), []
    for block in blocks:
        for message in block:
            if message.topic == 'joint_states':
                raw = message.encode(0)
                layout = decoder.layout(raw)
                rows.append(
                    (layout.stamp_ns(raw) * 1e-9, layout.numbers(raw, 0), layout.numbers(raw, 2))
                )
    positions = np.array([row[1] for row in rows])
    for column, period in enumerate(periods):
        if period:
            positions[:, column] = np.unwrap(positions[:, column])
    return MechanismSamples(
        np.array([row[0] for row in rows]),
        positions,
        np.array([row[2] for row in rows])[:, list(actuated)],
    )


def of_joint(seed):
    blocks = pendulum.generate(pendulum.Parameters(), 10.0, seed)
    found = fit(
        recorded(blocks, (1,), (0,)),
        unknowns('single_joint', {}, {'inertia': 0.08, 'gravity': 1.0}),
    )
    return found, [0.05, 0.02, 0.05, 1.5, 0.0, 0.0, 0.0]


def of_cart(seed):
    p = cart_pendulum.Parameters(model_parameters=('pendulum_damping=0.004', 'cart_damping=0.5'))
    found = fit(
        recorded(cart_pendulum.generate(p, 11.0, seed), (1, 0), (1,)),
        unknowns(
            'cart_pendulum',
            {'force_constant': 9.27, 'friction_speed': 0.002},
            {'pendulum_inertia': 0.06, 'moving_mass': 1.0},
        ),
    )
    return found, [0.0484, 0.105, 1.15, 3.98, 2.87, 0.004, 0.5, 0.0]


def of_leg(seed):
    p = robotic_leg.Parameters(
        force=5.0, torque=5.0, omega=6.0, noise=(1e-3, 1e-3, 1e-3), quantum=(0.0,)
    )
    found = fit(
        recorded(robotic_leg.generate(p, 6.0, seed), (0, 1, 1), (0, 2)),
        unknowns('robotic_leg', {}, {'foot_mass': 3.0}),
    )
    return found, [4.5, 1.7, 0.0]


def of_crane(seed):
    found = fit(
        recorded(crane_blocks(seed), (1, 0), (1,)),
        unknowns(CRANE, {}, {'load': 1.5, 'trolley': 6.0, 'cable': 1.3}),
    )
    return found, [2.0, 5.0, 1.5, 0.0]


@pytest.mark.long
@pytest.mark.parametrize(
    'of, seeds',
    [
        (of_joint, 2),
        pytest.param(of_joint, 12, marks=pytest.mark.slow),
        pytest.param(of_cart, 10, marks=pytest.mark.slow),
        pytest.param(of_leg, 12, marks=pytest.mark.slow),
        pytest.param(of_crane, 10, marks=pytest.mark.slow),
    ],
)
def test_true_numbers_lie_within_the_stated_deviations(of, seeds, crane):
    """Two-sided: the errors in stated deviations are of rms 1, neither much more nor much less."""
    errors = []
    for seed in range(seeds):
        found, true = of(seed)
        errors.append((found.values - true) / found.deviations)
        assert found.explained_elsewhere > found.explained - 0.05 > 0.7
        assert np.all(found.residual_elsewhere < 1.3 * found.residual)
    size = math.sqrt(np.mean(np.square(errors)))
    assert (0.75 if seeds >= 10 else 0.5) < size < (1.25 if seeds >= 10 else 1.6), size
    assert np.max(np.abs(errors)) < 5.0


@pytest.mark.long
def test_a_delay_of_the_inputs_is_found():
    """Efforts that are reported 7 ms after they acted."""
    known = recorded(pendulum.generate(pendulum.Parameters(), 8.0, 2), (1,), (0,))
    late = MechanismSamples(
        known.time,
        known.positions,
        np.interp(known.time + 0.007, known.time, known.inputs[:, 0])[:, None],
    )
    found = fit(late, unknowns('single_joint', {}, {'inertia': 0.06, 'gravity': 1.3}))
    assert found.names[-1] == 'input_delay'
    # half a sample more: the interpolation above is no longer held from sample to sample
    assert found.values[-1] == pytest.approx(0.007, abs=0.0012)
    assert found.deviations[-1] < 2e-4


# The command


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp('identify') / 'bag'
    assert (
        cli.main(['simulate', 'pendulum', '--duration', '8', '--seed', '4', '--out', str(path)])
        == 0
    )
    return path


def identified(tmp_path, bag, *words):
    """(result, path of the parameter file) of a run."""
    out, reported = tmp_path / 'found.yaml', tmp_path / 'found.json'
    more = '--out', str(out), '--json', str(reported)
    assert cli.main(['identify', str(bag), *words, *more]) == 0
    return json.loads(reported.read_text()), out


@pytest.mark.long
@pytest.mark.parametrize(
    'words, inertia',
    [('--model single_joint', 0.05), ('--set torque_constant=0.5 --set gear_ratio=4', 0.1)],
)
def test_what_is_found_can_be_replayed_with(recording, words, inertia, tmp_path, capsys):
    """Torque constant and gear are taken as the user sets them."""
    found, out = identified(tmp_path, recording, *words.split(), '--set', 'bias=0')
    assert '  coulomb = 0.' in capsys.readouterr().out
    assert found['values']['inertia'] == pytest.approx(inertia, rel=2e-3)
    assert 0.0 < found['stddev']['inertia'] < 2e-3 * inertia
    assert found['explained_elsewhere'] > 0.999 and 'bias' not in found['values']
    assert cli.main(['replay', str(recording), '--observer', 'geso', '--params', str(out)]) == 0


@pytest.mark.slow
def test_a_users_model_is_identified_from_a_bag_and_replayed(crane, tmp_path):
    """Its joints have other names in the bag."""
    bag = tmp_path / 'bag'
    with BagWriter(bag) as writer:
        writer.add_topic('/joint_states', 'sensor_msgs/msg/JointState')
        for block in crane_blocks(3):
            for message in block:
                if message.topic == 'joint_states':
                    writer.write('/joint_states', message.due_ns + 10**9, message.encode(10**9))
    words = '--joint cable --joint trolley --start load=1.5 --set cable=1.5'
    found, out = identified(tmp_path, bag, '--model', crane, *words.split())
    assert list(found['values']) == ['load', 'trolley', 'input_delay']
    for name, true in (('load', 2.0), ('trolley', 5.0), ('input_delay', 0.0)):
        assert abs(found['values'][name] - true) < 4.0 * found['stddev'][name], name
    assert found['stddev']['load'] < 0.02
    assert 'cable=1.5' in out.read_text()
    assert cli.main(['replay', str(bag), '--observer', 'geso', '--params', str(out)]) == 0


def test_recorded_joint_is_found_near_what_its_makers_say(tmp_path):
    """J about 0.16 kg m^2 and m g l about 3.2 N m; too short a record to be sure of either."""
    bag = RECORDINGS / 'dfki_simple_pendulum' / 'system_identification_300hz'
    found, _ = identified(tmp_path, bag)
    assert abs(found['values']['inertia'] - 0.16) < 3.0 * found['stddev']['inertia'] < 0.3
    assert abs(found['values']['gravity'] - 3.2) < 3.0 * found['stddev']['gravity'] < 6.0


@pytest.mark.parametrize(
    'words, message',
    [
        (['--model', 'cart_pendulum'], 'with --joint, once for each of pendulum'),
        (['--model', 'cart_pendulum', '--joint', 'joint'], 'give --joint 2 times, not 1'),
        (['--joint', 'jiont'], "did you mean 'joint'?"),
        (['--set', 'inertai=1'], "did you mean 'inertia'?"),
        (['--start', 'period=1'], "'period' of model 'single_joint' is not identified"),
        (['--set', 'bias=0', '--start', 'bias=1'], 'is in both --set and --start'),
        (['--model', 'own_models:CartPendulum'], "add an attribute 'parameters'"),
        (['--model', 'own_models:Nothing'], "has no 'Nothing'"),
        (['--set', 'torque_constant=x'], 'must be a number'),
    ],
)
def test_a_usage_error_is_one_line(recording, words, message, capsys):
    capsys.readouterr()
    assert cli.main(['identify', str(recording), *words]) in (1, 2)
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1


@pytest.mark.long
@pytest.mark.parametrize(
    'bag, message',
    [
        ('simulated/sine_12bit', 'has no efforts'),
        ('dfki_double_pendulum/sys_id_500hz', 'has the joints shoulder, elbow'),
        ('dfki_simple_pendulum/gravity_compensation_1000hz', 'check the sign of the torque'),
        ('at rest', 'record more varied motion'),
    ],
)
def test_recordings_that_cannot_tell_are_refused_in_one_line(bag, message, tmp_path, capsys):
    path = RECORDINGS / bag
    if bag == 'at rest':
        path = tmp_path / 'rest'
        words = ['simulate', 'pendulum', '--duration', '8', '--set', 'torque=0', '--out', str(path)]
        assert cli.main(words) == 0
    capsys.readouterr()
    assert cli.main(['identify', str(path)]) in (1, 2)
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1


def test_nothing_is_overwritten(recording, tmp_path, capsys):
    out = tmp_path / 'joint.yaml'
    out.write_text('mine')
    assert cli.main(['identify', str(recording), '--out', str(out)]) == 1
    assert out.read_text() == 'mine'
