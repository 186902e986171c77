# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Fit a model's parameters by output error: simulated motion under the recorded inputs.

The recording is cut into pieces. In each, the model starts at positions and velocities of its own,
which are fitted with the parameters, and moves under the recorded inputs. The fit minimises the
squares of position minus measurement over the pieces of the first part (Gauss-Newton with the
starts eliminated piece by piece, damped as by Levenberg and Marquardt). No measurement is
differentiated, so noise and quantisation cause no bias.

Standard deviations come from the sandwich estimator with a piece as the unit: residuals may be
correlated in any way within a piece, as they are with a coarse encoder or a wrong model.
Ljung, System Identification (1999), 7.4 and 9.2; MacKinnon and White (1985) for small samples.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.identify.model import Unknowns
from estimator_pkg.evaluation.identify.pieces import (
    COARSE,
    Piece,
    Recording,
    accumulated,
    cut,
    first_guess,
    thinned,
)
from estimator_pkg.models.mechanics import Mechanics
from estimator_pkg.observers.mechanism.motion import Motion

Array = NDArray[np.float64]

FINEST = 5e-4  # longest integration step of a model of ours [s]
ROUNDS = 60  # largest number of iterations
CONVERGED = 0.01  # a smaller change, in standard deviations, ends the fit
DELAY = 'input_delay'
LATEST = 0.1  # largest delay of the inputs [s]


class Found(NamedTuple):
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


Predict = Callable[[Array, 'Piece', Array], Array]  # (parameters, piece, start) -> positions


def fit(
    recording: Recording,
    unknowns: Unknowns,
    delay: float = 0.0,
    advance: Callable[[int], None] = lambda rounds: None,
) -> Found:
    """Return the parameters that explain the recording best.

    Parameters
    ----------
    delay : start value of the inputs' delay [s].
    advance : called with 1 after each round.

    Raises
    ------
    UserError : the recording is too short, or its motion does not determine the parameters.
    """
    mechanics = unknowns.make(unknowns.start)
    if not mechanics.ours:
        recording = thinned(recording)
    first, second = cut(recording)
    driven = mechanics.inputs > 0
    names = unknowns.names + ((DELAY,) if driven else ())
    numbers = np.append(unknowns.start, delay) if driven else unknowns.start.copy()
    low = np.append(unknowns.lowest, -LATEST) if driven else unknowns.lowest
    high = np.append(unknowns.highest, LATEST) if driven else unknowns.highest
    predict = _predictor(recording, unknowns, driven)
    weights: Array = np.ones(recording.positions.shape[1])
    starts = {piece: first_guess(recording, piece) for piece in (*first, *second)}
    for _ in range(2):  # the joints' weights follow from the residuals
        numbers = _minimise(recording, predict, first, starts, numbers, low, high, weights, advance)
        weights = 1.0 / np.maximum(_rms(recording, predict, first, starts, numbers), 1e-12)
    deviations = _deviations(recording, predict, first, starts, numbers, weights, names)
    for piece in second:
        _fit_start(recording, predict, piece, starts, numbers, weights)
    return Found(
        names,
        numbers,
        deviations,
        _rms(recording, predict, first, starts, numbers),
        _rms(recording, predict, second, starts, numbers),
        _explained(recording, predict, first, starts, numbers, weights),
        _explained(recording, predict, second, starts, numbers, weights),
        (len(first), len(second)),
    )


def _predictor(recording: Recording, unknowns: Unknowns, driven: bool) -> Predict:
    """Return a function for the positions of a piece by parameters and start (q, then v)."""
    time, n = recording.time, recording.positions.shape[1]
    total = accumulated(time, recording.inputs)
    made: dict[bytes, Mechanics] = {}

    def model(numbers: Array) -> Mechanics:
        key = numbers.tobytes()
        if key not in made:
            if len(made) > 64:
                made.clear()
            made[key] = unknowns.make(numbers)
        return made[key]

    def predict(numbers: Array, piece: Piece, start: Array) -> Array:
        mechanics = model(numbers[:-1] if driven else numbers)
        at = time[piece.begin : piece.end]
        steps = np.diff(at)
        inputs = np.zeros((len(steps), mechanics.inputs))
        if driven:
            for column in range(mechanics.inputs):
                inputs[:, column] = np.diff(np.interp(at - numbers[-1], time, total[:, column]))
            inputs /= steps[:, None]
        parts = (steps / (FINEST if mechanics.ours else COARSE)).astype(np.int64) + 1
        return Motion(mechanics, start[:n], start[n:]).run(inputs, steps, parts)[0]

    return predict


