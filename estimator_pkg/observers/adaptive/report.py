# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The report of the adaptive observer: identified parameters, their errors, and trust in them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from estimator_pkg.observers.adaptive.evidence import Assessment, Evidence, judge
from estimator_pkg.observers.adaptive.law import (
    ADAPTING,
    PAUSED,
    PHASE_NAMES,
    PHASE_TEXTS,
    injected,
    variance,
)
from estimator_pkg.observers.adaptive.observer import SLOW_POWER_RATIO, Adaptive
from estimator_pkg.observers.adaptive.state import Array, Coefficients, Design, State
from estimator_pkg.observers.adaptive.structure import Gains, names_of, physical
from estimator_pkg.observers.maths.linear import companion

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
    excitation: float  # information over that of noise alone; the gate opens at SIGNAL_TO_NOISE
    why_not: str = ''  # the condition that is not met; '' if trusted
    explained: float = math.nan  # part of the acceleration's power that is predicted; nan: unknown


class Origin(NamedTuple):
    """The origin of parameters from a file."""

    stddev: tuple[float, ...]  # standard deviations in the order of theta
    trusted: bool  # they were trusted when they were saved


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
    names, theta, adapted = names_of(gains), state.plant.tolist(), state.adapted
    supplied = adapted == 0.0 and design.has_theta
    verdict = None
    if evidence is not None and not supplied:
        verdict = _verdict(design, state, dt, evidence)
    covariance = _covariance(design, verdict, supplied, origin)
    sigma, scale, precise = _precision(design, state.plant, covariance, verdict)
    ratios = physical(names, design.model)
    why_not = _doubt(state, supplied, verdict)
    if not why_not and not supplied:
        own = {place: name for name, (place, *_) in ratios.items()}
        vague = [own.get(i, names[i]) for i in design.free if not precise[i]]
        why_not = _unphysical(design, state.plant, bool(ratios), gains, sigma, scale)
        if vague and not why_not:
            much = f'{100.0 * SMALL_ERROR:.0f} %'
            why_not = f'the error of {", ".join(vague)} may be larger than {much}'
    if supplied and origin is not None and not origin.trusted:
        why_not = 'they were not trusted when they were saved'
    # one bad parameter does not make the others bad, but a model that does not fit does
    fits = not why_not or (verdict is not None and _fits(verdict))
    known = [
        (supplied and not why_not) or i not in design.free or (fits and precise[i])
        for i in range(len(names))
    ]
    parameters = [
        Identified(name, value, s, _unit(name), good)
        for name, value, s, good in zip(names, theta, sigma, known)
    ]
    parameters += [
        Identified(name, offset + sign * theta[place], sigma[place], unit, known[place])
        for name, (place, offset, sign, unit) in ratios.items()
    ]
    if ratios and gains.torque_constant is not None:
        parameters += _masses(gains.torque_constant, ratios, theta, covariance, known)
    phase = state.phase
    reason = PAUSED if phase == ADAPTING and state.paused > 0.0 else PHASE_TEXTS[phase]
    return IdentificationReport(
        PHASE_NAMES[phase],
        f'{reason}; not trusted: {why_not}' if why_not else reason,
        tuple(parameters),
        names,
        tuple(theta),
        not why_not,
        adapted,
        excitation(design, state, dt),
        why_not,
        verdict.explained if verdict is not None else math.nan,
    )


def excitation(design: Design, state: State, dt: float) -> float:
    """Return the least ratio of the information to that of noise alone."""
    noise = dt * variance(state, design) * design.noise_floor
    try:
        most = float(np.max(np.linalg.eigvals(np.linalg.solve(state.information, noise)).real))
    except np.linalg.LinAlgError:
        return 0.0
    return 1.0 / most if most > 0.0 else 0.0


def _verdict(design: Design, state: State, dt: float, evidence: Evidence) -> Assessment | None:
    """Return the assessment of theta, including errors by noise in the filters and by sampling."""
    n, coefficients = design.order, Coefficients()
    Adaptive.prepare(coefficients, design, dt)
    noise, low_pass = variance(state, design), coefficients.low_pass
    to_x, free = injected(state, design), design.free
    bias = np.zeros(len(state.plant))
    # the first row of G1 is the weight of the newest sample in psi
    bias[:n] = noise * (coefficients.G1[0] - dt * design.w @ to_x)
    slow = noise * (1.0 + dt * float(to_x @ design.w @ to_x)) * low_pass / (2.0 - low_pass)
    sampling = _sampling(design, state.plant, dt)
    return judge(evidence, state.plant[free], bias[free], sampling[free], slow, SLOW_POWER_RATIO)


