# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The state of the observer `switched`, and its functions beyond the common contract."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from estimator_pkg.models.switched import SwitchedModel
from estimator_pkg.observers.contract import Functions

LARGEST = 1e15  # largest derivative or parameter, in its own unit


class State(NamedTuple):
    """The state; tuples have one entry per output.

    zh, zt: the estimates and the auxiliary states; zt are the derivatives, from the first to the
    one that ends the chain; errors: the last error of each stage.
    """

    zh: tuple[tuple[float, ...], ...]
    zt: tuple[tuple[float, ...], ...]
    errors: tuple[tuple[float, ...], ...]
    y: tuple[float, ...]  # newest outputs, unwrapped
    u: tuple[float, ...]  # newest input
    z: tuple[float, ...]  # Z from least squares
    predicted: tuple[float, ...]  # Z predicted at the last event
    y_at: tuple[float, ...]  # outputs at the last event
    history: tuple  # (Lambda, Y, A_d, beta_d) of the last intervals
    dt: float  # the last interval [s]
    observed: tuple[tuple[float, ...], ...]  # extended observers: the chain, then the disturbance w
    used: tuple[float, ...]  # the Z that they used last
    powers: tuple[float, ...]  # noise variance that their innovations correspond to
    noises: tuple  # variances of position, velocity and innovation at unit noise
    age: float  # since the last event, or gap [s]
    total: float  # since the start [s]
    forgetting: float  # time until the filters have forgotten an unknown Z or start [s]
    fitted: bool  # the last inversion could be used
    filters: tuple  # (of y, of Gamma, of the columns of Lambda, of their old content) by output
    last_columns: tuple  # Gamma and Lambda's columns at the newest sample
    origin: tuple  # columns at the last event: derivatives are relative to them
    p: tuple  # of least squares
    power: float  # mean square of its residual
    conventions: tuple
    scatters: tuple


def is_sound(state: State) -> bool:
    """Return False if an estimate is NaN or beyond `LARGEST`: the state has diverged."""
    return all(-LARGEST < x < LARGEST for x in state.z) and all(
        -LARGEST < x < LARGEST
        for chains in (state.zh, state.zt, state.observed)
        for chain in chains
        for x in chain
    )


@dataclass(frozen=True)
class SwitchedFunctions(Functions):
    """The contract's functions for tuples of outputs, and those of the states and of Z.

    states : (state) -> x, in the coordinates of the model.
    outputs : (state, measurement) -> (position, velocity, acceleration or nan) of each output.
    discrete : (state) -> (Z, its standard deviations, converged).
    chains : (state) -> (zeta, last derivative of each chain).
    jump : (state, (mode, v)) -> state after a switching instant.
    deviations : (state) -> one standard deviation of (position, velocity) of each output.
    model : of the system.
    """

    init: Callable[[Any, tuple], Any]

    states: Callable[[Any], tuple[float, ...]] = tuple
    outputs: Callable[[Any, tuple], list[tuple[float, float, float]]] = lambda state, reading: []
    discrete: Callable[[Any], tuple[tuple[float, ...], tuple[float, ...], bool]] = lambda state: (
        (),
        (),
        False,
    )
    chains: Callable[[Any], tuple[tuple[float, ...], tuple[float, ...]]] = lambda state: ((), ())
    jump: Callable[[Any, tuple], Any] = lambda state, event: state
    deviations: Callable[[Any], list[tuple[float, float]]] = lambda state: []
    model: SwitchedModel | None = None
