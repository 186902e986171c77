# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The reproduction of the paper on mechanisms: every row, the tables, the figures."""

import numpy as np
import pytest
import reproduced
from scipy.interpolate import make_smoothing_spline

from estimator_pkg.engine.calls import available
from sim_pkg.reproduce import claims
from sim_pkg.reproduce.contract import Row
from sim_pkg.reproduce.mechanical import benefit as mechanical_benefit
from sim_pkg.reproduce.mechanical import smoother as mechanical_smoother
from sim_pkg.reproduce.mechanical import tables as mechanical_tables
from sim_pkg.reproduce.mechanical.paper import REPRODUCTION

pytestmark = pytest.mark.skipif(not available(), reason='takes hours without the engine')


SLOW = ('B', 'C', 'D', 'E', 'G', 'H1', 'H3')
test_every_row_is_within_its_tolerance = reproduced.rows(REPRODUCTION, SLOW)


def test_the_table_of_the_specification_is_whole():
    assert len({reference.id for reference in REPRODUCTION.references()}) == 297


@pytest.mark.slow
def test_the_inferred_joint_gives_numbers_it_was_not_fitted_to():
    """Section 7 of the specification also prints these two, which are no rows of its table."""
    case = mechanical_benefit.Case
    for counts, with_disturbance, with_friction in ((4096, 0.023, 0.0135), (1024, 0.050, 0.025)):
        found = mechanical_benefit.best(case(True, 1.0), 0.05, counts)
        assert found == pytest.approx(with_disturbance, rel=0.1)
        found = mechanical_benefit.best(case(False, 1.0), 0.05, counts, known_friction=0.04)
        assert found == pytest.approx(with_friction, rel=0.1)


@pytest.mark.parametrize('weight', [1e-9, 1e-5, 1e-2])
def test_the_spline_is_that_of_scipy(weight):
    time = 0.01 * np.arange(400)
    readings = np.sin(3.0 * time) + 0.05 * np.random.default_rng(0).standard_normal(400)
    right = make_smoothing_spline(time, readings, lam=weight)
    position, velocity = mechanical_smoother.spline(readings, 0.01, weight)
    np.testing.assert_allclose(position, right(time), atol=1e-9)
    np.testing.assert_allclose(velocity, right(time, 1), atol=1e-8)


def test_tolerances_are_never_finer_than_what_is_printed():
    for reference in REPRODUCTION.references():
        if reference.kind != 'exact':
            assert reference.allowed >= 0.49e-6 * abs(reference.value), reference.id


def test_tables_are_laid_out_as_in_the_paper():
    rows = [Row(reference, reference.value) for reference in REPRODUCTION.references()]
    text = '\n'.join(mechanical_tables.lines(rows))
    for number in (1, 2, 5, 6, 7):
        assert f'Table {number}:' in text
    assert 'GESO  0.4941 (0.5)  0.3802 (0.3) *  0.4087 (0.4)  0.2625 (0.2) *' in text
    assert max(map(len, text.splitlines())) <= 80
    assert mechanical_tables.lines(rows[:5]) == []


def test_each_printed_number_agrees_or_has_a_reason():
    rows = [Row(reference, reference.value) for reference in REPRODUCTION.references()]
    found = claims.claims(rows, REPRODUCTION.reasons)
    numbers = [claim for claim in found if claim.is_number]
    assert len(numbers) == 139
    assert all(claim.why not in ('', claims.UNEXPLAINED) for claim in found if not claim.agrees)
    by_id = {claim.row.reference.id: claim for claim in found}
    assert not by_id['D3.nominal.LPM.GESO.MSE1e4'].agrees  # 8859 for 403
    assert 'unstable' in by_id['D3.nominal.LPM.GESO.MSE1e4'].why
    assert by_id['B4.GESO.ME1e2'].agrees
    agree = sum(claim.agrees for claim in numbers)
    text = ' '.join(claims.text(found))
    assert f'139 printed numbers: {agree} agree with the paper, {139 - agree} do not' in text
    assert 30 < agree < 70


@pytest.mark.slow
def test_figures_are_drawn(tmp_path):
    pytest.importorskip('matplotlib')
    paths = REPRODUCTION.draw(tmp_path)
    assert [path.name for path in paths] == [
        f'mechanical_figure_{n}.png' for n in (2, 3, 5, 6, 7, 9, 10, 11, 12, 13)
    ]
    assert all(path.stat().st_size > 10_000 for path in paths)
