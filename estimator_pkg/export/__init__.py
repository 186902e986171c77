# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Tuned observers as C99 headers, for firmware and C++. See docs/firmware.md."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

TEMPLATES = Path(__file__).with_name('templates')


def template(name: str, values: Mapping[str, object]) -> str:
    """Return the text of a file of `templates` with its names between two @ replaced."""
    return filled((TEMPLATES / f'{name}.in').read_text(), values)


def filled(text: str, values: Mapping[str, object]) -> str:
    """Return `text` with its names between two @ replaced."""
    return re.sub(r'@([A-Z_]+)@', lambda found: str(values[found[1]]), text)
