# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The reproduction of the adaptive paper: its rows, the plant they stand on, the figures."""

import re

import numpy as np
import pytest
import reproduced
from scipy.linalg import expm

from estimator_pkg import cli
from sim_pkg.reproduce.adaptive import plant as plant
from sim_pkg.reproduce.adaptive.paper import REPRODUCTION

QUICK = ('A6', 'recorded')
SLOW = [part.name for part in REPRODUCTION.parts if part.name not in QUICK]

test_every_row_is_within_its_tolerance = reproduced.rows(REPRODUCTION, SLOW)


def test_the_table_of_the_specification_is_whole():
    ids = [reference.id for reference in REPRODUCTION.references()]
    assert len(set(ids)) == len(ids)
    wanted = [
        f'A1 theta({t}) {name}' for t in (5, 10, 20, 40, 100) for name in ('l1', 'l2', 'b1', 'b2')
    ]
    wanted += [f'A2 theta({t}) b2' for t in (100, 200, 300, 400, 500)] + ['A2 physical(600) k']
    wanted += [
        f'A3 {form} {h} ms {name}'
        for form in ('Euler', 'FOH')
        for h in (1, 5, 10, 20)
        for name in ('-b/J', '-k/J', 'b1', 'b2', 'e_w')
    ]
    wanted += [f'A3 FOH Gamma x {g}, {h} ms' for g in (10, 100) for h in (1, 10, 20)]
    wanted += [
        f'A4b {name} {h} ms' for name in ('12 bit', '10 bit', 'sigma 0.01') for h in (1, 5, 20)
    ]
    wanted += [
        'A5a one sine e_wful',
        'A5c adapting',
        'A5d load, learnt J',
        'A5e load at rest, gate gamma',
        'A5e load at rest, frozen',
        'A6 Euler 40000 b2',
        'A6 FOH 1 xhat1',
    ]
    assert set(wanted) <= set(ids)


def test_the_noise_source_is_that_of_the_specification():
    assert plant.lcg(12345, 6) == pytest.approx(
        [-1.66137383, -1.67472738, 0.14949606, 0.46732136, 1.4203839, -1.34247216], abs=5e-9
    )


def test_the_exponential_is_that_of_scipy():
    matrix = np.array([[0.0, 1.0, 2.0], [-300.0, -40.0, 1.0], [0.0, 0.0, 0.0]])
    assert np.allclose(plant.exponential(matrix), expm(matrix), rtol=1e-10, atol=1e-12)


@pytest.mark.slow  # compiles
def test_the_continuous_plant_is_the_exact_one():
    inputs = plant.random_input(plant.VELOCITY, plant.RK4_STEP, 20.0)
    run = plant.continuous(plant.VELOCITY, inputs)
    angle, speed = plant.response(plant.VELOCITY, inputs, plant.RK4_STEP)
    assert np.abs(run.angle - angle).max() < 1e-9
    assert np.abs(run.velocity - speed).max() < 1e-9


@pytest.mark.long
def test_the_recordings_are_reported_side_by_side(capsys):
    assert cli.main(['reproduce', 'adaptive', '--only', 'recorded']) == 0
    out = capsys.readouterr().out
    assert re.search(r'sac +5\.057 \+- 0\.14', out)
    assert re.search(r'gravity_comp\. +nothing that is trusted', out)
    assert max(map(len, out.splitlines())) <= 80


@pytest.mark.slow
def test_the_command_draws_both_figures(tmp_path, capsys):
    assert cli.main(['reproduce', 'adaptive', '--only', 'A6', '--plot', str(tmp_path)]) == 0
    assert '45 of 45 checks' in capsys.readouterr().out
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        'adaptive_figure_1.png',
        'adaptive_figure_2.png',
    ]
