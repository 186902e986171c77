# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A log of angles, .csv, .mat or .npz, as a bag with one topic of JointStates.

A plain CSV and .npz need NumPy alone. A CSV with decimal commas, dates or cells that are no numbers
needs pandas, .mat needs SciPy.
"""

from __future__ import annotations

import argparse
import csv
import io
import math
import re
import shlex
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.reader import Bag, PendingBlock, Topic
from estimator_pkg.errors import UsageError, UserError, first_line, suggestion
from estimator_pkg.messages.block import Block
from estimator_pkg.messages.cdr import LATEST
from estimator_pkg.messages.joint_state import TYPE, Encoder
from estimator_pkg.messages.joint_state_block import encode_block
from estimator_pkg.optional import Lazy
from estimator_pkg.stamps import UNITS, stamps_of

pandas = Lazy('pandas')
scipy_io = Lazy('scipy.io')

SUFFIXES = ('.csv', '.mat', '.npz')
TOPIC = '/joint_states'
COUNT = 'count'
ANGLE_UNITS = {'rad': 1.0, 'deg': math.pi / 180.0, COUNT: math.nan, 'm': 1.0, 'mm': 1e-3}
PRISMATIC = ('m', 'mm')
WRITTEN = {'°': 'deg', 'counts': COUNT, 'ticks': COUNT, 'µs': 'us', 'sec': 's'}  # units in names
IN_NAME = re.compile(r'[\[(]\s*([^\])]+?)\s*[\])]\s*$')  # as in 'theta [deg]'
TIMES = re.compile(r't$|t\W|.*(time|stamp|zeit|sec)', re.IGNORECASE)
ANGLES = re.compile(r'q\d*$|.*(ang|pos|theta|phi|enc)', re.IGNORECASE)
HEAD = 2**16  # characters in which the first row of numbers is looked for
LISTED = 20  # names in an error
ROWS = 20_000  # messages of a block

Table = Mapping[str, Callable[[], NDArray[Any]]]  # column name -> reads it


class Unit(NamedTuple):
    """The unit of a kind of columns: its option, its default, those that are known."""

    option: str
    default: str
    known: Iterable[str]

    def words(self, name: str) -> str:
        """Return the option for the unit in a column's name; '' for none, and for the default."""
        found = IN_NAME.search(name)
        unit = WRITTEN.get(found[1], found[1]) if found else ''
        if unit not in self.known or unit == self.default:
            return ''
        return f'{self.option} {unit}' + (' --counts N' if unit == COUNT else '')

    def of(self, names: Iterable[str], given: str | None, line: str) -> str:
        """Return the unit of columns; raise UsageError if a name has another than the default."""
        for name in names if given is None else ():
            if words := self.words(name):
                raise UsageError(
                    f"'{name}' is in {words.split()[1]}: add {words} (or {self.option} "
                    f'{self.default}, if the name is wrong), as in: {line} {words}'
                )
        return given or self.default


OF_TIME, OF_ANGLE = Unit('--time-unit', 's', UNITS), Unit('--unit', 'rad', ANGLE_UNITS)


@dataclass(frozen=True)
class Columns:
    """The columns of a log that are read.

    line : the command line, to which an error adds the options that are missing.
    time, angles : names; None or empty: not known.
    time_unit, unit : None: s and rad, unless the names contain another.
    counts : of a turn, for the unit 'count'.
    """

    line: str
    time: str | None = None
    time_unit: str | None = None
    angles: tuple[str, ...] = ()
    unit: str | None = None
    counts: float | None = None

    @property
    def prismatic(self) -> bool:
        """True for lengths, which do not wrap."""
        return self.unit in PRISMATIC


def is_log(path: str | Path) -> bool:
    """Return True if the name is that of a log."""
    return Path(path).suffix.lower() in SUFFIXES


def arguments(parser: argparse.ArgumentParser, metavar: str = 'TOPIC:FIELD') -> None:
    """Add the option ``--angle``, and those of logs."""
    parser.add_argument(
        '--angle',
        action='append',
        metavar=metavar,
        help='the measurement is a number in messages of any type, for example '
        '/odom:pose.pose.orientation.yaw or /encoder:data (--wrap-period 0, or in replay --set '
        'wrap_period=0, for one that does not wrap); of a log a column, repeatable',
    )
    group = parser.add_argument_group('logs (.csv, .mat, .npz)')
    group.add_argument('--time', metavar='COLUMN', help='time of the angles')
    group.add_argument(
        '--time-unit', choices=UNITS, help='default s; the dates in a column have none'
    )
    group.add_argument('--unit', choices=ANGLE_UNITS, help='of the angles (default rad)')
    group.add_argument(
        '--counts', type=float, metavar='N', help='counts of a turn, with --unit count'
    )


