# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``python -m benchmarks.rules``: what each rule of `edge_adaptive` is worth, as CSV.

rules.yaml says how each is switched off. The engine is built from sources without it and runs over
all streams of the checkout (signals, recordings, captures, and those of tests), with no quantum.
"""

from __future__ import annotations

import csv
import json
import pickle
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks import ROOT, accuracy, field, motions
from benchmarks.columns import Column, published, shared
from benchmarks.runner import covered
from estimator_pkg import observers
from estimator_pkg.engine.entries import entries, installed, path_of
from estimator_pkg.engine.translate import FLAGS, translate
from estimator_pkg.evaluation.entries import Entry

OBSERVER = 'edge_adaptive'
FOLDERS = {'edge': 'estimator_pkg/observers/angle/edge', 'sensor': 'estimator_pkg/sensor'}
TESTS = ('test/support', 'test/observers/angle')  # streams that tests have
STARTS, FAR = 280, 5.0  # random starts; standard deviations
SAME = 1.02  # a smaller ratio of errors names no stream


def rules() -> dict[str, tuple[str, str, str, str]]:
    """Return (what it is for, source, pattern, replacement) by the name of each rule."""
    read = yaml.safe_load((ROOT / 'benchmarks/rules.yaml').read_text())
    return {
        name: (purpose, f'{FOLDERS[folder]}/{source}.py', pattern, without)
        for folder, found in read.items()
        for name, (purpose, source, pattern, without) in found.items()
    }


def switched_off(source: str, pattern: str, without: str) -> str:
    """Return the text of a source without a rule; raise ValueError unless it is there once."""
    text, count = re.subn(pattern, without, (ROOT / source).read_text())
    if count != 1:
        raise ValueError(f'{source} has {pattern!r} {count} times: mend benchmarks/rules.yaml')
    return text


def columns() -> Iterator[tuple[str, Column]]:
    """Yield each column with the name of its list."""
    sys.path += [str(ROOT / each) for each in TESTS]
    from edge_streams import PHASES, streams

    for kind, found in {
        **field.columns(ROOT / 'bags'),
        field.SIGNALS: shared(accuracy.ALL),
    }.items():
        yield from ((kind, each) for each in found)
    for name in {**motions.MOTIONS, **motions.FAILURES}:
        yield 'motions', Column(name, motions.sampled(name), 0.0)
    for phase in PHASES:
        for name, samples, period in streams(phase):
            yield 'streams', Column(f'{name} @{phase}', samples, 0.0, period=period)


def measure(path: str) -> dict[str, Any]:
    """Return {list: {stream: (rms error [rad/s], covered part)}} of pickled columns, and starts."""
    from sigma_starts import MOTIONS, Case, measure

    found: dict[str, Any] = {}
    joints = lru_cache(lambda period: Entry(OBSERVER, OBSERVER).joint(wrap_period=period))
    for kind, column in pickle.loads(Path(path).read_bytes()):
        joint = joints(column.period)
        joint.reset()
        out = joint.run(column.samples.stamps, column.samples.angle)
        told = published(out) & column.counted & np.isfinite(out.velocity)
        error = (out.velocity - column.samples.velocity)[told]
        sigma = np.hypot(out.velocity_stddev[told], column.noise)
        rms = float(np.sqrt(np.mean(error**2)))
        found.setdefault(kind, {})[column.name] = rms, covered(error, sigma)
    random, beyond = np.random.default_rng(1), 0
    for seed in range(STARTS):
        motion, rate = str(random.choice(list(MOTIONS))), float(random.choice([1e3, 5e2, 2e2, 1e2]))
        bits, noise = int(random.choice([12, 14, 17])), float(random.choice([0.0, 0.1, 0.5, 3.0]))
        case = Case(motion, rate, bits, noise, bool(random.random() < 0.5), seed=seed)
        beyond += measure(OBSERVER, {}, case).worst > FAR
    return {**found, 'starts': beyond}


def without(path: Path, source: str = '', text: str = '') -> dict[str, Any]:
    """Build the sources with this text in place of one, in a folder of its own, and measure."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        for package in ('estimator_pkg', 'sim_pkg'):
            unused = shutil.ignore_patterns('__pycache__', '*.so')
            shutil.copytree(ROOT / package, root / package, ignore=unused)
        if source:
            (root / source).write_text(text)
        observer = path_of(observers.find(OBSERVER))
        own = [each for each in entries(installed(), root) if observer in each.static.values()]
        (root / 'engine.c').write_text(translate(own, root))
        build = ['cc', *FLAGS, '-fPIC', '-shared', 'engine.c', '-lm', '-o']
        subprocess.run([*build, 'estimator_pkg/_engine.so'], cwd=root, check=True)
        paths = [str(each) for each in (root, ROOT, *(ROOT / each for each in TESTS))]
        code = f'import sys; sys.path[:0] = {paths}; import json; from benchmarks import rules; '
        code += f'print(json.dumps(rules.measure({str(path)!r})))'
        return json.loads(subprocess.check_output([sys.executable, '-c', code], cwd=root))


def row(name: str, purpose: str, new: dict[str, Any], old: dict[str, Any]) -> list[str]:
    """Return the cells of a rule: ratios of the error without it over that with it."""
    ratios, covered, means = {}, [], []
    for kind in list(old)[:-1]:
        own = {each: new[kind][each][0] / old[kind][each][0] for each in old[kind]}
        covered += [100.0 * (new[kind][each][1] - old[kind][each][1]) for each in own]
        means.append(f'{np.exp(np.mean(np.log([*own.values()]))):.3f}')
        ratios.update(own)
    worst = max(ratios, key=ratios.__getitem__)
    needs = f'{worst}: {ratios[worst]:.3g}' if ratios[worst] > SAME else ''
    return [name, purpose, needs, *means, f'{np.mean(covered):+.2f}', str(new['starts'])]


def main() -> None:
    """Print the table, a row as soon as its rule is measured."""
    every = rules()
    texts = {name: switched_off(*rule[1:]) for name, rule in every.items()}
    with tempfile.NamedTemporaryFile() as file:
        path = Path(file.name)
        path.write_bytes(pickle.dumps([*columns()]))
        old = without(path)
        kinds = list(old)[:-1]
        ratios = [f'ratio_{each.lower().replace(" ", "_")}' for each in kinds]
        head = ['rule', 'purpose', 'needed_most_by', *ratios]
        table = csv.writer(sys.stdout, lineterminator='\n')
        table.writerow([*head, 'coverage_change_percent', 'starts_beyond_5_sigma'])
        table.writerow(['all', '', '', *[1] * len(kinds), 0, old['starts']])
        for name, (purpose, source, *_) in every.items():
            new = without(path, source, texts[name])
            table.writerow(row(name, purpose, new, old))
            sys.stdout.flush()


if __name__ == '__main__':
    main()
