"""What is set of every simulator node beside the parameters of its simulator. Imports no ROS."""

from __future__ import annotations

from dataclasses import dataclass

from estimator_pkg.parameters import parameter

FOREVER = 0.0


@dataclass(frozen=True)
class RunSettings:
    """How long a simulator runs, and which of the equally likely runs it is."""

    seed: int = parameter(
        1,
        unit='',
        range=(0, 2**63 - 1),
        structural=True,
        description='the same seed and parameters give the same values and the same stamps '
        "relative to the start, live and in 'velocity_estimator simulate'",
    )
    duration: float = parameter(
        FOREVER,
        unit='s',
        range=(0.0, 1e9),
        structural=True,
        description='the node ends after this time; 0: never',
    )
    wait_for_subscribers: int = parameter(
        0,
        unit='',
        range=(0, 1000),
        structural=True,
        description='start only when every topic of the measurement has so many subscribers, so '
        'that they miss nothing',
    )
    wait_for_truth_subscribers: int = parameter(
        0,
        unit='',
        range=(0, 1000),
        structural=True,
        description='the same for every topic of the truth (a recorder of everything is 1 of each)',
    )
