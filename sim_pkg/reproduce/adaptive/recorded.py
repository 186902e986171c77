# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Rows of the recorded pendulum: the parameters that the observer identifies, per recording.

The paper has no recordings, so the references are our own results: they guard against change. The
rows show which parameters agree between the recordings and which are not trusted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations
from pathlib import Path
from typing import Any

from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.series import joint_series
from estimator_pkg.driver.adaptive import AdaptiveJoint
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.observers.adaptive.observer import OBSERVER
from estimator_pkg.observers.adaptive.report import Report
from estimator_pkg.parameters import build
from sim_pkg.reproduce.contract import Row, Values, references

RECORDINGS = {
    'energy_shaping': 'energy_shaping_200hz',
    'sac': 'sac_200hz_multiturn',
    'system_identification': 'system_identification_300hz',
    'gravity_compensation': 'gravity_compensation_1000hz',
}
QUANTUM = 2.914e-3  # [rad] of the position column
# The input is a torque; gravity is a known regressor and there is no spring. Nothing is learnt
# where the joint sticks or a hand pushes it.
SETTINGS: dict[str, Any] = {
    'gravity': True,
    'known': ('b1=0', 'k/J=0'),
    'bandwidth_hz': 3.0,
    'moving_above': 0.5,
    'torque_constant': 1.0,
    'quantum': QUANTUM,
}
LINEAR: dict[str, Any] = {
    'known': ('b1=0',),
    'torque_constant': 1.0,
    'quantum': QUANTUM,
}  # as somebody may start
NAMES = {'1/J': 'Kv/J', 'b/J': 'b/J', 'mgl/J': 'mgl/J'}
UNITS = {'1/J': '1/(kg m^2)', 'b/J': '1/s', 'mgl/J': '1/s^2'}
TRUSTED = ('energy_shaping', 'sac', 'system_identification')  # a hand moves the joint in the other


def folder() -> Path | None:
    """Return the folder of the recordings; None if it is missing (it is not installed)."""
    for place in (Path('bags'), Path(__file__).parents[3] / 'bags'):
        if (place / 'dfki_simple_pendulum').is_dir():
            return place / 'dfki_simple_pendulum'
    return None


@lru_cache
def identified(recording: str, linear: bool = False) -> Report:
    """Return the observer's report at the end of a recording."""
    place = folder()
    assert place is not None
    with open_bag(place / RECORDINGS[recording]) as bag:
        series = next(iter(joint_series(bag, '/joint_states').values()))
    joint = AdaptiveJoint(
        OBSERVER,
        build(OBSERVER.gains, LINEAR if linear else SETTINGS),
        JointSettings(wrap_period=0.0),
    )
    for stamp, angle, torque in zip(
        series.stamps_ns.tolist(), series.position.tolist(), series.effort.tolist()
    ):
        joint.update(stamp, angle, torque)  # as live: a batch would end its blocks differently
    return joint.report()


def values() -> Values:
    """Yield the values of all rows."""
    found = {recording: identified(recording) for recording in RECORDINGS}
    numbers = {
        recording: {item.name: item for item in report.parameters}
        for recording, report in found.items()
    }
    for recording in TRUSTED:
        for name, own in NAMES.items():
            yield f'recorded {recording} {name}', numbers[recording][own].value
            yield f'recorded {recording} {name} stddev', numbers[recording][own].stddev
        yield f'recorded {recording} explained', found[recording].explained
    for name, own in NAMES.items():
        yield (
            f'recorded disagreement {name}',
            max(
                abs(numbers[a][own].value - numbers[b][own].value)
                / math.hypot(numbers[a][own].stddev, numbers[b][own].stddev)
                for a, b in combinations(TRUSTED, 2)
            ),
        )
    yield 'recorded gravity_compensation explained', found['gravity_compensation'].explained
    yield 'recorded gravity_compensation trusted', _trusted(found['gravity_compensation'])
    for recording in RECORDINGS:
        yield f'recorded spring {recording} trusted', _trusted(identified(recording, linear=True))


def _trusted(report: Report) -> int:
    """Return the number of trusted parameters among those that had to be learnt."""
    return sum(item.trusted for item in report.parameters if item.stddev > 0.0)


def table(rows: Sequence[Row]) -> list[str]:
    """Return the table of all recordings as lines; none if its rows were not computed."""
    value = {row.reference.id: row.value for row in rows}
    if not all(
        reference.id in value
        for reference in references('adaptive')
        if reference.id.startswith('recorded')
    ):
        return []
    lines = [
        'The recorded pendulum (torque in, gravity a known regressor): value, standard',
        'deviation, and how much of the motion the model explains:',
        f'  {"recording":14}'
        + ''.join(f'{f"{name} [{UNITS[name]}]":>19}' for name in NAMES)
        + '  model',
    ]
    for recording in TRUSTED:
        numbers = ''.join(
            f'{value[f"recorded {recording} {name}"]:10.4g} +- '
            f'{value[f"recorded {recording} {name} stddev"]:<5.2g}'
            for name in NAMES
        )
        explained = 100.0 * value[f'recorded {recording} explained']
        lines.append(f'  {recording[:14]:14}{numbers}{explained:5.1f} %')
    lines.append(
        f'  {"gravity_comp.":14}{"nothing that is trusted":>57}'
        f'{100.0 * value["recorded gravity_compensation explained"]:5.1f} %'
    )
    worst = {name: value[f'recorded disagreement {name}'] for name in NAMES}
    lines.append(
        '  They agree within '
        + ', '.join(f'{far:.1f} ({name})' for name, far in worst.items())
        + ' standard deviations.'
    )
    return lines
