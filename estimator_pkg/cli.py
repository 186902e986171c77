# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The command line ``velocity_estimator``, which finds its commands through entry points.

A command is a `Command`: its module adds its arguments and runs. Errors that a user can correct are
one line; exit codes are 0 (done), 1 (failed), 2 (usage error) and 128 + N (ended by signal N).
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import shlex
import signal
import sys
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from estimator_pkg import __version__, destination, interrupts, registry, whole_file
from estimator_pkg.destination import STDOUT
from estimator_pkg.errors import UsageError, UserError, suggestion
from estimator_pkg.optional import missing
from estimator_pkg.printable import PrintableStream, printable, show

WIDTH = 80
INTERRUPTED = 128  # plus the number of the signal: exit code after a signal


@dataclass(frozen=True)
class Command:
    """A command, as an entry point of the group ``velocity_estimator.commands`` names it.

    Attributes
    ----------
    summary : one line.
    arguments : adds the command's arguments to its parser.
    run : (arguments) -> result, a dictionary for ``--json`` (or None). It prints the readable
        output. 'ok': False makes the exit code 1; 'interrupted': True makes it 128 plus the number
        of the signal, as for a command without a result.
    examples : (arguments, what they do), shown by ``--help``.
    """

    summary: str
    arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], dict[str, Any] | None]
    examples: tuple[tuple[str, str], ...] = ()


class _Parser(argparse.ArgumentParser):
    """Errors are one line that points to --help."""

    def error(self, message: str):
        show(f"{self.prog}: {message} (see '{self.prog} --help')", file=sys.stderr)
        raise SystemExit(2)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    prog = ' '.join(['velocity_estimator', *words[:1]])
    try:
        return guarded(lambda: _find_and_run(words, prog), prog)
    finally:
        if arguments is None and 'rclpy' in sys.modules:
            interrupts.limit_end()


def guarded(task: Callable[[], int], prog: str) -> int:
    """Run a task with printable output; return its exit code, also after an error.

    Parameters
    ----------
    task : returns an exit code.
    prog : name at the start of an error's line.
    """
    with contextlib.ExitStack() as stack:
        for stream, redirect in (
            (sys.stdout, contextlib.redirect_stdout),
            (sys.stderr, contextlib.redirect_stderr),
        ):
            if stream is not None and not isinstance(stream, PrintableStream):
                stack.enter_context(redirect(PrintableStream(stream)))
        stack.enter_context(interrupts.handled())
        return _ended(task, prog)


def _ended(task: Callable[[], int], prog: str) -> int:
    """Run one command to its end, however it ends; returns the exit code."""
    try:
        try:
            return task()
        finally:  # here, so that a closed pipe or a full disk is reported in one line
            if sys.stdout is not None:
                sys.stdout.flush()
    except UserError as error:
        interrupts.say(f'{prog}: {error}')
        return error.exit_code
    except (KeyboardInterrupt, ImportError) as error:
        if _interrupted(error):
            interrupts.finish()
            interrupts.say(f'{prog}: interrupted')
            return INTERRUPTED + (interrupts.came() or signal.SIGINT)
        line = missing(error)
        if line is None:
            raise
        interrupts.say(f'{prog}: {line}')
        return 1
    except BrokenPipeError:  # the reader of our output ended, as with `| head`
        _give_up_output()
        return 1
    except OSError as error:
        interrupts.say(f'{prog}: {error.filename or "output"}: {error.strerror or error}')
        if error.filename is None:
            _give_up_output()
        return 1


def _find_and_run(words: list[str], prog: str) -> int:
    if not words or words[0] in ('-h', '--help'):
        print(_overview())
        return 0 if words else 2
    if words[0] == '--version':
        print(__version__)
        return 0
    name = words[0]
    if name not in registry.names(registry.COMMANDS):
        show(
            f"velocity_estimator: unknown command '{name}': "
            f'{suggestion(name, registry.names(registry.COMMANDS))}',
            file=sys.stderr,
        )
        return 2
    return run(registry.find(registry.COMMANDS, name), words[1:], prog)


