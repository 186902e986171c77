# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Mutation testing: small changes of the code, and whether a test notices.

    make mutants                              # 500 of seed 1
    python test/mutants/run.py --count 60 --seed 2

cosmic-ray makes the changes, one at a time, in a copy of estimator_pkg. First all tests of MODULES
run once under coverage: which test runs which line, and how long it takes. Each mutant is then
judged by the tests that run its line, the quickest first, in plain Python. What
was judged is kept in build/mutants, see `still_true`. Verdicts on survivors are in survivors.yaml;
the table is docs/mutants.md.
"""

from __future__ import annotations

import argparse
import difflib
import hashlib
import json
import math
import os
import re
import shutil
import subprocess
import sys
import time
from collections import Counter, defaultdict
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Queue

import yaml
from cosmic_ray.commands import init
from cosmic_ray.mutating import apply_mutation, mutate_and_test
from cosmic_ray.plugins import get_operator
from cosmic_ray.work_db import WorkDB, use_db

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
WORK = ROOT / 'build' / 'mutants'
PAGE = ROOT / 'docs' / 'mutants.md'
VERDICTS = HERE / 'survivors.yaml'

SOURCES = (
    'driver/*.py',
    'messages/*.py',
    'sensor/*.py',
    'observers/*.py',
    'observers/angle/**/*.py',
    *(
        f'observers/maths/{name}.py'
        for name in ('covariance', 'steady_noise', 'tracking', 'twisting')
    ),
)
# Without DDS; what takes long in plain Python is left out test by test
MODULES = (
    'bags/test_replay.py',
    'driver/test_*.py',
    'messages/*.py',
    'evaluation/compare/test_per_sample.py',
    'nodes/test_pmsm_parts.py',
    'observers/adaptive/*.py',
    'observers/angle/**/test_*.py',
    'observers/switched/*.py',
    'observers/test_*.py',
    'sim/reproduce/test_hybrid_angle.py',
    'test_listing.py',
    'test_outputs.py',
    'test_parameters.py',
)
DECLARED = 'test/test_listing.py::'  # tests that read all declared parameters
LONGEST = 15.0  # s of CPU: a test that takes longer, under coverage, is cut off and left out
BUDGET = 40.0  # s of CPU: the tests of one mutant together
QUICK = 60  # tests among which the first round is
ENOUGH = 0.9  # of the mutants that are not equivalent must die
LARGE = 50.0  # a number beyond it, changed by one, is the same to within 2 %

# These die by a TypeError, or change nothing: bits of floats, `is` with numbers, annotations
NO_NEWS = re.compile(
    r'(Binary.*_(BitAnd|BitOr|BitXor|LShift|RShift)$|BinaryOperator_BitOr_'
    r'|ComparisonOperator_(?!Is_IsNot|IsNot_Is)(.*_)?Is(Not)?(_|$)'
    r'|NoOp|RemoveDecorator|Variable)'
)


def sources() -> list[Path]:
    """The files that are changed, relative to the checkout."""
    return sorted(
        {
            path.relative_to(ROOT)
            for pattern in SOURCES
            for path in (ROOT / 'estimator_pkg').glob(pattern)
            if path.name != '__init__.py'
        }
    )


def is_news(mutation) -> bool:
    """False for what NO_NEWS names, and for a number that is changed by less than 2 %."""
    if NO_NEWS.search(mutation.operator_name):
        return False
    (line, first), (_, last) = mutation.start_pos, mutation.end_pos
    text = Path(mutation.module_path).read_text().splitlines()[line - 1]
    if text.lstrip().startswith('@'):
        return False
    if mutation.operator_name != 'core/NumberReplacer':
        return True
    try:
        return abs(float(text[first:last])) <= LARGE
    except ValueError:
        return True


def sample(count: int, seed: int) -> list:
    """`count` mutations: places of the code drawn without repetition, and one change of each.

    Each place has a number of its own, drawn from the seed, its file, its line's text and its place
    in it; the lowest are the sample. So a change of the code leaves the rest of the sample.
    """
    places = defaultdict(list)
    WORK.mkdir(parents=True, exist_ok=True)
    with use_db(str(WORK / 'session.sqlite'), WorkDB.Mode.create) as session:
        init([ROOT / path for path in sources()], session, {})
        for item in session.work_items:
            mutation = item.mutations[0]
            if is_news(mutation):
                path = Path(mutation.module_path).relative_to(ROOT)
                places[str(path), mutation.start_pos, mutation.end_pos].append(mutation)
    print(
        f'{sum(map(len, places.values()))} mutations at {len(places)} places in '
        f'{len(sources())} files'
    )
    texts = {path: (ROOT / path).read_text().splitlines() for path, _, _ in places}
    alike: Counter = Counter()  # lines of the same text in a file
    drawn = []
    for path, (line, first), last in sorted(places):
        text = texts[path][line - 1].strip()
        place = (path, text, first, last[1])
        alike[place] += 1
        drawn.append((number(seed, *place, alike[place]), (path, (line, first), last)))
    return [
        min(
            places[place],
            key=lambda one: number(seed, one.operator_name, one.operator_args, drawn_as),
        )
        for drawn_as, place in sorted(drawn)[:count]
    ]


def number(*what) -> str:
    """Digits that follow from this alone."""
    return hashlib.sha256(repr(what).encode()).hexdigest()


# ---- which tests run which line


def workspace(name: str) -> Path:
    """A new folder with a copy of estimator_pkg."""
    folder = WORK / name
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(
        ROOT / 'estimator_pkg',
        folder / 'estimator_pkg',
        ignore=shutil.ignore_patterns('__pycache__'),
    )
    (folder / 'sim_pkg').symlink_to(ROOT / 'sim_pkg')
    return folder


def environment(folder: Path, **more: str) -> dict[str, str]:
    """What pytest runs in: the copy before the installed package, one thread, no bytecode kept."""
    return {
        **os.environ,
        'PYTHONPATH': os.pathsep.join((str(folder), str(HERE))),
        'PYTHONDONTWRITEBYTECODE': '1',
        'OMP_NUM_THREADS': '1',
        'OPENBLAS_NUM_THREADS': '1',
        'HYPOTHESIS_STORAGE_DIRECTORY': str(folder / 'hypothesis'),
        **more,
    }


def pytest(modules) -> list[str]:
    """The command that runs these test modules."""
    return [
        str(Path(sys.executable).parent / 'pytest'),
        '-c',
        str(ROOT / 'pyproject.toml'),
        '--rootdir',
        str(ROOT),
        '-x',
        '-q',
        '-p',
        'judge',
        '-p',
        'no:cacheprovider',
        '-p',
        'no:rerunfailures',
        '-p',
        'no:timeout',  # by the clock; here CPU time counts
        '-p',
        'no:faulthandler',
        '--hypothesis-seed',
        '0',
        *modules,
    ]


def modules_of(patterns) -> list[str]:
    """The test files, relative to test/, that these patterns name."""
    return sorted(
        {
            str(path.relative_to(ROOT / 'test'))
            for pattern in patterns
            for path in (ROOT / 'test').glob(pattern)
        }
    )


def fingerprint(*modules: str) -> str:
    """Of everything that decides which lines the tests of these modules run."""
    digest = hashlib.sha256(str(LONGEST).encode())
    helpers = [path for path in (ROOT / 'test').glob('*.py') if not path.stem.startswith('test_')]
    for path in sorted(
        [
            *(ROOT / 'estimator_pkg').rglob('*.py'),
            *helpers,
            *(ROOT / 'test' / module for module in modules),
        ]
    ):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def look(module: str) -> dict:
    """Of each test of a module that passes: its CPU time [s] and the lines it runs.

    Kept until any source or test changes.
    """
    name = module.removesuffix('.py').replace('/', '_')
    kept = WORK / f'tests_{name}_{fingerprint(module)}.json'
    if not kept.exists():
        folder = workspace(f'look_{name}')
        command = [part for part in pytest([f'{ROOT}/test/{module}']) if part != '-x']
        subprocess.run(
            command,
            env=environment(
                folder, MUTANTS_COVER=str(folder / 'tests.json'), MUTANTS_LONGEST=str(LONGEST)
            ),
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            check=False,
        )
        shutil.move(folder / 'tests.json', kept)
        shutil.rmtree(folder)
    return json.loads(kept.read_text())


def tests(modules, jobs: int) -> dict:
    """{nodeid: {'time': CPU s, 'lines': {file: [line]}}} of the tests that judge."""
    WORK.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(jobs) as pool:
        parts = list(pool.map(look, modules))
    return {name: test for part in parts for name, test in part.items()}


def judges(known: dict, path: str, lines: range) -> list[str]:
    """The tests that run one of these lines, the quickest first, within the budget.

    A line that runs at import alone (a constant) is judged by all that run anything of its file (of
    its folder, if there are constants alone), by the tests named after it, and by those that read
    what all files declare.
    """
    by_line = [
        name
        for name, test in known.items()
        if not set(lines).isdisjoint(test['lines'].get(path, ()))
    ]
    if not by_line:
        folder, _, file = path.rpartition('/')
        own = f'test{folder.removeprefix("estimator_pkg")}/test_{file}::'
        near = path if any(path in test['lines'] for test in known.values()) else folder
        by_line = [
            name
            for name, test in known.items()
            if name.startswith((DECLARED, own))
            or any(ran.startswith(near) for ran in test['lines'])
        ]
    chosen, total = [], 0.0
    for name in sorted(by_line, key=lambda name: (known[name]['time'], name)):
        total += known[name]['time']
        if total > BUDGET and chosen:
            break
        chosen.append(name)
    return chosen


# ---- one mutant


def change(mutation) -> tuple[str, str]:
    """(removed, added) line of the source."""
    operator = get_operator(mutation.operator_name)(**mutation.operator_args)
    before, after = apply_mutation(mutation.module_path, operator, mutation.occurrence)
    Path(mutation.module_path).write_text(before)
    lines = list(difflib.ndiff(before.splitlines(), after.splitlines()))
    return tuple(
        ' '.join(line[2:].strip() for line in lines if line[:2] == sign) for sign in ('- ', '+ ')
    )


def judge(mutation, folder: Path, known: dict) -> dict:
    """What became of a mutant: 'killed', 'survived' or 'no test'."""
    path = Path(mutation.module_path).relative_to(ROOT)
    here = type(mutation)(
        folder / path,
        mutation.operator_name,
        mutation.occurrence,
        mutation.start_pos,
        mutation.end_pos,
    )
    removed, added = change(here)
    chosen = judges(known, str(path), range(mutation.start_pos[0], mutation.end_pos[0] + 1))
    row = {
        'file': str(path),
        'line': mutation.start_pos[0],
        'removed': removed,
        'added': added,
        'operator': mutation.operator_name,
        'tests': len(chosen),
    }
    if not chosen:
        return {**row, 'outcome': 'no test'}
    begun = time.monotonic()
    for part in rounds(chosen):
        outcome, by = attempt(here, folder, part, sum(known[name]['time'] for name in part))
        if outcome != 'survived':
            break
    return {**row, 'outcome': outcome, 'seconds': round(time.monotonic() - begun, 1), 'by': by}


def rounds(chosen: list[str]) -> list[list[str]]:
    """Part tests: first the quick ones of one module, because the imports of all take 5 s."""
    quick = chosen[:QUICK]
    module, _ = Counter(name.split('::')[0] for name in quick).most_common(1)[0]
    first = [name for name in quick if name.startswith(f'{module}::')]
    return [part for part in (first, [name for name in chosen if name not in first]) if part]


def attempt(here, folder: Path, chosen: list[str], takes: float) -> tuple[str, str]:
    """(what became of a mutant in these tests, which of them failed).

    Parameters
    ----------
    takes : CPU time of the tests [s].
    """
    (folder / 'chosen.json').write_text(json.dumps(chosen))
    modules = sorted({str(ROOT / name.split('::')[0]) for name in chosen})
    seconds = round(3.0 * takes + 30.0)
    settings = environment(
        folder, MUTANTS_CHOSEN=str(folder / 'chosen.json'), MUTANTS_SECONDS=str(seconds)
    )
    words = [f'{name}={value}' for name, value in settings.items() if value != os.environ.get(name)]
    result = mutate_and_test(
        [here], ' '.join(['env', *words, *pytest(modules)]), timeout=20.0 * seconds
    )
    output = (result.output or '').strip().splitlines()
    by = (name for name in chosen if any(line.startswith(f'FAILED {name}') for line in output))
    return result.test_outcome.value, next(by, (output[-1] if output else '')[:160])


def still_true(row: dict, text: str, everything: str, known: dict, looked_at: dict) -> bool:
    """Return True if the outcome still holds: nothing changed since, or it follows from its file.

    A mutant that died in a file with this text stays dead while the test that failed exists, and
    one that is equivalent stays so.

    Parameters
    ----------
    text, everything : fingerprints of its file, and of all sources and tests.
    looked_at : see `verdicts`.
    """
    if row['of'] != text:
        return False
    if row['outcome'] == 'killed':
        lasts = '::' not in row['by'] or row['by'] in known
    else:
        lasts, _ = looked_at.get((row['file'], row['removed'], row['added']), (False, ''))
    return lasts or row['everything'] == everything


# ---- the table


def verdicts() -> dict:
    """{(file, removed, added): (equivalent, why)} of the survivors that were looked at."""
    rows = yaml.safe_load(VERDICTS.read_text()) if VERDICTS.exists() else None
    return {
        (row['file'], row['removed'], row['added']): (row['equivalent'], row['why'])
        for row in rows or ()
    }


def table(rows: list[dict], seed: int) -> tuple[str, float]:
    """(the Markdown, part of those not equivalent that died)."""
    known = verdicts()
    alive = [row for row in rows if row['outcome'] != 'killed']
    same = [
        row
        for row in alive
        if known.get((row['file'], row['removed'], row['added']), (False, ''))[0]
    ]
    part = (len(rows) - len(alive)) / max(1, len(rows) - len(same))
    counts: dict[str, Counter] = defaultdict(Counter)
    for row in rows:
        counts[row['file']][row['outcome'] == 'killed'] += 1
    lines = [
        f'Seed {seed}: {len(rows)} mutants, {len(rows) - len(alive)} killed, {len(same)} '
        f'equivalent, {len(alive) - len(same)} alive: {100.0 * part:.1f} % of those that are '
        'not equivalent died.',
        '',
        '| file | mutants | killed |',
        '|---|---|---|',
        *(
            f'| {name} | {sum(each.values())} | {each[True]} |'
            for name, each in sorted(counts.items())
        ),
        '',
        'Survivors:',
        '',
        '| file, line | before | after | verdict |',
        '|---|---|---|---|',
    ]
    for row in sorted(alive, key=lambda row: (row['file'], row['line'])):
        equivalent, why = known.get(
            (row['file'], row['removed'], row['added']), (False, 'not looked at yet')
        )
        cells = (
            f'{row["file"]}:{row["line"]}',
            f'`{row["removed"]}`',
            f'`{row["added"]}`',
            f'{"equivalent: " if equivalent else ""}{why}'
            f'{" (no test runs it)" if row["outcome"] == "no test" else ""}',
        )
        lines.append('| ' + ' | '.join(cell.replace('|', '\\|') for cell in cells) + ' |')
    return '\n'.join(lines), part


def main() -> int:
    """Sample, judge, write the table; 1 if too many survive."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--count', type=int, default=500, help='mutants to judge')
    parser.add_argument('--seed', type=int, default=1, help='random seed of the sample')
    parser.add_argument('--jobs', type=int, default=2, help='judged at the same time')
    parser.add_argument(
        '--modules',
        nargs='+',
        default=MODULES,
        metavar='NAME',
        help='test files that judge, as patterns below test/',
    )
    parser.add_argument(
        '--minutes',
        type=float,
        default=math.inf,
        help='judge no further mutant after so long; the next run goes on',
    )
    parser.add_argument('--page', action='store_true', help=f'write the table into {PAGE.name}')
    parsed = parser.parse_args()
    end = time.monotonic() + 60.0 * parsed.minutes
    chosen = sample(parsed.count, parsed.seed)
    modules = modules_of(parsed.modules)
    known = tests(modules, parsed.jobs)
    print(f'{len(known)} tests, {sum(test["time"] for test in known.values()):.0f} s together')
    everything = fingerprint(*modules)
    texts = {str(path): number((ROOT / path).read_text())[:16] for path in sources()}
    kept = WORK / 'judged.jsonl'
    judged, looked_at = {}, verdicts()
    for line in kept.read_text().splitlines() if kept.exists() else ():
        row = json.loads(line)
        if still_true(row, texts.get(row['file'], ''), everything, known, looked_at):
            judged[row['key'], row['of']] = row
    folders: Queue = Queue()
    for k in range(parsed.jobs):
        folders.put(workspace(f'copy_{k}'))

    def one(mutation) -> dict | None:
        name = key(mutation)
        if name in judged:
            return judged[name]
        if time.monotonic() > end:
            return None
        folder = folders.get()
        try:
            row = judge(mutation, folder, known)
        finally:
            folders.put(folder)
        with kept.open('a') as file:
            row = {'key': name[0], 'of': name[1], 'everything': everything, **row}
            file.write(json.dumps(row) + '\n')
        print(
            f'{row["outcome"]:9} {row["file"]}:{row["line"]}  {row["removed"]}  ->  {row["added"]}',
            flush=True,
        )
        return row

    def key(mutation) -> tuple[str, str]:
        path = str(Path(mutation.module_path).relative_to(ROOT))
        arguments = json.dumps(mutation.operator_args, sort_keys=True)
        return f'{path} {mutation.operator_name} {arguments} {mutation.occurrence}', texts[path]

    before = sum(key(mutation) in judged for mutation in chosen)
    if before:
        print(f'{before} were judged before')
    with ThreadPoolExecutor(parsed.jobs) as pool:
        rows = [row for row in pool.map(one, chosen) if row]
    if len(rows) < len(chosen):
        print(f'{len(rows)} of {len(chosen)} judged')
    text, part = table(rows, parsed.seed)
    print(text)
    if parsed.page:
        head = PAGE.read_text().split('<!-- table -->')[0]
        PAGE.write_text(f'{head}<!-- table -->\n\n{text}\n')
    return 0 if part >= ENOUGH else 1


if __name__ == '__main__':
    sys.exit(main())
