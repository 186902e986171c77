# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator reproduce``: what a paper prints and claims, and whether ours agrees."""

from __future__ import annotations

import argparse
import importlib
import textwrap
from pathlib import Path
from typing import Any

from estimator_pkg.cli import Command
from estimator_pkg.errors import UsageError, UserError, suggestion
from estimator_pkg.optional import Lazy, needs
from estimator_pkg.printable import show
from estimator_pkg.progress import progress
from sim_pkg.reproduce.contract import Reproduction

PAPERS = {
    name: Lazy(f'sim_pkg.reproduce.{name}.paper')
    for name in ('adaptive', 'hybrid_angle', 'hybrid_discrete', 'mechanical', 'pmsm')
}
claims = Lazy('sim_pkg.reproduce.claims')
WIDTH = 80
DPI = 100  # resolution of the figures


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument('paper', metavar='PAPER', help=f'one of: {", ".join(PAPERS)}')
    parser.add_argument('--plot', metavar='DIR', type=Path, help='draw the figures into DIR')
    parser.add_argument(
        '--only', metavar='ID', default='', help="only rows whose id starts with ID, such as 'F4'"
    )


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Compute and print the rows, draw the figures; return them, with 'ok' False if a row fails."""
    if parsed.paper not in PAPERS:
        raise UsageError(f"unknown paper '{parsed.paper}': {suggestion(parsed.paper, PAPERS)}")
    reproduction: Reproduction = PAPERS[parsed.paper].REPRODUCTION
    if parsed.plot is not None:
        _require_matplotlib()
        parsed.plot.mkdir(parents=True, exist_ok=True)
    with progress(reproduction.name, len(reproduction.references(parsed.only))) as advance:
        rows = reproduction.values(advance, parsed.only)
    found = claims.claims(rows, reproduction.reasons)
    show(*textwrap.wrap(reproduction.summary, WIDTH), *claims.text(reproduction, found))
    for note in reproduction.notes:
        show(*textwrap.wrap(note, WIDTH, break_on_hyphens=False))
    if parsed.plot is not None:
        show(*draw(reproduction.name, parsed.plot))
    return {
        'paper': reproduction.name,
        'ok': not any(claim.fails for claim in found),
        'rows': [claim.as_dict() for claim in found],
    }


def draw(paper: str, folder: Path) -> list[Path]:
    """Draw a paper's figures as PNG files into `folder`; return their paths. Needs matplotlib."""
    paths = []
    module = importlib.import_module(f'sim_pkg.reproduce.{paper}.figures')
    for name, make in module.FIGURES.items():
        paths.append(folder / f'{name}.png')
        make().savefig(paths[-1], dpi=DPI, pil_kwargs={'optimize': True})
    return paths


def _require_matplotlib() -> None:
    try:
        import matplotlib  # noqa: F401  (checks that it is installed)
    except ImportError as error:
        raise UserError(f'{needs("matplotlib")} (without --plot it is not needed)') from error


COMMAND = Command(
    "reproduce a paper's figures and tables",
    arguments,
    run,
    examples=(
        ('mechanical', 'the printed tables and claims, and whether ours agrees'),
        ('hybrid_angle --plot figures', 'and its figures'),
        ('pmsm --only F2', 'some rows'),
    ),
)
