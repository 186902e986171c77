# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Benchmarks of speed and accuracy against named peers, on the installed package."""

import os
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
if Path(sys.path[0]).resolve() == ROOT:  # python -m puts it first, but its package has no engine
    sys.path[:] = [*sys.path[1:], str(ROOT)]


def outside() -> dict[str, Any]:
    """Return arguments of subprocess with which a process imports what this one does."""
    return {'cwd': os.sep, 'env': {**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)}}
