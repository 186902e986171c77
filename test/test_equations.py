# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Equations read as their paper does: no field of a tuple is called by its number."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PLACES = (
    'estimator_pkg/observers/**/*.py',
    'estimator_pkg/driver/*.py',
    'sim_pkg/pmsm/*.py',
    'sim_pkg/reproduce/hybrid_angle/*.py',
    'sim_pkg/reproduce/mechanical/*.py',
    'benchmarks/laws.py',
)
FILES = sorted(path for place in PLACES for path in ROOT.glob(place))
# a number, or a constant that stands for one
INDEX = re.compile(
    r'\b(?:design|state|coefficients|_?track|core|watch|out|clear|lock|convention'
    r'|scatter|limits|sensor|band|doubt|motion|sway|start|reading|repeats|chain|signals'
    r'|gains|roots)\[-?(?:\d|[A-Z]+\b)'
)


def found_in(text: str) -> list[str]:
    """The lines in which a field is called by its number."""
    return [line.strip() for line in text.splitlines() if INDEX.search(line)]


def test_fields_are_called_by_name():
    found = {str(path): found_in(path.read_text()) for path in FILES}
    assert found and {path: lines for path, lines in found.items() if lines} == {}
