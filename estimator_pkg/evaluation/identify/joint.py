# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Start values for the parameters of a single joint, from its positions and torques.

The equation of motion is multiplied by smooth windows and integrated by parts, so it needs no
derivative of the measurement (weak form). With a window w that is zero with its slope at both
ends,

    J int w'' q - b int w' q + c int w sgn v + gs int w sin q + gc int w cos q + d int w = int w u

is linear in the parameters: least squares over the windows of the fitted part of the recording.
The delay of the torque is the one that fits best, and frictions are not negative. Torques are the
input times gear ratio and torque constant, which the recording does not determine and the user must
provide.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.identify.data import FIT_FRACTION, LONGEST_GAP, MechanismSamples
from estimator_pkg.models.single_joint import Parameters

Array = NDArray[np.float64]

WINDOW_S = 0.3  # length of a window [s]
OVERLAP = 4  # windows that cover each moment
DELAYS = np.arange(-0.004, 0.0401, 0.001)  # of the torque [s]
PARAMETERS = 6  # columns of the least squares


def first_guess(samples: MechanismSamples, known: Parameters) -> dict[str, float]:
    """Return the parameters of the joint by name of `Parameters`, and input_delay.

    Parameters
    ----------
    known : has gear ratio, torque constant, and the width of the smoothed Coulomb friction.

    Raises
    ------
    UserError : the motion does not determine the parameters.
    """
    time, position = samples.time, samples.positions[:, 0]
    torque = samples.inputs[:, 0] * known.torque_constant * known.gear_ratio
    rows, targets, centres = _windows(time, position, torque, known.coulomb_speed)
    split = time[0] + FIT_FRACTION * (time[-1] - time[0])
    first = centres < split - 0.5 * WINDOW_S
    rows, targets = rows[first], targets[first]
    scale = np.linalg.norm(rows, axis=0)
    if not np.all(scale > 0.0) or np.linalg.cond(rows / scale) > 1e4:
        raise UserError(
            'the motion in the recording does not distinguish inertia, friction and '
            'gravity: record more varied motion'
        )
    solved = np.linalg.lstsq(rows / scale, targets, rcond=None)[0]
    best = int(np.argmin(np.sum((rows / scale @ solved - targets) ** 2, axis=0)))
    inertia, damping, coulomb, sine, cosine, bias = (solved[:, best] / scale).tolist()
    if not inertia > 0.0:
        raise UserError(
            f'the best-fitting inertia is {inertia:.3g}, but it must be positive: check the sign '
            'of the torque, and that positions and torques are of the same joint'
        )
    return {
        'inertia': inertia,
        'damping': max(damping, 0.0),
        'coulomb': max(coulomb, 0.0),
        'gravity': math.hypot(sine, cosine),
        'hanging': math.atan2(-cosine, sine),
        'bias': bias,
        # the node takes an effort as the one since the previous sample: half a sample earlier
        'input_delay': float(DELAYS[best]) + 0.5 * float(np.median(np.diff(time))),
    }


def _windows(
    time: Array, position: Array, torque: Array, width: float
) -> tuple[Array, Array, Array]:
    """Return (rows of the least squares, right-hand sides for each delay, the windows' centres)."""
    steps = np.diff(time)
    usual = float(np.median(steps))
    half = 0.5 * WINDOW_S
    kernel = np.hanning((max(3, round(0.02 / usual)) | 1) + 2)
    rough = np.convolve(np.gradient(position, time), kernel[1:-1] / kernel.sum(), mode='same')
    weights = 0.5 * (np.append(steps, 0.0) + np.append(0.0, steps))
    signs = np.tanh(rough / width)
    late = [np.interp(time - delay, time, torque) for delay in DELAYS]
    signals = np.column_stack(
        [signs, np.sin(position), np.cos(position), np.ones(len(time)), *late]
    )
    rows, centres = [], []
    for centre in np.arange(time[0] + half, time[-1] - half, WINDOW_S / OVERLAP):
        begin, end = np.searchsorted(time, (centre - half, centre + half))
        if end - begin < 8 or np.max(steps[begin : end - 1]) > LONGEST_GAP * usual:
            continue
        s = (time[begin:end] - centre) / half
        inner = 1.0 - s * s
        w = weights[begin:end]
        slope = w * -6.0 * s * inner**2 / half
        bend = w * inner * (24.0 * s * s - 6.0 * inner) / half**2
        q = position[begin:end] - position[begin]
        rows.append([bend @ q, -(slope @ q), *((w * inner**3) @ signals[begin:end])])
        centres.append(centre)
    every = np.array(rows).reshape(-1, 2 + signals.shape[1])
    return every[:, :PARAMETERS], every[:, PARAMETERS:], np.array(centres)
