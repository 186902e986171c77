# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``tune --live``: record from a running node, and set its new gains on request."""

from __future__ import annotations

import argparse
import signal
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from estimator_pkg import interrupts
from estimator_pkg.bags import record
from estimator_pkg.errors import UserError

if TYPE_CHECKING:
    from estimator_pkg.bags.live import RemoteParameters


@contextmanager
def recorded(topics: Sequence[str], truth: str, seconds: float) -> Iterator[str]:
    """Record `topics` (and `truth`, if it is published) for `seconds`; yield the bag's path.

    The bag is deleted when the context ends.

    Raises
    ------
    UserError : no message arrived.
    """
    with TemporaryDirectory(prefix='velocity_estimator_') as folder:
        path = str(Path(folder) / 'live')
        try:
            record.run(argparse.Namespace(topics=[*topics, truth], out=path, duration=seconds))
        except UserError:  # nothing arrived
            if interrupts.came():
                raise KeyboardInterrupt from None
            raise
        if interrupts.came() not in (0, signal.SIGINT):
            raise KeyboardInterrupt
        interrupts.forget()  # Ctrl-C ended only the recording
        yield path


@contextmanager
def remote(node: str, observer: str) -> Iterator[RemoteParameters]:
    """Yield the parameters of a node; UserError: no such node, or it runs another observer."""
    from estimator_pkg.bags.live import RemoteParameters, live

    with live('gain_setter') as here:
        there = RemoteParameters(here, node)
        runs = there.get(['observer'])['observer']
        if runs not in (None, observer):  # others have gains of the same names
            raise UserError(
                f"the node '{there.name}' runs {runs}, and the gains are of {observer}: start it "
                f"with 'observer: {observer}', or tune {runs}"
            )
        yield there


def apply(node: str, gains: Mapping[str, Any], observer: str) -> list[str]:
    """Set parameters of a running node, whose state is kept; return the changes as text.

    Parameters
    ----------
    gains : by the node's own parameter names. observer : whose gains they are.

    Raises
    ------
    UserError : no such node, another observer in it, no answer, or a refused value (with the
        node's reason).
    """
    if not gains:
        return []
    with remote(node, observer) as there:
        before = there.get(list(gains))
        there.set(gains)
        after = there.get(list(gains))
    return [f'{name}: {_text(before[name])} -> {_text(after[name])}' for name in gains]


def _text(value: Any) -> str:
    """Return a value as text; None: the parameter was not set."""
    if value is None:
        return 'not set'
    return f'{value:.6g}' if isinstance(value, float) else str(value)
