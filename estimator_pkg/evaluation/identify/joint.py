"""The numbers of a single joint from a recording of its positions and torques.

The equation of motion is multiplied by smooth windows and integrated by parts, so that it needs no
derivative of the measurement (the weak form): with a window w that vanishes with its slope at both
ends,

    J int w'' q - b int w' q + c int w sgn v + gs int w sin q + gc int w cos q + d int w = int w u

is linear in the numbers: least squares, window by window, over one part of the recording; the other
part judges. The delay of the torque is the one that fits best. Torques in units of the input times
gear ratio and torque constant, which a recording cannot tell from the rest and so are given.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UserError
from estimator_pkg.models.single_joint import Parameters

Array = NDArray[np.float64]

WINDOW = 0.3  # s, length of a window
OVERLAP = 4  # windows that cover a moment
PART = 0.6  # of the recording that the numbers are found from
DELAYS = np.arange(-0.004, 0.0401, 0.001)  # s, of the torque
GAP = 5.0  # median sample times: no window reaches across a longer hole
FEWEST = 20  # windows
COLUMNS = ('inertia', 'damping', 'coulomb', 'gravity_sin', 'gravity_cos', 'bias')


class Identified(NamedTuple):
    """Numbers with their standard deviations.

    values, deviations : by name of `single_joint.Parameters` (and input_delay).
    explained, explained_elsewhere : part of the torque's variance that the model explains, where
        the numbers are from and in the other part of the recording.
    residual : rms torque that it does not explain there [N m], window by window.
    windows : how many, in both parts.
    """

    values: dict[str, float]
    deviations: dict[str, float]
    explained: float
    explained_elsewhere: float
    residual: float
    windows: tuple[int, int]


def identify(time: Array, position: Array, torque: Array, width: float) -> Identified:
    """The numbers of the joint.

    Parameters
    ----------
    time, position, torque : shape (n,) [s, rad, N m]; positions not wrapped.
    width : of the Coulomb friction's change of sign [rad/s].

    Raises
    ------
    UserError : too short, or a motion that does not tell the numbers.
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
                f'the recording is too short to identify a joint: {len(centres)} '
                f'windows of {WINDOW:g} s without a hole; {2 * FEWEST} are needed'
            )
        solved = _solve(rows[first], wanted[first])
        rest = float(np.mean((wanted[first] - rows[first] @ solved[0]) ** 2))
        if best is None or rest < best[0]:
            best = (rest, float(delay), (rows, wanted, first, second, *solved))
    assert best is not None
    rest, found, (rows, wanted, first, second, answer, covariance) = best
    scale = WINDOW * 0.4571428571  # integral of the window
    values, deviations = _named(answer, covariance)
    # the node takes an effort to have acted since the sample before: half a sample earlier
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
    """A rough velocity, for the sign of the friction alone."""
    count = max(3, round(0.02 / float(np.median(np.diff(time))))) | 1
    kernel = np.hanning(count + 2)[1:-1]
    smooth = np.convolve(np.gradient(position, time), kernel / kernel.sum(), mode='same')
    return smooth


def _windows(
    time: Array, position: Array, velocity: Array, torque: Array, width: float
) -> tuple[Array, Array, Array]:
    """(rows of the least squares, their right-hand sides, the windows' centres)."""
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
    """(answer, covariance); negative frictions are left out, as they are none."""
    use = np.ones(len(COLUMNS), bool)
    while True:
        part = rows[:, use]
        scale = np.linalg.norm(part, axis=0)
        normal = (part / np.maximum(scale, 1e-300)).T @ (part / np.maximum(scale, 1e-300))
        if not np.all(scale > 0.0) or np.linalg.cond(normal) > 1e8:
            raise UserError(
                'the motion in the recording does not tell inertia, friction and '
                'gravity apart: it needs to move more'
            )
        inverse = np.linalg.inv(normal) / np.outer(scale, scale)
        answer = np.zeros(len(COLUMNS))
        answer[use] = inverse @ part.T @ wanted
        wrong = [k for k in (1, 2) if use[k] and answer[k] < 0.0]
        if not wrong:
            rest = wanted - rows @ answer
            covariance = np.zeros((len(COLUMNS), len(COLUMNS)))
            # neighbouring windows share their samples
            spread = OVERLAP * float(rest @ rest) / max(1, len(wanted) - int(use.sum()))
            covariance[np.ix_(use, use)] = inverse * spread
            return answer, covariance
        use[min(wrong, key=lambda k: answer[k] * np.linalg.norm(rows[:, k]))] = False


def _named(answer: Array, covariance: Array) -> tuple[dict[str, float], dict[str, float]]:
    """By the names of the model; amplitude and angle of gravity from its two parts."""
    if not answer[0] > 0.0:
        raise UserError(
            f'the inertia that fits best is {answer[0]:.3g}: positions and torques do '
            'not belong together (a wrong sign of the torque?)'
        )
    sine, cosine = float(answer[3]), float(answer[4])
    size = math.hypot(sine, cosine)
    spread = np.sqrt(np.diag(covariance))
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
        'inertia': float(spread[0]),
        'damping': float(spread[1]),
        'coulomb': float(spread[2]),
        'gravity': math.sqrt(float(along @ block @ along)),
        'hanging': math.sqrt(float(across @ block @ across)) / size if size else math.pi,
        'bias': float(spread[5]),
    }
    return values, deviations


def parameters_of(
    found: Identified, width: float, torque_constant: float, gear_ratio: float, period: float
) -> Parameters:
    """The model's parameters."""
    numbers = {name: value for name, value in found.values.items() if name != 'input_delay'}
    return Parameters(
        **numbers,
        coulomb_speed=width,
        torque_constant=torque_constant,
        gear_ratio=gear_ratio,
        period=period,
    )
