# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Fit a model's parameters by output error: simulated motion under the recorded inputs.

The recording is cut into pieces. In each, the model starts at positions and velocities of its own,
which are fitted with the parameters, and moves under the recorded inputs. SciPy's `least_squares`
minimises position minus measurement over the pieces of the first part. It varies the parameters
alone: the starts follow from the linearised pieces (variable projection, Golub and Pereyra, 2003).
No measurement is differentiated, so noise and quantisation cause no bias.

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
from estimator_pkg.evaluation.identify.model import Unknowns
from estimator_pkg.evaluation.identify.pieces import (
    PLAIN_STEP,
    MechanismSamples,
    accumulated,
    cut,
    thinned,
)
from estimator_pkg.models.motion import course

Array = NDArray[np.float64]
Pieces = Sequence[slice]
Predict = Callable[[Array, Pieces, Sequence[Array]], list[Array]]  # of the starts: positions

MODEL_STEP = 5e-4  # longest integration step of a model of ours [s]
ROUNDS = 60  # largest number of simulations of all pieces in a fit
START_STEP = 1e-5  # of the slopes by the start [rad or m, and per second]
SETTLING = 4  # steps of Gauss and Newton to the starts at given parameters
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
    from scipy.optimize import least_squares

    mechanics = unknowns.make(unknowns.start)
    recording = recording if mechanics.ours else thinned(recording)
    driven = mechanics.inputs > 0
    numbers = np.append(unknowns.start, [delay] if driven else [])
    low = np.append(unknowns.lowest, [-LARGEST_DELAY] if driven else [])
    high = np.append(unknowns.highest, [LARGEST_DELAY] if driven else [])
    predict = _predictor(recording, unknowns, driven)
    first, second = (_Part(recording, predict, pieces, high) for pieces in cut(recording))

    def rest(numbers: Array) -> Array:
        advance(1)
        try:
            return first.rest(numbers)
        except UserError:  # invalid parameters
            return np.full(first.size, np.nan)

    for tolerance in CONVERGED:  # the joints' weights follow from the residuals
        if not np.all(np.isfinite(first.rest(numbers))):
            raise UserError(
                'the model diverges from the recording with the start values of its '
                'parameters: give better ones with --start'
            )
        solved = least_squares(
            rest,
            np.clip(numbers, low, high),
            first.slopes,
            (low, high),
            x_scale='jac',
            ftol=tolerance,
            xtol=tolerance,
            gtol=None,
            max_nfev=ROUNDS,
        )
        numbers = np.where(solved.active_mask < 0, low, solved.x)
        numbers = np.where(solved.active_mask > 0, high, numbers)
        residual, explained = first.quality(numbers)
        first.weights = second.weights = 1.0 / np.maximum(residual, 1e-12)
    names = (*unknowns.names, DELAY) if driven else unknowns.names
    deviations = _deviations(first, numbers, names)
    second.settle(numbers)
    residual_elsewhere, explained_elsewhere = second.quality(numbers)
    of_all = residual, residual_elsewhere, first.quality(numbers)[1], explained_elsewhere
    pieces = len(first.pieces), len(second.pieces)
    return FitResult(names, numbers, deviations, *of_all, pieces)


