# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the observer `switched`."""

from __future__ import annotations

from dataclasses import dataclass

from estimator_pkg.models.switched import OWN
from estimator_pkg.parameters import parameter, structural


@dataclass(frozen=True)
class Gains:
    """Parameters of `switched`."""

    model: str = structural(
        'gripper',
        choices=(*OWN, 'package.module:name'),
        description='the system: a built-in model, or your own SwitchedModel',
    )
    discrete: str = structural(
        'regression',
        choices=('regression', 'inversion', 'copy'),
        description='how Z is estimated: regression for noisy encoders; inversion as in the paper, '
        'for exact outputs only; copy: predicted with A_d and beta_d only',
        equation='(28), (29)',
    )
    velocity: str = structural(
        'filtered',
        choices=('filtered', 'cascade'),
        description='source of the published velocity. filtered: an extended observer that uses '
        'the model with the estimated Z, for noisy encoders; cascade: the super-twisting stages, '
        'as in the paper',
        equation='(22)',
    )
    bandwidth_hz: float = parameter(
        48.0,
        unit='Hz',
        range=(0.001, 1e6),
        search=(1.0, 500.0),
        description='-3 dB frequency from true to estimated velocity for motion that the model '
        'does not predict; velocity filtered only',
    )
    form: str = structural(
        'implicit',
        choices=('implicit', 'explicit'),
        description='discretisation of super-twisting; explicit chatters, it is there for '
        'comparison',
    )
    gate: float = parameter(
        1e-3,
        unit='unit of the output',
        range=(1e-12, 1e6),
        description='a stage runs while the errors of all stages before it are below this',
        equation='epsilon in (23)',
    )
    steps: int = structural(
        1,
        range=(1, 20),
        description='number of past intervals that the inversion uses',
        equation='N in (28)',
    )
    singular_value: float = parameter(
        0.05,
        range=(0.0, 1e9),
        description='the inversion is used if the smallest singular value of its matrix is above '
        'this',
    )
    settle: float = parameter(
        0.3,
        unit='s',
        range=(0.0, 1e6),
        description='settling time after an event, during which Z is predicted and not converged; '
        'between two events closer than this Z stays predicted',
        equation='tau_c in (26)',
    )
    reset: str = structural(
        'all',
        choices=('all', 'states', 'none'),
        description='what (13) resets at an event. states: the states of both chains; all: the '
        'last derivative of each chain too; none: nothing',
    )
    filter_rate: float = structural(
        25.0,
        unit='1/s',
        range=(1e-3, 1e5),
        description='pole of the regression filter; set it as high as the noise allows',
    )
    memory: float = parameter(
        0.0,
        unit='s',
        range=(0.0, 1e9),
        description='time constant with which the regression forgets within an interval; 0: it '
        'forgets nothing',
    )
    bound_scale: float = parameter(
        1.0,
        range=(1e-6, 1e6),
        description="factor on the model's bounds L of the outputs' derivatives",
    )
    quantum: float = parameter(
        0.0,
        unit='rad',
        range=(0.0, 10.0),
        description='smallest step of the measurement; 0: not known',
    )
    noise: float | None = parameter(
        None,
        unit='rad',
        range=(1e-12, 10.0),
        description='standard deviation of the measurement noise; automatic: estimated',
    )
