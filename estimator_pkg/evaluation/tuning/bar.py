# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A progress bar with the best trial so far, on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from estimator_pkg.evaluation.tuning.search import Search
from estimator_pkg.evaluation.tuning.study import Value
from estimator_pkg.optional import is_there
from estimator_pkg.printable import printable, terminal


@contextmanager
def bar(label: str, trials: int) -> Iterator[Callable[[int, Search], None]]:
    """Yield a function to call after each batch: (number of trials, search so far)."""
    if sys.stderr is None or not sys.stderr.isatty() or not is_there('rich'):
        yield lambda count, found: None
        return
    from rich import progress as rich
    from rich.console import Console

    with rich.Progress(
        rich.TextColumn('{task.description}', markup=False),
        rich.BarColumn(),
        rich.MofNCompleteColumn(),
        rich.TextColumn('{task.fields[best]}', markup=False),
        console=Console(file=terminal(sys.stderr)),
        transient=True,
    ) as shown:
        task = shown.add_task(printable(label), total=trials, best='')

        def show(count: int, found: Search) -> None:
            best = found.best
            text = (
                ''
                if best is None
                else (
                    f'best cost {best.cost:.3f} of that of the defaults: '
                    + ', '.join(f'{name} {written(value)}' for name, value in best.values.items())
                )
            )
            shown.update(task, advance=count, best=text)

        yield show


def written(value: Value | None) -> str:
    """Return a gain as readable text."""
    if value is None:
        return '-'
    return value if isinstance(value, str) else f'{value:.4g}'
