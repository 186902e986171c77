# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Faults among the publishers of a node's inputs and the subscribers of its outputs.

DDS reports most of them to nobody.
"""

from __future__ import annotations

from typing import Any

from rclpy.duration import Infinite
from rclpy.node import Node
from rclpy.qos import LivelinessPolicy, QoSCompatibility, QoSProfile, qos_check_compatible

from estimator_pkg.errors import suggestion
from estimator_pkg.nodes.endpoints import Endpoints, Input, type_name
from estimator_pkg.nodes.faults import Values, listed

UNNAMED = '_NODE_NAME_UNKNOWN_'  # ROS's name for a node that is not completely discovered
AT_START = 2.5  # [s] in which those that were there before us are found
LEFT = 20  # nodes that are remembered after they ended


class Graph:
    """Compares a node's endpoints with those of others.

    Parameters
    ----------
    node, endpoints : the node and its endpoints. started : when the node started [s].
    """

    def __init__(self, node: Node, endpoints: Endpoints, started: float) -> None:
        self._node, self._endpoints, self._started = node, endpoints, started
        self._first: set[bytes] = set()  # ours, and what a crash shortly before has left

    def look(self, now: float) -> dict[str, list[Values]]:
        """Return the values of the faults by row; note who publishes the inputs."""
        node = self._node
        found: dict[str, list[Values]] = {name: [] for name in ('nobody', 'type', 'qos', 'shared')}
        for each in self._endpoints.inputs:
            topic, before = each.topic_name, each.found
            others = node.get_publishers_info_by_topic(topic)
            if not others and not each.optional:
                values = {'topic': topic, 'type': each.type, 'port': each.port}
                found['nobody'].append({'key': topic, **values, 'hint': self._instead(each)})
            each.found = []
            for other in others:
                who = full_name(other)
                if other.topic_type != each.type:
                    values = {'topic': topic, 'type': each.type, 'other': other.topic_type}
                    found['type'].append({'key': f'{topic} {who}', 'who': who, **values})
                elif reason := _conflict(other.qos_profile, _offered(each.qos)):
                    found['qos'].append(_incompatible('publisher', who, topic, reason))
                else:
                    each.found.append(who)
            each.left.update(dict.fromkeys(set(before) - set(each.found), now))
            for name in (*each.found, *list(each.left)[:-LEFT]):
                each.left.pop(name, None)
        for publisher in self._endpoints.publishers:
            topic, offered = publisher.topic_name, _offered(publisher.qos_profile)
            for other in node.get_subscriptions_info_by_topic(topic):
                if other.topic_type == type_name(publisher.msg_type) and (
                    reason := _conflict(offered, other.qos_profile)
                ):
                    who = full_name(other)
                    found['qos'].append(_incompatible('subscription', who, topic, reason))
        topic = self._endpoints.outputs[0].topic_name
        there = {
            bytes(each.endpoint_gid): full_name(each)
            for each in node.get_publishers_info_by_topic(topic)
        }
        if now < self._started + AT_START:
            self._first |= there.keys()
        if later := sorted(name for gid, name in there.items() if gid not in self._first):
            found['shared'].append({'key': topic, 'who': listed(later), 'topic': topic})
        return found

    def _instead(self, each: Input) -> str:
        """Return the topics with a publisher of an input's type that may be meant, as text."""
        node, endpoints = self._node, self._endpoints
        own = {each.topic_name for each in endpoints.inputs}
        own.update(publisher.topic_name for publisher in endpoints.publishers)
        names = sorted(
            name
            for name, kinds in node.get_topic_names_and_types()
            if each.type in kinds
            and name not in own
            and not name.endswith(('/estimate', '/estimate_stddev'))  # of another observer
            and node.count_publishers(name)
        )
        if not names:
            return ''
        said = suggestion(each.topic_name, names)
        return f'; {said}' if 'mean' in said else f'; others of this type: {listed(names)}'


def full_name(endpoint: Any) -> str:
    """Return the node of another's endpoint; a publisher outside ROS has none."""
    if endpoint.node_name == UNNAMED:
        return 'an unnamed publisher'
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'


def _incompatible(role: str, who: str, topic: str, reason: str) -> Values:
    own = 'subscription' if role == 'publisher' else 'publisher'
    values = {'role': role, 'who': who, 'topic': topic, 'reason': reason, 'own': own}
    return {'key': f'{topic} {who}', **values}


def _conflict(offered: QoSProfile, requested: QoSProfile) -> str:
    """Return why two profiles are incompatible, in the words of the middleware; '': they fit."""
    compatible, reason = qos_check_compatible(offered, requested)
    if compatible != QoSCompatibility.ERROR:
        return ''
    return reason.replace('ERROR: ', '').strip('; ')


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
