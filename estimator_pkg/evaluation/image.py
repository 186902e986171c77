# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Files of plots, drawn by Matplotlib."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from estimator_pkg import destination, whole_file
from estimator_pkg.errors import UserError
from estimator_pkg.optional import needs


def check(path: str) -> None:
    """Raise UserError unless `path` can be drawn: called before the work, not after it.

    Raises
    ------
    UserError : matplotlib is missing, does not support the file type, or the file is not writable.
    """
    try:
        from matplotlib.backend_bases import FigureCanvasBase
    except ImportError as error:
        raise UserError(f'plots: {needs("matplotlib")}') from error
    logging.getLogger('matplotlib').setLevel(logging.ERROR)  # it lists missing fonts
    kinds = FigureCanvasBase.get_supported_filetypes()
    kind = Path(path).suffix[1:].lower()
    if kind not in kinds:
        raise UserError(
            f'{path}: '
            + (f'{kind} is not supported' if kind else 'the name has no ending')
            + f': end it in one of {", ".join(sorted(kinds))}'
        )
    destination.check(path)


def save(figure: Any, path: str) -> None:
    """Write a figure, completely or not at all; its type is that of the suffix."""
    with whole_file.replacing(path) as temporary:
        figure.savefig(temporary, dpi=120, format=Path(path).suffix[1:].lower())
