# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""`tune` without an observer: which one to tune, and whether to take it instead of the default."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from estimator_pkg import streams
from estimator_pkg.bags.log_file import Columns
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.selection import measured_topics
from estimator_pkg.evaluation.entries import Entry, angle_observers
from estimator_pkg.evaluation.tuning.objective import (
    Compared,
    Dataset,
    compared,
    costs,
    mean,
    measure,
)
from estimator_pkg.evaluation.tuning.records import TuningRecord
from estimator_pkg.evaluation.tuning.settings import TuneSettings
from estimator_pkg.parameters import declared
from estimator_pkg.streams.angle import AngleSettings

DEFAULT = AngleSettings.observer
BANDWIDTH = 'bandwidth_hz'  # the gain of a linear observer


def usual(path: str, unpack_limit: int, columns: Columns | None) -> str:
    """Return the observer of the bag's measurement: that of a drive, else the default."""
    with open_bag(path, unpack_limit, columns) as bag:
        topics, joints = bag.topics, bool(measured_topics(bag))
    for stream in streams.every():
        if stream.recognises(topics.__contains__, joints):
            return str(declared(stream.SETTINGS)['observer'].default)
    return DEFAULT


def best_linear(seen: Sequence[TuningRecord], tuning: TuneSettings) -> str:
    """Return the linear observer whose defaults cost least, relative to the default observer.

    Parameters
    ----------
    seen : data of the search.
    """
    linear = [
        name
        for name in angle_observers()
        if name != DEFAULT and BANDWIDTH in declared(type(Entry('', name).joint().observer.gains()))
    ]
    ratios: dict[str, list[float]] = {name: [] for name in linear}
    for record in seen:
        cost = {
            name: costs(measure(record.seen, name, {}), record.seen, tuning.weights)
            for name in (DEFAULT, *linear)
        }
        for name in linear:
            ratios[name] += [
                each / max(cost[DEFAULT][joint], 1e-300) for joint, each in cost[name].items()
            ]
    return min(linear, key=lambda name: mean(ratios[name]))


def against_default(
    parts: Sequence[Dataset], gains: Mapping[str, Any], tuning: TuneSettings, delay_known: bool
) -> tuple[Compared | None, str]:
    """Return the comparison of these gains with the default observer as it is, and its result.

    Where the motion shows no delay, noise alone would decide: there is no comparison.
    """
    if not delay_known:
        return None, f'the motion shows no delay, so {DEFAULT} stays, the default observer'
    observer = tuning.entry.observer
    pair = compared(parts, observer, gains, tuning.weights, DEFAULT)
    own = f'{observer} {"with these gains" if gains else "at its defaults"}'
    if pair is None:
        return None, f'too few estimates for comparing {own} with {DEFAULT}, the default observer'
    return pair, pair.text(own, f'{DEFAULT}, the default observer as it is,')


def replaces_default(pairs: Sequence[Compared]) -> bool:
    """Return True if the mean over these comparisons is for the tuned observer (`chosen`)."""
    if not pairs:
        return False
    difference = math.expm1(mean([math.log1p(pair.difference / 100.0) for pair in pairs]))
    return Compared(max(pair.sign for pair in pairs), 100.0 * difference, 0.0).used
