# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Fit a model's parameters by output error: simulated motion under the recorded inputs.

The recording is cut into pieces. In each, the model starts at positions and velocities of its own,
and moves under the recorded inputs. SciPy's `least_squares` minimises position minus measurement
over the pieces of the first part, by the parameters and the starts. No measurement is
differentiated, so noise and quantisation cause no bias.

Standard deviations come from the sandwich estimator with a piece as the unit: residuals may be
correlated in any way within a piece, as they are with a coarse encoder or a wrong model.
Ljung, System Identification (1999), 7.4 and 9.2; MacKinnon and White (1985) for small samples.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.identify.data import (
    PLAIN_STEP,
    MechanismSamples,
    accumulated,
    cut,
    thinned,
)
from estimator_pkg.evaluation.identify.model import Unknowns
from estimator_pkg.models.motion import course

Array = NDArray[np.float64]

MODEL_STEP = 5e-4  # longest integration step of a model of ours [s]
ROUNDS = 60  # largest number of simulations of all pieces in a fit
SETTLING = 4  # steps of Gauss and Newton to the starts at fixed parameters
START_STEP = 1e-5  # of the slopes by the start [rad or m, and per second]
CONVERGED = 1e-3, 1e-6  # smallest relative changes of cost and parameters, for weights and fit
DELAY = 'input_delay'
LARGEST_DELAY = 0.1  # largest delay of the inputs [s]


class FitResult(NamedTuple):
    """Parameters with their standard deviations.

    names : of the model's parameters, then input_delay if the model has inputs.
    values, deviations : shape (p,).
    residual, residual_elsewhere : rms of position minus measurement of each joint [rad or m], in
        the fitted and in the held-out part.
    explained, explained_elsewhere : fraction of the squared motion beyond constant velocity that
        the model explains in each part.
    pieces : their numbers in both parts.
    """

    names: tuple[str, ...]
    values: Array
    deviations: Array
    residual: Array
    residual_elsewhere: Array
    explained: float
    explained_elsewhere: float
    pieces: tuple[int, int]


def fit(
    recording: MechanismSamples,
    unknowns: Unknowns,
    delay: float = 0.0,
    advance: Callable[[int], None] = lambda rounds: None,
) -> FitResult:
    """Return the parameters that explain the recording best.

    Parameters
    ----------
    delay : start value of the inputs' delay [s].
    advance : called with 1 after each simulation of all pieces.

    Raises
    ------
    UserError : the recording is too short, or its motion does not determine the parameters.
    """
    mechanics = unknowns.make(unknowns.start)
    recording = recording if mechanics.ours else thinned(recording)
    driven = mechanics.inputs > 0
    numbers = np.append(unknowns.start, [delay] if driven else [])
    low = np.append(unknowns.lowest, [-LARGEST_DELAY] if driven else [])
    high = np.append(unknowns.highest, [LARGEST_DELAY] if driven else [])
    names = (*unknowns.names, DELAY) if driven else unknowns.names
    first, second = (_Part(recording, unknowns, pieces) for pieces in cut(recording))
    for tolerance in CONVERGED:  # the joints' weights follow from the residuals
        if not np.all(np.isfinite(first.rest(numbers))):
            raise UserError(
                'the model diverges from the recording with the start values of its '
                'parameters: give better ones with --start'
            )
        numbers = first.solve(numbers, low, high, tolerance, advance)
        residual, _ = first.quality(numbers)
        first.weights = second.weights = 1.0 / np.maximum(residual, 1e-12)
    second.settle(numbers)
    residual_elsewhere, explained_elsewhere = second.quality(numbers)
    return FitResult(
        names,
        numbers,
        _deviations(*first.slopes(numbers, first.starts, high), names),
        residual,
        residual_elsewhere,
        first.quality(numbers)[1],
        explained_elsewhere,
        (len(first.pieces), len(second.pieces)),
    )


