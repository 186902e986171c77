"""The comparison with the field: the peers run, and both choices are what they are said to be."""

import math

import numpy as np
import pytest

from estimator_pkg.evaluation import bench_field
from estimator_pkg.evaluation.signals import SIGNALS, Signal, constant, sine

SHORT = (Signal('one', 'a sine', sine(5.0, 2.0)), Signal('two', 'constant', constant(3.0)))


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(bench_field, 'DURATION', 2.0)


def made(name, errors):
    """An estimator that is off by errors[gain][signal]."""
    def estimate(samples, value):
        moves = float(np.std(samples.velocity)) > 0.1
        return samples.velocity + errors[value][0 if moves else 1]
    return bench_field.Estimator(name, estimate, tuple(errors))


def test_one_setting_and_the_best_of_each_column():
    found = bench_field.run([made('x', {1: (1.0, 9.0), 2: (2.0, 2.0), 3: (9.0, 1.0),
                                        4: (math.nan, 0.5)})], SHORT)
    row, = found['rows']
    assert row['setting'] == 2
    assert row['one'] == pytest.approx({'one': 2.0, 'two': 2.0})
    assert row['best'] == pytest.approx({'one': 1.0, 'two': 0.5})
    assert row['best_at'] == {'one': 1, 'two': 4}
    assert '2 | 1' in bench_field.describe(found)


def test_ours_are_all_there_and_use_their_gain():
    names = {each.name for each in bench_field.ours()}
    assert {'hybrid_angle', 'kalman acceleration', 'pll', 'finite_difference'} <= names
    pll = next(each for each in bench_field.ours() if each.name == 'pll')
    samples = SIGNALS[1].samples(duration=1.0)
    assert not np.array_equal(pll.estimate(samples, 5.0), pll.estimate(samples, 50.0))


def test_the_peers_that_are_installed_follow_the_motion():
    found, missing = bench_field.peers()
    if not found:
        pytest.skip(f'not run, not installed: {", ".join(missing)}')
    samples = SIGNALS[1].samples(duration=2.0)
    for each in found:
        errors = [bench_field._error(each, samples, value) for value in each.values[2::3]]
        assert min(errors) < 0.5, each.name


def test_the_chart(tmp_path):
    found = bench_field.run([made('x', {1: (1.0, 9.0)}), made('y', {1: (0.1, 0.2)})], SHORT)
    bench_field.draw(found, str(tmp_path / 'field.png'))
    assert (tmp_path / 'field.png').read_bytes().startswith(b'\x89PNG')
