# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The reproduction of the hybrid paper: its rows and the figures."""

import pytest
import reproduced

from estimator_pkg import cli
from sim_pkg.reproduce.hybrid_discrete.paper import REPRODUCTION

SLOW = ('B2', 'B3', 'B5', 'C')
test_every_row_is_within_its_tolerance = reproduced.rows(REPRODUCTION, SLOW)


def test_the_table_of_the_specification_is_whole():
    ids = [reference.id for reference in REPRODUCTION.references()]
    assert len(set(ids)) == len(ids)
    wanted = [
        f'B1 {t} s {name}'
        for t in ('0.5', '1', '2', '5', '20')
        for name in ('x1', 'x4', 'z1', 'z3')
    ]
    wanted += [
        f'B5 {column} {h} ms'
        for h in ('0.1', '1', '5', '10', '20')
        for column in (
            'o1 explicit',
            'o1 implicit',
            'o1 matching',
            'o2 taylor',
            'o2 matching',
            'o3 taylor',
            'o3 matching',
        )
    ]
    wanted += ['B2 Z k=2..40', 'B3 noise 0.001', 'C velocity', 'B5 bound 400 12 bit']
    assert set(wanted) <= set(ids)


@pytest.mark.slow
def test_the_command_draws_the_figures(tmp_path, capsys):
    assert cli.main(['reproduce', 'hybrid_discrete', '--only', 'B1', '--plot', str(tmp_path)]) == 0
    assert '35 of 35 checks' in capsys.readouterr().out
    assert len(list(tmp_path.iterdir())) == 3
