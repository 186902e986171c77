# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The quality of a measured reference velocity: its own lag, bias, slope and noise.

The reference of a recording is a sensor too. Its lag and bias are fitted to the measured position,

    integral of the reference = position(t - lag) * slope + bias * t,

over short windows. Their length limits both the drift of the integral and the effect of the
position's quantisation.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.delay import GAP_STEPS
from estimator_pkg.evaluation.options import SMOOTHER
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
LEAST_LAG = 2e-4  # a shorter lag of the truth does not matter [s]
LAG_SURE = 3.0  # a lag is significant, and lags differ, from this many standard deviations on
LAGS_ALIKE = 0.1  # but not if they differ by less than this fraction
ORDERS = (3, 5, 7, 9)  # of the differences that show white noise
CLEARLY_LESS = 0.5  # for white noise all of them agree within this ratio
QUIETEST = 0.1  # the quietest fraction of the record counts; over n samples, the rms of white noise
UNLUCKY = 1.28  # is below its mean there by this many standard deviations
NOISE_BLOCK = 0.2  # length of a block whose power is one value [s],
SHORTEST_BLOCK = 20  # but at least this many samples
MANY_BLOCKS = 20


@dataclass(frozen=True)
class Reference:
    """The quality of a reference; nan where the record does not determine it.

    lag_s, lag_stddev [s]: delay behind the position. bias, bias_stddev [rad/s]: mean error. slope,
    slope_stddev: factor on the true speed. noise [rad/s]: rms of its white noise; for the off-line
    smoother its own error. window_s: length of the windows of the fit. origin: 'sensor' or
    'smoother'.
    """

    lag_s: float = math.nan
    lag_stddev: float = math.nan
    bias: float = math.nan
    bias_stddev: float = math.nan
    slope: float = math.nan
    slope_stddev: float = math.nan
    noise: float = math.nan
    window_s: float = math.nan
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
    return Reference(0.0, 0.0, 0.0, 0.0, 1.0, 0.0, uncertainty, math.nan, SMOOTHER)


class Lag(NamedTuple):
    """Lag of the truth behind the positions, and its standard deviation [s]."""

    lag: float
    stddev: float


def common_lag(references: Iterable[Reference]) -> Lag | None:
    """Return the lag of all joints: of a drive's own filter or clock.

    Against a late truth the estimates that are late by the same time would be best. None if it is
    not significant or not the same, or if the truth is early: then the sensor is late, and so is
    every estimate.
    """
    found = [(each.lag_s, max(each.lag_stddev, 1e-9)) for each in references]
    lags, stddevs = np.array([each for each in found if math.isfinite(each[0])]).reshape(-1, 2).T
    if not len(lags):
        return None
    mean = float(np.average(lags, weights=stddevs**-2.0))
    stddev = float(np.sum(stddevs**-2.0) ** -0.5)
    alike = np.maximum(LAG_SURE * stddevs, max(LAGS_ALIKE * abs(mean), 0.5 * LEAST_LAG))
    same = bool(np.all(np.abs(lags - mean) <= alike))
    return Lag(mean, stddev) if same and mean > max(LEAST_LAG, LAG_SURE * stddev) else None


def white_noise(time: Array, velocity: Array) -> float:
    """Return the rms of the white noise on a velocity [rad/s]; nan for too few samples.

    At usual sample rates the third differences of a motion are small, and those of white noise are
    not. A violent motion has large ones too, so the quietest tenth of the record counts. With the
    order, the differences of white noise grow as expected, and those of a motion that is sampled
    often enough fall: the least counts if it is clearly less.

    Parameters
    ----------
    time : shape (n,), strictly increasing [s]. velocity : shape (n,) [rad/s].
    """
    orders = [order for order in ORDERS if len(time) >= SHORTEST_BLOCK + order]
    if not orders:
        return math.nan
    size = int(max(NOISE_BLOCK / float(np.median(np.diff(time))), SHORTEST_BLOCK))
    found = [_by_differences(velocity, order, size) for order in orders]
    return min(found) if min(found) < CLEARLY_LESS * found[0] else found[0]


