# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What limits a verdict without truth: failures that the readings show, and those they cannot."""

from __future__ import annotations

import numpy as np

from estimator_pkg.evaluation.ranking.verdict import NEVER_SHOWN
from estimator_pkg.evaluation.reference.motion import ReferenceMotion
from estimator_pkg.evaluation.reference.smoother.smoother import Smoothed
from estimator_pkg.evaluation.reference.vibration import UNEXPLAINED_PART
from estimator_pkg.evaluation.text import number

AT_REST = 0.01  # a joint that moves less in the whole record is at rest [rad]
SHORT_RECORD = 5.0  # a shorter record shows too little of the motion [s]
NEVER_SHOWN_BY_EMF = (
    'currents and voltages show neither a wrong resistance or inductance, which acts on the '
    'reference too, nor a constant error of the angle, nor anything near standstill'
)
UNSEEN_PART = 0.1  # a larger fraction of the readings without a reference may decide otherwise
JUDGE_BY_TRUTH = 'judge by a measured truth, or record again without jumps and repeated readings'


def cautions(reference: ReferenceMotion) -> tuple[str, ...]:
    """Return the cautions for this joint, most important first; the last one always applies."""
    found = []
    left = reference.smoothed
    if left.contradicted:
        found.append(f'{contradiction(left)}; every error here may be wrong: {JUDGE_BY_TRUTH}')
    if reference.constant:
        found.append(
            f'the joint {_steady(reference)}, so noise alone is ranked and delay is not: record '
            'a motion that accelerates'
        )
    if reference.fresh.stuck:
        longest = max(length for _, length in reference.fresh.stuck)
        found.append(
            f'the sensor sticks {len(reference.fresh.stuck)} times (longest '
            f'{number(longest * 1e3, 2)} ms) while the joint moves; these readings are left out'
        )
    if reference.fresh.stale > 0.2:
        found.append(
            f'{reference.fresh.stale:.0%} of the readings in motion repeat the one before; only '
            'new readings make the reference'
        )
    if (
        not (reference.of_emf or reference.constant or reference.vibrates or reference.seldom)
        and left.unexplained > UNEXPLAINED_PART * left.uncertainty
    ):
        found.append(
            f'an oscillation of {number(left.unexplained, 2)} rad/s in the readings is taken for '
            'tones of the counts, not for motion'
        )
    length = float(reference.time[-1] - reference.time[0])
    if length < SHORT_RECORD:
        found.append(f'the record has only {number(length, 2)} s: a longer one may rank otherwise')
    return (*found, NEVER_SHOWN_BY_EMF if reference.of_emf else NEVER_SHOWN)


def unseen(reference: ReferenceMotion) -> str:
    """Return why a ranking would leave out published estimates; '' if it judges them."""
    if reference.unseen <= UNSEEN_PART:
        return ''
    return (
        f'{reference.unseen:.0%} of the readings have no reference, because they repeat older ones '
        'while the joint moves, and the estimates there may err most: publish each reading once, '
        'with the stamp of when it was taken, or judge by a measured truth (--truth)'
    )


def contradiction(smoothed: Smoothed) -> str:
    """Return how the readings contradict the noise that was fitted to them."""
    return (
        f'the off-line reference takes {number(smoothed.noise.reading, 2)} rad for noise, but the '
        f'readings scatter by {number(smoothed.scatter, 2)} rad'
    )


def _steady(reference: ReferenceMotion) -> str:
    speed = float(np.max(np.abs(reference.velocity)))
    if speed * float(reference.time[-1] - reference.time[0]) < AT_REST:
        return 'is at rest'
    return f'moves at a constant {number(speed, 3)} rad/s'
