# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The columns of a page's table, and the gains of an estimate."""

from __future__ import annotations

from typing import Any

from estimator_pkg import registry
from estimator_pkg.evaluation.compare.comparison import Row
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.report.tradeoff import MAIN_GAINS
from estimator_pkg.parameters import declared
from estimator_pkg.params_file import split

COLUMNS = {  # of `description.cells`: unit
    **{'rms': 'rad/s', 'mean': 'rad/s', 'max': 'rad/s', 'max at': 's', 'bias': 'rad/s'},
    **{'delay': 'ms', 'noise': 'rad/s', 'in 95 % interval': '', 'valid': 's'},
    **{'samples': '', 'dropped': ''},
}
SHOWN_GAINS = 3  # gains in a cell


def gains(row: Row, entry: Entry | None) -> str:
    """Return the gains of an estimate: those that were set, else the main one; '' if unknown.

    Parameters
    ----------
    entry : the observer that was run; None: a topic, or an observer at its defaults.
    """
    name = row.source if entry is None else entry.observer
    if name not in registry.names(registry.OBSERVERS):
        return ''
    values = changed(entry, row.joint)
    if values:
        shown = [f'{name} {text}' for name, text in list(values.items())[:SHOWN_GAINS]]
        return ', '.join(shown + ['...'] * (len(values) > SHOWN_GAINS))
    known = declared(registry.find(registry.OBSERVERS, name).gains)
    main = next((each for each in MAIN_GAINS if each in known), '')
    if not main:
        return 'defaults'
    default = known[main].default
    return f'{main} {"automatic" if default is None else _gain(default)} (default)'


def changed(entry: Entry | None, joint: str) -> dict[str, str]:
    """Return the gains of a joint that are not at their defaults, as text."""
    if entry is None:
        return {}
    known = declared(registry.find(registry.OBSERVERS, entry.observer).gains)
    common, overrides = split(dict(entry.values))
    values = {**common, **overrides.get(joint, {})}
    return {
        name: _gain(value)
        for name, value in values.items()
        if name in known and value != known[name].default
    }


def _gain(value: Any) -> str:
    return f'{value:.4g}' if isinstance(value, float) else str(value)
