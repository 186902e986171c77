# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The constants of the laws; docs/observers/edge_adaptive_theory.md says where each comes from."""

from __future__ import annotations

from estimator_pkg.sensor.noise import BLUR, NOISE_SAMPLES, SIGMAS  # noqa: F401  (of the laws, too)

ADAPTATION_RATE = 0.3  # of the slow law: log density per unit of its product and of filter memory
SLACK = 0.3  # of that product
SHARE = 0.2  # memory of the slow law's low-pass, over the filter's
LONGEST_MEMORY = 2.0  # [s] longest memory; the start's too
ACCELERATION_TIME_CONSTANT = 0.3  # [s]
OUTLIER_QUANTA = 2.0  # quanta: gate that one sample alone never passes
CONFIRMED = 4.0  # samples after which a start, a gap or a doubt has settled
RESTED_PART = 0.7  # of a cell's variance: a prediction this vague has seen no edge for long

FASTER = 8.0  # density of `fast` over that of `balanced`, and of that over `smooth`
RATIO = {'smooth': 1.0 / FASTER, 'balanced': 1.0, 'fast': FASTER}  # see `preference`

# what follows from these
ALARM = CONFIRMED * SIGMAS  # of the cumulative sums: four samples of twice the slack
REPEATS = ALARM  # quanta: an unchanged reading of a shaft that moved by more is no reading
LEAST_JERK_DENSITY = LONGEST_MEMORY**-5  # [1/s^5] per variance of the angle
NOISY_ABOVE = 4.0 * BLUR * BLUR  # [quanta^2] more noise is more than the blur of the edges
