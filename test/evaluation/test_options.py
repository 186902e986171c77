# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Options that evaluate, tune and doctor share act in each of them, however they are set."""

import json

import numpy as np
import pytest
import yaml
from joint_bags import write_bag

from estimator_pkg.cli import main
from estimator_pkg.errors import UsageError
from estimator_pkg.evaluation.options import WRAP_PERIOD, wrap_periods

START = 1_700_000_000_000_000_000
PERIOD, FASTER = 1.6, 200.0
REPAIRED = '--set', 'stamp_repair=regular'
BOTH = {'wrap_period': PERIOD, 'per_joint.lift.wrap_period': 0.0}


def stamps_of(time):
    return (START + np.rint(np.asarray(time) * 1e9).astype(np.int64)).tolist()


def run(tmp_path, command, *words, code=0):
    """The result as JSON."""
    out = tmp_path / 'out.json'
    assert main([command, *words, '--json', str(out)]) == code
    return json.loads(out.read_text())


@pytest.fixture(scope='module')
def turning(tmp_path_factory):
    """A motion as a joint whose reading repeats after 1.6 rad, and as a faster one without that.

    The latter passes more than half the period of the former in a sample.
    """
    time = np.arange(1, 2001) / 500.0
    angle = np.round((1.1 * time + 0.9 * np.sin(3.0 * time)) / 1e-3) * 1e-3
    rows = [
        (stamp, ('joint', 'lift'), (float(one % PERIOD), float(FASTER * one)), ())
        for stamp, one in zip(stamps_of(time), angle)
    ]
    return write_bag(tmp_path_factory.mktemp('options') / 'turning', {'/joint_states': rows})


def errors(joints):
    """The larger rms error [rad/s], of the slower motion."""
    return max(joints['joint']['velocity']['rms'], joints['lift']['velocity']['rms'] / FASTER)


@pytest.fixture
def params(tmp_path):
    file = tmp_path / 'params.yaml'
    file.write_text(yaml.safe_dump({'/**': {'ros__parameters': BOTH}}))
    return str(file)


@pytest.mark.parametrize(
    'requested, parameters, expected',
    [
        (None, [], (WRAP_PERIOD, {})),
        (1.6, [{}], (1.6, {})),
        (None, [{}, {'wrap_period': 1.6}], (1.6, {})),
        (1.6, [{'wrap_period': 1.6}], (1.6, {})),
        (0.0, [{'per_joint.a.b.wrap_period': 1}], (0.0, {'a.b': 1.0})),
        (2.0, [{'wrap_period': 1.6}], "--wrap-period is 2 rad, but parameter 'wrap_period' is 1.6"),
        (None, [{'per_joint.a.wrap_period': 1.0}, {'per_joint.a.wrap_period': 2.0}], 'is 2 rad'),
    ],
)
def test_the_wrap_period_is_one_wherever_it_is_set(requested, parameters, expected):
    if isinstance(expected, str):
        with pytest.raises(UsageError, match=expected):
            wrap_periods(requested, parameters)
    else:
        assert wrap_periods(requested, parameters) == expected


@pytest.mark.long
@pytest.mark.parametrize('way', ['file', 'set'])
def test_a_wrap_period_acts_in_every_command(turning, params, tmp_path, way):
    sets = [word for name, value in BOTH.items() for word in ('--set', f'{name}={value}')]
    words = ['--params', params] if way == 'file' else [*sets]
    found = run(tmp_path, 'evaluate', turning, *words, '--observer', 'kalman')['bags'][turning]
    joints = found['estimates']['kalman']['joints']
    assert errors(joints) < 0.1 and len(joints) == 2
    assert not found['refused']
    out = tmp_path / 'tuned.yaml'
    run(
        tmp_path,
        'tune',
        turning,
        '--observer',
        'kalman',
        '--trials',
        '1',
        '--out',
        str(out),
        *words,
    )
    written = yaml.safe_load(out.read_text())['/**']['ros__parameters']
    assert {name: written[name] for name in BOTH} == BOTH
    again = tmp_path / 'again'
    run(tmp_path, 'replay', turning, '--params', str(out), '--out', str(again))
    found = run(tmp_path, 'evaluate', str(again), *words, '--estimate', '/joint_observer/estimate')
    rows = found['bags'][str(again)]['estimates']['/joint_observer/estimate']['joints']
    assert errors(rows) < 0.1
    if way == 'set':
        told = run(tmp_path, 'doctor', turning, *sets)
        (of_lift,) = (e for e in told['joints']['lift']['findings'] if e['check'] == 'wrap')
        assert told['ok'] and of_lift['value'].endswith('no wrap period')
        assert main(['doctor', turning, '--wrap-period', '2', *sets]) == 2


