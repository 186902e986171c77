# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The interface of a reproduction of a paper: rows that can fail, tables and figures.

A row is a figure, a table or a claim of the paper. Its reference is data: ``references.csv`` beside
the code that computes the values of a paper. `Part.rows` raises KeyError if a value has no
reference or a reference no value, so no row is lost.
"""

from __future__ import annotations

import csv
import importlib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from estimator_pkg.errors import UsageError, suggestion

ABSOLUTE = 'absolute'  # |value - reference| <= tolerance
PERCENT = 'percent'  # |value - reference| <= tolerance % of |reference|
EXACT = 'exact'  # value == reference
AT_MOST = 'at most'  # value <= reference
SPECIFIED = 'specified'  # the paper gives everything that the row needs
OPEN = 'open'  # gains, start, input or machine are not published: ours are assumed
MISPRINT = 'misprint'  # explains a misprint or an ambiguity
DPI = 100  # resolution of the figures


@dataclass(frozen=True)
class Reference:
    """The reference of a row.

    Attributes
    ----------
    id : unique, its part's name first: 'F4 RMS e2 [0,2) sin'.
    what : the quantity in words, with its unit.
    value : the reference number.
    tolerance : in the unit of the value, or in % for `kind` PERCENT; else unused.
    kind : ABSOLUTE, PERCENT, EXACT or AT_MOST.
    paper : what the paper prints: a number or its words.
    basis : SPECIFIED, OPEN or MISPRINT.
    """

    id: str
    what: str
    value: float
    tolerance: float
    kind: str
    paper: float | str
    basis: str = SPECIFIED

    @property
    def allowed(self) -> float:
        """The tolerance in the unit of the value; 0 for kinds without one."""
        if self.kind == PERCENT:
            return 0.01 * self.tolerance * abs(self.value)
        return self.tolerance if self.kind == ABSOLUTE else 0.0


@dataclass(frozen=True)
class Row:
    """A reference and our value."""

    reference: Reference
    value: float

    @property
    def ok(self) -> bool:
        """True if our value is within the tolerance; False for NaN or infinity."""
        reference = self.reference
        if not math.isfinite(self.value):
            return False
        if reference.kind == AT_MOST:
            return self.value <= reference.value
        return abs(self.value - reference.value) <= reference.allowed

    def as_dict(self) -> dict[str, Any]:
        """Return the row for ``--json``; 'tolerance' is in the unit of the value."""
        reference = self.reference
        return {
            'id': reference.id,
            'what': reference.what,
            'value': self.value,
            'reference': reference.value,
            'tolerance': reference.allowed,
            'kind': reference.kind,
            'paper': reference.paper,
            'basis': reference.basis,
            'ok': self.ok,
        }


Values = Iterator[tuple[str, Any]]  # (id, a number of Python's or numpy's)


@dataclass(frozen=True)
class Part:
    """Rows that are computed together.

    Attributes
    ----------
    name : every id of the part starts with it.
    references : in the order of the table.
    values : () -> (id, value) of each reference, in any order, as they are computed.
    """

    name: str
    references: tuple[Reference, ...]
    values: Callable[[], Values]

    def rows(self) -> Iterator[Row]:
        """Yield the rows as they are computed.

        Raises
        ------
        KeyError : a value without a reference, or a reference without a value.
        """
        missing = {reference.id: reference for reference in self.references}
        for name, value in self.values():
            yield Row(missing.pop(name), float(value))
        if missing:
            raise KeyError(f'{self.name}: no value for {", ".join(missing)}')

    def concerns(self, prefix: str) -> bool:
        """Return True if an id of this part starts with `prefix`."""
        return any(reference.id.startswith(prefix) for reference in self.references)


class Table(NamedTuple):
    """A table in the paper's layout: ids of rows, by the name of its line."""

    title: str
    columns: tuple[str, ...]
    body: dict[str, list[str]]


@dataclass(frozen=True)
class Reproduction:
    """The reproduction of a paper, as `sim_pkg.reproduce.command` names it.

    Attributes
    ----------
    name : as users write it.
    summary : one line; the paper.
    parts : in the order of the table.
    figures : the module whose FIGURES maps file names to functions () -> figure. It is imported
        only for drawing, because it imports matplotlib.
    notes : lines printed below the table.
    tables : shown if all their rows were computed.
    reasons : (regular expression of ids, why ours are not what the paper prints).
    """

    name: str
    summary: str
    parts: tuple[Part, ...]
    figures: str
    notes: tuple[str, ...] = field(default=())
    tables: tuple[Table, ...] = field(default=())
    reasons: tuple[tuple[str, str], ...] = field(default=())

    def draw(self, folder: Path) -> list[Path]:
        """Draw the figures as PNG files into `folder`; return their paths. Needs matplotlib."""
        paths = []
        for name, make in importlib.import_module(self.figures).FIGURES.items():
            paths.append(folder / f'{name}.png')
            make().savefig(paths[-1], dpi=DPI, pil_kwargs={'optimize': True})
        return paths

    def references(self, prefix: str = '') -> list[Reference]:
        """Return the references whose id starts with `prefix`, in the order of the table.

        Raises
        ------
        UsageError : no id starts with `prefix`; the nearest part is suggested.
        """
        every = [reference for part in self.parts for reference in part.references]
        found = [reference for reference in every if reference.id.startswith(prefix)]
        if not found:
            names = [part.name for part in self.parts]
            raise UsageError(
                f"no row of {self.name} starts with '{prefix}': {suggestion(prefix, names)}"
            )
        return found

    def rows(
        self, advance: Callable[[int], None] = lambda count: None, prefix: str = ''
    ) -> Iterator[Row]:
        """Yield the rows whose id starts with `prefix`; parts without such rows are not run.

        Parameters
        ----------
        advance : called with 1 after each row.
        """
        for part in self.parts:
            if not part.concerns(prefix):
                continue
            order = {reference.id: place for place, reference in enumerate(part.references)}
            found = []
            for row in part.rows():
                if row.reference.id.startswith(prefix):
                    found.append(row)
                    advance(1)
            yield from sorted(found, key=lambda row: order[row.reference.id])


@lru_cache
def references(paper: str) -> tuple[Reference, ...]:
    """Return all references of a paper, read from its ``references.csv``, in the order of the file.

    Its columns are the attributes of `Reference`.
    """
    folder = files(f'{__package__}.{paper}')
    table = folder.joinpath('references.csv').read_text(encoding='utf-8')
    return tuple(
        Reference(
            row['id'],
            row['what'],
            float(row['value']),
            float(row['tolerance']),
            row['kind'],
            _printed(row['paper']),
            row['basis'],
        )
        for row in csv.DictReader(table.splitlines())
    )


def _printed(cell: str) -> float | str:
    """Return what the paper prints: a number or its words."""
    try:
        return float(cell)
    except ValueError:
        return cell


def parts(paper: str, values: Mapping[str, Callable[[], Values]]) -> tuple[Part, ...]:
    """Return the parts of a paper; each takes the references whose id starts with its name.

    Parameters
    ----------
    values : name of the part -> function of its values, in the order of ``references.csv``.

    Raises
    ------
    ValueError : a reference belongs to no part or to two, or the order is another.
    """
    every = references(paper)
    found = tuple(
        Part(name, tuple(row for row in every if row.id.startswith(name)), compute)
        for name, compute in values.items()
    )
    if tuple(row for part in found for row in part.references) != every:
        raise ValueError(f'{paper}: the parts {", ".join(values)} do not divide its references')
    return found
