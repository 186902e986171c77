# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A controller of ros2_control that runs an exported observer: an ament_cmake package.

The folder `templates` has its files; names between two @ are replaced, also in the files' names.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from estimator_pkg import __version__, observers, whole_file
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.errors import UsageError
from estimator_pkg.export import filled
from estimator_pkg.export.header import exported
from estimator_pkg.observers.contract import Observer
from estimator_pkg.streams.contract import Stream

TEMPLATES = Path(__file__).with_name('templates')
NAME = re.compile(r'[a-z](_?[a-z0-9])+')
JOINT = re.compile(r'[\w.-]+', re.ASCII)


def run(
    parsed: argparse.Namespace, out: Path, stream: type[Stream], values: dict[str, Any]
) -> dict[str, Any]:
    """Write the package that the command's arguments name; return what was written.

    Raises
    ------
    UsageError : see `package`; or the options do not belong together.
    """
    if not parsed.ros2_control:
        raise UsageError('--name names a package: add --ros2-control, or omit it')
    if parsed.name is None:
        raise UsageError('--ros2-control needs a name for package and controller: add --name NAME')
    if parsed.bag is not None:
        raise UsageError('--bag checks a header: omit it with --ros2-control')
    check(parsed.name, observers.find(parsed.observer))
    bank = stream.of(values).bank
    joints = sorted(bank.only or bank.configuration.overrides) or ['joint1']
    joints = [parsed.joint] if parsed.joint else joints
    files = package(parsed.name, bank.configuration, joints, parsed.float32)
    for path, text in files.items():
        place = out / path
        place.parent.mkdir(parents=True, exist_ok=True)
        whole_file.write_text(place, text)
    print(f'{out}: package {parsed.name}, {parsed.observer} for {", ".join(joints)}')
    return {'observer': parsed.observer, 'out': str(out), 'package': parsed.name, 'joints': joints}


def check(name: str, observer: type[Observer]) -> None:
    """Raise UsageError for a name that ROS refuses, or an observer of more than an angle."""
    if not NAME.fullmatch(name):
        raise UsageError(
            f"--name '{name}' is no name of a ROS package: use lower-case letters, digits and "
            'single _, beginning with a letter'
        )
    if observer.kind != 'angle':
        raise UsageError(
            f"observer '{observer.name}' needs more than the angle of a joint: choose one of "
            'joint_observer'
        )


def package(
    name: str, configuration: Configuration, joints: Sequence[str], float32: bool = False
) -> dict[str, str]:
    """Return the texts of the package's files by their paths.

    Parameters
    ----------
    name : of the package and its controller.
    configuration : gains and settings; a joint with values of its own gets a header of its own.
    joints : those of the example, and those whose own values are used.
    float32 : compute in float instead of double.

    Raises
    ------
    UsageError : a joint that cannot be in the name of an interface; or see `exported`.
    """
    for joint in joints:
        if not JOINT.fullmatch(joint):
            raise UsageError(
                f"joint '{joint}' cannot be in the name of an interface: use letters, digits, _, "
                '- and .'
            )
    observer = configuration.observer
    own = [joint for joint in joints if joint in configuration.overrides]
    laws: dict[str, str] = {}  # joint -> prefix of its header; '': the other joints
    files: dict[str, str] = {}
    values = {
        'NAME': name,
        'NAME_UPPER': name.upper(),
        'OBSERVER': observer.name,
        'VERSION': __version__,
        'JOINTS': _listed(joints),
        'STATES': _listed(f'{name}/{joint}' for joint in joints),
        'VELOCITIES': _listed(f'{name}/{joint}/velocity' for joint in joints),
        'GAINS': '\n'.join(
            f'      {json.dumps(joint)}: {{p: 0.5, feedforward_gain: 1.0}}' for joint in joints
        ),
    }
    for joint in ['', *own]:
        prefix = re.sub(r'\W', '_', f'{observer.name}_{joint}'.lower() if joint else observer.name)
        while prefix in laws.values():
            prefix += '_'
        laws[joint] = prefix
        made = exported(observer, *configuration.for_joint(joint), prefix, float32)
        files[f'src/{prefix}.h'] = made.header
    prefixes = list(laws.values())
    values['LAWS'] = '\n'.join(f'  src/law_{prefix}.cpp' for prefix in prefixes)
    values['DECLARATIONS'] = '\n'.join(f'std::unique_ptr<Law> {each}_law();' for each in prefixes)
    values['SELECTION'] = '\n'.join(
        f'  if (joint == "{joint}") {{ return {laws[joint]}_law(); }}' for joint in own
    )
    values['SELECTION'] += f'\n  return {laws[""]}_law();'
    for path in sorted(TEMPLATES.rglob('*.in')):
        place, text = path.relative_to(TEMPLATES).with_suffix('').as_posix(), path.read_text()
        for prefix in prefixes if '@PREFIX@' in place else ['']:
            own_values = {**values, 'PREFIX': prefix}
            files[filled(place, own_values)] = filled(text, own_values)
    return files


def _listed(names: Iterable[str]) -> str:
    return ', '.join(json.dumps(each) for each in names)
