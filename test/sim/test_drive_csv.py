# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""docs/examples/drive_csv.py: a drive's log to a bag, and back."""

import sys

import numpy as np
import pytest

from docs.examples import drive_csv
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.series import joint_series
from estimator_pkg.messages import drive_samples

TIME = np.arange(450) / 5000.0
CURRENT = 8.0 * np.exp(1j * (300.0 * TIME - 0.4))
VOLTAGE = 20.0 * np.exp(1j * 300.0 * TIME)
SPEED = 60.0 + TIME
TRUTH = '/ground_truth/joint_states'


def phases(vector):
    return [(vector * np.exp(-2j * np.pi * k / 3.0)).real for k in range(3)]


def run(monkeypatch, *words):
    monkeypatch.setattr(sys, 'argv', ['drive_csv.py', *map(str, words)])
    return drive_csv.main()


def write(path, names, *arrays):
    lines = [','.join(names), *(','.join(map(repr, map(float, row))) for row in zip(*arrays))]
    path.write_text('\n'.join(lines) + '\n')
    return path


def read(path):
    with open_bag(str(path)) as bag:
        batches = [drive_samples.decode(bytes(m.raw)) for m in bag.messages(['/drive_samples'])]
        truth = joint_series(bag, TRUTH).get('motor') if TRUTH in bag.topics else None
    stamps = np.concatenate([batch.stamps_ns for batch in batches])
    return len(batches), stamps, np.concatenate([batch.values for batch in batches]), truth


EXPECTED = np.column_stack([CURRENT.real, CURRENT.imag, VOLTAGE.real, VOLTAGE.imag])


@pytest.mark.parametrize('how', ['phases', 'two phases', 'alpha, beta'])
def test_each_form_of_a_log_gives_the_same_bag(how, tmp_path, monkeypatch):
    u = [each + 3.0 for each in phases(VOLTAGE)]  # the star point is not at zero
    names = ['t_ms', 'ia', 'ib', 'ic', 'ua', 'ub', 'uc', 'w']
    arrays = [1e3 * TIME, *phases(CURRENT), *u, SPEED]
    words = ['--current', 'ia,ib,ic', '--voltage', 'ua,ub,uc']
    if how == 'two phases':
        words = ['--current', 'ia,ib', '--voltage', 'ua,ub,uc', '--phases']
    if how == 'alpha, beta':
        names = ['t_ms', 'ia', 'ib', 'ua', 'ub', 'w']
        arrays = [1e3 * TIME, *EXPECTED.T, SPEED]
        words = ['--current', 'ia,ib', '--voltage', 'ua,ub']
    log = write(tmp_path / 'log.csv', names, *arrays)
    words += ['--time', 't_ms', '--time-unit', 'ms', '--speed', 'w']
    assert run(monkeypatch, 'to-bag', log, tmp_path / 'bag', *words) == 0
    batches, stamps, values, truth = read(tmp_path / 'bag')
    assert batches == 3 and stamps[0] > 0
    np.testing.assert_allclose((stamps - stamps[0]) * 1e-9, TIME, atol=1e-9)
    np.testing.assert_allclose(values, EXPECTED, atol=1e-9)
    np.testing.assert_allclose(truth.velocity, SPEED)

    assert run(monkeypatch, 'to-csv', tmp_path / 'bag', tmp_path / 'again.csv') == 0
    words = ['--time', 'time_s', '--current', 'i_a,i_b,i_c', '--voltage', 'u_a,u_b,u_c']
    assert run(monkeypatch, 'to-bag', tmp_path / 'again.csv', tmp_path / 'again', *words) == 0
    _, again, values, truth = read(tmp_path / 'again')
    assert np.array_equal(again, stamps) and truth is None
    np.testing.assert_allclose(values, EXPECTED, atol=1e-6)


def test_semicolons_and_decimal_commas_are_read(tmp_path, monkeypatch):
    log = write(tmp_path / 'log.csv', ['t', 'i', 'j', 'u', 'v'], TIME, *EXPECTED.T)
    text = log.read_text().replace(',', ';').replace('.', ',')
    log.write_text('\ufeff' + text)  # as a spreadsheet writes it
    words = ['--time', 't', '--current', 'i,j', '--voltage', 'u,v']
    assert run(monkeypatch, 'to-bag', log, tmp_path / 'bag', *words) == 0
    np.testing.assert_allclose(read(tmp_path / 'bag')[2], EXPECTED, atol=1e-9)


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('t,i,j,u\n0,1,2,3\n', "no column 'v'"),
        ('t,i,j,u,v\n0,1,2,3,4\n1,x,2,3,4\n', 'line 3'),
        ('t,i,j,u,v\n0,1,2,3\n', 'line 2'),
        ('t,i,j,u,v\n', 'no row'),
        ('t,i,j,u,v\n0,1,2,3,4\n1,1,2,3,4\n1,1,2,3,4\n', 'line 4: the time does not increase'),
    ],
)
def test_a_wrong_log_is_one_line(text, words, tmp_path, monkeypatch, capsys):
    (tmp_path / 'log.csv').write_text(text)
    names = ['--time', 't', '--current', 'i,j', '--voltage', 'u,v']
    assert run(monkeypatch, 'to-bag', tmp_path / 'log.csv', tmp_path / 'bag', *names) == 1
    error = capsys.readouterr().err
    assert words in error and error.count('\n') == 1
    assert not (tmp_path / 'bag').exists()
