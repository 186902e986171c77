# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Fit the parameters of a single joint to a recording of its positions and torques.

The equation of motion is multiplied by smooth windows and integrated by parts, so it needs no
derivative of the measurement (weak form). With a window w that is zero with its slope at both
ends,

    J int w'' q - b int w' q + c int w sgn v + gs int w sin q + gc int w cos q + d int w = int w u

is linear in the parameters: least squares over the windows of one part of the recording; the other
part validates. The delay of the torque is the one that fits best. Torques are the input times gear
ratio and torque constant, which the recording does not determine and the user must provide.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UserError

Array = NDArray[np.float64]

WINDOW = 0.3  # length of a window [s]
OVERLAP = 4  # windows that cover each moment
PART = 0.6  # fraction of the recording for the fit
DELAYS = np.arange(-0.004, 0.0401, 0.001)  # of the torque [s]
GAP = 5.0  # longest gap within a window, in median sample times
FEWEST = 20  # smallest number of windows
COLUMNS = ('inertia', 'damping', 'coulomb', 'gravity_sin', 'gravity_cos', 'bias')


class Identified(NamedTuple):
    """Parameters with their standard deviations.

    values, deviations : by name of `single_joint.Parameters` (and input_delay).
    explained, explained_elsewhere : fraction of the torque's variance that the model explains, in
        the fitted and in the held-out part of the recording.
    residual : rms of the unexplained torque in the held-out part [N m], per window.
    windows : their numbers in both parts.
    """

    values: dict[str, float]
    deviations: dict[str, float]
    explained: float
    explained_elsewhere: float
    residual: float
    windows: tuple[int, int]


def identify(time: Array, position: Array, torque: Array, width: float) -> Identified:
    """Return the parameters of the joint.

    Parameters
    ----------
    time, position, torque : shape (n,) [s, rad, N m]; positions not wrapped.
    width : width of the smoothed sign of the Coulomb friction [rad/s].

    Raises
    ------
    UserError : the recording is too short, or its motion does not determine the parameters.
    """
    velocity = _velocity(time, position)
    best: tuple[float, float, Any] | None = None
    for delay in DELAYS:
        rows, wanted, centres = _windows(
            time, position, velocity, np.interp(time - delay, time, torque), width
        )
        split = time[0] + PART * (time[-1] - time[0])
        first, second = centres < split - 0.5 * WINDOW, centres > split + 0.5 * WINDOW
        if np.count_nonzero(first) < FEWEST or np.count_nonzero(second) < FEWEST // 2:
            raise UserError(
                f'the recording is too short to identify a joint: it has {len(centres)} '
                f'windows of {WINDOW:g} s without a gap and needs {2 * FEWEST}: record longer'
            )
        solved = _solve(rows[first], wanted[first])
        rest = float(np.mean((wanted[first] - rows[first] @ solved[0]) ** 2))
        if best is None or rest < best[0]:
            best = (rest, float(delay), (rows, wanted, first, second, *solved))
    assert best is not None
    rest, found, (rows, wanted, first, second, answer, covariance) = best
    scale = WINDOW * 0.4571428571  # integral of the window
    values, deviations = _named(answer, covariance)
    # the node takes an effort as the one since the previous sample: half a sample earlier
    values['input_delay'] = found + 0.5 * float(np.median(np.diff(time)))
    deviations['input_delay'] = float(DELAYS[1] - DELAYS[0]) / math.sqrt(12.0)

    def explained(part: NDArray[np.bool_]) -> float:
        return 1.0 - float(np.var(wanted[part] - rows[part] @ answer) / np.var(wanted[part]))

    left = wanted[second] - rows[second] @ answer
    return Identified(
        values,
        deviations,
        explained(first),
        explained(second),
        float(np.sqrt(np.mean(left**2))) / scale,
        (int(np.count_nonzero(first)), int(np.count_nonzero(second))),
    )


def _velocity(time: Array, position: Array) -> Array:
    """Return a rough velocity, only for the sign of the friction."""
    count = max(3, round(0.02 / float(np.median(np.diff(time))))) | 1
    kernel = np.hanning(count + 2)[1:-1]
    smooth = np.convolve(np.gradient(position, time), kernel / kernel.sum(), mode='same')
    return smooth


