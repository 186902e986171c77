# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Functions made from text: loops over two or three numbers cost more than their arithmetic."""

from __future__ import annotations

from typing import Any


def written_out(lines: list[str], title: str, **known: Any) -> dict[str, Any]:
    """Return the functions that these lines of text define, by name.

    No other function of this package executes text.

    Parameters
    ----------
    lines : Python source, one line each.
    title : shown in tracebacks instead of a file's name.
    known : functions and numbers that the text uses, by name.
    """
    names: dict[str, Any] = dict(known)
    exec(compile('\n'.join(lines), f'<{title}>', 'exec'), names)
    return names
