# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Each planted fault is named, and none is on clean readings."""

import math

import numpy as np
import pytest

from docs.tools import checks
from estimator_pkg.evaluation.checks.joint import CHECKS, checked
from estimator_pkg.evaluation.checks.readings import Readings
from estimator_pkg.evaluation.checks.row import FAIL, PASS

TURN = 2.0 * math.pi
RATE, SECONDS, COUNT = 500.0, 12.0, TURN / 4096
START = 1_700_000_000_000_000_000


def clean(motion='sines', rate=RATE, count=COUNT, wrapped=True, noise=0.0, seed=1):
    """(stamps [ns], arrival [ns], position) of a joint without any fault."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(SECONDS * rate)) / rate
    if motion == 'sines':
        angle = 4.0 * np.sin(TURN * 0.3 * t) + 0.4 * np.sin(TURN * 1.7 * t)
    elif motion == 'trapezoid':
        speed = 12.0 * np.clip(1.5 * np.sin(TURN * 0.25 * t), -1.0, 1.0)
        angle = np.cumsum(speed) / rate
    elif motion == 'moves and rests':
        angle = np.interp(t, [0, 2, 3, 5, 5.5, 8, 9, 12], [0, 0, 2, 2, -1, -1, 0.5, 0.5])
    elif motion == 'creep':
        angle = 0.02 * t + 0.01 * np.sin(TURN * 0.2 * t)
    else:  # constant speed
        angle = 7.3 * t
    angle = angle + noise * rng.standard_normal(len(t))
    if count:
        angle = np.round(angle / count) * count
    if wrapped:
        angle = (angle + math.pi) % TURN - math.pi
    stamps = START + np.round(t * 1e9).astype(np.int64)
    arrival = stamps + 300_000 + np.round(5e4 * rng.standard_exponential(len(t))).astype(np.int64)
    return stamps, arrival, angle


def look(stamps, arrival, angle, period=TURN):
    """The findings by check."""
    seen = Readings('joint', stamps, arrival, angle, np.full(len(angle), np.nan), period, START)
    return {each.check: each for each in checked(seen)}


def named(found):
    """The checks that do not pass."""
    return {name for name, each in found.items() if each.level != PASS}


CLEAN = {
    'sines': {},
    'multi-turn': {'wrapped': False},
    'trapezoid': {'motion': 'trapezoid'},
    'moves and rests': {'motion': 'moves and rests'},
    'creep': {'motion': 'creep'},
    'constant speed': {'motion': 'constant speed'},
    'float': {'count': 0.0},
    'float with noise': {'count': 0.0, 'noise': 3e-4},
    'noise of two counts': {'noise': 2.0 * COUNT},
    'fine, 1 kHz': {'rate': 1000.0, 'count': TURN / 2**17},
    'slow rate': {'rate': 50.0, 'motion': 'moves and rests'},
}


@pytest.mark.parametrize('case', CLEAN)
def test_clean_readings_pass(case):
    assert named(look(*clean(**CLEAN[case]))) == set()


COUNTED = round(RATE * SECONDS)


def picked(rows):
    """Only these samples."""
    return lambda s, a, y: (s[rows], a[rows], y[rows])


def stamped(change):
    """Other stamps."""
    return lambda s, a, y: (change(s.copy()), a, y)


def read(change):
    """Other readings."""
    return lambda s, a, y: (s, a, change(y.copy()))


def put(rows, value):
    def change(values):
        values[rows] = value
        return values

    return change


def add(rows, value):
    return lambda values: put(rows, values[rows] + value)(values)


def noise(seed, size):
    return np.random.default_rng(seed).normal(0.0, size, COUNTED)


def arrival_stamps(s, a, y):
    """Stamps of a busy receiver: most at once, some late together."""
    late = np.random.default_rng(3).exponential(6e5, len(s)).astype(np.int64)
    return np.maximum.accumulate(s + late), a + 5_000_000, y


def out_of_order(s, a, y):
    order = np.arange(len(s))
    order[200::100], order[201::100] = order[201::100].copy(), order[200::100].copy()
    return s[order], a, y[order]


def some_repeated(y):
    again = np.flatnonzero(np.random.default_rng(5).random(len(y)) < 0.03)[1:]
    return put(again, y[again - 1])(y)


def sticking(y):
    for at in range(500, len(y) - 50, 1000):
        y[at : at + 25] = y[at]
    return y


def flip(y):
    return (add(slice(2600, 2700), 3.1)(y) + math.pi) % TURN - math.pi


SOURCES = {'wrap', 'resolution', 'repeated readings'}
FAULTS = {  # what is planted, the check that names it, and others that may
    'rate change': (picked(np.r_[0:3000, 3000:COUNTED:2]), 'rate', set()),
    'stamps that err by half of the sample time': (
        stamped(lambda s: s + noise(3, 1e6).astype(np.int64)),
        'lying stamps',
        {'jitter', 'order of stamps', 'repeated stamps', 'holes'},
    ),
    'irregular stamps': (
        stamped(lambda s: s + noise(3, 1e6).astype(np.int64)),
        'jitter',
        {'lying stamps', 'order of stamps', 'repeated stamps', 'holes'},
    ),
    'stamps of arrival': (arrival_stamps, 'lying stamps', {'jitter', 'repeated stamps'}),
    'holes': (picked(np.r_[0:2000, 2060:4000, 4030:COUNTED]), 'holes', set()),
    'lost': (
        picked(np.flatnonzero(np.random.default_rng(4).random(COUNTED) > 0.03)),
        'holes',
        set(),
    ),
    'repeated stamps': (
        stamped(lambda s: put(slice(100, None, 50), s[99:-1:50])(s)),
        'repeated stamps',
        {'holes'},
    ),
    'out of order': (out_of_order, 'order of stamps', set()),
    'a loop': (
        stamped(add(slice(3000, None), -5_000_000_000)),
        'order of stamps',
        {'clock', 'jumps'},
    ),
    'a stray stamp': (stamped(add(2500, 3600 * 10**9)), 'order of stamps', set()),
    'no stamp': (stamped(put(slice(None, None, 7), 0)), 'missing stamps', {'holes', 'rate'}),
    'drift': (stamped(lambda s: START + ((s - START) * 1.02).astype(np.int64)), 'clock', set()),
    'stamps ahead': (stamped(lambda s: s + 40_000_000), 'clock', set()),
    'late arrival': (lambda s, a, y: (s, a + 120_000_000, y), 'clock', set()),
    'not finite': (read(put(slice(700, 720), np.nan)), 'finite readings', {'holes'}),
    'each three times': (
        read(lambda y: y[np.arange(COUNTED) // 3 * 3]),
        'repeated readings',
        set(),
    ),
    'some repeated': (read(some_repeated), 'repeated readings', set()),
    'sticking': (read(sticking), 'sticking sensor', set()),
    'flip': (read(flip), 'jumps', set()),
    'outliers': (read(add([800, 1700, 4100], 0.5)), 'jumps', set()),
    'slipped': (read(add(slice(3500, None), 0.2)), 'jumps', set()),
    'degrees': (read(np.degrees), 'wrap', {'jumps'}),
    'behind a gear of 1 to 2': (read(lambda y: np.mod(y, math.pi)), 'wrap', {'jumps'}),
    'rest': (read(lambda y: y[0] + COUNT * (np.arange(COUNTED) % 97 == 0)), 'motion', set()),
    'coarse': (read(lambda y: np.round(y / (TURN / 90)) * (TURN / 90)), 'resolution', set()),
    'noisy': (read(lambda y: y + noise(6, 0.02)), 'resolution', set()),
    'two sources': (read(put(slice(1, None, 2), 0.3)), 'jumps', SOURCES),
    'wrong readings': (read(add([900, 1800, 4200], 1.0)), 'encoder', {'jumps'}),
    'a slow second source': (read(put(slice(3, None, 7), 2.5)), 'jumps', SOURCES),
}


@pytest.mark.parametrize('fault', FAULTS)
@pytest.mark.long
def test_a_planted_fault_is_named(fault):
    plant, check, others = FAULTS[fault]
    found = look(*plant(*clean()))
    assert check in named(found)
    assert named(found) <= {check, 'encoder'} | others
    assert found[check].remedy


def test_every_row_has_a_fault_and_is_on_the_page():
    assert {check for _, check, _ in FAULTS.values()} == {each.name for each in CHECKS}
    text = checks.PAGE.read_text()
    assert checks.page(text) == text, 'python -m docs.tools.checks'
    assert f'plants {len(FAULTS)} faults' in text and f'in {len(CLEAN)} kinds' in text


def test_the_times_of_a_flip_are_named():
    found = look(*read(flip)(*clean()))['jumps']
    assert found.level == FAIL
    assert found.numbers['times_s'] == pytest.approx([5.2, 5.4])
    assert '5.20 s' in found.value and '5.40 s' in found.value


def test_wrong_stamps_are_measured():
    for error in (2e-4, 1e-3):
        stamps, arrival, angle = clean(rate=1000.0)
        wrong = np.random.default_rng(3).normal(0.0, error * 1e9, len(stamps)).astype(np.int64)
        found = look(stamps + wrong, arrival, angle)['lying stamps']
        assert found.numbers['stamp_error_s'] == pytest.approx(error, rel=0.1)


def test_true_stamps_of_irregular_readings_do_not_lie():
    rng = np.random.default_rng(7)
    stamps, arrival, _ = clean()
    stamps = stamps + rng.uniform(-8e5, 8e5, len(stamps)).astype(np.int64)
    t = (stamps - START) * 1e-9
    angle = np.round(4.0 * np.sin(TURN * 0.3 * t) / COUNT) * COUNT
    assert look(stamps, arrival, angle)['lying stamps'].level == PASS


@pytest.mark.parametrize('digit', (0.001, 0.0001, 0.01, 0.0005, 0.0015, 0.002, 0.005))
def test_radians_that_a_driver_rounds_to_decimals_are_not_degrees(digit):
    stamps, arrival, angle = clean(count=0.0)
    found = look(stamps, arrival, np.round(angle / digit) * digit)
    assert found['resolution'].numbers['quantum'] == pytest.approx(digit, rel=1e-3)
    assert found['wrap'].level == PASS
    assert found['resolution'].numbers['counts_per_turn'] == pytest.approx(TURN / digit, rel=1e-3)


def test_few_readings_are_one_finding():
    stamps, arrival, angle = (each[:5] for each in clean())
    assert look(stamps, arrival, angle)['readings'].level == FAIL
    stamps, arrival, angle = clean()
    assert look(np.full_like(stamps, START), arrival, angle)['readings'].level == FAIL
