"""The paper on observers of mechanisms: every row, Tables 1, 2, 5, 6, 7, Figures 2 to 13."""

from __future__ import annotations

from sim_pkg.reproduce.contract import Reproduction
from sim_pkg.reproduce.mechanical import (
    benefit,
    cart,
    fast,
    gain_rows,
    lab,
    leg,
    loop,
    smoother,
    tables,
)

REPRODUCTION = Reproduction(
    name='mechanical',
    summary='Aranovskiy, Ortega, Romero, Sokolov: A globally exponentially stable speed observer '
    'for a class of mechanical systems (2019)',
    parts=(
        *gain_rows.PARTS,
        *cart.PARTS,
        *leg.PARTS,
        *lab.PARTS,
        *loop.PARTS,
        *smoother.PARTS,
        *benefit.PARTS,
        *fast.PARTS,
    ),
    figures='sim_pkg.reproduce.mechanical.figures',
    tables=tables.lines,
    notes=(
        'References are from an independent implementation; "paper" is what the paper prints.',
        'Which printed numbers cannot be reproduced, and why: docs/papers/mechanical.md',
    ),
)
