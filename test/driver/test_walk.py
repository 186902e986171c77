# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The walk of one live sample, as docs/architecture.md lists it."""

import math
import re
import sys
from pathlib import Path

import pytest

from estimator_pkg import observers
from estimator_pkg.driver import bank, joint
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.streams.angle import AngleSettings, AngleStream

ROOT = Path(joint.__file__).resolve().parents[1]
PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'architecture.md'


def files_of_samples(name, monkeypatch):
    """The files whose functions run while plain Python takes 2500 messages, one of them late."""
    monkeypatch.setattr(joint, 'functions_of', lambda module: None)
    monkeypatch.setattr(bank, 'functions_of', lambda module: None, raising=False)
    stream = AngleStream(AngleSettings(observer=name), Configuration(observers.find(name)))
    seen = set()

    def note(frame, event, _):
        path = Path(frame.f_code.co_filename)
        if event == 'call' and path.is_relative_to(ROOT):
            seen.add(path.relative_to(ROOT).as_posix())

    encode, step = Encoder().encode, 2.0 * math.pi / 4096
    for k in range(3000):
        angle = step * round(0.3 * math.sin(0.01 * k) / step)
        late = 400_000 if k == 1500 else 0
        raw = encode(10**18 + k * 10**6 + late, '', ['a'], [angle])
        if k == 500:
            sys.setprofile(note)
        try:
            stream.feed(0, raw, 0)
        finally:
            if k == 2999:
                sys.setprofile(None)
    return seen


@pytest.mark.long
def test_a_sample_walks_through_the_files_that_the_docs_list(monkeypatch):
    (listed,) = re.findall(r'<!-- walk -->\n(.*?)\n<!-- end -->', PAGE.read_text(), re.S)
    known = set(re.findall(r'`([\w/]+\.py)`', listed))
    assert files_of_samples('edge_adaptive', monkeypatch) == known
    assert f'in {len(known)} files in all' in PAGE.read_text()
