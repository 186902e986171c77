# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""`--part faults` and `--part soak`: what is counted, what is reported, what comes twice."""

import numpy as np
import pytest

from benchmarks import faults
from benchmarks.soak import soak


@pytest.mark.parametrize(
    'name, counted, reported',
    [
        ('none', {}, []),
        ('each 50th message twice', {'duplicate': 100}, []),
        ('each 50th overtakes the next', {'late': 100}, []),
        ('each 50th without a stamp', {'zero_stamp': 100}, []),
        ('one reading 1 rad wrong each 2 s', {}, ['`glitch`']),
    ],
)
def test_a_fault_is_counted_or_reported_and_no_estimate_is_wrong(name, counted, reported):
    sent = faults.Stream(*faults.SIGNAL.samples(duration=5.0))
    row = faults.judged(faults.FAULTS[name](sent, np.random.default_rng(1)))
    assert row['counted'] == counted and row['reported'] == reported
    assert row['published'] > 0.97 and row['wrong'] == 0.0 and row['covered'] > 0.9


@pytest.mark.slow
def test_a_short_soak_loses_nothing_silently_and_answers_once():
    rows = soak(0.7)
    assert all(row['ok'] is not False for row in rows), rows
    published = next(row['value'] for row in rows if row['name'] == 'messages published')
    assert published > 5000
