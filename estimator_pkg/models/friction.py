# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Friction: its parameters, and dry friction as a function of velocity."""

from __future__ import annotations

from typing import Any

import numpy as np

from estimator_pkg.parameters import structural

STRIBECK = 0.02  # default width of the smoothed sign [rad/s or m/s]


def smooth_sign(v: Any, width: float) -> Any:
    """Return tanh(v / width); for width 0 the sign of v, with 0 at 0."""
    return np.tanh(v / width) if width > 0.0 else np.sign(v)


def asymmetric(v: Any, forward: float, backward: float, width: float) -> Any:
    """Return Coulomb friction with a different level per direction: forward for v >= 0."""
    return np.where(v >= 0.0, forward, backward) * smooth_sign(v, width)


def viscous(default: float = 0.0, of: str = '', unit: str = 'N m s/rad') -> Any:
    """Return the declaration of a viscous friction."""
    return structural(default, unit=unit, range=(0.0, 1e6), description=f'viscous friction{of}')


def coulomb(default: float = 0.0, of: str = 'Coulomb friction', unit: str = 'N m') -> Any:
    """Return the declaration of a dry friction."""
    return structural(default, unit=unit, range=(0.0, 1e6), description=of)


def sign_width() -> Any:
    """Return the declaration of the width of the smoothed sign of a joint's Coulomb friction."""
    return structural(
        STRIBECK,
        unit='rad/s',
        range=(1e-9, 100.0),
        advanced=True,
        description='width of the smoothed sign of the Coulomb friction, tanh(v / width)',
    )
