"""One bag's estimates held against its truth: recorded estimates, or observers run on the spot."""

from __future__ import annotations

import ctypes
import tempfile
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.series import Series
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.compare import metrics
from estimator_pkg.evaluation.compare.matching import match
from estimator_pkg.evaluation.compare.sources import Estimate, measured, sources
from estimator_pkg.evaluation.compare.truth import SMOOTHED, Truth, check_common, truth
from estimator_pkg.evaluation.options import Options
from estimator_pkg.evaluation.reference.reference import Reference
from estimator_pkg.evaluation.reference.smoother.smoother import Smoothed
from estimator_pkg.evaluation.text import number
from estimator_pkg.streams.contract import WHY_DROPPED

MMAP_THRESHOLD = -3  # glibc's malloc.h
LONG = 8_000_000  # bytes; shorter arrays stay in memory


def give_back_freed() -> None:
    """From now on, freed arrays go back to the system at once.

    The C library (glibc) learns to keep those of up to 32 MB, and then loses what lies between
    them to larger ones: of an hour at 1 kHz, a seventh of the memory.
    """
    with suppress(OSError, AttributeError, TypeError):  # another library, another system
        ctypes.CDLL(None).mallopt(MMAP_THRESHOLD, LONG // 2)


class Kept:
    """An array, in a file without a name if it is long; gone when nobody refers to it.

    It stays in memory where the file cannot be written. Another process gets the array itself.

    Parameters
    ----------
    values : shape (n,).
    """

    def __init__(self, values: NDArray) -> None:
        self._values: NDArray | None = values
        self._type = values.dtype
        self._file: BinaryIO | None = None
        if values.nbytes >= LONG:
            try:
                file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115  (open as long as this)
                values.tofile(file)
            except OSError:
                return
            self._file, self._values = file, None

    def get(self) -> NDArray:
        """The array; not to be written to."""
        if self._file is None:
            assert self._values is not None
            return self._values
        self._file.seek(0)
        return np.fromfile(self._file, self._type)

    def __reduce__(self) -> tuple[Any, ...]:
        return Kept, (self.get(),)


Array = NDArray[np.float64]

BAND = 1.96  # standard deviations that should hold 95 % of the errors
MANY = 1_000_000  # samples whose arrays are worth giving back
ROUNDING = 1e-10  # [s], [rad/s] what is this close is the same


@dataclass(frozen=True)
class Row:
    """One estimate of one joint, compared.

    validity : seconds by status, or published and withheld.
    coverage : the part of the errors within the 95 % band, to which the reference's own noise is
        added; nan without a standard deviation.
    reference_cannot_tell : the error is no larger than what the reference itself may be wrong by.
    reference_noise : what the reference itself may be wrong by [rad/s].
    time : shape (m,) [s]; truth, estimate, stddev : shape (m,), velocities at these times; the last
        two are read anew whenever they are asked for.
    status_time, status : shape (k,), of every sample that was used; empty where it is not known.
    """

    source: str
    joint: str
    velocity: dict[str, Any]
    position: dict[str, Any]
    samples: dict[str, Any]
    matched: dict[str, int]
    validity: dict[str, float]
    coverage: float
    reference_cannot_tell: bool
    time: Array
    truth: Array
    kept_estimate: Kept
    kept_stddev: Kept
    reference_noise: float
    status_time: NDArray[np.floating]
    status: NDArray[np.int8]

    @property
    def estimate(self) -> Array:
        """See above."""
        return self.kept_estimate.get()

    @property
    def stddev(self) -> Array:
        """See above."""
        return self.kept_stddev.get()

    def as_dict(self) -> dict[str, Any]:
        """For ``--json``."""
        return {
            'velocity': self.velocity,
            'position': self.position,
            'samples': self.samples,
            'matched': self.matched,
            'validity_s': self.validity,
            'coverage_95': self.coverage,
            'reference_cannot_tell': self.reference_cannot_tell,
        }


@dataclass(frozen=True)
class Comparison:
    """What one bag gives: rows, and what is known of the reference of each joint.

    measurement : the measured positions by joint; starts : their first stamps [ns].
    smoothed : how the off-line smoother came by the reference; empty where there is a truth.
    refused : why observers are not ranked, by joint.
    """

    bag: str
    truth: str
    rows: tuple[Row, ...]
    references: dict[str, Reference]
    corrected: dict[str, dict[str, float]]
    notes: tuple[str, ...]
    measurement: dict[str, Series]
    starts: dict[str, int]
    smoothed: dict[str, Smoothed]
    refused: dict[str, str]

    def as_dict(self) -> dict[str, Any]:
        """For ``--json``."""
        estimates: dict[str, Any] = {}
        for row in self.rows:
            estimates.setdefault(row.source, {'joints': {}})['joints'][row.joint] = row.as_dict()
        return {
            'truth': self.truth,
            'estimates': estimates,
            'reference': {
                joint: {
                    **known.as_dict(),
                    'corrected': self.corrected.get(joint, {}),
                    'smoother': _smoother(self.smoothed.get(joint)),
                }
                for joint, known in self.references.items()
            },
            'refused': self.refused,
            'notes': list(self.notes),
        }


def compare(path: str, options: Options) -> Comparison:
    """Everything that can be said of the estimates in the bag at `path`.

    Raises
    ------
    UserError : no truth, no estimates, no joint in common, no overlap in time; one line each, with
        what there is instead.
    """
    with open_bag(path, options.unpack_limit) as bag:
        measurement = measured(bag, options)
        true = truth(bag, path, measurement, options)
        if any(len(series.stamps_ns) >= MANY for series in true.series.values()):
            give_back_freed()
        rows: list[Row] = []
        notes: list[str] = []
        starts = {joint: _start(series) for joint, series in {**true.series, **measurement}.items()}
        for source, estimates in sources(bag, path, measurement, options):
            check_common(path, source, estimates, true)
            for joint, estimate in estimates.items():
                if joint not in true.series:
                    notes.append(f"joint '{joint}' has no truth")
                elif not len(estimate.stamps):
                    notes.append(
                        f"{source}: joint '{joint}' has no valid estimate" + _all_dropped(estimate)
                    )
                else:
                    try:
                        row = _row(
                            source,
                            joint,
                            estimate,
                            true.series[joint],
                            starts[joint],
                            true.references[joint],
                            options,
                        )
                        rows.append(_sharing(row, rows))
                    except UserError as error:
                        raise UserError(f"{path}: {source}, joint '{joint}': {error}") from None
            estimates.clear()
            del estimate  # before the next observer makes its own
        if not rows:
            raise UserError(f'{path}: nothing to compare: ' + '; '.join(dict.fromkeys(notes)))
    return Comparison(
        path,
        true.name,
        tuple(rows),
        true.references,
        true.corrected,
        tuple(dict.fromkeys(notes)),
        measurement,
        starts,
        true.smoothed,
        _refusals(true, rows),
    )


def _all_dropped(estimate: Estimate) -> str:
    """Why there is no estimate, where one cause is behind all of it."""
    for kind, count in estimate.samples['dropped'].items():
        if count == estimate.samples['received']:
            return f': {WHY_DROPPED.get(kind, kind)}'
    return ''


def _row(
    source: str,
    joint: str,
    estimate: Estimate,
    truth: Series,
    start: int,
    known: Reference,
    options: Options,
) -> Row:
    matched = match(
        estimate.stamps, truth.stamps_ns, truth.velocity, truth.position, options.wrap_period
    )
    if not len(matched.rows):
        raise UserError(
            f'estimates ({_span(estimate.stamps)}) and truth ({_span(truth.stamps_ns)})'
            ' do not overlap in time'
        )
    elapsed = matched.time + (int(estimate.stamps[matched.rows[0]]) - start) * 1e-9
    left = np.flatnonzero(elapsed >= options.skip)
    if not len(left):
        raise UserError(f'nothing is left after the first {options.skip:g} s')
    # mostly all, or all from some one on: views take no memory
    kept = slice(left[0], None) if len(left) == len(elapsed) - left[0] else left
    del left
    rows, time, true = matched.rows[kept], matched.time[kept], matched.velocity[kept]
    velocity, stddev = estimate.velocity[rows], estimate.velocity_stddev[rows]
    if np.isinf(stddev).any():  # not known: no band, no coverage
        stddev = np.where(np.isinf(stddev), np.nan, stddev)
    noise = known.noise if np.isfinite(known.noise) else 0.0
    speeds = metrics.velocity(time, velocity, true, noise)
    angles = metrics.position(
        time, estimate.position[rows], matched.position[kept], options.wrap_period
    )
    counts = {
        'estimates': len(estimate.stamps),
        'compared': len(rows),
        'interpolated': len(matched.rows) - matched.exact,
        'unmatched': matched.unmatched,
    }
    return Row(
        source,
        joint,
        speeds,
        angles,
        estimate.samples,
        counts,
        estimate.validity,
        coverage(velocity - true, np.hypot(stddev, noise)),
        known.cannot_tell(speeds['rms']),
        elapsed[kept],
        true,
        Kept(velocity),
        Kept(stddev),
        noise,
        (estimate.status_stamps - start) * 1e-9,
        estimate.status,
    )


def _sharing(row: Row, others: list[Row]) -> Row:
    """The row; what another one has too (mostly its last part) is held only once."""

    def shared(name: str) -> Array:
        values: Array = getattr(row, name)
        for other in others:
            longer: Array = getattr(other, name)
            tail = longer[max(0, len(longer) - len(values)) :]
            if len(tail) == len(values) and not np.any(np.abs(tail - values) > ROUNDING):
                return tail
        return values

    return replace(
        row, time=shared('time'), truth=shared('truth'), status_time=shared('status_time')
    )


def coverage(errors: Array, stddev: Array) -> float:
    """The part of the errors within 1.96 standard deviations; nan where none is known."""
    known = np.isfinite(errors) & np.isfinite(stddev)
    if not known.any():
        return np.nan
    return float(np.mean(np.abs(errors[known]) <= BAND * stddev[known]))


def _refusals(true: Truth, rows: list[Row]) -> dict[str, str]:
    """Why the smoother cannot rank the observers, by joint where it cannot."""
    refused = {}
    for joint, smoothed in true.smoothed.items():
        errors = [row.velocity['rms'] for row in rows if row.joint == joint]
        if errors and true.references[joint].cannot_tell(min(errors)):
            if smoothed.seldom:
                refused[joint] = (
                    f'no ranking of {joint}: its reading changes '
                    f'{smoothed.changes} times in all, too seldom to tell how it '
                    'moves'
                )
                continue
            because = ''
            if smoothed.unexplained > 0.5 * smoothed.uncertainty:
                because = ', because the readings hold a fast motion that it takes for noise'
            refused[joint] = (
                f'no ranking of {joint}: {SMOOTHED} may itself be wrong by '
                f'{number(smoothed.uncertainty, 2)} rad/s rms{because}, and the best estimate '
                f'differs from it by {number(min(errors), 2)}'
            )
    return refused


def _smoother(found: Smoothed | None) -> dict[str, Any] | None:
    """For ``--json``."""
    if found is None:
        return None
    return {
        'uncertainty': found.uncertainty,
        'unexplained': found.unexplained,
        'reading_stddev': found.noise.reading,
        'jerk_intensity': found.noise.jerk,
        'quantum': found.noise.quantum,
        'at_quantisation_floor': found.noise.at_floor,
        'outliers': found.outliers,
    }


def _start(series: Series) -> int:
    """The first stamp that is one [ns]."""
    good = series.stamps_ns[series.stamps_ns > 0]
    return int(good[0]) if len(good) else 0


def _span(stamps: NDArray[np.int64]) -> str:
    return f'{np.min(stamps) * 1e-9:.3f} to {np.max(stamps) * 1e-9:.3f} s'
