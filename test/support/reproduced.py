# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The test that all reproductions share."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

import pytest


def rows(reproduction: Any, slow: Collection[str] = ()) -> Callable[..., None]:
    """A test for each part of a reproduction, that its rows are within their tolerances.

    Parameters
    ----------
    slow : names of parts that take minutes.
    """

    @pytest.mark.long
    @pytest.mark.parametrize(
        'part',
        [
            pytest.param(part, marks=pytest.mark.slow if part.name in slow else (), id=part.name)
            for part in reproduction.parts
        ],
    )
    def test_every_row_is_within_its_tolerance(part: Any) -> None:
        failed = [
            f'{row.reference.id}: {row.value} for {row.reference.value} '
            f'+- {row.reference.tolerance_text}'
            for row in part.rows()
            if not row.ok
        ]
        assert not failed

    return test_every_row_is_within_its_tolerance