def test_stamp_repair_acts_in_evaluate_and_doctor_names_it(tmp_path):
    """A device that samples at 500 Hz; its messages are stamped when they are received."""
    random = np.random.default_rng(1)
    time = np.arange(1, 4001) / 500.0
    received = time + random.uniform(0.0, 1.8e-3, len(time))
    angle = np.round((4.0 * np.sin(2.0 * time) + 3.0 * np.sin(5.0 * time)) / 1e-3) * 1e-3
    speed = 8.0 * np.cos(2.0 * time) + 15.0 * np.cos(5.0 * time)

    def recorded(name, stamped):
        measured = zip(stamps_of(stamped), angle.tolist())
        true = zip(stamps_of(time), angle.tolist(), speed.tolist())
        topics = {
            '/joint_states': [(stamp, ('a',), (one,), ()) for stamp, one in measured],
            '/ground_truth/joint_states': [(stamp, ('a',), (x,), (v,)) for stamp, x, v in true],
        }
        return write_bag(tmp_path / name, topics)

    def rms(bag, *words):
        words = ['--observer', 'edge_adaptive', '--wrap-period', '0', *words]
        found = run(tmp_path, 'evaluate', bag, *words)
        return found['bags'][bag]['estimates']['edge_adaptive']['joints']['a']['velocity']['rms']

    bag, regular = recorded('bag', received), recorded('regular', time + 0.9e-3)
    # after the repair has learnt the period, what is left is nearly that of the device's own clock
    plain, repaired = rms(bag, '--from', '3'), rms(bag, *REPAIRED, '--from', '3')
    best = rms(regular, '--from', '3')
    assert repaired < 1.15 * best and plain < 2.0 * best  # by the readings, or by the repair
    findings = run(tmp_path, 'doctor', bag, '--wrap-period', '0')['joints']['a']['findings']
    named = [each['check'] for each in findings if 'stamp_repair: regular' in each['remedy']]
    assert named == ['jitter', 'lying stamps']


def flawed(kind):
    """Rows of a joint for 20 s at 250 Hz with one bad moment."""
    time = np.arange(5000) / 250.0
    angle = np.round((1.5 * np.sin(2.0 * time) + 0.8 * np.sin(5.0 * time)) / 1e-3) * 1e-3
    kept = np.ones(len(time), bool)
    if kind == 'seam':
        angle[time > 8.0] += 1.0
    elif kind == 'flips':
        angle[time % 1.0 > 0.5] += 1.0
    elif kind == 'hole':
        kept = (time < 5.0) | (time > 8.0)
    elif kind == 'restart':
        time[time > 8.0] -= 8.0
    return [
        (stamp, ('a',), (float(one),), (), START + 4_000_000 * number)
        for number, (stamp, one, use) in enumerate(zip(stamps_of(time), angle, kept))
        if use
    ]


@pytest.mark.long
@pytest.mark.parametrize(
    'kind, words, caution',
    [
        ('seam', (), 'judged from 8.00 to 20.00 s, the longest part'),
        ('seam', ('--from', '0', '--to', '7.9'), ''),
        ('hole', (), '1 hole, the longest 3'),
        ('restart', (), 'the clock jumps back 1 time'),
        ('flips', (), None),
    ],
)
def test_one_bad_moment_does_not_refuse_the_ranking(tmp_path, kind, words, caution):
    bag = write_bag(tmp_path / 'bag', {'/joint_states': flawed(kind)})
    observers = ['--observer', 'kalman', '--observer', 'pll', *words]
    found = run(tmp_path, 'evaluate', bag, *observers)['bags'][bag]['verdict']['a']
    told = run(tmp_path, 'doctor', bag, *words, code=0 if caution == '' else 1)['joints']['a']
    if caution is None:
        assert not found['best'] and told['verdict'] is None
        return
    assert found['best'] and told['verdict']['best']
    for cautions in (found['cautions'], told['verdict']['cautions']):
        assert cautions[0].startswith(caution or 'the angle alone')


@pytest.mark.long
@pytest.mark.parametrize('kind', ['seam', 'flips'])
def test_tune_judges_the_part_that_evaluate_judges(tmp_path, kind):
    bag = write_bag(tmp_path / 'bag', {'/joint_states': flawed(kind)})
    words = ['--observer', 'kalman', '--trials', '1', '--out', str(tmp_path / 'tuned.yaml')]
    (tuned,) = run(tmp_path, 'tune', bag, *words)['tuned']
    assert bool(tuned['tried']) == (kind == 'seam')
    assert kind == 'flips' or tuned['cautions'][0].startswith('judged from 8.00 to 20.00 s')
