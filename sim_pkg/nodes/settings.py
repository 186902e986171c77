"""Parameters that every simulator node has in addition to those of its simulator. No ROS import."""

from __future__ import annotations

from dataclasses import dataclass

from estimator_pkg.parameters import parameter

FOREVER = 0.0


@dataclass(frozen=True)
class RunSettings:
    """Random seed and duration of a run, and the subscribers that it waits for."""

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
        description='number of subscribers of each measurement topic to wait for before the start, '
        'so that they miss nothing',
    )
    wait_for_truth_subscribers: int = parameter(
        0,
        unit='',
        range=(0, 1000),
        structural=True,
        description='the same for each truth topic (a recorder of all topics counts as 1 on each)',
    )
