# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The comparison with the field: the peers run, and each law has its one setting."""

import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks import __main__ as command
from benchmarks import field, laws, recorded
from benchmarks.columns import Column, of_signal
from benchmarks.laws import Law
from benchmarks.signals import SIGNALS, Samples, Signal, constant, sine

BAGS = Path(__file__).resolve().parents[2] / 'bags'
SINE = next(signal for signal in SIGNALS if signal.name == 'sine')
DROPS = next(signal for signal in SIGNALS if signal.name == 'drops')


def columns():
    return [
        of_signal(Signal('one', 'a sine', sine(5.0, 2.0)), 2.0),
        of_signal(Signal('two', 'constant', constant(3.0)), 2.0),
    ]


def made(name, errors, share=1.0):
    """A law that is off by errors[gain][column], and publishes this share."""

    def run(column, value):
        velocity = column.samples.velocity + errors[value][0 if column.name == 'one' else 1]
        velocity[np.arange(len(velocity)) % 10 >= round(10.0 * share)] = np.nan
        return velocity

    return Law(name, run, tuple(errors), 'gain')


def test_a_law_has_one_setting_for_a_set():
    law = made('x', {1: (1.0, 9.0), 2: (2.0, 2.0), 3: (9.0, 1.0), 4: (math.inf, 0.5)}, share=0.7)
    row, hardly = field.run({'shared': columns()}, [law, made('y', {1: (1.0, 1.0)}, share=0.1)])
    assert row['settings'] == {'shared': 2}
    assert row['errors']['shared'] == pytest.approx({'one': 2.0, 'two': 2.0})
    assert hardly['errors']['shared'] == {'one': math.inf, 'two': math.inf}  # what is published


def test_peers_are_not_run_on_captures():
    law = Law('peer', made('', {1: (1.0, 1.0)}).run, (1,), 'gain', laws.PEERS)
    (row,) = field.run({field.SIGNALS: columns(), field.CAPTURES: columns()}, [law])
    assert list(row['errors']) == [field.SIGNALS]


def test_every_observer_of_an_angle_is_a_law_and_uses_its_gain():
    every = {law.name: law for law in laws.ours()}
    names = 'edge_adaptive', 'hybrid_angle', 'kalman acceleration', 'pll', 'super_twisting'
    assert {*names, 'finite_difference', 'finite_difference, raw'} <= set(every)
    column = of_signal(SINE, 1.5)
    assert not np.array_equal(every['pll'].run(column, 5.0), every['pll'].run(column, 50.0))


@pytest.mark.slow
def test_the_peers_that_are_installed_follow_the_motion():
    found, missing = laws.peers()
    if not found:
        pytest.skip(f'not run, not installed: {", ".join(missing)}')
    column = of_signal(DROPS, 2.0)
    for each in found:
        errors = [column.error(each.run(column, value))[0] for value in each.values[2::3]]
        assert min(errors) < 0.5, each.name


def test_peers_get_clean_samples_and_their_estimates_stand_at_their_stamps():
    stamps = np.array([5, 5, 3, 8, 9], np.int64) * 1_000_000_000
    angle = np.array([3.0, 3.0, 1.0, -3.0, np.nan])
    column = Column('x', Samples(stamps, angle, np.zeros(5)), 0.0)
    rows, time, unwrapped = column.cleaned()
    assert rows.tolist() == [0, 3] and time.tolist() == [0.0, 3.0]
    assert unwrapped == pytest.approx([3.0, 2.0 * math.pi - 3.0])
    assert np.isnan(column.at_rows(rows, np.ones(2))).tolist() == [False, True, True, False, True]


@pytest.mark.long
def test_recordings_are_columns_with_their_reference():
    found = recorded.columns(BAGS)
    by_name = {column.name: column for column in found}
    assert len(found) >= 12 and len(by_name) == len(found)
    elbow = by_name['sys_id_500hz/elbow']
    assert 0.05 < elbow.noise < 0.1
    assert by_name['yx2bag/yaw'].reference == 'the off-line smoother'
    error = elbow.error(laws.ours()[-1].run(elbow, None))
    assert error[0] == pytest.approx(0.2, rel=0.1) and error[1] > 0.99


def test_recordings_that_are_requested_must_be_there(tmp_path, capsys):
    assert command.main(['--part', 'field', '--bags', str(tmp_path)]) == 1
    assert f'{tmp_path} contains no bag with' in capsys.readouterr().err


def test_every_loss_is_printed():
    every = [
        made(field.MAIN, {1: (1.0, 1.0)}),
        made('worse', {1: (4.0, 4.0)}),
        made('mixed', {1: (0.25, 4.0)}),
        made('silent', {1: (1.0, 1.0)}, share=0.1),
    ]
    sets = {'shared': columns(), 'captures': columns()}
    rows = field.run(sets, every)
    del rows[2]['errors']['captures']  # it was not run there
    found = field.compared(rows, sets)
    assert found[1]['lost'] == pytest.approx({'one': 0.26 / 1.01})
    text = field.describe(found)
    lines = {line.split('  ')[0]: line.split() for line in text.splitlines()}
    assert lines['worse'] == ['worse', '3.97', '3.97', 'none']
    assert lines['mixed'] == ['mixed', '1.01', '-', 'one', '0.26']
    assert lines['silent'] == ['silent', '-', '-', 'none'] and field.MAIN not in lines
