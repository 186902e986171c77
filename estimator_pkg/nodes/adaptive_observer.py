"""The node ``adaptive_observer``: velocities of joints whose parameters are not known.

To run it in an executor of your own, make a `AdaptiveObserver`.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from estimator_pkg.nodes.runtime import run

if TYPE_CHECKING:
    from rclpy.node import Node


def make_node() -> Node:
    """The node, with the parameters of the command line."""
    from estimator_pkg.nodes.adaptive_node import AdaptiveObserver
    return AdaptiveObserver()


def main(args: list[str] | None = None) -> int:
    """Run the node until it is interrupted; returns the exit code."""
    return run(make_node, args)


if __name__ == '__main__':
    sys.exit(main())
