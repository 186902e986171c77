# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The comparison with the field: the peers run, and both choices are what they are said to be."""

import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks import __main__ as command
from benchmarks import chart, field, ours, peers, rivals
from benchmarks.columns import Column, driven_by, of_signal, shared
from benchmarks.ours import Estimator
from benchmarks.recordings import recorded
from benchmarks.signals import SIGNALS, Samples, Signal, constant, sine
from estimator_pkg.errors import UsageError

BAGS = Path(__file__).resolve().parents[2] / 'bags'
SINE = next(signal for signal in SIGNALS if signal.name == 'sine')
DROPS = next(signal for signal in SIGNALS if signal.name == 'drops')


def columns():
    return [
        of_signal(Signal('one', 'a sine', sine(5.0, 2.0)), 2.0),
        of_signal(Signal('two', 'constant', constant(3.0)), 2.0),
    ]


def made(name, errors, share=1.0):
    """An estimator that is off by errors[gain][column], and publishes this share."""

    def run(column, value):
        velocity = column.samples.velocity + errors[value][0 if column.name == 'one' else 1]
        velocity[np.arange(len(velocity)) % 10 >= round(10.0 * share)] = np.nan
        return velocity

    return Estimator(name, run, tuple(errors), 'gain')


def test_one_setting_and_the_best_of_each_column():
    found = field.run(
        columns(), [made('x', {1: (1.0, 9.0), 2: (2.0, 2.0), 3: (9.0, 1.0), 4: (math.inf, 0.5)})]
    )
    (row,) = found['rows']
    assert row['setting'] == 2
    assert {name: cell['rms'] for name, cell in row['one'].items()} == pytest.approx(
        {'one': 2.0, 'two': 2.0}
    )
    assert [(cell['rms'], cell['setting']) for cell in row['best'].values()] == [
        (pytest.approx(1.0), 1),
        (pytest.approx(0.5), 4),
    ]
    assert 'gain 2' in field.describe(found, 'the field')


def test_a_late_estimate_is_reported_with_its_delay():
    late = Estimator('late', lambda column, value: np.roll(column.samples.velocity, 20))
    cell = field.run(columns()[:1], [late])['rows'][0]['one']['one']
    assert cell['delay_s'] == pytest.approx(0.020, abs=1e-4)
    text = field.describe(field.run(columns()[:1], [late]), 'the field')
    assert ', 20.0' in text


def test_what_is_not_published_is_not_judged_but_reported():
    found = field.run(
        columns(),
        [made('half', {1: (1.0, 1.0)}, share=0.7), made('hardly', {1: (1.0, 1.0)}, share=0.1)],
    )
    half, hardly = (row['one']['one'] for row in found['rows'])
    assert half['rms'] == pytest.approx(1.0) and 0.3 < half['published'] < 0.9
    assert hardly['rms'] is None
    assert '%)' in field.describe(found, 'the field', as_markdown=True)


def test_an_error_that_the_reference_cannot_tell_is_marked():
    column, _ = columns()
    noisy = Column('one', '', column.samples, column.quantum, noise=0.5)
    found = field.run([noisy], [made('x', {1: (0.4,)}), made('y', {1: (0.7,)})])
    assert [row['one']['one']['cannot_tell'] for row in found['rows']] == [True, False]


def test_every_observer_has_a_row_or_a_reason():
    rows = {each.name for each in [*ours.ours(), *ours.with_input()]}
    for name in (
        'edge_adaptive',
        'hybrid_angle',
        'kalman acceleration',
        'pll',
        'super_twisting',
        'finite_difference',
        'finite_difference, raw',
        'geso',
        'hgo',
        'ehgo',
        'smo',
        'adaptive',
        'switched',
    ):
        assert name in rows
    assert 'pmsm' in ours.NOT_HERE


def test_ours_use_their_gain():
    pll = next(each for each in ours.ours() if each.name == 'pll')
    column = of_signal(SINE, 1.5)
    assert not np.array_equal(pll.run(column, 5.0), pll.run(column, 50.0))


def test_the_torque_is_the_one_that_makes_the_motion():
    """Integrated, it gives the velocity, across dropped samples too."""
    column = of_signal(DROPS, 2.0)
    steps = np.diff(column.samples.stamps) * 1e-9
    gained = np.concatenate([[0.0], np.cumsum(driven_by(column)[1:] * steps)])
    assert column.samples.velocity[0] + gained == pytest.approx(column.samples.velocity)


@pytest.mark.long
@pytest.mark.parametrize(
    'name', ['geso', 'hgo', 'ehgo', 'smo', pytest.param('adaptive', marks=pytest.mark.slow)]
)
def test_who_knows_the_torque_uses_it(name):
    each = next(each for each in ours.with_input() if each.name == name)
    column = of_signal(SINE, 6.0 if name == 'adaptive' else 2.5)
    without = Column('x', '', column.samples, column.quantum)
    right = field.error(each.run(column, each.values[1]), column)
    assert right[0] < 0.05 and right[1] > 0.5
    assert np.isnan(each.run(without, each.values[1])).all()


