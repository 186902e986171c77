"""How `pmsm_observer` is: as of joints, and what only currents and voltages can be wrong in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from rclpy.node import Node
from rclpy.subscription import Subscription

from estimator_pkg.driver.drive_stream import DriveStream
from estimator_pkg.driver.joint import Joint
from estimator_pkg.nodes.endpoints import Endpoints
from estimator_pkg.nodes.health import Health, WatchedBank
from estimator_pkg.nodes.ros_parameters import RosParameters


class PmsmHealth(Health):
    """Adds to `Health` why no sample comes of the messages.

    Parameters
    ----------
    stream : the motor behind its topics.
    """

    NO_STAMP = 'every sample needs its own'
    WRONG: ClassVar[Mapping[str, str]] = {
        **Health.WRONG, 'unpaired': 'currents or voltages without their partner',
        'unbalanced': 'currents whose phases do not sum to zero'}

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

    def _totals(self) -> Any:
        self._bank.empty = self._stream.empty
        totals = super()._totals()
        totals['unpaired'] = self._stream.pairs.unpaired
        if self._stream.phases is not None:
            totals['unbalanced'] = self._stream.phases.unbalanced
        return totals
