# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Message definitions and type hashes; a bag stores them so that any tool can read it."""

from __future__ import annotations

import json
import os
import sys
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from estimator_pkg.errors import UserError
from estimator_pkg.messages.field import EMPTY, SEQUENCE, Definition, Kind
from estimator_pkg.optional import Lazy
from estimator_pkg.ros.message_class import TYPE_NAME

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

interfaces = Lazy('rosbags.interfaces')
typesys = Lazy('rosbags.typesys')
SEPARATOR = '=' * 80
LONGEST_DEFINITION = 1 << 20  # characters of a bag's definition that are read


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
    if type_name in store.fielddefs:
        text, _ = store.generate_msgdef(type_name, ros_version=2)
        return text, _hash(type_name) or store.hash_rihs01(type_name)
    return _installed(type_name)


def _installed(type_name: str) -> tuple[str, str]:
    texts: list[str] = []
    done: set[str] = set()
    waiting = [type_name]
    while waiting:
        name = waiting.pop(0)
        if name in done:
            continue
        done.add(name)
        file = _file(name, '.msg')
        if file is None:
            return '', ''
        text = file.read_text(encoding='utf-8')
        package = name.split('/')[0]
        head = '' if name == type_name else f'{SEPARATOR}\nMSG: {name.replace("/msg/", "/")}\n'
        texts.append(head + text)
        for line in text.splitlines():
            word = line.split('#')[0].strip().split(' ')[0].split('[')[0].split('<')[0]
            if word[:1].isupper():
                waiting.append(f'{package}/msg/{word}')
            elif '/' in word:
                owner, _, short = word.partition('/')
                waiting.append(f'{owner}/msg/{short.rpartition("/")[2]}')
    return '\n'.join(texts), _hash(type_name)


def _hash(type_name: str) -> str:
    file = _file(type_name, '.json')
    if file is None:
        return ''
    for item in json.loads(file.read_text(encoding='utf-8')).get('type_hashes', []):
        if item['type_name'] == type_name:
            return item['hash_string']
    return ''


def _file(type_name: str, suffix: str) -> Path | None:
    if not TYPE_NAME.fullmatch(type_name):  # from a bag: it must not lead out of `share`
        return None
    for prefix in [*os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep), sys.prefix]:
        package, _, rest = type_name.partition('/')
        path = Path(prefix, 'share', package, rest + suffix)
        if prefix and path.is_file():
            return path
    return None


def store_for(type_name: str, definition: str) -> Typestore:
    """Return a type store with this type: from the bag's definition, else Jazzy's.

    Raises
    ------
    UserError : neither has it.
    """
    if 0 < len(definition) <= LONGEST_DEFINITION and not definition.startswith(f'{SEPARATOR}\nIDL'):
        store = typesys.get_typestore(typesys.Stores.EMPTY)
        try:
            store.register(typesys.get_types_from_msg(definition, type_name))
            return store
        except Exception:  # the parser rejects the definition: use Jazzy's, if it has the type
            pass
    if type_name in jazzy().fielddefs:
        return jazzy()
    raise UserError(
        f'the bag has no definition of {type_name} that can be read, and ROS 2 Jazzy does not '
        'have it either: install its package'
    )


def fields_of(store: Typestore) -> Definition:
    """Return the fields of message types, as a type store defines them."""
    nodes = interfaces.Nodetype

    def kind(node: Any, what: Any) -> Kind:
        if node == nodes.NAME:  # rosbags also has there what it does not know, as wstring
            return Kind(what if what in store.fielddefs else what.rpartition('/')[2])
        if node == nodes.BASE:
            return Kind(what[0])
        inner, count = what
        return Kind(kind(*inner).base, count if node == nodes.ARRAY else SEQUENCE)

    @lru_cache
    def fields(type_name: str) -> dict[str, Kind]:
        found = {field: kind(*what) for field, what in store.fielddefs[type_name][1]}
        return {field: each for field, each in found.items() if each.length != 0} or EMPTY

    return fields
