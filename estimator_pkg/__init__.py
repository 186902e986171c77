# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Live velocity estimation for ROS 2: observers, their nodes, bags and evaluation.

The library is `VelocityEstimator`: one joint, no ROS (docs/library.md). docs/architecture.md lists
the rooms (the folders), and what each may know.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from estimator_pkg.errors import UsageError
    from estimator_pkg.estimator import Estimate, EstimateArrays, VelocityEstimator, differentiate

__all__ = ['Estimate', 'EstimateArrays', 'UsageError', 'VelocityEstimator', 'differentiate']

__version__ = '1.0.0'


def __getattr__(name: str) -> Any:
    """Import the library when one of its names is used: `import estimator_pkg` loads no numpy."""
    if name not in __all__:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    from estimator_pkg import estimator

    return getattr(estimator, name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
