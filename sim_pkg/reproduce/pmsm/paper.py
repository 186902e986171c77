# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The sensorless-motor paper: Figures 1 and 2, tables T0 to T7, and our claims about a drive."""

from sim_pkg.reproduce.contract import Reproduction, parts
from sim_pkg.reproduce.pmsm import alias_rows, continuous_rows, drive_rows, sampled_rows

REPRODUCTION = Reproduction(
    name='pmsm',
    summary='Bosso, Azzollini, Tilli: A semi-global hybrid sensorless observer for permanent '
    'magnets synchronous machines with unknown mechanical model (2020)',
    parts=parts(
        'pmsm',
        {
            'T0': continuous_rows.checkpoint_values,
            'T1': continuous_rows.unit_values,
            'T2': continuous_rows.run_values,
            'order': continuous_rows.order_values,
            'T3': sampled_rows.scheme_values,
            'T4': sampled_rows.start_values,
            'T5': sampled_rows.bias_values,
            'T7': sampled_rows.loop_values,
            'T6': alias_rows.values,
            'status': drive_rows.status_values,
            'loop': drive_rows.loop_values,
        },
    ),
    figures='sim_pkg.reproduce.pmsm.figures',
    notes=(
        'The paper prints curves and no results as numbers: the references come from an '
        'independent implementation; rows "status" and "loop" have bounds of our own.',
        'Meaning of each row, misprints and limits: docs/papers/pmsm.md',
    ),
)