def _rest(
    recording: Recording,
    predict: Predict,
    piece: Piece,
    start: Array,
    numbers: Array,
    weights: Array,
) -> Array:
    """Return weighted position minus measurement, shape (rows * n,)."""
    positions = predict(numbers, piece, start)
    return ((positions - recording.positions[piece.begin : piece.end]) * weights).ravel()


def _slopes(function: Callable[[Array], Array], at: Array, value: Array, step: Array) -> Array:
    """Return the derivatives of `function` by each parameter, one-sided."""
    columns = []
    for index in range(len(at)):
        moved = at.copy()
        moved[index] += step[index]
        columns.append((function(moved) - value) / step[index])
    return np.array(columns).T.reshape(len(value), len(at))


def _steps_of(numbers: Array) -> Array:
    return 1e-4 * np.maximum(np.abs(numbers), 0.01)


class _Linear(NamedTuple):
    """A piece, linearised about the present parameters, with its start eliminated."""

    rest: Array  # residual without the part that another start would remove
    by_number: Array  # its slopes by parameter, likewise
    start: Array  # (residual, slopes by parameter) -> change of the start


def _linear(
    recording: Recording,
    predict: Predict,
    piece: Piece,
    starts: dict[Piece, Array],
    numbers: Array,
    weights: Array,
) -> tuple[_Linear, Array, Array]:
    """Return the linearised piece, its full residual, and its full slopes by parameter."""
    start = starts[piece]
    rest = _rest(recording, predict, piece, start, numbers, weights)
    by_start = _slopes(
        lambda x: _rest(recording, predict, piece, x, numbers, weights),
        start,
        rest,
        np.full(len(start), 1e-5),
    )
    by_number = _slopes(
        lambda x: _rest(recording, predict, piece, start, x, weights),
        numbers,
        rest,
        _steps_of(numbers),
    )
    basis, triangle = np.linalg.qr(by_start)

    def without(values: Array) -> Array:
        return values - basis @ (basis.T @ values)

    return (
        _Linear(without(rest), without(by_number), np.linalg.pinv(triangle) @ basis.T),
        rest,
        by_number,
    )


def _cost(rests: list[Array]) -> float:
    with np.errstate(all='ignore'):  # parameters far off: the model may run away
        total = sum(float(rest @ rest) for rest in rests)
    return total if np.isfinite(total) else np.inf


def _minimise(
    recording: Recording,
    predict: Predict,
    pieces: list[Piece],
    starts: dict[Piece, Array],
    numbers: Array,
    low: Array,
    high: Array,
    weights: Array,
    advance: Callable[[int], None],
) -> Array:
    """Return the best parameters; updates the starts."""
    damping = 1e-3
    fresh = True
    for _ in range(ROUNDS):
        if fresh:
            lines = [
                _linear(recording, predict, piece, starts, numbers, weights) for piece in pieces
            ]
            cost = _cost([line[1] for line in lines])
            square: Array = np.zeros((len(numbers), len(numbers)))
            slope: Array = np.zeros(len(numbers))
            for line in lines:
                square = square + line[0].by_number.T @ line[0].by_number
                slope = slope + line[0].by_number.T @ line[0].rest
            if not np.all(np.isfinite(square)) or not np.isfinite(cost):
                raise UserError(
                    'the model diverges from the recording with the start values of its '
                    'parameters: give better ones with --start'
                )
        advance(1)
        size = np.diag(square).copy()
        size[size == 0.0] = 1.0
        held = ((numbers <= low) & (slope > 0.0)) | ((numbers >= high) & (slope < 0.0))
        free = ~held
        change: Array = np.zeros(len(numbers))
        change[free] = -np.linalg.lstsq(
            square[np.ix_(free, free)] + damping * np.diag(size[free]), slope[free], rcond=None
        )[0]
        wanted = np.clip(numbers + change, low, high)
        change = wanted - numbers
        moved = {
            piece: starts[piece] - line[0].start @ (line[1] + line[2] @ change)
            for piece, line in zip(pieces, lines)
        }
        try:
            after = _cost(
                [
                    _rest(recording, predict, piece, moved[piece], wanted, weights)
                    for piece in pieces
                ]
            )
        except UserError:  # invalid parameters
            after = np.inf
        fresh = after <= cost
        if fresh:
            numbers = wanted
            starts.update(moved)
            noise = cost / sum(len(line[1]) for line in lines)
            damping = max(0.1 * damping, 1e-12)
            # in units of the change that noise alone would cause
            if np.all(np.abs(change) * np.sqrt(size) <= CONVERGED * np.sqrt(noise)):
                return numbers
        else:
            damping = max(damping, 1e-9) * 10.0
            if damping > 1e9:
                return numbers
    return numbers


