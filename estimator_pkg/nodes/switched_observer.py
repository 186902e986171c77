"""The node ``switched_observer``: velocities of a system that known events switch.

To run it in an executor of your own, make a `SwitchedObserver`.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from estimator_pkg.nodes.runtime import run

if TYPE_CHECKING:
    from rclpy.node import Node


def make_node() -> Node:
    """The node, with the parameters of the command line."""
    from estimator_pkg.nodes.switched_node import SwitchedObserver
    return SwitchedObserver()


def main(args: list[str] | None = None) -> int:
    """Run the node until it is interrupted; returns the exit code."""
    return run(make_node, args)


if __name__ == '__main__':
    sys.exit(main())