def _predictor(recording: MechanismSamples, unknowns: Unknowns, driven: bool) -> Predict:
    """Return a function for the positions in pieces by parameters and starts (q, then v)."""
    time = recording.time
    total = accumulated(time, recording.inputs)

    def predict(numbers: Array, pieces: Pieces, starts: Sequence[Array]) -> list[Array]:
        """Move all pieces side by side: short ones stop, with steps of length 0."""
        mechanics = unknowns.make(numbers[:-1] if driven else numbers)
        lengths = [piece.stop - piece.start for piece in pieces]
        steps = np.zeros((max(lengths) - 1, len(pieces), 1))
        inputs = np.zeros((len(steps), len(pieces), mechanics.inputs))
        for k, (piece, length) in enumerate(zip(pieces, lengths)):
            steps[: length - 1, k, 0] = np.diff(time[piece])
            for column in range(mechanics.inputs):
                acted = np.interp(time[piece] - numbers[-1], time, total[:, column])
                inputs[: length - 1, k, column] = np.diff(acted) / np.diff(time[piece])
        longest = MODEL_STEP if mechanics.ours else PLAIN_STEP
        parts = np.ceil(steps.max(axis=(1, 2)) / longest - 1e-6).astype(int)
        q, v = np.split(np.array(starts), 2, axis=1)
        positions, _ = course(mechanics, q, v, inputs, steps, parts.tolist())
        return [positions[:length, k] for k, length in enumerate(lengths)]

    return predict


class _Linear(NamedTuple):
    """A piece, linearised about parameters and a start."""

    start: Array
    rest: Array
    by_number: Array  # slopes by parameter
    basis: Array  # orthonormal columns: the residuals that another start can change
    to_start: Array  # (residual) -> the change of the start that removes most of it

    def without(self, values: Array) -> Array:
        """Return residuals or slopes, shape (m, ...), less what another start would remove."""
        return values - self.basis @ (self.basis.T @ values)


