# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Identify radii and track of a base on wheels, from a drive with a gyro or from two loops.

    I = (rr / b) Pr - (rl / b) Pl + bias T - delay w

I is the integral of the gyro in a window of time T, Pl and Pr what the wheels turn, w the change of
the gyro's value. A loop that ends as it began turns the base by one turn (Borenstein and Feng
1996). Both know the ratios of the radii to the track; a known radius, track or path makes lengths
of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.definitions import fields_of
from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.series import joint_series
from estimator_pkg.errors import UsageError, UserError, suggestion
from estimator_pkg.evaluation.identify.data import common
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.field import Field
from estimator_pkg.parameters import build
from estimator_pkg.streams.wheels import WheelSettings

Array = NDArray[np.float64]

WINDOW, LEAST_WINDOWS = 2.0, 10  # [s]
KEPT = 0.7  # part of the windows to identify from; the others validate
OPEN = 0.02  # of its length: a loop with a larger gap is none
UNSURE = 0.02  # standard deviation of the heading at the end of a loop [rad]
STEP = 0.2  # between samples of a path [s]
LITTLE = 0.1  # relative deviation above which a drive identifies nothing
NAMES = ('radius_left', 'radius_right', 'track')
UNITS = {
    'bias': 'rad/s',
    'delay': 's',
    'residual': 'rad in 2 s',
    'residual_elsewhere': 'rad in the held-out part',
}


class Base(NamedTuple):
    """What is found.

    values : radii of left and right wheels, and effective track [m]. deviations : of each [m].
    about : further numbers by name.
    """

    values: Array
    deviations: Array
    about: dict[str, float]


def identified(
    bag: Bag, topic: str, values: Mapping[str, Any], loops: bool, distance: float | None
) -> Base:
    """Return radii and track from a bag.

    Parameters
    ----------
    values : parameters of `wheel_odometry`; one of `radius` and `track`, or `distance` is needed.
    loops : the bag has two loops, not a gyro. distance : path [m] of the base, or of each loop.

    Raises
    ------
    UsageError, UserError : a wheel or the gyro is missing, or the motion identifies nothing.
    """
    if sum((distance is not None, 'radius' in values, 'track' in values)) != 1:
        raise UsageError(
            'the ratio of radius to track is identified: set one length, as in --set track=0.5, '
            '--set radius=0.1, or --distance 20 (the path of the base [m])'
        )
    settings = build(WheelSettings, {'radius': [1.0], 'track': 1.0, **values})
    settings.find_observer()
    times, turned = _turned(bag, topic, settings)
    if loops:
        ratios, covariance, about = _of_loops(times, turned)
    else:
        ratios, covariance, about = _of_gyro(times, turned, *_gyro(bag, settings))

    def lengths(ratios: Array) -> Array:
        """Return left and right radius, and track [m]."""
        track = settings.track or 1.0
        if distance is not None:
            track = distance * (1 + loops) / _path(ratios, times, turned)
        elif 'radius' in values:
            track = float(np.mean(settings.radius or 1.0)) / float(np.mean(ratios))
        return np.append(ratios * track, track)

    found, steps = lengths(ratios), 1e-6 * np.diag(ratios)
    by = np.array([(lengths(ratios + step) - found) / step.sum() for step in steps]).T
    deviations = np.sqrt(np.diag(by @ covariance @ by.T))
    if not (deviations < LITTLE * found).all() or not (found > 0.0).all():
        raise UserError(
            f'{bag.path} does not identify the base (track {found[2]:.3g} +- {deviations[2]:.1g} '
            'm): drive curves to both sides for a minute, without slip, and check the sides of the '
            "wheels and the sign of 'gyro_ratio'"
        )
    return Base(found, deviations, about)


