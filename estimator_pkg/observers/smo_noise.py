"""What white measurement noise does to a sliding-mode observer.

Its injections are a gain and a remnant at innovations of one size (see `describing`). The gain
makes a linear observer; the remnant, the chattering about it, acts on that as a further white
noise, because the innovation itself is nearly white. Both follow from the functions as they are
stepped, so that a step so long that the sliding mode is met in one sample, where the observer is a
finite difference, comes out right too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.observers.describing import Describing
from estimator_pkg.observers.mechanical_noise import NoiseGains
from estimator_pkg.observers.steady_noise import settled

Array = NDArray[np.float64]

def scatter(pairs: Sequence[Describing], damping: Array, dt: float, *, implicit: bool,
            linear_hold: bool) -> NoiseGains:
    """Variances of estimate and innovation, per variance of noise and by the remnants.

    Parameters
    ----------
    pairs : one per position.
    damping : the velocities' own rates -M^-1 D, shape (n, n).
    implicit, linear_hold : how a step is made.
    """
    n = len(pairs)
    eye, nought = np.eye(n), np.zeros((n, n))
    # of the velocity over a sample, by the damping as it is stepped
    glide = np.linalg.inv(eye - dt * damping) if implicit else eye + dt * damping
    position = np.diag([pair.position for pair in pairs])
    velocity = np.diag([pair.velocity for pair in pairs])
    # the state is (offset e, velocity, noise of the sample before); with it the innovation
    if implicit:
        ahead = dt * glide
        seen = np.hstack([eye, ahead, eye if linear_hold else nought])
        of_noise = -eye if linear_hold else nought
        offset = position @ seen
        entering = position @ of_noise
        if not linear_hold:
            offset = offset + np.hstack([nought, nought, eye])
            entering = entering - eye
        speed = np.hstack([nought, glide, nought]) - dt * velocity @ seen
        of_speed = -dt * velocity @ of_noise
    else:
        seen, of_noise = np.hstack([eye, nought, nought]), nought
        offset = np.hstack([eye - dt * position, dt * eye, eye])
        entering = -eye
        speed = np.hstack([-dt * velocity, glide, nought])
        of_speed = nought
    step = np.vstack([offset, speed, np.zeros((n, 3 * n))])
    arrival = np.vstack([entering, of_speed, eye])
    remnant = np.zeros((3 * n, 3 * n))
    turn = np.diag([1.0, -dt]) if implicit else np.diag([-dt, -dt])
    for index, pair in enumerate(pairs):
        rows = np.ix_((index, n + index), (index, n + index))
        remnant[rows] = turn @ pair.remnant @ turn
    shown = np.hstack([eye, nought, eye])  # the estimate's own error: offset plus noise of y
    speeds = np.hstack([nought, eye, nought])

    def variances(rows: Array, covariance: Array) -> Array:
        found: Array = np.einsum('ij,jk,ik->i', rows, covariance, rows)
        return found

    per_noise = np.zeros((3, n, n))
    for joint in range(n):
        came = arrival[:, joint]
        covariance = settled(step, came[:, None] * came)
        per_noise[0, :, joint] = variances(shown, covariance)
        per_noise[1, :, joint] = variances(speeds, covariance)
        per_noise[2, :, joint] = variances(seen, covariance) + of_noise[:, joint] ** 2
    chatter = settled(step, remnant)
    return NoiseGains(per_noise[0], per_noise[1], per_noise[2], variances(shown, chatter),
                      variances(speeds, chatter), variances(seen, chatter))
