"""The hybrid-angle paper: Figures 3 to 6 and every number of its specification."""

from __future__ import annotations

from sim_pkg.reproduce import (
    hybrid_continuous_rows,
    hybrid_limit_rows,
    hybrid_sampled_rows,
    hybrid_stream_rows,
)
from sim_pkg.reproduce.contract import Reproduction

REPRODUCTION = Reproduction(
    name='hybrid_angle',
    summary='Brentari, Bosetti, Zaccarian: A class of hybrid velocity observers for angular '
            'measurements with jumps (2018)',
    parts=(*hybrid_continuous_rows.PARTS, *hybrid_sampled_rows.PARTS, *hybrid_limit_rows.PARTS,
           *hybrid_stream_rows.PARTS),
    figures='sim_pkg.reproduce.hybrid_figures',
    notes=('The paper prints curves and words, no numbers but the 150 rad/s: the references come '
           'from an independent implementation.',
           'What each row shows, misprints and findings: docs/papers/hybrid_angle.md'))
