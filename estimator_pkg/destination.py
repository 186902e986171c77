"""Where a result goes: looked at before the work, so that no work is lost for a wrong name."""

from __future__ import annotations

import os
from pathlib import Path

from estimator_pkg.errors import UserError


def check(path: str | Path) -> None:
    """Holds that a file can be written at `path`.

    Raises
    ------
    UserError : there is no such folder, a folder has that name, or it may not be written.
    """
    place = Path(path)
    if place.is_dir():
        raise UserError(f'{path} is a folder: name a file')
    if not place.parent.is_dir():
        raise UserError(f'{path}: there is no folder {place.parent}')
    if not os.access(place if place.exists() else place.parent, os.W_OK):
        raise UserError(f'{path} may not be written')
