# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Main functions of the observer executables; each runs until it is interrupted.

``python -m estimator_pkg.nodes.executables joint_observer --ros-args ...`` runs one without its
script.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from estimator_pkg.ros.runtime import run


def of_stream(kind: str) -> Callable[..., int]:
    """Return the main function for the node of this kind of observers; it returns the exit code.

    A package with its own family defines its executable like this: ``my_observer =
    of_stream('my_kind')``.
    """

    def make() -> Any:
        # ROS imports slowly, and an interrupt during it must end the process quietly
        from estimator_pkg.nodes.observer import ObserverNode

        return ObserverNode(kind)

    def main(args: list[str] | None = None) -> int:
        return run(make, args)

    return main


joint_observer = of_stream('angle')
mechanical_observer = of_stream('mechanical')
pmsm_observer = of_stream('drive')
adaptive_observer = of_stream('angle_and_input')
switched_observer = of_stream('switched')
wheel_odometry = of_stream('wheels')

if __name__ == '__main__':
    name = sys.argv.pop(1) if len(sys.argv) > 1 else ''
    if not name.endswith(('_observer', '_odometry')) or name not in globals():
        sys.exit(f"unknown node '{name}': pass the name of an executable, as joint_observer")
    sys.argv[0] = name
    sys.exit(globals()[name]())
