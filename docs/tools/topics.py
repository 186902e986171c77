# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The page docs/topics.md: topics, services and QoS, read from nodes that really run.

    python -m docs.tools.topics > docs/topics.md

Each node is made with the settings that decide which topics it has. A topic or service without a
text in `MEANING` is an error, and so is a text without a topic.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'  # read by rclpy.init

from estimator_pkg.ros import runtime  # noqa: F401  sets what rclpy reads  # isort: skip

import rclpy
from rclpy.logging import LoggingSeverity, set_logger_level

from estimator_pkg import registry
from estimator_pkg.evaluation.text import markdown
from estimator_pkg.nodes.observer import ObserverNode
from estimator_pkg.nodes.ros_parameters import ros_values
from sim_pkg.nodes.simulator_node import SENSOR_DATA

PAGE = Path(__file__).resolve().parents[1] / 'topics.md'

MOTOR = {'resistance': 0.06, 'inductance': 3.375e-5, 'flux': 0.0019, 'pole_pairs': 7}
POSE = {'field_type': 'geometry_msgs/msg/PoseStamped', 'field': 'pose.orientation.yaw'}
COMMANDED = {'input': 'effort_command'}
NODES: dict[str, list[dict[str, Any]]] = {  # by kind: the settings that decide about topics
    'angle': [{}, {'input': 'angle'}, {'input': 'field', **POSE}, {'observer': 'pll'}],
    'mechanical': [{}, COMMANDED],
    'drive': [MOTOR, {**MOTOR, 'input': 'current_voltage'}],
    'angle_and_input': [{}, COMMANDED],
    'switched': [{}, COMMANDED],
    'wheels': [{'radius': [0.1], 'track': 0.5, 'gyro_topic': 'imu'}],
}
MEANING = {
    'joint_states': 'names, positions, and efforts where a known input is needed',
    'angle': 'one number: `angle_type`, or `field` of `field_type`',
    'effort_command': 'the commanded input; `effort_command_type: Float64MultiArray` has no names',
    'switch_event': 'names of the events that happened, at their stamps; may have no publisher',
    'imu': '`gyro_topic`: `gyro_field` of `gyro_type` is the yaw rate; may have no publisher',
    'drive_samples': 'batches of currents and voltages: [layout](first_drive.md#drive_samples)',
    'current': '`x` alpha, `y` beta, or the phases [A] (`frame`)',
    'voltage': '`x` alpha, `y` beta, or the phases [V] (`frame`)',
    '~/estimate': 'the joints of the message that it answers: position, velocity, efforts copied',
    '~/estimate_stddev': 'one standard deviation of position and velocity',
    '~/acceleration': 'position, velocity and acceleration of the joints that have one',
    '~/smoothed': 'position and velocity of a message `smoothing_lag` ago, with its stamp',
    '~/smoothed_stddev': 'one standard deviation of these',
    '~/gains': 'effect of the gains, in words: poles, limits, noise',
    '~/flux_linkage': '`x` flux linkage [Wb], `y` its standard deviation',
    '~/estimate_samples': 'every sample: electrical angle, electrical speed, flux linkage, valid',
    '~/identified_parameters': 'parameters with standard deviations, 10 times per second',
    '~/discrete_state': 'the discrete state, by its name in the model',
    '~/odometry': 'pose and twist of the base with their covariances',
    '~/status': 'status of each joint and why, faults of its encoder too, when it changes; '
    'the node itself comes last',
    '/diagnostics': 'the same once per second, with all counters',
    'service ~/reset': 'starts every joint again',
    'service ~/save': 'writes the identified parameters to `parameters_file`',
    'service ~/freeze': '`true` stops the identification, `false` resumes it',
}
INTRODUCTION = """\
# Topics, services and QoS

`python -m docs.tools.topics` starts the nodes and reads these tables from them.

- Names are those before remapping. `~` is the node's name: `~/estimate` of `joint_observer` is
  `/joint_observer/estimate`. Remap with `-r joint_states:=/arm/joint_states`.
- *On demand* outputs are computed only while somebody subscribes to them.
- The answers of the first 5 s (`wait_for_subscriber`; 0.0: none) wait for the first subscriber,
  the last 500 of each output: DDS may discover a subscriber that is already there only seconds
  later. They then come at once, with their stamps.
- Inputs are best effort, so they match every publisher. A subscriber of an output may be reliable
  or best effort.
- Parameters change reliability, durability, history and depth. An output that is made transient
  local has depth 1, unless a parameter sets it. Their names contain the topic after remapping:

        ros2 run velocity_estimator joint_observer --ros-args \\
          -p qos_overrides./joint_states.subscription.reliability:=reliable

- A node subscribes to an input once it has a publisher, or after 10 s without one
  ([why](troubleshooting.md#ros2-topic-info-shows-no-subscription-of-the-node)).
- Each node also has the parameter services of ROS, `/rosout` and `/parameter_events`."""
LAST = """\
## Simulators

Topics of simulators are relative: start one in the same namespace as its observer. The QoS of all
of them is {qos}. Each simulator publishes `joint_states` and `ground_truth/joint_states`
(sensor_msgs/JointState), but `pmsm_sim` the second alone; and `/diagnostics` once per second, which
counts how late it is. `cart_pendulum_sim` can close its control loop with `estimate`
(sensor_msgs/JointState). Others also publish:"""
COMMON = ('joint_states', 'ground_truth/joint_states')  # named in LAST


