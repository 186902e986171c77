# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The interface of a reproduction of a paper: rows that can fail, and the paper's figures.

A row is a number or a claim of the paper. Its reference is data: ``references.csv`` beside the code
that computes the values of a paper. `Reproduction.values` raises KeyError if a value has no
reference or a reference no value, so no row is lost.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UsageError, suggestion

ABSOLUTE = 'absolute'  # |value - reference| <= tolerance
PERCENT = 'percent'  # |value - reference| <= tolerance % of |reference|
EXACT = 'exact'  # value == reference
AT_MOST = 'at most'  # value <= reference
SPECIFIED = 'specified'  # the paper gives everything that the row needs
OPEN = 'open'  # gains, start, input or machine are not published: ours are assumed
MISPRINT = 'misprint'  # explains a misprint or an ambiguity

Values = Iterator[tuple[str, Any]]  # (id, a number of Python's or numpy's)


def rms(values: NDArray[Any]) -> float:
    """Return the root mean square of `values`, of any shape, in their unit."""
    return float(np.sqrt(np.mean(np.square(values))))


class Reference(NamedTuple):
    """The reference of a row.

    id : unique, its part's name first: 'F4 RMS e2 [0,2) sin'. what : the quantity in words, with
    its unit. tolerance : in the unit of the value, or in % for `kind` PERCENT; else unused.
    kind : ABSOLUTE, PERCENT, EXACT or AT_MOST. paper : what the paper prints: a number or its
    words. basis : SPECIFIED, OPEN or MISPRINT.
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

    def met(self, value: float) -> bool:
        """Return True if a value is within the tolerance; False for NaN or infinity."""
        if self.kind == AT_MOST:
            return math.isfinite(value) and value <= self.value
        return abs(value - self.value) <= self.allowed


@dataclass(frozen=True)
class Reproduction:
    """The reproduction of a paper; its module `figures` maps file names to () -> figure.

    Attributes
    ----------
    name : as users write it.
    summary : one line; the paper.
    parts : name -> (title, () -> (id, value) of each row whose id starts with the name).
    notes : lines printed below the rows.
    reasons : (regular expression of ids, why ours are not what the paper prints).
    """

    name: str
    summary: str
    parts: Mapping[str, tuple[str, Callable[[], Values]]]
    notes: tuple[str, ...] = ()
    reasons: tuple[tuple[str, str], ...] = ()

    def references(self, prefix: str = '') -> list[Reference]:
        """Return the references whose id starts with `prefix`, in the order of the file.

        Raises
        ------
        UsageError : no id starts with `prefix`; the nearest part is suggested.
        """
        found = [each for each in references(self.name) if each.id.startswith(prefix)]
        if not found:
            raise UsageError(
                f"no row of {self.name} starts with '{prefix}': {suggestion(prefix, self.parts)}"
            )
        return found

    def values(
        self, advance: Callable[[int], None] = lambda count: None, prefix: str = ''
    ) -> list[tuple[Reference, float]]:
        """Return the rows whose id starts with `prefix`; parts without such rows are not run.

        Parameters
        ----------
        advance : called with 1 after each row.

        Raises
        ------
        KeyError : a value without a reference, or a reference without a value.
        """
        known = {each.id: each for each in self.references(prefix)}
        found: dict[str, float] = {}
        for part, (_, values) in self.parts.items():
            if any(name.startswith(part) for name in known):
                for name, value in values():
                    if name.startswith(prefix):
                        found[name] = float(value)
                        advance(1)
        if found.keys() != known.keys():
            odd = ', '.join(sorted(found.keys() ^ known.keys()))
            raise KeyError(f'{self.name}: a value or a reference is missing: {odd}')
        return [(each, found[name]) for name, each in known.items()]


@lru_cache
def references(paper: str) -> tuple[Reference, ...]:
    """Return all references of a paper, read from its ``references.csv``, in the order of the file.

    Its columns are the attributes of `Reference`.
    """
    table = files(f'{__package__}.{paper}').joinpath('references.csv').read_text(encoding='utf-8')
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
