# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A plugin of pytest for `run.py`: writes which test runs which line, or runs the chosen tests.

MUTANTS_COVER: a file for {nodeid: {'time': CPU s, 'lines': {file: [line]}}} of tests that pass
within MUTANTS_LONGEST s of CPU.
MUTANTS_CHOSEN: a file with the node ids to run, in this order, within MUTANTS_SECONDS s of CPU.
"""

import contextlib
import importlib
import json
import os
import resource
import signal
import time
from pathlib import Path

import pytest

AGAIN = 0.01  # s of CPU after which a test is cut off that could not be before
COVER, CHOSEN = os.environ.get('MUTANTS_COVER'), os.environ.get('MUTANTS_CHOSEN')
PACKAGE = Path(os.environ['PYTHONPATH'].split(os.pathsep)[0])
found: dict = {}
passed: set = set()

if COVER:
    import coverage

    tool = coverage.Coverage(data_file=None, source=[str(PACKAGE / 'estimator_pkg')])
    tool.start()  # before anything is imported
    # what runs at import is no test's: the first one to import it shows no more than the others
    for folder in ('driver', 'messages', 'observers'):
        for path in sorted(PACKAGE.glob(f'estimator_pkg/{folder}/**/[!_]*.py')):
            with contextlib.suppress(ImportError):
                importlib.import_module('.'.join(path.relative_to(PACKAGE).with_suffix('').parts))
    longest = float(os.environ['MUTANTS_LONGEST'])

    def cut_off(_, frame):
        inner = frame
        while inner is not None:
            if inner.f_globals.get('__name__', '').startswith('coverage.'):
                # it may hold its lock, which nothing would give back
                signal.setitimer(signal.ITIMER_VIRTUAL, AGAIN)
                return
            inner = inner.f_back
        raise TimeoutError('takes too long to judge mutants')

    signal.signal(signal.SIGVTALRM, cut_off)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(item):
        tool.switch_context(item.nodeid)
        begun = time.process_time()
        signal.setitimer(signal.ITIMER_VIRTUAL, longest)
        result = yield
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        found[item.nodeid] = time.process_time() - begun
        tool.switch_context('')
        return result

    def pytest_runtest_logreport(report):
        if report.when == 'call' and report.passed:
            passed.add(report.nodeid)

    def pytest_sessionfinish():
        tool.stop()
        data = tool.get_data()
        rows = {name: {'time': found[name], 'lines': {}} for name in passed}
        for path in data.measured_files():
            short = str(Path(path).relative_to(PACKAGE))
            for line, contexts in data.contexts_by_lineno(path).items():
                for name in contexts:
                    if name in rows:
                        rows[name]['lines'].setdefault(short, []).append(line)
        Path(COVER).write_text(json.dumps(rows))


if CHOSEN:
    seconds = int(os.environ['MUTANTS_SECONDS'])
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))  # a loop without end is noticed

    def pytest_collection_modifyitems(items):
        order = {name: place for place, name in enumerate(json.loads(Path(CHOSEN).read_text()))}
        items[:] = sorted(
            (item for item in items if item.nodeid in order), key=lambda item: order[item.nodeid]
        )
