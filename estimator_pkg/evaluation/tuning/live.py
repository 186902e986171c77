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
from estimator_pkg.parameters import Parameter
from estimator_pkg.params_file import parameter_of
from estimator_pkg.yaml_text import scalar

if TYPE_CHECKING:
    from estimator_pkg.bags.remote_parameters import RemoteParameters


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
    from estimator_pkg.bags.live import live

    with live('gain_setter') as here:
        from estimator_pkg.bags.remote_parameters import RemoteParameters

        there = RemoteParameters(here, node)
        runs = there.get(['observer'])['observer']
        if runs not in (None, observer):  # others have gains of the same names
            raise UserError(
                f"the node '{there.name}' runs {runs}, and the gains are of {observer}: start it "
                f"with 'observer: {observer}', or tune {runs}"
            )
        yield there


def apply(
    node: str, gains: Mapping[str, Any], declared: Mapping[str, Parameter], observer: str
) -> list[str]:
    """Set parameters of a running node, whose state is kept.

    Parameters
    ----------
    gains : by the node's own parameter names. declared : what is declared of them, by plain name.
    observer : whose gains they are.

    Returns
    -------
    The changes as text: each gain before and after.

    Raises
    ------
    UserError : no such node, another observer in it, no answer, or a refused value (with the
        node's reason).
    """
    with remote(node, observer) as there:
        before = there.get(list(gains))
        there.set(gains)
        after = there.get(list(gains))
    known = {name: declared.get(parameter_of(name)) for name in gains}
    return [
        f'{name}: {_text(before[name], each)} -> {_text(after[name], each)}'
        for name, each in known.items()
    ]


def _text(value: Any, parameter: Parameter | None) -> str:
    """Return a value as text; None: the parameter was not set."""
    if value is None:
        return 'not set'
    if parameter is not None and parameter.is_automatic(value):
        return parameter.automatic_text
    return f'{value:.6g}' if isinstance(value, float) else scalar(value)
