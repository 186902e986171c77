# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Whether our values agree with what a paper prints: its numbers, and its claims in words."""

from __future__ import annotations

import math
import re
import textwrap
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal
from typing import Any, NamedTuple

from sim_pkg.reproduce.contract import AT_MOST, MISPRINT, OPEN, SPECIFIED, Reference, Reproduction

NEAR = 0.1  # relative difference from a printed number that counts as agreement
SIMILAR = 0.1  # relative spread of values that are called similar
SLACK = 1.0  # between settling times [ms]
SLIGHT = 5.0  # a slight gain is below this [%]
CORRECTED = re.compile(r'[\d.]+ \(for ([\d.]+)\)')
UNEXPLAINED = 'not explained'
WIDTH = 80
NAMED = 6  # ids that are listed with a reason
TITLES = {
    SPECIFIED: 'the paper specifies everything',
    OPEN: 'the paper leaves gains, start, input or machine open, and ours are assumed',
    MISPRINT: 'misprints and ambiguities of the paper',
}
Group = Sequence[tuple[str, float]]  # what the paper says of some rows, and our values


class Claim(NamedTuple):
    """A row: our value, whether it agrees with what the paper prints, and why not ('': it does)."""

    reference: Reference
    value: float
    agrees: bool
    why: str

    @property
    def fails(self) -> bool:
        """True if the value left its tolerance, or disagrees without a known reason."""
        return not self.reference.met(self.value) or self.why == UNEXPLAINED

    def as_dict(self) -> dict[str, Any]:
        """Return the row for ``--json``; 'tolerance' is in the unit of the value."""
        own = self.reference._asdict()
        own['reference'], own['tolerance'] = own['value'], self.reference.allowed
        own |= {'value': self.value, 'ok': self.reference.met(self.value)}
        return {**own, 'agrees': self.agrees, 'why': self.why}


def claims(
    rows: Sequence[tuple[Reference, float]], reasons: Sequence[tuple[str, str]]
) -> list[Claim]:
    """Return the claims of all rows, in order.

    Parameters
    ----------
    reasons : (regular expression of ids, why they do not agree); the first that matches is used.
    """
    groups: dict[str, list[tuple[str, float]]] = defaultdict(list)  # ids but for the last word
    for reference, value in rows:
        groups[reference.id.rpartition(' ')[0]].append((str(reference.paper), value))
    found = []
    for reference, value in rows:
        good = agrees(reference, value, groups[reference.id.rpartition(' ')[0]])
        why = next((why for ids, why in reasons if re.match(ids, reference.id)), UNEXPLAINED)
        found.append(Claim(reference, value, good, '' if good else why))
    return found


def agrees(reference: Reference, value: float, group: Group) -> bool:
    """Return True if the value is what the paper prints; `group` has it and its neighbours.

    A number agrees within half a unit of its last printed digit, within the scatter that the
    tolerance of the row allows, or within 10 %.
    """
    paper = reference.paper
    if not math.isfinite(value):
        return False
    if isinstance(paper, str) and (found := CORRECTED.fullmatch(paper)):
        paper = float(found[1])
    if isinstance(paper, str):
        return WORDS[paper](value, group)
    digit = Decimal(repr(paper)).normalize().as_tuple().exponent
    half = 0.5 * 10.0 ** int(digit) if paper else reference.value
    return abs(value - paper) <= max(half, reference.allowed, NEAR * abs(paper))


def _similar(value: float, group: Group) -> bool:
    """Return True if all of them are alike, or, of differences, all are small [rad/s]."""
    values = [each for said, each in group if said == 'similar']
    if min(values) == 0.0:
        return max(values) < SIMILAR * 5.0  # of an rms error of 5 rad/s
    return max(values) - min(values) <= SIMILAR * max(values)


def _extreme(sign: float, same: str) -> Callable[[float, Group], bool]:
    """Return a rule: the value is the largest (sign 1) or smallest (-1), but for its equals."""
    return lambda value, group: all(
        sign * (value - each) >= 0.0 for said, each in group if not said.startswith(same)
    )


def _faster_than(words: str) -> Callable[[float, Group], bool]:
    """Return a rule: not later than that of which the paper says `words` by more than SLACK."""
    return lambda value, group: value <= dict(group).get(words, math.inf) + SLACK


WORDS: Mapping[str, Callable[[float, Group], bool]] = {
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
    """Return all rows as lines of 80 columns, part by part; then the differences and the counts."""
    lines: list[str] = []
    for part, (title, _) in reproduction.parts.items():
        own = [claim for claim in found if claim.reference.id.startswith(part)]
        lines += ['', *_wrapped(f'{part}: {title}')] if own else []
        lines += [f'  {"row":<42} {"ours":>10}  {"the paper":<16} verdict'] if own else []
        for claim in own:
            paper = claim.reference.paper
            printed = paper if isinstance(paper, str) else number(paper)
            verdict = 'FAILS' if claim.fails else 'agrees' if claim.agrees else 'no'
            row = f'  {claim.reference.id:<42} {number(claim.value):>10}  {printed:<16} {verdict}'
            lines.append(row)
    lines += ['', *_differences(found), *_failures(found)]
    for basis, title in TITLES.items():
        some = [claim for claim in found if claim.reference.basis == basis]
        lines += _wrapped(_count(title, some)) if some else []
    return lines


def number(value: float) -> str:
    """Return a number as text: at most five digits."""
    if not math.isfinite(value):
        return str(value)
    if value == int(value) and abs(value) < 1e6:
        return f'{int(value)}'
    return f'{value:.5g}' if abs(value) >= 1e-4 else f'{value:.2e}'


def _differences(found: Sequence[Claim]) -> list[str]:
    differing: dict[str, list[str]] = defaultdict(list)
    for claim in found:
        if not claim.agrees:
            differing[claim.why].append(claim.reference.id)
    lines = ['does not agree, and why'] if differing else []
    for why, ids in differing.items():
        more = f' and {len(ids) - NAMED} more' if len(ids) > NAMED else ''
        lines += _wrapped(f'{len(ids)}: {why}', '  ')
        lines += _wrapped(f'({", ".join(ids[:NAMED])}{more})', '     ')
    return [*lines, ''] if lines else []


def _failures(found: Sequence[Claim]) -> list[str]:
    lines = []
    for reference, value in ((claim.reference, claim.value) for claim in found if claim.fails):
        bound = f'{number(reference.value)} +- {number(reference.allowed)}'
        if reference.kind == AT_MOST:
            bound = f'{AT_MOST} {number(reference.value)}'
        words = f'failed: {reference.id} ({reference.what}) is {number(value)}, not {bound}'
        lines += _wrapped(words)
    return lines


def _count(title: str, found: Sequence[Claim]) -> str:
    said = []
    for words, what in ((False, 'printed numbers'), (True, 'claims in words')):
        some = [each for each in found if isinstance(each.reference.paper, str) == words]
        if some:
            said.append(f'{sum(claim.agrees for claim in some)} of {len(some)} {what} agree')
    return f'{title[0].upper()}{title[1:]}: {"; ".join(said)}.'


def _wrapped(words: str, indent: str = '') -> list[str]:
    return textwrap.wrap(
        words, WIDTH, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False
    )
