# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The reproduction of the hybrid-angle paper: every row, the figures, the command."""

import json
import math
from functools import partial

import numpy as np
import pytest
import reproduced
from observer_cases import make, stamps

from estimator_pkg import cli
from estimator_pkg.engine import calls
from estimator_pkg.errors import UsageError
from estimator_pkg.observers.angle.hybrid import injections
from sim_pkg.joints import profiles
from sim_pkg.reproduce import claims, contract, splitmix
from sim_pkg.reproduce.contract import AT_LEAST, AT_MOST, EXACT, PERCENT, Part, Reference, Row
from sim_pkg.reproduce.hybrid_angle import continuous as hybrid_continuous
from sim_pkg.reproduce.hybrid_angle import observer as continuous
from sim_pkg.reproduce.hybrid_angle.paper import REPRODUCTION
from sim_pkg.reproduce.hybrid_angle.sampled import FIGURE_6, PERIOD, Alone, algorithm_1, samples

TURN = 2.0 * math.pi


test_every_row_is_within_its_tolerance = reproduced.rows(REPRODUCTION)


def test_the_table_of_the_specification_is_whole():
    """Section 4: 14 lines of four injections, seven entries of them empty, and nine scalars."""
    ids = [reference.id for reference in REPRODUCTION.references()]
    assert len(set(ids)) == len(ids)
    lines = (
        'F4 RMS e2 [0,2)',
        'F4 RMS e2 [2,8)',
        'F4 max |e1| [0,2)',
        'F4 settling',
        'F4 J2 resets',
        'F4 |int e2| [2,8)',
        'F4 max |xh2 - xh2 saw| [0,2)',
        'LY max flow increase of V',
        'F5 RMS e2 [2,8)',
        'F5 RMS e2 [6,8)',
        'F5 J2 resets',
        'F6 RMS e2 [0,2)',
        'F6 RMS e2 [5,6) td=0.15',
        'F6 RMS e2 [5,6) td=0.05',
        'F6 J2 resets',
    )
    wanted = [f'{line} {name}' for line in lines for name in injections.NAMES]
    wanted += [
        'LY dV at J2 sin',
        'LY dV at J2 sat',
        'F4 first J2 reset sin',
        'F4 first J2 reset sat',
        'stability T/eps',
        'noise sigma_v/sigma_y',
        'stability saw eps=0.0340 |e2| at 6 s',
        'stability sin eps=0.0335 limit cycle',
        'noise std xh2 14 bit',
        'noise std xh2 2 mrad',
        'ramp e2 at a=75',
        'ramp e2 at a=75 third order',
        'start stationary tan',
        'ramp e2 at 1200 rad/s',
    ]
    assert set(wanted) <= set(ids)
    assert all(
        name.startswith(f'{part.name} ')
        for part in REPRODUCTION.parts
        for name in (reference.id for reference in part.references)
    )


@pytest.mark.parametrize(
    'kind, tolerance, good, bad',
    [
        (contract.ABSOLUTE, 0.5, 10.5, 10.51),
        (PERCENT, 1.0, 9.9, 9.89),
        (EXACT, 0.0, 10, 10.0001),
        (AT_MOST, 0.0, 10.0, 10.1),
        (AT_LEAST, 0.0, 10.0, 9.9),
    ],
)
def test_a_row_holds_exactly_up_to_its_tolerance(kind, tolerance, good, bad):
    reference = Reference('x', 'what', 10.0, tolerance, kind)
    assert Row(reference, good).ok
    assert not Row(reference, bad).ok
    assert not Row(reference, math.nan).ok
    assert not Row(reference, math.inf).ok
    assert not Row(reference, -math.inf).ok


def test_no_row_gets_lost():
    references = (Reference('p a', 'a', 1.0), Reference('p b', 'b', 2.0))
    with pytest.raises(KeyError, match='p b'):
        list(Part('p', references, lambda: iter([('p a', 1.0)])).rows())
    with pytest.raises(KeyError, match='p c'):
        list(Part('p', references, lambda: iter([('p c', 1.0)])).rows())


