# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The output of `tune`: a table and sentences, also as comments in a YAML for the node."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from estimator_pkg import params_file, streams, yaml_text
from estimator_pkg.evaluation.text import WIDTH, for_node, interval, number, table, units, wrapped
from estimator_pkg.evaluation.tuning.objective import Compared
from estimator_pkg.evaluation.tuning.settings import TuneSettings
from estimator_pkg.parameters import declared

if TYPE_CHECKING:
    from estimator_pkg.evaluation.tuning.seek import Tuned

TABLE_HEADER = ('joint', '', 'gains', 'error', 'delay ms', 'noise', 'cost')  # [rad/s]


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


def written_gains(each: Tuned, quantum: bool = True) -> dict[str, dict[str, Any]]:
    """Return the parameters that the file sets, by joint; '': for all joints.

    Tuned gains as they are. Defaults with the quantum of the readings, if the observer has it.
    """
    if each.gains:
        return {each.joint: dict(each.gains)}
    quanta = each.quanta if quantum else {}
    if quanta and (each.joint or len(set(quanta.values())) == 1):
        return {each.joint: {'quantum': next(iter(quanta.values()))}}
    return {joint: {'quantum': value} for joint, value in quanta.items()}


def written(value: Any) -> str:
    """Return a gain as readable text."""
    if value is None:
        return '-'
    return value if isinstance(value, str) else f'{value:.4g}'


def as_yaml(
    tuning: TuneSettings,
    held: Mapping[str, Any],
    tuned: Sequence[Tuned],
    remaps: Sequence[str] = (),
) -> str:
    """Return a parameter file for the observer's node, with comments on the tuning.

    Parameters
    ----------
    held : fixed parameters, which the node needs too.
    tuned : results of `seek.seek`; one without a joint applies to all of them.
    remaps : of the node's topics.
    """
    observer = tuning.entry.observer
    stream = streams.of_observer(observer)
    period = held.get('wrap_period', math.tau)
    tuned_ = 'tuned from data' if any(each.gains for each in tuned) else 'its defaults'
    about = [
        f'Gains of {observer}: {tuned_} (preference: {tuning.preference}).',
        *for_node(stream.NODE, remaps),
    ]
    for each in tuned:
        of = f'Joint {each.joint}' if each.joint else f'Joints {", ".join(each.joints)}'
        about += [f'{of}, from', *(f'  {bag}' for bag in each.bags)]
        if each.judged_on:
            about += ['validated on', *(f'  {bag}' for bag in each.judged_on)]
    about += described(tuned, period=period, width=WIDTH - 2)
    lines = [yaml_text.comment(each) for line in about for each in wrapped(line, WIDTH - 2)]
    known = streams.parameters(observer, held)
    values: dict[str, Any] = {}
    if 'observer' in declared(stream.SETTINGS):
        values['observer'] = observer
    for name, value in held.items():
        values[name] = known[params_file.parameter_of(name)].plain(value)
    quantum = 'quantum' in tuning.gains and 'quantum' not in held
    for each in tuned:
        for joint, gains in written_gains(each, quantum).items():
            values.update({f'{params_file.OVERRIDES}.{joint}': gains} if joint else gains)
    lines += ['/**:', '  ros__parameters:' if values else '  ros__parameters: {}']
    return '\n'.join([*lines, *_yaml_lines(values, '    ')]) + '\n'


def _yaml_lines(values: Mapping[str, Any], indent: str) -> Iterator[str]:
    for name, value in values.items():
        if isinstance(value, dict):
            yield f'{indent}{yaml_text.key(name)}:'
            yield from _yaml_lines(value, indent + '  ')
        else:
            yield f'{indent}{yaml_text.key(name)}: {yaml_text.scalar(value)}'


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
    below: list[str] = []
    for each in tuned:
        of = each.joint or 'all joints'
        below += [
            f"{of}: '{name}' has no effect in these bags and stays at its default"
            for name in each.idle
        ]
        below += [f'{of}: {text}' for text in founded(each)]
    if any(each.interrupted for each in tuned):
        below.append('interrupted: these are the best gains so far')
    rows = [row for each in tuned for row in _rows(each)]
    return [
        units(head, period),
        *table_lines(rows, width),
        *(each for line in [*below, *notes] for each in wrapped(units(line, period), width)),
    ]


def _rows(each: Tuned) -> Iterator[list[str]]:
    """Yield the rows of the table: defaults and tuned gains, over all joints and by joint."""
    name = each.joint or 'all joints'
    for label, gains, result in (
        ('defaults', each.default_gains, each.default),
        ('tuned', each.tried, each.best),
    ):
        text = ', '.join(f'{name} {written(value)}' for name, value in gains.items())
        yield [name, label, text, *(['-'] * 4 if result is None else _cells(result))]
        if result is not None and len(result['by_joint']) > 1:
            for joint, one in result['by_joint'].items():
                yield [f'  {joint}', '', '', *_cells(one)]


def _cells(result: Mapping[str, Any]) -> list[str]:
    return [
        number(result['error']),
        interval(result['delay_s'] * 1e3, result['delay_95_s'] * 1e3),
        number(result['noise'], 3),
        number(result['cost']),
    ]


def table_lines(rows: Sequence[Sequence[str]], width: int = WIDTH) -> list[str]:
    """Return the rows as a table; gains that do not fit it have lines of their own below."""
    whole = table(TABLE_HEADER, rows, left=3).split('\n')
    if max(map(len, whole)) <= width:
        return whole
    gains = TABLE_HEADER.index('gains')
    narrow = [[*row[:gains], *row[gains + 1 :]] for row in [TABLE_HEADER, *rows]]
    below = [f'{row[0]}, {row[1]}: {row[gains]}' for row in rows if row[gains]]
    return [
        *table(narrow[0], narrow[1:], left=2, width=width).split('\n'),
        *(each for line in below for each in wrapped(line, width)),
    ]


def founded(each: Tuned) -> list[str]:
    """Return how well-founded the choice between defaults and tuned gains is, as sentences."""
    pair = each.pair
    if each.why:
        found = [f'The defaults stay: {each.why}.']
    elif pair is None:
        found = ['The tuned gains are used: the defaults do not work here.']
    else:
        found = [f'{Compared(**pair).text().capitalize()}.']
    if pair is not None and pair['events'] and not pair['sign']:
        parts = f'{pair["events"]} part{"s" * (pair["events"] > 1)}'
        found.append(f'Few events decide: half of the difference is in {parts} of the record.')
    if each.cautions and pair is not None and pair['resolution'] > 0.0:
        found.append('Judged without ground truth.')
    if each.against:
        found.append(f'{each.against}.')
    return found + [text[:1].upper() + text[1:] + '.' for text in each.cautions]
