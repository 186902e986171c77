# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Worker processes end with the command that started them, however it ends."""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest

COMMAND = """
import time
from estimator_pkg.evaluation.workers import workers

if __name__ == '__main__':
    with workers(2) as run_many:
        for _ in run_many(time.sleep, [(0.1,), (600.0,), (600.0,)]):
            print('one', flush=True)
"""


def lives(process):
    return process.is_running() and process.status() != psutil.STATUS_ZOMBIE


@pytest.mark.long
def test_a_command_that_is_killed_leaves_no_worker(tmp_path):
    script = tmp_path / 'command.py'
    script.write_text(COMMAND)
    command = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE)
    started = []
    try:
        assert command.stdout.readline() == b'one\n'
        started = psutil.Process(command.pid).children(recursive=True)
        assert len(started) >= 2
        os.kill(command.pid, signal.SIGKILL)
        end = time.monotonic() + 20.0
        while time.monotonic() < end and any(map(lives, started)):
            time.sleep(0.1)
        assert not list(filter(lives, started))
    finally:
        command.kill()
        for each in filter(lives, started):
            each.kill()
        command.communicate()