def test_the_parts_divide_the_references_of_a_paper():
    """A row of the file that no part computes is reported, and so are parts that share one."""
    values = dict.fromkeys(part.name for part in REPRODUCTION.parts)
    assert len(contract.parts('hybrid_angle', values)) == len(values)
    with pytest.raises(ValueError, match='do not divide'):
        contract.parts('hybrid_angle', {**values, 'F4 gain': None})
    values.pop('tan')
    with pytest.raises(ValueError, match='do not divide'):
        contract.parts('hybrid_angle', values)


def test_a_cell_of_the_paper_is_a_number_words_or_nothing():
    found = {row.id: row.paper for row in REPRODUCTION.references()}
    assert found['F6 mean xh2 [4,5) sin'] == 150
    assert found['F4 RMS e2 [2,8) tan'] == 'best, slightly'
    assert found['F4 J2 resets sin'] is None


def test_only_runs_the_parts_that_are_asked_for():
    def never():
        raise AssertionError('this part was not asked for')

    parts = (
        Part(
            'p',
            (Reference('p b', 'b', 2.0), Reference('p a', 'a', 1.0)),
            lambda: iter([('p a', 1.0), ('p b', 2.0)]),
        ),
        Part('q', (Reference('q a', 'a', 1.0),), never),
    )
    reproduction = contract.Reproduction('paper', 'summary', parts, '')
    counted = []
    rows = list(reproduction.rows(counted.append, 'p'))
    assert [row.reference.id for row in rows] == ['p b', 'p a']  # the order of the table
    assert sum(counted) == 2
    assert [row.reference.id for row in reproduction.rows(prefix='p a')] == ['p a']
    with pytest.raises(UsageError, match="starts with 'r'"):
        list(reproduction.rows(prefix='r'))


def test_command_prints_a_table_and_writes_the_rows(tmp_path, capsys):
    path = tmp_path / 'rows.json'
    assert cli.main(['reproduce', 'hybrid_angle', '--only', 'tan', '--json', str(path)]) == 0
    out = capsys.readouterr().out
    assert 'tan one update at 150 deg' in out
    assert '6 of 6 checks against our own independent numbers are within tolerance' in out
    assert max(map(len, out.splitlines())) <= 80
    rows = json.loads(path.read_text())['rows']
    assert len(rows) == 6
    for row in rows:
        assert {'id', 'value', 'reference', 'tolerance', 'paper', 'ok'} <= set(row)
        if row['kind'] in ('absolute', 'percent', 'exact'):
            assert row['ok'] == (abs(row['value'] - row['reference']) <= row['tolerance'])


def words(**values):
    """Rows of one group: id's last word -> (what the paper says, value)."""
    return [
        Row(Reference(f'g {name}', '', value, 0.1, 'percent', said), value)
        for name, (said, value) in values.items()
    ]


@pytest.mark.parametrize(
    'rows, agreeing',
    [
        (words(a=('worst', 3.0), b=('best', 1.0), c=(None, 2.0)), 'ab'),
        (words(a=('worst', 1.5), b=('best', 2.0), c=(None, 2.5)), ''),
        (words(a=('similar', 1.0), b=('similar', 1.05)), 'ab'),
        (words(a=('similar', 1.0), b=('similar', 1.5)), ''),
        (words(a=('slower', 2.0), b=('faster', 1.0)), 'ab'),
        (words(a=('slower', 1.0), b=('faster', 2.0)), ''),
        (words(a=(15.7, 77.0), b=(2.0, 2.15), c=(0.3, 0.34)), 'bc'),
        (words(a=('327.8 (for 3278)', 3300.0), b=('327.8 (for 3278)', 327.8)), 'a'),
    ],
)
def test_a_claim_is_compared_with_our_value(rows, agreeing):
    found = claims.claims(rows, (('g a', 'because'),))
    assert {each.row.reference.id[-1] for each in found if each.agrees} == set(agreeing)
    assert all(bool(each.why) != each.agrees for each in found)


