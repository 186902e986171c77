# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``evaluate`` and ``replay`` with a second sensor."""

import json
from pathlib import Path

from estimator_pkg.cli import main

BAGS = Path(__file__).parents[3] / 'bags/simulated'
ALONE = ('--set', 'quantum=0.00153398')
SOURCE = ('sources=[gyro]', 'source.gyro.topic=/imu', 'source.gyro.delay=0.004')
GYRO = (*ALONE, *(word for each in SOURCE for word in ('--set', each)))


def of_wheel(file):
    (bag,) = json.loads(file.read_text())['bags'].values()
    return bag['estimates']['edge_adaptive']['joints']['wheel']


def test_evaluate_prints_the_row_and_what_was_learnt(tmp_path, capsys):
    rms = []
    for words in (ALONE, GYRO):
        file = tmp_path / 'result.json'
        words = [str(BAGS / 'gyro'), '--observer', 'edge_adaptive', '--from', '2', *words]
        assert main(['evaluate', *words, '--json', str(file)]) == 0
        rms.append(of_wheel(file)['velocity']['rms'])
    assert rms[1] < 0.5 * rms[0]
    output = ' '.join(capsys.readouterr().out.split())
    said = 'used, informs in 100 of 100 samples, bias 0.030'
    assert f'edge_adaptive, wheel: source gyro: {said}' in output
    assert of_wheel(file)['samples']['sources']['gyro'].startswith(said)


def test_a_source_that_is_not_in_the_bag_or_misspelt_is_named(capsys):
    assert main(['replay', str(BAGS / 'sine_12bit'), *GYRO]) == 2
    assert "'/imu' is not in the bag: omit it in 'sources'" in capsys.readouterr().err
    words = ('--observer', 'edge_adaptive', *GYRO, '--set', 'source.gyro.rato=1')
    assert main(['evaluate', str(BAGS / 'gyro'), *words]) == 2
    assert "did you mean 'source.gyro.ratio'?" in capsys.readouterr().err
    assert main(['replay', str(BAGS / 'gyro'), *GYRO, '--set', 'source.gyro.joint=whel']) == 1
    assert "has no joint 'whel'; it has wheel" in capsys.readouterr().err
