"""The sensorless-motor paper: Figures 1 and 2, tables T0 to T7, and our claims about a drive."""

from __future__ import annotations

from sim_pkg.reproduce.contract import Reproduction
from sim_pkg.reproduce.pmsm import alias_rows, continuous_rows, drive_rows, sampled_rows

REPRODUCTION = Reproduction(
    name='pmsm',
    summary='Bosso, Azzollini, Tilli: A semi-global hybrid sensorless observer for permanent '
    'magnets synchronous machines with unknown mechanical model (2020)',
    parts=(*continuous_rows.PARTS, *sampled_rows.PARTS, *alias_rows.PARTS, *drive_rows.PARTS),
    figures='sim_pkg.reproduce.pmsm.figures',
    notes=(
        'The paper prints curves and no results as numbers: the references come from an '
        'independent implementation; rows "status" and "loop" have bounds of our own.',
        'Meaning of each row, misprints and limits: docs/papers/pmsm.md',
    ),
)
