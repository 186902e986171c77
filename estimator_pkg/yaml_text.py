# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Read YAML as ROS does, and write YAML that every reader understands in the same way.

ROS parses parameter files with its own rules: y, n, on and off are booleans, 017 is 15, and 1:30,
1_000 and 2026-01-01 are texts. Values read here are the same as in a node.
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Callable
from typing import Any

import yaml

from estimator_pkg.printable import printable

_TAG = 'tag:yaml.org,2002:'
TRUE = frozenset(
    form for word in ('y', 'yes', 'true', 'on') for form in (word, word.capitalize(), word.upper())
)
FALSE = frozenset(
    form for word in ('n', 'no', 'false', 'off') for form in (word, word.capitalize(), word.upper())
)
NULL = frozenset(('', '~', 'null', 'Null', 'NULL'))
_WHOLE = re.compile(r'[-+]?(0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)')
_NUMBER = re.compile(
    r'[-+]?((\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|'
    r'\.?inf|\.?Inf|\.?INF|infinity)|\.?nan|\.?NaN|\.?NAN'
)


class Word(str):
    """A word on the command line that YAML reads as a boolean, as in ``--set adapt=off``."""

    @property
    def truth(self) -> bool:
        """The word as a boolean."""
        return self in TRUE


def is_text(word: str) -> bool:
    """Return True if `word` without quotes is a text, in ROS and in YAML 1.1."""
    return (
        yaml.SafeLoader('').resolve(yaml.ScalarNode, word, (True, False)) == f'{_TAG}str'
        and _tag(word) == f'{_TAG}str'
    )


def _tag(word: str) -> str:
    """Return the tag of an unquoted word."""
    if word in NULL:
        return f'{_TAG}null'
    if word in TRUE or word in FALSE:
        return f'{_TAG}bool'
    if _WHOLE.fullmatch(word):
        return f'{_TAG}int'
    return f'{_TAG}float' if _NUMBER.fullmatch(word) else f'{_TAG}str'


class Loader(yaml.SafeLoader):
    """YAML as ROS reads it; a repeated key is an error."""

    def resolve(self, kind: Any, value: Any, implicit: Any) -> str:
        """Return the tag of a node, by the rules of ROS for unquoted words."""
        if kind is yaml.ScalarNode and implicit[0] and value != '<<':
            return _tag(value)
        return super().resolve(kind, value, implicit)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        """Return the mapping; raise ConstructorError if a key occurs twice."""
        seen = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.tag != f'{_TAG}merge':
                if key.value in seen:
                    raise yaml.constructor.ConstructorError(
                        None, None, f"key '{key.value}' occurs twice", key.start_mark
                    )
                seen.add(key.value)
                key.tag = f'{_TAG}str'  # as in ROS, a key y is not a boolean
        return super().construct_mapping(node, deep)


def _whole(text: str) -> int:
    digits = text.lstrip('+-')
    base = 16 if digits[:2] in ('0x', '0X') else 8 if digits[0] == '0' else 10
    return -int(digits, base) if text[0] == '-' else int(digits, base)


def _number(text: str) -> float:
    return float(text.lower().replace('.inf', 'inf').replace('.nan', 'nan'))


def _construct(loader: type[Loader], tag: str, made: Callable[[str], Any]) -> None:
    loader.add_constructor(f'{_TAG}{tag}', lambda _, node: made(node.value))


_construct(Loader, 'bool', TRUE.__contains__)
_construct(Loader, 'int', _whole)
_construct(Loader, 'float', _number)


def read(text: str) -> Any:
    """Return the value of the YAML `text`.

    Raises
    ------
    yaml.YAMLError : invalid YAML, or a type that is not a plain one.
    """
    try:
        return yaml.load(text, Loader=Loader)
    except (ValueError, TypeError, AttributeError, RecursionError) as error:  # of a wrong tag
        raise yaml.YAMLError(f'{type(error).__name__}: {error}') from error


def of_command_line(text: str) -> Any:
    """Return the value of ``--set key=text``: texts need no quotes.

    A word such as off becomes a `Word`; invalid YAML is a text.
    """
    try:
        return yaml.load(text, Loader=_Unquoted)
    except (yaml.YAMLError, ValueError, TypeError, AttributeError, RecursionError):
        return text


class _Unquoted(Loader):
    """YAML in which y, n, yes, no, on and off are texts, as in ``--set joints=[x,y]``."""


def _word(text: str) -> bool | Word:
    return text in TRUE if text.lower() in ('true', 'false') else Word(text)


_construct(_Unquoted, 'bool', _word)


class _Dumper(yaml.SafeDumper):
    """Writes every text in quotes, so that every reader reads a text."""

    def ignore_aliases(self, data: Any) -> bool:
        """Return True: no anchors, which ROS does not read."""
        return True

    def represent_mapping(self, *arguments: Any, **options: Any) -> yaml.MappingNode:
        """Return the node of a mapping; a key that is a plain word needs no quotes."""
        made = super().represent_mapping(*arguments, **options)
        for key, _ in made.value:
            if _is_plain(key.value):
                key.style = None
        return made


def _quoted(dumper: _Dumper, text: str) -> yaml.Node:
    style = "'" if text.isascii() and text.isprintable() else '"'
    return dumper.represent_scalar(f'{_TAG}str', str(text), style=style)


_Dumper.add_multi_representer(str, _quoted)
_Dumper.add_representer(str, _quoted)
_Dumper.add_representer(tuple, yaml.SafeDumper.represent_list)
_Dumper.add_representer(array, yaml.SafeDumper.represent_list)  # numbers of a ROS message


def scalar(value: Any) -> str:
    """Return `value` (a text, number, boolean or list) as YAML in one line, texts in quotes."""
    text = yaml.dump(value, Dumper=_Dumper, default_flow_style=True, width=math.inf)
    return text.removesuffix('\n').removesuffix('\n...')


def _is_plain(name: str) -> bool:
    return name.isascii() and name.isidentifier() and is_text(name)


def key(name: str) -> str:
    """Return `name` as the key of a mapping, in quotes unless it is a plain word."""
    return name if _is_plain(name) else scalar(name)


def block(values: Any) -> str:
    """Return `values` as YAML in several lines, lists of numbers in one line each."""
    return yaml.dump(
        values, Dumper=_Dumper, default_flow_style=None, width=math.inf, sort_keys=False
    )


def comment(text: str) -> str:
    """Return `text` as one comment line."""
    return f'# {printable(text)}'
