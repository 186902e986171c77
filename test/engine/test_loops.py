# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The loops of `entries.LOOPS` give the same numbers compiled and as plain Python."""

import numpy as np
import pytest

from estimator_pkg.engine import calls
from estimator_pkg.evaluation.reference.smoother.cells import used
from sim_pkg.reproduce.adaptive import plant
from sim_pkg.reproduce.pmsm import reference, schemes

pytestmark = pytest.mark.skipif(not calls.available(), reason='no engine was built')
EXAMPLE = plant.VELOCITY
INPUTS = plant.random_input(EXAMPLE, plant.RK4_STEP, 1.0)


def reference_run(kind):
    exact = reference.signals(0.5 * reference.STEP * np.arange(16001.0))
    return reference.reference_run(exact, kind, 90.0, 1500.0)[1:]


def sampled_run(way):
    samples = schemes.drive_samples(2000.0)
    return schemes.sampled_run(samples, 2000.0, way, reference.ID_POST, 90.0, 1500.0)[1:]


CASES = {
    **{name: (reference_run, kind) for kind, name in enumerate(reference.OBSERVERS)},
    **{name: (sampled_run, way) for way, name in enumerate(schemes.NAMES)},
    'continuous': (lambda _: plant.continuous(EXAMPLE, INPUTS, freeze=0.5), None),
    'response': (lambda _: plant.response(EXAMPLE, INPUTS, 1e-3, 0.3), None),
}


@pytest.mark.parametrize('name', CASES)
def test_plain_and_compiled_are_equal(name, monkeypatch):
    made, argument = CASES[name]
    compiled = made(argument)
    monkeypatch.setattr(calls, 'load', lambda: (None, ''))
    for ours, theirs in zip(compiled, made(argument)):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize('plain', [False, True])
def test_arrays_of_any_layout_are_taken_and_filled(plain, monkeypatch):
    if plain:
        monkeypatch.setattr(calls, 'load', lambda: (None, ''))
    readings = np.repeat(np.array([0, 1, 2, 2, 2, 5], np.float32), 2)[::2]
    steps = np.full(6, 0.5)
    steps.flags.writeable = False
    rows, gaps = np.zeros((6, 2), np.int32)[:, 0], np.zeros(7, np.float32)
    assert calls.run(used, 6, readings, steps, 1.0, 9.0, 1.0, rows, gaps) == 5
    assert rows.tolist() == [0, 1, 2, 4, 5, 0]
    assert gaps.tolist() == [0.0, 0.5, 0.5, 1.0, 0.5, 0.0, 0.0]