def _windows(
    time: Array, position: Array, velocity: Array, torque: Array, width: float
) -> tuple[Array, Array, Array]:
    """Return (rows of the least squares, their right-hand sides, the windows' centres)."""
    steps = np.diff(time)
    usual = float(np.median(steps))
    half = 0.5 * WINDOW
    weights = np.zeros(len(time))
    weights[:-1] += 0.5 * steps
    weights[1:] += 0.5 * steps
    signals = np.column_stack(
        [np.tanh(velocity / width), np.sin(position), np.cos(position), np.ones(len(time)), torque]
    )
    rows, wanted, centres = [], [], []
    for centre in np.arange(time[0] + half, time[-1] - half, WINDOW / OVERLAP):
        begin, end = np.searchsorted(time, (centre - half, centre + half))
        if end - begin < 8 or np.max(steps[begin : end - 1]) > GAP * usual:
            continue
        s = (time[begin:end] - centre) / half
        inner = 1.0 - s * s
        w = weights[begin:end]
        window = w * inner**3
        slope = w * -6.0 * s * inner**2 / half
        bend = w * inner * (24.0 * s * s - 6.0 * inner) / half**2
        q = position[begin:end] - position[begin]
        integrals = window @ signals[begin:end]
        rows.append([bend @ q, -(slope @ q), *integrals[:4]])
        wanted.append(integrals[4])
        centres.append(centre)
    return np.array(rows).reshape(-1, len(COLUMNS)), np.array(wanted), np.array(centres)


def _solve(rows: Array, wanted: Array) -> tuple[Array, Array]:
    """Return (answer, covariance); negative frictions are set to zero."""
    use = np.ones(len(COLUMNS), bool)
    while True:
        part = rows[:, use]
        scale = np.linalg.norm(part, axis=0)
        normal = (part / np.maximum(scale, 1e-300)).T @ (part / np.maximum(scale, 1e-300))
        if not np.all(scale > 0.0) or np.linalg.cond(normal) > 1e8:
            raise UserError(
                'the motion in the recording does not distinguish inertia, friction and '
                'gravity: record more varied motion'
            )
        inverse = np.linalg.inv(normal) / np.outer(scale, scale)
        answer = np.zeros(len(COLUMNS))
        answer[use] = inverse @ part.T @ wanted
        wrong = [k for k in (1, 2) if use[k] and answer[k] < 0.0]
        if not wrong:
            rest = wanted - rows @ answer
            covariance = np.zeros((len(COLUMNS), len(COLUMNS)))
            # neighbouring windows share their samples
            variance = OVERLAP * float(rest @ rest) / max(1, len(wanted) - int(use.sum()))
            covariance[np.ix_(use, use)] = inverse * variance
            return answer, covariance
        use[min(wrong, key=lambda k: answer[k] * np.linalg.norm(rows[:, k]))] = False


def _named(answer: Array, covariance: Array) -> tuple[dict[str, float], dict[str, float]]:
    """Return values and deviations by the model's names; amplitude and angle of gravity."""
    if not answer[0] > 0.0:
        raise UserError(
            f'the best-fitting inertia is {answer[0]:.3g}, but it must be positive: check the sign '
            'of the torque, and that positions and torques are of the same joint'
        )
    sine, cosine = float(answer[3]), float(answer[4])
    size = math.hypot(sine, cosine)
    stddev = np.sqrt(np.diag(covariance))
    block = covariance[3:5, 3:5]
    along = np.array([sine, cosine]) / size if size > 0.0 else np.array([1.0, 0.0])
    across = np.array([-along[1], along[0]])
    values = {
        'inertia': float(answer[0]),
        'damping': float(answer[1]),
        'coulomb': float(answer[2]),
        'gravity': size,
        'hanging': math.atan2(-cosine, sine),
        'bias': float(answer[5]),
    }
    deviations = {
        'inertia': float(stddev[0]),
        'damping': float(stddev[1]),
        'coulomb': float(stddev[2]),
        'gravity': math.sqrt(float(along @ block @ along)),
        'hanging': math.sqrt(float(across @ block @ across)) / size if size else math.pi,
        'bias': float(stddev[5]),
    }
    return values, deviations
