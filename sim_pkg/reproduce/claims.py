# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Whether our values agree with what a paper prints: its numbers, and its claims in words."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal
from typing import NamedTuple

from sim_pkg.reproduce.contract import AT_MOST, MISPRINT, OPEN, SPECIFIED, Reproduction, Row, Table

NEAR = 0.1  # relative difference from a printed number that counts as agreement
SIMILAR = 0.1  # relative spread of values that are called similar
SLACK = 1.0  # between settling times [ms]
SLIGHT = 5.0  # a slight gain is below this [%]
CORRECTED = re.compile(r'[\d.]+ \(for ([\d.]+)\)')
UNEXPLAINED = 'not explained'
WIDTH = 80
NAMED = 6  # ids that are listed with a reason
LEGEND = 'ours, and in brackets what the paper prints; * does not agree with it'
TITLES = {
    SPECIFIED: 'the paper specifies everything',
    OPEN: 'the paper leaves gains, start, input or machine open, and ours are assumed',
    MISPRINT: 'misprints and ambiguities of the paper',
}


class Claim(NamedTuple):
    """A row: whether it agrees with what the paper prints, and why not ('' if it does)."""

    row: Row
    agrees: bool
    why: str

    @property
    def fails(self) -> bool:
        """True if the value left its tolerance, or disagrees without a known reason."""
        return not self.row.ok or self.why == UNEXPLAINED

    @property
    def printed(self) -> str:
        """What the paper prints, as text."""
        paper = self.row.reference.paper
        return paper if isinstance(paper, str) else number(paper)

    @property
    def verdict(self) -> str:
        """The last word of its line."""
        return 'FAILS' if self.fails else 'agrees' if self.agrees else 'no'


def number(value: float) -> str:
    """Return a number as text for the tables: at most five digits."""
    if not math.isfinite(value):
        return str(value)
    if value == int(value) and abs(value) < 1e6:
        return f'{int(value)}'
    return f'{value:.5g}' if abs(value) >= 1e-4 else f'{value:.2e}'


def claims(rows: Sequence[Row], reasons: Sequence[tuple[str, str]]) -> list[Claim]:
    """Return the claims of all rows, in order.

    Parameters
    ----------
    reasons : (regular expression of ids, why they do not agree); the first that matches is used.
    """
    found = []
    for row in rows:
        good = agrees(row, rows)
        why = next((why for ids, why in reasons if re.match(ids, row.reference.id)), UNEXPLAINED)
        found.append(Claim(row, good, '' if good else why))
    return found


def agrees(row: Row, rows: Sequence[Row]) -> bool:
    """Return True if the value is what the paper prints; `rows` has the others of its group.

    A number agrees within half a unit of its last printed digit, within the scatter that the
    tolerance of the row allows, or within 10 %.
    """
    value, paper = row.value, row.reference.paper
    if not math.isfinite(value):
        return False
    if isinstance(paper, str) and (found := CORRECTED.fullmatch(paper)):
        paper = float(found[1])
    if isinstance(paper, str):
        return WORDS[paper](value, _beside(row, rows))
    digit = Decimal(repr(paper)).normalize().as_tuple().exponent
    half = 0.5 * 10.0 ** int(digit) if paper else row.reference.value
    return abs(value - paper) <= max(half, row.reference.allowed, NEAR * abs(paper))


def _beside(row: Row, rows: Sequence[Row]) -> list[tuple[str, float]]:
    """Return (what the paper says, value) of the rows whose ids differ in the last word only."""
    stem = row.reference.id.rpartition(' ')[0]
    return [
        (str(each.reference.paper), each.value)
        for each in rows
        if each.reference.id.rpartition(' ')[0] == stem
    ]


def _similar(value: float, group: Sequence[tuple[str, float]]) -> bool:
    """Return True if all of them are alike, or, of differences, all are small [rad/s]."""
    values = [each for said, each in group if said == 'similar']
    if min(values) == 0.0:
        return max(values) < SIMILAR * 5.0  # of an rms error of 5 rad/s
    return max(values) - min(values) <= SIMILAR * max(values)


def _extreme(sign: float, same: str) -> Callable[[float, Sequence[tuple[str, float]]], bool]:
    """Return a rule: the value is the largest (sign 1) or smallest (-1), but for its equals."""
    return lambda value, group: all(
        sign * (value - each) >= 0.0 for said, each in group if not said.startswith(same)
    )


def _faster_than(words: str) -> Callable[[float, Sequence[tuple[str, float]]], bool]:
    """Return a rule: not later than that of which the paper says `words` by more than SLACK."""
    return lambda value, group: value <= dict(group).get(words, math.inf) + SLACK


