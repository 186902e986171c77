# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Bags to tune on, and runs of `tune`."""

from __future__ import annotations

import json
import math

import joint_bags

from estimator_pkg.cli import main

START = 1_700_000_000_000_000_000


def write_bag(path, joints, truth=True, counts=4096, seconds=6.0, rate=500.0):
    """A bag with joints: name -> frequency [Hz] of a motion of 5 rad/s."""
    found = {'/joint_states': [], **({'/ground_truth/joint_states': []} if truth else {})}
    for k in range(1, int(seconds * rate)):
        t = k / rate
        stamp = START + round(t * 1e9)
        angles = [-5.0 / (math.tau * f) * math.cos(math.tau * f * t) for f in joints.values()]
        read = [math.floor(a * counts / math.tau) * math.tau / counts for a in angles]
        found['/joint_states'].append((stamp, tuple(joints), read, ()))
        if truth:
            speeds = [5.0 * math.sin(math.tau * f * t) for f in joints.values()]
            found['/ground_truth/joint_states'].append((stamp, tuple(joints), angles, speeds))
    return joint_bags.write_bag(path, found)


def tuned(tmp_path, *words):
    """(result, path of the parameter file) of a run."""
    result, out = tmp_path / 'result.json', tmp_path / 'gains.yaml'
    more = ['--out', str(out), '--json', str(result)]
    assert main(['tune', *map(str, words), *more]) == 0
    return json.loads(result.read_text()), out


def fails(capsys, *words, code=1):
    """The one line of a run that fails."""
    capsys.readouterr()
    assert main(['tune', *map(str, words)]) == code
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1, lines
    return lines[0]


def held(*pairs):
    """The words that fix parameters."""
    return [word for pair in pairs for word in ('--set', pair)]
