# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Which candidate to use: the one rule of `doctor`, `evaluate` and `tune`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

LOSES = 0.03  # a simpler candidate with this much more error is not used


def chosen(
    errors: Mapping[str, float], simpler: Sequence[str], better: Callable[[str, str], int]
) -> str:
    """Return the candidate with the least error, unless a simpler one is as good.

    A simpler one is as good if the pair cannot be distinguished (95 %) and its error is less than
    3 % larger. So a difference that is not significant is believed if it is large: on series with
    truth, the measured least error is nearly always the true one.

    Parameters
    ----------
    errors : by candidate [rad/s], or in any other unit; not empty.
    simpler : candidates that have less to set, simplest first: the default is the first. Those
        without an error are ignored.
    better : its result for two candidates is positive if the first is better (95 %).
    """
    best = min(errors, key=errors.__getitem__)
    most = (1.0 + LOSES) * errors[best]
    return next(
        (
            name
            for name in simpler
            if name == best or (errors.get(name, most) < most and better(best, name) <= 0)
        ),
        best,
    )
