"""Equations read as their paper does: no field of a tuple is called by its number."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / 'estimator_pkg'
FILES = sorted(
    path
    for pattern in (
        'observers/convention.py',
        'observers/adaptive/*.py',
        'observers/mechanism/*.py',
        'observers/pmsm/*.py',
        'observers/switched/*.py',
        'observers/angle/hybrid/injections.py',
        'observers/maths/*.py',
        'driver/drive.py',
        'driver/joint.py',
        'driver/switched.py',
        'driver/track.py',
    )
    for path in PACKAGE.glob(pattern)
)
# a number, or a constant that stands for one
INDEX = re.compile(
    r'\b(?:design|state|coefficients|_?track|core|watch|out|clear|lock|convention'
    r'|scatter|limits)\[-?(?:\d|[A-Z]+\b)'
)


def found_in(text: str) -> list[str]:
    """The lines in which a field is called by its number."""
    return [line.strip() for line in text.splitlines() if INDEX.search(line)]


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.stem)
def test_fields_are_called_by_name(path):
    assert found_in(path.read_text()) == []


def test_numbers_are_found():
    assert found_in('x = state[2]\ny = self._track[STATE]\nz = design[10][1]\nw = rows[k]') == [
        'x = state[2]',
        'y = self._track[STATE]',
        'z = design[10][1]',
    ]


def test_all_families_are_looked_at():
    assert len(FILES) >= 40
