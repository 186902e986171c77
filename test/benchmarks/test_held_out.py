# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The held-out recordings: how a listed file is read, and how the observers are compared."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import held_out
from benchmarks.held_out import Listed
from benchmarks.laws import ours
from benchmarks.runner import printed
from estimator_pkg.errors import UserError

RATE, TURN = 200.0, 2.0 * np.pi


def _listed(folder: Path, text: str, **keys: Any) -> Listed:
    """Write a file below `folder` as the list names it, and return its entry."""
    (folder / 'owner/name').mkdir(parents=True, exist_ok=True)
    (folder / 'owner/name/log.csv').write_text(text)
    digest = hashlib.sha256(text.encode()).hexdigest()
    common = {'repository': 'owner/name', 'commit': 'c', 'path': 'log.csv', 'what': 'a joint'}
    files = {'log.csv': digest}
    return Listed('joint', {**common, 'truth': 'sensor', 'files': files, **keys}, 0.5)


def _motion(count: int = 600) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    time = np.arange(count) / RATE
    return time, 0.3 + np.sin(TURN * time), TURN * np.cos(TURN * time)


def _log(*columns: np.ndarray) -> str:
    rows = '\n'.join(', '.join(f'{value:.9g}' for value in row) for row in zip(*columns))
    return f'# a header; of three words\ntime, angle, velocity\n{rows}\nnan, nan, nan\n'


def test_a_log_is_read_with_its_units_and_ends_where_its_time_restarts(tmp_path: Path) -> None:
    time, angle, velocity = _motion()
    ring = _log(
        np.append(8000.0 * time, 0.0), np.append(angle / TURN, 9.0), np.append(velocity / TURN, 9.0)
    )
    series = _listed(
        tmp_path,
        ring,
        time={'column': 0, 'unit': 1.25e-4},
        angle={'column': 1, 'unit': TURN},
        velocity={'column': 2, 'unit': TURN},
    )
    column = held_out.column(tmp_path, series)
    assert len(column.samples.angle) == len(time)
    np.testing.assert_allclose(column.samples.angle, angle, atol=1e-6)
    np.testing.assert_allclose(np.diff(column.samples.stamps), 5_000_000, atol=2)
    inside = np.isfinite(column.samples.velocity)
    np.testing.assert_allclose(column.samples.velocity[inside], velocity[inside], atol=0.02)
    assert np.mean(inside) > 0.95
    assert column.reference == 'sensor'


def test_a_yaw_is_unwrapped_thinned_and_rounded_with_the_reference_of_all(tmp_path: Path) -> None:
    time, angle, velocity = _motion()
    half = 0.5 * 3.0 * angle
    none = np.zeros(len(time))
    series = _listed(
        tmp_path,
        _log(time, np.cos(half), none, none, np.sin(half)),
        time={'column': 0},
        yaw=[1, 2, 3, 4],
        every=2,
        quantum=0.01,
    )
    column = held_out.column(tmp_path, series)
    assert len(column.samples.angle) == len(time) // 2
    np.testing.assert_allclose(column.samples.angle, 3.0 * angle[::2], atol=0.0101)
    counts = column.samples.angle / 0.01
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    middle = slice(20, -20)
    np.testing.assert_allclose(
        column.samples.velocity[middle], 3.0 * velocity[::2][middle], atol=0.05
    )


def test_a_missing_and_a_changed_file_are_named(tmp_path: Path) -> None:
    time, angle, _ = _motion()
    series = _listed(tmp_path, _log(time, angle, angle), rate=RATE, angle={'column': 1})
    log = tmp_path / 'owner/name/log.csv'
    log.write_text(log.read_text() + '1, 2, 3\n')
    with pytest.raises(UserError, match='not the listed file'):
        held_out.column(tmp_path, series)
    log.unlink()
    with pytest.raises(UserError, match=r'github.com/owner/name, commit c'):
        held_out.column(tmp_path, series)


def test_every_listed_series_has_its_file_its_angle_and_its_time() -> None:
    lists = {which: held_out.listed(which) for which in held_out.LISTS}
    names = [each.name for found in lists.values() for each in found]
    assert len(names) == len(set(names)) and len(lists['series']) >= 24
    for _, keys, _ in (each for found in lists.values() for each in found):
        assert len(keys['files'][keys['path']]) == 64 and len(keys['commit']) == 40
        assert ('angle' in keys or 'yaw' in keys) and ('time' in keys or 'rate' in keys)
    sources = {which: {each.keys['repository'] for each in found} for which, found in lists.items()}
    contact = sources.pop('contact')
    assert len(contact) >= 5 and not contact & set().union(*sources.values())
    files = Counter(each.keys['path'] for each in lists['contact'])
    assert set(files.values()) == {6, 1, 7}  # every joint of every file


