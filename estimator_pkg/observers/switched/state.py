"""What the observer `switched` carries, and what it can be asked beyond the common contract."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from estimator_pkg.observers.contract import Functions

LARGEST = 1e15  # of any derivative or parameter, in its own unit


class State(NamedTuple):
    """What is carried from sample to sample; tuples by output.

    zh, zt: the estimates and the auxiliary states, which are the derivatives from the first on and
    last what ends the chain; errors: the last error of each stage.
    """

    zh: tuple[tuple[float, ...], ...]
    zt: tuple[tuple[float, ...], ...]
    errors: tuple[tuple[float, ...], ...]
    y: tuple[float, ...]  # newest outputs, unwrapped
    u: tuple[float, ...]  # newest input
    z: tuple[float, ...]  # Z as learnt
    predicted: tuple[float, ...]  # Z as predicted at the last event
    y_at: tuple[float, ...]  # outputs at the last event
    history: tuple  # (Lambda, Y, A_d, beta_d) of the last intervals
    dt: float  # the last interval [s]
    observed: tuple[tuple[float, ...], ...]  # extended observers: the chain, what is unexplained
    used: tuple[float, ...]  # Z as they last used it
    powers: tuple[float, ...]  # mean square of their innovations, as noise of the readings
    noises: tuple  # variances of position, velocity and innovation at unit noise
    age: float  # since the last event, or gap [s]
    total: float  # since the start [s]
    deaf: float  # the filters hold what is not known for so long [s]
    fitted: bool  # the last inversion could be used
    filters: tuple  # (of y, of Gamma, of the columns of Lambda, carried) by output
    last_columns: tuple  # Gamma and Lambda's columns at the newest sample
    origin: tuple  # columns at the last event: derivatives count from there
    p: tuple  # of least squares
    power: float  # mean square of its residual
    conventions: tuple
    scatters: tuple


def is_sound(state: State) -> bool:
    """False where an estimate is so large, or no number, that no sample could bring it back."""
    return all(-LARGEST < x < LARGEST for x in state.z) and all(
        -LARGEST < x < LARGEST
        for chains in (state.zh, state.zt, state.observed)
        for chain in chains
        for x in chain
    )


@dataclass(frozen=True)
class SwitchedFunctions(Functions):
    """The contract's functions, for tuples of outputs, and what is known beside the outputs.

    states : (state) -> x, in the coordinates of the model.
    outputs : (state, measurement) -> (position, velocity, acceleration or nan) of each output.
    discrete : (state) -> (Z, its standard deviations, converged).
    chains : (state) -> (zeta, what ends the chains).
    jump : (state, (mode, v)) -> state, at a switching instant.
    deviations : (state) -> one standard deviation of (position, velocity) of each output.
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
