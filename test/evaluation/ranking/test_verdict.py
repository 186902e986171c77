# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Ranking without truth: the tests of pairs, and the sentences of a verdict."""

import dataclasses
import math

import numpy as np
import pytest

from estimator_pkg.evaluation import pairs
from estimator_pkg.evaluation.ranking.ranking import rank
from estimator_pkg.evaluation.ranking.verdict import NEVER_SHOWN, ComparedPair, Verdict
from estimator_pkg.evaluation.reference.motion import motion


def difference(squares, others, block):
    return pairs.of_sums([np.bincount(block, squares - others)], [np.bincount(block)])


def test_the_quantile_is_students():
    scipy = pytest.importorskip('scipy.stats')
    for degrees in (7, 10, 20, 39, 400):
        assert pairs.student(degrees) == pytest.approx(scipy.t.ppf(0.975, degrees), rel=1e-3)


def test_equal_estimates_are_declared_different_in_one_of_twenty_cases():
    """Correlated within blocks, as errors of estimates are."""
    random = np.random.default_rng(3)
    time = np.arange(4000) * 1e-3
    block = pairs.blocks(time)
    assert block[0] == 0 and block[-1] == 14  # at least 0.25 s each
    declared = 0
    for _ in range(600):
        a, b = (np.convolve(random.normal(size=4063), np.ones(64) / 8.0, 'valid') for _ in 'ab')
        declared += difference(a**2, b**2, block).sign != 0
    assert 0.02 <= declared / 600 <= 0.08


def test_the_sentences_of_a_verdict():
    found = Verdict(
        'edge_adaptive',
        'hybrid_angle',
        ('kalman',),
        {'edge_adaptive': 0.21, 'kalman': 0.215, 'hybrid_angle': 0.34, 'pll': 0.4},
        (
            ComparedPair('edge_adaptive', 'kalman', 0, 2.4, 3.6),
            ComparedPair('edge_adaptive', 'hybrid_angle', 1, 62.0, 5.0),
            ComparedPair('edge_adaptive', 'pll', 1, 90.0, 5.0),
        ),
    )
    assert found.sentences() == [
        'edge_adaptive is best: 0.21 rad/s rms; hybrid_angle makes 0.34, 62 % more '
        '(95 % sure): use edge_adaptive.',
        'edge_adaptive is better than hybrid_angle and pll (95 %).',
        'edge_adaptive and kalman cannot be distinguished: within 6 %.',
        NEVER_SHOWN[0].upper() + NEVER_SHOWN[1:] + '.',
    ]
    assert found.choice == 'edge_adaptive'
    assert found.better('pll', 'edge_adaptive') == -1 and found.better('kalman', 'pll') == 0


def pair_of(difference, sign, *events):
    """A verdict on `pll` and the default, whose error is larger by `difference` [%]."""
    return Verdict(
        'pll',
        'edge_adaptive',
        () if sign else ('edge_adaptive',),
        {'pll': 0.2, 'edge_adaptive': 0.2 * (1.0 + difference / 100.0)},
        (ComparedPair('pll', 'edge_adaptive', sign, difference, 5.0, events),),
    )


def test_the_default_is_kept_where_it_cannot_be_told_apart_and_loses_less_than_3_percent():
    found = pair_of(1.0, 0)
    assert found.choice == 'edge_adaptive'
    assert found.sentences()[0] == 'All are equal within 6 % here: keep edge_adaptive.'
    for difference, sign, known in ((1.0, 1, '95 % sure'), (15.0, 0, 'not significant')):
        found = pair_of(difference, sign)
        assert found.choice == 'pll'
        more = f'{difference:.2g} % more ({known}): use pll.'
        assert found.sentences()[0].endswith(more)
    assert 'cannot be distinguished: within 20 %' in found.sentences()[1]


