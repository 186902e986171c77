# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The output of `tune`: a table, and a commented YAML for the node."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from estimator_pkg import params_file, streams, yaml_text
from estimator_pkg.evaluation.text import WIDTH, for_node, interval, number, table, units, wrapped
from estimator_pkg.evaluation.tuning.settings import TuneSettings, single
from estimator_pkg.parameters import Parameter, declared
from estimator_pkg.yaml_text import scalar

TABLE_HEADER = ('joint', '', 'gains', 'error', 'delay ms', 'noise', 'cost')  # [rad/s]


def node_values(tuned: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the gains to use by parameter: ``<gain>`` or ``per_joint.<joint>.<gain>``.

    Where the defaults stay, these are the defaults of the gains that were searched.
    """
    found: dict[str, Any] = {}
    for each in tuned:
        prefix = f'{params_file.OVERRIDES}.{each["joint"]}.' if each['joint'] else ''
        gains = each['gains'] or {
            name: value for name, value in each['default_gains'].items() if value is not None
        }
        found.update({prefix + name: value for name, value in gains.items()})
    return found


def written_gains(each: Mapping[str, Any], quantum: bool = True) -> dict[str, dict[str, Any]]:
    """Return the parameters that the file sets, by joint; '': for all joints.

    Tuned gains as they are. Defaults with the quantum of the readings, if the observer has it.
    """
    if each['gains']:
        return {each['joint']: each['gains']}
    quanta = each['quanta'] if quantum else {}
    if quanta and (each['joint'] or len(set(quanta.values())) == 1):
        return {each['joint']: {'quantum': next(iter(quanta.values()))}}
    return {joint: {'quantum': value} for joint, value in quanta.items()}


def written(value: Any) -> str:
    """Return a gain as readable text."""
    if value is None:
        return '-'
    return value if isinstance(value, str) else f'{value:.4g}'


def as_yaml(
    tuning: TuneSettings,
    held: Mapping[str, Any],
    tuned: Sequence[Mapping[str, Any]],
    held_out: float,
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
    tuned_ = 'tuned from data' if any(each['gains'] for each in tuned) else 'its defaults'
    about = [
        f'Gains of {observer}: {tuned_} (preference: {tuning.preference}).',
        *for_node(stream.NODE, remaps),
    ]
    for each in tuned:
        about += _origin(each, held_out)
    period = held.get('wrap_period', math.tau)
    about = [units(line, period) for line in about]
    lines = [yaml_text.comment(each) for line in about for each in wrapped(line, WIDTH - 2)]
    lines += ['/**:', '  ros__parameters:']
    if 'observer' in declared(stream.SETTINGS):
        lines.append(f'    observer: {scalar(observer)}')
    known = streams.parameters(observer, held)
    lines += [
        f'    {yaml_text.key(name)}: {known[params_file.parameter_of(name)].text(value)}'
        for name, value in held.items()
    ]
    quantum = 'quantum' in tuning.gains and 'quantum' not in held
    for each in tuned:
        for joint, gains in written_gains(each, quantum).items():
            indent = '    '
            if joint:
                lines.append(f'    {yaml_text.key(params_file.OVERRIDES + "." + joint)}:')
                indent = '      '
            lines += [
                f'{indent}{name}: {scalar(value)}{units(_about(tuning.gains[name]), period)}'
                for name, value in gains.items()
            ]
    if lines[-1] == '  ros__parameters:':
        lines[-1] += ' {}'
    return '\n'.join(lines) + '\n'


def _table(rows: Sequence[Sequence[str]]) -> str:
    """Return the rows as a table; gains that do not fit it have lines of their own below."""
    whole = table(TABLE_HEADER, rows, left=3)
    if max(map(len, whole.split('\n'))) <= WIDTH:
        return whole
    gains = TABLE_HEADER.index('gains')
    narrow = [[*row[:gains], *row[gains + 1 :]] for row in [TABLE_HEADER, *rows]]
    below = [f'{row[0]}, {row[1]}: {row[gains]}' for row in rows if row[gains]]
    lines = [each for line in below for each in wrapped(line)]
    return '\n'.join([table(narrow[0], narrow[1:], left=2, width=WIDTH), *lines])


def _about(gain: Parameter) -> str:
    unit = f'[{gain.unit}] ' if gain.unit else ''
    default = single(gain.default)
    text = (
        f'{gain.text(None)} (automatic)'
        if default is None
        else (default if isinstance(default, str) else f'{default:g}')
    )
    return f'  {yaml_text.comment(f"{unit}the default is {text}")}'


def _origin(each: Mapping[str, Any], held_out: float) -> list[str]:
    of = f'Joint {each["joint"]}' if each['joint'] else f'Joints {", ".join(each["joints"])}'
    lines = [f'{of}, from', *(f'  {bag}' for bag in each['bags'])]
    if not each['tried']:
        return [*lines, f'The defaults: {each["why"]}.']
    if each['judged_on']:
        where = 'recordings that the search did not use'
    elif each['held_out']:
        where = f'the last {held_out:.0%} of each record, which the search did not use'
    else:
        where = 'the data of the search'
    lines.append(
        f'{each["evaluations"]} trials'
        + (', interrupted' if each['interrupted'] else '')
        + f'. On {where}:'
    )
    lines += [f'  {bag}' for bag in each['judged_on']]
    for label, result in (('the tuned gains', each['best']), ('the defaults', each['default'])):
        if result is None:
            lines.append(f'  {label}: do not work on it')
            continue
        lines.append(f'  {label}: {_expected(result)}')
        if len(result['by_joint']) > 1:
            lines += [f'    {joint}: {_expected(one)}' for joint, one in result['by_joint'].items()]
    lines += [
        f"'{name}' has no effect in these bags and stays at its default." for name in each['idle']
    ]
    return lines + founded(each)


def founded(each: Mapping[str, Any]) -> list[str]:
    """Return how well-founded the choice between defaults and tuned gains is, as sentences."""
    pair = each['pair']
    if each['why']:
        found = [f'The defaults stay: {each["why"]}.']
    elif pair is None:
        found = ['The tuned gains are used: the defaults do not work here.']
    else:
        smaller = number(100.0 - 100.0 / (1.0 + pair['difference'] / 100.0), 2)
        found = [
            'The tuned gains are better than the defaults (95 %): their error is smaller by '
            f'{smaller} %.'
            if pair['sign']
            else f'The tuned gains are used: their error is smaller by {smaller} %, which is not '
            'significant.'
        ]
    if pair is not None and pair['events'] and not pair['sign']:
        parts = f'{pair["events"]} part{"s" * (pair["events"] > 1)}'
        found.append(f'Few events decide: half of the difference is in {parts} of the record.')
    if each['cautions'] and pair is not None and pair['resolution'] > 0.0:
        found.append('Judged without ground truth.')
    if each.get('against'):
        found.append(f'{each["against"]}.')
    return found + [text[:1].upper() + text[1:] + '.' for text in each['cautions']]


def _expected(result: Mapping[str, Any]) -> str:
    return (
        f'error {number(result["error"])} rad/s rms, delay {_late(result)} ms, '
        f'noise {number(result["noise"], 3)} rad/s'
    )


def _late(result: Mapping[str, Any]) -> str:
    return interval(result['delay_s'] * 1e3, result['delay_95_s'] * 1e3)


def describe(
    tuned: Sequence[Mapping[str, Any]], notes: Sequence[str] = (), period: float = math.tau
) -> str:
    """Return the results as text: gains, default and tuned errors, on held-out data.

    Parameters
    ----------
    period : wrap period of the positions [rad]; 0: none.
    """
    rows = []
    for each in tuned:
        for label, gains, result in (
            ('defaults', each['default_gains'], each['default']),
            ('tuned', each['tried'], each['best']),
        ):
            text = ', '.join(f'{name} {written(value)}' for name, value in gains.items())
            cells = (
                ['-'] * 4
                if result is None
                else [
                    number(result['error'], 4),
                    _late(result),
                    number(result['noise'], 3),
                    number(result['cost'], 4),
                ]
            )
            rows.append((each['joint'] or 'all joints', label, text, *cells))
    if all(each['judged_on'] for each in tuned):
        judged = 'the recordings of --judge'
    elif all(each['held_out'] for each in tuned):
        judged = 'held-out data'
    else:
        judged = 'the data of the search: nothing was held out'
    head = f'on {judged}, after {sum(each["evaluations"] for each in tuned)} trials [rad/s]'
    lines: list[str] = []
    for each in tuned:
        of = each['joint'] or 'all joints'
        lines += [
            f"{of}: '{name}' has no effect in these bags and stays at its default"
            for name in each['idle']
        ]
        lines += [f'{of}: {text}' for text in founded(each)]
    if any(each['interrupted'] for each in tuned):
        lines.append('interrupted: these are the best gains so far')
    below = [each for line in [*lines, *notes] for each in wrapped(units(line, period))]
    return '\n'.join([units(head, period), _table(rows), *below])
