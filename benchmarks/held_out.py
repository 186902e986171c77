# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``--part held-out``: observers at their defaults on held-out recordings, next to textbook ones.

`held_out.yaml` lists the series and explains its keys. The four baselines are swept over their
gain. The single best one is the observer and setting with the lowest geometric mean rms over a
list. The best of four is, series by series, the best of the four, each at its own common setting:
the one with its lowest geometric mean.

`first_contact.yaml` has the last list and the rule by which it was chosen before a file was opened.
There the baselines have the settings that are best on the lists before, together.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from benchmarks.columns import Column, referenced
from benchmarks.laws import ours
from benchmarks.runner import Blocks, Part, Table, chosen, csv_text, delay_and_coverage, result
from benchmarks.signals import START_NS
from estimator_pkg.bags.series import Series
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.evaluation.compare.truth import OFFLINE_SMOOTHER, measured_truth
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.reference.motion import motion
from estimator_pkg.evaluation.text import fixed, number
from estimator_pkg.progress import progress

Array = NDArray[np.float64]

LIST = Path(__file__).with_name('held_out.yaml')
CONTACT = Path(__file__).with_name('first_contact.yaml')
LISTS = {
    'series': 'first list',
    'unseen': 'second list',
    'third': 'third list',
    'contact': 'first contact',
}
# By list: when its series were fixed, before an observer ran on one, and by which commit.
FIXED = {
    'first list': ('2026-11-22', 'a7289b45'),
    'second list': ('2026-11-22', '823453c8'),
    'third list': ('2026-11-22', 'c2e44592'),
    'first contact': ('2026-11-25', 'd93c8dff'),
}
OBSERVERS = ('edge_adaptive', 'hybrid_angle')
BASELINES = ('finite_difference', 'pll', 'kalman velocity', 'kalman acceleration')
NEAR = 1.15  # of a baseline's error, at most on each series
TURN = 2.0 * np.pi
SHORTEST = 300, 3.0  # readings and duration [s] of a series of the last list, at least
MOVES = 0.05  # motion of a joint that is not at rest, at least [rad]


class Listed(NamedTuple):
    """A series of a list: name, keys of its source and its own, largest allowed reference error.

    judged : the series counts where its reference's error is at most this part of a baseline's.
    """

    name: str
    keys: Mapping[str, Any]
    judged: float


def listed(which: str = 'series', path: Path = LIST) -> list[Listed]:
    """Return the series of one of `LISTS`; their keys replace the source's."""
    if which == 'contact':
        return _contacts(yaml.safe_load(CONTACT.read_text(encoding='utf-8')))
    found = yaml.safe_load(path.read_text(encoding='utf-8'))
    return [
        Listed(name, {**found['sources'][keys['source']], **keys}, found['judged'])
        for name, keys in found[which].items()
    ]


def _contacts(found: Mapping[str, Any]) -> list[Listed]:
    """Return each joint of each file."""
    series = []
    for source, keys in found['sources'].items():
        for name, path in zip(keys['names'], keys['files'], strict=True):
            for joint, (angle, velocity) in enumerate(keys['columns'], 1):
                own = {
                    'source': source,
                    'path': path,
                    'angle': {**keys.get('angle', {}), 'column': angle},
                    'velocity': {**keys.get('velocity', {}), 'column': velocity},
                }
                label = f'{source}_{name}' + (f'_{joint}' if len(keys['columns']) > 1 else '')
                series.append(Listed(label, {**keys, **own}, found['judged']))
    return series


def left_out(column: Column) -> str:
    """Return why the rule of `first_contact.yaml` leaves a series out; '' if it does not."""
    angle = column.samples.angle
    if len(angle) < SHORTEST[0] or column.time[-1] < SHORTEST[1]:
        return 'short'
    return 'rest' if np.ptp(angle) < MOVES else ''


def column(folder: Path, series: Listed) -> Column:
    """Return one series with its reference.

    Raises
    ------
    UserError : a file is missing, or is not the listed one.
    """
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
    against = known.stamps_ns, known.velocity, known.position
    origin = OFFLINE_SMOOTHER if velocity is None else str(keys['truth'])
    return referenced(series.name, (stamps, angle), against, noise, origin, period)