def _sampling(design: Design, theta: Array, dt: float) -> Array:
    """Return the error of theta from the sampling, to leading order, in the order of theta.

    The filters of the sampled form assume a linear angle between samples. Forward Euler estimates
    (exp(A dt) - 1)/dt instead of A.
    """
    n, plant = design.order, theta.copy()
    plant[:n] += design.model
    if not design.is_paper:
        return (design.pace * dt) ** 2 / CURVED * np.abs(plant)
    a, error = companion(plant[:n]), np.zeros(len(theta))
    error[:n] = np.poly(a)[1:] - np.poly(a + 0.5 * dt * a @ a)[1:]
    error[n : 2 * n] = 0.5 * dt * a @ plant[n : 2 * n]
    return error


def _covariance(
    design: Design, verdict: Assessment | None, supplied: bool, origin: Origin | None
) -> Array:
    """Return the covariance of theta, shape (p, p); infinite variances for unknown parameters."""
    size, free = len(design.fixed), design.free
    covariance = np.zeros((size, size))
    places = np.ix_(free, free)
    if supplied and origin is not None:
        fits = len(origin.stddev) == size
        sigmas = np.array(origin.stddev)[free] if fits else np.full(len(free), math.inf)
        covariance[places] = np.diag(sigmas**2)
    elif not supplied:
        unknown = np.diag([math.inf] * len(free))
        covariance[places] = unknown if verdict is None else verdict.covariance
    return covariance


def _precision(
    design: Design, theta: Array, covariance: Array, verdict: Assessment | None
) -> tuple[list[float], Array, list[bool]]:
    """Return standard deviations, scales (see `Assessment`), and whether the error is small."""
    plant, sigma = theta.copy(), np.sqrt(np.diag(covariance))
    plant[: design.order] += design.model
    hidden, scale = np.zeros_like(plant), np.zeros_like(plant)
    if verdict is not None:
        hidden[design.free], scale[design.free] = verdict.hidden, verdict.scale
    allowed = np.maximum(SMALL_ERROR * np.abs(plant), ZERO_ERROR * scale)
    return sigma.tolist(), scale, (np.hypot(sigma, hidden) <= allowed).tolist()


def _fits(verdict: Assessment) -> bool:
    return verdict.noise_only or verdict.explained >= EXPLAINED


def _doubt(state: State, supplied: bool, verdict: Assessment | None) -> str:
    """Return why no parameter is trusted; '' if some may be."""
    if supplied:
        return '' if state.trusted else 'the innovation is larger than noise explains'
    if state.adapted == 0.0:
        return 'nothing was learnt'
    if verdict is None:
        return 'too little was learnt, or the signals do not determine the parameters'
    if not _fits(verdict):
        return (
            f'the model predicts {100.0 * max(0.0, verdict.explained):.0f} % of the '
            f'acceleration: at least {100.0 * EXPLAINED:.0f} % are needed'
        )
    return ''


def _unphysical(
    design: Design, theta: Array, has_ratios: bool, gains: Gains, sigma: list[float], scale: Array
) -> str:
    """Return why the parameters are not those of a servo; '' if they may be."""
    damping, gain = -design.model[0] - float(theta[0]), 3  # b/J, and the place of Kv/J
    if not has_ratios:
        return ''
    if 0 in design.free and damping < -SIGN_SIGMAS * sigma[0] - ZERO_ERROR * float(scale[0]):
        return 'the damping b/J is negative'
    known = gains.torque_constant is not None
    if known and gain in design.free and theta[gain] <= SIGN_SIGMAS * sigma[gain]:
        return 'the inertia may be negative: does the input have the right sign?'
    return ''


def _unit(name: str) -> str:
    power = '' if name[1:] == '1' else f'^{name[1:]}'
    if name[0] == 'l':
        return f'1/s{power}'
    return f'rad/s{power}' + (' per unit of input' if name[0] == 'b' else '')


def _masses(
    constant: float, ratios: dict, theta: list[float], covariance: Array, known: list[bool]
) -> list[Identified]:
    """Return J, b, k and m g l from the ratios and Kv, with standard deviations to first order."""
    gain = theta[3]
    if gain == 0.0:
        return []
    inertia, found = constant / gain, []
    for name, unit in (('J', 'kg m^2'), ('b', 'N m s/rad'), ('k', 'N m/rad'), ('mgl', 'N m')):
        slope, ratio, good = np.zeros(len(theta)), 1.0, known[3]
        if name != 'J':
            if f'{name}/J' not in ratios:
                continue
            place, offset, sign, _ = ratios[f'{name}/J']
            slope[place], ratio = inertia * sign, offset + sign * theta[place]
            good = good and known[place]
        slope[3] = -inertia * ratio / gain
        used = slope != 0.0
        variance = float(slope[used] @ covariance[np.ix_(used, used)] @ slope[used])
        sigma = math.sqrt(variance) if variance >= 0.0 else math.inf
        found.append(Identified(name, inertia * ratio, sigma, unit, good))
    return found
