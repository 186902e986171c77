"""How `pmsm_observer` is: as of joints, and what only currents and voltages can be wrong in."""

from __future__ import annotations

from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from rclpy.subscription import Subscription

from estimator_pkg.driver.drive_stream import DriveStream
from estimator_pkg.driver.joint import Joint
from estimator_pkg.nodes.diagnostics import WARN
from estimator_pkg.nodes.endpoints import Endpoints
from estimator_pkg.nodes.health import Health, WatchedBank
from estimator_pkg.nodes.ros_parameters import RosParameters


class PmsmHealth(Health):
    """Adds to `Health` why no sample comes of the messages.

    Parameters
    ----------
    stream : the motor behind its topics.
    """

    def __init__(self, node: Node, bank: WatchedBank, endpoints: Endpoints, ros: RosParameters,
                 input: Subscription, stream: DriveStream) -> None:
        self._stream = stream
        super().__init__(node, bank, endpoints, ros, input)

    def _judge(self, name: str, joint: Joint, now: float) -> tuple[int, str]:
        if self._stream.joint.misfit:  # no sample is used then, and that is why
            return joint.estimate()[3], joint.why()
        return super()._judge(name, joint, now)

    def _why_silent(self, name: str) -> str:
        return self._stream.why_silent()

    def _of_node(self, name: str, totals: Any, new: Any, passed: float) -> DiagnosticStatus:
        stream = self._stream
        status = super()._of_node(name, totals, new, passed)
        wrong = [] if status.message == 'ok' else [status.message]
        if new['messages_dropped.malformed']:
            wrong.append(stream.complaint)
        if new.get('unpaired', 0):
            wrong.append(f"{new['unpaired']} currents or voltages without their partner")
        if new.get('unbalanced', 0):
            wrong.append(f"{new['unbalanced']} currents whose phases do not sum to zero")
        if wrong:
            status.level, status.message = WARN, ', '.join(wrong)
        return status

    def _totals(self) -> Any:
        self._bank.empty = self._stream.empty
        totals = super()._totals()
        totals['unpaired'] = self._stream.pairs.unpaired
        if self._stream.phases is not None:
            totals['unbalanced'] = self._stream.phases.unbalanced
        return totals
