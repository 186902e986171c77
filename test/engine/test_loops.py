# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The loops of `entries.LOOPS` take arrays of any layout."""

import numpy as np
import pytest

from estimator_pkg.engine import calls
from estimator_pkg.evaluation.reference.smoother.cells import used

pytestmark = pytest.mark.skipif(not calls.available(), reason='no engine was built')


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
