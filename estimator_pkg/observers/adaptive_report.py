"""What the adaptive observer has identified, in words and numbers for a person or a message."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from estimator_pkg.observers.adaptive import PHASES, REASONS, build
from estimator_pkg.observers.adaptive_gains import GRADIENT, Gains, physical, structure
from estimator_pkg.observers.circle import Circle


class Identified(NamedTuple):
    """One parameter; `stddev` is 0 where the value is known or given."""

    name: str
    value: float
    stddev: float
    unit: str


class Report(NamedTuple):
    """Attributes: phase and its reason, everything identified, theta as it can be loaded again.

    trusted : the innovation is explained by the noise of the reading (or small beside the motion).
    adapted : time spent adapting [s].
    excitation : what the gate compares with its threshold: signal to noise, or the smallest
        eigenvalue of the information matrix weighed by gamma.
    """

    phase: str
    reason: str
    parameters: tuple[Identified, ...]
    names: tuple[str, ...]
    theta: tuple[float, ...]
    trusted: bool
    adapted: float
    excitation: float


def report(gains: Gains, state: tuple, dt: float) -> Report:
    """What a state of the observer with these gains and this sample time [s] says.

    The standard deviation is that of least squares, from the innovation's mean square and the
    information gathered until theta last moved. It holds for errors that are independent from
    sample to sample; friction and other parts that the model lacks are not in it. Before anything
    was learnt it is infinite.
    """
    made = structure(gains)
    theta = list(made.fixed)
    for place, value, low, high in zip(made.free, state[2], made.low, made.high):
        theta[place] = min(max(value, low), high)
    covariance = np.zeros((len(theta), len(theta)))
    places = np.ix_(made.free, made.free)
    covariance[places] = _covariance(gains, state, dt)
    sigma = np.sqrt(np.diag(covariance))
    parameters = [Identified(name, value, float(s), _unit(name, gains.order))
                  for name, value, s in zip(made.names, theta, sigma)]
    ratios = physical(made.names, made.model)
    for name, (place, offset, sign, unit) in ratios.items():
        parameters.append(Identified(name, offset + sign * theta[place], float(sigma[place]), unit))
    if ratios and gains.torque_constant is not None:
        parameters += _masses(gains.torque_constant, theta, covariance, made.model)
    phase = state[8][0]
    return Report(PHASES[phase], REASONS[phase], tuple(parameters), made.names, tuple(theta),
                  state[8][1] > 0, state[7][4], excitation(gains, state, dt))


def excitation(gains: Gains, state: tuple, dt: float) -> float:
    """The number that opens the gate; see `Report`."""
    functions = build(gains, Circle(0.0))
    design = functions.design()
    information, floor = np.array(state[3]), np.array(design[8])
    scale, threshold = 1.0, gains.excitation
    if gains.gate != 'gamma':
        noise = design[13][0] or max(state[6][0], design[13][1])
        scale, threshold = dt * noise, gains.signal_to_noise
    try:
        most = float(np.max(np.linalg.eigvals(np.linalg.solve(information, scale * floor)).real))
    except np.linalg.LinAlgError:
        return 0.0
    return threshold / most if most > 0.0 else 0.0


def _covariance(gains: Gains, state: tuple, dt: float) -> Any:
    """Of the free parameters; infinite variances where nothing was learnt."""
    count = len(state[2])
    information, power = np.array(state[9][0]), state[9][1]
    if state[7][4] == 0.0:
        given = gains.theta is not None
        return np.diag([0.0 if given else math.inf] * count)
    if gains.law == GRADIENT:
        try:
            return power * dt * np.linalg.inv(information)
        except np.linalg.LinAlgError:
            return np.diag([math.inf] * count)
    return power * np.array(state[4])


def _unit(name: str, order: int) -> str:
    power = int(name[1:])
    per = '1/s' if power == 1 else f'1/s^{power}'
    if name[0] == 'l':
        return per
    rate = 'rad/s' if power == 1 else f'rad/s^{power}'
    return rate if name[0] == 'd' else f'{rate} per unit of input'


def _masses(constant: float, theta: list[float], covariance: Any, model: tuple[float, ...]
            ) -> list[Identified]:
    """J, b and k from the ratios and Kv; errors to first order."""
    b2 = theta[3]
    if b2 == 0.0:
        return []
    inertia = constant / b2
    found = []
    for name, unit, ratio, place in (('J', 'kg m^2', 1.0, None),
                                     ('b', 'N m s/rad', -(model[0] + theta[0]), 0),
                                     ('k', 'N m/rad', -(model[1] + theta[1]), 1)):
        slope = np.zeros(len(theta))
        slope[3] = -inertia * ratio / b2
        if place is not None:
            slope[place] = -inertia
        used = slope != 0.0
        variance = float(slope[used] @ covariance[np.ix_(used, used)] @ slope[used])
        sigma = math.sqrt(variance) if variance >= 0.0 else math.inf
        found.append(Identified(name, inertia * ratio, sigma, unit))
    return found
