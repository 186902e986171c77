# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The style that all figures of the papers share. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

BLUE, RED, GREEN, PURPLE, ORANGE = '#1f6fb4', '#d1342f', '#2a9d4a', '#8a4fbf', '#e0912f'
GREY, DARK = '#cfcfcf', '#222222'
TRUTH: dict[str, Any] = {'color': DARK, 'linewidth': 1.1, 'linestyle': (0, (5, 2)), 'label': 'true'}


def panels(
    count: int, title: str, labels: tuple[str, ...] = (), columns: int = 1, sharex: bool = True
) -> Any:
    """Return (figure, axes) of panels over time; `labels` are those of the vertical axes."""
    figure = Figure(figsize=(8.0, 1.2 + 2.0 * count), layout='constrained')
    axes = figure.subplots(count, columns, sharex=sharex, squeeze=False)
    figure.suptitle(title)
    for each in axes.flat:
        each.grid(color='#e5e5e5', linewidth=0.6)
        each.spines[['top', 'right']].set_visible(False)
        each.margins(x=0.0)
    for each, label in zip(axes[:, 0], labels):
        each.set_ylabel(label)
    for each in axes[-1]:
        each.set_xlabel('time [s]')
    return figure, axes[:, 0] if columns == 1 else axes


def lines(
    axes: Any, time: NDArray[Any], curves: Mapping[str, Any], styles: Mapping[str, Any], **more: Any
) -> None:
    """Plot curves by name over time, shape (n,) each, in their style, with a legend.

    A style is a colour, or keywords.
    """
    for name, values in curves.items():
        style = styles.get(name, {})
        style = {'color': style} if isinstance(style, str) else style
        axes.plot(time, np.asarray(values), **{'linewidth': 1.0, 'label': name, **more, **style})
    if len(curves) > 1:
        axes.legend(frameon=False, loc='upper right')
