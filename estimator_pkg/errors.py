"""The one error a user sees: a single clear line, never a traceback."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from traceback import extract_tb


class UserError(Exception):
    """Something the user can mend. Commands print it as one line and exit with 1 (or 2)."""

    exit_code = 1


class UsageError(UserError):
    """The call itself is wrong (unknown name, value out of range): exit code 2."""

    exit_code = 2


def first_line(error: BaseException) -> str:
    """The first line of what an error says, or what kind of error it is."""
    return (str(error).strip() or type(error).__name__).splitlines()[0]


def where(error: BaseException) -> str:
    """What a caught error says, in one line, and the line of the file that raised it."""
    place = extract_tb(error.__traceback__)[-1]
    return (
        f'{type(error).__name__}: {first_line(error)} (line {place.lineno} of '
        f'{Path(place.filename).name})'
    )


@contextmanager
def plainly(what: str) -> Iterator[None]:
    """Around code of a user's own, which may raise anything.

    Raises
    ------
    UserError : `what` failed, why and where.
    """
    try:
        yield
    except UserError:
        raise
    except Exception as error:
        raise UserError(f'{what} failed: {where(error)}') from error


def suggestion(name: str, known: Iterable[str]) -> str:
    """A half-sentence that names the nearest known name, or all of them.

    Parameters
    ----------
    name : what the user wrote.
    known : the names that would have been right.
    """
    names = sorted(known)
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    if near:
        return f"did you mean '{near[0]}'?"
    return 'known: ' + ', '.join(names) if names else 'none is known'
