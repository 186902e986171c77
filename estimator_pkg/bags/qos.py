# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Offered QoS profiles in bags."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import yaml
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos

ENDLESS = QosTime(9223372036, 854775807)


def profile(*, reliable: bool = True, transient_local: bool = False, depth: int = 10) -> Qos:
    """Return a profile with these settings, and ROS defaults for the others."""
    return Qos(
        QosHistory.KEEP_LAST,
        depth,
        QosReliability.RELIABLE if reliable else QosReliability.BEST_EFFORT,
        QosDurability.TRANSIENT_LOCAL if transient_local else QosDurability.VOLATILE,
        ENDLESS,
        ENDLESS,
        QosLiveliness.AUTOMATIC,
        ENDLESS,
        False,
    )


def plain(profiles: Sequence[Qos]) -> list[dict[str, Any]]:
    """Return the profiles in the form of Jazzy's metadata.yaml."""
    return [{**item} for item in dump_qos_v9(list(profiles))]


def to_text(profiles: Sequence[Qos]) -> str:
    """Return the profiles in the form of an MCAP channel: YAML."""
    return yaml.safe_dump(plain(profiles), sort_keys=False).strip() if profiles else ''


@lru_cache(64)  # each topic has a text, mostly the same; YAML takes milliseconds
def of_text(text: str) -> tuple[Qos, ...]:
    """Return the profiles in the text of an MCAP channel; () if it is invalid."""
    try:
        return tuple(parse_qos(text))
    except Exception:  # of other recorders: unreadable profiles count as missing
        return ()
