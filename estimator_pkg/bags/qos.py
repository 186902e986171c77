"""Offered QoS profiles, as bags carry them and as rclpy takes them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import yaml

if TYPE_CHECKING:
    from rosbags.interfaces import Qos


def profile(*, reliable: bool = True, transient_local: bool = False, depth: int = 10) -> Qos:
    """A profile with what matters set, and the rest as ROS has it by default."""
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


def plain(profiles: list[Qos]) -> list[dict[str, Any]]:
    """The profiles as metadata.yaml of Jazzy lists them."""
    from rosbags.rosbag2.metadata import dump_qos_v9

    return [{**item} for item in dump_qos_v9(profiles)]


def to_text(profiles: list[Qos]) -> str:
    """The profiles as an MCAP channel carries them: YAML."""
    if not profiles:
        return ''
    return yaml.safe_dump(plain(profiles), sort_keys=False).strip()


def parse(text: Any) -> list[Qos]:
    """The profiles in a bag's text or list, of any rosbag2 version; none where it makes no sense.

    Parameters
    ----------
    text : YAML text of a channel, or the list in metadata.yaml.
    """
    from rosbags.rosbag2.metadata import parse_qos

    try:
        return parse_qos(text)
    except Exception:  # of other recorders: what cannot be read is as good as absent
        return []