def columns(parsed: argparse.Namespace) -> Columns | None:
    """Return the columns of the logs among the arguments; None for bags.

    `parsed.angle` becomes ``TOPIC:FIELD`` of a bag or None, and `parsed.wrap_period` of lengths 0.

    Raises
    ------
    UsageError : the options are wrong, or do not fit the files.
    """
    named = [getattr(parsed, name, None) for name in ('bag', 'bags', 'judge')]
    paths = [path for each in named for path in ([each] if isinstance(each, str) else each or ())]
    logs = [path for path in paths if is_log(path)]
    angles = tuple(dict.fromkeys(parsed.angle or ()))
    of_logs = {name: getattr(parsed, name) for name in ('time', 'time_unit', 'unit', 'counts')}
    if not logs:
        wrong = [name.replace('_', '-') for name, value in of_logs.items() if value is not None]
        if wrong:
            raise UsageError(f'--{wrong[0]} is for logs ({", ".join(SUFFIXES)}): omit it')
        if len(angles) > 1:
            raise UsageError('--angle: of a bag one TOPIC:FIELD can be read: omit the others')
        parsed.angle = angles[0] if angles else None
        return None
    if len(logs) < len(paths):
        raise UsageError(f'{logs[0]} is a log, others are bags: name logs or bags')
    counts = parsed.counts
    if (parsed.unit == COUNT) != (counts is not None):
        raise UsageError('--unit count and --counts N (counts of a turn) go together')
    if counts is not None and not 1.0 <= counts < math.inf:
        raise UsageError(f'--counts is {counts:g}: it must be 1 or more')
    found = Columns(parsed.line, angles=angles, **of_logs)
    parsed.angle = None
    if found.prismatic and getattr(parsed, 'wrap_period', 0.0) is None:  # not set by the user
        parsed.wrap_period = 0.0
    return found


class LogFile:
    """A log as the file of a bag, see `estimator_pkg.bags.reader`.

    Parameters
    ----------
    wanted : its columns; None: those of a command that reads bags only.

    Raises
    ------
    UserError, UsageError : it cannot be read, or has no such columns.
    """

    SORTS = True

    def __init__(self, path: Path, bag: Bag, wanted: Columns | None) -> None:
        self.path, self._bag = path, bag
        with _readable(path):
            table = _table(path)
            if wanted is None or not (wanted.time and wanted.angles):
                raise UsageError(_without_columns(path, list(table), wanted))
            for name in (wanted.time, *wanted.angles):
                if name not in table:
                    near = suggestion(name, table)
                    hint = near if 'mean' in near else f'it has {_listing(list(table))}'
                    raise UsageError(f"{path} has no column '{name}': {hint}")
            self._stamps = self._read_stamps(wanted.time, wanted, table[wanted.time]())
            unit = OF_ANGLE.of(wanted.angles, wanted.unit, wanted.line)
            factor = 2.0 * math.pi / wanted.counts if wanted.counts else ANGLE_UNITS[unit]
            angles = [self._read_angle(name, table[name]()) for name in wanted.angles]
        self._names, self._angles = wanted.angles, factor * np.column_stack(angles)
        if not np.isfinite(self._angles).any():
            raise UserError(
                f"{path}: column '{wanted.angles[0]}' has no number: name another with --angle"
            )
        self._number = bag.number(Topic(TOPIC, TYPE, len(self._stamps)))

    def _read_stamps(self, name: str, wanted: Columns, times: NDArray[Any]) -> NDArray[np.int64]:
        unit = OF_TIME.of([name], wanted.time_unit, wanted.line)
        where = f"{self.path}, column '{name}'"
        latest = 0
        if times.dtype.kind in 'iuf':
            latest = times[np.isfinite(times)].max(initial=0)
        if latest > LATEST / UNITS[unit]:
            fits = [each for each in UNITS if latest <= LATEST / UNITS[each]] or ['UNIT']
            raise UsageError(
                f'{where} has {latest} {unit}, after the year 2038: add --time-unit {fits[0]}'
            )
        try:
            stamps = stamps_of(times, unit, after_zero=True)
        except UsageError as error:
            raise UsageError(f'{where}: {error}') from error
        if not stamps.any():
            raise UsageError(f'{where} has no time: name another with --time')
        return stamps

    def _read_angle(self, name: str, values: NDArray[Any]) -> NDArray[np.float64]:
        if values.shape != self._stamps.shape:
            raise UsageError(
                f"{self.path}: column '{name}' has {len(values)} rows, the time "
                f'{len(self._stamps)}: name others'
            )
        numbers = values.astype(np.float64)
        missing = int(np.count_nonzero(np.isnan(numbers)))
        if missing:
            self._bag.warn(
                f"{self.path}: {missing} of {len(numbers)} cells of column '{name}' are no numbers "
                'and are dropped'
            )
        return numbers

    def pieces(self, keep: np.ndarray) -> Iterator[PendingBlock]:
        """Yield the messages, in the order of the rows; none is recorded before another."""
        log_ns = _increasing(self._stamps)
        for first in range(0, len(self._stamps), ROWS):
            rows = slice(first, first + ROWS)
            load = partial(self._load, rows, log_ns[rows])
            yield PendingBlock(int(log_ns[first]), self._angles[rows].nbytes, load)

    def _load(self, rows: slice, log_ns: NDArray[np.int64]) -> Block:
        raw = encode_block(Encoder(), self._stamps[rows], '', self._names, self._angles[rows])
        count, size = raw.shape
        start = size * np.arange(count)
        topic = np.full(count, self._number)
        return Block(topic, log_ns, log_ns, raw.ravel(), start, start + size)

    def close(self) -> None:
        """Do nothing: everything is in memory."""


