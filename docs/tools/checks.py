# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The tables of docs/doctor.md: the checks of joints and of drives, from their rows.

python -m docs.tools.checks
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from estimator_pkg.evaluation.checks import joint
from estimator_pkg.evaluation.checks.row import Check
from estimator_pkg.evaluation.doctor import command, drive, velocities
from estimator_pkg.evaluation.text import markdown

PAGE = Path(__file__).resolve().parents[1] / 'doctor.md'
SECOND = Check(
    'second sensor',
    'ratio and delay of a gyro, of another joint that moves with it, of a published '
    'velocity; the error with and without it',
    'never: `--out` has its parameters if it pays (95 %)',
)
JOINTS = (joint.READINGS, command.TOPIC, *joint.CHECKS, *velocities.CHECKS, SECOND)
TABLE = re.compile(r'^\| check \|.*?(?=\n\n)', re.DOTALL | re.MULTILINE)


def table(checks: Iterable[Check]) -> str:
    """Return the rows as Markdown."""
    rows = [(each.name, each.measures, each.limit) for each in checks]
    return markdown(('check', 'measures', 'WARN or FAIL'), rows)


def page(text: str) -> str:
    """Return the page with its two tables as the rows are now."""
    tables = iter([table(JOINTS), table(drive.CHECKS)])
    return TABLE.sub(lambda _: next(tables), text)


if __name__ == '__main__':
    PAGE.write_text(page(PAGE.read_text()))
