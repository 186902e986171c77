# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The identified parameters of the observer `adaptive`, as key and value and in a file.

The file contains the plant itself, the first column of A and B, so it does not depend on the
observer's poles.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import yaml

from estimator_pkg import whole_file, yaml_text
from estimator_pkg.driver.adaptive import AdaptiveBank
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.observers.adaptive.report import IdentificationReport
from estimator_pkg.observers.adaptive.structure import structure

UNKNOWN_UNIT = 'unit of input'  # name in a report


def values_of(said: IdentificationReport, input_unit: str = '') -> dict[str, Any]:
    """Return the state, and value, deviation, unit and trust of each parameter.

    Parameters
    ----------
    input_unit : unit of the model's input; empty: not known.
    """
    values: dict[str, Any] = {
        'state': said.phase,
        'why': said.reason,
        'trusted': said.trusted,
        'adapted_s': said.adapted,
        'excitation': said.excitation,
        'explained': said.explained,
    }
    for item in said.parameters:
        unit = item.unit.replace(UNKNOWN_UNIT, input_unit) if input_unit else item.unit
        values.update(
            {
                item.name: item.value,
                f'{item.name}.stddev': item.stddev,
                f'{item.name}.unit': unit,
                f'{item.name}.trusted': item.trusted,
            }
        )
    return values


FILE_FORMAT = 1
FILE_COMMENT = "x1' = A x + B u in observable canonical form: a is the first column of A, b is B."


def save(path: str, bank: AdaptiveBank) -> list[str]:
    """Write the identified parameters, keeping other joints of the file; return the names written.

    Raises
    ------
    UserError : nothing is identified, or the file cannot be written.
    """
    joints = load(path) if Path(path).exists() else {}
    names = []
    for name, said in bank.reports().items():
        gains = bank.joints[name].gains
        if said.adapted == 0.0 and gains.theta is None:
            continue
        n = gains.order
        model = structure(gains).model
        joints[name] = {
            'order': n,
            'a': [known + value for known, value in zip(model, said.theta)],
            'b': list(said.theta[n : 2 * n]),
            'stddev': [item.stddev for item in said.parameters[: len(said.theta)]],
            'trusted': said.trusted,
        }
        for word, letter, has in (('load', 'd', gains.load), ('gravity', 's', gains.gravity)):
            if has:
                joints[name][word] = said.theta[said.names.index(f'{letter}{n}')]
        names.append(name)
    if not names:
        raise UserError('nothing is identified yet: excite the joint for longer')
    text = f'{yaml_text.comment(FILE_COMMENT)}\n' + yaml_text.block(
        {'adaptive_parameters': FILE_FORMAT, 'joints': joints}
    )
    try:
        whole_file.write_text(path, text)
    except OSError as error:
        raise UserError(f'cannot write {path}: {error.strerror}') from error
    return names


def load(path: str) -> dict[str, dict[str, Any]]:
    """Return the content of a file of `save`, by joint.

    Raises
    ------
    UsageError : it cannot be read, or is not such a file.
    """
    try:
        content = yaml_text.read(whole_file.read_text(path))
    except OSError as error:
        raise UsageError(f'cannot read {path}: {error.strerror}') from error
    except (yaml.YAMLError, UnicodeDecodeError):
        content = None
    if not isinstance(content, dict) or content.get('adaptive_parameters') != FILE_FORMAT:
        raise UsageError(f'{path} contains no parameters of the adaptive observer')
    joints = content.get('joints') or {}
    if not isinstance(joints, dict):
        raise UsageError(
            f"{path}: 'joints' must map each joint's name to its parameters, not {joints!r}"
        )
    for name, own in joints.items():
        if not _is_entry(own):
            raise UsageError(f"{path}: the parameters of joint '{name}' are damaged")
    return dict(joints)


def _is_entry(own: Any) -> bool:
    """Return True if this is a joint's entry as `save` writes it."""
    try:
        n, stddev = own['order'], own.get('stddev', [])
        others = [own[word] for word in ('load', 'gravity') if word in own]
        numbers = [*own['a'], *own['b'], *others]
        return (
            type(n) is int
            and len(own['a']) == len(own['b']) == n
            and all(type(x) is float and math.isfinite(x) for x in numbers)
            and len(stddev) in (0, len(numbers))
            and all(type(x) is float for x in stddev)
            and type(own.get('trusted', True)) is bool
        )
    except (TypeError, KeyError, AttributeError):
        return False
