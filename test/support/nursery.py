# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Starts `python -m MODULE` for tests by a fork of a process that has imported ROS.

The imports take most of a short-lived node's time. A fork has the imported modules, but no
context of ROS and no participant of DDS. It is a child of the nursery, which reports its exit code.
"""

from __future__ import annotations

import atexit
import gc
import json
import os
import runpy
import select
import signal
import socket
import struct
import subprocess
import sys
import textwrap
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache

NUMBER = struct.Struct('i')
OF_PYTEST = 'PYTEST_CURRENT_TEST'  # differs in each test, and matters to none


def alike(environment: Mapping[str, str]) -> dict[str, str]:
    return {name: value for name, value in environment.items() if name != OF_PYTEST}


class Nursery:
    """The process that forks; it ends with the one that made it."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        self.environment = alike(environment)
        self.line, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._process = subprocess.Popen(
            [sys.executable, __file__, str(theirs.fileno())],
            pass_fds=[theirs.fileno()],
            env=environment,
        )
        theirs.close()
        atexit.register(self._end)

    def _end(self) -> None:
        self.line.close()
        self._process.wait()


@lru_cache(1)
def nursery() -> Nursery:
    """The one of this process, whose children keep its environment of the first call."""
    return Nursery({**os.environ, 'PYTHONUNBUFFERED': '1'})


class Child:
    """A process of the nursery: what tests use of `subprocess.Popen`.

    Its two outputs go to `files`, or together to `stdout`, which one can read.
    """

    def __init__(self, module: str, *arguments: str, files: tuple[int, int] | None = None) -> None:
        self.stdout, pipe = None, None
        if files is None:
            read, pipe = os.pipe()
            self.stdout, files = os.fdopen(read), (pipe, pipe)
        self._status, status = os.pipe()
        request = json.dumps([module, arguments, os.getcwd()]).encode()
        socket.send_fds(nursery().line, [request], [*files, status])
        for number in (pipe, status):
            if number is not None:
                os.close(number)
        self.pid = self._number()
        self.returncode: int | None = None

    def _number(self) -> int:
        raw = os.read(self._status, NUMBER.size)
        assert raw, 'the nursery has ended'
        return NUMBER.unpack(raw)[0]

    def wait(self, timeout: float | None = None) -> int:
        if self.returncode is None:
            if not select.select([self._status], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
            self.returncode = self._number()
            os.close(self._status)
        return self.returncode

    def poll(self) -> int | None:
        try:
            return self.wait(0.0)
        except subprocess.TimeoutExpired:
            return None

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


def fits(environment: Mapping[str, str]) -> bool:
    """True if it is that of the nursery, which its children have; else a process starts afresh."""
    return nursery().environment == alike(environment)


def words_of(module: str, *arguments: str) -> list[str]:
    """The command line of a process that starts afresh."""
    return [
        sys.executable,
        '-c' if module == 'exec' else '-m',
        *(arguments if module == 'exec' else (module, *arguments)),
    ]


def start(module: str, *arguments: str) -> Child | subprocess.Popen:
    """Start it; both outputs are read from its `stdout`."""
    environment = {**os.environ, 'PYTHONUNBUFFERED': '1'}
    if fits(environment):
        return Child(module, *arguments)
    return subprocess.Popen(
        words_of(module, *arguments),
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=environment,
    )


class Run:
    """A run of which only the end matters."""

    def __init__(self, module: str, *arguments: str) -> None:
        self._files = output, error = os.memfd_create('stdout'), os.memfd_create('stderr')
        environment = {**os.environ, 'PYTHONUNBUFFERED': '1'}
        self._child: Child | subprocess.Popen
        if fits(environment):
            self._child = Child(module, *arguments, files=(output, error))
        else:
            words = words_of(module, *arguments)
            self._child = subprocess.Popen(words, stdout=output, stderr=error, env=environment)

    def done(self, timeout: float = 200.0) -> tuple[int, str, str]:
        """(exit code, stdout, stderr); it is killed after `timeout` [s]."""
        try:
            code = self._child.wait(timeout)
        except subprocess.TimeoutExpired:
            self._child.kill()
            raise
        reported = []
        for number in self._files:
            os.lseek(number, 0, os.SEEK_SET)
            with os.fdopen(number, 'rb') as file:
                reported.append(file.read().decode())
        return code, *reported


def run(module: str, *arguments: str) -> tuple[int, str, str]:
    """(exit code, stdout, stderr) of `python -m MODULE`."""
    return Run(module, *arguments).done()


def run_script(script: str, *arguments: object) -> tuple[int, str]:
    """(exit code, both outputs) of `python -c SCRIPT`, which is indented."""
    child = start('exec', textwrap.dedent(script), *map(str, arguments))
    output = child.stdout.read()
    return child.wait(), output


def prepare() -> None:
    """Import what nodes do, as far as it is installed."""
    from estimator_pkg.ros import runtime  # noqa: F401, I001  prepares what NumPy reads

    import estimator_pkg.observers
    import estimator_pkg.streams.angle

    estimator_pkg.observers.find(estimator_pkg.streams.angle.AngleStream.SETTINGS().observer)
    with suppress(ImportError):
        from diagnostic_msgs.msg import DiagnosticArray
        from rosidl_generator_py import import_type_support
        from sensor_msgs.msg import JointState

        import estimator_pkg.nodes.observer

        for message in (DiagnosticArray, JointState):
            import_type_support(message.__module__.partition('.')[0])
    gc.freeze()


def fork_as_asked(line: socket.socket) -> tuple[str, list[str]]:
    """Fork for each request; return in the child alone, with its module and arguments."""
    reports: dict[int, int] = {}  # where the exit code of a child goes
    woken, wake = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
    signal.set_wakeup_fd(wake)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    while True:
        ready, *_ = select.select([line, woken], [], [])
        if woken in ready:
            os.read(woken, 1 << 10)
        while reports and (ended := os.waitpid(-1, os.WNOHANG))[0]:
            report = reports.pop(ended[0])
            with suppress(BrokenPipeError):  # nobody waits any more
                os.write(report, NUMBER.pack(os.waitstatus_to_exitcode(ended[1])))
            os.close(report)
        if line not in ready:
            continue
        raw, files, *_ = socket.recv_fds(line, 1 << 17, 3)
        if not raw:
            sys.exit()
        output, error, report = files
        pid = os.fork()
        if not pid:
            break
        os.close(output)
        os.close(error)
        os.write(report, NUMBER.pack(pid))
        reports[pid] = report
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    module, arguments, folder = json.loads(raw)
    os.chdir(folder)
    os.dup2(output, 1)
    os.dup2(error, 2)
    for number in (line.fileno(), woken, wake, output, error, report, *reports.values()):
        os.close(number)
    return module, arguments


if __name__ == '__main__':
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for those that ask
    connection = socket.socket(fileno=int(sys.argv[1]))
    prepare()
    name, words = fork_as_asked(connection)
    connection.detach()
    if name == 'exec':
        sys.argv = ['-c', *words[1:]]
        exec(words[0], {'__name__': '__main__'})
    else:
        sys.argv = [name, *words]
        runpy.run_module(name, run_name='__main__', alter_sys=True)