def test_a_few_events_that_decide_are_named():
    said = (
        'Few events decide: half of the difference of pll and edge_adaptive is at 3.25 s and 9 s.'
    )
    assert said in pair_of(15.0, 0, 3.25, 9.0).sentences()
    assert said in pair_of(1.0, 0, 3.25, 9.0).sentences()
    assert said not in pair_of(15.0, 1, 3.25, 9.0).sentences()
    one = np.full(40, 1.0)
    assert pairs.events(one).size == 0
    one[[30, 7]] = 40.0, -90.0
    assert pairs.events(one).tolist() == [7]
    one[9] = 60.0
    assert pairs.events(one).tolist() == [7, 9]


def swinging(counts=8e4):
    """The motion that 16 s of counted readings show."""
    time = np.arange(8000) * 2e-3
    stamps = np.rint(time * 1e9).astype(np.int64) + 10**18
    return motion(stamps, np.floor(counts * np.sin(5.0 * time)) / counts, 0.0)


def test_the_events_are_where_one_estimate_is_wrong():
    found = swinging()
    time = found.time
    wrong = found.velocity + 0.1
    wrong[(time > 9.0) & (time < 9.2)] += 2.0
    verdict = rank({'a': found.velocity + 0.1, 'b': wrong}, found, default='b')
    (pair,) = verdict.pairs
    assert not pair.sign and verdict.choice == 'a' and len(pair.events) == 1
    assert pair.events[0] == pytest.approx(9.1, abs=0.4)


@pytest.mark.parametrize('other, sign', [(0.0504, 0), (0.0516, 1)])
def test_estimates_that_print_the_same_error_are_not_ranked(other, sign):
    """Both differences are significant; 0.05 and 0.0504 are printed as 0.05."""
    found = swinging()
    verdict = rank({'a': found.velocity + 0.05, 'b': found.velocity + other}, found, default='b')
    assert verdict.pair('a', 'b').sign == sign
    assert ('b' in verdict.ties) == (sign == 0) and verdict.choice == ('b' if not sign else 'a')


def test_without_a_reference_the_default_is_the_choice():
    found = rank({'pll': np.zeros(0)}, None, default='edge_adaptive')
    assert (found.best, found.choice, found.tunable) == ('', 'edge_adaptive', False)
    assert found.sentences()[0] == (
        'No ranking: there are too few readings; use edge_adaptive as it is.'
    )


def test_where_readings_must_be_mended_first_nothing_is_recommended():
    found = swinging()
    verdict = rank(
        {'a': found.velocity + 0.1}, dataclasses.replace(found, unseen=0.75), default='a'
    )
    assert verdict.choice == '' and 'use a' not in ' '.join(verdict.sentences())
    assert verdict.sentences()[0].startswith('No ranking: 75% of the readings have no reference')


def test_a_default_without_estimates_is_not_recommended():
    found = swinging(800.0)
    both = {'a': found.velocity + 0.1, 'b': found.velocity - 0.1}
    both['c'] = np.full(len(found.time), np.nan)
    verdict = rank(both, found, default='c')
    assert verdict.unranked == ('c',) and verdict.default == '' and verdict.choice == verdict.best
    assert verdict.sentences()[0].startswith('All are equal within')
    assert 'keep' not in verdict.sentences()[0]


@pytest.mark.parametrize('count', [0, 1, 13, 40, 200])
def test_any_readings_give_a_verdict(count):
    stamps = 10**18 + np.arange(count) * 5_000_000
    random = np.random.default_rng(0)
    for angle in (
        np.sin(0.05 * np.arange(count)),
        np.zeros(count),
        np.full(count, np.nan),
        random.uniform(-3.0, 3.0, count),
    ):
        found = motion(stamps, angle, 2.0 * math.pi)
        size = 0 if found is None else len(found.stamps)
        both = {'a': np.zeros(size), 'b': np.full(size, 0.1)}
        verdict = rank(both, found, default='a', motion_hz=1.0)
        assert verdict.sentences() and verdict.as_dict()['choice'] in both