@pytest.mark.long
def test_the_single_baseline_is_the_one_with_the_least_mean_and_the_best_is_never_worse(
    tmp_path: Path,
) -> None:
    time, angle, velocity = _motion(400)
    columns = []
    for name, quantum in (('fine', 1e-4), ('coarse', 2e-2)):
        series = _listed(
            tmp_path,
            _log(time, angle, velocity),
            time={'column': 0},
            angle={'column': 1},
            velocity={'column': 2},
            quantum=quantum,
        )
        columns.append(held_out.column(tmp_path, series._replace(name=name)))
    found = held_out.compared(columns, {'fine': 0.5, 'coarse': 0.5})
    assert [row['series'] for row in found['rows']] == ['fine', 'coarse']
    for row in found['rows']:
        assert row['judged'] and 0.0 < row['best'] <= row['single']
        edge = row['results']['edge_adaptive']
        assert edge['rms'] < 1.1 * row['best'] and 0.5 < edge['coverage'] <= 1.0
    means = []
    for family in ours():
        if family.name in held_out.BASELINES:
            for value in family.values:
                errors = [each.error(family.run(each, value))[0] for each in columns]
                means.append(np.sqrt(errors[0] * errors[1]))
    least = np.sqrt(found['rows'][0]['single'] * found['rows'][1]['single'])
    assert least == pytest.approx(min(means))
    single = found['ratios']['edge_adaptive / single']
    ratios = [row['results']['edge_adaptive']['rms'] / row['single'] for row in found['rows']]
    assert single['mean'] == pytest.approx(np.sqrt(ratios[0] * ratios[1]))
    assert single['near'] == 1.0 and single['worst'] == max(ratios)
    assert single['at_most'] == sum(ratio <= 1.0 for ratio in ratios) / 2
    sources = {'fine': 'robot', 'coarse': 'robot'}
    text = printed(held_out.describe({'first contact': {**found, 'sources': sources}}))
    assert '  fine ' in text and f'first contact: single: {found["single"]}' in text
    assert re.search(rf'(?m)^robot +2026-11-25 d93c8dff +2/2 +{single["mean"]:.2f} ', text)
    kept = Path(held_out.__file__).with_name('results') / 'held_out.csv'
    header = held_out.as_csv({'two joints': found}).partition('\n')[0]
    assert set(kept.read_text().partition('\n')[0].split(',')) <= set(header.split(','))


def test_first_contact_leaves_out_by_its_rule_and_freezes_the_baselines(tmp_path: Path) -> None:
    time, angle, velocity = _motion(700)
    columns = {'time': {'column': 0}, 'angle': {'column': 1}, 'velocity': {'column': 2}}
    moving = held_out.column(tmp_path, _listed(tmp_path, _log(time, angle, velocity), **columns))
    still = _log(time, 0.02 * angle, 0.02 * velocity)
    resting = held_out.column(tmp_path, _listed(tmp_path, still, **columns))
    thin = held_out.column(
        tmp_path, _listed(tmp_path, _log(time, angle, velocity), thin=5, **columns)
    )
    assert len(thin.samples.angle) == len(time) // 5
    assert [held_out.left_out(each) for each in (moving, resting, thin)] == ['', 'rest', 'short']
    frozen = {'pll': 28.12, 'finite_difference': 15.81, 'kalman velocity': 28.12}
    frozen['kalman acceleration'] = 15.81
    found = held_out.compared([moving], {'joint': 0.5}, frozen)
    assert found['single'] == 'pll, bandwidth_hz 28.1'
    law = next(each for each in ours() if each.name == 'pll')
    assert found['rows'][0]['single'] == moving.error(law.run(moving, 28.12))[0]


def test_a_json_log_has_its_fields_in_the_order_of_their_names(tmp_path: Path) -> None:
    path = tmp_path / 'log.json'
    path.write_text('{"entries": [{"t": 0.5, "angle": 2}, {"angle": 3, "t": 1.5}]}')
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    assert held_out._read(path, digest, 'entries', 0).tolist() == [[2.0, 0.5], [3.0, 1.5]]
