# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator``, and ``python -m estimator_pkg``."""

from __future__ import annotations

import signal
import sys


def main() -> int:
    """Run the command line; return the exit code.

    Until it is imported and handles Ctrl-C itself, Ctrl-C ends the process without a traceback.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from estimator_pkg import cli

    return cli.main()


if __name__ == '__main__':
    sys.exit(main())
