# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Streams as other people record them: what the checks of `doctor` say, and what they do not."""

import math
import re

import numpy as np
import pytest

from estimator_pkg.evaluation.checks.joint import as_read, checked, reference, stretch
from estimator_pkg.evaluation.checks.readings import Readings
from estimator_pkg.evaluation.checks.row import FAIL, PASS, WARN
from estimator_pkg.evaluation.doctor import velocities

TURN = 2.0 * math.pi
START = 1_700_000_000_000_000_000


def time(rate, seconds=40.0):
    return np.arange(round(rate * seconds)) / rate


def rounded(values, step):
    return np.round(values / step) * step if step else values


def wrapped(values, period):
    return (values + 0.5 * period) % period - 0.5 * period


def random(seed):
    return np.random.default_rng(seed)


def sway(seed, rate, size, seconds=40.0):
    """A smooth motion of this amplitude, of a few slow sines."""
    own, t = random(seed), time(rate, seconds)
    parts = [np.sin(TURN * own.uniform(0.1, 0.4) * t + own.uniform(0, TURN)) for _ in range(3)]
    return t, size / 3.0 * sum(parts)


def lift(step, unit=1.0, offset=200.0, size=180.0, rate=100):
    t = time(rate)
    return t, rounded(unit * (offset + size * np.sin(0.4 * math.pi * t)), step)


