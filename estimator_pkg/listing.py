# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator list``: observers, models, simulators, commands, and all parameters.

With a name it describes each parameter, and for an observer of mechanisms the effect of the gains:
poles, limits, noise.
"""

from __future__ import annotations

import argparse
import shutil
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from estimator_pkg import observers, registry
from estimator_pkg.circle import Circle
from estimator_pkg.cli import Command, add_set
from estimator_pkg.engine.calls import why_plain
from estimator_pkg.errors import UsageError, UserError, suggestion
from estimator_pkg.observers.mechanism.gains import MEANINGS, in_words
from estimator_pkg.observers.mechanism.parameters import MechanicalGains
from estimator_pkg.parameters import Parameter, build, declared, parse_assignments
from estimator_pkg.printable import printable

WIDTH = 80  # columns


def meanings(name: str, values: Mapping[str, Any], rate: float) -> dict[str, dict[str, str]]:
    """Return the effect of the gains by model: for the model that is set, else each built-in one.

    Empty if `name` is not an observer of mechanisms.

    Parameters
    ----------
    name : name of the observer.
    values : parameters that differ from their defaults.
    rate : samples per second.

    Raises
    ------
    UsageError, UserError : values that cannot be used, or that this observer does not have.
    """
    if not rate > 0.0:
        raise UsageError(f'--rate is {rate:g} Hz: it must be above 0')
    record = observers.find(name) if name in registry.names(registry.OBSERVERS) else None
    if record is None or not issubclass(record.gains, MechanicalGains):
        if values:
            raise UsageError(
                f"'--set' is for observers of mechanisms, and '{name}' is not one: omit it"
            )
        return {}
    models = [str(values['model'])] if 'model' in values else registry.names(registry.MODELS)
    found: dict[str, dict[str, str]] = {}
    for model in models:
        gains: Any = build(record.gains, {**values, 'model': model}, owner=name)
        try:
            plan = record.plan(gains, Circle())
        except UserError as error:
            if len(models) == 1:
                raise
            found[model] = {'refused': str(error)}
            continue
        words = in_words(plan.describe(1.0 / rate))
        why = plan.limits(1.0 / rate)
        found[model] = {**words, **({'refused': why} if why else {})}
    return found


def as_text(found: Mapping[str, Mapping[str, str]], rate: float) -> str:
    """Return `meanings` as text."""
    lines = [f'  effect of the gains at {rate:g} Hz (--rate, --set NAME=VALUE for others):']
    for model, words in found.items():
        lines.append(f'    {model}')
        for name, text in words.items():
            lines += _wrapped(f'{MEANINGS.get(name, name)}: {text}', WIDTH, 6, 8)
    return '\n'.join(lines)


def _wrapped(text: str, width: int, first: int, others: int) -> list[str]:
    """Return the text in lines, indented by `first` and by `others` columns."""
    return textwrap.wrap(
        printable(text),
        width,
        initial_indent=' ' * first,
        subsequent_indent=' ' * others,
        break_on_hyphens=False,
    )


TYPE_NAMES = {
    float: 'float',
    int: 'int',
    bool: 'bool',
    str: 'text',
    tuple: 'list of text',
    list: 'list of float',
}


@dataclass(frozen=True)
class Item:
    """An observer, model, node, simulator or command of the catalogue."""

    name: str
    summary: str
    reference: str = ''
    parameters: tuple[Parameter, ...] = ()
    live: bool = True  # served by a node whose parameters may change while it runs
    plain: str = ''  # why it runs as plain Python

    def as_dict(self) -> dict[str, Any]:
        """Return the item for ``--json``."""
        return {
            'summary': self.summary,
            'reference': self.reference,
            'parameters': {
                p.name: {
                    'type': TYPE_NAMES[p.kind],
                    'default': p.default,
                    'automatic': p.text(None) if p.automatic is not None else None,
                    'unit': p.unit,
                    'minimum': p.minimum,
                    'maximum': p.maximum,
                    'choices': list(p.choices),
                    'description': p.description,
                    'equation': p.equation,
                    'live': not p.structural,
                    'advanced': p.advanced,
                }
                for p in self.parameters
            },
        }


def catalogue() -> dict[str, list[Item]]:
    """Return all items by kind; an item that cannot be imported has the error as its summary."""
    streams, simulators = _records(registry.STREAMS), _records(registry.SIMULATORS)
    return {
        'observers': _items(_records(registry.OBSERVERS), 'gains'),
        'settings of each joint': _settings(streams, 'PER_JOINT'),
        'settings of each source': _settings(streams, 'PER_SOURCE', live=False),
        'nodes': [
            Item(name, f'({stream})')
            if isinstance(stream, UserError)
            else _declared(stream.NODE, stream.SETTINGS)
            for name, stream in streams.items()
        ],
        'models': _items(_records(registry.MODELS), 'parameters'),
        'simulators': _items(simulators, 'parameters', live=False),
        'settings of each simulator': _settings(simulators, 'SETTINGS', live=False),
        'commands': _items(_records(registry.COMMANDS), ''),
    }


def _records(group: str) -> dict[str, Any]:
    """Return the objects of a group by name; for what cannot be imported, the error."""
    found: dict[str, Any] = {}
    for name in registry.names(group):
        try:
            found[name] = registry.find(group, name)
        except UserError as error:
            found[name] = error
    return found


def _items(records: Mapping[str, Any], declaring: str, live: bool = True) -> list[Item]:
    """Return the items of a group; `declaring` is the attribute with the dataclass."""
    items = []
    for name, record in records.items():
        summary = getattr(record, 'summary', f'({record})')
        cls = getattr(record, declaring, None)
        parameters = tuple(declared(cls).values()) if cls is not None else ()
        plain = why_plain(record) if observers.is_observer(record) else ''
        reference = getattr(record, 'reference', '')
        items.append(Item(name, summary, reference, parameters, live, plain))
    return items


def _settings(records: Mapping[str, Any], attribute: str, live: bool = True) -> list[Item]:
    """Return the classes of settings that these objects name, each once."""
    named = (getattr(record, attribute, None) for record in records.values())
    return [_declared(settings_name(cls), cls, live) for cls in dict.fromkeys(named) if cls]


def settings_name(cls: type) -> str:
    """Return the name of a class of settings in the catalogue."""
    return cls.__name__.removesuffix('Settings').lower()


def _declared(name: str, cls: type, live: bool = True) -> Item:
    """Return the parameters of a class of settings, summarised by its docstring's first line."""
    summary = (cls.__doc__ or '').strip().partition('\n')[0].rstrip('.')
    parameters = tuple(declared(cls).values())
    return Item(name, summary[:1].lower() + summary[1:], parameters=parameters, live=live)


