# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The clock of the edge-aware observer: which stamps and which repeated readings it believes."""

import pytest

from estimator_pkg.circle import Circle
from estimator_pkg.observers.angle.edge import observer

PACE = 1e-3
QUANTUM = 1e-3


def test_a_shaft_that_stops_soon_after_a_start_is_seen_to_stop():
    design = observer.design(observer.Gains(quantum=QUANTUM), Circle())
    state, coefficients, reading = observer.State(), observer.Coefficients(), 0.0
    observer.prepare(coefficients, design, PACE)
    observer.start(observer, state, design, 0.0)
    for i in range(60):
        reading += 20.0 * QUANTUM if i < 50 else 0.0
        observer.step(observer, state, coefficients, design, reading, 0.0)
    assert state.motion.angle == pytest.approx(reading, abs=2.0 * QUANTUM)
    assert abs(state.motion.velocity) < 20.0 * QUANTUM / PACE * 0.2