def parser_of(command: Command, prog: str) -> argparse.ArgumentParser:
    """Return the parser of a command, whose help ends with its examples."""
    lines = ['examples:'] * bool(command.examples)
    for words, meaning in command.examples:
        lines += [f'  # {meaning}', *_broken(f'{prog} {words}')]
    parser = _Parser(
        prog=prog,
        description=command.summary,
        epilog='\n'.join(lines),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.arguments(parser)
    parser.add_argument(
        '--json', metavar='FILE', help="the result as JSON ('-': to stdout, and the text to stderr)"
    )
    return parser


def add_set(parser: argparse.ArgumentParser, help: str) -> None:
    """Add the option ``--set KEY=VALUE``, whose values `parse_assignments` reads."""
    parser.add_argument('--set', metavar='KEY=VALUE', action='append', default=[], help=help)


def _broken(line: str) -> list[str]:
    """Return a command line for a shell in lines of 80 columns."""
    found = textwrap.wrap(
        line, WIDTH - 4, subsequent_indent='    ', break_long_words=False, break_on_hyphens=False
    )
    return [f'  {each} \\' for each in found[:-1]] + [f'  {each}' for each in found[-1:]]


def run(command: Command, words: Sequence[str], prog: str) -> int:
    """Parse the arguments of a command and run it; returns the exit code."""
    parser = parser_of(command, prog)
    parsed = parser.parse_args(words)
    parsed.line = f'{prog} {shlex.join(words)}'
    _check_filled(parser, parsed)
    to_stdout = parsed.json == STDOUT
    destination.check_distinct(parsed)
    if parsed.json is not None and not to_stdout:
        destination.check(parsed.json)
    shown = sys.stderr if to_stdout else sys.stdout
    with contextlib.redirect_stdout(shown):
        result = command.run(parsed)
        if parsed.json is not None and not to_stdout:
            _write_json(parsed.json, result)
    if to_stdout:
        _write_json(STDOUT, result)
    if result and result.get('interrupted'):
        return INTERRUPTED + (interrupts.came() or signal.SIGINT)
    return 1 if result and result.get('ok') is False else 0


def _check_filled(parser: argparse.ArgumentParser, parsed: argparse.Namespace) -> None:
    """Raise UsageError for an empty argument, as of a variable that a shell does not know."""
    for action in parser._actions:
        value = getattr(parsed, action.dest, None)
        if value != action.default and (value == '' or (isinstance(value, list) and '' in value)):
            name = action.option_strings[-1] if action.option_strings else action.metavar
            raise UsageError(f'{name} is empty: give a name')


def _give_up_output() -> None:
    """Discard the rest of the output, so that the process ends without another error."""
    with contextlib.suppress(OSError, ValueError):  # stdout may have no file
        interrupts.discard(sys.stdout.fileno())


def _interrupted(error: BaseException | None) -> bool:
    """Return True for Ctrl-C, which becomes an ImportError during the import of a C extension."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _write_json(path: str, result: Any) -> None:
    text = json.dumps(_strict(result), indent=2, allow_nan=False)
    if path == STDOUT:
        print(text)
    else:
        whole_file.write_text(path, text + '\n')


def _strict(value: Any) -> Any:
    """Return a value for JSON: NaN and infinity become null, numpy's numbers Python's."""
    if isinstance(value, dict):
        return {str(key): _strict(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_strict(item) for item in value]
    if hasattr(value, 'tolist'):
        return _strict(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


_START = (
    'Start with a bag of angles:  velocity_estimator doctor BAG',
    'or without any data:         velocity_estimator demo',
)


def _overview() -> str:
    lines = ['usage: velocity_estimator COMMAND ...', '', 'commands:']
    for name in registry.names(registry.COMMANDS):
        try:
            summary = registry.find(registry.COMMANDS, name).summary
        except UserError as error:
            summary = printable(f'({error})')
        lines.append(f'  {name:<12} {summary}')
    lines += ['', "'velocity_estimator COMMAND --help' describes a command, with examples."]
    return '\n'.join([*lines, *_START])


if __name__ == '__main__':
    sys.exit(main())
