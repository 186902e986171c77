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

from sim_pkg.reproduce.contract import Row
from sim_pkg.reproduce.table import number

NEAR = 0.1  # relative difference from a printed number that counts as agreement
SIMILAR = 0.1  # relative spread of values that are called similar
SLIGHT = 5.0  # a slight gain is below this [%]
MISPRINT = re.compile(r'[\d.]+ \(for ([\d.]+)\)')
UNEXPLAINED = 'not explained'
WIDTH = 80
NAMED = 6  # ids that are listed with a reason


class Claim(NamedTuple):
    """A row with something printed: whether ours agrees, and why not ('' if it does)."""

    row: Row
    agrees: bool
    why: str

    @property
    def is_number(self) -> bool:
        """True if the paper prints a number."""
        return not isinstance(self.row.reference.paper, str)

    @property
    def printed(self) -> str:
        """What the paper prints."""
        paper = self.row.reference.paper
        return paper if isinstance(paper, str) else number(float(paper or 0.0))


def printed_number(row: Row) -> float | None:
    """Return the number that the paper prints or means; None for words."""
    paper = row.reference.paper
    if isinstance(paper, str):
        found = MISPRINT.fullmatch(paper)
        return float(found[1]) if found else None
    return paper


def claims(rows: Sequence[Row], reasons: Sequence[tuple[str, str]]) -> list[Claim]:
    """Return the rows with something printed, in order.

    Parameters
    ----------
    reasons : (regular expression of ids, why they do not agree); the first that matches is used.
    """
    found = []
    for row in rows:
        if row.reference.paper is None:
            continue
        good = agrees(row, rows)
        why = '' if good else _reason(row.reference.id, reasons)
        found.append(Claim(row, good, why))
    return found


def _reason(name: str, reasons: Sequence[tuple[str, str]]) -> str:
    return next((why for ids, why in reasons if re.match(ids, name)), UNEXPLAINED)


def agrees(row: Row, rows: Sequence[Row]) -> bool:
    """Return True if the value is what the paper prints; `rows` has the others of its group.

    A number agrees within half a unit of its last printed digit, within the scatter that the
    tolerance of the row allows, or within 10 %.
    """
    value, printed = row.value, printed_number(row)
    if not math.isfinite(value):
        return False
    if printed is None:
        rule = WORDS.get(str(row.reference.paper))
        return row.ok if rule is None else rule(value, _beside(row, rows))
    digit = Decimal(repr(printed)).normalize().as_tuple().exponent
    half = 0.5 * 10.0 ** int(digit) if printed else row.reference.value
    return abs(value - printed) <= max(half, row.reference.allowed, NEAR * abs(printed))


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


WORDS: Mapping[str, Callable[[float, Sequence[tuple[str, float]]], bool]] = {
    'similar': _similar,
    'worst': _extreme(1.0, 'worst'),
    'best': _extreme(-1.0, 'best'),
    'best, slightly': lambda value, group: all(value <= each for _, each in group),
    'slower': _extreme(1.0, 'slower'),
    'faster': _extreme(-1.0, 'faster'),
    'slight': lambda value, _: 0.0 <= value < SLIGHT,
    'none': lambda value, _: value == 0.0,
    'below 0': lambda value, _: value < 0.0,
    'at most 0': lambda value, _: value <= 1e-6,
    'practically zero': lambda value, _: abs(value) < 1e-3,
    'Fig. 1a: before 40 s': lambda value, _: value < 40.0,
    'Fig. 4: after a few steps': lambda value, _: abs(value) < 1e-3,
    'significantly faster': lambda value, _: value == 0.0,
    'consistently faster': lambda value, _: value == 0.0,
}


def text(found: Sequence[Claim]) -> list[str]:
    """Return the claims as lines of 80 columns: those in words, the differences, the counts."""
    lines = []
    words = [claim for claim in found if not claim.is_number]
    if words:
        lines += _table('claims in words', words)
    numbers = [claim for claim in found if claim.is_number]
    if numbers and len(numbers) <= 2 * NAMED + 10:
        lines += _table('printed numbers', numbers)
    differing: dict[str, list[Claim]] = {}
    for claim in found:
        if not claim.agrees:
            differing.setdefault(claim.why, []).append(claim)
    if differing:
        lines.append('does not agree, and why')
    for why, those in differing.items():
        ids = ', '.join(claim.row.reference.id for claim in those[:NAMED])
        more = f' and {len(those) - NAMED} more' if len(those) > NAMED else ''
        lines += _wrapped(f'{len(those)}: {why}', '  ')
        lines += _wrapped(f'({ids}{more})', '     ')
    if differing:
        lines.append('')
    for kind, some in (('printed numbers', numbers), ('claims in words', words)):
        if some:
            lines += _wrapped(_count(kind, some), '')
    return lines


def _table(title: str, found: Sequence[Claim]) -> list[str]:
    return [
        title,
        _line('row', 'ours', 'the paper', ''),
        *(
            _line(
                claim.row.reference.id,
                number(claim.row.value),
                claim.printed,
                'agrees' if claim.agrees else 'NO',
            )
            for claim in found
        ),
        '',
    ]


def _count(kind: str, found: Sequence[Claim]) -> str:
    agree = sum(claim.agrees for claim in found)
    what = kind if len(found) > 1 else kind.replace('claims', 'claim').replace('numbers', 'number')
    said = f'{len(found)} {what}: {agree} agree{"s" * (agree == 1)} with the paper'
    if agree == len(found):
        return f'{said}.'
    reasons = dict.fromkeys(claim.why for claim in found if not claim.agrees)
    because = '; '.join(why.partition(': ')[0] for why in reasons)
    other = len(found) - agree
    return f'{said}, {other} do{"es" if other == 1 else ""} not, because: {because}.'


def _line(name: str, ours: str, printed: str, agrees: str) -> str:
    return f'  {name:<41} {ours:>10}  {printed:<17} {agrees}'.rstrip()


def _wrapped(words: str, indent: str) -> list[str]:
    return textwrap.wrap(
        words, WIDTH, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False
    )
