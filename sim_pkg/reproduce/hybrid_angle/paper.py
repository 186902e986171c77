# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The hybrid-angle paper: Figures 3 to 6, Lemma 1 and Theorem 2."""

from sim_pkg.reproduce.contract import Reproduction
from sim_pkg.reproduce.hybrid_angle import continuous, sampled

REPRODUCTION = Reproduction(
    name='hybrid_angle',
    summary='Brentari, Bosetti, Zaccarian: A class of hybrid velocity observers for angular '
    'measurements with jumps (2018)',
    parts={
        'F4': ('Figure 4', continuous.figure_4_values),
        'LY': ('Lemma 1, on the runs of Figure 4', continuous.lyapunov_values),
        'F5': ('Figure 5', continuous.figure_5_values),
        'F6': ('Figure 6', sampled.figure_6_values),
        'stability': ('Theorem 2', sampled.stability_values),
    },
    notes=(
        'The paper prints curves and words, and only one number (150 rad/s). The noise of Figure 5 '
        'and the motor of Figure 6 are ours.',
        'Meaning of each row, misprints and findings: docs/papers/hybrid_angle.md',
    ),
)
