# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Message types that users name, and their fields, from the ROS packages of this machine."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any

from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.messages.field import EMPTY, SEQUENCE, Kind
from estimator_pkg.ros.message_class import (
    TYPE_NAME,
    message_class,
    message_types,
    packages_with_messages,
)

_BASES = {'boolean': 'bool', 'double': 'float64', 'float': 'float32', 'octet': 'byte'}
_FIELD = re.compile(r'(?:sequence<(?P<items>.+?)(?:, \d+)?>|(?P<item>.+?)(?:\[(?P<count>\d+)\])?)')
_BOUND = re.compile(r'(w?string)<\d+>')


def find(type_name: str, parameter: str = 'field_type') -> Any:
    """Return the class of a message type.

    Parameters
    ----------
    parameter : name of the parameter with this value, for the error.

    Raises
    ------
    UsageError : it is not a message type, or not installed here.
    """
    wrong = f"parameter '{parameter}': "
    named = TYPE_NAME.fullmatch(type_name)
    if named is None:
        example = 'geometry_msgs/msg/PoseStamped'
        raise UsageError(f"{wrong}'{type_name}' is not a message type: write it as {example}")
    package = named[1]
    types = message_types(package)
    found = message_class(type_name)
    if found is None and type_name not in types:
        if types:
            raise UsageError(
                f"{wrong}{package} has no '{type_name}': {suggestion(type_name, types)}"
            )
        near = suggestion(package, packages_with_messages())
        hint = f'{near} Otherwise' if near.startswith('did') else ''
        raise UsageError(
            f"{wrong}the package '{package}' is not installed, or has no messages: "
            + f'{hint} install it, or source its workspace'.strip()
        )
    if found is None:
        raise UsageError(f'{wrong}{type_name} cannot be imported: build {package} again')
    return found


@lru_cache(maxsize=256)
def fields_of(type_name: str) -> dict[str, Kind]:
    """Return the fields of an installed message type, see `estimator_pkg.messages.field`.

    Raises
    ------
    UsageError : its package is not installed.
    """
    found = message_class(type_name)
    if found is None:
        raise UsageError(f'{type_name} is not installed: install its package')
    fields = found.get_fields_and_field_types()
    return {name: _kind(text) for name, text in fields.items()} or EMPTY


def _kind(text: str) -> Kind:
    """Return the kind of a field from its text, as in 'double[36]' or 'sequence<double, 3>'."""
    match = _FIELD.fullmatch(text)
    assert match is not None
    base = _BOUND.sub(r'\1', match['items'] or match['item'])
    package, slash, name = base.partition('/')
    base = f'{package}/msg/{name}' if slash else _BASES.get(base, base)
    if match['items']:
        return Kind(base, SEQUENCE)
    return Kind(base, int(match['count']) if match['count'] else None)
