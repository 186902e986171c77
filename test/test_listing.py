# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The command list, and the pages of parameters in the documentation."""

import dataclasses
import json
import re

import pytest
from declaring import declaring

from docs.tools import parameters as pages
from estimator_pkg import listing, parameters, registry
from estimator_pkg.cli import main
from estimator_pkg.errors import UserError
from estimator_pkg.parameters import declared
from estimator_pkg.streams.angle import AngleStream


def listed(capsys, *words):
    assert main(['list', *words]) == 0
    return capsys.readouterr().out


def test_every_kind_is_listed(capsys):
    out = listed(capsys)
    for kind in ('OBSERVERS', 'NODES', 'MODELS', 'SIMULATORS', 'COMMANDS'):
        assert f'{kind}\n' in out
    for name in ('hybrid_angle', 'finite_difference', 'pll', 'kalman', 'encoder', 'evaluate'):
        assert re.search(rf'^  {name} +\w', out, re.MULTILINE)
    assert 'cannot be imported' not in out
    lines = out.splitlines()
    assert len(lines) <= 60 and max(map(len, lines)) <= 80


def test_a_kind_is_listed_alone(capsys, tmp_path):
    out = tmp_path / 'list.json'
    text = listed(capsys, 'observers', '--json', str(out))
    assert re.search(r'^  kalman +Kalman filter', text, re.MULTILINE)
    assert 'SIMULATORS' not in text and max(map(len, text.splitlines())) <= 80
    assert list(json.loads(out.read_text())) == ['observers']


def test_structural_parameters_are_marked_where_others_are_live(capsys):
    assert 'wrapping (at start only)' in listed(capsys, 'joint').replace('\n      ', ' ')
    assert 'at start only' not in listed(capsys, 'encoder')  # a simulation never changes


def test_automatic_and_required_parameters_are_distinguished(capsys, tmp_path):
    out = tmp_path / 'list.json'
    text = listed(capsys, 'pmsm', '--json', str(out))
    assert 'k_eta = automatic (-1.0) [1/Wb], [0, 1e+09]; -1.0: automatic' in text
    assert 'resistance = required [ohm], [1e-06, 10000]' in text
    assert 'noise = automatic (0.0)' in listed(capsys, 'kalman')
    found = json.loads(out.read_text())['observers']['pmsm']['parameters']
    assert (found['k_eta']['default'], found['k_eta']['automatic']) == (None, '-1.0')
    assert found['resistance']['default'] is found['resistance']['automatic'] is None
    assert "known = none (['']), a list of texts; ['']: none" in listed(capsys, 'adaptive')


def test_a_stream_of_another_package_brings_its_node_and_its_settings(capsys, monkeypatch):
    @dataclasses.dataclass(frozen=True)
    class GantrySettings:
        """What is set per gantry."""

        rails: int = parameters.parameter(2, unit='', range=(1, 4), description='that carry it')

    class Gantries(AngleStream):
        NODE, PER_JOINT = 'gantry_observer', GantrySettings

    names, find = registry.names, registry.find
    ours = {'gantries': Gantries, 'broken': UserError("stream 'broken' cannot be imported: no")}

    def found(group, name):
        if group == registry.STREAMS and name in ours:
            if isinstance(ours[name], UserError):
                raise ours[name]
            return ours[name]
        return find(group, name)

    monkeypatch.setattr(
        registry, 'names', lambda group: names(group) + [*ours] * (group == registry.STREAMS)
    )
    monkeypatch.setattr(registry, 'find', found)
    out = listed(capsys)
    assert re.search(r'  gantry_observer +parameters of the node', out)
    assert re.search(r"  broken +\(stream 'broken' cannot be imported: no\)", out)
    assert re.search(r'  gantry +what is set per gantry', out)
    assert '  rails = 2, [1, 4]' in listed(capsys, 'gantry')


def test_gains_of_observers_of_mechanisms_are_explained(capsys, tmp_path):
    """K, poles, dt K against L, noise figure, slowest pole, guaranteed rate: what is worked out."""
    out = listed(capsys, 'geso')
    for words in ('single_joint', 'cart_pendulum', 'robotic_leg', 'at 1000 Hz', 'slowest pole'):
        assert words in out
    reported = tmp_path / 'reported.json'
    words = '--rate 112 --set model=single_joint --set L=[50] --set K=[600] --set form=paper'
    model = ['--set', 'model_parameters=[inertia=0.1]', '--json', str(reported)]
    out = listed(capsys, 'geso', *words.split(), *model)
    assert 'cart_pendulum' not in out.partition('effect of the gains')[2]
    assert 'noise figure K^2/(2 L) [1/s^3]: 3600' in out
    assert 'poles of the error at the operating point [1/s]: -30, -20' in out
    assert 'dt K [1/s]: 5.357' in out and 'required by forward Euler: yes' in out
    assert 'guaranteed rate of decay, Proposition 4.1 as corrected [1/s]: 0.2564' in out
    found = json.loads(reported.read_text())['gains']['single_joint']
    assert found['slowest_pole_over_range'] == '20' and 'refused' not in found
    words = 'hgo --rate 10 --set form=paper --set L=50 --set K=600'
    out = listed(capsys, *words.split())
    assert 'required by forward Euler: no' in out and 'refused: forward Euler' in out
    assert 'chattering' in listed(capsys, 'smo')


@pytest.mark.parametrize(
    'words, message',
    [
        (['pll', '--set', 'model=x'], "'pll' is not one"),
        (['--set', 'model=x'], '--set needs an observer'),
        (['geso', '--set', 'modle=x'], "did you mean 'model'?"),
        (['geso', '--rate', '0'], '--rate is 0 Hz'),
    ],
)
def test_gains_that_cannot_be_explained_are_refused_in_one_line(words, message, capsys):
    assert main(['list', *words]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1


def test_the_pages_of_parameters_are_as_the_code_declares():
    found = {path.name: path.read_text('utf-8') for path in pages.FOLDER.iterdir()}
    assert found == pages.pages(), 'python -m docs.tools.parameters'


@pytest.mark.long
def test_every_declared_parameter_is_described_on_a_page():
    lines = ''.join(pages.pages().values()).splitlines()
    cells = {tuple(line.split(' | ')[:2]) for line in lines if line.startswith('| `')}
    assert len(declaring()) > 6
    bases = {base for cls in declaring().values() for base in cls.__mro__[1:]}  # not on a page
    for name, cls in declaring().items():
        for parameter in declared(cls).values():
            where = f'{name}: {parameter.name}'
            row = f'| `{parameter.name}`', listing.default_text(parameter)
            assert cls in bases or row in cells, where
            assert parameter.description.strip(), where
            assert parameter.kind in listing.TYPE_NAMES, where
            if parameter.default is not None:
                assert parameter.check(parameter.default) == parameter.default, where
