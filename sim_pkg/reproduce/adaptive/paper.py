"""The adaptive paper: Figures 1 and 2, tables A1 to A6 of its specification, the recordings."""

from __future__ import annotations

from sim_pkg.reproduce.adaptive import excitation_rows, recorded_rows, rows, sampling_rows
from sim_pkg.reproduce.contract import Reproduction

REPRODUCTION = Reproduction(
    name='adaptive',
    summary='Gonzalez-Olvera, Tang: Velocity estimation using adaptive observers',
    parts=(*rows.PARTS, *sampling_rows.PARTS, *excitation_rows.PARTS, *recorded_rows.PARTS),
    figures='sim_pkg.reproduce.adaptive.figures',
    tables=recorded_rows.table,
    notes=(
        'The inputs, the start values and the gains of example 4.1 are not published: ours are '
        'in sim_pkg/reproduce/adaptive/plant.py.',
        'Meaning of each row, misprints and findings: docs/papers/adaptive.md',
        *(
            ()
            if recorded_rows.PARTS
            else ('The recorded pendulum is skipped: the folder bags does not exist here.',)
        ),
    ),
)
