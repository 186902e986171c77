"""The observers that every contract is tested on, in the variants that differ in structure."""

from __future__ import annotations

import math

import numpy as np

from estimator_pkg import observers
from estimator_pkg.driver.joint import Joint, JointSettings
from estimator_pkg.parameters import build

STRUCTURES = {
    'hybrid_angle': [{'order': 2}, {'form': 'paper', 'bandwidth_hz': 20.0},
                     {'injection': 'tan', 'order': 2}],
    'kalman': [{'model': 'constant_velocity'}],
}


def variants():
    """(observer's name, gains) of each angle observer found here: its defaults, and variants."""
    return [(name, gains) for name in observers.names() if observers.find(name).kind == 'angle'
            for gains in ({}, *STRUCTURES.get(name, ()))]


def label(variant):
    name, gains = variant
    return '-'.join((name, *(str(value) for value in gains.values())))


def make(name, gains=None, **settings):
    """A joint with this observer."""
    observer = observers.find(name)
    return Joint(observer, build(observer.gains, gains or {}), build(JointSettings, settings))


def wrapped(angle):
    """In [-pi, pi)."""
    return (np.asarray(angle) + math.pi) % (2.0 * math.pi) - math.pi


def stamps(count, dt=1e-3, jitter=0.0, seed=1):
    """`count` int64 stamps [ns], sampled every dt [s] with a jitter [s] that never swaps two."""
    times = np.arange(count) * dt + np.random.default_rng(seed).uniform(-jitter, jitter, count)
    return 1_700_000_000_000_000_000 + np.rint(times * 1e9).astype(np.int64)
