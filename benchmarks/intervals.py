# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The 95 % interval of every angle observer on every recording, with and without its calibration.

    python -m benchmarks accuracy --part interval

The streams are the recordings, the Hall captures, the motions of `motions`, and starts, bursts,
slow motions and gaps. The constants of the calibration were chosen on half of them: see `held_out`.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks import moteus, motions
from benchmarks.accuracy import interval_score
from benchmarks.columns import Column
from benchmarks.recordings import recorded
from benchmarks.signals import Samples, encoder
from estimator_pkg.driver.batch import Estimates
from estimator_pkg.driver.joint import Joint
from estimator_pkg.errors import UserError
from estimator_pkg.estimate import COASTING, TRACKING
from estimator_pkg.evaluation.entries import Entry, at_defaults
from estimator_pkg.evaluation.text import fixed, markdown, number, table
from estimator_pkg.progress import progress

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Speed = Callable[[Array], Array]

TURN = 2.0 * math.pi
HALL = 360_000  # samples of a Hall capture
STOOD, START = 0.2, 0.3  # [s] at rest before a start; its length
HOLE, AFTER = 0.1, 0.5  # [s] a gap; the time after it
SLOW = 20.0  # quanta/s: a speed below it is slow
FEWEST = 50  # samples from which a part of a stream is judged
KINDS = {'rec': 'recordings', 'hall': 'Hall captures', 'mot': 'motions', 'own': 'hard motions'}


class Motion(NamedTuple):
    """A speed [rad/s] over time [s], read by an encoder; without samples in the `holes` [s]."""

    speed: Speed
    length: float
    rate: float
    counts: int
    noise: float = 0.0
    jitter: float = 0.0
    hole: float = 0.0


def ramps(acceleration: float, speed: float, move: float, rest: float) -> Speed:
    """Return a motion from rest to `speed` [rad/s] and back, in turns to either side."""

    def at(time: Array) -> Array:
        cycle, within = np.divmod(time, move + rest)
        ramp = np.minimum((within - rest) * acceleration, (move + rest - within) * acceleration)
        return np.where(cycle % 2 == 0, 1.0, -1.0) * np.clip(ramp, 0.0, speed)

    return at


def bursts(speed: float, size: float, hz: float, every: float, length: float) -> Speed:
    """Return a constant speed with a sine for `length` [s] in `every` [s]."""

    def at(time: Array) -> Array:
        within = time % every
        return speed + np.where(within < length, size * np.sin(TURN * hz * within), 0.0)

    return at


def slow(speed: float, hz: float) -> Speed:
    """Return a slow speed [rad/s] that varies by half."""
    return lambda time: speed * (1.0 + 0.5 * np.sin(TURN * hz * time))


def slow_and_fast(speed: float, fast: float, every: float) -> Speed:
    """Return a slow speed [rad/s] that rises to a fast one in 0.1 s, and falls again."""

    def at(time: Array) -> Array:
        within = time % every
        rise = np.clip((within - 0.5 * every) / 0.1, 0.0, 1.0)
        return speed + (fast - speed) * np.minimum(rise, np.clip((every - within) / 0.1, 0.0, 1.0))

    return at


def sine(size: float, hz: float) -> Speed:
    """Return a sine of speed [rad/s]."""
    return lambda time: size * np.sin(TURN * hz * time)


HARD: dict[str, Motion] = {
    f'{name} {rate}/{bits}': Motion(speed, 12.0, rate, 2**bits)
    for rate in (1000, 200, 100)
    for bits in (12, 17)
    for name, speed in (
        ('start acc40', ramps(40.0, 8.0, 1.0, 1.0)),
        ('start jump', ramps(1e6, 5.0, 1.0, 1.0)),
        ('bursts', bursts(0.3, 3.0, 6.0, 2.0, 0.5)),
    )
} | {
    'start acc300 1000/12': Motion(ramps(300.0, 20.0, 0.6, 0.6), 12.0, 1000, 4096),
    'start acc5 500/13 noise': Motion(ramps(5.0, 2.0, 1.5, 0.8), 14.0, 500, 8192, 1e-3),
    'creep .005 1000/12': Motion(slow(0.005, 0.1), 20.0, 1000, 4096),
    'creep .02 500/11': Motion(slow(0.02, 0.2), 20.0, 500, 2048),
    'creep .1 200/10': Motion(slow(0.1, 0.2), 20.0, 200, 1024),
    'creep .02 100/14': Motion(slow(0.02, 0.3), 20.0, 100, 16384),
    'creep-fast 1000/12': Motion(slow_and_fast(0.02, 6.0, 3.0), 18.0, 1000, 4096),
    'creep-fast 200/10': Motion(slow_and_fast(0.05, 10.0, 3.0), 18.0, 200, 1024),
    'gaps .05 1000/12': Motion(sine(5.0, 0.7), 13.0, 1000, 4096, hole=0.05),
    'gaps .25 1000/12': Motion(sine(5.0, 0.7), 13.0, 1000, 4096, hole=0.25),
    'gaps .7 500/14': Motion(sine(3.0, 0.5), 13.0, 500, 16384, hole=0.7),
    'gaps .3 200/12 noise': Motion(sine(3.0, 0.5), 13.0, 200, 4096, 1e-3, 0.3, 0.3),
    'gaps .25 const 1000/12': Motion(
        lambda time: np.full(len(time), 3.0), 13.0, 1000, 4096, hole=0.25
    ),
}


