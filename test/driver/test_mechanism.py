# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Mechanisms without ROS: inputs over time, joints gathered by stamp, wrong settings, replay."""

import math

import numpy as np
import pytest
from answers import valid
from mechanism_runs import FAST, motion

from estimator_pkg import cli, observers
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.efforts import EFFORT_COMMAND
from estimator_pkg.driver.mechanism import MechanismBank, MechanismSettings
from estimator_pkg.errors import UserError
from estimator_pkg.estimate import COASTING, NOT_OBSERVABLE, TRACKING

MS = 1_000_000
START = 10**12


def bank(source='joint_states', names=('m',), overrides=None, observer='geso', **values):
    """The mechanisms of a node with these parameters."""
    configuration = Configuration(observers.find(observer), values, overrides, MechanismSettings)
    return MechanismBank(configuration, names, source)


# Inputs


@pytest.mark.parametrize('delay', (0.0, 0.005))
def test_the_effort_command_acts_from_its_stamp_plus_its_delay(delay):
    """The observer's momentum moves exactly when and as much as the command says."""
    mechanisms = bank(
        EFFORT_COMMAND,
        model='single_joint',
        model_parameters=['inertia=0.1'],
        joints=['j'],
        input_scale=[-2.0],
        input_delay=delay,
        L=[1e-3],
        K=[1e-6],
    )
    mechanisms.command(START - 100 * MS, ('j',), (0.0,))
    mechanism = mechanisms.joints['m']
    velocities = []
    for k in range(60):
        if k == 20:
            mechanisms.command(START + 20 * MS - MS // 2, ('other', 'j'), (7.0, 0.5))
        mechanisms.update(START + k * MS, ('j',), (0.0,), ())
        velocities.append(mechanism.estimate()[1][0] if k else 0.0)
    late = round(delay * 1000)
    assert abs(velocities[19 + late]) < 1e-9
    assert velocities[20 + late] == pytest.approx(-2.0 * 0.5 / 0.1 * 0.5e-3, rel=1e-3)
    assert velocities[59] == pytest.approx(-10.0 * (39.5e-3 - delay), rel=1e-3)


# Joints


def test_joints_in_separate_messages_are_matched_by_stamp():
    """In any order, with another sample between; the same estimates as from whole messages."""
    values = {'model': 'cart_pendulum', 'bandwidth_hz': 20.0, 'joints': ['arm', 'wagon']}
    whole, parts = bank(**values), bank(**values)
    for k in range(200):
        stamp, y = START + k * MS, (0.3 + 1e-3 * k, 2e-4 * k)
        whole.update(stamp, ('wagon', 'arm'), (y[1], y[0]), (0.5, 0.0))
        messages = [(('arm',), (y[0],), ()), (('wagon', 'x'), (y[1], 9.0), (0.5, 9.0))]
        for names, positions, efforts in messages[:: 1 if k % 2 else -1]:
            parts.update(stamp, names, positions, efforts)
    assert whole.joints['m'].estimate() == parts.joints['m'].estimate()
    assert parts.joints['m'].used == 200 and parts.joints['m'].incomplete == 0


def test_a_stamp_that_never_gets_all_joints_is_counted():
    mechanisms = bank(model='cart_pendulum', joints=['arm', 'wagon'])
    for k in range(10):
        mechanisms.update(START + k * MS, ('arm',), (0.0,), ())
        if k != 4:
            mechanisms.update(START + k * MS, ('wagon',), (0.0,), (0.0,))
    mechanism = mechanisms.joints['m']
    assert mechanism.used == 9 and mechanism.incomplete == 1


@pytest.mark.parametrize('order', [(0, 1), (1, 0)])
@pytest.mark.parametrize('tolerance', [0.0, 2e-4])
def test_a_sample_of_joints_that_come_apart_has_the_later_stamp(tolerance, order):
    """Whichever message comes first: only then all its positions were measured."""
    mechanisms = bank(model='cart_pendulum', joints=['arm', 'wagon'], pair_tolerance=tolerance)
    messages = [(START, 'arm'), (START + MS // 10, 'wagon')]
    for place in order:
        stamp, joint = messages[place]
        mechanisms.update(stamp, (joint,), (0.0,), (0.0,))
    assert mechanisms.joints['m'].used == int(tolerance > 0.0)
    assert mechanisms.joints['m'].stamp_ns == (START + MS // 10 if tolerance else 0)


def through_a_missing_effort(observer):
    """(velocities, true velocities) of a fast cart-pendulum, the effort missing for 0.15 s, from
    sample 1500 on, while the arm turns by 1 rad.
    """
    positions, truth = motion('cart_pendulum', FAST, (1.37, -0.1), (6.0, 0.35), 1e-3, 1655)
    gains = {'mu': [29.0, 10.0]} if observer == 'smo' else {'bandwidth_hz': 8.0}
    mechanisms = bank(
        observer=observer, model='cart_pendulum', model_parameters=list(FAST), **gains
    )
    mechanism, velocities = mechanisms.joints['m'], []
    for k, position in enumerate(positions.tolist()):
        effort = math.nan if 1500 <= k < 1650 else 0.0
        mechanisms.update(START + k * MS, mechanism.names, position, (effort, effort))
        velocities.append(mechanism.estimate()[1])
    return np.array(velocities), truth


@pytest.mark.parametrize('observer', ['hgo', 'ehgo', 'smo'])
def test_the_velocity_goes_on_where_the_input_comes_back(observer):
    velocities, _ = through_a_missing_effort(observer)
    held = velocities[1499:1650]
    assert np.all(held == held[0])
    assert velocities[1650] == pytest.approx(held[0], abs=0.3)


def test_geso_keeps_the_momenta_while_the_input_is_missing():
    """The cart swings from -2.8 to 2.6 m/s meanwhile, moved by nothing but the turning arm."""
    velocities, truth = through_a_missing_effort('geso')
    assert np.ptp(truth[1500:1650, 1]) > 5.0
    assert np.all(np.max(np.abs(velocities - truth)[1500:], axis=0) < (0.2, 0.05))


def test_without_an_effort_it_coasts_for_a_fifth_of_a_second_and_no_longer():
    mechanisms = bank(model='single_joint', joints=['j'], bandwidth_hz=20.0)
    mechanism, published = mechanisms.joints['m'], []
    for k in range(1400):
        effort = math.nan if k >= 1000 else 0.0
        found = mechanisms.update(START + k * MS, ('j',), (1e-3 * k,), (effort,))
        published.append((mechanism.estimate()[3], bool(valid(found))))
    assert published[999] == (TRACKING, True)
    assert set(published[1000:1190]) == {(COASTING, True)}
    assert set(published[1210:]) == {(NOT_OBSERVABLE, False)}


def test_missing_effort_of_an_unactuated_joint_is_no_error():
    """The cart's effort is there, the pendulum's is nan: estimated. The other way round: not."""
    for efforts, published in (((math.nan, 0.0), True), ((0.0, math.nan), False), ((), False)):
        mechanisms = bank(model='cart_pendulum', bandwidth_hz=20.0)
        for k in range(1000):
            found = mechanisms.update(START + k * MS, ('pendulum', 'cart'), (0.1, 0.0), efforts)
        assert bool(valid(found)) == published
        if not published:
            assert 'no effort for cart' in mechanisms.joints['m'].why()


def test_efforts_of_another_number_than_the_names_are_a_mismatch():
    mechanisms = bank(model='single_joint', joints=['j'])
    for efforts in ((0.1, 0.2), (0.1, 0.2, 0.3)):
        assert mechanisms.update(START, ('j',), (0.1,), efforts) is None
    assert mechanisms.mismatched == 2 and mechanisms.joints['m'].received == 0
    commanded = bank(EFFORT_COMMAND, model='single_joint', joints=['j'])
    commanded.update(START, ('j',), (0.1,), (0.1, 0.2))  # nobody reads them
    assert commanded.mismatched == 0 and commanded.joints['m'].used == 1


def test_a_joint_that_no_longer_comes_is_named():
    mechanisms = bank(model='cart_pendulum', joints=['p', 'c'])
    mechanisms.update(START, ('p', 'c'), (0.1, 0.0), (0.0, 0.0))
    assert mechanisms.why_silent('m') == ''
    mechanisms.update(START + MS, ('p',), (0.1,), (0.0,))
    assert mechanisms.why_silent('m') == 'waiting for c'


def test_joints_whose_stamps_never_agree_are_reported_with_their_distance():
    mechanisms = bank(model='cart_pendulum', joints=['p', 'c'])
    for k in range(60):
        mechanisms.update(START + k * MS, ('p',), (0.1,), ())
        mechanisms.update(START + k * MS + 200_000, ('c',), (0.0,), ())
    assert mechanisms.why_silent('m') == (
        'the stamps of its joints differ by at least 0.0002 s: increase pair_tolerance'
    )
    assert mechanisms.joints['m'].received == 0 < mechanisms.joints['m'].incomplete


def test_several_mechanisms_in_one_stream():
    mechanisms = bank(
        names=('arm', 'cart'),
        bandwidth_hz=20.0,
        overrides={
            'arm': {'joints': ['elbow']},
            'cart': {'model': 'cart_pendulum', 'joints': ['p', 'c'], 'bandwidth_hz': 30.0},
        },
    )
    for k in range(500):
        found = mechanisms.update(
            START + k * MS, ('p', 'elbow', 'c'), (0.1, 1e-3 * k, 0.0), (0.0, 0.0, 0.0)
        )
    assert found.names == ['p', 'elbow', 'c'] and found.efforts == [0.0, 0.0, 0.0]
    assert found.estimates[1][1] == pytest.approx(1.0, abs=1e-3)
    assert [found.measured_position(k) for k in range(3)] == [0.1, 0.499, 0.0]
    arm, cart = mechanisms.joints['arm'].stddev(), mechanisms.joints['cart'].stddev()
    assert found.stddevs([2, 1]) == [(cart[0][1], cart[1][1]), (arm[0][0], arm[1][0])]
    at, readings = START + 500 * MS, (0.0, 0.5, 0.1)
    assert mechanisms.update(at, ('c', 'elbow', 'p'), readings, (0.0,) * 3).names[0] == 'c'


@pytest.mark.parametrize(
    'values, words',
    [
        (
            {'model': 'cart_pendulum', 'joints': ['a']},
            "has 2 joints (pendulum, cart), but 'joints'",
        ),
        ({'model': 'cart_pendulum', 'joints': ['a', 'a']}, 'names a joint twice'),
        ({'input_scale': [1.0, 2.0]}, "'input_scale' has 2 numbers for 1 input"),
        ({'names': ('a', 'a')}, "'mechanisms' names 'a' twice"),
        ({'names': ('a', 'b')}, "'a' and 'b' both have the joint 'joint'"),
        ({'bandwith_hz': 3.0}, "did you mean 'bandwidth_hz'?"),
        ({'overrides': {'arn': {'bandwidth_hz': 3.0}}}, "unknown mechanism 'arn'"),
    ],
)
def test_wrong_settings_are_refused_in_one_line(values, words):
    with pytest.raises(UserError) as error:
        bank(**values)
    assert words in str(error.value)


# Replay of simulated bags: two-sided bounds on the rms of the velocity errors


@pytest.mark.parametrize(
    'words, message',
    [
        (
            ['--observer', 'geso', '--set', 'model=cart_pendulum'],
            'set its joint names with the parameter',
        ),
        (['--observer', 'geso', '--joint', 'a'], '--angle and --joint'),
    ],
)
def test_replay_says_what_is_wrong_in_one_line(words, message, tmp_path, capsys):
    assert (
        cli.main(['simulate', 'pendulum', '--duration', '0.1', '--out', str(tmp_path / 'bag')]) == 0
    )
    capsys.readouterr()
    assert cli.main(['replay', str(tmp_path / 'bag'), *words]) in (1, 2)
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1


def test_the_parameter_file_is_what_the_node_and_replay_take():
    from pathlib import Path

    from estimator_pkg import params_file
    from estimator_pkg.driver.mechanism import MechanismSettings
    from estimator_pkg.parameters import declared
    from estimator_pkg.streams.mechanical import MechanicalSettings, MechanicalStream

    path = Path(__file__).parents[2] / 'config/mechanical_observer.yaml'
    stream = MechanicalStream.of(params_file.load(str(path), 'mechanical_observer'))
    assert stream.observer.name == 'geso' and list(stream.bank.joints) == ['mechanism']
    text = path.read_text()
    wanted = {*declared(MechanicalSettings), *declared(MechanismSettings)} - {'wrap_period'}
    for name in ('geso', 'hgo', 'ehgo', 'smo'):
        wanted |= set(declared(observers.find(name).gains))
    for name in wanted:
        assert f'    {name}: ' in text or f'    #{name}: ' in text, name


@pytest.mark.parametrize('observer', ('geso', 'hgo'))
def test_a_disturbance_can_be_looked_for_from_now_on(observer):
    """A live change of disturbance_hz, both ways: a constant torque of 0.2 N m is found, or not."""
    mechanisms = bank(
        observer=observer,
        model='single_joint',
        model_parameters=['inertia=0.1'],
        joints=['j'],
        bandwidth_hz=5.0,
    )
    mechanism = mechanisms.joints['m']
    error = []
    for k in range(6000):
        if k in (2000, 4000):
            mechanism.set_gains(
                mechanism.gains.__class__(
                    model_parameters=('inertia=0.1',),
                    bandwidth_hz=5.0,
                    disturbance_hz=1.0 if k == 2000 else 0.0,
                )
            )
        mechanisms.update(START + k * MS, ('j',), (1e-6 * k * k,), (0.0,))  # 2 rad/s^2
        error.append(mechanism.estimate()[1][0] - 2e-3 * k)
    assert abs(error[1999]) == pytest.approx(abs(error[5999]), rel=1e-3) and abs(error[1999]) > 0.05
    assert abs(error[3999]) < 1e-3
