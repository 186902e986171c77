# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The reproductions of all papers: every row, the claims, the figures, the command."""

import importlib
import json
import math
import sys

import pytest

from estimator_pkg import cli
from estimator_pkg.errors import UsageError
from sim_pkg.reproduce import claims, contract
from sim_pkg.reproduce.command import PAPERS, draw
from sim_pkg.reproduce.contract import AT_MOST, EXACT, PERCENT, Reference

FIGURES = {'adaptive': 2, 'hybrid_angle': 4, 'hybrid_discrete': 3, 'mechanical': 10, 'pmsm': 2}


@pytest.mark.slow
@pytest.mark.parametrize('paper', PAPERS)
def test_every_row_agrees_or_has_a_reason(paper, tmp_path, capsys):
    """The whole command: no row fails, and no line is longer than a terminal."""
    path = tmp_path / 'rows.json'
    assert cli.main(['reproduce', paper, '--json', str(path)]) == 0, capsys.readouterr().out
    out = capsys.readouterr().out
    assert 'failed' not in out and claims.UNEXPLAINED not in out
    assert max(map(len, out.splitlines())) <= 80
    for row in json.loads(path.read_text())['rows']:
        assert {'id', 'value', 'reference', 'tolerance', 'paper', 'basis', 'ok'} <= set(row)
        assert row['ok'] and (row['agrees'] or row['why'])


@pytest.mark.parametrize('paper', PAPERS)
def test_rows_are_unique_and_printed_with_what_the_paper_has(paper):
    reproduction = importlib.import_module(f'sim_pkg.reproduce.{paper}.paper').REPRODUCTION
    found = reproduction.references()
    assert len({each.id for each in found}) == len(found)
    for each in found:
        assert each.paper != '' and each.basis in claims.TITLES
        assert each.kind in (contract.ABSOLUTE, PERCENT, EXACT, AT_MOST)
    rows = [(each, each.value) for each in found]
    text = '\n'.join(claims.text(reproduction, claims.claims(rows, (('', 'because'),))))
    for basis, title in claims.TITLES.items():  # what is specified is counted apart
        assert (title[1:] in text.replace('\n', ' ')) == any(each.basis == basis for each in found)
    shown = [line.strip() for line in text.splitlines()]
    assert all(sum(line.startswith(f'{each.id}  ') for line in shown) == 1 for each in found)


@pytest.mark.parametrize(
    'kind, tolerance, good, bad',
    [
        (contract.ABSOLUTE, 0.5, 10.5, 10.51),
        (PERCENT, 1.0, 9.9, 9.89),
        (EXACT, 0.0, 10, 10.0001),
        (AT_MOST, 0.0, 10.0, 10.1),
    ],
)
def test_a_row_holds_exactly_up_to_its_tolerance(kind, tolerance, good, bad):
    reference = Reference('x', 'what', 10.0, tolerance, kind, 10.0)
    assert reference.met(good)
    assert not any(map(reference.met, (bad, math.nan, math.inf, -math.inf)))


def of_parts(monkeypatch, names, **parts):
    """Return a paper with these rows and parts."""
    rows = tuple(
        Reference(name, 'the thing', value, 0.1, 'absolute', value) for name, value in names.items()
    )
    monkeypatch.setattr(contract, 'references', lambda paper: rows)
    titled = {name: ('of a test', values) for name, values in parts.items()}
    return contract.Reproduction('paper', 'summary', titled)


@pytest.mark.parametrize(
    'names, values, lost',
    [
        ({'p a': 1.0, 'p b': 2.0}, {'p a': 1.0}, 'p b'),
        ({'p a': 1.0}, {'p a': 1.0, 'p c': 1.0}, 'p c'),
        ({'p a': 1.0, 'q a': 3.0}, {'p a': 1.0}, 'q a'),  # that no part computes
    ],
)
def test_no_row_gets_lost(names, values, lost, monkeypatch):
    with pytest.raises(KeyError, match=lost):
        of_parts(monkeypatch, names, p=lambda: iter(values.items())).values()


