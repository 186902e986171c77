"""The sensorless-motor paper: Figures 1 and 2, tables T0 to T7, and what is claimed in a drive."""

from __future__ import annotations

from sim_pkg.reproduce import (
    pmsm_alias_rows,
    pmsm_continuous_rows,
    pmsm_drive_rows,
    pmsm_sampled_rows,
)
from sim_pkg.reproduce.contract import Reproduction

REPRODUCTION = Reproduction(
    name='pmsm',
    summary='Bosso, Azzollini, Tilli: A semi-global hybrid sensorless observer for permanent '
            'magnets synchronous machines with unknown mechanical model (2020)',
    parts=(*pmsm_continuous_rows.PARTS, *pmsm_sampled_rows.PARTS, *pmsm_alias_rows.PARTS,
           *pmsm_drive_rows.PARTS),
    figures='sim_pkg.reproduce.pmsm_figures',
    notes=('The paper prints curves and no results as numbers: the references come from an '
           'independent implementation; rows "status" and "loop" are held to our own bounds.',
           'What each row shows, misprints and limits: docs/papers/pmsm.md'))
