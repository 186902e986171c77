"""Fixtures shared by tests."""

from __future__ import annotations

import os
import re
import sys
from functools import lru_cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT))  # benchmarks and docs.tools; the packages are the installed ones

USES_DDS = re.compile(r'^import dds$|\bprobe\b', re.MULTILINE)

for name in ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE'):  # old and new
    os.environ.setdefault(name, str(Path(__file__).parent / 'discovery.xml'))


def pytest_itemcollected(item):
    """Mark a test that uses DDS: one with the probe, or of a module that imports `dds`.

    It runs again once when it fails, and the summary says so: best-effort traffic may lose messages
    on a busy machine, and a fault of ours fails twice.
    """
    if 'probe' in item.fixturenames or hasattr(item.module, 'dds'):
        item.add_marker(pytest.mark.dds)
    if item.get_closest_marker('dds'):
        item.add_marker(pytest.mark.flaky(reruns=1))


@lru_cache
def scope(file: str) -> str:
    """Return what one worker of a parallel run (-n 4) takes as a whole.

    Tests over DDS mostly wait: two workers have them all, and the others take the rest by files.
    """
    if not USES_DDS.search((ROOT / file).read_text()):
        return file
    return 'dds of nodes' if file.startswith('test/nodes/') else 'dds'


def pytest_collection_modifyitems(items):
    """Begin with DDS, which takes longest."""
    items.sort(key=lambda item: not scope(item.nodeid.partition('::')[0]).startswith('dds'))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """In a parallel run, see `scope`."""
    from xdist.scheduler import LoadScopeScheduling

    class Scopes(LoadScopeScheduling):
        def _split_scope(self, nodeid):
            return scope(nodeid.partition('::')[0])

    return Scopes(config, log)


@pytest.fixture(scope='module')
def probe():
    """A node of the tests' own, on a ROS domain of this run."""
    import dds

    instance = dds.Probe()
    yield instance
    instance.close()
