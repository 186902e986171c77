# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The parameter file of a node, as `doctor` and the page of `evaluate` recommend it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from estimator_pkg import params_file, yaml_text
from estimator_pkg.evaluation.text import WIDTH, wrapped

EMPTY = '  ros__parameters: {}'


def as_yaml(
    head: Iterable[str],
    values: Mapping[str, Any],
    quanta: Mapping[str, float] = {},
    joints: Mapping[str, Mapping[str, Any]] = {},
    node: str = '/**',
) -> str:
    """Return the file.

    Parameters
    ----------
    head : sentences of the comment at its top. values : of all joints.
    quanta : quantum of each joint's readings [rad or m]; 0: none. It is written for all joints
        where they have the same one, unless `values` has it.
    joints : further values of a joint. node : that reads the file; usually every one.
    """
    known = {name: float(f'{count:.6g}') for name, count in quanta.items() if count}
    own: dict[str, dict[str, Any]] = {
        name: dict(joints.get(name, {})) for name in {**quanta, **joints}
    }
    values = dict(values)
    if 'quantum' not in values:
        if len(set(known.values())) == 1 and len(known) == len(quanta):
            values['quantum'] = next(iter(known.values()))
        else:
            for name, count in known.items():
                own[name]['quantum'] = count
    lines = [yaml_text.comment(line) for each in head for line in wrapped(each, WIDTH - 2)]
    lines += [f'{node}:', '  ros__parameters:' if values or any(own.values()) else EMPTY]
    lines += [f'    {yaml_text.key(k)}: {yaml_text.scalar(v)}' for k, v in values.items()]
    for name, more in own.items():
        if more and name:
            lines.append(f'    {yaml_text.key(f"{params_file.OVERRIDES}.{name}")}:')
        lines += [f'    {"  " * bool(name)}{k}: {yaml_text.scalar(v)}' for k, v in more.items()]
    return '\n'.join(lines) + '\n'
