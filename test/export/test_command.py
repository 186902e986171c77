# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""`velocity_estimator export`: the folder, its check, and one line for what cannot be exported."""

import json
import subprocess

import pytest

from estimator_pkg.cli import main
from estimator_pkg.export import folder

MECHANISMS = ('geso', 'hgo', 'ehgo', 'smo')


def refused(capsys, *words):
    """Return the one line with which the command refuses."""
    assert main(['export', *map(str, words)]) in (1, 2)
    (line,) = capsys.readouterr().err.strip().splitlines()
    return line


@pytest.mark.long
def test_a_folder_is_complete_and_passes_its_check(tmp_path, capsys):
    out = tmp_path / 'firmware'
    result = tmp_path / 'result.json'
    words = ['kalman', '--set', 'bandwidth_hz=20.0', '--joint', 'Left-Elbow', '--out', out]
    assert main(['export', *map(str, words), '--json', str(result)]) == 0
    files = {path.name for path in out.iterdir()}
    assert files == {'left_elbow.h', 'main.c', 'vectors.h', 'CMakeLists.txt', 'README.md'}
    said = json.loads(result.read_text())
    assert said['prefix'] == 'left_elbow' and said['passed'] and said['samples'] > 3000
    assert 'bandwidth_hz = 20.0 [Hz]' in (out / 'left_elbow.h').read_text()
    printed = capsys.readouterr().out
    assert '0 flips of a decision' in printed
    text = (out / 'left_elbow.h').read_text()
    wrong = text.replace('velocity = motion.', 'velocity = 1e-9 + motion.')
    assert wrong != text
    (out / 'left_elbow.h').write_text(wrong)
    assert not folder.checked(out)[0]


def test_vectors_come_from_a_bag(tmp_path, capsys):
    out = tmp_path / 'firmware'
    bags = folder.Path(__file__).parents[2] / 'bags'
    path = next((bags / 'dfki_simple_pendulum').rglob('*.mcap'))
    code = main(['export', 'pll', '--bag', str(path), '--out', str(out)])
    text = capsys.readouterr()
    assert code == 0, text.err
    assert 'equal to the last bit, ' in text.out


@pytest.mark.long
@pytest.mark.parametrize(
    'words, remedy',
    [
        ('kalman', 'add --set quantum=STEP (2 pi / counts) or --set bandwidth_hz=HZ, or use dou'),
        ('kalman --set quantum=0.00153', ''),
        ('kalman --set bandwidth_hz=20.0', ''),
        ('super_twisting', 'with these gains: use double'),
    ],
)
def test_float32_that_is_not_near_names_the_remedy(words, remedy, tmp_path, capsys):
    assert main(['export', *words.split(), '--float32', '--out', str(tmp_path / 'out')]) == 0
    said = capsys.readouterr().out
    assert (remedy or 'rms 3.') in said
    assert ('float32 is not within' in said) == bool(remedy)


@pytest.mark.parametrize(
    ('words', 'part'),
    [
        (['kalmann'], "unknown observer 'kalmann'"),
        (['kalman', '--set', 'bandwidth=3.0'], 'bandwidth_hz'),
        (['kalman', '--set', 'bandwidth_hz=-3.0'], 'outside'),
        (['adaptive'], "'adaptive' cannot be exported"),
        (['switched'], "'switched' cannot be exported"),
        *(([name], 'for observers of one angle and of drives') for name in MECHANISMS),
        (['pll', '--params', 'nowhere.yaml'], 'nowhere.yaml'),
        (['pll', '--bag', 'nowhere'], 'nowhere'),
    ],
    ids=str,
)
def test_bad_input_is_one_line(words, part, tmp_path, capsys):
    assert part in refused(capsys, *words, '--out', tmp_path / 'out')
    assert not (tmp_path / 'out').exists()


def test_a_folder_that_exists_is_left_alone(tmp_path, capsys):
    assert 'exists: name another folder' in refused(capsys, 'pll', '--out', tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_cmake_builds_and_checks(tmp_path):
    folder.shutil.which('cmake') or pytest.skip('cmake is not installed')
    assert main(['export', 'pll', '--out', str(tmp_path / 'o')]) == 0
    for command in ('cmake -S . -B b', 'cmake --build b', 'ctest --test-dir b'):
        subprocess.run(command.split(), check=True, cwd=tmp_path / 'o', stdout=subprocess.DEVNULL)


MOTOR = 'resistance=0.5 inductance=0.001 flux=0.05 pole_pairs=4 speed_max=300.0'


def test_a_drive_is_equal_to_the_last_bit(tmp_path):
    out = tmp_path / 'out'
    words = [word for value in MOTOR.split() for word in ('--set', value)]
    assert main(['export', 'pmsm', *words, '--out', str(out)]) == 0
    passed, (counts, *_) = folder.checked(out)
    count, equal = (int(part.split()[0]) for part in counts.replace(':', ',').split(', ')[:2])
    assert passed and equal == count > 3000
