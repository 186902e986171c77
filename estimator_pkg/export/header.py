# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A tuned observer as one header, C99 and C++17: guard, sensor stage, observer, calibration."""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from estimator_pkg import __version__
from estimator_pkg.driver.drive import DriveJoint
from estimator_pkg.driver.joint import Joint
from estimator_pkg.engine.entries import path_of
from estimator_pkg.engine.prelude import MATH, TAKEN, TESTS
from estimator_pkg.engine.sources import RefusedError
from estimator_pkg.engine.translate import Entry, Translator
from estimator_pkg.errors import UsageError
from estimator_pkg.export import template
from estimator_pkg.export.angle import Options
from estimator_pkg.parameters import declared

LEAST, MOST = 1.1754944e-38, 3.4028235e38  # normal floats
ROOT = Path(__file__).resolve().parents[2]
FAMILIES = {  # what the header of an observer of each kind has
    'angle': 'estimator_pkg.export.angle',
    'drive': 'estimator_pkg.export.drive',
}
OWN = 'they name a function or a class of your own, and only functions of modules are translated'
TITLES = {
    'angle': 'velocity of one joint from its angle',
    'drive': 'speed and angle of a motor from its currents and voltages',
}
SIZES = 'a header is for observers of one angle and of drives'


@dataclass(frozen=True)
class Exported:
    """A header and what belongs to it.

    prefix : of all names in it. header : the text. joint : the driver's joint with these gains.
    """

    prefix: str
    header: str
    joint: Any
    float32: bool


def exported(
    observer: Any,
    gains: Any,
    settings: Any,
    prefix: str,
    float32: bool = False,
    sample_period: float = 0.0,
) -> Exported:
    """Return an observer with its gains as a header.

    Parameters
    ----------
    observer : `observers.contract.Observer`. gains, settings : of `Configuration.for_joint`.
    prefix : a C identifier, with which all names in the header begin.
    float32 : compute in float instead of double.
    sample_period : of a drive [s]; 0: not known.

    Raises
    ------
    UsageError : the observer cannot be exported; the message has the reason.
    """
    if not re.fullmatch(r'[a-z][a-z0-9_]*', prefix) or prefix in TAKEN:
        raise UsageError(f"'{prefix}' is no name for C: use lower-case letters, digits and _")
    joint = _joint(observer, gains, settings, sample_period)
    if joint.module.runs_plain(joint.gains):
        raise UsageError(f"'{observer.name}' cannot be exported with these gains: {OWN}")
    family = FAMILIES[observer.kind]
    channel, records = joint.channel, [Options()]
    if observer.kind == 'angle':
        records[0].turns = joint._counts_turns
        frames = [channel.wrapped, channel.counted if joint._counts_turns else channel.wrapped]
        for frame in frames:
            limits = type(channel.limits)()
            limits.take(channel.limits)
            limits.longest_dt, limits.period = frame.longest_dt, frame.period
            records += [frame, limits]
        bound = {
            'init': {'wrapped': frames[0]},
            'update': dict(zip(('wrapped', 'counted'), frames)),
            'get': {},
        }
    else:
        records += [channel.design, channel.limits]
        bound = {'init': {'tuned': channel.design}, 'update': {}, 'get': {}}
    known, used = _known(records), None
    static = {'observer': path_of(joint.module)}
    for _ in range(2):  # the second time with the fields alone that the first one found in use
        translator = Translator(ROOT, prefix, known, used, [_root(joint.module.__module__)])
        translator.names = {(family, 'State'): prefix, (family, 'Estimate'): f'{prefix}_estimate'}
        try:
            for name, values in bound.items():
                translator.export(Entry(family, name, static, f'{prefix}_{name}', values))
        except RefusedError as error:
            raise UsageError(
                f"'{observer.name}' cannot be exported: {error}: see docs/engine.md"
            ) from error
        used = translator.reached
    body = translator.body()
    values = {
        'TITLE': f'{prefix}: {TITLES[observer.kind]}, by the observer {observer.name}.',
        'ABOUT': '\n'.join(f' * {line}'.rstrip() for line in _about(observer, gains, settings)),
        'GUARD': f'{prefix.upper()}_H',
        'BODY': single(body) if float32 else body,
    }
    return Exported(prefix, template('observer.h', values), joint, float32)


