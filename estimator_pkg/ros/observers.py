# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The observer nodes of the graph, and what they publish."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from time import monotonic
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import DurabilityPolicy, QoSProfile

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STATUS, RESET = '/status', '/reset'
STDDEV = '_stddev'
ESTIMATING = {'tracking', 'coasting'}
PATIENCE = 3.0  # [s] for ~/status, which is latched, and /diagnostics, which comes once a second
DISCOVERY = 1.0  # [s] for the first node
DIAGNOSTICS, STATES = 'diagnostic_msgs/msg/DiagnosticArray', 'sensor_msgs/msg/JointState'


def observers(node: Any) -> set[str]:
    """Return the nodes that publish ~/status and serve ~/reset, by their full names."""
    publishing = {
        name + STATUS
        for topic, types in node.get_topic_names_and_types()
        if topic.endswith(STATUS) and DIAGNOSTICS in types
        for name in _publishers(node, topic)
    }
    services = {
        name
        for name, types in node.get_service_names_and_types()
        if 'std_srvs/srv/Trigger' in types
    }
    names = {topic.removesuffix(STATUS) for topic in publishing}
    return {name for name in names if name + RESET in services}


def listen(
    node: Any, name: str, status: Callable[[Any], None], diagnosed: Callable[[str], None]
) -> None:
    """Subscribe to what an observer reports.

    Parameters
    ----------
    status : gets the entries of ~/status. diagnosed : gets the observer's text on /diagnostics.
    """

    def diagnoses(message: DiagnosticArray) -> None:
        for entry in message.status:
            if entry.name == name:
                diagnosed(entry.message)

    def statuses(message: DiagnosticArray) -> None:
        status(message.status)

    node.create_subscription(DiagnosticArray, name + STATUS, statuses, LATCHED)
    node.create_subscription(DiagnosticArray, '/diagnostics', diagnoses, 10)


def outputs(node: Any, name: str) -> dict[str, list[str]]:
    """Return the types of the topics that the node of this full name publishes."""
    space, _, own = name.rpartition('/')
    try:
        return dict(node.get_publisher_names_and_types_by_node(own, space or '/'))
    except Exception:  # of rcl: the node has just gone
        return {}


def makers(node: Any, topics: Iterable[str]) -> dict[str, str]:
    """Return the observer that publishes each of these topics; none: the topic is left out."""
    ours = observers(node)
    return {topic: name for topic in topics for name in _publishers(node, topic) if name in ours}


def _publishers(node: Any, topic: str) -> list[str]:
    """Return the full names of the nodes that publish a topic."""
    return [
        f'{each.node_namespace.rstrip("/")}/{each.node_name}'
        for each in node.get_publishers_info_by_topic(topic)
    ]


def estimate_topics(node: Any, name: str) -> tuple[str, str]:
    """Return the topics of an observer's estimates and standard deviations; '' for none yet.

    Parameters
    ----------
    name : full name of the observer's node. Its topics may be remapped.
    """
    states = sorted(topic for topic, types in outputs(node, name).items() if STATES in types)
    estimates = [topic for topic in states if not topic.endswith(STDDEV)]
    ours = [topic for topic in estimates if topic.endswith('/estimate')] or estimates
    return (next(iter(ours), ''), next((topic for topic in states if topic.endswith(STDDEV)), ''))


def why_nothing(node: Any) -> dict[str, str]:
    """Return the observer nodes of the graph: name -> '' or why it estimates nothing.

    Parameters
    ----------
    node : in no executor; it listens for up to `DISCOVERY` + `PATIENCE`.
    """
    statuses: dict[str, list[Any]] = {}
    diagnoses: dict[str, str] = {}
    end = monotonic() + DISCOVERY
    while not (names := observers(node)) and monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    for name in names:
        listen(node, name, *(partial(each.__setitem__, name) for each in (statuses, diagnoses)))
    end = monotonic() + PATIENCE
    while not (names <= statuses.keys() & diagnoses.keys()) and monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    return {name: _why(statuses.get(name), diagnoses.get(name, '')) for name in sorted(names)}


def _why(entries: list[Any] | None, diagnosis: str) -> str:
    """Return why a node estimates nothing; '' if one of its joints has an estimate."""
    if entries is None:
        return f'its status did not arrive within {PATIENCE:g} s'
    for entry in entries:
        if any(item.key == 'status' and item.value in ESTIMATING for item in entry.values):
            return ''
    reasons = [f'{entry.name}: {entry.message}' for entry in entries] or ['no joint has appeared']
    return '; '.join([*reasons, *([diagnosis] if diagnosis not in ('', 'ok') else [])])
