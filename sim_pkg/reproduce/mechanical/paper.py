# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The paper on observers of mechanisms: every row, Tables 1, 2, 5, 6, 7, Figures 2 to 13."""

from __future__ import annotations

from sim_pkg.reproduce.contract import Reproduction, parts
from sim_pkg.reproduce.mechanical import (
    benefit,
    cart,
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
    parts=parts(
        'mechanical',
        {
            'A': gain_rows.values,
            'B': cart.values,
            'C': leg.values,
            'H1': leg.study_values,
            'D': lab.values,
            'H3': lab.study_values,
            'H4': lab.low_amplitude_values,
            'E': loop.values,
            'F': smoother.values,
            'H5': smoother.jitter_values,
            'G': benefit.values,
            'H2': cart.fast_values,
        },
    ),
    figures='sim_pkg.reproduce.mechanical.figures',
    tables=tables.lines,
    notes=(
        'References are from an independent implementation; "paper" is what the paper prints.',
        'Which printed numbers cannot be reproduced, and why: docs/papers/mechanical.md',
    ),
)
