# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The held-out recordings as columns; `held_out.yaml` lists them and explains its keys."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from benchmarks.columns import Column
from benchmarks.recorded import SKIPPED
from benchmarks.signals import START_NS, Samples
from estimator_pkg.bags.series import Series
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.compare.matching import match
from estimator_pkg.evaluation.compare.truth import SMOOTHED, measured_truth
from estimator_pkg.evaluation.reference.motion import motion
from estimator_pkg.evaluation.reference.quantum import quantum
from estimator_pkg.progress import progress

Array = NDArray[np.float64]

LIST = Path(__file__).with_name('held_out.yaml')
TURN = 2.0 * np.pi


class Listed(NamedTuple):
    """A series of the list: name, keys of its source and its own, largest allowed reference error.

    judged : the series counts where its reference's error is at most this part of a baseline's.
    """

    name: str
    keys: Mapping[str, Any]
    judged: float


def listed(which: str = 'series', path: Path = LIST) -> list[Listed]:
    """Return the series of a list (a key of `held_out.LISTS`); their keys replace the source's."""
    found = yaml.safe_load(path.read_text(encoding='utf-8'))
    return [
        Listed(name, {**found['sources'][keys['source']], **keys}, found['judged'])
        for name, keys in found[which].items()
    ]


def columns(folder: Path, series: Sequence[Listed]) -> list[Column]:
    """Return a column per series.

    Raises
    ------
    UserError : a file is missing, or is not the listed one.
    """
    found = []
    with progress('reading the held-out recordings', len(series)) as advance:
        for each in series:
            found.append(column(folder, each))
            advance(1)
    return found


def column(folder: Path, series: Listed) -> Column:
    """Return one series with its reference; raises as `columns`."""
    keys = series.keys
    period = float(keys.get('period', TURN))
    time, angle, velocity = _rows(folder, keys)
    stamps = START_NS + np.rint((time - time[0]) * 1e9).astype(np.int64)
    if velocity is None:
        moved = motion(stamps, angle, period)
        if moved is None:
            raise UserError(f'{series.name}: too few readings for a reference')
        firm = moved.firm
        known = Series(moved.stamps[firm], moved.position[firm], moved.velocity[firm], angle[:0])
        noise = moved.uncertainty
    else:
        true = Series(stamps, np.full(len(angle), np.nan), velocity, np.full(len(angle), np.nan))
        known, noise = measured_truth(true, Series(stamps, angle, velocity, velocity), period)
    used = slice(None, None, int(keys.get('every', 1)))
    stamps, angle = stamps[used], angle[used]
    if 'quantum' in keys:
        angle = keys['quantum'] * np.floor(angle / keys['quantum'])
    at = match(stamps, known.stamps_ns, known.velocity, known.position, period)
    reference = np.full(len(stamps), np.nan)
    reference[at.rows] = at.velocity
    return Column(
        series.name,
        str(keys['what']),
        Samples(stamps, angle, reference),
        quantum(angle),
        SKIPPED,
        float(noise) if np.isfinite(noise) else 0.0,
        reference=SMOOTHED if velocity is None else str(keys['truth']),
        period=period,
    )


def _rows(folder: Path, keys: Mapping[str, Any]) -> tuple[Array, Array, Array | None]:
    """Return time [s], angle [rad] and velocity [rad/s] or None, up to where the time restarts."""

    def values(name: str) -> Array | None:
        if name not in keys:
            return None
        wanted = {**keys, **keys[name]}
        return table(folder, wanted)[:, wanted['column']] * float(wanted.get('unit', 1.0))

    if 'yaw' in keys:
        w, x, y, z = table(folder, keys)[:, keys['yaw']].T
        angle = np.unwrap(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
    else:
        angle = values('angle')
    assert angle is not None
    time, velocity = values('time'), values('velocity')
    if time is None:
        time = np.arange(len(angle)) / float(keys['rate'])
    good = np.isfinite(time) & np.isfinite(angle)
    time, angle = time[good], angle[good]
    back = np.flatnonzero(np.diff(time) < 0.0)  # a log that is a ring ends with its oldest rows
    end = int(back[0]) + 1 if len(back) else len(time)
    return time[:end], angle[:end], None if velocity is None else velocity[good][:end]


def table(folder: Path, keys: Mapping[str, Any]) -> Array:
    """Return a file as numbers, shape (rows, columns); raises as `columns`."""
    path = folder / keys['repository'] / keys['path']
    if not path.is_file():
        raise UserError(
            f'{path} is missing: it is {keys["path"]} of github.com/{keys["repository"]}, commit '
            f'{keys["commit"]}; give the folder of the repositories with --held-out'
        )
    return _read(
        path, keys['files'][keys['path']], keys.get('variable', ''), int(keys.get('width', 0))
    )


@lru_cache(maxsize=4)
def _read(path: Path, expected: str, variable: str, width: int) -> Array:
    data = path.read_bytes()
    if hashlib.sha256(data).hexdigest() != expected:
        raise UserError(f'{path} is not the listed file: check out the commit of held_out.yaml')
    if variable:
        from scipy.io import loadmat

        found = loadmat(BytesIO(data), squeeze_me=True, struct_as_record=False)
        name, *fields = variable.split('.')
        value = found[name]
        for field in fields:
            value = getattr(value, field)
        return np.asarray(value, np.float64).reshape(len(value), -1)
    rows = [numbers(line) for line in data.decode('utf-8-sig').splitlines()]
    if width:
        return np.array([each for row in rows for each in row]).reshape(-1, width)
    usual = Counter(len(row) for row in rows if row).most_common(1)[0][0]
    return np.array([row for row in rows if len(row) == usual])


def numbers(line: str) -> list[float]:
    """Return the numbers of a line; none if it has any other word."""
    try:
        return [float(word) for word in line.replace(',', ' ').replace(';', ' ').split()]
    except ValueError:
        return []
