"""What nodes of observers that know an input have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from estimator_pkg.nodes.base import ObserverNode, Take  # first: settles what rclpy reads  # isort: skip

from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from estimator_pkg.driver.effort_command import ARRAY
from estimator_pkg.driver.efforts import COMMAND
from estimator_pkg.nodes.effort_settings import EffortSettings
from estimator_pkg.nodes.health import Health


class DrivenHealth(Health):
    """Adds what the node knows of a joint's input."""

    MISMATCH = ('their arrays differ in number, or they lack a joint or an effort that the '
                'observer needs (with input: effort_command efforts come by a topic of their own)')
    _node: DrivenNode

    def _more(self, name: str) -> Mapping[str, Any]:
        return self._node.about(name)


class DrivenNode(ObserverNode):
    """An `ObserverNode` whose efforts come with the joint states or from effort_command."""

    HEALTH = DrivenHealth
    settings: EffortSettings

    def about(self, name: str) -> Mapping[str, Any]:
        """What the status of a joint tells beside what it tells of every joint."""
        settings: Any = self.bank.joints[name].settings
        return {'input': self.settings.input, 'input_unit': settings.input_unit}

    def _build(self, configuration: Any, joint: str) -> Any:
        functions = super()._build(configuration, joint)
        given = functions.no_input
        configuration.for_joint(joint)[1].check_inputs(
            len(given) if isinstance(given, tuple) else 1, self._called(joint))
        return functions

    def _orders(self) -> Sequence[Sequence[str]]:
        """Names that the numbers of a Float64MultiArray may stand for."""
        raise NotImplementedError

    def _connect_states(self, take: Take) -> Subscription:
        """Subscribe to the joint states, for which `take` is called, and to the efforts."""
        states = self._listen_to_states('joint_states', take)
        if self.settings.input == COMMAND:
            kind = Float64MultiArray if self.settings.effort_command_type == ARRAY else JointState
            self._commands = self.settings.commands(self._orders())
            self._listen(kind, 'effort_command', self._command_came, answered=False)
        return states

    def _command_came(self, raw: bytes, info: Mapping[str, Any]) -> None:
        bank: Any = self.bank
        bank.command(*self._commands.decode(raw, info['source_timestamp']))