def _turned(bag: Bag, topic: str, settings: WheelSettings) -> tuple[Array, Array]:
    """Return times [s] since 1970 and what left and right wheels turned [rad], shape (2, n)."""
    every, names = joint_series(bag, topic), settings.names
    for name in names:
        if name not in every:
            raise UserError(
                f"topic '{topic}' of {bag.path} has no joint '{name}': set wheels_left and "
                f'wheels_right, {suggestion(name, every)}'
            )
    stamps, rows = common(names, every)
    positions = np.array([every[name].position[row] for name, row in zip(names, rows)])
    good = np.isfinite(positions).all(axis=0)
    if good.sum() < 2:
        raise UserError(f"topic '{topic}' of {bag.path} has no two samples of {', '.join(names)}")
    wheels = np.unwrap(positions[:, good]).reshape(2, len(names) // 2, -1)
    return stamps[good] * 1e-9, wheels.mean(axis=1)


def _path(ratios: Array, times: Array, turned: Array) -> float:
    """Return the path of the base over its track; noise at standstill is no path."""
    coarse = np.arange(times[0], times[-1] + STEP, STEP)
    moved = np.diff([np.interp(coarse, times, each) for each in turned])
    return float(np.abs(ratios @ moved).sum()) / 2.0


def _gyro(bag: Bag, settings: WheelSettings) -> tuple[Array, Array]:
    """Return times [s] since 1970 and values [rad/s] of the gyro."""
    name = f'/{(settings.gyro_topic or "imu").lstrip("/")}'
    topic = bag.require(name, [settings.gyro_type])
    field = Field(fields_of(topic.type, topic.definition), topic.type, settings.gyro_field)
    samples = {}
    for message in bag.messages([name]):
        with suppress(MalformedMessageError):
            stamp_ns, _, value = field.decode(message.raw)
            if value is not None and math.isfinite(value):
                at_ns = message.publish_ns if stamp_ns is None else stamp_ns
                samples[at_ns] = settings.gyro_ratio * value
    if len(samples) < 2:
        raise UserError(f"topic '{name}' of {bag.path} has no two values of {settings.gyro_field}")
    stamps = np.array(sorted(samples))
    return stamps * 1e-9, np.array([samples[each] for each in stamps.tolist()])


def _fit(terms: Array, whole: Array, sigma: float, loss: str) -> tuple[Array, Array]:
    """Return the unknowns of `terms` x = `whole` and their covariance, by least squares."""
    from scipy.optimize import least_squares

    start = np.linalg.lstsq(terms, whole, rcond=None)[0]
    fit = least_squares(
        lambda x: (terms @ x - whole) / sigma, start, lambda x: terms / sigma, loss=loss
    )
    return fit.x, np.linalg.pinv(fit.jac.T @ fit.jac)


def _of_gyro(
    times: Array, turned: Array, at: Array, rate: Array
) -> tuple[Array, Array, dict[str, float]]:
    """Return ratios of left and right radius to the track, their covariance, further numbers."""
    within = (times >= at[0]) & (times <= at[-1])
    times, turned = times[within], turned[:, within]
    count = int((times[-1] - times[0]) / WINDOW) if len(times) else 0
    if count < LEAST_WINDOWS:
        raise UserError(
            f'gyro and wheels have {WINDOW * count:g} s in common: record a drive of '
            f'{LEAST_WINDOWS * WINDOW:g} s or more'
        )
    integral = np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(at)))
    rows = np.searchsorted(times, times[0] + WINDOW * np.arange(count + 1))
    whole, change = (np.diff(np.interp(times[rows], at, each)) for each in (integral, rate))
    left, right = np.diff(turned[:, rows])
    terms = np.array([-left, right, np.diff(times[rows]), -change]).T
    fitted = np.arange(count) < KEPT * count
    sigma = 0.1
    for _ in range(10):  # windows of slip have little weight once the usual error is known
        solution, covariance = _fit(terms[fitted], whole[fitted], sigma, 'cauchy')
        errors = whole - terms @ solution
        sigma = 1.4826 * float(np.median(np.abs(errors[fitted]))) + 1e-9
    about = {
        'bias': float(solution[2]),
        'delay': float(solution[3]),
        'residual': sigma,
        'residual_elsewhere': float(np.sqrt(np.mean(errors[~fitted] ** 2))),
    }
    return solution[:2], covariance[:2, :2], about


def _of_loops(times: Array, turned: Array) -> tuple[Array, Array, dict[str, float]]:
    """Return the same from two loops, with the longest standstill between them."""
    driven = np.append(0.0, np.cumsum(np.abs(np.diff(turned)).sum(axis=0)))
    levels = np.linspace(0.02, 0.98, 400) * driven[-1]
    longest = int(np.argmax(np.diff(np.interp(levels, driven, times))))
    middle = int(np.searchsorted(driven, levels[longest : longest + 2].mean()))
    between = turned[:, [0, middle, -1]]
    terms = np.diff(between).T * (-1.0, 1.0)
    turns = np.sign(terms.sum(axis=1))
    if turns.sum() != 0.0:
        raise UserError(
            'the two loops are not one to the left and one to the right: drive both, with a '
            'standstill between them, and end each as it began'
        )
    ratios, covariance = _fit(terms, 2.0 * math.pi * turns, UNSURE, 'linear')
    for loop in (turned[:, : middle + 1], turned[:, middle:]):
        left, right = ratios[:, None] * np.diff(loop)
        steps, heading = 0.5 * (left + right), np.cumsum(right - left) - 0.5 * (right - left)
        gap = np.hypot(steps @ np.cos(heading), steps @ np.sin(heading)) / np.abs(steps).sum()
        if gap > OPEN:
            raise UserError(
                f'a loop ends {100.0 * gap:.2g} % of its length from its start: end each loop '
                'where it began, or identify from a drive with a gyro'
            )
    return ratios, covariance, {}
