# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The hybrid continuous-discrete paper: Figures 2 to 4, tables B1 to B5 and C."""

from sim_pkg.reproduce.contract import Reproduction, parts
from sim_pkg.reproduce.hybrid_discrete import differentiators, rows

REPRODUCTION = Reproduction(
    name='hybrid_discrete',
    summary='Barbot, Djemai, Manamanni: State observer and observability conditions for a class '
    'of hybrid continuous-discrete dynamic system (2007)',
    parts=parts(
        'hybrid_discrete',
        {
            'B1': rows.b1_values,
            'B2': rows.b2_values,
            'B3': rows.b3_values,
            'C': rows.c_values,
            'B5': differentiators.b5_values,
        },
    ),
    figures='sim_pkg.reproduce.hybrid_discrete.figures',
    notes=(
        'The paper prints no gains, start values or results as numbers: the references come '
        'from an independent implementation.',
        'Meaning of each row, misprints and findings: docs/papers/hybrid_discrete.md',
    ),
)
