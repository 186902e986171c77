# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Message definitions and type hashes; a bag stores them so that any tool can read it."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from estimator_pkg.errors import UserError
from estimator_pkg.messages.field import BASES, EMPTY, SEQUENCE, Definition, Kind
from estimator_pkg.optional import Lazy
from estimator_pkg.ros.message_class import TYPE_NAME

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

interfaces = Lazy('rosbags.interfaces')
typesys = Lazy('rosbags.typesys')
MOST_LINES = 10_000  # of a definition that is read: the library's parser takes 0.1 ms for each


@lru_cache(maxsize=1)
def jazzy() -> Typestore:
    """The message types of ROS 2 Jazzy."""
    return typesys.get_typestore(typesys.Stores.ROS2_JAZZY)


@lru_cache(maxsize=256)
def define(type_name: str) -> tuple[str, str]:
    """Return (definition with its dependencies, type hash) of a type; '' and '' if it is unknown.

    Parameters
    ----------
    type_name : as in 'sensor_msgs/msg/JointState'. Types that Jazzy does not have are searched in
        the installed ROS packages.
    """
    store = jazzy()
    try:
        _register(store, type_name)
    except (OSError, typesys.TypesysError):
        return '', ''
    return store.generate_msgdef(type_name, ros_version=2)[0], _hash(store, type_name)


def _hash(store: Typestore, type_name: str) -> str:
    """Return the installed type hash; that of rosbags is wrong for types with `char`."""
    with suppress(OSError):
        found = json.loads(_file(type_name, '.json').read_text(encoding='utf-8'))
        for item in found.get('type_hashes', []):
            if item['type_name'] == type_name:
                return item['hash_string']
    return store.hash_rihs01(type_name)


def _register(store: Typestore, type_name: str) -> None:
    """Add an installed type and those in it; raise OSError or TypesysError if one is missing."""
    if type_name in store.fielddefs:
        return
    found = typesys.get_types_from_msg(_file(type_name, '.msg').read_text('utf-8'), type_name)
    for _, fields in found.values():
        for kind in (_kind(*each) for _, each in fields):
            if kind.is_message:
                _register(store, kind.base)
    store.register(found)


def _file(type_name: str, suffix: str) -> Path:
    """Return the file of an installed type; raise FileNotFoundError."""
    package, _, name = type_name.partition('/')
    if TYPE_NAME.fullmatch(type_name):  # from a bag: it must not lead out of `share`
        for prefix in [*os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep), sys.prefix]:
            path = Path(prefix, 'share', package, name + suffix)
            if prefix and path.is_file():
                return path
    raise FileNotFoundError(type_name)


def fields_of(type_name: str, definition: str) -> Definition:
    """Return the fields of a message type and of those in it: from the bag's definition, else ours.

    Raises
    ------
    UserError : the definition cannot be read, and neither Jazzy nor an installed package has one.
    """
    own, known = define(type_name)
    for text in [*([definition] if definition else ()), *([own] if known else ())]:
        if text.count('\n') < MOST_LINES:
            with suppress(typesys.TypesysError, ValueError):
                return _parsed(type_name, text).__getitem__
    raise UserError(
        f'the bag has no definition of {type_name} that can be read, and ROS 2 Jazzy does not '
        'have it either: install its package'
    )


def _parsed(type_name: str, text: str) -> dict[str, Mapping[str, Kind]]:
    """Return the fields of all types in a definition."""
    found: dict[str, Mapping[str, Kind]] = {}
    for name, (_, fields) in typesys.get_types_from_msg(text, type_name).items():
        found[name] = {field: _kind(*kind) for field, kind in fields} or EMPTY
        if len(found[name]) < len(fields):
            raise ValueError(f'{name} has two fields of one name')
    if not {kind.base for each in found.values() for kind in each.values()} <= {*found, *BASES}:
        raise ValueError('a type has no definition')
    return found


def _kind(node: int, content: Any) -> Kind:
    """Return the kind of a field that rosbags describes as (node, content)."""
    if node in (interfaces.Nodetype.ARRAY, interfaces.Nodetype.SEQUENCE):
        element, size = content
        return Kind(_kind(*element).base, size if node == interfaces.Nodetype.ARRAY else SEQUENCE)
    base = content[0] if node == interfaces.Nodetype.BASE else content
    return Kind('wstring' if base.endswith('/msg/wstring') else base)  # rosbags has no wstring