@pytest.mark.long
def test_the_command_begins_with_the_claims(capsys, tmp_path):
    path = tmp_path / 'rows.json'
    assert cli.main(['reproduce', 'hybrid_angle', '--only', 'F4', '--json', str(path)]) == 0
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 80
    assert 'claims in words' in out and 'best, slightly' in out
    assert '15 claims in words: 14 agree with the paper, 1 does not, because:' in out
    assert 'independent numbers: add --all' in out and 'tolerance' not in out
    rows = {row['id']: row for row in json.loads(path.read_text())['rows']}
    assert rows['F4 RMS e2 [2,8) sin']['agrees'] is True
    assert rows['F4 settling sin']['agrees'] is None


def test_command_fails_when_a_row_fails(monkeypatch, capsys):
    wrong = contract.Reproduction(
        'hybrid_angle',
        'summary',
        (Part('p', (Reference('p a', 'the thing', 1.0, 0.1),), lambda: iter([('p a', 1.2)])),),
        '',
    )
    monkeypatch.setattr('sim_pkg.reproduce.hybrid_angle.paper.REPRODUCTION', wrong)
    assert cli.main(['reproduce', 'hybrid_angle']) == 1
    out = capsys.readouterr().out
    assert 'NO' in out
    assert 'failed: p a (the thing)' in out