WORDS: Mapping[str, Callable[[float, Sequence[tuple[str, float]]], bool]] = {
    'similar': _similar,
    'worst': _extreme(1.0, 'worst'),
    'best': _extreme(-1.0, 'best'),
    'best, slightly': lambda value, group: all(value <= each for _, each in group),
    'slower': _extreme(1.0, 'slower'),
    'faster': _extreme(-1.0, 'faster'),
    'slight': lambda value, _: 0.0 <= value < SLIGHT,
    'none': lambda value, _: value == 0.0,
    'at most 0': lambda value, _: value <= 1e-6,
    'below 0': lambda value, _: value < 0.0,
    'practically zero': lambda value, _: abs(value) < 1e-3,
    'Fig. 1a: before 40 s': lambda value, _: value < 40.0,
    'below 500': lambda value, _: value < 500.0,
    'coincide': lambda value, _: abs(value) < 0.05,
    'found': lambda value, _: abs(value) < 0.01,
    'falls': lambda value, _: value > 0.0,
    'converges': lambda value, _: value < 0.5,
    # settling times of observer (5), of (16) and of (16) with the identifier
    'relatively slow': lambda value, group: max(each for _, each in group) <= value + SLACK,
    'faster than (5)': _faster_than('relatively slow'),
    'faster than (16)': _faster_than('faster than (5)'),
}


def text(reproduction: Reproduction, found: Sequence[Claim]) -> list[str]:
    """Return all rows as lines of 80 columns: tables, the other rows, the differences, counts."""
    by_id = {claim.row.reference.id: claim for claim in found}
    lines: list[str] = []
    shown: set[str] = set()
    for table in reproduction.tables:
        ids = [name for names in table.body.values() for name in names]
        if by_id.keys() >= set(ids):
            shown.update(ids)
            lines += ['', *_table(table, by_id)]
    if shown:
        lines = ['', LEGEND, *lines]
    rest = [claim for claim in found if claim.row.reference.id not in shown]
    if rest:
        lines += ['', f'  {"row":<43} {"ours":>10}  {"the paper":<16} verdict']
    for claim in rest:
        name, ours = claim.row.reference.id, number(claim.row.value)
        lines.append(f'  {name:<43} {ours:>10}  {claim.printed:<16} {claim.verdict}')
    lines += ['', *_differences(found), *_failures(found)]
    for basis, title in TITLES.items():
        some = [claim for claim in found if claim.row.reference.basis == basis]
        if some:
            lines += _wrapped(_count(title, some), '')
    return lines


def _differences(found: Sequence[Claim]) -> list[str]:
    differing: dict[str, list[str]] = {}
    for claim in found:
        if not claim.agrees:
            differing.setdefault(claim.why, []).append(claim.row.reference.id)
    lines = ['does not agree, and why'] if differing else []
    for why, ids in differing.items():
        more = f' and {len(ids) - NAMED} more' if len(ids) > NAMED else ''
        lines += _wrapped(f'{len(ids)}: {why}', '  ')
        lines += _wrapped(f'({", ".join(ids[:NAMED])}{more})', '     ')
    return [*lines, ''] if lines else []


def _failures(found: Sequence[Claim]) -> list[str]:
    lines = []
    for row in (claim.row for claim in found if claim.fails):
        reference = row.reference
        bound = number(reference.value)
        if reference.kind == AT_MOST:
            bound = f'{AT_MOST} {bound}'
        else:
            bound += f' +- {number(reference.allowed)}'
        words = f'failed: {reference.id} ({reference.what}) is {number(row.value)}, not {bound}'
        lines += _wrapped(words, '')
    return lines


def _count(title: str, found: Sequence[Claim]) -> str:
    said = []
    for words, what in ((False, 'printed numbers'), (True, 'claims in words')):
        some = [each for each in found if isinstance(each.row.reference.paper, str) == words]
        if some:
            said.append(f'{sum(claim.agrees for claim in some)} of {len(some)} {what} agree')
    return f'{title[0].upper()}{title[1:]}: {"; ".join(said)}.'


def _table(table: Table, by_id: Mapping[str, Claim]) -> list[str]:
    def entry(name: str) -> str:
        claim = by_id[name]
        mark = '' if claim.agrees else ' *'
        return f'{claim.row.value:.4g} ({claim.printed}){mark}'

    body = {name: [entry(each) for each in ids] for name, ids in table.body.items()}
    return layout(table.title, list(table.columns), body)


def layout(title: str, columns: list[str], body: Mapping[str, list[str]]) -> list[str]:
    """Return a table as lines; one of more than 80 columns in two halves."""
    cells = [['', *columns], *([name, *entries] for name, entries in body.items())]
    widths = [max(len(row[k]) for row in cells) for k in range(len(cells[0]))]
    if sum(widths) + 2 * len(widths) > WIDTH:
        half = (len(columns) + 1) // 2
        return [
            *layout(title, columns[:half], {name: each[:half] for name, each in body.items()}),
            *layout('', columns[half:], {name: each[half:] for name, each in body.items()}),
        ]
    return [title] * bool(title) + [
        '  ' + '  '.join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip()
        for row in cells
    ]


def _wrapped(words: str, indent: str) -> list[str]:
    return textwrap.wrap(
        words, WIDTH, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False
    )
