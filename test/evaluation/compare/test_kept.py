# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Arrays that wait in a file, and comparisons that are made of them."""

import json
import math
import pickle
import shlex
import tempfile

import numpy as np
import pytest

from estimator_pkg.cli import main
from estimator_pkg.evaluation.compare import comparison as kept
from estimator_pkg.evaluation.compare.comparison import Kept


@pytest.fixture
def all_in_files(monkeypatch):
    """As if every array were long; the number of files made."""
    made = []
    monkeypatch.setattr(kept, 'LONG', 1)
    usual = tempfile.TemporaryFile

    def counted(*words, **names):
        made.append(1)
        return usual(*words, **names)

    monkeypatch.setattr(kept.tempfile, 'TemporaryFile', counted)
    return made


def test_what_is_kept_comes_back_as_often_as_asked(all_in_files):
    for values in (
        np.linspace(0.0, 1.0, 1001),
        np.array([math.nan, -0.0]),
        np.arange(5, dtype='i1'),
        np.arange(10.0)[::2],
    ):
        held = Kept(values)
        for copy in (held.get(), held.get(), pickle.loads(pickle.dumps(held)).get()):
            assert copy.dtype == values.dtype and copy.tobytes() == values.tobytes()
    assert len(all_in_files) == 8


def test_without_room_it_stays_in_memory(monkeypatch):
    def full(**names):
        raise OSError('no space left on device')

    monkeypatch.setattr(kept, 'LONG', 1)
    monkeypatch.setattr(kept.tempfile, 'TemporaryFile', full)
    assert Kept(np.arange(3)).get().tolist() == [0, 1, 2]


@pytest.mark.long
def test_a_report_does_not_depend_on_where_arrays_wait(tmp_path, all_in_files, monkeypatch):
    assert main(['simulate', 'encoder', '--duration', '2', '--out', str(tmp_path / 'bag')]) == 0
    found = []
    for long in (1, 10**9):
        monkeypatch.setattr(kept, 'LONG', long)
        page, result = tmp_path / f'{long}.html', tmp_path / f'{long}.json'
        assert (
            main(
                [
                    'evaluate',
                    str(tmp_path / 'bag'),
                    *shlex.split('--observer pll --observer kalman --skip 0.2'),
                    '--html',
                    str(page),
                    '--json',
                    str(result),
                    '--data',
                    str(tmp_path / 'numbers.npz'),
                ]
            )
            == 0
        )
        with np.load(tmp_path / 'numbers.npz') as full:
            found.append((json.loads(result.read_text()), {name: full[name] for name in full}))
    assert found[0][0] == found[1][0]
    assert found[0][1].keys() == found[1][1].keys()
    for name, values in found[0][1].items():
        assert np.array_equal(values, found[1][1][name], equal_nan=True), name
    # velocity and deviation of two observers, and of the finite difference that the page adds
    assert len(all_in_files) == 6