def sampled(name: str, motion: Motion) -> Samples:
    """Return the readings of a hard motion; the same each time."""
    random = np.random.default_rng(sum(map(ord, name)) * 7919)
    count = round(motion.length * motion.rate)
    time = (np.arange(count) + 1.0 + motion.jitter * random.uniform(-1.0, 1.0, count)) / motion.rate
    if motion.hole:
        begins = 2.3 + 1.7 * np.arange(6)
        inside = (time[:, None] > begins) & (time[:, None] < begins + motion.hole)
        time = time[~inside.any(axis=1)]
    fine = np.arange(0.0, motion.length + 0.1, 1e-4)
    speed = motion.speed(fine)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * 1e-4)])
    position = np.interp(time, fine, angle) + random.uniform(0.0, TURN)
    position += random.normal(0.0, max(motion.noise, 1e-12), len(time))
    stamps = motions.START_NS + np.rint(time * 1e9).astype(np.int64)
    return Samples(stamps, encoder(position, motion.counts), np.interp(time, fine, speed))


def columns(folder: Path | None) -> list[Column]:
    """Return all streams; without those below `folder` if it is None or has no recordings."""
    found = []
    if folder is not None:
        try:
            found += [_named('rec', column) for column in recorded(folder)[0]]
            for column in moteus.columns(folder / moteus.FOLDER):
                stamps, angle, speed = column.samples
                samples = Samples(stamps[:HALL], angle[:HALL], speed[:HALL])
                found.append(_named('hall', column, samples))
        except UserError as error:
            print(f'recordings: not all run: {error}: give their folder with --bags\n')
    for name, (_, sensor) in {**motions.MOTIONS, **motions.FAILURES}.items():
        samples = Samples(*motions.sampled(name))
        found.append(Column(f'mot {name}', '', samples, TURN / sensor.counts, skip=0.0))
    for name, motion in HARD.items():
        samples = sampled(name, motion)
        found.append(Column(f'own {name}', '', samples, TURN / motion.counts, skip=0.0))
    return found


def _named(kind: str, column: Column, samples: Samples | None = None) -> Column:
    return Column(
        f'{kind} {column.name}',
        column.summary,
        samples or column.samples,
        column.quantum,
        column.skip,
        column.noise,
    )


def held_out(name: str) -> bool:
    """Return True for the half of the streams on which no constant was chosen."""
    return name.startswith('hall') or zlib.crc32(name.encode()) % 2 == 1


def parts(column: Column) -> dict[str, Mask]:
    """Return the samples of a stream by part.

    'all'; 'after a gap'; and where the truth is exact: 'start' (after a rest), 'slow' (below `SLOW`
    quanta/s) and 'hard' (acceleration above its rms).
    """
    time, speed = column.time, column.samples.velocity
    found = {'all': np.ones(len(time), bool)}
    found['after a gap'] = _after(time, np.diff(time, prepend=time[0]) > HOLE, AFTER)
    if column.noise == 0.0 and column.name.startswith(('mot', 'own')):
        rests = np.abs(speed) < 1e-9
        stood = time - np.maximum.accumulate(np.where(rests, time[0], time))
        begins = ~rests & (np.concatenate([[0.0], stood[:-1]]) > STOOD)
        found['start'] = _after(time, begins, START)
        found['slow'] = ~rests & (np.abs(speed) < SLOW * column.quantum)
        acceleration = np.gradient(speed, time)
        found['hard'] = np.abs(acceleration) > np.sqrt(np.mean(acceleration**2)) + 1e-9
    return found


def _after(time: Array, begins: Mask, length: float) -> Mask:
    last = np.maximum.accumulate(np.where(begins, time, -math.inf))
    return time - last < length


def uncalibrated(joint: Joint, samples: Samples) -> Estimates:
    """Return the estimates with the standard deviation as the observer makes it."""
    alone = Joint(joint.observer, joint.gains, joint.settings)
    alone.learner = None
    with alone._changing() as channel:
        channel.track.calibration.quantum = -1e6  # no step is smaller, and it hides every error
    return alone.run(samples.stamps, samples.angle)


