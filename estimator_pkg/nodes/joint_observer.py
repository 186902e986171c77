"""The executable `joint_observer`: angles in, velocities out.

The node's class is `JointObserver`; add it to an executor of your own if you like.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from estimator_pkg.nodes.runtime import run

if TYPE_CHECKING:
    from estimator_pkg.nodes.observer_node import JointObserver

__all__ = ['JointObserver', 'main']


def __getattr__(name: str) -> Any:
    """`JointObserver`, imported when it is asked for: ROS takes a while."""
    if name == 'JointObserver':
        from estimator_pkg.nodes.observer_node import JointObserver
        return JointObserver
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def _make() -> JointObserver:
    from estimator_pkg.nodes.observer_node import JointObserver
    return JointObserver()


def main(args: list[str] | None = None) -> int:
    """Run the node until it is interrupted; returns the exit code."""
    return run(_make, args)


if __name__ == '__main__':
    sys.exit(main())
