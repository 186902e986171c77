"""The hybrid-angle paper: Figures 3 to 6 and every number of its specification."""

from __future__ import annotations

from sim_pkg.reproduce.contract import Reproduction
from sim_pkg.reproduce.hybrid_angle import continuous_rows, limit_rows, sampled_rows, stream_rows

REPRODUCTION = Reproduction(
    name='hybrid_angle',
    summary='Brentari, Bosetti, Zaccarian: A class of hybrid velocity observers for angular '
    'measurements with jumps (2018)',
    parts=(*continuous_rows.PARTS, *sampled_rows.PARTS, *limit_rows.PARTS, *stream_rows.PARTS),
    figures='sim_pkg.reproduce.hybrid_angle.figures',
    notes=(
        'The paper prints curves and words, and only one number (150 rad/s): the references come '
        'from an independent implementation.',
        'Meaning of each row, misprints and findings: docs/papers/hybrid_angle.md',
    ),
)