def _joint(observer: Any, gains: Any, settings: Any, sample_period: float) -> Any:
    """Return the driver's joint or drive."""
    if observer.kind == 'drive':
        return DriveJoint(observer, gains, settings, sample_period=sample_period)
    if observer.kind == 'angle':
        return Joint(observer, gains, settings)
    raise UsageError(f"'{observer.name}' cannot be exported: {SIZES}")


def _root(name: str) -> Path:
    """Return the folder of the package that has this module."""
    path = Path(str(sys.modules[name].__file__)).resolve()
    return path.parents[name.count('.') + (path.stem == '__init__')]


def _known(records: list[Any]) -> dict[tuple[str, str], dict[str, Any]]:
    """Return the numbers that all records of a class have in common, by module and class."""
    found: dict[tuple[str, str], dict[str, list[Any]]] = {}
    for each in records:
        for key, name, value in _numbers(each):
            found.setdefault(key, {}).setdefault(name, []).append(value)
    return {
        key: {name: values[0] for name, values in fields.items() if len(set(map(repr, values))) < 2}
        for key, fields in found.items()
    }


def _numbers(record: Any) -> Iterator[tuple[tuple[str, str], str, Any]]:
    """Yield module and class, field, and value of each number in a record."""
    kind: Any = type(record)
    for name in kind.fields:
        value = getattr(record, name)
        if hasattr(type(value), 'fields'):
            yield from _numbers(value)
        elif type(value) in (bool, int, float):
            yield (kind.__module__, kind.__name__.partition('.')[0]), name, value


def _about(observer: Any, gains: Any, settings: Any) -> list[str]:
    """Return what a reader needs to know first, and the gains."""
    lines = [
        f'Written by velocity_estimator {__version__} export; other gains mean another export.',
        '',
        observer.summary,
        f'Reference: {observer.reference}',
        '',
        'Compile with -ffp-contract=off to get the numbers of the package to the last bit.',
        '',
        'Gains and settings:',
    ]
    for values in (gains, settings):
        for name, parameter in declared(type(values)).items():
            unit = f' [{parameter.unit}]' if parameter.unit else ''
            text = f'{name} = {parameter.text(getattr(values, name))}{unit}'
            lines.append(f'  {text}')
    wrapped = (textwrap.wrap(line, 96, subsequent_indent='    ') or [''] for line in lines)
    return [part for parts in wrapped for part in parts]


NUMBER = re.compile(r'(?<![\w.])(\d+\.\d*(?:e[+-]?\d+)?|\d+e[+-]?\d+)(?![\w.])')
FUNCTION = re.compile(rf'\b({"|".join((*MATH, "rint", "hypot", "ldexp"))})\(')


def single(body: str) -> str:
    """Return C text that computes in float."""
    made, block = [], False
    for line in body.splitlines():
        code, mark, note = line.partition('//')
        block = block or line.startswith('/*')
        if not block:
            code = NUMBER.sub(lambda i: _float(i[1]), code)
            code = FUNCTION.sub(lambda i: f'{i[1]}{"f" * (i[1] not in TESTS)}(', code)
            code = re.sub(r'\bdouble\b', 'float', code)
        if line.rstrip().endswith('*/'):
            block = False
        made.append(code + mark + note)
    return '\n'.join(made)


def _float(text: str) -> str:
    """Return the text of a positive double as a float, which is neither 0 nor infinite."""
    return f'{min(max(float(text), LEAST), MOST) if float(text) else 0.0!r}f'
