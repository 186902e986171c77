# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A progress bar for long work, on stderr, if it is a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from estimator_pkg.optional import is_there
from estimator_pkg.printable import printable, terminal


@contextmanager
def progress(label: str, total: int | None) -> Iterator[Callable[..., None]]:
    """Show a bar; yield a function that advances it by n steps, and may change its label.

    Silent without a terminal.

    Parameters
    ----------
    label : name of the work.
    total : number of all steps; None: not known.
    """
    if sys.stderr is None or not sys.stderr.isatty() or not is_there('rich'):
        yield lambda steps, label='': None
        return
    from rich import progress as rich
    from rich.console import Console

    with rich.Progress(
        rich.SpinnerColumn(),
        rich.TextColumn('{task.description}', markup=False),
        rich.BarColumn(),
        rich.MofNCompleteColumn(),
        rich.TimeElapsedColumn(),
        rich.TimeRemainingColumn(),
        console=Console(file=terminal(sys.stderr)),
        transient=True,
    ) as bar:
        task = bar.add_task(printable(label), total=total)
        yield lambda steps, label=label: bar.update(
            task, advance=steps, description=printable(label)
        )
