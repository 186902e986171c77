"""Fixtures shared by tests."""

from __future__ import annotations

import pytest


@pytest.fixture(scope='session')
def probe():
    """A node of the tests' own, on a ROS domain of this run."""
    import dds

    instance = dds.Probe()
    yield instance
    instance.close()
