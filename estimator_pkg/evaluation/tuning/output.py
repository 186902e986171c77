"""What `tune` says and leaves behind: a table, and a YAML with comments for the node."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from estimator_pkg import params_file, streams, yaml_text
from estimator_pkg.evaluation.text import number, table
from estimator_pkg.evaluation.tuning.bar import written
from estimator_pkg.evaluation.tuning.wishes import Wishes, single
from estimator_pkg.parameters import Parameter, declared
from estimator_pkg.printable import printable
from estimator_pkg.yaml_text import scalar

WORSE = 'on what was held out these gains are no better than the defaults: keep the defaults'
HEADER = ('joint', '', 'gains', 'error rad/s', 'delay ms', 'noise rad/s', 'cost')


def worse(each: Mapping[str, Any]) -> bool:
    """True if the gains found do worse than the defaults where the search did not look."""
    best, default = each['best'], each['default']
    return default is not None and (best is None or best['cost'] > default['cost'])


def node_values(tuned: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The gains by the node's parameter names: common ones, and ``per_joint.<joint>.<gain>``."""
    found: dict[str, Any] = {}
    for each in tuned:
        prefix = f'{params_file.OVERRIDES}.{each["joint"]}.' if each['joint'] else ''
        found.update({prefix + name: rounded(value) for name, value in each['gains'].items()})
    return found


def rounded(value: Any) -> Any:
    """A gain with the digits that it deserves."""
    return value if isinstance(value, str) else float(f'{value:.6g}')


def as_yaml(
    wishes: Wishes, held: Mapping[str, Any], tuned: Sequence[Mapping[str, Any]], held_out: float
) -> str:
    """A parameter file for the observer's node, which says where its numbers come from.

    Parameters
    ----------
    held : parameters that were held, and hold for the node too.
    tuned : results of `seek.seek`; one without a joint holds for all of them.
    """
    observer = wishes.entry.observer
    stream = streams.of_observer(observer)
    about = [
        f'Gains of {observer}, tuned from data (preference: {wishes.preference}).',
        f'For the node {stream.NODE}: --ros-args --params-file THIS_FILE',
    ]
    for each in tuned:
        about += _origin(each, held_out)
    lines = [yaml_text.comment(line) for line in about]
    lines += ['/**:', '  ros__parameters:']
    if 'observer' in declared(stream.SETTINGS):
        lines.append(f'    observer: {scalar(observer)}')
    known = {**stream.parameters(observer), **declared(stream.SETTINGS)}
    lines += [
        f'    {yaml_text.key(name)}: {known[params_file.parameter_of(name)].text(value)}'
        for name, value in held.items()
    ]
    for each in tuned:
        indent = '    '
        if each['joint']:
            lines.append(f'    {yaml_text.key(params_file.OVERRIDES + "." + each["joint"])}:')
            indent = '      '
        lines += [
            f'{indent}{name}: {scalar(rounded(value))}{_about(wishes.gains[name])}'
            for name, value in each['gains'].items()
        ]
    return '\n'.join(lines) + '\n'


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
    if each['judged_on']:
        where = 'recordings that the search did not see'
    elif each['held_out']:
        where = f'the last {held_out:.0%} of each record, which the search did not see'
    else:
        where = 'the data they were tuned on'
    lines.append(
        f'{each["evaluations"]} trials'
        + (', interrupted' if each['interrupted'] else '')
        + f'. On {where}:'
    )
    lines += [f'  {bag}' for bag in each['judged_on']]
    for label, result in (('these gains', each['best']), ('the defaults', each['default'])):
        if result is None:
            lines.append(f'  {label}: cannot work on it')
            continue
        lines.append(f'  {label}: {_expected(result)}')
        if len(result['by_joint']) > 1:
            lines += [f'    {joint}: {_expected(one)}' for joint, one in result['by_joint'].items()]
    lines += [
        f"'{name}' changes nothing in these bags and is left at its default."
        for name in each['idle']
    ]
    if worse(each):
        lines.append(f'{WORSE[0].upper()}{WORSE[1:]}.')
    return lines


def _expected(result: Mapping[str, Any]) -> str:
    return (
        f'error {number(result["error"])} rad/s rms, delay '
        f'{number(result["delay_s"] * 1e3, 3)} ms, noise {number(result["noise"], 3)} rad/s'
    )


def describe(tuned: Sequence[Mapping[str, Any]], notes: Sequence[str] = ()) -> str:
    """What was found, before and after, on what was held out."""
    rows = []
    for each in tuned:
        for label, gains, result in (
            ('defaults', each['default_gains'], each['default']),
            ('tuned', each['gains'], each['best']),
        ):
            text = ', '.join(f'{name} {written(value)}' for name, value in gains.items())
            cells = (
                ['-'] * 4
                if result is None
                else [
                    number(result['error'], 4),
                    number(result['delay_s'] * 1e3, 3),
                    number(result['noise'], 3),
                    number(result['cost'], 4),
                ]
            )
            rows.append((each['joint'] or 'all joints', label, text, *cells))
    if all(each['judged_on'] for each in tuned):
        judged = 'the recordings named with --judge'
    elif all(each['held_out'] for each in tuned):
        judged = 'the part held out'
    else:
        judged = 'the part that was tuned on: nothing was held out'
    lines = [
        f'on {judged}, after {sum(each["evaluations"] for each in tuned)} trials',
        *table(HEADER, rows, left=3).split('\n'),
    ]
    for each in tuned:
        of = each['joint'] or 'all joints'
        lines += [
            f"{of}: '{name}' changes nothing in these bags and is left at its default"
            for name in each['idle']
        ]
        if worse(each):
            lines.append(f'{of}: {WORSE}')
    if any(each['interrupted'] for each in tuned):
        lines.append('interrupted: these are the best gains so far')
    return '\n'.join(map(printable, [*lines, *notes]))
