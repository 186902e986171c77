"""Parameters of the observer `switched`."""

from __future__ import annotations

from dataclasses import dataclass

from estimator_pkg.models.switched import OWN
from estimator_pkg.parameters import parameter


@dataclass(frozen=True)
class Gains:
    """Parameters of `switched`."""

    model: str = parameter(
        'gripper',
        unit='',
        choices=(*OWN, 'package.module:name'),
        structural=True,
        description='the system: one of ours, or your own SwitchedModel',
    )
    discrete: str = parameter(
        'regression',
        unit='',
        choices=('regression', 'inversion', 'copy'),
        structural=True,
        description='how Z is found: regression for noisy encoders; inversion as in the paper, for '
        'exact outputs only; copy: from A_d and beta_d alone',
        equation='(28), (29)',
    )
    velocity: str = parameter(
        'filtered',
        unit='',
        choices=('filtered', 'cascade'),
        structural=True,
        description='what is published. filtered: an observer that is fed the model with Z as it '
        'is known, for noisy encoders; cascade: the super-twisting stages, as in the '
        'paper',
        equation='(22)',
    )
    bandwidth_hz: float = parameter(
        48.0,
        unit='Hz',
        range=(0.001, 1e6),
        search=(1.0, 500.0),
        description='-3 dB frequency from true to estimated velocity, of what the model does not '
        'explain; velocity filtered only',
    )
    form: str = parameter(
        'implicit',
        unit='',
        choices=('implicit', 'explicit'),
        structural=True,
        description='sampling of super-twisting; explicit chatters, kept to show why not',
    )
    gate: float = parameter(
        1e-3,
        unit='unit of the output',
        range=(1e-12, 1e6),
        description='a stage runs while the errors of all before it are below this',
        equation='epsilon in (23)',
    )
    steps: int = parameter(
        1,
        unit='',
        range=(1, 20),
        structural=True,
        description='intervals that the inversion looks back',
        equation='N in (28)',
    )
    singular_value: float = parameter(
        0.05,
        unit='',
        range=(0.0, 1e9),
        description='the inversion is used while the least singular value of its matrix is above',
    )
    settle: float = parameter(
        0.3,
        unit='s',
        range=(0.0, 1e6),
        description='after an event Z is predicted, and not converged, for so long; two events '
        'closer than this leave the prediction',
        equation='tau_c in (26)',
    )
    reset: str = parameter(
        'all',
        unit='',
        choices=('all', 'states', 'none'),
        structural=True,
        description='what is moved by (13) at an event: the states of both kinds, and (all) what '
        'ends the chains',
    )
    filter_rate: float = parameter(
        25.0,
        unit='1/s',
        range=(1e-3, 1e5),
        structural=True,
        description='pole of the filter of the regression; as high as the noise allows',
    )
    memory: float = parameter(
        0.0,
        unit='s',
        range=(0.0, 1e9),
        description='the regression forgets with this time constant within an interval; 0: never',
    )
    bound_scale: float = parameter(
        1.0,
        unit='',
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