class _Part:
    """A part of a recording, whose pieces have the starts that fit best."""

    def __init__(
        self, recording: MechanismSamples, predict: Predict, pieces: Pieces, high: Array
    ) -> None:
        self.pieces = pieces
        self.weights: Array = np.ones(recording.positions.shape[1])  # of the joints
        self.size = sum(recording.positions[piece].size for piece in pieces)
        self._recording, self._predict, self._high = recording, predict, high
        self._starts = [_parabola(recording, piece) for piece in pieces]
        self._at: Array = np.zeros(0)
        self._lines: list[_Linear] = []

    def _starts_at(self, numbers: Array) -> list[Array]:
        """Return the starts that fit these parameters, by the last linearisation."""
        if not self._lines:
            return self._starts
        change = numbers - self._at
        return [
            line.start - line.to_start @ (line.rest + line.by_number @ change)
            for line in self._lines
        ]

    def _rests(self, numbers: Array, starts: Sequence[Array]) -> list[Array]:
        """Return weighted position minus measurement, shape (m,), for starts of all pieces."""
        pieces = [*self.pieces] * (len(starts) // len(self.pieces))
        measured = self._recording.positions
        with np.errstate(all='ignore'):  # parameters far off: the model may run away
            return [
                ((positions - measured[piece]) * self.weights).ravel()
                for positions, piece in zip(self._predict(numbers, pieces, starts), pieces)
            ]

    def rest(self, numbers: Array) -> Array:
        """Return the residuals of all pieces, shape (size,)."""
        return np.concatenate(self._rests(numbers, self._starts_at(numbers)))

    def _by_start(self, numbers: Array, starts: Sequence[Array]) -> tuple[list[Array], list[Array]]:
        """Return residuals, and their slopes by the start, shape (m, 2 n), of each piece."""
        count, steps = len(self.pieces), START_STEP * np.eye(len(starts[0]))
        moved = [start + step for step in steps for start in starts]
        rests = self._rests(numbers, [*starts, *moved])
        slopes = [
            np.stack([each - rests[k] for each in rests[k + count :: count]], axis=1) / START_STEP
            for k in range(count)
        ]
        return rests[:count], slopes

    def slopes(self, numbers: Array) -> Array:
        """Linearise at these parameters; return the slopes by parameter, shape (size, p)."""
        starts = self._starts_at(numbers)
        rests, by_start = self._by_start(numbers, starts)
        steps = 1e-4 * np.maximum(np.abs(numbers), 0.01)
        steps = np.where(numbers + steps > self._high, -steps, steps)
        others = [self._rests(numbers + step, starts) for step in np.diag(steps)]
        self._at, self._starts, self._lines = numbers.copy(), [], []
        for k, start in enumerate(starts):
            columns = [(other[k] - rests[k]) / step for other, step in zip(others, steps)]
            by_number = np.array(columns).T.reshape(len(rests[k]), len(numbers))
            basis, triangle = np.linalg.qr(by_start[k])
            to_start = np.linalg.pinv(triangle) @ basis.T
            self._lines.append(_Linear(start, rests[k], by_number, basis, to_start))
        return np.concatenate([line.without(line.by_number) for line in self._lines])

    def projected(self, numbers: Array) -> list[tuple[Array, Array]]:
        """Return (residual, slopes by parameter) of each piece, with its start eliminated.

        They have shape (m,) and (m, p): m numbers of a piece, p parameters.
        """
        self.slopes(numbers)
        return [(line.without(line.rest), line.without(line.by_number)) for line in self._lines]

    def settle(self, numbers: Array) -> None:
        """Fit the starts at these parameters, shape (p,)."""
        for _ in range(SETTLING):  # each begins where the linear pieces have their starts
            self.slopes(numbers)

    def quality(self, numbers: Array) -> tuple[Array, float]:
        """Return the rms of position minus measurement, shape (n,), and the explained fraction.

        The latter is 1 minus the squared residual over that of motion at constant velocity.
        """
        rest = self.rest(numbers).reshape(-1, len(self.weights))
        straight = 0.0
        for piece in self.pieces:
            time = self._recording.time[piece]
            powers = np.column_stack([np.ones(len(time)), time - time[0]])
            measured = self._recording.positions[piece] * self.weights
            line = powers @ np.linalg.lstsq(powers, measured, rcond=None)[0]
            straight += float(np.sum((measured - line) ** 2))
        rms = np.sqrt(np.mean((rest / self.weights) ** 2, axis=0))
        return rms, 1.0 - float(np.sum(rest**2)) / straight if straight > 0.0 else -np.inf


def _parabola(recording: MechanismSamples, piece: slice) -> Array:
    """Return positions and velocities [SI] at the start, shape (2 n,): those of a parabola."""
    count = min(piece.stop - piece.start, max(8, (piece.stop - piece.start) // 4))
    rows = slice(piece.start, piece.start + count)
    time = recording.time[rows] - recording.time[piece.start]
    found = np.linalg.lstsq(np.vander(time, 3), recording.positions[rows], rcond=None)[0]
    return np.concatenate([found[2], found[1]])


def _deviations(part: _Part, numbers: Array, names: Sequence[str]) -> Array:
    """Return one standard deviation of each parameter; raise UserError."""
    lines = part.projected(numbers)
    square = np.array(sum(slopes.T @ slopes for _, slopes in lines))
    scale = np.sqrt(np.diag(square))
    if not np.all(scale > 0.0):
        names_of = ', '.join(name for name, size in zip(names, scale) if not size > 0.0)
        raise UserError(
            f'the motion in the recording does not depend on {names_of}: fix it with --set'
        )
    normal = square / np.outer(scale, scale)
    sizes, axes = np.linalg.eigh(normal)
    if sizes[0] < 1e-9:
        mixed = [name for name, part in zip(names, np.abs(axes[:, 0])) if part > 0.3]
        raise UserError(
            f'the motion in the recording does not distinguish {", ".join(mixed)}: record more '
            'varied motion, or fix some of them with --set'
        )
    inverse = np.linalg.inv(normal) / np.outer(scale, scale)
    middle = np.zeros_like(square)
    for rest, slopes in lines:
        # the piece is part of the fit, which makes its residual too small
        lever = slopes.T @ slopes @ inverse
        push = np.linalg.solve(np.eye(len(lever)) - lever, slopes.T @ rest)
        middle += np.outer(push, push)
    count = len(lines)
    found: Array = np.sqrt(np.diag(inverse @ middle @ inverse) * (count - 1.0) / count)
    return found
