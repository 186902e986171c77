"""What is set of `joint_observer` as a whole; what is set per joint is declared with the driver.

Replay reads the same parameter files, so nothing here imports ROS.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from estimator_pkg.driver.raw_angle import RawAngle
from estimator_pkg.errors import UsageError
from estimator_pkg.parameters import parameter

JOINT_STATES = 'joint_states'
ANGLE = 'angle'
ANGLE_TYPES = ('Float64', 'Float32', 'Int32', 'Int64', 'UInt16')  # of std_msgs


@dataclass(frozen=True)
class NodeSettings:
    """Parameters of the node `joint_observer` beside those of its observer."""

    observer: str = parameter(
        'hybrid_angle', unit='', structural=True,
        description="which observer; 'velocity_estimator list' names them all")
    joints: tuple[str, ...] | None = parameter(
        None, unit='', kind=tuple, structural=True,
        description='names of the joints to estimate; unset: every joint that appears')
    joints_max: int = parameter(
        512, unit='', range=(1, 1_000_000), structural=True,
        description='joints that are kept at most; names that come beyond it get no estimate and '
                    'are counted. Joints that are named in the parameters do not count')
    expiry: float = parameter(
        600.0, unit='s', range=(0.0, 1e9), structural=True,
        description='without a sample for so long a joint is forgotten, unless the parameters name '
                    'it; 0: never')
    input: str = parameter(
        JOINT_STATES, unit='', choices=(JOINT_STATES, ANGLE), structural=True,
        description='which topic is read: joint_states (sensor_msgs/JointState) or angle '
                    '(one number of std_msgs, see angle_type)')
    angle_type: str = parameter(
        'Float64', unit='', choices=ANGLE_TYPES, structural=True,
        description='message type of the topic angle')
    angle_joint: str = parameter(
        'joint', unit='', structural=True,
        description='name under which the joint of the topic angle is published')
    counts_per_revolution: float = parameter(
        0.0, unit='counts', range=(0.0, 1e12), structural=True,
        description='counts of one turn on the topic angle; 0: it carries rad. It also gives the '
                    'quantum where none is set')
    angle_offset: float = parameter(
        0.0, unit='rad', range=(-1e6, 1e6), structural=True,
        description='added to the angle of the topic angle, after scale and sign')
    angle_sign: int = parameter(
        1, unit='', range=(-1, 1), structural=True,
        description='-1 turns the sense of the topic angle round')
    stamp_source: str = parameter(
        'header', unit='', choices=('header', 'publisher'), structural=True,
        description='time of a JointState: its header stamp, or the time at which its publisher '
                    'sent it (for drivers that leave the stamp zero)')

    def check(self) -> None:
        """What a range cannot say.

        Raises
        ------
        UsageError : a sign of 0, an integer angle without counts, an unnamed joint.
        """
        if self.angle_sign == 0:
            raise UsageError("parameter 'angle_sign' must be 1 or -1, not 0")
        if self.input == ANGLE:
            if 'Int' in self.angle_type and self.counts_per_revolution <= 0.0:
                raise UsageError(f"angle_type '{self.angle_type}' carries counts: set "
                                 "'counts_per_revolution'")
            if not self.angle_joint:
                raise UsageError("parameter 'angle_joint' must not be empty")
            if self.only and self.angle_joint not in self.only:
                raise UsageError(f"angle_joint '{self.angle_joint}' is not among 'joints'")

    @property
    def only(self) -> tuple[str, ...]:
        """The joints to estimate; empty: all. (An empty text is how YAML writes an empty list.)"""
        return tuple(name for name in self.joints or () if name)

    @property
    def raw_angle(self) -> RawAngle:
        """What turns a number of the topic angle into rad."""
        return RawAngle(self.counts_per_revolution, self.angle_offset, self.angle_sign)

    def implied(self, common: Mapping[str, Any]) -> dict[str, Any]:
        """`common` observer parameters with what the counts imply: the quantum, if it is unset."""
        values = dict(common)
        if self.input == ANGLE and not values.get('quantum') and self.counts_per_revolution > 0.0:
            values['quantum'] = self.raw_angle.quantum
        return values