def _rows(folder: Path, keys: Mapping[str, Any]) -> tuple[Array, Array, Array | None]:
    """Return time [s], angle [rad] and velocity [rad/s] or None, up to where the time restarts."""

    def values(name: str) -> Array | None:
        if name not in keys:
            return None
        wanted = {**keys, **keys[name]}
        rows = table(folder, wanted)[:: int(keys.get('thin', 1))]
        return rows[:, wanted['column']] * float(wanted.get('unit', 1.0))

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
    """Return a file as numbers, shape (rows, columns); raises as `column`."""
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
    if path.suffix == '.json':
        rows = json.loads(data)[variable]
        return np.array([[float(row[name]) for name in sorted(row)] for row in rows])
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


Found = dict[str, Any]


def part(folder: str | None, lists: Iterable[str] = ()) -> Part:
    """Return the comparison by list, all by default, whose files are below `folder`."""
    if folder is None:
        raise UsageError(
            'their files are not shipped: give the folder of the repositories with --held-out'
        )
    frozen = yaml.safe_load(CONTACT.read_text(encoding='utf-8'))['frozen']
    read = {which: columns(Path(folder), which) for which in lists or LISTS}  # or a file is missing
    found = {}
    for which, (every, judged, excluded) in read.items():
        compare = compared(every, judged, frozen if which == 'contact' else None)
        sources = {each.name: each.keys['source'] for each in listed(which)}
        found[LISTS[which]] = {**compare, 'sources': sources, 'left_out': excluded}
    return found, describe(found)


def columns(
    folder: Path, which: str
) -> tuple[list[Column], dict[str, float], dict[str, list[str]]]:
    """Return the columns of a list, `judged` as in `Listed`, and names left out by reason."""
    chosen, found, excluded = listed(which), [], defaultdict(list)
    with progress(LISTS[which], len(chosen)) as advance:
        for each in chosen:
            made = column(folder, each)
            why = left_out(made) if which == 'contact' else ''
            if why:
                excluded[why].append(each.name)
            else:
                found.append(made)
            advance(1)
    return found, {each.name: each.judged for each in chosen}, dict(excluded)


def compared(
    columns: Sequence[Column],
    judged: Mapping[str, float],
    frozen: Mapping[str, float] | None = None,
) -> Found:
    """Return the comparison on these columns; `judged` as in `Listed`, by name.

    Parameters
    ----------
    frozen : gain of each baseline, the single best one first; by default they are swept.

    Returns
    -------
    rows : by series: name, reference and noise (its error [rad/s]); `result` by observer; single
    and best, rms of the single best baseline and of the best of the four [rad/s], which (name of
    the latter); judged, whether the reference is fine enough for the baselines' errors. single and
    common : the single best baseline and the settings of all, in words. ratios : see `summary`.
    """
    families = [law for law in ours() if law.name in BASELINES]
    if frozen is not None:
        families = [replace(law, values=(frozen[law.name],)) for law in families]
    swept = chosen(families, {'': columns}, floors=False)
    errors = {name: found[''][1] for name, found in swept.items()}
    means = {name: float(np.mean(np.log(each))) for name, each in errors.items()}
    single = next(iter(frozen)) if frozen is not None else min(means, key=lambda name: means[name])
    settings = {
        law.name: f'{law.name}, {law.gain} {number(float(swept[law.name][""][0]), 3)}'
        for law in families
    }
    rows = []
    with progress('observers', len(columns)) as advance:
        for j, one in enumerate(columns):
            which = min(errors, key=lambda name: errors[name][j])
            least = float(errors[which][j])
            rows.append(
                {
                    'series': one.name,
                    'reference': one.reference,
                    'noise': one.noise,
                    'results': {name: result(one, Entry(name, name)) for name in OBSERVERS},
                    'single': float(errors[single][j]),
                    'best': least,
                    'which': which,
                    'judged': bool(one.noise <= judged[one.name] * least),
                }
            )
            advance(1)
    ratios = {
        f'{name} / {baseline}': summary(rows, name, baseline)
        for name in OBSERVERS
        for baseline in ('single', 'best')
    }
    return {'rows': rows, 'single': settings[single], 'common': settings, 'ratios': ratios}


