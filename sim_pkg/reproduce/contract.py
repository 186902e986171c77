"""The interface of a reproduction of a paper: rows with a reference and a tolerance, and figures.

The references are a table next to the code that computes the values. `Part.rows` raises KeyError
if a value has no reference or a reference no value, so no row is lost.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from estimator_pkg.errors import UsageError, suggestion

ABSOLUTE = 'absolute'  # |value - reference| <= tolerance
PERCENT = 'percent'  # |value - reference| <= tolerance % of |reference|
EXACT = 'exact'  # value == reference
AT_MOST = 'at most'  # value <= reference
AT_LEAST = 'at least'  # value >= reference
KINDS = (ABSOLUTE, PERCENT, EXACT, AT_MOST, AT_LEAST)
DPI = 100  # resolution of the figures


@dataclass(frozen=True)
class Reference:
    """The reference of a row.

    Attributes
    ----------
    id : unique, its part's name first: 'F4 RMS e2 [0,2) sin'.
    what : the quantity in words, with its unit.
    value : the reference number.
    tolerance : in the unit of the value, or in % for `kind` PERCENT; unused by the other kinds.
    kind : one of KINDS.
    paper : what the paper prints: a number or its words; None if it prints neither.
    """

    id: str
    what: str
    value: float
    tolerance: float = 0.0
    kind: str = ABSOLUTE
    paper: float | str | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"'{self.id}': kind '{self.kind}' is not one of {', '.join(KINDS)}")

    @property
    def allowed(self) -> float:
        """The tolerance in the unit of the value; 0 for kinds without one."""
        if self.kind == PERCENT:
            return 0.01 * self.tolerance * abs(self.value)
        return self.tolerance if self.kind == ABSOLUTE else 0.0

    @property
    def tolerance_text(self) -> str:
        """The tolerance as text."""
        if self.kind == PERCENT:
            return f'{self.tolerance:g} %'
        return f'{self.tolerance:g}' if self.kind == ABSOLUTE else self.kind


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
        if reference.kind == AT_LEAST:
            return self.value >= reference.value
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


@dataclass(frozen=True)
class Reproduction:
    """A reproduction, as an entry point of ``velocity_estimator.reproductions`` names it.

    Attributes
    ----------
    name : as users write it.
    summary : one line; the paper.
    parts : in the order of the table.
    figures : the module whose FIGURES maps file names to functions () -> figure. It is imported
        only for drawing, because it imports matplotlib.
    notes : lines printed below the table.
    tables : (rows) -> the paper's own tables as lines, our results next to the printed numbers;
        only those whose rows are all in `rows`.
    """

    name: str
    summary: str
    parts: tuple[Part, ...]
    figures: str
    notes: tuple[str, ...] = field(default=())
    tables: Callable[[Sequence[Row]], list[str]] = field(default=lambda rows: [])

    def draw(self, folder: Path) -> list[Path]:
        """Draw the figures as PNG files into `folder`; return their paths. Needs matplotlib."""
        paths = []
        for name, make in importlib.import_module(self.figures).FIGURES.items():
            paths.append(folder / f'{name}.png')
            make().savefig(paths[-1], dpi=DPI, pil_kwargs={'optimize': True})
        return paths

    def references(self, prefix: str = '') -> list[Reference]:
        """Return the references whose id starts with `prefix`, in the order of the table."""
        return [
            reference
            for part in self.parts
            for reference in part.references
            if reference.id.startswith(prefix)
        ]

    def rows(
        self, advance: Callable[[int], None] = lambda count: None, prefix: str = ''
    ) -> Iterator[Row]:
        """Yield the rows whose id starts with `prefix`; parts without such rows are not run.

        Parameters
        ----------
        advance : called with 1 after each row that is yielded.

        Raises
        ------
        UsageError : no id starts with `prefix`; the nearest part is suggested.
        """
        if not self.references(prefix):
            names = [part.name for part in self.parts]
            raise UsageError(
                f"no row of {self.name} starts with '{prefix}': {suggestion(prefix, names)}"
            )
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


def family(
    name: str,
    what: str,
    values: Mapping[str, float],
    tolerance: float = 0.0,
    kind: str = ABSOLUTE,
    paper: Mapping[str, float | str] | None = None,
) -> tuple[Reference, ...]:
    """Return one reference for each of several variants: 'name variant' for each of `values`.

    Parameters
    ----------
    what : the quantity, with its unit.
    values : variant -> reference.
    paper : variant -> what the paper prints.
    """
    return tuple(
        Reference(f'{name} {variant}', what, value, tolerance, kind, (paper or {}).get(variant))
        for variant, value in values.items()
    )
