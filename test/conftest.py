"""Fixtures shared by tests."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT))  # benchmarks and docs.tools; the packages are the installed ones

for name in ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE'):  # old and new
    os.environ.setdefault(name, str(Path(__file__).parent / 'discovery.xml'))


@pytest.hookimpl(tryfirst=True)  # before xdist reads the groups
def pytest_collection_modifyitems(items):
    """Mark the tests that use DDS: those with the probe, and those of modules that import `dds`.

    They run again once when they fail, and the summary says so: best-effort traffic may lose
    messages on a busy machine, and a fault of ours fails twice. In a parallel run they follow one
    another in one worker, while the others take the rest file by file.
    """
    for item in items:
        if 'probe' in item.fixturenames or hasattr(item.module, 'dds'):
            item.add_marker(pytest.mark.dds)
        if item.get_closest_marker('dds'):
            item.add_marker(pytest.mark.flaky(reruns=1))
            item.add_marker(pytest.mark.xdist_group('dds'))
        else:
            item.add_marker(pytest.mark.xdist_group(item.nodeid.split('::')[0]))


@pytest.fixture(scope='module')
def probe():
    """A node of the tests' own, on a ROS domain of this run."""
    import dds

    instance = dds.Probe()
    yield instance
    instance.close()
