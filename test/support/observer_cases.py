# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The observers that every contract is tested on, in the variants that differ in structure."""

import contextlib
import math

import numpy as np
import pytest

from estimator_pkg import observers
from estimator_pkg.driver import joint as joints
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.errors import UserError
from estimator_pkg.parameters import build, declared

UNTUNED = {'edge_adaptive'}
STRUCTURES = {
    'hybrid_angle': [
        {'order': 2},
        {'form': 'paper', 'bandwidth_hz': 20.0},
        {'injection': 'tan', 'order': 2},
    ],
    'kalman': [{'model': 'constant_velocity'}],
}


def found():
    """The observers that can be loaded here, by name; a test holds all of them to it."""
    known = {}
    for name in observers.names():
        with contextlib.suppress(UserError):
            known[name] = observers.find(name)
    return known


def angle_observers():
    """The names of those that work from an angle alone."""
    return [name for name, observer in found().items() if observer.kind == 'angle']


def variants():
    """(observer's name, gains) of each angle observer found here: its defaults, and variants."""
    return [
        (name, gains) for name in angle_observers() for gains in ({}, *STRUCTURES.get(name, ()))
    ]


def tunable_variants():
    """Without those that find noise and bandwidth by themselves, and have no gain for either."""
    return [(name, gains) for name, gains in variants() if name not in UNTUNED]


def label(variant):
    name, gains = variant
    return '-'.join((name, *(str(value) for value in gains.values())))


def joint(name, gains=None, kind=Joint, **settings):
    """A joint with this observer."""
    observer = observers.find(name)
    return kind(observer, build(observer.gains, gains or {}), build(JointSettings, settings))


def make(name, gains=None, **settings):
    """A joint with this observer; the engine runs it where there is one."""
    return joint(name, gains, **settings)


def plain(name, gains=None, **settings):
    """A joint with this observer, as plain Python."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(joints, 'functions_of', lambda module: None)
        return joint(name, gains, **settings)


def drawn(parameter, random):
    """A value within what the parameter admits, often at an end of it."""
    if parameter.kind is bool:
        return bool(random.integers(2))
    if parameter.kind is str:
        return str(random.choice([name for name in parameter.choices if ':' not in name]))
    low, high = parameter.minimum, parameter.maximum
    if parameter.kind is int:
        return int(random.integers(low, high + 1))
    at = random.choice([0.0, 1.0, random.uniform()])
    start = math.log(max(low, 1e-12))
    return min(max(math.exp(start + at * (math.log(high) - start)), low), high)


def drawn_gains(gains, random):
    return {
        name: drawn(parameter, random)
        for name, parameter in declared(gains).items()
        if random.uniform() < 0.5
        and (parameter.kind is bool or parameter.choices or parameter.kind in (int, float))
    }


def wrapped(angle):
    """In [-pi, pi)."""
    return (np.asarray(angle) + math.pi) % (2.0 * math.pi) - math.pi


def stamps(count, dt=1e-3, jitter=0.0, seed=1):
    """`count` int64 stamps [ns], sampled every dt [s] with a jitter [s] that never swaps two."""
    times = np.arange(count) * dt + np.random.default_rng(seed).uniform(-jitter, jitter, count)
    return 1_700_000_000_000_000_000 + np.rint(times * 1e9).astype(np.int64)


def stream(seed, count=400, noise=3e-3):
    """(stamps, angles): jitter, gaps, duplicates, late and bad stamps, repeats, wraps, outliers."""
    random = np.random.default_rng(seed)
    at = stamps(count, 1e-3, 2e-4, seed)
    t = (at - at[0]) * 1e-9
    angle = 2.0 + 40.0 * t + 3.0 * np.sin(20.0 * t) + random.normal(0.0, noise, count)
    angle = np.rint(wrapped(angle) / 1e-3) * 1e-3
    at[150:] += 300_000_000  # a gap
    at[250] = at[249]  # a duplicate
    at[270] = at[268]  # late
    at[300] += 10**15  # the far future
    angle[200] = angle[199]  # a repeat
    angle[320] += 3.0  # outliers
    angle[321] = math.nan
    angle[340:352] = angle[340]  # a stuck sensor
    return at, angle


def beside(name, gains, at, angles):
    """((channel, outputs), (channel, outputs)) of each sample, plain and by the engine."""
    both = plain(name, gains), make(name, gains)
    for k in range(len(at)):
        part = slice(k, k + 1)
        outs = [each.run(at[part], angles[part]) for each in both]
        yield tuple((repr(each.channel), out) for each, out in zip(both, outs))