def wheel(speeds, rate, seconds=40.0, period=0.0):
    """The integral of a few commanded speeds [rad/s]."""
    t = time(rate, seconds)
    angle = np.cumsum(np.array(speeds)[np.arange(len(t)) * len(speeds) // len(t)]) / rate
    return t, wrapped(angle, period) if period else angle


def encoder(counts, speed, seed, rate=50, turns=True):
    """Exact counts of a motion near this speed [counts a sample]."""
    t, more = sway(seed, rate, 0.3 * TURN / counts)
    angle = rounded(speed * rate * t * TURN / counts + more, TURN / counts)
    return t, angle if turns else wrapped(angle, TURN)


def turning(seed, unit, step, rate=200, speed=2.0):
    """An angle that wraps, in another unit: `unit` a turn."""
    t, more = sway(seed, rate, 1.0)
    return t, rounded(np.mod(speed * t + more, TURN) / TURN * unit, step)


def hole(seed, size=17):
    """One wrap, which is in a hole of the record."""
    t = time(100, 12.0)
    angle = wrapped(rounded(0.5 * t + 0.1 * np.sin(3.0 * t + seed), TURN / 4096), TURN)
    at = int(np.argmax(np.abs(np.diff(angle)) > math.pi))
    kept = np.r_[0 : at - size // 2, at + size // 2 + 1 : len(t)]
    return t[kept], angle[kept]


def residue(seed, size, rate=500):
    """A simulated joint at rest: 0.4 rad but for what its solver leaves, which once jumps."""
    t = time(rate, 20.0)
    more = 1e-3 * size * np.cumsum(np.sin(0.5 * t + seed)) / rate
    more += size * (np.arange(len(t)) >= random(seed).integers(1000, 8000))
    return t, 0.4 * (size > 1e-9) + more


def noisy(seed, noise, rate=500, seconds=20.0):
    t = time(rate, seconds)
    return t, 0.4 + noise * random(seed).standard_normal(len(t))


def start(seed, rate=100, speed=0.515):
    """A joint that rests, moves, and between makes one step of a slower speed."""
    t = time(rate)
    moved = np.where(t % 10.0 < 1.0, speed * np.sin(TURN * t), 0.0)
    moved[1700] += 0.45 * speed
    return t, np.cumsum(moved) / rate + 1e-6 * random(seed).standard_normal(len(t))


def sent(copies, seed, rate=50, apart=0.5e-3):
    """A device each of whose readings is sent several times, with a stamp for each."""
    t, angle = sway(seed, rate, 2.0)
    stamps = (t[:, None] + apart * np.arange(copies)).ravel()
    return stamps, np.repeat(rounded(angle, TURN / 4096), copies)


def slipped(size, seed=1):
    t, angle = sway(seed, 200, 1.0)
    return t, rounded(angle, TURN / 4096) + np.where(t > 20.0, size, 0.0)


READINGS = 'degrees.* mm.* prismatic or multi-turn.*wrap-period 0'
UNIT = 'wrap', WARN, READINGS
NO_WRAP = 'wrap', PASS, ''
COUNTS = 'counts_per_revolution='
CASES = {  # stream of a seed, checks that do not pass: (check, level, remedy), and others' texts
    **{
        f'a lift in mm, rounded to {step}': (lambda seed, step=step: lift(step), [UNIT])
        for step in (0.1, 0.05, 0.02)
    },
    'a lift in cm': (lambda seed: lift(0.01, 0.1), [('resolution', WARN, '')]),
    'a lift in mm, 10 mm a sample': (lambda seed: lift(0.1, size=800.0, offset=900.0), [UNIT]),
    'a small lift in mm': (lambda seed: lift(0.1, size=20.0 + seed), [UNIT]),
    'a wheel of one speed': (lambda seed: wheel([0.5], 10), []),
    'a wheel of three speeds': (lambda seed: wheel([0.45, -0.3 * seed, 0.15], 10), []),
    'a wheel of two, wrapped': (lambda seed: wheel([0.9, 0.45 * seed], 10, 40.0, TURN), []),
    'degrees, wrapped': (
        lambda seed: turning(seed, 360.0, 0.1),
        [('wrap', FAIL, 'degrees.*' + COUNTS + '360')],
    ),
    'degrees, wrapped, in whole ones': (
        lambda seed: turning(seed, 360.0, 1.0),
        [('wrap', FAIL, 'degrees.*' + COUNTS + '360'), ('resolution', WARN, '^use edge_adaptive')],
    ),
    'degrees of 4096 counts': (
        lambda seed: turning(seed, 360.0, 360.0 / 4096, speed=-1.0),
        [('wrap', FAIL, 'degrees.*' + COUNTS + '360')],
    ),
    'degrees, wrapped once': (
        lambda seed: (lambda t: (t, rounded(np.mod(300.0 + 4.0 * seed * t, 360.0), 0.1)))(
            time(100)
        ),
        [('wrap', WARN, 'if degrees.*' + COUNTS + '360')],
    ),
    'degrees that do not wrap': (
        lambda seed: (lambda t, x: (t, rounded(np.degrees(x), 0.1)))(*sway(seed, 200, 0.8)),
        [UNIT],
    ),
    'raw counts, wrapped': (
        lambda seed: turning(seed, 4096.0, 1.0),
        [('wrap', FAIL, 'raw counts.*' + COUNTS + '4096')],
    ),
    'raw counts of several turns': (
        lambda seed: (lambda t, x: (t, rounded(4096 * x, 1.0)))(*sway(seed, 200, 2.0)),
        [('wrap', WARN, COUNTS + 'N.*' + READINGS)],
    ),
    'a gear of 1 to 2': (
        lambda seed: turning(seed, math.pi, TURN / 4096, speed=1.0),
        [('wrap', FAIL, 'wrap_period: 3.14')],
    ),
    'a wrap in a hole': (hole, [('holes', WARN, '')]),
    **{
        f'{speed} counts a sample{", wrapped" if not turns else ""}': (
            lambda seed, speed=speed, turns=turns: encoder(512, speed, seed, turns=turns),
            [('resolution', WARN, 'quantum: 0.01227')],
        )
        for speed in (0.3, 1.02, 3.3, 3.02, 10.7, 40.4)
        for turns in (True, False)
    },
    **{
        f'a residue of {size:g} rad': (
            lambda seed, size=size: residue(seed, size),
            [('motion', WARN, 'in motion')],
        )
        for size in (7e-13, 1e-10, 1e-8, 3e-7)
    },
    **{
        f'at rest with {noise:g} rad of noise': (
            lambda seed, noise=noise: noisy(seed, noise),
            [('motion', WARN, 'in motion')],
        )
        for noise in (3e-6, 1e-4, 1e-9)
    },
    'starts within a sample': (start, []),
    'a slip of 0.2 rad': (lambda seed: slipped(0.2, seed), [('jumps', FAIL, 'slipped')]),
}

COUNTED = {'counts', 'slip', 'hole', 'cm', 'gear'}  # of streams that have a quantum to set


def look(stream, period=TURN):
    """The findings by check."""
    t, angle = stream
    stamps = START + np.round(t * 1e9).astype(np.int64)
    nothing = np.full(len(angle), np.nan)
    seen = Readings('joint', stamps, stamps + 300_000, angle, nothing, period, START)
    return {each.check: each for each in checked(as_read(seen))}


@pytest.mark.parametrize('seed', [1, 2])
@pytest.mark.parametrize('case', CASES)
def test_what_is_said_of_it(case, seed):
    made, expected = CASES[case]
    found = look(made(seed))
    not_passed = {name: each for name, each in found.items() if each.level != PASS}
    allowed = {name for name, *_ in expected}
    assert set(not_passed) - {'encoder'} <= allowed, not_passed
    for name, level, remedy in expected:
        assert found[name].level == level, found[name]
        assert re.search(remedy, found[name].remedy), found[name]
    if case.startswith('raw') or COUNTED.isdisjoint(case.split()):
        quantum = found['resolution'].remedy
        assert 'quantum: 1' not in quantum and 'shielding' not in quantum
    if 'wheel' in case:
        assert found['resolution'].numbers['quantum'] == 0.0


@pytest.mark.parametrize('copies, many', [(2, 'twice'), (3, '3 times')])
@pytest.mark.parametrize('rate, apart', [(50, 0.5765e-3), (20, 1e-4), (100, 1e-3)])
def test_copies_of_a_reading_are_no_rate(copies, many, rate, apart):
    found = look(sent(copies, 1, rate, apart))
    assert found['rate'].value.startswith(f'{rate} Hz, each reading {many}')
    assert '-' not in found['holes'].value.partition('%')[0], found['holes'].value
    assert f'at about {rate} Hz' in found['repeated readings'].value


def late(values, seconds, rate=200):
    return np.interp(np.arange(len(values)) / rate - seconds, np.arange(len(values)) / rate, values)


def filtered(values, hz, rate=200):
    """As a first-order low-pass filter in a driver."""
    part, found = 1.0 - math.exp(-TURN * hz / rate), np.zeros(len(values))
    for k in range(1, len(values)):
        found[k] = found[k - 1] + part * (values[k] - found[k - 1])
    return found


def differences(position, rate=200):
    return np.diff(position, prepend=position[0]) * rate


PUBLISHED = {  # velocity made of (true velocity, reading, random), level, text, remedy
    'right': (lambda v, x, r: v, PASS, 'noise', ''),
    'with noise': (lambda v, x, r: v + 0.3 * r.standard_normal(len(v)), PASS, 'noise', ''),
    'a finite difference': (lambda v, x, r: differences(x), PASS, 'noise', ''),
    'low-passed at 40 Hz': (lambda v, x, r: filtered(v, 40.0), PASS, 'noise', ''),
    '0.92 of it': (lambda v, x, r: 0.92 * v, WARN, '0.92 times', 'scaling'),
    'a tenth': (lambda v, x, r: 0.1 * differences(x), WARN, '0.1 times', 'scaling'),
    'in rpm': (lambda v, x, r: v * 60.0 / TURN, WARN, 'rpm', 'rad/s'),
    'in deg/s': (lambda v, x, r: np.degrees(v), WARN, '57.3 times the velocity: deg/s', 'rad/s'),
    'in turns per second': (lambda v, x, r: v / TURN, WARN, 'turns per second', 'rad/s'),
    'reversed': (lambda v, x, r: -v, WARN, 'reversed', 'sign'),
    'reversed, in rpm, late': (
        lambda v, x, r: late(-v * 60.0 / TURN, 0.03),
        WARN,
        'reversed, and 9.5. times the velocity: rpm; (29|30|31)',
        'sign; publish rad/s',
    ),
    'the position': (
        lambda v, x, r: 0.7 * np.unwrap(x),
        WARN,
        r'proportional to the position \(0.7',
        'driver',
    ),
    'constant': (lambda v, x, r: 0.0 * v + 0.3, WARN, 'constant at 0.3', 'driver'),
    'zero': (lambda v, x, r: 0.0 * v, WARN, 'zero', 'driver'),
    'late': (lambda v, x, r: late(v, 0.04), WARN, '(39|40|41)[.0-9 +-]* ms late', 'node'),
    'something else': (
        lambda v, x, r: filtered(30.0 * r.standard_normal(len(v)), 1.0),
        WARN,
        'not the derivative',
        'driver',
    ),
    'another motion': (
        lambda v, x, r: sway(99, 200, 2.0, 20.0)[1],
        WARN,
        'not the derivative',
        'driver',
    ),
}


SINES = [(0.7, 0.31, 1.0), (0.3, 0.83, 2.0), (0.2, 1.3, 0.0)]
MOTIONS = {'sines': (0.0, SINES), 'a sine': (0.0, [(1.0, 0.5, 0.3)]), 'turning': (3.0, SINES)}
OF_READING = ('a finite difference', 'a tenth')  # that does not wrap


@pytest.mark.parametrize(
    'case, motion',
    [(c, m) for c in PUBLISHED for m in MOTIONS if m != 'turning' or c not in OF_READING],
)
def test_the_published_velocity_is_checked(case, motion):
    make, level, text, remedy = PUBLISHED[case]
    t, (mean, parts) = time(200, 20.0), MOTIONS[motion]
    angle = mean * t + sum(a * np.sin(TURN * f * t + p) for a, f, p in parts)
    speed = mean + sum(a * TURN * f * np.cos(TURN * f * t + p) for a, f, p in parts)
    reading = rounded(wrapped(angle, TURN) if mean else angle, TURN / 4096)
    stamps = START + np.round(t * 1e9).astype(np.int64)
    given = make(speed, reading, random(5))
    seen = Readings('joint', stamps, stamps, reading, given, TURN, START)
    rows = np.sort(stretch(seen))
    found = velocities.checks(seen, reference(seen, rows), rows)
    (own,) = [each for each in found if each.check == velocities.PUBLISHED.name]
    assert own.level == level and re.search(text, own.value) and re.search(remedy, own.remedy), own
    assert velocities.misleads(found) is (level == WARN and case != 'late')


def two_sines(t):
    return np.sin(5.0 * t) + np.sin(7.7 * t)


T20 = time(200, 20.0)
SWING, DECAY = np.sin(3.0 * T20), np.exp(-0.2 * T20)
NOISE = random(5).standard_normal(len(T20))
RELATIONS = {  # published velocity, true one, deviation of that, what is wrong
    'constant, as the joint': (0.3 + 0.0 * T20, 0.3 + 1e-4 * SWING, 1e-3, ''),
    'zero, the joint at a constant speed': (0.0 * T20, 0.3 + 1e-4 * SWING, 1e-3, 'zero'),
    'right, where the position is like it': (DECAY, DECAY, 1e-4, ''),
    'right, with much noise': (SWING + 1.6 * NOISE, SWING, 1e-3, ''),
    'late by a third of a period': (two_sines(T20 - 0.24), two_sines(T20), 1e-4, ''),
    'another, the truth uncertain': (NOISE, 0.1 * SWING, 0.1, ''),
    'another, the truth certain': (NOISE, 0.1 * SWING, 1e-3, 'not the derivative'),
    '1.1 of it, the truth uncertain': (1.1 * SWING, SWING, 0.1, ''),
    '1.1 of it, the truth certain': (1.1 * SWING, SWING, 1e-3, '1.1 times'),
}


@pytest.mark.parametrize('case', RELATIONS)
def test_what_is_wrong_depends_on_the_motion_and_on_what_is_known_of_it(case):
    values, truth, unsure, wrong = RELATIONS[case]
    found = velocities.relation(T20, values, truth, np.cumsum(truth) / 200.0, unsure).wrong
    assert found.startswith(wrong) and bool(found) == bool(wrong), found
