# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Write or check the numbers on the pages with the commands that produce them.

    make figures                                    # writes all of figures.yaml into the pages
    python -m docs.tools.figures --check --quick    # only prints what differs
    python -m docs.tools.figures README.md          # one page

An entry of docs/tools/figures.yaml names a page, the commands to run and one of

- ``text``: a text of the page, in which ``{{expression:format}}`` replaces a number;
- ``lines: true``: each line of the output that is also on the page, except for its numbers, in the
  same order. An indented block
  that has a line of the output must have no other line, except for ``...`` and commands;
- ``lines: EXPRESSION``: the same, with the text of an expression in place of the output.

Numbers agree within ``tolerance`` (relative, 0.02 if unset) or the rounding of the last printed
digit; at tolerance 0 they must be equal. In expressions ``r`` is the JSON of the last command and
``runs`` a list of all. ``rms(observer, run)`` [rad/s], ``delay(observer, run)`` [ms] and
``covered(joint, run)`` [%] come from ``evaluate``; ``run`` is the last one if unset.
``csv_of(rows)`` is the CSV file of the rows of ``--part accuracy``.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections import defaultdict, deque
from functools import lru_cache
from pathlib import Path

import yaml

from benchmarks import __main__ as benchmarks
from benchmarks import accuracy
from estimator_pkg import cli

ROOT = Path(__file__).resolve().parents[2]
NUMBER = re.compile(r'(?<![\w.#/])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w/])')
PLACE = re.compile(r'\{\{(.+?)(?::([^:{}]+))?\}\}')
QUOTED = re.compile(r'(?:^(?: {4}.*)?\n)+', re.MULTILINE)  # indented lines, and empty ones
COMMAND = re.compile(r'\s*(?:velocity_estimator|python|ros2|make) ')
TOLERANCE = 0.02
BENCHMARKS = ['python', '-m', 'benchmarks']


def entries() -> list[dict]:
    """Return the entries of docs/tools/figures.yaml."""
    return yaml.safe_load((Path(__file__).with_name('figures.yaml')).read_text())


@lru_cache
def outcome(commands: tuple[str, ...]) -> tuple[str, list]:
    """Run commands in a new folder; return (output of the last, JSON of each that wrote it)."""
    printed, results, before = '', [], Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for name in ('bags', 'config'):
            Path(name).symlink_to(ROOT / name)
        try:
            for number, command in enumerate(commands):
                words = shlex.split(command)
                main = cli.main
                if words[:3] == BENCHMARKS:
                    main, words = benchmarks.main, words[2:]
                elif words[0] != 'velocity_estimator':
                    printed = subprocess.run(
                        [sys.executable, *words[1:]],
                        text=True,
                        check=True,
                        env={**os.environ, 'PYTHONPATH': str(ROOT)},
                        capture_output=True,
                    ).stdout
                    continue
                out = io.StringIO()
                with contextlib.redirect_stdout(out):
                    code = main([*words[1:], '--json', f'{number}.json'])
                if code != 0:
                    raise RuntimeError(f'{command}: exit code {code}')
                printed = out.getvalue()
                results.append(json.loads(Path(f'{number}.json').read_text()))
        finally:
            os.chdir(before)
    return printed, results


def names(results: list) -> dict:
    """Return the names that expressions may use."""

    def estimates(run: int) -> dict:
        return next(iter(results[run]['bags'].values()))['estimates']

    def velocity(observer: str, run: int) -> dict:
        return next(iter(estimates(run)[observer]['joints'].values()))['velocity']

    def covered(joint: str, run: int = -1) -> float:
        return 100.0 * next(iter(estimates(run).values()))['joints'][joint]['coverage_95']

    return {
        'r': results[-1] if results else None,
        'runs': results,
        'rms': lambda observer, run=-1: velocity(observer, run)['rms'],
        'delay': lambda observer, run=-1: 1e3 * velocity(observer, run)['delay_s'],
        'covered': covered,
        'csv_of': accuracy.as_csv,
    }


def close(old: str, new: float, tolerance: float, units: float) -> bool:
    """Return True if `old` is within tolerance, or `units` of its last digit, of `new`."""
    digits, _, power = old.partition('e')
    unit = 10.0 ** (int(power or 0) - len(digits.partition('.')[2]))
    return abs(float(old) - new) <= (
        max(tolerance * abs(new), 1.001 * units * unit) if tolerance else 0.0
    )


