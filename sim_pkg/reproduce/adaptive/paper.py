# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The adaptive paper: Figures 1 and 2, and what it prints of its two examples."""

from sim_pkg.reproduce.adaptive import examples
from sim_pkg.reproduce.contract import Reproduction

REPRODUCTION = Reproduction(
    name='adaptive',
    summary='Gonzalez-Olvera, Tang: Velocity estimation using adaptive observers',
    parts={
        'A1': ('4.1, velocity of a DC motor', examples.a1_values),
        'A2': ('4.2, identification', examples.a2_values),
    },
    reasons=(
        (
            r'A2 theta.* b1',
            'b1 is 0 in the plant: both numbers are what training leaves of it, and its length is '
            'not printed',
        ),
        (
            r'A2 parallel',
            'the error depends on the length of the training, which is not printed: 0.0016 after '
            '400 s, 0.081 after 300 s',
        ),
    ),
    notes=(
        'The inputs, the start values and the gains of example 4.1 are not published: ours are '
        'in sim_pkg/reproduce/adaptive/plant.py.',
        'Meaning of each row, misprints and findings: docs/papers/adaptive.md',
    ),
)
