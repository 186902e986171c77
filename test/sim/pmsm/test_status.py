# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The status of the observer `pmsm` on the simulated drive is never good while it is wrong."""

import drive_status
import pytest

from sim_pkg.pmsm.profiles import P1, Profile


@pytest.mark.parametrize('scenario', drive_status.SCENARIOS)
@pytest.mark.parametrize('plant', drive_status.PLANTS)
def test_the_status_is_honest(scenario, plant):
    """All 25 runs, with another noise than that of the table."""
    found = drive_status.verdict(scenario, plant, seed=11)
    assert found.wrong <= 3.0
    assert found.withheld <= 80.0
    assert found.tracking > 300.0  # and it is not honest by silence


@pytest.mark.long
def test_on_a_slow_ramp_too():
    profile = Profile([(0.1, 0, 0), (2.0, 0, 2000), (0.1, 2000, 2000), (2.0, 2000, 0)])
    for plant in drive_status.PLANTS.values():
        found = drive_status.judged(profile, plant, seed=2)
        assert found.wrong <= 3.0 and found.withheld <= 80.0, plant
        assert found.tracking > 2000.0


def test_dead_time_that_the_voltage_does_not_know_of_is_taken_off_where_it_is_declared():
    """P1 turns its torque round at full current; 0.5 us at 24 V and 20 kHz are 0.24 V per phase."""
    plant = {'current_noise': 0.1, 'dead_time': 0.5e-6}
    blind = drive_status.judged(Profile(P1), plant)
    reported = drive_status.judged(Profile(P1), plant, dead_time_voltage=0.24)
    assert blind.worst > 10.0
    assert reported.wrong == 0.0 and reported.worst < 4.0 and reported.withheld < 15.0
