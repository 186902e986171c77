"""The executable `pmsm_observer`: currents and voltages in, speed, angle and flux out.

The node's class is `PmsmObserver`; add it to an executor of your own if you like.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from estimator_pkg.nodes.runtime import run

if TYPE_CHECKING:
    from estimator_pkg.nodes.pmsm_node import PmsmObserver

__all__ = ['PmsmObserver', 'main']


def __getattr__(name: str) -> Any:
    """`PmsmObserver`, imported when it is asked for: ROS takes a while."""
    if name == 'PmsmObserver':
        from estimator_pkg.nodes.pmsm_node import PmsmObserver
        return PmsmObserver
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def _make() -> PmsmObserver:
    from estimator_pkg.nodes.pmsm_node import PmsmObserver
    return PmsmObserver()


def main(args: list[str] | None = None) -> int:
    """Run the node until it is interrupted; returns the exit code."""
    return run(_make, args)


if __name__ == '__main__':
    sys.exit(main())
