# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The laws of the field are what their papers say, and each has its one setting for a set."""

import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks import __main__ as command
from benchmarks import field
from benchmarks.columns import Column, of_signal
from benchmarks.laws import Law, peers
from benchmarks.runner import chosen, printed
from benchmarks.signals import SIGNALS, Samples, Signal, constant, sine

BAGS = Path(__file__).resolve().parents[2] / 'bags'
SINE = next(signal for signal in SIGNALS if signal.name == 'sine')
DROPS = next(signal for signal in SIGNALS if signal.name == 'drops')
H, QUANTUM = 1e-3, 2e-3
TIME = np.arange(2000) * H


def counted(angle):
    return np.round(angle / QUANTUM) * QUANTUM


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
    hardly = made('y', {1: (1.0, 1.0)}, share=0.1)
    away = Law('away', law.run, law.values, without=('shared',))
    found = chosen([law, hardly, away], {'shared': columns()})
    setting, errors = found['x']['shared']
    assert setting == 2 and errors == pytest.approx([2.0, 2.0])
    assert found['y']['shared'][1].tolist() == [math.inf, math.inf]  # what is published
    assert found['away'] == {}


@pytest.mark.slow
def test_the_libraries_that_are_installed_follow_the_motion():
    found, missing = peers()
    column = of_signal(DROPS, 2.0)
    for each in found[-2:]:
        errors = [column.error(each.run(column, value))[0] for value in each.values[2::3]]
        assert min(errors) < 0.5, each.name
    assert len(found) == 8 - len(missing)


def test_peers_get_clean_samples_and_their_estimates_stand_at_their_stamps():
    stamps = np.array([5, 5, 3, 8, 9], np.int64) * 1_000_000_000
    angle = np.array([3.0, 3.0, 1.0, -3.0, np.nan])
    column = Column('x', Samples(stamps, angle, np.zeros(5)), 0.0)
    rows, time, unwrapped = column.cleaned()
    assert rows.tolist() == [0, 3] and time.tolist() == [0.0, 3.0]
    assert unwrapped == pytest.approx([3.0, 2.0 * math.pi - 3.0])
    assert np.isnan(column.at_rows(rows, np.ones(2))).tolist() == [False, True, True, False, True]


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
    rows = chosen(every, sets)
    del rows['mixed']['captures']  # it was not run there
    found = field.compared(rows, sets)
    assert found[1]['lost'] == pytest.approx({'one': 0.26 / 1.01})
    text = printed(field.describe(found))
    lines = {line.split('  ')[0]: line.split() for line in text.splitlines()}
    assert lines['worse'] == ['worse', '3.97', '3.97', 'none']
    assert lines['mixed'] == ['mixed', '1.01', '-', 'one', '0.26']
    assert lines['silent'] == ['silent', '-', '-', 'none'] and field.MAIN not in lines


@pytest.mark.long
def test_every_law_of_practice_follows_a_constant_speed():
    stamps = 10**9 + (TIME * 1e9).astype(np.int64)
    column = Column('x', Samples(stamps, counted(1.3 * TIME), np.full(len(TIME), 1.3)), QUANTUM)
    for law in peers()[0][:-2]:
        errors = [
            np.sqrt(np.nanmean((law.run(column, value)[1000:] - 1.3) ** 2)) for value in law.values
        ]
        assert min(errors) < 0.02, law.name  # a raw difference has 1.0


def test_the_slope_at_the_end_of_a_parabola_is_exact_for_one():
    """At even and at uneven times."""
    law = next(each for each in peers()[0] if each.name == 'Savitzky-Golay, causal')
    for jitter in (0.0, 0.3):
        time = TIME + jitter * H * np.random.default_rng(1).random(len(TIME))
        samples = Samples(np.rint(1e9 + 1e9 * time).astype(np.int64), 0.4 * time**2, 0.8 * time)
        column = Column('x', samples, QUANTUM, period=0.0)
        found = law.run(column, 14 * H)[100:]
        np.testing.assert_allclose(found, samples.velocity[100:], atol=1e-5)
