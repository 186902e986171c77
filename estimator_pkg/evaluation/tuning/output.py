# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The output of `tune`: a table and sentences, also as comments in a YAML for the node."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from estimator_pkg import params_file, streams
from estimator_pkg.evaluation import parameter_file
from estimator_pkg.evaluation.text import WIDTH, for_node, interval, number, table, units, wrapped
from estimator_pkg.evaluation.tuning.objective import Compared
from estimator_pkg.evaluation.tuning.settings import Settings
from estimator_pkg.evaluation.tuning.tune import Tuned
from estimator_pkg.parameters import declared

TABLE_HEADER = ('joint', '', 'error', 'delay ms', 'noise', 'cost')  # [rad/s]


def node_values(tuned: Sequence[Tuned]) -> dict[str, Any]:
    """Return the gains to use by parameter: ``<gain>`` or ``per_joint.<joint>.<gain>``.

    Where the defaults stay, these are the defaults of the gains that were searched.
    """
    found: dict[str, Any] = {}
    for each in tuned:
        prefix = f'{params_file.OVERRIDES}.{each.joint}.' if each.joint else ''
        gains = each.gains or each.default_gains
        found.update({prefix + name: value for name, value in gains.items() if value is not None})
    return found


def as_yaml(
    settings: Settings, held: Mapping[str, Any], tuned: Sequence[Tuned], remaps: Sequence[str] = ()
) -> str:
    """Return a parameter file for the observer's node, with comments on the tuning.

    Where the defaults stay, it has the quantum of the readings, if the observer has that gain.

    Parameters
    ----------
    held : fixed parameters, which the node needs too.
    tuned : results of `tune`; one without a joint applies to all of them.
    remaps : of the node's topics.
    """
    observer = settings.entry.observer
    stream = streams.of_observer(observer)
    origin = 'tuned from data' if any(each.gains for each in tuned) else 'its defaults'
    about = [
        f'Gains of {observer}: {origin} (preference: {settings.preference}).',
        *for_node(stream.NODE, remaps),
    ]
    for each in tuned:
        of = f'Joint {each.joint}' if each.joint else f'Joints {", ".join(each.joints)}'
        about += [f'{of}, from', *(f'  {bag}' for bag in each.bags)]
        if each.judged_on:
            about += ['validated on', *(f'  {bag}' for bag in each.judged_on)]
    about += described(tuned, period=held.get('wrap_period', math.tau), width=WIDTH - 2)
    known = streams.parameters(observer, held)
    values: dict[str, Any] = (
        {'observer': observer} if 'observer' in declared(stream.SETTINGS) else {}
    )
    for name, value in held.items():
        values[name] = known[params_file.parameter_of(name)].plain(value)
    joints: dict[str, Mapping[str, Any]] = {}
    for each in tuned:
        quanta = each.quanta if 'quantum' in settings.gains and 'quantum' not in held else {}
        if each.gains or not quanta:
            joints[each.joint] = each.gains
        elif not each.joint and len(set(quanta.values())) == 1:
            values['quantum'] = next(iter(quanta.values()))
        else:
            joints.update({joint: {'quantum': value} for joint, value in quanta.items()})
    values.update(joints.pop('', {}))
    return parameter_file.as_yaml(about, values, joints=joints)


def described(
    tuned: Sequence[Tuned], notes: Sequence[str] = (), period: float = math.tau, width: int = WIDTH
) -> list[str]:
    """Return the results as lines: gains, default and tuned errors, and what is used and why.

    Parameters
    ----------
    period : wrap period of the positions [rad]; 0: none. width : of the text [columns].
    """
    if all(each.judged_on for each in tuned):
        judged = 'the recordings of --judge'
    elif all(each.held_out for each in tuned):
        judged = 'held-out data'
    else:
        judged = 'the data of the search: nothing was held out'
    head = f'on {judged}, after {sum(each.evaluations for each in tuned)} trials [rad/s]'
    below = [f'{each.joint or "all joints"}: {text}' for each in tuned for text in _said(each)]
    if any(each.interrupted for each in tuned):
        below.append('interrupted: these are the best gains so far')
    rows = [row for each in tuned for row in _rows(each)]
    return [
        units(head, period),
        *table(TABLE_HEADER, rows, left=2, width=width).split('\n'),
        *(each for line in [*below, *notes] for each in wrapped(units(line, period), width)),
    ]


def _rows(each: Tuned) -> Iterator[list[str]]:
    """Yield the rows of the table: defaults and tuned gains, over all joints and by joint."""
    for label, result in (('defaults', each.default), ('tuned', each.best)):
        yield [each.joint or 'all joints', label, *_cells(result)]
        if result is not None and len(result['by_joint']) > 1:
            for joint, one in result['by_joint'].items():
                yield [f'  {joint}', '', *_cells(one)]


def _cells(result: Mapping[str, Any] | None) -> list[str]:
    if result is None:
        return ['-'] * 4
    return [
        number(result['error']),
        interval(result['delay_s'] * 1e3, result['delay_95_s'] * 1e3),
        number(result['noise'], 3),
        number(result['cost']),
    ]


def _said(each: Tuned) -> Iterator[str]:
    """Yield the gains, and how well-founded the choice between defaults and tuned gains is."""
    if each.tried:
        yield ', '.join(
            f'{name} {_written(each.default_gains[name])} -> {_written(value)}'
            for name, value in each.tried.items()
        )
    for name in each.idle:
        yield f"'{name}' has no effect in these bags and stays at its default"
    pair = each.pair
    if each.why:
        yield f'The defaults stay: {each.why}.'
    elif pair is None:
        yield 'The tuned gains are used: the defaults do not work here.'
    else:
        yield f'{Compared(**pair).text().capitalize()}.'
    if pair is not None and pair['events'] and not pair['sign']:
        parts = f'{pair["events"]} part{"s" * (pair["events"] > 1)}'
        yield f'Few events decide: half of the difference is in {parts} of the record.'
    if each.cautions and pair is not None and pair['resolution'] > 0.0:
        yield 'Judged without ground truth.'
    if each.against:
        yield f'{each.against}.'
    yield from (text[:1].upper() + text[1:] + '.' for text in each.cautions)


def _written(value: Any) -> str:
    """Return a gain as readable text."""
    if value is None:
        return 'automatic'
    return value if isinstance(value, str) else f'{value:.4g}'