@pytest.mark.parametrize(
    'words, message',
    [
        (['hybrid_angel'], "did you mean 'hybrid_angle'?"),
        (['hybrid_angle', '--only', 'F7'], "no row of hybrid_angle starts with 'F7'"),
    ],
)
def test_command_says_what_is_wrong_in_one_line(words, message, capsys):
    assert cli.main(['reproduce', *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count('\n') == 1


def test_without_matplotlib_plot_is_one_line_before_the_work(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(__import__('sys').modules, 'matplotlib', None)
    assert cli.main(['reproduce', 'hybrid_angle', '--plot', str(tmp_path / 'figures')]) == 1
    captured = capsys.readouterr()
    assert "the library 'matplotlib' is not installed: " in captured.err
    assert captured.err.count('\n') == 1
    assert captured.out == ''


def test_a_place_for_figures_that_cannot_be_is_reported_before_the_work(tmp_path, capsys):
    (tmp_path / 'file').write_text('')
    assert cli.main(['reproduce', 'hybrid_angle', '--plot', str(tmp_path / 'file')]) == 1
    captured = capsys.readouterr()
    assert captured.out == '' and captured.err.count('\n') == 1


@pytest.mark.slow
def test_figures_are_drawn(tmp_path):
    image = pytest.importorskip('matplotlib.image')
    paths = REPRODUCTION.draw(tmp_path)
    assert [path.name for path in paths] == [f'hybrid_angle_figure_{n}.png' for n in (3, 4, 5, 6)]
    for path in paths:
        pixels = image.imread(path)[..., :3]
        colours = {tuple(c) for c in np.round(255 * pixels.reshape(-1, 3)).astype(int)}
        # each injection has its own colour in each figure (tan and saw last where all coincide)
        assert {(209, 52, 47), (138, 79, 191)} <= colours


def test_splitmix_gives_the_published_numbers():
    assert splitmix.integers(1234567, 5).tolist() == [
        6457827717110365317,
        3203168211198807973,
        9817491932198370423,
        4593380528125082431,
        16408922859458223821,
    ]
    values = splitmix.uniforms(3, 20_000, 0.5)
    assert -0.5 <= values.min() < -0.499
    assert 0.499 < values.max() < 0.5
    assert abs(values.mean()) < 0.01


@pytest.mark.parametrize('name', injections.NAMES)
def test_lyapunov_potential_is_the_integral_of_the_injection(name):
    kind = injections.NAMES.index(name)
    potential, injection = partial(continuous.potential, kind), partial(continuous.injection, kind)
    for error in np.linspace(-3.0, 3.0, 41):
        if abs(abs(error) - 0.8) < 0.06:
            continue  # the kink of sat
        slope = (potential(error + 1e-5, 0.8) - potential(error - 1e-5, 0.8)) / 2e-5
        assert slope == pytest.approx(injection(error, 0.8), abs=1e-6)
        assert potential(error + TURN, 0.8) == pytest.approx(potential(error, 0.8), abs=1e-9)
        assert potential(error, 0.8) >= 0.0
    assert potential(0.0, 0.8) == 0.0
    assert continuous.lyapunov(kind, 0.0, 3.0, 4.5, 0.8) == pytest.approx(1.0)


def test_jump_sets_and_maps_of_the_continuous_observer():
    margin = 0.1
    assert continuous.in_first_jump_set(math.pi + 0.1, margin)
    assert continuous.in_first_jump_set(-math.pi - 0.11, margin)
    assert not continuous.in_first_jump_set(-math.pi - 0.09, margin)
    assert continuous.first_jump(3.3) == pytest.approx(3.3 - TURN)
    assert continuous.first_jump(-3.3) == pytest.approx(TURN - 3.3)
    for error, inside in ((3.05, True), (-3.24, True), (3.03, False), (3.25, False), (0.0, False)):
        assert continuous.in_second_jump_set(error, margin) is inside
    assert continuous.flow(injections.SIN, 1.0, 2.0, 1.5, 3.0, 4.0, 1.0) == pytest.approx(
        (2.0 + 3.0 * math.sin(0.5), 4.0 * math.sin(0.5))
    )


@pytest.mark.skipif(not calls.available(), reason='no engine was built')
@pytest.mark.parametrize('name', injections.NAMES)
def test_the_continuous_observer_compiles_to_the_same_numbers(name, monkeypatch):
    outs = []
    for _ in range(2):
        out = [np.zeros(3000) for _ in range(5)]
        out += [np.full(3000, np.nan), np.full(3000, np.nan), np.zeros(3000)]
        speed, noise = np.linspace(0.0, 90.0, 6001), splitmix.uniforms(1, 3000, 0.2)
        columns = 3000, speed, noise, *out
        kind = injections.NAMES.index(name)
        calls.run(hybrid_continuous.simulate, kind, 8.6, 10.2, 1.0, 0.08, 1e-3, *columns)
        outs.append(out)
        monkeypatch.setattr(calls, 'load', lambda: (None, ''))
    assert bool(outs[0][7].any()) == (name != 'tan')  # tan keeps the error out of J2
    for plain, compiled in zip(*outs):
        np.testing.assert_array_equal(plain, compiled)


@pytest.mark.parametrize('name', injections.NAMES)
def test_the_node_runs_the_algorithm_that_is_reproduced(name):
    """What the driver calls (``form: paper``) gives the rows' numbers to the bit."""
    joint = make(
        'hybrid_angle', {'form': 'paper', 'injection': name, **FIGURE_6, 'low_speed_bound': False}
    )
    _, _, angles = samples(profiles.figure_6(0.05), 8.0, start=0.3)
    # one sample time later: the paper's first step predicts from (0, 0)
    found = joint.run(stamps(len(angles) + 1, PERIOD), np.concatenate(([0.0], angles))).velocity[1:]
    np.testing.assert_array_equal(found, algorithm_1(name, angles).velocity)


@pytest.mark.parametrize('name', injections.NAMES)
def test_the_continuous_observer_has_the_injections_of_the_node(name):
    design = Alone(form='paper', injection=name, **FIGURE_6).design
    for error in np.linspace(-9.0, 9.0, 61).tolist():
        ours = continuous.injection(injections.NAMES.index(name), error, 1.0)
        assert ours == injections.inject(error, design)


@pytest.mark.parametrize('name', injections.NAMES)
def test_a_potential_is_the_integral_of_its_injection(name):
    """(7) of the paper, at a saturation that is not 1."""
    limit, kind = 0.7, injections.NAMES.index(name)
    potential, injection = partial(continuous.potential, kind), partial(continuous.injection, kind)
    errors = np.linspace(-2.9, 2.9, 59)
    slope = [(potential(e + 1e-6, limit) - potential(e - 1e-6, limit)) / 2e-6 for e in errors]
    assert slope == pytest.approx([injection(e, limit) for e in errors.tolist()], abs=1e-5)
    assert potential(0.0, limit) == 0.0
    assert potential(limit + 1e-12, limit) == pytest.approx(potential(limit - 1e-12, limit))
