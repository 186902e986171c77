"""The paper on observers of mechanisms: every row, Tables 1, 2, 5, 6, 7, Figures 2 to 13."""

from __future__ import annotations

from sim_pkg.reproduce import (
    mechanical_benefit,
    mechanical_cart,
    mechanical_fast,
    mechanical_gain_rows,
    mechanical_lab,
    mechanical_leg,
    mechanical_loop,
    mechanical_smoother,
    mechanical_tables,
)
from sim_pkg.reproduce.contract import Reproduction

REPRODUCTION = Reproduction(
    name='mechanical',
    summary='Aranovskiy, Ortega, Romero, Sokolov: A globally exponentially stable speed observer '
            'for a class of mechanical systems (2019)',
    parts=(*mechanical_gain_rows.PARTS, *mechanical_cart.PARTS, *mechanical_leg.PARTS,
           *mechanical_lab.PARTS, *mechanical_loop.PARTS, *mechanical_smoother.PARTS,
           *mechanical_benefit.PARTS, *mechanical_fast.PARTS),
    figures='sim_pkg.reproduce.mechanical_figures', tables=mechanical_tables.lines,
    notes=('References are from an independent implementation; "paper" is what the paper prints.',
           'Which printed numbers cannot be reproduced, and why: docs/papers/mechanical.md'))
