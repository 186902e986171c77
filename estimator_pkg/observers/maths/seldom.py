# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Mark a function that few samples reach, for the compiler."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

Function = TypeVar('Function', bound=Callable)


def seldom(function: Function) -> Function:
    """Return the function, which compiled code calls from now on and does not contain.

    Compiled loops contain the functions that they call, which saves nearly all of the call's cost.
    But one that few samples reach makes the loop longer, and its other lines slower.
    """
    vars(function)['seldom'] = True
    return function


def is_seldom(function: Callable) -> bool:
    """Return True if `seldom` marked the function."""
    return 'seldom' in vars(function)
