# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The fixture of tests with a node in their own process."""

import pytest


@pytest.fixture
def own(probe, monkeypatch):
    """(kind, parameters) -> a node in this process, see `OwnNode`."""
    from own_node import OwnNode

    made = []

    def start(kind, **values):
        made.append(OwnNode(monkeypatch, kind, **values))
        return made[-1]

    yield start
    for each in made:
        each.close()
