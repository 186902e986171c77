# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""QoS of the topics of a node, and what its users can override of it."""

from __future__ import annotations

from rcl_interfaces.msg import SetParametersResult
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

DEEPEST = 100_000  # largest depth of a queue
KEPT = 500  # messages for a subscriber that connects

_OPEN = (
    QoSPolicyKind.HISTORY,
    QoSPolicyKind.DEPTH,
    QoSPolicyKind.RELIABILITY,
    QoSPolicyKind.DURABILITY,
)


def sensor_data() -> QoSProfile:
    """QoS of inputs: best effort matches every publisher; depth 200 bridges 0.2 s at 1 kHz."""
    return QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT)


def estimates(depth: int = KEPT) -> QoSProfile:
    """QoS for outputs: reliable; the queue keeps what a subscriber missed while it connected."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)


def latched() -> QoSProfile:
    """QoS for latched topics: late joiners get the last message."""
    return QoSProfile(
        depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
    )


def overriding() -> QoSOverridingOptions:
    """Return the policies that the parameters ``qos_overrides`` may set."""
    return QoSOverridingOptions(_OPEN, callback=_possible)


def _possible(qos: QoSProfile) -> SetParametersResult:
    """Check that the depth is valid; the middleware would report it in ten lines."""
    if 1 <= qos.depth <= DEEPEST or qos.history == HistoryPolicy.KEEP_ALL:
        return SetParametersResult(successful=True)
    return SetParametersResult(
        successful=False, reason=f'depth {qos.depth} is outside [1, {DEEPEST}]'
    )
