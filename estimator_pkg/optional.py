# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Optional libraries: imported when used; if one is missing, the error has the install command.

The version ranges come from the package's metadata, so they are those of its set-up.
"""

from __future__ import annotations

import importlib
import re
import shlex
import sys
import sysconfig
from importlib.metadata import PackageNotFoundError, requires
from importlib.util import find_spec
from pathlib import Path
from typing import Any

PACKAGE = 'velocity_estimator'
OWN = ('estimator_pkg', 'sim_pkg')
# Requirements that have another name than their module, or bring it.
COMES_WITH = {'dask': 'distributed', 'yaml': 'PyYAML', 'ament_index_python': 'ros-jazzy-rclpy'}
ROS = ('ros-jazzy-rclpy', 'ros-jazzy-common-interfaces', 'ros-jazzy-rmw-fastrtps-cpp')
OF_ROS = re.compile(
    r'rclpy|rmw.*|rpyutils|ament_index_python|builtin_interfaces|\w+_(msgs|srvs)'
    r'|\w+_interfaces'
)
# Needed by every command that reads or writes bags.
BAGS = ('mcap', 'rosbags', 'rich', 'apsw', 'lz4', 'zstandard')
PLACE = '~/velocity_estimator_venv'


class Lazy:
    """A module that is imported at its first use, so that ``--help`` works without it."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        return getattr(importlib.import_module(self._name), attribute)


def is_there(module: str) -> bool:
    """Return True if `module` is installed; it is not imported."""
    try:
        return find_spec(module) is not None
    except (ImportError, ValueError):
        return False


def missing(error: BaseException | None) -> str | None:
    """Return one line with the command that installs a missing library, or None.

    Parameters
    ----------
    error : the exception; None is returned unless it, or its cause, is a missing library.
    """
    while error is not None:
        module = (getattr(error, 'name', None) or '').partition('.')[0]
        if isinstance(error, ModuleNotFoundError) and module and module not in OWN:
            return needs(module)
        error = error.__cause__ or error.__context__
    return None


def needs(module: str) -> str:
    """Return one line: that `module` is not installed, and the command that installs it."""
    line = f"the library '{module}' is not installed"
    ranges = _ranges()
    if OF_ROS.fullmatch(module):
        names = [ranges.get(name, name) for name in ROS]
        return (
            f'{line}: source the setup file of ROS (/opt/ros/jazzy/setup.bash), or without ROS '
            f'on this machine: {install(*names)}'
        )
    name = COMES_WITH.get(module, module)
    if name not in ranges:  # of a user's own module: a guessed name may be another's package
        return f'{line} for {sys.executable}'
    required = [name]
    if name in BAGS:
        required += [other for other in BAGS if other != name and not is_there(other)]
    return f'{line}: {install(*(ranges[each] for each in required))}'


def install(*requirements: str) -> str:
    """Return the command that installs `requirements` for this Python.

    A Python that the system manages (PEP 668) refuses pip: for it the command creates a virtual
    environment that includes the system's packages, such as ROS.
    """
    words = ' '.join(map(shlex.quote, requirements))
    stdlib = Path(sysconfig.get_path('stdlib', sysconfig.get_default_scheme()))
    own = sys.prefix != sys.base_prefix  # a virtual environment
    if own or not (stdlib / 'EXTERNALLY-MANAGED').is_file():
        return f'{shlex.quote(sys.executable)} -m pip install {words}'
    return (
        f'{shlex.quote(sys.executable)} -m venv --system-site-packages {PLACE} && '
        f'{PLACE}/bin/pip install {words} (the system manages this Python); then run '
        f'{PLACE}/bin/python -m estimator_pkg.cli instead of {PACKAGE}'
    )


def _ranges() -> dict[str, str]:
    """Return our requirements (extras included) by name, each with its version range."""
    try:
        every = requires(PACKAGE) or []
    except PackageNotFoundError:  # run from a checkout
        return {}
    texts = [text.partition(';')[0].strip() for text in every]
    return {found[0]: text for text in texts if (found := re.match(r'[\w.-]+', text))}
