# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Child processes that never outlive their parent."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence

from estimator_pkg.errors import UserError

PATIENCE = 5.0  # time that a process has to end after each signal [s]


class Child:
    """A Python module that runs as a process in its own session.

    Ctrl-C reaches only the parent, which then ends its children in their order.
    """

    def __init__(
        self, name: str, module: str, arguments: Sequence[str], environment: Mapping[str, str]
    ) -> None:
        self.name = name
        self._log = tempfile.TemporaryFile(  # noqa: SIM115 (closed by `end`)
            mode='a+', encoding='utf-8', errors='replace'
        )
        self._process = subprocess.Popen(
            [sys.executable, '-m', module, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=subprocess.STDOUT,
            env=dict(environment),
            start_new_session=True,
        )

    def check(self) -> None:
        """Raise UserError, with its last line of output, if the process failed."""
        code = self._process.poll()
        if code:
            raise UserError(f'{self.name} ended with code {code}: {self.last_line()}')

    def last_line(self) -> str:
        """Return the last line that the process printed."""
        self._log.seek(0)
        lines = [line for line in self._log.read().splitlines() if line.strip()]
        return lines[-1] if lines else '(it printed nothing)'

    def end(self) -> int:
        """End the process, with SIGINT first; return its exit code."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            if self._process.poll() is not None:
                break
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, number)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(PATIENCE)
        self._log.close()
        return self._process.wait()
