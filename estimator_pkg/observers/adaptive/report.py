# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The report of the adaptive observer: identified parameters, their errors, and trust in them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.observers.adaptive.evidence import Assessment, Evidence, judge
from estimator_pkg.observers.adaptive.law import (
    ADAPTING,
    PAUSED,
    PHASE_NAMES,
    PHASE_TEXTS,
    variance,
)
from estimator_pkg.observers.adaptive.observer import (
    PUBLISHED_FORM,
    SLOW_POWER_RATIO,
    Gains,
    prepare,
)
from estimator_pkg.observers.adaptive.state import Coefficients, Design, State
from estimator_pkg.observers.adaptive.structure import Structure, physical, structure

Array = NDArray[np.float64]

EXPLAINED = 0.9  # smallest predicted part of the acceleration's power for a trusted model
SMALL_ERROR = 0.1  # largest error of a trusted parameter, relative to its value, ...
ZERO_ERROR = 0.05  # ... or to the value at which it alone would cause the acceleration
CURVED = 8.0  # between 12, for a parabola's mean height, and the value observed for b/J
SIGN_SIGMAS = 2.0  # standard deviations from which a sign is certain


class Identified(NamedTuple):
    """One parameter."""

    name: str
    value: float
    stddev: float  # 0 if the user has set the value
    unit: str
    trusted: bool = True  # the value can be used; see `IdentificationReport.trusted`


class IdentificationReport(NamedTuple):
    """The state of the identification.

    It is trusted if, for every free parameter, standard deviation and hidden error are small
    compared with the value, or the parameter is nearly zero; the model predicts the acceleration,
    or noise explains the rest; damping is not negative; inertia is positive if its sign is known.
    """

    phase: str  # of the adaptation
    reason: str  # why it is in this phase, and why the parameters are not trusted
    parameters: tuple[Identified, ...]  # entries of theta first, then physical ones
    names: tuple[str, ...]  # of theta, as the parameter `theta` takes it
    theta: tuple[float, ...]
    trusted: bool
    adapted: float  # time spent adapting [s]
    # the value that the gate compares with its threshold: signal to noise, or the smallest
    # eigenvalue of the information matrix weighted by gamma
    excitation: float
    why_not: str = ''  # the condition that is not met; '' if trusted
    explained: float = math.nan  # part of the acceleration's power that is predicted; nan: unknown


class Origin(NamedTuple):
    """The origin of parameters from a file."""

    stddev: tuple[float, ...]  # standard deviations in the order of theta
    trusted: bool  # they were trusted when they were saved


class _Free(NamedTuple):
    """One free parameter of the plant: value, standard deviation, hidden error, scale."""

    name: str
    value: float
    stddev: float
    hidden: float
    scale: float

    @property
    def is_known(self) -> bool:
        error = math.hypot(self.stddev, self.hidden)
        return bool(error <= SMALL_ERROR * abs(self.value) or error <= ZERO_ERROR * self.scale)


def report(
    gains: Gains,
    design: Design,
    state: State,
    dt: float,
    evidence: Evidence | None = None,
    origin: Origin | None = None,
) -> IdentificationReport:
    """Return the report on a state of the observer.

    Parameters
    ----------
    dt : sample time [s].
    evidence : `AdaptiveJoint.evidence`; without it the learnt parameters have no standard
        deviation and are not trusted.
    origin : of parameters from a file; None: parameters set by the user are taken to be exact.
    """
    made = structure(gains)
    theta = list(made.fixed)
    for place, value, low, high in zip(made.free, state.theta, made.low, made.high):
        theta[place] = min(max(value, low), high)
    adapted = state.adapted
    supplied = adapted == 0.0 and gains.theta is not None
    verdict = None
    if evidence is not None and not supplied:
        verdict = _verdict(gains, made, theta, design, state, dt, evidence)
    covariance = _whole(made, verdict, supplied, origin)
    sigma = np.sqrt(np.diag(covariance))
    ratios = physical(made.names, made.model)
    free = _free(made, theta, sigma, ratios, verdict)
    why_not = _doubt(gains, state.trusted, adapted, supplied, verdict, free)
    if supplied and origin is not None and not origin.trusted:
        why_not = 'they were not trusted when they were saved'
    # one bad parameter does not make the others bad, but a model that does not fit does
    believed = {own.name: own.is_known for own in free}
    fits = not why_not or (verdict is not None and _fits(verdict))
    known = [
        (supplied and not why_not)
        or i not in made.free
        or (fits and believed[_plant_name(name, ratios, i)])
        for i, name in enumerate(made.names)
    ]
    parameters = [
        Identified(name, value, float(s), _unit(name), good)
        for name, value, s, good in zip(made.names, theta, sigma, known)
    ]
    for name, (place, offset, sign, unit) in ratios.items():
        parameters.append(
            Identified(name, offset + sign * theta[place], float(sigma[place]), unit, known[place])
        )
    if ratios and gains.torque_constant is not None:
        parameters += _masses(gains.torque_constant, theta, covariance, made, known)
    phase = state.phase
    reason = PAUSED if phase == ADAPTING and state.paused > 0.0 else PHASE_TEXTS[phase]
    return IdentificationReport(
        PHASE_NAMES[phase],
        f'{reason}; not trusted: {why_not}' if why_not else reason,
        tuple(parameters),
        made.names,
        tuple(theta),
        not why_not,
        adapted,
        excitation(gains, design, state, dt),
        why_not,
        verdict.explained if verdict is not None else math.nan,
    )