class _Part:
    """A part of a recording, and the starts of its pieces, shape (k, 2 n): q, then v."""

    def __init__(
        self, recording: MechanismSamples, unknowns: Unknowns, pieces: Sequence[slice]
    ) -> None:
        self.pieces = pieces
        self.weights: Array = np.ones(recording.positions.shape[1])  # of the joints
        self.size = sum(recording.positions[piece].size for piece in pieces)
        self.starts = np.array([_parabola(recording, piece) for piece in pieces])
        self._recording, self._unknowns = recording, unknowns
        self._total = accumulated(recording.time, recording.inputs)

    def solve(
        self,
        numbers: Array,
        low: Array,
        high: Array,
        tolerance: float,
        advance: Callable[[int], None],
    ) -> Array:
        """Fit parameters, from `low` to `high`, and starts; return the parameters."""
        from scipy.linalg import block_diag
        from scipy.optimize import least_squares

        count, free = len(numbers), np.full(self.starts.size, np.inf)

        def rest(point: Array) -> Array:
            advance(1)
            try:
                return self.rest(point[:count], point[count:].reshape(self.starts.shape))
            except UserError:  # invalid parameters
                return np.full(self.size, np.nan)

        def slopes(point: Array) -> Array:
            starts = point[count:].reshape(self.starts.shape)
            _, by_number, by_start = self.slopes(point[:count], starts, high)
            return np.hstack([np.vstack(by_number), block_diag(*by_start)])

        solved = least_squares(
            rest,
            np.append(np.clip(numbers, low, high), self.starts),
            slopes,
            (np.append(low, -free), np.append(high, free)),
            x_scale='jac',
            ftol=tolerance,
            xtol=tolerance,
            gtol=None,
            max_nfev=ROUNDS,
        )
        self.starts = solved.x[count:].reshape(self.starts.shape)
        at_bound = solved.active_mask[:count]
        return np.where(at_bound < 0, low, np.where(at_bound > 0, high, solved.x[:count]))

    def settle(self, numbers: Array) -> None:
        """Fit the starts at these parameters, by Gauss and Newton."""
        for _ in range(SETTLING):
            rests, by_start = self._by_start(numbers, self.starts)
            changes = [np.linalg.lstsq(*pair, rcond=None)[0] for pair in zip(by_start, rests)]
            self.starts = self.starts - np.array(changes)

    def rest(self, numbers: Array, starts: Array | None = None) -> Array:
        """Return weighted position minus measurement of all pieces, shape (size,)."""
        return np.concatenate(self._rests(numbers, self.starts if starts is None else starts))

    def slopes(
        self, numbers: Array, starts: Array, high: Array
    ) -> tuple[list[Array], list[Array], list[Array]]:
        """Return residuals, their slopes by parameter and by start, of each piece.

        They have shape (m,), (m, p) and (m, 2 n). Parameters stay below `high`.
        """
        rests, by_start = self._by_start(numbers, starts)
        steps = 1e-4 * np.maximum(np.abs(numbers), 0.01)
        steps = np.where(numbers + steps > high, -steps, steps)
        others = [self._rests(numbers + step, starts) for step in np.diag(steps)]
        by_number = [
            np.stack([(each[k] - rest) / step for each, step in zip(others, steps)], axis=1)
            for k, rest in enumerate(rests)
        ]
        return rests, by_number, by_start

    def _by_start(self, numbers: Array, starts: Array) -> tuple[list[Array], list[Array]]:
        """Return residuals, and their slopes by the start, shape (m, 2 n), of each piece."""
        count, shifts = len(self.pieces), START_STEP * np.eye(starts.shape[1])
        moved = self._rests(numbers, np.concatenate([starts, *(starts + each for each in shifts)]))
        rests = moved[:count]
        return rests, [
            np.stack([each - rest for each in moved[k + count :: count]], axis=1) / START_STEP
            for k, rest in enumerate(rests)
        ]

    def quality(self, numbers: Array) -> tuple[Array, float]:
        """Return the rms of position minus measurement, shape (n,), and the explained fraction.

        The latter is 1 minus the squared residual over that of motion at constant velocity.
        """
        rest = self.rest(numbers).reshape(-1, len(self.weights))
        straight = 0.0
        for piece in self.pieces:
            time = self._recording.time[piece]
            powers = np.vander(time - time[0], 2)
            measured = self._recording.positions[piece] * self.weights
            line = powers @ np.linalg.lstsq(powers, measured, rcond=None)[0]
            straight += float(np.sum((measured - line) ** 2))
        rms = np.sqrt(np.mean((rest / self.weights) ** 2, axis=0))
        return rms, 1.0 - float(np.sum(rest**2)) / straight if straight > 0.0 else -np.inf

    def _rests(self, numbers: Array, starts: Array) -> list[Array]:
        """Return weighted position minus measurement, shape (m,), for starts of all pieces.

        All pieces move side by side: short ones stop, with steps of length 0.
        """
        time, measured = self._recording.time, self._recording.positions
        pieces = [*self.pieces] * (len(starts) // len(self.pieces))
        mechanics = self._unknowns.make(numbers[: len(self._unknowns.names)])
        lengths = [piece.stop - piece.start for piece in pieces]
        steps = np.zeros((max(lengths) - 1, len(pieces), 1))
        inputs = np.zeros((len(steps), len(pieces), mechanics.inputs))
        for k, (piece, length) in enumerate(zip(pieces, lengths)):
            steps[: length - 1, k, 0] = np.diff(time[piece])
            for column in range(mechanics.inputs):
                acted = np.interp(time[piece] - numbers[-1], time, self._total[:, column])
                inputs[: length - 1, k, column] = np.diff(acted) / np.diff(time[piece])
        longest = MODEL_STEP if mechanics.ours else PLAIN_STEP
        parts = np.ceil(steps.max(axis=(1, 2)) / longest - 1e-6).astype(int)
        q, v = np.split(starts, 2, axis=1)
        with np.errstate(all='ignore'):  # parameters far off: the model may run away
            positions, _ = course(mechanics, q, v, inputs, steps, parts.tolist())
            return [
                ((positions[:length, k] - measured[piece]) * self.weights).ravel()
                for k, (piece, length) in enumerate(zip(pieces, lengths))
            ]


def _parabola(recording: MechanismSamples, piece: slice) -> Array:
    """Return positions and velocities [SI] at the start, shape (2 n,): those of a parabola."""
    count = min(piece.stop - piece.start, max(8, (piece.stop - piece.start) // 4))
    rows = slice(piece.start, piece.start + count)
    time = recording.time[rows] - recording.time[piece.start]
    found = np.linalg.lstsq(np.vander(time, 3), recording.positions[rows], rcond=None)[0]
    return np.concatenate([found[2], found[1]])


def _deviations(
    rests: Sequence[Array],
    by_number: Sequence[Array],
    by_start: Sequence[Array],
    names: Sequence[str],
) -> Array:
    """Return one standard deviation of each parameter, shape (p,); raise UserError.

    Parameters
    ----------
    rests, by_number, by_start : of each piece, as those of `_Part.slopes`.
    """
    bases = [np.linalg.qr(each)[0] for each in by_start]  # what another start can change
    slopes = [each - basis @ (basis.T @ each) for each, basis in zip(by_number, bases)]
    square = np.array(sum(each.T @ each for each in slopes))
    scale = np.sqrt(np.diag(square))
    normal = square / np.outer(scale, scale) if np.all(scale > 0.0) else np.diag(scale > 0.0)
    sizes, axes = np.linalg.eigh(normal)
    if sizes[0] < 1e-9:
        mixed = [name for name, part in zip(names, np.abs(axes[:, 0])) if part > 0.3]
        raise UserError(
            f'the motion in the recording does not determine {", ".join(mixed)}: record more '
            'varied motion, or fix some of them with --set'
        )
    inverse = np.linalg.inv(normal) / np.outer(scale, scale)
    middle = np.zeros_like(square)
    for rest, by in zip(rests, slopes):
        # the piece is part of the fit, which makes its residual too small
        lever = by.T @ by @ inverse
        push = np.linalg.solve(np.eye(len(lever)) - lever, by.T @ rest)  # by is normal to bases
        middle += np.outer(push, push)
    count = len(rests)
    found: Array = np.sqrt(np.diag(inverse @ middle @ inverse) * (count - 1.0) / count)
    return found