def test_only_runs_the_parts_that_are_asked_for(monkeypatch):
    def never():
        raise AssertionError('a part ran that was not selected')

    names = {'p b': 2.0, 'p a': 1.0, 'q a': 1.0}
    found = of_parts(monkeypatch, names, p=lambda: iter([('p a', 1.0), ('p b', 2.0)]), q=never)
    counted = []
    rows = found.values(counted.append, 'p')
    assert [reference.id for reference, _ in rows] == ['p b', 'p a']  # the order of the file
    assert sum(counted) == 2
    assert [reference.id for reference, _ in found.values(prefix='p a')] == ['p a']
    with pytest.raises(UsageError, match="starts with 'r'"):
        found.references('r')


def settling(first, second, third):
    """Rows of the settling times of observer (5), of (16), and of (16) with the identifier."""
    return words(
        a=('relatively slow', first), b=('faster than (5)', second), c=('faster than (16)', third)
    )


def words(**values):
    """Rows of one group: id's last word -> (what the paper says, value)."""
    return [
        (Reference(f'g {name}', '', value, 0.1, 'percent', said), value)
        for name, (said, value) in values.items()
    ]


@pytest.mark.parametrize(
    'rows, agreeing',
    [
        (words(a=('worst', 3.0), b=('best', 1.0), c=(9.0, 2.0)), 'ab'),
        (words(a=('worst', 1.5), b=('best', 2.0), c=(9.0, 2.5)), ''),
        (words(a=('similar', 1.0), b=('similar', 1.05)), 'ab'),
        (words(a=('similar', 1.0), b=('similar', 1.5)), ''),
        (settling(140.0, 85.0, 30.0), 'abc'),
        (settling(140.0, 85.0, 90.0), 'ab'),
        (settling(80.0, 85.0, 30.0), 'c'),
        (settling(140.0, math.nan, 30.0), 'a'),  # nan never settles
        (words(a=('slower', 2.0), b=('faster', 1.0)), 'ab'),
        (words(a=('slower', 1.0), b=('faster', 2.0)), ''),
        (words(a=(15.7, 77.0), b=(2.0, 2.15), c=(0.3, 0.34)), 'bc'),
        (words(a=('327.8 (for 3278)', 3300.0), b=('327.8 (for 3278)', 327.8)), 'a'),
    ],
)
def test_a_claim_is_compared_with_our_value(rows, agreeing):
    found = claims.claims(rows, (('g a', 'because'),))
    assert {each.reference.id[-1] for each in found if each.agrees} == set(agreeing)
    assert all(bool(each.why) != each.agrees for each in found)
    unexplained = [each.fails for each in claims.claims(rows, ())]  # a difference needs a reason
    assert unexplained == [not each.agrees or math.isnan(each.value) for each in found]


def test_command_fails_when_a_row_fails(monkeypatch, capsys):
    wrong = of_parts(monkeypatch, {'p a': 1.0}, p=lambda: iter([('p a', 1.2)]))
    monkeypatch.setattr('sim_pkg.reproduce.hybrid_angle.paper.REPRODUCTION', wrong)
    assert cli.main(['reproduce', 'hybrid_angle']) == 1
    out = capsys.readouterr().out
    assert 'FAILS' in out
    assert 'failed: p a (the thing) is 1.2, not 1 +- 0.1' in out


@pytest.mark.parametrize(
    'words, code, message',
    [
        ('hybrid_angel', 2, "did you mean 'hybrid_angle'?"),
        ('hybrid_angle --only F7', 2, "no row of hybrid_angle starts with 'F7'"),
        ('hybrid_angle --plot file', 1, 'file'),
        ('hybrid_angle --plot figures', 1, "the library 'matplotlib' is not installed: "),
    ],
)
def test_what_is_wrong_is_one_line_before_the_work(
    words, code, message, capsys, monkeypatch, tmp_path
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'file').write_text('')
    if 'figures' in words:
        monkeypatch.setitem(sys.modules, 'matplotlib', None)
    assert cli.main(['reproduce', *words.split()]) == code
    captured = capsys.readouterr()
    assert message in captured.err and captured.err.count('\n') == 1
    assert captured.out == ''


@pytest.mark.slow
@pytest.mark.parametrize('paper', PAPERS)
def test_figures_are_drawn(paper, tmp_path):
    pytest.importorskip('matplotlib')
    paths = draw(paper, tmp_path)
    assert len(paths) == FIGURES[paper]
    assert all(path.stat().st_size > 10_000 for path in paths)
