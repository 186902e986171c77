# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The shared parameters of all observers of mechanisms, and functions of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator_pkg import registry
from estimator_pkg.errors import UsageError
from estimator_pkg.models.mechanics import Array, Mechanics, assignments_of
from estimator_pkg.parameters import build, parameter, structural

EXACT_FORM, PAPER_FORM = 'exact', 'paper'
LINEAR, PREVIOUS = 'linear', 'previous'
AT_MEASUREMENT, AT_ESTIMATE = 'measurement', 'estimate'


@dataclass(frozen=True)
class MechanicalGains:
    """The parameters that all observers of mechanisms share."""

    model: str = structural(
        'single_joint',
        choices=(*registry.names(registry.MODELS), 'package.module:name'),
        description="the mechanism; 'velocity_estimator list' shows the parameters of each, "
        'docs/known_inputs.md how to write one',
    )
    model_parameters: tuple[str, ...] = structural(
        (),
        description="the model's numbers as 'name=value', such as ['inertia=0.05', "
        "'damping=0.01']; 'velocity_estimator identify' estimates them",
    )
    form: str = structural(
        EXACT_FORM,
        choices=(EXACT_FORM, PAPER_FORM),
        description='exact: the step is exact for the time between samples; paper: forward Euler, '
        'which is unstable unless dt K is well below L',
    )
    hold: str = structural(
        LINEAR,
        choices=(LINEAR, PREVIOUS),
        advanced=True,
        description='the measurement between samples in the exact form: linear, or constant at the '
        'previous sample (half a sample more delay)',
    )
    schedule: str = structural(
        AT_MEASUREMENT,
        choices=(AT_MEASUREMENT, AT_ESTIMATE),
        description='where the model is evaluated: at the measurement, as the proof requires, or '
        'at the estimated position, which is less noisy with a noisy encoder',
    )
    noise: tuple[float, ...] | None = parameter(
        None,
        unit='rad or m',
        kind=list,
        range=(1e-12, 10.0),
        description='standard deviation of the measurement noise of each position; automatic: '
        'estimated from the innovation',
    )
    quantum: tuple[float, ...] | None = parameter(
        None,
        unit='rad or m',
        kind=list,
        range=(0.0, 10.0),
        description='smallest step of each measurement; automatic: not known',
    )


@dataclass(frozen=True)
class BandwidthGains:
    """The parameters of observers that are tuned by a bandwidth at an operating point."""

    bandwidth_hz: float = parameter(
        10.0,
        unit='Hz',
        range=(0.001, 1e5),
        search=(0.5, 500.0),
        description='-3 dB frequency from true to estimated velocity for motion that the model '
        'does not predict; lower trusts the model more. Not used if L or h is set',
    )
    operating_point: tuple[float, ...] | None = parameter(
        None,
        unit='rad or m',
        kind=list,
        range=(-1e6, 1e6),
        description='positions for which bandwidth and damping are set; automatic: the middle of '
        "the model's range",
    )


@dataclass(frozen=True)
class LoopGains(BandwidthGains):
    """The parameters of observers with an error of second order and an optional disturbance."""

    damping: float = parameter(
        1.0,
        range=(0.1, 10.0),
        search=(0.5, 2.0),
        description='damping ratio of the error at the operating point',
        equation='L = 2 damping sqrt(K), velocity/true = K/(s^2 + L s + K)',
    )
    L: tuple[float, ...] | None = parameter(
        None,
        unit='1/s',
        kind=list,
        range=(-1e9, 1e9),
        advanced=True,
        description='gain of the position: one number, one per position, or a matrix row by row; '
        'automatic: from bandwidth_hz and damping',
        equation="qh' = vh + L (y - qh)",
    )
    disturbance_hz: float = parameter(
        0.0,
        unit='Hz',
        range=(0.0, 1e4),
        search=(0.0, 50.0),
        description='bandwidth of the disturbance estimate, for constant or slow forces that the '
        'model does not contain; 0: no disturbance estimate',
    )


def default_numbers(gains: MechanicalGains) -> str:
    """Return the numbers of a built-in model if all are defaults; else ''."""
    if gains.model_parameters or ':' in gains.model:
        return ''
    model = registry.find(registry.MODELS, gains.model)
    return ', '.join(assignments_of(model, build(model.parameters, {})))


def gain_matrix(name: str, values: tuple[float, ...], count: int) -> Array:
    """Return a gain as a matrix, shape (count, count).

    `values` are one number for all positions, one number each, or a matrix row by row.

    Raises
    ------
    UsageError : neither 1, n nor n^2 numbers.
    """
    numbers = np.array(values, float)
    if len(numbers) == 1:
        return np.eye(count) * numbers[0]
    if len(numbers) == count:
        return np.diag(numbers)
    if len(numbers) == count * count:
        return numbers.reshape(count, count)
    takes = (
        'one position takes 1'
        if count == 1
        else f'{count} positions takes 1, {count} or {count * count}'
    )
    raise UsageError(f"parameter '{name}' has {len(numbers)} numbers; a mechanism of {takes}")


def per_joint(name: str, values: tuple[float, ...] | None, count: int) -> tuple[float, ...]:
    """Return one number per joint; zeros if `values` is None; raises UsageError."""
    if values is None:
        return (0.0,) * count
    if len(values) == 1:
        return tuple(values) * count
    if len(values) != count:
        right = '1 position: set 1' if count == 1 else f'{count} positions: set 1 or {count}'
        raise UsageError(f"parameter '{name}' has {len(values)} numbers for {right}")
    return tuple(values)


def operating_point(gains: BandwidthGains, mechanics: Mechanics) -> Array:
    """Return the positions for which bandwidth and damping are set [rad or m], shape (n,).

    Raises
    ------
    UsageError : the wrong number of positions, or the model is not valid there.
    """
    if gains.operating_point is None:
        return np.array(mechanics.centre, float)
    if len(gains.operating_point) != mechanics.degrees:
        raise UsageError(
            f"parameter 'operating_point' has {len(gains.operating_point)} numbers "
            f'for {mechanics.degrees} positions: set {mechanics.degrees}'
        )
    if not mechanics.admits(np.array(gains.operating_point, float)):
        raise UsageError(
            f"model '{mechanics.name}' is not valid at operating_point "
            f'{list(gains.operating_point)}: choose positions inside its domain'
        )
    return np.array(gains.operating_point, float)
