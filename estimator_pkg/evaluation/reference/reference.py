# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The quality of a measured reference velocity: its own lag, bias, slope and noise.

The reference of a recording is a sensor too. Its lag and bias are fitted to the measured position,

    integral of the reference = position(t - lag) * slope + bias * t,

over short windows. Their length limits both the drift of the integral and the effect of the
position's quantisation.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.delay import GAP_STEPS
from estimator_pkg.evaluation.options import SMOOTHER
from estimator_pkg.evaluation.reference.white_noise import noise
from estimator_pkg.evaluation.signals import wrapped

Array = NDArray[np.float64]

SENSOR = 'sensor'
FIT_WINDOW = 0.1  # length of a window [s], but at least this many samples:
WINDOW_SAMPLES = 10
FEWEST_WINDOWS = 20  # smallest number of windows end to end for a fit
NEIGHBOURS = (-3, -2, 2, 3)  # samples with the same speed but other noise than the one between
WINDOW_OUTLIER = 6.0  # windows beyond this many robust standard deviations are ignored
LAG_KNOWN = 1e-3  # a lag, slope or bias is reported up to this standard deviation
SLOPE_KNOWN = 0.01  # (lag [s], slope, fraction of the reference's rms speed or this [rad/s])
BIAS_KNOWN = 0.01
NOISE_MULTIPLE = 1.1  # an error up to this multiple of the reference's noise cannot be measured


@dataclass(frozen=True)
class Reference:
    """The quality of a reference; nan where the record does not determine it.

    lag_s, lag_stddev [s]: delay behind the position. bias, bias_stddev [rad/s]: mean error. slope,
    slope_stddev: factor on the true speed. noise [rad/s]: rms of its white noise; for the off-line
    smoother its own error. window_s: length of the windows of the fit. origin: 'sensor' or
    'smoother'.
    """

    lag_s: float
    lag_stddev: float
    bias: float
    bias_stddev: float
    slope: float
    slope_stddev: float
    noise: float
    window_s: float
    origin: str = SENSOR

    def as_dict(self) -> dict[str, Any]:
        """Return the quality for ``--json``."""
        return asdict(self)

    def cannot_tell(self, rms: float) -> bool:
        """Return True if an rms error [rad/s] is below the reference's own error.

        The error of the off-line smoother only adds to those of all estimates, so it can rank them
        unless it is infinite.
        """
        if self.origin != SENSOR:
            return self.noise == np.inf
        return bool(rms <= NOISE_MULTIPLE * self.noise)


def from_smoother(uncertainty: float) -> Reference:
    """Return a reference without lag and bias, with the error `uncertainty` [rad/s]."""
    return Reference(0.0, 0.0, 0.0, 0.0, 1.0, 0.0, uncertainty, np.nan, SMOOTHER)


def noise_only(
    time: Array, velocity: Array, own: Array | None = None, period: float = 0.0
) -> Reference:
    """Return the quality of a reference without a measured position: its noise.

    Arrays of shape (n,): time [s], velocity [rad/s or m/s], own position [rad or m].
    """
    return Reference(
        np.nan, np.nan, np.nan, np.nan, np.nan, np.nan, noise(time, velocity, own, period), np.nan
    )


def fit(
    time: Array, velocity: Array, position: Array, period: float, own: Array | None = None
) -> Reference:
    """Return lag, bias, slope and noise of a reference velocity against the measured position.

    Parameters
    ----------
    time : shape (n,), strictly increasing [s].
    velocity : shape (n,), the reference [rad/s].
    position : shape (n,), the measurement at the same times [rad], in any convention.
    period : wrap period [rad]; 0: none.
    own : shape (n,), the reference's own position [rad], nan for none; None: it has no positions.
    """
    good = np.isfinite(velocity) & np.isfinite(position)
    time, velocity, position = time[good], velocity[good], position[good]
    unknown = noise_only(time, velocity, None if own is None else own[good], period)
    if len(time) < 2 * WINDOW_SAMPLES:
        return unknown
    steps = np.diff(time)
    step = float(np.median(steps))
    across = max(WINDOW_SAMPLES, round(FIT_WINDOW / step))
    if len(time) < FEWEST_WINDOWS * across:
        return unknown
    travelled = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * steps)])
    ahead = travelled - position  # changes slowly except for whole turns, at any speed
    holes = np.concatenate([[0], np.cumsum(steps > GAP_STEPS * step)])
    whole = holes[across:] == holes[:-across]

    def across_window(values: Array) -> Array:
        return (values[across:] - values[:-across])[whole]

    around = np.full(len(time), np.nan)
    around[3:-3] = np.mean([velocity[3 + i : len(time) - 3 + i] for i in NEIGHBOURS], axis=0)
    whole &= np.isfinite(around[across:]) & np.isfinite(around[:-across])
    length = across_window(time)
    if len(length) < FEWEST_WINDOWS * across:
        return unknown
    missed = wrapped(across_window(ahead), period)
    moved = across_window(travelled) - missed
    columns = np.stack([length, -across_window(velocity), moved], axis=1)
    instruments = np.stack([length, -across_window(around), moved], axis=1)
    kept = np.ones(len(missed), bool)
    for _ in range(3):
        answer = _solve(columns[kept], instruments[kept], missed[kept], across)
        rest = np.abs(missed - columns @ np.nan_to_num(answer[0]))
        kept = rest <= WINDOW_OUTLIER * 1.4826 * float(np.median(rest)) + 1e-12
    (bias, lag, slope), (bias_stddev, lag_stddev, slope_stddev) = answer
    return Reference(
        lag, lag_stddev, bias, bias_stddev, 1.0 + slope, slope_stddev, unknown.noise, across * step
    )


def _solve(
    columns: Array, instruments: Array, missed: Array, across: int
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return (bias, lag, slope - 1) and their standard deviations; nan for undetermined ones.

    The noise of the reference in `columns` would bias a least-squares lag towards zero, so the
    equations are weighted with `instruments` that have the same speed but other noise. Parameters
    that the record does not determine (a lag at rest) are omitted.
    """
    speed = float(np.sqrt(np.mean((columns[:, 2] / columns[:, 0]) ** 2)))
    limits = (BIAS_KNOWN * max(1.0, speed), LAG_KNOWN, SLOPE_KNOWN)
    use = [0, 1, 2]
    while use:
        part, weights = columns[:, use], instruments[:, use]
        normal = weights.T @ part
        scale = np.sqrt(np.abs(np.diag(normal)))
        if np.all(scale > 0.0) and np.linalg.cond(normal / np.outer(scale, scale)) < 1e10:
            inverse = np.linalg.inv(normal)
            values = inverse @ (weights.T @ missed)
            # neighbouring windows share samples: only every `across`-th is independent
            variance = float(np.mean((missed - part @ values) ** 2)) * across
            deviations = np.sqrt(variance * np.diag(inverse @ (weights.T @ weights) @ inverse.T))
            vague = [name for name, deviation in zip(use, deviations) if deviation > limits[name]]
            if not vague:
                answer, stddevs = [np.nan] * 3, [np.nan] * 3
                for name, value, deviation in zip(use, values, deviations):
                    answer[name], stddevs[name] = float(value), float(deviation)
                return tuple(answer), tuple(stddevs)
            use.remove(max(vague))  # the slope first, then the lag, then the bias
        else:
            use.pop()
    return (np.nan,) * 3, (np.nan,) * 3