def filled(page: str, entry: dict) -> tuple[str, list[str]]:
    """Return (the page with new numbers, descriptions of the differences)."""
    printed, results = outcome(tuple(entry.get('run', ())))
    tolerance = entry.get('tolerance', TOLERANCE)
    lines = entry.get('lines')
    if lines:
        return _lines(page, printed if lines is True else eval(lines, names(results)), tolerance)
    text = entry['text'].strip('\n')
    pattern, fresh, end = '', [], 0
    for place in PLACE.finditer(text):
        pattern += _literal(text[end : place.start()]) + r'([-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?)'
        end = place.end()
        fresh.append((eval(place.group(1), names(results)), place.group(2) or ''))
    found = re.search(pattern + _literal(text[end:]), page)
    if found is None:
        return page, [f'the page has no text like: {text}']
    differ = [
        f'{old} on the page, {value:.4g} now'
        for old, (value, _) in zip(found.groups(), fresh)
        if not close(old, value, tolerance, 0.5)
    ]
    for place in reversed(range(len(fresh))):
        first, last = found.span(place + 1)
        page = page[:first] + format(*fresh[place]) + page[last:]
    return page, differ


def _literal(text: str) -> str:
    """Return a pattern for this text that accepts other line breaks."""
    return r'\s+'.join(re.escape(word) for word in re.split(r'\s+', text))


def skeleton(line: str) -> str:
    """Return a line without its numbers, asterisks and widths."""
    return re.sub(r'[\s*]+', ' ', NUMBER.sub('#', line)).strip()


def _lines(page: str, printed: str, tolerance: float) -> tuple[str, list[str]]:
    fresh: dict[str, deque] = defaultdict(deque)
    for line in printed.splitlines():
        if NUMBER.search(line):
            fresh[skeleton(line)].append(line)
    lines, differ, met = page.split('\n'), [], 0
    for place, line in enumerate(lines):
        same = fresh.get(skeleton(line))
        if not same or not NUMBER.search(line):
            continue
        new = same.popleft().rstrip()
        met += 1
        pairs = list(zip(NUMBER.findall(line), NUMBER.findall(new)))
        wrong = [
            f'{old} on the page, {now} now: {line.strip()}'
            for old, now in pairs
            if not close(old, float(now), tolerance, 1.0)
        ]
        differ += wrong
        lines[place] = line[: len(line) - len(line.lstrip())] + new.strip()
    differ += _unprinted(page, printed)
    return '\n'.join(lines), differ if met else ['the page has no line of the output']


def _unprinted(page: str, printed: str) -> list[str]:
    """Return the lines that a quoted output has on the page, but the command does not print."""
    known, found = {skeleton(line) for line in printed.splitlines()}, []
    for block in QUOTED.findall(page):
        parts = [part for part in block.split('\n\n') if not COMMAND.match(part)]
        lines = [line for line in '\n'.join(parts).splitlines() if line.strip(' .')]
        other = [line.strip() for line in lines if skeleton(line) not in known]
        if 0 < len(other) < len(lines):
            found += [f'not in the output: {line}' for line in other]
    return found


def main() -> int:
    """Write the figures, or with --check only print differences; return 1 if there are any."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('pages', nargs='*', help='pages, for example README.md (default: all)')
    parser.add_argument('--check', action='store_true', help='write nothing; exit code 1 if wrong')
    parser.add_argument('--quick', action='store_true', help='skip entries that take minutes')
    parsed = parser.parse_args()
    wrong = False
    for entry in entries():
        if (parsed.pages and entry['page'] not in parsed.pages) or (
            parsed.quick and entry.get('slow')
        ):
            continue
        path = ROOT / entry['page']
        page, differ = filled(path.read_text(), entry)
        wrong = wrong or bool(differ)
        print(f'{entry["page"]}: {"; ".join(entry.get("run", ["(no command)"]))}', flush=True)
        for line in differ:
            print(f'    {line}')
        if not parsed.check:
            path.write_text(page)
    return int(wrong and parsed.check)


if __name__ == '__main__':
    sys.exit(main())
