# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The four injections of the paper, and a user's own held to Assumption 1."""

import math
import sys

import numpy as np
import pytest

from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.errors import UsageError
from estimator_pkg.observers.angle.hybrid import injections
from estimator_pkg.observers.angle.hybrid.design import Design
from estimator_pkg.observers.angle.hybrid.observer import HybridAngle

TURN = 2.0 * math.pi
MARGIN = math.radians(5.0)

OWN = """
import math

def steeper(e):
    return math.sin(e) * (1.0 + 0.2 * math.sin(e) ** 2)

def jumps_within_the_margin(e):
    w = (e + math.pi) % (2.0 * math.pi) - math.pi
    return w if abs(w) < math.pi - 0.05 else 0.1 * w

def with_a_list(e):
    return math.fsum([math.sin(e)])

def whole_numbers_too(e):
    return 0 if e == 0 else 2.0 * math.tan(0.5 * e)

def twice_the_slope(e):
    return 2.0 * math.sin(e)

def no_slope(e):
    return math.sin(e) ** 3

def wrong_sign_beyond_a_quarter(e):
    return 0.5 * math.sin(2.0 * e)

def wrong_sign_near_half_a_turn(e):
    w = (e + math.pi) % (2.0 * math.pi) - math.pi
    return math.sin(w) if abs(w) < math.pi - 0.05 else -0.1 * w

def not_periodic(e):
    return e

def steps_down(e):
    w = (e + math.pi) % (2.0 * math.pi) - math.pi
    return w if abs(w) < 1.0 else 0.3 * w

def steps_down_at_the_margin(e):
    w = (e + math.pi) % (2.0 * math.pi) - math.pi
    return w if w < math.pi - math.radians(5.0) - 1e-4 else 0.3 * w

def infinite(e):
    return math.sin(e) if abs(e) < 2.0 else math.inf

def fails(e):
    return math.sqrt(1.0 - e * e)

no_function = 3
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    (tmp_path / 'own_injections.py').write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)
    yield lambda name: f'own_injections:{name}'
    sys.modules.pop('own_injections', None)


def function(name):
    """(error, period, limit) -> injection."""
    design = Design()
    design.injection = injections.find(name, margin=MARGIN)

    def injection(error, period, limit):
        design.shared.period, design.saturation = period, limit
        return injections.inject(error, design)

    return injection


def test_values_are_the_papers():
    sin, tan, saw, sat = map(function, ('sin', 'tan', 'saw', 'sat'))
    assert sin(1.0, TURN, 1.0) == pytest.approx(math.sin(1.0))
    assert tan(1.0, TURN, 1.0) == pytest.approx(2.0 * math.tan(0.5))
    assert saw(4.0, TURN, 1.0) == pytest.approx(4.0 - TURN)
    assert sat(0.4, TURN, 1.0) == pytest.approx(0.4)
    assert sat(2.0, TURN, 1.0) == 1.0
    assert sat(-2.0, TURN, 0.03) == -0.03


@pytest.mark.parametrize('name', injections.INJECTIONS)
def test_built_in_ones_keep_assumption_1(name):
    found = function(name)
    injections.check_assumption_1(lambda error: found(error, TURN, 1.0), MARGIN, name)


def test_another_period_scales_one_of_the_user(own):
    found = function(own('steeper'))
    for error in (-0.4, 0.1, 0.3):
        assert found(error, 1.0, 1.0) == pytest.approx(found(error * TURN, TURN, 1.0) / TURN)
        assert found(error * TURN, TURN, 1.0) != error * TURN


@pytest.mark.parametrize(
    'name', ['steeper', 'jumps_within_the_margin', 'with_a_list', 'whole_numbers_too']
)
def test_a_good_one_serves(own, name):
    joint = Joint(
        HybridAngle,
        HybridAngle.gains(injection=own(name), order=2, bandwidth_hz=5.0),
        JointSettings(),
    )
    velocity = np.where(np.arange(2000) < 1000, 10.0, 40.0)  # a step, for large errors
    angle = np.cumsum(velocity) * 1e-3
    stamps = 10**18 + np.arange(2000) * 10**6
    out = joint.run(stamps, (angle + math.pi) % TURN - math.pi)
    assert abs(out.velocity[-1] - 40.0) < 1e-3


@pytest.mark.parametrize(
    'name, reason',
    [
        ('twice_the_slope', 'item 4: slope at zero is 2, not 1'),
        ('no_slope', 'item 4: slope at zero'),
        ('wrong_sign_beyond_a_quarter', 'item 2: error times injection is not positive'),
        ('wrong_sign_near_half_a_turn', 'item 2: error times injection is not positive at 3.09'),
        ('not_periodic', 'item 3: not 2 pi periodic'),
        ('steps_down', 'item 1: jumps near -0.999'),
        ('steps_down_at_the_margin', 'item 1: jumps near 3.054'),
        ('infinite', 'item 1: not finite'),
        ('fails', 'fails at -3.05.* rad: math domain error'),
        ('no_function', 'is no function'),
        ('not_there', "has no 'not_there'"),
    ],
)
def test_a_bad_one_is_refused_with_the_reason(own, name, reason):
    with pytest.raises(UsageError, match=reason) as refused:
        Joint(HybridAngle, HybridAngle.gains(injection=own(name)), JointSettings())
    assert '\n' not in str(refused.value)
