# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Drives of a base, its wheels estimated once, and their odometry with a gyro that may be wrong."""

from functools import cache
from typing import NamedTuple

import numpy as np

from estimator_pkg.driver.bank import Bank
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.estimate import VALID
from estimator_pkg.observers.wheels import Geometry, WheelObserver, WheelOdometry

RADIUS, TRACK, PERIOD = 0.1, 0.5, 2.0 * np.pi
QUANTUM = PERIOD / 4096
GYRO_NOISE, GYRO_BIAS = 0.005, 0.02  # [rad/s]
START = 10**18
WHEELS = ('left', 'right')


def _slalom(t):
    return 0.8 * (1.0 + 0.25 * np.sin(0.7 * t)), 0.42 * np.sin(0.9 * t) + 0.18 * np.sin(2.3 * t)


def _stops(t):
    """A slalom that stands for 4 of 12 s."""
    part = np.clip((np.abs(t % 12.0 - 10.0) - 2.0) / 0.5, 0.0, 1.0)
    return tuple(part * each for each in _slalom(t))


def _steps(speeds, h):
    """What is travelled in each step, by the trapezoidal rule; zero in the first one."""
    ends = np.insert(speeds, 0, speeds[..., 0], axis=-1)
    return 0.5 * h * (ends[..., 1:] + ends[..., :-1])


PROFILES = {  # speed [m/s] and yaw rate [rad/s]
    'straight': lambda t: (0.8, 0.0),
    'circle': lambda t: (0.8, 0.4),
    'slalom': _slalom,
    'stops': _stops,
    'spins': lambda t: (0.1, 2.5 * np.sin(0.7 * t)),
}


class Drive(NamedTuple):
    """Messages of the wheels and true motion.

    stamps_ns : (n,). wheels : estimates as `WheelOdometry.update` takes them, (n, 2, 5). true : x,
    y, yaw, speed and yaw rate, (n, 5). gyro : values in the middle to the next message, (n,).
    """

    stamps_ns: np.ndarray
    wheels: np.ndarray
    true: np.ndarray
    gyro: np.ndarray


@cache
def drive(
    profile, rate=50.0, seed=0, seconds=60.0, ground=0.0, swapped=None, slip=0.0, geometry=(1, 1, 1)
):
    """Return a `Drive`.

    Parameters
    ----------
    swapped : from this time on the wheels are on the other side [s]. slip : of the right wheel for
    1 s of 8 s [m/s]. geometry : true over nominal left radius, right radius and track.
    """
    random, fine = np.random.default_rng(seed), 8
    h = 1.0 / (rate * fine)
    t = np.arange(round(seconds * rate) * fine) * h
    v, w = ((1.0 - np.exp(-t * t)) * each for each in PROFILES[profile](t))
    half = 0.5 * TRACK * geometry[2] * w
    sides = np.array([v - half, v + half])
    sides[1] += slip * np.sin(np.pi * (t % 8.0 - 4.0)) ** 2 * (np.abs(t % 8.0 - 4.5) < 0.5)
    if swapped is not None:
        sides = np.where(t < swapped, sides, sides[::-1])
    moved = _steps(sides, h)
    moved += ground * np.sqrt(np.abs(moved)) * random.standard_normal(moved.shape)
    angles = np.cumsum(moved.T / (RADIUS * np.array(geometry[:2])), axis=0)[::fine]
    angles += random.uniform(0.0, PERIOD, 2)
    yaw = np.cumsum(_steps(w, h))
    x, y = np.cumsum(_steps(v * (np.cos(yaw), np.sin(yaw)), h), axis=1)
    stamps = START + np.round(t[::fine] * 1e9).astype(np.int64)
    bank, rows, found = Bank(Configuration(WheelObserver, {'quantum': QUANTUM}, {})), [], []
    readings = np.floor(angles % PERIOD / QUANTUM) * QUANTUM
    for row, (stamp, reading) in enumerate(zip(stamps.tolist(), readings.tolist())):
        taken = bank.update(stamp, WHEELS, reading)
        if all(each and each[3] in VALID for each in taken.estimates):
            rows.append(row)
            pairs = taken.stddevs((0, 1))
            found.append([(*each[:3], *pair) for each, pair in zip(taken.estimates, pairs)])
    gyro = w[fine // 2 :: fine] + GYRO_BIAS + GYRO_NOISE * random.standard_normal(len(stamps))
    true = np.array([x, y, yaw, v, w]).T[::fine]
    return Drive(stamps[rows], np.array(found), true[rows], gyro[rows])


FAULTS = {  # (value, time since it is wrong) -> value
    'clean': lambda value, since: value,
    'bias 0.05': lambda value, since: value + 0.05,
    'bias 0.3': lambda value, since: value + 0.3,
    'drift': lambda value, since: value + 0.002 * since,
    'reversed': lambda value, since: -value,
    'in deg/s': lambda value, since: np.degrees(value),
    'swapped': lambda value, since: value,
    'silent': lambda value, since: np.nan,
    'stuck': lambda value, since: 0.2,
}


class Run(NamedTuple):
    """Odometry of a drive: x, y, yaw, speed and yaw rate.

    found, errors, sigmas : (n, 5). covariance : of the last pose. notices : of the base.
    """

    time: np.ndarray
    found: np.ndarray
    errors: np.ndarray
    sigmas: np.ndarray
    base: WheelOdometry

    def covered(self, after=0.5):
        """Return the fraction of time that yaw, speed and yaw rate are in the 95 % interval."""
        inside = np.abs(self.errors) < 1.96 * self.sigmas + 1e-9
        return inside[self.time > after, 2:].mean(axis=0)

    def rms(self, after=3.0):
        """Return the root mean square error of the yaw rate."""
        return np.sqrt(np.mean(self.errors[self.time > after, 4] ** 2))

    def nees(self):
        """Return the squared error of the last pose, normalised by its covariance."""
        error = self.errors[-1, :3]
        return error @ np.linalg.solve(self.base.covariance, error)


def run(of, fault='clean', start=0.0, gyro=True, **values):
    """Return the `Run` of a drive; the gyro is wrong from `start` on [s]."""
    geometry = Geometry(**{'radius': (RADIUS,), 'track': TRACK, **values})
    base, found = WheelOdometry(geometry, gyro, PERIOD, 0.5), []
    half = int(np.median(np.diff(of.stamps_ns)) / 2)
    for stamp, wheels, value in zip(of.stamps_ns.tolist(), of.wheels, of.gyro.tolist()):
        base.update(stamp, (0.0, 0.0), wheels)
        variances = np.diag(base.covariance), np.diag(base.twist_covariance)
        found.append(np.concatenate((base.pose, base.twist, *variances)))
        if gyro:
            since = (stamp - START) * 1e-9 - start
            base.gyro.receive(stamp + half, FAULTS[fault](value, since) if since >= 0.0 else value)
    found, variances = np.hsplit(np.array(found), 2)
    errors = found - of.true
    errors[:, 2] = (errors[:, 2] + np.pi) % PERIOD - np.pi
    return Run((of.stamps_ns - START) * 1e-9, found, errors, np.sqrt(variances), base)