def run(found: list[Column], entries: Iterable[Entry] | None = None) -> list[dict[str, Any]]:
    """Return one row per observer, stream and part of the stream.

    The keys of a row: observer, stream, part, held_out, coarse (the reference's own error exceeds
    the standard deviation), and coverage, width and score (see `interval_score`), of the observer
    alone with `_alone`. The reference's own error is part of the interval.
    """
    rows = []
    chosen = list(at_defaults() if entries is None else entries)
    with progress('intervals', len(chosen) * len(found)) as advance:
        for entry in chosen:
            joint = entry.joint()
            for column in found:
                joint.reset()
                stamps, angle, truth = column.samples
                out = joint.run(stamps, angle)
                alone = uncalibrated(joint, column.samples).velocity_stddev
                valid = (out.status == TRACKING) | (out.status == COASTING)
                time = column.time
                valid &= (time >= column.skip) & np.isfinite(truth) & np.isfinite(out.velocity)
                valid &= np.isfinite(out.velocity_stddev)
                for part, mask in parts(column).items():
                    rows_of = valid & mask
                    if np.count_nonzero(rows_of) < FEWEST:
                        continue
                    error = (out.velocity - truth)[rows_of]
                    row: dict[str, Any] = {
                        'observer': entry.label,
                        'stream': column.name,
                        'part': part,
                        'held_out': held_out(column.name),
                        'coarse': bool(column.noise > np.median(out.velocity_stddev[rows_of])),
                    }
                    for key, sigma in (('', out.velocity_stddev), ('_alone', alone)):
                        numbers = interval_score(error, np.hypot(sigma[rows_of], column.noise))
                        row |= dict(zip((f'coverage{key}', f'width{key}', f'score{key}'), numbers))
                    rows.append(row)
                advance(1)
    return rows


def summary(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Return the median, tenth percentile and minimum of the coverage, alone and calibrated.

    width, score : geometric means of the ratios, calibrated over alone; worst : of the score.
    """
    found: dict[str, float] = {'streams': float(len(rows))}
    for key in ('_alone', ''):
        covered = np.array([row[f'coverage{key}'] for row in rows])
        found |= {
            f'median{key}': float(np.median(covered)),
            f'tenth{key}': float(np.quantile(covered, 0.1)),
            f'least{key}': float(np.min(covered)),
        }
    for key in ('width', 'score'):
        ratio = np.array([row[key] / row[f'{key}_alone'] for row in rows])
        found[key] = float(np.exp(np.mean(np.log(ratio))))
    found['worst'] = float(np.max([row['score'] / row['score_alone'] for row in rows]))
    return found


def describe(rows: list[dict[str, Any]], as_markdown: bool = False) -> str:
    """Return a line per stream with a cell per observer, and the summaries."""
    draw = markdown if as_markdown else table
    observers = list(dict.fromkeys(row['observer'] for row in rows))
    cells: dict[str, dict[str, str]] = {}
    for row in rows:
        if row['part'] == 'all':
            cells.setdefault(row['stream'] + (' *' if row['held_out'] else ''), {})[
                row['observer']
            ] = (
                f'{_percent(row["coverage"])}{" <" if row["coarse"] else ""} '
                f'{number(row["width"], 3)} {number(row["score"], 3)}'
            )
    lines = [(name, *(cell.get(each, '-') for each in observers)) for name, cell in cells.items()]
    return (
        'covered [%], mean width and score [rad/s] of the 95 % interval; *: no constant was chosen '
        'on this stream; <: the reference is coarser than the standard deviation\n'
        + draw(('stream', *observers), lines)
        + '\n\nwithout -> with calibration: part of the samples that is covered [%]; ratios of '
        'width and score, geometric means over the streams\n' + describe_summaries(rows, draw)
    )


def _is_of_kind(kind: str, held_out: bool, row: dict[str, Any]) -> bool:
    """Return True for a row of a whole stream of this kind."""
    whole: bool = row['part'] == 'all' and row['stream'].startswith(kind)
    return whole and row['held_out'] == held_out


def _is_part(part: str, row: dict[str, Any]) -> bool:
    return bool(row['part'] == part)


def describe_summaries(rows: list[dict[str, Any]], draw: Callable[..., str] = table) -> str:
    """Return a line per observer and group of streams, or part of them."""
    groups: list[tuple[str, Callable[[dict[str, Any]], bool]]] = [
        (f'{title}, {"held out" if held else "chosen on"}', partial(_is_of_kind, kind, held))
        for kind, title in KINDS.items()
        for held in (False, True)
    ]
    groups += [
        (part, partial(_is_part, part)) for part in ('all', 'start', 'hard', 'slow', 'after a gap')
    ]
    lines = []
    for observer in dict.fromkeys(row['observer'] for row in rows):
        for title, belongs in groups:
            mine = [row for row in rows if row['observer'] == observer and belongs(row)]
            if mine:
                found = summary(mine)
                lines.append(
                    (
                        observer,
                        title,
                        str(len(mine)),
                        *(
                            f'{_percent(found[f"{key}_alone"])} -> {_percent(found[key])}'
                            for key in ('median', 'tenth', 'least')
                        ),
                        fixed(found['width'], 2),
                        fixed(found['score'], 2),
                        fixed(found['worst'], 2),
                    )
                )
    return draw(
        (
            'observer',
            'streams',
            'n',
            'median',
            'a tenth below',
            'least',
            'width',
            'score',
            'worst score',
        ),
        lines,
    )


def _percent(part: float) -> str:
    return fixed(100.0 * part, 1)