def excitation(gains: Gains, design: Design, state: State, dt: float) -> float:
    """Return the value that the gate compares with its threshold; see `IdentificationReport`."""
    matrix, floor = np.array(state.information), np.array(design.floor)
    scale, threshold = 1.0, gains.excitation
    if gains.gate != 'gamma':
        scale, threshold = dt * variance(state.scatter, design), gains.signal_to_noise
    try:
        most = float(np.max(np.linalg.eigvals(np.linalg.solve(matrix, scale * floor)).real))
    except np.linalg.LinAlgError:
        return 0.0
    return threshold / most if most > 0.0 else 0.0


def _verdict(
    gains: Gains,
    made: Structure,
    theta: list[float],
    design: Design,
    state: State,
    dt: float,
    evidence: Evidence,
) -> Assessment | None:
    """Return the assessment of theta, including errors by noise in the filters and by sampling."""
    n, coefficients = gains.order, Coefficients()
    prepare(coefficients, design, dt)
    weights, noise = np.array(design.w), variance(state.scatter, design)
    injected = np.array(design.k) + theta[:n]
    bias = np.zeros(len(made.names))
    newest = np.array(coefficients.g1)  # weight of the newest sample in psi
    bias[:n] = noise * (newest - dt * weights @ injected)
    low_pass = -math.expm1(-dt * made.slowest)
    slow = noise * (1.0 + dt * float(injected @ weights @ injected)) * low_pass / (2.0 - low_pass)
    free = list(made.free)
    return judge(
        evidence,
        np.array(theta)[free],
        bias[free],
        _sampling(gains, made, theta, dt)[free],
        slow,
        SLOW_POWER_RATIO,
    )


def _sampling(gains: Gains, made: Structure, theta: list[float], dt: float) -> Array:
    """Return the error of theta from the sampling, to leading order, in the order of theta.

    The filters of the sampled form assume a linear angle between samples. Forward Euler estimates
    (exp(A dt) - 1)/dt instead of A.
    """
    n = gains.order
    plant = np.array(theta)
    plant[:n] += made.model
    if gains.form != PUBLISHED_FORM:
        pace = (-made.observer[-1]) ** (1.0 / n)
        return (pace * dt) ** 2 / CURVED * np.abs(plant)
    a = np.diag(np.ones(n - 1), 1)
    a[:, 0] = plant[:n]
    error = np.zeros(len(theta))
    error[:n] = np.poly(a)[1:] - np.poly(a + 0.5 * dt * a @ a)[1:]
    error[n : 2 * n] = 0.5 * dt * a @ plant[n : 2 * n]
    return error


