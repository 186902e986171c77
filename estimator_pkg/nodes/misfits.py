# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Publishers and subscriptions of others that do not fit ours. DDS reports few of them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rclpy.duration import Infinite
from rclpy.qos import LivelinessPolicy, QoSCompatibility, QoSProfile, qos_check_compatible

from estimator_pkg.nodes.faults import say

UNNAMED_PUBLISHER = 'an unnamed publisher'
UNNAMED = '_NODE_NAME_UNKNOWN_'  # ROS's name for a node that is not completely discovered
_POLICIES = {
    'eliab': 'reliability',
    'olatile': 'durability',
    'eadline': 'deadline',
    'iveliness': 'liveliness',
}  # word in the reason of `qos_check_compatible` -> policy


def misfits(
    others: Iterable[Any], topic: str, kind: str, qos: QoSProfile, role: str
) -> tuple[dict[str, str], list[str]]:
    """Return (texts about endpoints of others that are not connected, names of the rest).

    Parameters
    ----------
    others : what the graph knows of them.
    topic, kind, qos : of our endpoint; kind is the name of its message class.
    role : of the others, 'publisher' or 'subscription'.
    """
    texts, rest = {}, []
    qos = _offered(qos)
    for other in others:
        who = full_name(other)
        if other.topic_type != kind:
            does = {'other': other.topic_type, 'topic': topic, 'type': kind}
            if role == 'publisher':
                texts[f'type {topic} {who}'] = say('type', who=who, **does)
            continue
        ends = (other.qos_profile, qos) if role == 'publisher' else (qos, other.qos_profile)
        compatible, reason = qos_check_compatible(*ends)
        if compatible != QoSCompatibility.ERROR:
            rest.append(who)
            continue
        own = 'subscription' if role == 'publisher' else 'publisher'
        policy = next((each for word, each in _POLICIES.items() if word in reason), '')
        theirs, ours = (_value(each, policy) for each in (other.qos_profile, qos))
        remedy = (
            f"set the parameter 'qos_overrides.{topic}.{own}.{policy}' to {theirs}"
            if policy in ('reliability', 'durability')
            else f'change it in {who}'
        )
        values = {'policy': policy or 'QoS', 'theirs': theirs, 'ours': ours}
        texts[f'qos {topic} {who}'] = say(
            'qos', role=role, topic=topic, who=who, remedy=remedy, **values
        )
    return texts, rest


def _offered(qos: QoSProfile) -> QoSProfile:
    """Return one of our profiles as the graph shows it: the policies that we leave open are set."""
    return QoSProfile(
        depth=1,
        reliability=qos.reliability,
        durability=qos.durability,
        deadline=Infinite,
        liveliness=LivelinessPolicy.AUTOMATIC,
        liveliness_lease_duration=Infinite,
    )


def _value(qos: QoSProfile, policy: str) -> str:
    value = getattr(qos, policy, '')
    return str(getattr(value, 'name', value)).lower()


def full_name(endpoint: Any) -> str:
    """Return the node of another's endpoint; a publisher outside ROS has none."""
    if endpoint.node_name == UNNAMED:
        return UNNAMED_PUBLISHER
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'


def type_name(kind: Any) -> str:
    """Return the name of a message class, as in 'sensor_msgs/msg/JointState'."""
    package, what, _ = kind.__module__.split('.', 2)
    return f'{package}/{what}/{kind.__name__}'