def summary(rows: Iterable[dict[str, Any]], observer: str, baseline: str) -> dict[str, Any]:
    """Return the ratios of the judged series over a baseline, 'single' or 'best'.

    Returns
    -------
    mean: geometric; at_most, near: shares at most 1.0 and `NEAR`; worst, and its series.
    """
    ratios = {
        row['series']: row['results'][observer]['rms'] / row[baseline]
        for row in rows
        if row['judged']
    }
    values = np.array(list(ratios.values()))
    worst = max(ratios, key=lambda name: ratios[name])
    return {
        'mean': float(np.exp(np.mean(np.log(values)))),
        'at_most': float(np.mean(values <= 1.0)),
        'near': float(np.mean(values <= NEAR)),
        'worst': ratios[worst],
        'series': worst,
    }


def as_csv(lists: Mapping[str, Found]) -> str:
    """Return the series of all lists as a file of benchmarks/results."""
    return csv_text(
        {
            'list': title,
            'series': row['series'],
            'judged': 'yes' if row['judged'] else 'no',
            'reference_error_rad_s': number(row['noise'], 2),
            'single_rms_rad_s': number(row['single'], 3),
            'best_of_four_rms_rad_s': number(row['best'], 3),
            'best_of_four': row['which'],
            **{
                key: value
                for name, found in row['results'].items()
                for key, value in (
                    (f'{name}_rms_rad_s', number(found['rms'], 3)),
                    *delay_and_coverage(found, f'{name}_').items(),
                )
            },
        }
        for title, found in lists.items()
        for row in found['rows']
    )


def by_source(lists: Mapping[str, Found]) -> Table:
    """Return the table of the sources: `edge_adaptive` over the single best baseline."""
    lines = []
    for title, found in lists.items():
        rows = defaultdict(list)
        for row in found['rows']:
            rows[found['sources'][row['series']]].append(row)
        for source, own in rows.items():
            judged = [row for row in own if row['judged']]
            if not judged:
                continue
            over = summary(judged, OBSERVERS[0], 'single')
            covered = [row['results'][OBSERVERS[0]]['coverage'] for row in judged]
            lines.append(
                (
                    source,
                    ' '.join(FIXED[title]),
                    f'{len(judged)}/{len(own)}',
                    fixed(over['mean'], 2),
                    f'{fixed(over["worst"], 2)}, {over["series"]}',
                    f'{100.0 * float(np.median(covered)):.0f}',
                )
            )
    header = ('source', 'fixed', 'judged', '/ single: mean', 'worst', 'covered [%]')
    return Table(header, lines)


def describe(lists: Mapping[str, Found]) -> Blocks:
    """Return the tables of all series and sources, and lines that summarise each list."""
    lines = []
    for title, found in lists.items():
        for row in found['rows']:
            single, best = row['single'], row['best']
            cells = [row['series'] + ('' if row['judged'] else ' *'), number(row['noise'], 2)]
            cells += [number(single, 3), f'{number(best, 3)}, {row["which"]}']
            for each in row['results'].values():
                rms = each['rms']
                cells += [number(rms, 3), fixed(rms / single, 2), fixed(rms / best, 2)]
                cells.append(f'{100.0 * each["coverage"]:.0f} %')
                cells.append(fixed(1e3 * each['delay_s'], 1))
            lines.append((title, *cells))
    header = ['list', 'series', 'reference', 'single', 'best of four']
    for observer in OBSERVERS:
        header += [observer, '/ single', '/ best', 'covered', 'late [ms]']
    return [
        'held-out recordings: velocity rms error [rad/s], observers at their defaults',
        Table(header, lines),
        "*: not judged: the reference's own error is more than half of the best baseline's",
        by_source(lists),
        *('\n'.join(_summarised(title, found)) for title, found in lists.items()),
    ]


def _summarised(title: str, found: Found) -> Iterable[str]:
    yield f'{title}: single: {found["single"]}; best of four: {"; ".join(found["common"].values())}'
    for why, names in found.get('left_out', {}).items():
        yield f'- left out, {why}: {", ".join(names)}'
    for name, over in found['ratios'].items():
        yield (
            f'- {name}: geometric mean {over["mean"]:.2f}; at most 1.0 on {over["at_most"]:.0%}, '
            f'at most {NEAR} on {over["near"]:.0%}; worst {over["worst"]:.2f}, {over["series"]}'
        )
    for name in OBSERVERS:
        covered = [row['results'][name]['coverage'] for row in found['rows'] if row['judged']]
        yield (
            f'- {name}: the 95 % interval covers {100.0 * float(np.median(covered)):.0f} % '
            f'(median), {100.0 * min(covered):.0f} % at least'
        )
