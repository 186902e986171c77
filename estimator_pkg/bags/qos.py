# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Offered QoS profiles, in the forms of bags and of rclpy."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import yaml

if TYPE_CHECKING:
    from rosbags.interfaces import Qos


def profile(*, reliable: bool = True, transient_local: bool = False, depth: int = 10) -> Qos:
    """Return a profile with these settings, and ROS defaults for the others."""
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    endless = QosTime(9223372036, 854775807)
    return Qos(
        QosHistory.KEEP_LAST,
        depth,
        QosReliability.RELIABLE if reliable else QosReliability.BEST_EFFORT,
        QosDurability.TRANSIENT_LOCAL if transient_local else QosDurability.VOLATILE,
        endless,
        endless,
        QosLiveliness.AUTOMATIC,
        endless,
        False,
    )


def plain(profiles: Sequence[Qos]) -> list[dict[str, Any]]:
    """Return the profiles in the form of Jazzy's metadata.yaml."""
    from rosbags.rosbag2.metadata import dump_qos_v9

    return [{**item} for item in dump_qos_v9(list(profiles))]


def to_text(profiles: Sequence[Qos]) -> str:
    """Return the profiles in the form of an MCAP channel: YAML."""
    if not profiles:
        return ''
    return yaml.safe_dump(plain(profiles), sort_keys=False).strip()


def parse(text: Any) -> list[Qos]:
    """Return the profiles in a bag's text or list, of any rosbag2 version; [] if it is invalid.

    Parameters
    ----------
    text : YAML text of a channel, or the list in metadata.yaml.
    """
    return list(_of_text(text)) if isinstance(text, str) else _profiles(text)


@lru_cache(64)  # each topic has them, mostly the same; YAML takes milliseconds
def _of_text(text: str) -> tuple[Qos, ...]:
    return tuple(_profiles(text))


def _profiles(given: Any) -> list[Qos]:
    from rosbags.rosbag2.metadata import parse_qos

    try:
        return parse_qos(given)
    except Exception:  # of other recorders: unreadable profiles count as missing
        return []
