# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Errors for users: a single clear line, never a traceback."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from traceback import extract_tb


class UserError(Exception):
    """An error that the user can correct. Commands print one line and exit with 1 (or 2)."""

    exit_code = 1


class UsageError(UserError):
    """The call itself is wrong (unknown name, value out of range): exit code 2."""

    exit_code = 2


def first_line(error: BaseException) -> str:
    """Return the first line of an error's message, or the name of its type."""
    return (str(error).strip() or type(error).__name__).splitlines()[0]


def where(error: BaseException) -> str:
    """Return a caught error's message in one line, with the file and line that raised it."""
    place = extract_tb(error.__traceback__)[-1]
    return (
        f'{type(error).__name__}: {first_line(error)} (line {place.lineno} of '
        f'{Path(place.filename).name})'
    )


@contextmanager
def plainly(what: str) -> Iterator[None]:
    """Convert any exception of a user's own code within the block into a UserError.

    Raises
    ------
    UserError : `what` failed; the message has the reason and the line.
    """
    try:
        yield
    except UserError:
        raise
    except Exception as error:
        raise UserError(f'{what} failed: {where(error)}') from error


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return a clause for an error message with the nearest known name, or all of them.

    Parameters
    ----------
    name : the unknown name.
    known : the valid names.
    """
    names = sorted(known)
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    if near:
        return f"did you mean '{near[0]}'?"
    return 'known: ' + ', '.join(names) if names else 'none is known'