class Row(NamedTuple):
    """A topic or service of a node."""

    role: str
    name: str
    type: str
    qos: str


def quality(profile: Any) -> str:
    """Return a QoS profile as text."""
    durability = profile.durability.name.lower().replace('_', ' ')
    return ', '.join(
        [
            profile.reliability.name.lower().replace('_', ' '),
            *(['transient local'] if durability == 'transient local' else []),
            f'depth {profile.depth}',
        ]
    )


def type_name(kind: Any) -> str:
    """Return the name of a message or service class as in 'sensor_msgs/JointState'."""
    return f'{kind.__module__.partition(".")[0]}/{kind.__name__}'


def rows(kind: str, values: dict[str, Any]) -> Iterator[Row]:
    """Yield what a node with these parameters has, in the order of its messages."""
    node = ObserverNode(kind, parameter_overrides=ros_values(values))
    try:
        own = node.get_fully_qualified_name()
        inputs = node._endpoints.inputs
        for each in inputs:
            short = each.type.replace('/msg/', '/')
            yield Row('input', each.topic_name.lstrip('/'), short, quality(each.qos))
        demanded = {output.name for output in node.stream.outputs if output.on_demand}
        for each in node.publishers:
            name = each.topic_name.replace(own, '~')
            if name in ('/rosout', '/parameter_events'):
                continue
            extra = ', on demand' if name.removeprefix('~/') in demanded else ''
            yield Row('output', name, type_name(each.msg_type), quality(each.qos_profile) + extra)
        for each in node.services:
            name = each.srv_name.replace(own, '~')
            if type_name(each.srv_type).startswith('std_srvs'):
                yield Row('service', name, type_name(each.srv_type), '')
    finally:
        node.destroy_node()


def lines(kind: str) -> list[tuple[str, ...]]:
    """Return the lines of a node's table; a topic's content has the setting that it needs."""
    variants = [(values, list(rows(kind, values))) for values in NODES[kind]]
    order = {row: None for _, found in variants for row in found}
    found = []
    for row in sorted(order, key=lambda row: ('input', 'output', 'service').index(row.role)):
        having = [values for values, found in variants if row in found]
        needs = ''
        if len(having) < len(variants):
            inputs = {values.get('input', 'the default') for values in having}
            if len(inputs) < len({values.get('input', 'the default') for values, _ in variants}):
                needs = ' or '.join(f'`input: {one}`' for one in sorted(inputs))
                needs = needs.replace('`input: the default`', 'default `input`')
            else:
                needs = 'if the observer estimates it'
        meaning = MEANING[f'service {row.name}' if row.role == 'service' else row.name]
        content = f'{meaning} ({needs})' if needs else meaning
        found.append((row.role, f'`{row.name}`', row.type, row.qos, content))
    return found


def simulated() -> str:
    """Return the table of further topics that simulators publish with their default parameters."""
    lines = []
    for name in registry.names(registry.SIMULATORS):
        simulator = registry.find(registry.SIMULATORS, name)
        topics = [
            f'`{topic.name}` ({topic.type.replace("/msg/", "/")})'
            for topic in simulator.topics(simulator.parameters())
            if topic.name not in COMMON
        ]
        if topics:
            lines.append((f'`{name}_sim`', ', '.join(topics)))
    return markdown(('node', 'publishes'), lines)


def page() -> str:
    """Return the text of docs/topics.md."""
    tables = {registry.find(registry.STREAMS, kind).NODE: lines(kind) for kind in NODES}
    first, *others = tables.values()
    every = [line for line in first if all(line in other for other in others)]
    parts = [INTRODUCTION]
    for node, found in {'Every node': [], **tables}.items():
        own = [line for line in found if line not in every] or every
        parts += [f'## {node}', markdown(('', 'name', 'type', 'QoS', 'content'), own)]
    missing = [text for name, text in MEANING.items() if text not in '\n'.join(parts)]
    if missing:
        raise ValueError(f'no node has the topics of these texts: {missing}')
    parts += [LAST.format(qos=quality(SENSOR_DATA)), simulated()]
    return '\n\n'.join(parts) + '\n'


def main() -> None:
    """Print the page."""
    rclpy.init()
    set_logger_level('', LoggingSeverity.FATAL)
    try:
        print(page(), end='')
    finally:
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