def _fit_start(
    recording: Recording,
    predict: Predict,
    piece: Piece,
    starts: dict[Piece, Array],
    numbers: Array,
    weights: Array,
) -> None:
    """Fit the start of a piece at these parameters."""
    for _ in range(5):
        start = starts[piece]
        rest = _rest(recording, predict, piece, start, numbers, weights)
        by_start = _slopes(
            lambda x: _rest(recording, predict, piece, x, numbers, weights),
            start,
            rest,
            np.full(len(start), 1e-5),
        )
        if not np.all(np.isfinite(by_start)):
            return
        moved = start - np.linalg.lstsq(by_start, rest, rcond=None)[0]
        after = _rest(recording, predict, piece, moved, numbers, weights)
        if not _cost([after]) < _cost([rest]):
            return
        starts[piece] = moved


def _deviations(
    recording: Recording,
    predict: Predict,
    pieces: list[Piece],
    starts: dict[Piece, Array],
    numbers: Array,
    weights: Array,
    names: tuple[str, ...],
) -> Array:
    """Return one standard deviation of each parameter; raise UserError."""
    lines = [_linear(recording, predict, piece, starts, numbers, weights)[0] for piece in pieces]
    square = np.array(sum(line.by_number.T @ line.by_number for line in lines))
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
    inverse = np.linalg.inv(normal) / (scale[:, None] * scale)
    count = len(pieces)
    middle = np.zeros_like(square)
    for line in lines:
        # the piece is part of the fit, which makes its residual too small
        push = line.by_number.T @ line.rest
        lever = line.by_number.T @ line.by_number @ inverse
        push = np.linalg.solve(np.eye(len(push)) - lever, push)
        middle += push[:, None] * push
    found: Array = np.sqrt(np.diag(inverse @ middle @ inverse) * (count - 1.0) / count)
    return found


def _rms(
    recording: Recording,
    predict: Predict,
    pieces: list[Piece],
    starts: dict[Piece, Array],
    numbers: Array,
) -> Array:
    """Return the rms of position minus measurement of each joint."""
    n = recording.positions.shape[1]
    rests = [
        _rest(recording, predict, piece, starts[piece], numbers, np.ones(n)).reshape(-1, n)
        for piece in pieces
    ]
    found: Array = np.sqrt(np.mean(np.concatenate(rests) ** 2, axis=0))
    return found


def _explained(
    recording: Recording,
    predict: Predict,
    pieces: list[Piece],
    starts: dict[Piece, Array],
    numbers: Array,
    weights: Array,
) -> float:
    """Return 1 minus the model's squared residual over that of motion at constant velocity."""
    left = _cost(
        [_rest(recording, predict, piece, starts[piece], numbers, weights) for piece in pieces]
    )
    straight = 0.0
    for piece in pieces:
        time = recording.time[piece.begin : piece.end]
        powers = np.column_stack([np.ones(len(time)), time - time[0]])
        measured = recording.positions[piece.begin : piece.end] * weights
        rest = measured - powers @ np.linalg.lstsq(powers, measured, rcond=None)[0]
        straight += float(np.sum(rest**2))
    return 1.0 - left / straight if straight > 0.0 else -np.inf
