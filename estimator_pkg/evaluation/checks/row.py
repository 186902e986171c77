# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A check as a row: what it measures, where its limit is, its texts and remedies."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

PASS, WARN, FAIL = 'PASS', 'WARN', 'FAIL'
LEVELS = (PASS, WARN, FAIL)


class Finding(NamedTuple):
    """The result of one check.

    check : its name. level : PASS; WARN: estimates get worse; FAIL: they are wrong or missing.
    value : what was measured, with units. remedy : what to do; '' if nothing.
    numbers : the measured values for ``--json``.
    """

    check: str
    level: str
    value: str
    remedy: str = ''
    numbers: Mapping[str, Any] = {}

    def as_dict(self) -> dict[str, Any]:
        """Return the finding for ``--json``."""
        fields = self._asdict()
        numbers = fields.pop('numbers')
        return {**fields, **numbers}


class Measured(NamedTuple):
    """What the statistic of a check found.

    texts : those of the row that apply. numbers : for ``--json``. words : further values of the
    texts.
    """

    level: str
    texts: Sequence[str]
    numbers: Mapping[str, Any] = {}
    words: Mapping[str, Any] = {}


class Check(NamedTuple):
    """A check: one row of docs/doctor.md.

    name : of the check.
    measures, limit : what it measures, and when it does not pass, as that page has it.
    texts : name -> 'text -> remedy' or 'text', with the values of `Measured` in braces.
    statistic : measures it in the readings; None: `found` is called with what was measured.
    """

    name: str
    measures: str
    limit: str
    texts: Mapping[str, str] = {}
    statistic: Callable[[Any], Measured] | None = None

    def __call__(self, seen: Any) -> Finding:
        """Return the finding on these readings."""
        assert self.statistic is not None
        return self.found(*self.statistic(seen))

    def found(
        self,
        level: str,
        texts: Sequence[str],
        numbers: Mapping[str, Any] = {},
        words: Mapping[str, Any] = {},
    ) -> Finding:
        """Return the finding that a measured statistic gives; see `Measured`."""
        values = {**numbers, **words}
        said = [self.texts[each].format_map(values).partition(' -> ') for each in texts]
        value = '; '.join(text for text, *_ in said)
        remedy = '; '.join(remedy for *_, remedy in said if remedy)
        return Finding(self.name, level, value, remedy, numbers)