@pytest.mark.slow
def test_the_peers_that_are_installed_follow_the_motion():
    found, missing = peers.peers()
    if not found:
        pytest.skip(f'not run, not installed: {", ".join(missing)}')
    column = of_signal(DROPS, 2.0)
    for each in found:
        errors = [field.error(each.run(column, value), column)[0] for value in each.values[2::3]]
        assert min(errors) < 0.5, each.name


def test_peers_get_clean_samples_and_their_estimates_stand_at_their_stamps():
    stamps = np.array([5, 5, 3, 8, 9], np.int64) * 1_000_000_000
    angle = np.array([3.0, 3.0, 1.0, -3.0, np.nan])
    column = Column('x', '', Samples(stamps, angle, np.zeros(5)), 0.0)
    rows, time, unwrapped = column.cleaned()
    assert rows.tolist() == [0, 3] and time.tolist() == [0.0, 3.0]
    assert unwrapped == pytest.approx([3.0, 2.0 * math.pi - 3.0])
    assert np.isnan(column.at_rows(rows, np.ones(2))).tolist() == [False, True, True, False, True]


@pytest.mark.long
def test_forward_alone_sees_no_future():
    pytest.importorskip('pynumdiff')
    forward = next(each for each in peers.peers()[0] if each.name == 'PyNumDiff kalman_filter')
    column = of_signal(SINE, 1.5)
    cut = Column('x', '', Samples(*(each[:800] for each in column.samples)), column.quantum)
    assert forward.run(column, 1e7)[:800] == pytest.approx(forward.run(cut, 1e7))


@pytest.mark.long
def test_recordings_are_columns_with_their_reference():
    found, refused = recorded(BAGS)
    by_name = {column.name: column for column in found}
    assert len(found) >= 12 and len(by_name) == len(found)
    elbow = by_name['sys_id_500hz/elbow']
    assert 0.05 < elbow.noise < 0.1 and elbow.torque is None
    pendulum = by_name['sac_200hz_multiturn/pendulum']
    assert pendulum.torque is not None and 0.1 < pendulum.joint['inertia'] < 0.25
    assert by_name['system_identification_300hz/pendulum'].torque is None  # it was made from it
    assert by_name['yx2bag/yaw'].reference == 'the off-line smoother'
    assert 'own error' in refused['yawbag/yaw']
    raw = ours.ours()[-1]
    error = field.error(raw.run(elbow, None), elbow)
    assert error[0] == pytest.approx(0.2, rel=0.1) and error[1] > 0.99


@pytest.mark.long
def test_the_chart(tmp_path):
    found = field.run(columns(), [made('x', {1: (1.0, 9.0)}), made('y', {1: (0.1, 0.2)})])
    chart.draw(found, str(tmp_path / 'field.png'), 'the field')
    assert (tmp_path / 'field.png').read_bytes().startswith(b'\x89PNG')


def test_parts_of_each_group():
    parser = command.argparse.ArgumentParser()
    command.arguments(parser)
    assert command._chosen(parser.parse_args(['accuracy', '--part', 'field'])) == {
        'accuracy': ['field']
    }
    assert command._chosen(parser.parse_args(['--part', 'drive', '--part', 'update'])) == {
        'accuracy': ['drive'],
        'speed': ['update', 'drive'],
    }
    assert set(command._chosen(parser.parse_args([]))) == {'accuracy', 'speed'}
    with pytest.raises(UsageError, match="speed has no part 'field'"):
        command._chosen(parser.parse_args(['speed', '--part', 'field']))


def test_the_shared_set_is_the_columns():
    assert [column.name for column in shared(duration=1.5)] == [s.name for s in SIGNALS]


def test_recordings_that_are_asked_for_must_be_there(tmp_path, capsys):
    words = ['accuracy', '--part', 'recordings', '--bags', str(tmp_path)]
    assert command.main(words) == 1
    assert f'{tmp_path} contains no bag with' in capsys.readouterr().err


def test_every_loss_beside_the_rivals_is_printed(tmp_path):
    laws = [
        made(rivals.MAIN, {1: (1.0, 1.0)}),
        made('worse', {1: (4.0, 4.0)}),
        made('mixed', {1: (0.25, 4.0)}),
        made('silent', {1: (1.0, 1.0)}, share=0.1),
    ]
    found = {'shared': field.run(columns(), laws), 'captures': field.run(columns(), laws[:2])}
    assert rivals.ratios(found['shared'], 'mixed') == pytest.approx(
        {'one': 0.26 / 1.01, 'two': 4.01 / 1.01}
    )
    rows = rivals.rivals(found)
    text = rivals.describe(rows)
    lines = {line.split('  ')[0]: line.split() for line in text.splitlines()}
    assert lines['worse'] == ['worse', '3.97', '3.97', 'none']
    assert lines['mixed'] == ['mixed', '1.01', '-', 'one', '0.26']
    assert lines['silent'] == ['silent', '-', '-', 'none'] and rivals.MAIN not in lines
    rivals.draw(rows, str(tmp_path / 'rivals.png'))
    assert (tmp_path / 'rivals.png').stat().st_size > 5000
