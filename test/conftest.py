# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Fixtures shared by tests."""

from __future__ import annotations

import fcntl
import gc
import importlib.util
import os
import re
import signal
import sys
import tempfile
import zlib
from collections import Counter
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# Other tests take turns on the processor: how long one takes says nothing.
settings.register_profile('shared', deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile('shared')

ROOT = Path(__file__).parents[1]
gc.disable()  # until all tests are collected: nearly everything that they allocate stays
sys.path.append(str(ROOT))  # benchmarks and docs.tools; the packages are the installed ones

# What a shell runs in the background ignores Ctrl-C, and what nohup runs ignores SIGHUP. Processes
# of tests would inherit that.
for number, usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) == signal.SIG_IGN:
        signal.signal(number, usual)

# Processes of tests import the installed packages, too (Python 3.10 finds the checkout first).
os.environ['PYTHONSAFEPATH'] = '1'

# Small matrices: further threads of BLAS would only wait, on processors that other workers need.
for name in ('OMP', 'OPENBLAS', 'MKL'):
    os.environ.setdefault(f'{name}_NUM_THREADS', '1')

BEGIN_WITH_DDS = 3  # workers, see `scope`
USES_DDS = re.compile(r'^import dds$|\bprobe\b', re.MULTILINE)

for name in ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE'):  # old and new
    os.environ.setdefault(name, str(Path(__file__).parent / 'support/discovery.xml'))


def pytest_itemcollected(item):
    """Mark a test that uses DDS: one with the probe, or of a module that imports `dds`.

    It runs again once when it fails, and the summary says so: best-effort traffic may lose messages
    on a busy machine, and a fault of ours fails twice.
    """
    if 'probe' in item.fixturenames or hasattr(item.module, 'dds'):
        item.add_marker(pytest.mark.dds)
    if item.get_closest_marker('dds'):
        item.add_marker(pytest.mark.flaky(reruns=1))


# Libraries that rosdep cannot install with apt, so that a ROS installation may lack them.
WITHOUT_KEY = {
    *('AlgDiff', 'colcon_core', 'dask', 'distributed', 'filterpy', 'latex2mathml', 'mcap'),
    *('mkdocs', 'motulator', 'optuna', 'pynumdiff', 'rosbags', 'selenium'),
}
LACKING = []  # (error, why) of the tests that were skipped
LACKS = re.compile(r"No module named '(\w+)|the library '(\w+)' is not installed")


def lacking(text):
    """Why a test cannot run, if `text` says that such a library is missing; else ''."""
    for found in LACKS.finditer(text):
        name = found[1] or found[2]
        if name in WITHOUT_KEY and importlib.util.find_spec(name) is None:
            return f'{name} is not installed, and apt has no package of it that rosdep knows'
    return ''


@contextmanager
def alone(what, name):
    """One worker at a time does `what` with `name`."""
    file = f'{what}_{os.getuid()}_{zlib.crc32(name.encode())}'
    with open(Path(tempfile.gettempdir()) / file, 'w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


class Module(pytest.Module):
    """A module that is skipped if it imports a library without a rosdep key that is missing.

    One worker rewrites its assertions: the others wait, and load what it has kept.
    """

    def _import(self):
        if 'PYTEST_XDIST_WORKER' in os.environ and not sys.dont_write_bytecode:
            kept = self.path.parent / '__pycache__'
            with alone('rewrites', str(self.path)):
                if not any(kept.glob(f'{self.path.stem}.*-pytest-*')):
                    return super()._getobj()
        return super()._getobj()

    def _getobj(self):
        try:
            return self._import()
        except self.CollectError as error:
            why = lacking(str(error))
            if why:
                raise pytest.skip.Exception(why, allow_module_level=True) from error
            raise


def pytest_pycollect_makemodule(module_path, parent):
    """Collect with `Module`."""
    return Module.from_parent(parent, path=module_path)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item, call):
    """Report a test as skipped that failed because such a library is missing.

    A fixture of a module raises its error again for each test, but prints only once.
    """
    outcome = yield
    report = outcome.get_result()
    if not report.failed:
        return
    error = call.excinfo.value
    text = '\n'.join([report.longreprtext, *(text for _, text in report.sections)])
    why = lacking(text) or next((why for known, why in LACKING if known is error), '')
    if why:
        LACKING.append((error, why))
        path, line, _ = item.location
        report.outcome, report.longrepr = 'skipped', (path, line, f'Skipped: {why}')


@lru_cache
def scope(file: str) -> str:
    """Return what one worker of a parallel run (-n 4) takes as a whole.

    Tests over DDS mostly wait: three workers begin with them, and the rest is taken by files.
    """
    if not USES_DDS.search((ROOT / file).read_text()):
        return file
    folder, _, name = file.rpartition('/')
    if folder != 'test/nodes':
        return 'dds'
    return 'dds of nodes, first half' if name < 'test_l' else 'dds of nodes, second half'


def pytest_collection_modifyitems(items):
    """Begin with DDS, then with the files that have most `long` tests, which end last otherwise."""
    files = [item.nodeid.partition('::')[0] for item in items]
    long = Counter(
        file for file, item in zip(files, items) if item.get_closest_marker('long') is not None
    )
    order = {}
    for file in files:
        order.setdefault(file, (not scope(file).startswith('dds'), -long[file], len(order)))
    items.sort(key=lambda item: order[item.nodeid.partition('::')[0]])
    worker = os.environ.get('PYTEST_XDIST_WORKER', 'gw0')
    if int(worker.removeprefix('gw')) >= BEGIN_WITH_DDS:
        os.nice(5)  # what waits for an answer goes first


def pytest_collection_finish():
    """Spare the garbage collector the 5000 tests."""
    gc.collect()
    gc.freeze()
    gc.enable()
    gc.set_threshold(100_000, 20, 50)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """In a parallel run, see `scope`; in the order of `pytest_collection_modifyitems`."""
    from xdist.scheduler import LoadScopeScheduling

    config.option.loadscopereorder = False  # else those with most tests begin

    class Scopes(LoadScopeScheduling):
        def _split_scope(self, nodeid):
            return scope(nodeid.partition('::')[0])

    return Scopes(config, log)


def pytest_terminal_summary(terminalreporter):
    """Say what failed at the first try of tests that ran again."""
    for report in terminalreporter.stats.get('rerun', ()):
        where = re.compile(r'E  |\S+\.py:\d+: ')
        lines = [line for line in report.longreprtext.splitlines() if where.match(line)]
        terminalreporter.write_line(f'first try of {report.nodeid}:')
        terminalreporter.write_line('\n'.join(lines[:8]))


@pytest.fixture(scope='module')
def probe():
    """A node of the tests' own, on a ROS domain of this run."""
    import dds

    instance = dds.Probe()
    yield instance
    instance.close()


@pytest.fixture(autouse=True)
def no_endpoints_left(request):
    """What a test that failed has left on the probe would take part in its second try."""
    if 'probe' not in request.fixturenames:
        yield
        return
    node = request.getfixturevalue('probe').node
    before = {*node.publishers, *node.subscriptions}
    yield
    for each in {*node.publishers} - before:
        node.destroy_publisher(each)
    for each in {*node.subscriptions} - before:
        node.destroy_subscription(each)
