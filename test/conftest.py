"""Fixtures shared by tests."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT))  # benchmarks and docs.tools; the packages are the installed ones

# Processes of tests import the installed packages, too (Python 3.10 finds the checkout first).
os.environ['PYTHONSAFEPATH'] = '1'

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


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """In a parallel run (-n 3) one worker has the files that use DDS; the others take the rest."""
    from xdist.scheduler import LoadScopeScheduling

    class Files(LoadScopeScheduling):
        def _split_scope(self, nodeid):
            file = nodeid.split('::')[0]
            return 'dds' if USES_DDS.search((ROOT / file).read_text()) else file

    return Files(config, log)


@pytest.fixture(scope='module')
def probe():
    """A node of the tests' own, on a ROS domain of this run."""
    import dds

    instance = dds.Probe()
    yield instance
    instance.close()
