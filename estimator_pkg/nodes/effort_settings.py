"""What is set of nodes that know an input, about where it comes from. Imports no ROS."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from estimator_pkg.driver.effort_command import ARRAY, JOINT_STATE, EffortCommands
from estimator_pkg.driver.efforts import COMMAND, FIELD
from estimator_pkg.parameters import parameter


@dataclass(frozen=True)
class EffortSettings:
    """Where the efforts of a node come from, and which time its messages have."""

    input: str = parameter(
        FIELD, unit='', choices=(FIELD, COMMAND), structural=True,
        description='where efforts come from: the effort field of joint_states, or the topic '
                    'effort_command (see effort_is for when they act)')
    effort_command_type: str = parameter(
        JOINT_STATE, unit='', choices=(JOINT_STATE, ARRAY), structural=True,
        description='of the topic effort_command: sensor_msgs/JointState, efforts by name; or '
                    'std_msgs/Float64MultiArray, one number per joint (or per joint that has an '
                    'input), in the order of the joints; it has the time at which it was sent')
    stamp_source: str = parameter(
        'header', unit='', choices=('header', 'publisher'), structural=True,
        description='time of a message: its header stamp, or the time at which its publisher sent '
                    'it; events always have their header stamp')

    def commands(self, orders: Sequence[Sequence[str]]) -> EffortCommands:
        """What decodes the topic effort_command.

        Parameters
        ----------
        orders : names of the joints, all and those that have an input.
        """
        return EffortCommands(self.effort_command_type, orders, self.stamp_source == 'publisher')
