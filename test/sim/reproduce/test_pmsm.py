# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The reproduction of the sensorless-motor paper: rows, claims, figures."""

import numpy as np
import pytest
import reproduced

from sim_pkg.pmsm.profiles import P1, Profile
from sim_pkg.reproduce.pmsm import alias_rows as pmsm_alias_rows
from sim_pkg.reproduce.pmsm import continuous_rows as pmsm_continuous_rows
from sim_pkg.reproduce.pmsm import drive_rows as pmsm_drive_rows
from sim_pkg.reproduce.pmsm.alias_rows import ROBUST, outcome
from sim_pkg.reproduce.pmsm.continuous_rows import drawn_times, later
from sim_pkg.reproduce.pmsm.paper import REPRODUCTION

# the 120 starts, those at four rates, aliases; what takes two seconds or more
SLOW = ('order', 'T4', 'T6', 'T2', 'T3', 'T5', 'T7', 'loop', 'status')


test_every_row_is_within_its_tolerance = reproduced.rows(REPRODUCTION, SLOW)


def test_the_tables_are_whole():
    ids = [reference.id for reference in REPRODUCTION.references()]
    assert len(set(ids)) == len(ids)
    assert {name.split()[0] for name in ids} == {
        'T0',
        'T1',
        'T2',
        'T3',
        'T4',
        'T5',
        'T6',
        'T7',
        'order',
        'status',
        'loop',
    }
    assert sum(name.startswith('T2') and name.endswith('t_w') for name in ids) == 7 * 5
    assert sum(name.startswith('T3') and name.endswith('t_w') for name in ids) == 6 * 7 * 2
    assert sum(name.startswith('status') for name in ids) == 2 * 25


@pytest.mark.slow
def test_the_order_of_the_observers_holds_for_random_starts():
    cont, hyb, post, _ = drawn_times(12, seed=99).T
    assert later(post, hyb) == 0 and later(hyb, cont) == 0
    assert np.isfinite(post).all()
    assert np.median(post) < np.median(hyb) < np.median(cont)


@pytest.mark.slow
def test_no_speed_loses_the_default_observer_and_the_printed_one_is_lost():
    for speed in pmsm_alias_rows.BAD_SPEEDS:
        times, fires = outcome(ROBUST, speed, 1)
        assert np.isfinite(times).all() and times[0] < 40.0 and sum(fires) == 0
    times, fires = outcome(
        pmsm_alias_rows.FORMS['paper'], pmsm_alias_rows.BAD_SPEEDS[0], 1, cold=False
    )
    assert np.isnan(times).all() and fires[0] > 30


@pytest.mark.parametrize('scenario', pmsm_drive_rows.SCENARIOS)
@pytest.mark.parametrize('plant', pmsm_drive_rows.PLANTS)
def test_the_status_is_honest(scenario, plant):
    """All 25 runs, with another noise than that of the table."""
    found = pmsm_drive_rows.verdict(scenario, plant, seed=11)
    assert found.wrong <= 3.0
    assert found.withheld <= 80.0
    assert found.tracking > 300.0  # and it is not honest by silence


@pytest.mark.long
def test_on_a_slow_ramp_too():
    profile = Profile([(0.1, 0, 0), (2.0, 0, 2000), (0.1, 2000, 2000), (2.0, 2000, 0)])
    for plant in pmsm_drive_rows.PLANTS.values():
        found = pmsm_drive_rows.judged(profile, plant, seed=2)
        assert found.wrong <= 3.0 and found.withheld <= 80.0, plant
        assert found.tracking > 2000.0


def test_dead_time_that_the_voltage_does_not_know_of_is_taken_off_where_it_is_declared():
    """P1 turns its torque round at full current; 0.5 us at 24 V and 20 kHz are 0.24 V per phase."""
    plant = {'current_noise': 0.1, 'dead_time': 0.5e-6}
    blind = pmsm_drive_rows.judged(Profile(P1), plant)
    reported = pmsm_drive_rows.judged(Profile(P1), plant, dead_time_voltage=0.24)
    assert blind.worst > 10.0
    assert reported.wrong == 0.0 and reported.worst < 4.0 and reported.withheld < 15.0


@pytest.mark.slow
def test_the_figures_are_drawn(tmp_path):
    paths = REPRODUCTION.draw(tmp_path)
    assert [path.name for path in paths] == [
        'pmsm_figure_1.png',
        'pmsm_figure_2.png',
        'pmsm_closed_loop.png',
    ]
    assert all(path.read_bytes()[:8] == b'\x89PNG\r\n\x1a\n' for path in paths)
    assert pmsm_continuous_rows.NEVER < 0.0
