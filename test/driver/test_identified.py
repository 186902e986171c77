# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The file of identified parameters: what is written is read; anything else is refused."""

import math

import pytest
import yaml
from servos import excited, servo

from estimator_pkg.driver.adaptive import AdaptiveBank, AdaptiveConfiguration
from estimator_pkg.driver.identified import load, save
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.observers.adaptive.observer import Adaptive

DT_NS = 2_000_000
GOOD = {'order': 2, 'a': [-5.0, -2.0], 'b': [0.0, 30.0], 'stddev': [0.1, 0.2, 0.3, 0.4]}


def bank(**values):
    return AdaptiveBank(AdaptiveConfiguration(Adaptive, {'wrap_period': 0.0, **values}))


def learnt(names=('a',), **values):
    one, u = bank(**values), excited(1500, hold=50)
    one.take(10**18 - DT_NS, ('idle',), (0.0,), (0.0,))  # this one learns nothing
    angles, _ = servo(2.0, 5.0, 30.0, u, 1e-9 * DT_NS)
    for k in range(len(u)):
        one.take(
            10**18 + k * DT_NS,
            names,
            (float(angles[k]),) * len(names),
            (float(u[k - 1]) if k else 0.0,) * len(names),
        )
    return one


def test_what_is_saved_is_the_plant_and_other_joints_stay(tmp_path):
    path = str(tmp_path / 'parameters.yaml')
    mine = tmp_path / 'parameters.yaml.part'
    mine.write_text('mine')
    one = learnt(load=True, gravity=True)
    assert save(path, one) == ['a']
    found = load(path)['a']
    said = one.reports()['a']
    theta = dict(zip(said.names, said.theta))
    assert found['order'] == 2 and found['trusted'] is said.trusted
    assert found['b'] == [theta['b1'], theta['b2']] == list(said.theta[2:4])
    assert (found['load'], found['gravity']) == (theta['d2'], theta['s2'])
    assert len(found['stddev']) == 6
    again = AdaptiveConfiguration(
        Adaptive, {'wrap_period': 0.0, 'load': True, 'gravity': True}, saved={'a': found}
    )
    assert again.for_joint('a')[0].theta == pytest.approx(said.theta)
    assert again.origin('a').trusted is said.trusted and again.origin('b') is None
    assert save(path, learnt(('b', 'c'))) == ['b', 'c']
    assert load(path)['a'] == found and set(load(path)) == {'a', 'b', 'c'}
    assert 'load' not in load(path)['b'] and len(load(path)['b']['stddev']) == 4
    assert mine.read_text() == 'mine' and len(list(tmp_path.iterdir())) == 2


def test_nothing_identified_is_not_saved(tmp_path):
    with pytest.raises(UserError, match='nothing is identified yet'):
        save(str(tmp_path / 'x.yaml'), bank())
    with pytest.raises(UserError, match='nothing is identified yet'):
        one = bank()
        one.take(10**18, ('a',), (0.0,), (0.0,))
        save(str(tmp_path / 'x.yaml'), one)
    with pytest.raises(UserError, match=r'cannot write .*no_folder'):
        save(str(tmp_path / 'no_folder' / 'x.yaml'), learnt())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    'change',
    [
        {'order': '2'},
        {'order': 3},
        {'order': True},
        {'a': [1.0]},
        {'a': 5.0},
        {'b': None},
        {'b': [0.0, 1.0, 2.0]},
        {'b': [0.0, math.nan]},
        {'a': [0.0, 'x']},
        {'stddev': 0.1},
        {'stddev': [0.1, 0.2, 0.3, 'x']},
        {'stddev': [0.1, 0.2, 0.3]},
        {'load': 1.0},  # and no deviation of it
        {'gravity': 1.0},
        {'load': math.inf, 'stddev': []},
        {'gravity': math.nan, 'stddev': []},
        {'load': 'x', 'stddev': []},
        {'trusted': 'no'},
    ],
)
def test_damaged_entries_name_the_joint(tmp_path, change):
    path = tmp_path / 'x.yaml'
    for entry, good in ((GOOD, True), ({**GOOD, **change}, False)):
        path.write_text(yaml.safe_dump({'adaptive_parameters': 1, 'joints': {'a': entry}}))
        if good:
            assert load(str(path)) == {'a': GOOD}
        else:
            with pytest.raises(UsageError, match="the parameters of joint 'a' are damaged"):
                load(str(path))


@pytest.mark.parametrize(
    'text, said',
    [
        ('x: 1', 'contains no parameters of the adaptive observer'),
        ('[1, 2]', 'contains no parameters of the adaptive observer'),
        ('a: [', 'contains no parameters of the adaptive observer'),
        ('adaptive_parameters: 2', 'contains no parameters of the adaptive observer'),
        ('{adaptive_parameters: 1, joints: [a]}', "'joints' must map each joint's name"),
        ('{adaptive_parameters: 1, joints: {a: 5}}', "joint 'a' are damaged"),
        ('{adaptive_parameters: 1, joints: 3}', "'joints' must map each joint's name"),
        ('{adaptive_parameters: 1, joints: {[a]: 1}}', 'contains no parameters'),
        ('{adaptive_parameters: 1, joints: !!python/name:os.system ""}', 'contains no parameters'),
        (None, 'cannot read .*: No such file'),
    ],
)
def test_other_files_are_refused(tmp_path, text, said):
    path = tmp_path / 'x.yaml'
    if text is not None:
        path.write_text(text)
    with pytest.raises(UsageError, match=said) as caught:
        load(str(path))
    assert '\n' not in str(caught.value)


def test_entries_without_deviations_or_of_load_and_gravity_are_whole(tmp_path):
    path = tmp_path / 'x.yaml'
    for more in (
        {'stddev': []},
        {'load': 1.5, 'stddev': [0.1] * 5},
        {'load': 1.5, 'gravity': 2.5, 'stddev': [0.1] * 6, 'trusted': False},
    ):
        path.write_text(
            yaml.safe_dump({'adaptive_parameters': 1, 'joints': {'a': {**GOOD, **more}}})
        )
        assert load(str(path)) == {'a': {**GOOD, **more}}
    for nothing in ('', '\njoints:'):
        path.write_text(f'adaptive_parameters: 1{nothing}')
        assert load(str(path)) == {}


@pytest.mark.parametrize('word', ['load', 'gravity'])
def test_saved_parameters_must_fit_the_gains(word):
    with pytest.raises(UsageError, match='have order 2, but order is 1: set order to 2'):
        AdaptiveConfiguration(Adaptive, {'order': 1}, saved={'a': GOOD})
    with pytest.raises(UsageError, match=f'have a {word}: set {word} to true'):
        AdaptiveConfiguration(Adaptive, {}, saved={'a': {**GOOD, word: 1.0}})
    AdaptiveConfiguration(Adaptive, {}, saved={'a': {**GOOD, word: 0.0}})