def _by_differences(velocity: Array, order: int, size: int) -> float:
    """Return the rms of white noise with these differences, in the quietest blocks of a size."""
    gain = math.comb(2 * order, order)
    squares = np.diff(velocity, order) ** 2 / gain
    last = max(1, len(squares) - size + 1)
    # in a short record blocks overlap, because a quiet stretch may span two of them
    starts = range(0, last, size if last >= MANY_BLOCKS * size else max(1, size // 4))
    powers = [float(np.mean(squares[i : i + size])) for i in starts]
    # sum of the squared correlations of neighbouring differences of white noise
    alike = math.comb(4 * order, 2 * order) / gain**2
    low = 1.0 - UNLUCKY * math.sqrt(0.5 * alike / size) if len(powers) > 1 else 1.0
    return float(np.sqrt(np.quantile(powers, QUIETEST)) / low)


def fit(time: Array, velocity: Array, position: Array, period: float) -> Reference:
    """Return lag, bias, slope and noise of a reference velocity against the measured position.

    Parameters
    ----------
    time : shape (n,), strictly increasing [s].
    velocity : shape (n,), the reference [rad/s].
    position : shape (n,), the measurement at the same times [rad], in any convention.
    period : wrap period [rad]; 0: none.
    """
    good = np.isfinite(velocity) & np.isfinite(position)
    time, velocity, position = time[good], velocity[good], position[good]
    unknown = Reference(noise=white_noise(time, velocity))
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
        values, stddevs = _solve(columns[kept], instruments[kept], missed[kept], across)
        rest = np.abs(missed - columns @ np.nan_to_num(values))
        kept = rest <= WINDOW_OUTLIER * 1.4826 * float(np.median(rest)) + 1e-12
    (bias, lag, slope), (bias_stddev, lag_stddev, slope_stddev) = values.tolist(), stddevs.tolist()
    window = across * step
    return Reference(
        lag, lag_stddev, bias, bias_stddev, 1.0 + slope, slope_stddev, unknown.noise, window
    )


def _solve(columns: Array, instruments: Array, missed: Array, across: int) -> tuple[Array, Array]:
    """Return (bias, lag, slope - 1) and their standard deviations; nan for undetermined ones.

    The noise of the reference in `columns` would bias a least-squares lag towards zero, so the
    equations are weighted with `instruments` that have the same speed but other noise. Parameters
    that the record does not determine (a lag at rest) are omitted.
    """
    speed = float(np.sqrt(np.mean((columns[:, 2] / columns[:, 0]) ** 2)))
    limits = (BIAS_KNOWN * max(1.0, speed), LAG_KNOWN, SLOPE_KNOWN)
    answer, stddevs = np.full(3, np.nan), np.full(3, np.nan)
    use = [0, 1, 2]
    while use:
        part, weights = columns[:, use], instruments[:, use]
        normal = weights.T @ part
        scale = np.sqrt(np.abs(np.diag(normal)))
        if np.any(scale == 0.0) or np.linalg.cond(normal / np.outer(scale, scale)) >= 1e10:
            use.pop()
            continue
        inverse = np.linalg.inv(normal)
        values = inverse @ (weights.T @ missed)
        # neighbouring windows share samples: only every `across`-th is independent
        variance = float(np.mean((missed - part @ values) ** 2)) * across
        deviations = np.sqrt(variance * np.diag(inverse @ (weights.T @ weights) @ inverse.T))
        vague = [name for name, deviation in zip(use, deviations) if deviation > limits[name]]
        if not vague:
            answer[use], stddevs[use] = values, deviations
            break
        use.remove(max(vague))  # the slope first, then the lag, then the bias
    return answer, stddevs
