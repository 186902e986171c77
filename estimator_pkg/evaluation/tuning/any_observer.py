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
from estimator_pkg.evaluation.ranking.choice import chosen as to_use
from estimator_pkg.evaluation.text import number
from estimator_pkg.evaluation.tuning.held_out import Compared, compared
from estimator_pkg.evaluation.tuning.objective import costs, mean, measure
from estimator_pkg.evaluation.tuning.records import TuningRecord
from estimator_pkg.evaluation.tuning.settings import TuneSettings
from estimator_pkg.parameters import declared
from estimator_pkg.streams.angle import AngleSettings

DEFAULT = AngleSettings.observer
BANDWIDTH = 'bandwidth_hz'  # the gain of a linear observer


def linear() -> list[str]:
    """Return the observers of single angles with a bandwidth, without the default."""
    return [
        name
        for name in angle_observers()
        if name != DEFAULT and BANDWIDTH in declared(type(Entry('', name).joint().observer.gains()))
    ]


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

    def cost(name: str) -> float:
        ratios = []
        for record in seen:
            own, usual_ = (
                costs(measure(record.seen, each, {}), record.seen, tuning.weights)
                for each in (name, DEFAULT)
            )
            ratios += [own[joint] / max(usual_[joint], 1e-300) for joint in own]
        return mean(ratios) if ratios else math.inf

    return min(linear(), key=cost)


def against_default(
    tuned: Sequence[Mapping[str, Any]],
    groups: Mapping[str, Sequence[TuningRecord]],
    judged: Sequence[TuningRecord],
    tuning: TuneSettings,
) -> tuple[bool, dict[str, str]]:
    """Return whether the tuned observer replaces the default as it is, and why, by group.

    Their errors on held-out data decide, over the groups, by the rule of `chosen`. Where the motion
    shows no delay, noise alone would decide: the default stays.

    Parameters
    ----------
    tuned : results of `seek`. groups : the records that have their own gains. judged : as in
        `seek`.
    """
    pairs, sentences = [], {}
    for each in tuned:
        joint = each['joint']
        chosen = [record for record in groups[joint] if not record.why]
        if not chosen:
            continue
        held = [record.held_out for record in chosen if record.held_out is not None]
        own = [record.seen for record in judged if not record.why and joint in ('', record.label)]
        parts = own or held or [record.seen for record in chosen]
        observer = tuning.entry.observer
        if not each['delay_known']:
            sentences[joint] = (
                f'the motion shows no delay, so {DEFAULT} stays, the default observer'
            )
            continue
        pair = compared(parts, observer, each['gains'], tuning.weights, DEFAULT)
        sentences[joint] = _sentence(observer, bool(each['gains']), pair)
        pairs += [] if pair is None else [pair]
    if not pairs:
        return False, sentences
    ratios = [math.log(1.0 + pair.difference / 100.0) for pair in pairs]
    errors = {DEFAULT: math.exp(mean(ratios)), tuning.entry.observer: 1.0}
    sign = max(pair.sign for pair in pairs)
    return to_use(errors, (DEFAULT,), lambda *_: sign) != DEFAULT, sentences


def _sentence(observer: str, tuned: bool, pair: Compared | None) -> str:
    """Return the result of the pair in words."""
    name = f'{observer} with these gains' if tuned else f'{observer} at its defaults'
    usual_ = f'{DEFAULT}, the default observer, as it is'
    if pair is None:
        return f'too few estimates for comparing {name} with {usual_}'
    smaller = number(100.0 - 100.0 / (1.0 + max(pair.difference, 0.0) / 100.0), 2)
    if pair.sign > 0:
        return f'{name} is better than {usual_} (95 %): its error is smaller by {smaller} %'
    if pair.sign < 0:
        return f'{usual_}, is better than {name} (95 %)'
    if pair.used:
        return f'{name} has less error than {usual_}, by {smaller} %, which is not significant'
    within = number(abs(pair.difference) + pair.resolution, 2)
    return f'{name} and {usual_}, cannot be distinguished: within {within} %'
