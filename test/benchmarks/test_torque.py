# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What a reported torque is worth on the recorded pendulums: docs/papers/mechanical.md, held."""

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import torque
from benchmarks.torque import STUDIES
from estimator_pkg.engine.calls import available

BAGS = Path(__file__).parents[2] / 'bags'

pytestmark = pytest.mark.skipif(not available(), reason='slow without the engine')


@pytest.mark.slow
def test_the_torque_helps_on_the_elbow_of_the_double_pendulum():
    """At the settings that are best of the whole grid; and it is the torque that does it."""
    few = replace(STUDIES[3], bandwidths=(55.0, 70.0), disturbances=(4.0,))
    shoulder, elbow = torque.study(BAGS, few, ('hybrid_angle',))
    assert elbow.explained > 0.98
    assert 0.72 < elbow.ratio < 0.84
    assert elbow.torque.delay <= elbow.angle.delay + torque.CLOSE
    assert elbow.torque.error < 0.95 * elbow.without.error < 0.95 * elbow.angle.error
    assert shoulder.angle.error == 0.0  # below the reference's noise: nothing can be said
    assert '0.79' in torque.text([elbow])
