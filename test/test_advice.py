# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Advice names parameters that the observer has: every text, for every observer that it reaches."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from estimator_pkg import registry, streams
from estimator_pkg.bags.series import of_positions
from estimator_pkg.evaluation.report.findings import look, of_joint, sentences
from estimator_pkg.sensor.guard import WHY_DROPPED

EVERY = registry.names(registry.OBSERVERS)
DECLARED = {name: set(streams.parameters(name)) for name in EVERY}
NAMES = set.union(*DECLARED.values())


def named(text):
    """The parameters that a text names: quoted, or words that can be nothing else."""
    return {
        name
        for name in NAMES
        if re.search(rf"'{name}(?:'|: )", text)
        or ('_' in name and re.search(rf"(?<![\w.'-]){name}(?![\w'])", text))
    }


def row(source, late=0.0, noise=0.0):
    """An estimate of a joint, as `compare` returns it."""
    time = np.arange(2000) * 1e-3
    truth = np.sin(3.0 * time)
    estimate = np.sin(3.0 * (time - late)) + noise * np.random.default_rng(1).normal(size=2000)
    rms = float(np.sqrt(np.mean((estimate - truth) ** 2)))
    return SimpleNamespace(
        source=source,
        joint='j',
        time=time,
        truth=truth,
        estimate=estimate,
        velocity={'rms': rms, 'delay_s': late, 'delay_95_s': 1e-4, 'noise': noise or np.nan},
        samples={'received': 9, 'dropped': dict.fromkeys(WHY_DROPPED, 1)},
        validity={},
        coverage=0.6,
        reference_cannot_tell=False,
    )


@pytest.mark.parametrize('observer', [*EVERY, '/joint_observer/estimate'])
def test_findings_fit_the_observer(observer):
    """Late, noisy, counts, samples of which each kind is dropped."""
    time = np.arange(2000)
    seen = look(of_positions(10**9 + 10**6 * time, np.rint(2000 * np.sin(3e-3 * time)) / 1e3), 0, 0)
    assert seen.quantum
    said = []
    for each in (row(observer, late=0.02), row(observer, noise=0.1)):
        comparison = SimpleNamespace(rows=[each], refused={}, notes=())
        said += sentences(comparison, {'j': of_joint(comparison, 'j', seen)})
    text = ' '.join(said)
    assert 'most of its error comes from its delay' in text and 'is noise' in text
    assert 'unstable' in text
    allowed = DECLARED.get(observer, {'quantum'})  # nearly every observer has that one
    assert named(text) <= allowed
    assert ('bandwidth_hz' in named(text)) == ('bandwidth_hz' in allowed)
    assert ('prefer' in named(text)) == ('prefer' in allowed)