def default_text(parameter: Parameter) -> str:
    """Return the default as text."""
    value = parameter.default
    if parameter.automatic is not None:
        return f'{parameter.automatic_text} ({parameter.text(value)})'
    if value is None:
        return 'required'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f'{value:g}'
    return f'[{", ".join(map(str, value))}]' if isinstance(value, (tuple, list)) else str(value)


def _with_unit(parameter: Parameter) -> str:
    unit = f'[{parameter.unit}]' if parameter.default is None else parameter.unit
    return f'{default_text(parameter)} {unit}' if parameter.unit else default_text(parameter)


def meaning(parameter: Parameter, live: bool) -> str:
    """Return description, equation, and (for a live node) whether it can change during a run."""
    text = parameter.description
    if parameter.equation:
        text += f'; {parameter.equation}'
    if live and parameter.structural:
        text += ' (at start only)'
    return text


def describe(item: Item, width: int) -> str:
    """Return the item as text of `width` columns."""
    lines = _wrapped(f'{item.name}: {item.summary}', width, 0, 2)
    if item.reference:
        lines += _wrapped(f'from: {item.reference}', width, 2, 4)
    if item.plain:
        lines += _wrapped(f'runs as plain Python: {item.plain}', width, 2, 4)
    for p in item.parameters:
        lines += _wrapped(f'{p.name} = {_with_unit(p)}, {p.range_text()}', width, 2, 4)
        lines += _wrapped(meaning(p, item.live), width, 6, 6)
    return '\n'.join(lines)


def line(item: Item, width: int) -> str:
    """Return the item in one line: its name, and what it is as far as the line reaches."""
    text = printable(item.summary)
    lead = f'  {item.name:<17} '
    return lead + textwrap.shorten(text, width - len(lead), placeholder=' ...')


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        'name',
        nargs='?',
        help='a kind, such as observers or simulators, or one item, described with its parameters',
    )
    add_set(parser, 'for an observer of mechanisms: show the effect of these gains')
    parser.add_argument(
        '--rate',
        metavar='HZ',
        type=float,
        default=1000.0,
        help='sample rate for the effect of the gains [Hz] (default 1000)',
    )


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Print the catalogue, or the requested item; return it."""
    kinds = catalogue()
    if parsed.name is not None:
        kinds = _only(kinds, parsed.name)
    result: dict[str, Any] = {
        kind: {item.name: item.as_dict() for item in items} for kind, items in kinds.items()
    }
    values = parse_assignments(parsed.set)
    named = parsed.name is not None and parsed.name not in kinds
    if values and not named:
        raise UsageError('--set needs an observer: name it')
    gains = meanings(parsed.name, values, parsed.rate) if named else {}
    _print(kinds, describe if named else line)
    if not named:
        print("'list NAME' describes one with each parameter, 'list observers' a kind")
    if gains:
        print(as_text(gains, parsed.rate))
    return {**result, 'gains': gains} if gains else result


def _only(kinds: dict[str, list[Item]], name: str) -> dict[str, list[Item]]:
    if name in kinds:
        return {name: kinds[name]}
    chosen = {kind: [item for item in items if item.name == name] for kind, items in kinds.items()}
    chosen = {kind: items for kind, items in chosen.items() if items}
    if not chosen:
        known = {item.name for items in kinds.values() for item in items} | set(kinds)
        raise UsageError(f"unknown name '{name}': {suggestion(name, known)}")
    return chosen


def _print(kinds: dict[str, list[Item]], show: Callable[[Item, int], str]) -> None:
    width = max(40, min(WIDTH, shutil.get_terminal_size((WIDTH, 24)).columns))
    separator = '\n\n' if show is describe else '\n'
    for kind, items in kinds.items():
        print(kind.upper())
        print(separator.join(show(item, width) for item in items) or '  none')


COMMAND = Command(
    'list observers, models, simulators and commands; describe one',
    arguments,
    run,
    examples=(
        ('observers', 'the observers alone'),
        ('kalman', 'one of them, with each parameter'),
        ('smo --set mu=[29,10] --rate 500', 'the effect of these gains at 500 Hz'),
    ),
)