def _whole(
    made: Structure, verdict: Assessment | None, supplied: bool, origin: Origin | None
) -> Array:
    """Return the covariance of theta; infinite variances for unknown parameters."""
    covariance = np.zeros((len(made.names), len(made.names)))
    if supplied and origin is not None:
        fits = len(origin.stddev) == len(made.names)
        sigmas = np.array(origin.stddev) if fits else np.full(len(made.names), math.inf)
        for place in made.free:
            covariance[place, place] = sigmas[place] ** 2
    elif not supplied:
        places = np.ix_(made.free, made.free)
        covariance[places] = (
            np.diag([math.inf] * len(made.free)) if verdict is None else verdict.covariance
        )
    return covariance


def _plant_name(name: str, ratios: dict, place: int) -> str:
    """Return the plant's name for this entry of theta."""
    return next((own for own, (at, *_) in ratios.items() if at == place), name)


def _free(
    made: Structure, theta: list[float], sigma: Array, ratios: dict, verdict: Assessment | None
) -> list[_Free]:
    found = []
    for k, place in enumerate(made.free):
        name = _plant_name(made.names[place], ratios, place)
        value = theta[place] + (made.model[place] if place < len(made.model) else 0.0)
        if name in ratios:
            value = ratios[name][1] + ratios[name][2] * theta[place]
        found.append(
            _Free(
                name,
                value,
                float(sigma[place]),
                0.0 if verdict is None else float(verdict.hidden[k]),
                0.0 if verdict is None else float(verdict.scale[k]),
            )
        )
    return found


def _fits(verdict: Assessment) -> bool:
    return verdict.noise_only or verdict.explained >= EXPLAINED


def _doubt(
    gains: Gains,
    observer_trusts: bool,
    adapted: float,
    supplied: bool,
    verdict: Assessment | None,
    free: list[_Free],
) -> str:
    """Return why the parameters are not trusted; '' if they are."""
    if supplied:
        return '' if observer_trusts else 'the innovation is larger than noise explains'
    if adapted == 0.0:
        return 'nothing was learnt'
    if verdict is None:
        return 'too little was learnt, or the signals do not determine the parameters'
    if not _fits(verdict):
        return (
            f'the model predicts {100.0 * max(0.0, verdict.explained):.0f} % of the '
            f'acceleration: at least {100.0 * EXPLAINED:.0f} % are needed'
        )
    by_name = {own.name: own for own in free}
    damping, gain = by_name.get('b/J'), by_name.get('Kv/J')
    if damping and damping.value < -SIGN_SIGMAS * damping.stddev - ZERO_ERROR * damping.scale:
        return 'the damping b/J is negative'
    if gain and gains.torque_constant is not None and gain.value <= SIGN_SIGMAS * gain.stddev:
        return 'the inertia may be negative: does the input have the right sign?'
    vague = [own.name for own in free if not own.is_known]
    if vague:
        return f'the error of {", ".join(vague)} may be larger than {100.0 * SMALL_ERROR:.0f} %'
    return ''


def _unit(name: str) -> str:
    power = int(name[1:])
    per = '1/s' if power == 1 else f'1/s^{power}'
    if name[0] == 'l':
        return per
    rate = 'rad/s' if power == 1 else f'rad/s^{power}'
    return rate if name[0] in 'ds' else f'{rate} per unit of input'


def _masses(
    constant: float, theta: list[float], covariance: Array, made: Structure, known: list[bool]
) -> list[Identified]:
    """Return J, b, k and m g l from the ratios and Kv, with standard deviations to first order."""
    b2 = theta[3]
    if b2 == 0.0:
        return []
    inertia, model = constant / b2, made.model
    entries: list[tuple[str, str, float, int | None]] = [
        ('J', 'kg m^2', 1.0, None),
        ('b', 'N m s/rad', -(model[0] + theta[0]), 0),
        ('k', 'N m/rad', -(model[1] + theta[1]), 1),
    ]
    if 's2' in made.names:
        at = made.names.index('s2')
        entries.append(('mgl', 'N m', -theta[at], at))
    found = []
    for name, unit, ratio, place in entries:
        slope = np.zeros(len(theta))
        slope[3] = -inertia * ratio / b2
        if place is not None:
            slope[place] = -inertia
        used = slope != 0.0
        variance = float(slope[used] @ covariance[np.ix_(used, used)] @ slope[used])
        sigma = math.sqrt(variance) if variance >= 0.0 else math.inf
        found.append(
            Identified(
                name, inertia * ratio, sigma, unit, known[3] and (place is None or known[place])
            )
        )
    return found