def _increasing(stamps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return stamps that never decrease, those that were stray as one next to them."""
    later = np.maximum.accumulate(stamps)
    sooner = np.minimum.accumulate(np.where(stamps > 0, stamps, later)[::-1])[::-1]
    return min(later, sooner, key=lambda each: float(np.abs(each - stamps).sum()))


def _listing(names: Sequence[str]) -> str:
    more = f' and {len(names) - LISTED} more' if len(names) > LISTED else ''
    return f'{", ".join(names[:LISTED])}{more}'


def _without_columns(path: Path, names: list[str], wanted: Columns | None) -> str:
    """Return the error that names the columns and the line to type."""
    if not names:
        return f'{path} has no columns of numbers: name another'
    line = wanted.line if wanted else f'velocity_estimator replay {shlex.quote(str(path))}'
    known = wanted or Columns(line)
    words, time = [line], known.time
    if not time:
        time = next(filter(TIMES.match, names), names[0])
        words += ['--time', shlex.quote(time), OF_TIME.words(time)]
    if not known.angles:
        others = [name for name in names if name != time]
        angle = next(filter(ANGLES.match, others), (others or ['ANGLE'])[0])
        words += ['--angle', shlex.quote(angle), '' if known.unit else OF_ANGLE.words(angle)]
    what = 'name the time and the angles'
    if wanted is None:
        what, words = 'a log, not a bag: make one of it', [*words, '--out BAG']
    return (
        f'{path} has the columns {_listing(names)}: {what}, as in: {" ".join(filter(None, words))}'
    )


# ---- files


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Raise UserError for what the libraries raise within the block."""
    try:
        yield
    except (UserError, ImportError):
        raise
    except NotImplementedError as error:  # of SciPy
        raise UserError(
            f"{path} is a MAT file of version 7.3: save it with '-v7' in MATLAB"
        ) from error
    except Exception as error:  # the libraries may raise anything for a damaged file
        if isinstance(error, OSError) and error.errno:
            raise
        raise UserError(
            f'{path} cannot be read as {path.suffix}: {first_line(error)}: check the file'
        ) from error


def _table(path: Path) -> Table:
    """Return the columns of a log."""
    if path.suffix.lower() == '.csv':
        return _csv(path)
    found: dict[str, Any] = {}
    if path.suffix.lower() == '.npz':
        if not zipfile.is_zipfile(path):
            raise UserError(f'{path} is not an .npz file: name another')
        with np.load(path, allow_pickle=False) as arrays:
            for name in arrays.files:
                with suppress(ValueError):  # an array of objects
                    found[name] = arrays[name]
    else:
        every = scipy_io.loadmat(path, squeeze_me=True)
        found = {name: value for name, value in every.items() if not name.startswith('__')}
    return {name: partial(np.asarray, values) for name, values in _flat('', found)}


def _flat(name: str, value: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the arrays of numbers, shape (n,), in nested structs and in columns of matrices."""
    if isinstance(value, dict):
        for inner, each in value.items():
            yield from _flat(f'{name}.{inner}' if name else inner, each)
        return
    array = np.asarray(value)
    fields = array.dtype.names
    if fields and array.size == 1:  # a struct of MATLAB
        yield from _flat(name, {inner: array[inner].reshape(())[()] for inner in fields})
    elif array.dtype.kind in 'iufMm' and array.size > 1:
        array = np.squeeze(array)
        if array.ndim == 1:
            yield name, array
        elif array.ndim == 2:
            samples_first = array.shape[0] >= array.shape[1]
            for i, column in enumerate(array.T if samples_first else array):
                yield f'{name}[{i}]', column


def _csv(path: Path) -> Table:
    """Return the columns of a CSV; the names are in the first line that has as many as numbers."""
    raw = path.read_bytes()
    utf16 = raw.startswith((b'\xff\xfe', b'\xfe\xff'))
    try:
        text = raw.decode('utf-16' if utf16 else 'utf-8-sig')
    except UnicodeDecodeError:
        text = raw.decode('latin-1')
    lines = text[:HEAD].splitlines()
    usual = lines[len(lines) // 2] if lines else ''
    separator = next((each for each in ';\t,' if each in usual), None)
    commas = r'"-?\d+,\d+"' if separator == ',' else r'\d,\d'
    decimal = ',' if separator and re.search(commas, text) else '.'
    rows = [_cells(line, separator) for line in lines]
    count = len(_cells(usual, separator))
    first = next(
        (i for i, row in enumerate(rows) if len(row) == count and _is_data(row, decimal, i == 0)),
        len(rows),
    )
    if first == len(rows):
        raise UserError(f'{path} has no row of numbers: name another file')
    named = next((row for row in rows[:first] if len(row) == count), [''] * count)
    names = [name or str(i) for i, name in enumerate(named)]
    body = '\n'.join(text.splitlines()[first:])

    def read(column: int) -> NDArray[Any]:
        for kind in (np.int64, np.float64) if decimal == '.' else ():
            with suppress(ValueError):
                return np.loadtxt(
                    io.StringIO(body),
                    kind,
                    delimiter=separator,
                    usecols=column,
                    quotechar='"',
                    ndmin=1,
                )
        return _with_pandas(body, separator, decimal, column)

    return {name: partial(read, i) for i, name in enumerate(names)}


def _cells(line: str, separator: str | None) -> list[str]:
    line = line.lstrip('#% ')
    if separator is None:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def _is_data(cells: Sequence[str], decimal: str, first: bool) -> bool:
    """Return True for a row of values: in the `first` line, all cells must be numbers."""
    numbers = []
    for cell in cells:
        try:
            float(cell.replace(decimal, '.'))
            numbers.append(True)
        except ValueError:
            numbers.append(False)
    return bool(numbers) and (all(numbers) if first else any(numbers))


def _with_pandas(body: str, separator: str | None, decimal: str, column: int) -> NDArray[Any]:
    """Return a column of numbers, nan where a cell is none, or of text."""
    frame = pandas.read_csv(
        io.StringIO(body),
        sep=separator or r'\s+',
        decimal=decimal,
        header=None,
        usecols=[column],
        skipinitialspace=True,
        comment='#',
    )
    found = frame[column]
    if found.dtype.kind in 'iuf':
        return np.asarray(found)
    texts = found.astype(str).str.strip()
    numbers = pandas.to_numeric(texts.str.replace(decimal, '.'), errors='coerce')
    if numbers.notna().any():
        return np.asarray(numbers)
    dates = pandas.to_datetime(texts, errors='coerce', utc=True, format='ISO8601')
    return np.asarray(dates.dt.tz_localize(None) if dates.notna().any() else numbers)
