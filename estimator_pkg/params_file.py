# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Parameter files in the ROS format, as nodes take them with ``--params-file``."""

from __future__ import annotations

import sys
from collections.abc import Container, Iterable, Mapping
from difflib import get_close_matches
from itertools import accumulate
from pathlib import Path
from typing import Any

import yaml

from estimator_pkg import whole_file, yaml_text
from estimator_pkg.errors import UsageError, UserError, first_line, suggestion
from estimator_pkg.printable import show

KEY = 'ros__parameters'
OVERRIDES = 'per_joint'
OF_EVERY_NODE = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')


def load(path: str | Path, node_name: str = 'joint_observer') -> dict[str, Any]:
    """The parameters for a node, nested keys flattened with dots.

    Sections named ``/**`` or ``*`` hold for every node, those named after it (with or without a
    namespace) for this one; the latter win.

    Raises
    ------
    UserError : the file cannot be read.
    UsageError : it is no parameter file, or has no section for this node.
    """
    content = _content(path, node_name)
    matching = sorted(_sections(path, content, ''), key=lambda item: _weight(item[0], node_name))
    values: dict[str, Any] = {}
    found = False
    for name, section in matching:
        if _weight(name, node_name):
            found = True
            values.update(_flat(section, ''))
    if not found:
        there = ', '.join(f"'{name}'" for name, _ in matching)
        raise UsageError(
            f"{path} has no section for '{node_name}'; "
            + (f'it has {there}' if there else f"no '{KEY}' at all")
        )
    return values


def for_observer(path: str | Path, node_name: str, observer: str | None) -> dict[str, Any] | None:
    """The parameters for a node that runs this observer; None: the file names another one.

    Parameters
    ----------
    observer : None: the one that the file names.

    Raises
    ------
    UserError, UsageError : as `load`.
    """
    values = of_this_node(load(path, node_name))
    return None if observer and values.get('observer', observer) != observer else values


def warn_unused(path: str | Path, observers: Iterable[str]) -> None:
    """Warn that a file names none of these observers."""
    show(
        f'warning: {path} is not used: it names another observer than {", ".join(observers)}',
        file=sys.stderr,
    )


def section_names(path: str | Path) -> set[str]:
    """The last parts of the names of a file's sections, as in 'joint_observer'.

    Raises
    ------
    UserError, UsageError : as `load`.
    """
    content = _content(path, 'joint_observer')
    return {name.rpartition('/')[2] for name, _ in _sections(path, content, '')}


def _content(path: str | Path, node_name: str) -> Mapping:
    """What the file holds; raises UserError or UsageError if it is no parameter file."""
    try:
        text = whole_file.read_text(path)
    except UnicodeDecodeError as error:
        raise UserError(f'{path} is not text') from error
    except OSError as error:
        raise UserError(f'cannot read {path}: {error.strerror}') from error
    try:
        content = yaml_text.read(text)
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None)
        line = f' (line {mark.line + 1})' if mark else ''
        what = getattr(error, 'problem', None) or first_line(error)
        raise UsageError(f'{path} is no YAML{line}: {what}') from error
    if not isinstance(content, Mapping):
        raise UsageError(f"{path} is no parameter file: it has no section '{node_name}: {KEY}:'")
    try:
        _flat(content, '')
    except RecursionError as error:
        raise UsageError(f'{path} has an alias to what it is part of') from error
    return content


def override(name: str) -> tuple[str, str]:
    """(joint, parameter) of ``per_joint.<joint>.<parameter>``; ('', name) for any other name.

    A joint's name may contain dots; parameter names have none.
    """
    first, _, rest = name.partition('.')
    joint, _, parameter = rest.rpartition('.')
    return (joint, parameter) if first == OVERRIDES and joint and parameter else ('', name)


def split(values: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """(common values, joint -> values): ``per_joint.<joint>.<parameter>`` apart from the others.

    Raises
    ------
    UsageError : a name would be that of a value and of a group of values.
    """
    common: dict[str, Any] = {}
    overrides: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        joint, parameter = override(name)
        (overrides.setdefault(joint, {}) if joint else common)[parameter] = value
    check_leaves(values)
    return common, overrides


def check_leaves(names: Iterable[str]) -> None:
    """Raise UsageError where a name is a leaf and a branch: ROS could not write such a file."""
    names = {name for name in names if override(name)[0]}
    for name in names:
        for group in list(accumulate(name.split('.'), '{}.{}'.format))[:-1]:
            if group in names:
                raise UsageError(
                    f"parameters '{group}' and '{name}' cannot be in one file: rename the joint"
                )


def parameter_suggestion(name: str, known: Iterable[str], of_joints: Container[str]) -> str:
    """A half-sentence that names the nearest right name.

    Parameters
    ----------
    name : what the user wrote. known : the plain names. of_joints : those that joints may have.
    """
    group, _, rest = name.partition('.')
    joint, _, parameter = rest.rpartition('.')
    if parameter in of_joints:
        like = get_close_matches(group, [OVERRIDES]) and '.' in rest
        if like and not joint:
            return f"name the joint, as in '{OVERRIDES}.JOINT.{parameter}'"
        return f"did you mean '{OVERRIDES}.{rest if like else name}'?"
    return suggestion(name, known)


def parameter_of(name: str) -> str:
    """The parameter of ``per_joint.<joint>.<parameter>``; any other name is that of a parameter."""
    return override(name)[1]


def of_this_node(values: Mapping[str, Any]) -> dict[str, Any]:
    """`values` without what ROS gives to every node."""
    return {
        name: value
        for name, value in values.items()
        if not any(
            name == known or (known.endswith('.') and name.startswith(known))
            for known in OF_EVERY_NODE
        )
    }


def _sections(path: str | Path, content: Mapping, prefix: str) -> list[tuple[str, Mapping]]:
    found: list[tuple[str, Mapping]] = []
    for key, value in content.items():
        name = f'{prefix}/{str(key).strip("/")}' if prefix or str(key).startswith('/') else str(key)
        if not isinstance(value, Mapping):
            raise UsageError(f"{path}: '{name}' must hold '{KEY}:' with the parameters below it")
        if KEY in value:
            section = value[KEY]
            if section is None:
                section = {}
            if not isinstance(section, Mapping):
                raise UsageError(f"{path}: '{KEY}' of '{name}' must hold keys and values")
            found.append((name, section))
            rest = {other: item for other, item in value.items() if other != KEY}
        else:
            rest = dict(value)
        found.extend(_sections(path, rest, name))
    return found


def _weight(section: str, node_name: str) -> int:
    """0: not for this node; else the larger the more it is meant for this one."""
    parts = [part for part in section.split('/') if part]
    last = parts[-1] if parts else ''
    if last == node_name.rpartition('/')[2]:
        return 3
    if last == '*':
        return 2
    return 1 if last == '**' else 0


def _flat(section: Mapping, prefix: str) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for key, value in section.items():
        name = f'{prefix}.{key}' if prefix else str(key)
        if isinstance(value, Mapping):
            values.update(_flat(value, name))
        else:
            values[name] = value
    return values
