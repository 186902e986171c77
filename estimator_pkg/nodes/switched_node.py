"""The class of the node `switched_observer`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from estimator_pkg.nodes.driven import DrivenNode  # first: settles what rclpy reads  # isort: skip

from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState

from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.efforts import DrivenSettings
from estimator_pkg.driver.switched_joint import REFUSED, SwitchedBank, SwitchedJoint
from estimator_pkg.messages.joint_state import Decoder, Encoder, Layout
from estimator_pkg.models.switched import load
from estimator_pkg.nodes.switched_settings import SwitchedNodeSettings
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.switched import OBSERVER


class SwitchedObserver(DrivenNode):
    """Estimates the velocities of a system that known events switch, and its discrete state.

    Parameters, errors and attributes as of `ObserverNode`; ``bank`` holds the system.
    """

    NAME = 'switched_observer'
    SETTINGS = SwitchedNodeSettings
    PER_JOINT = DrivenSettings
    OVERRIDES = False
    settings: SwitchedNodeSettings
    bank: SwitchedBank

    def _find_observer(self) -> Observer:
        return OBSERVER

    def _make_bank(self, configuration: Configuration) -> SwitchedBank:
        gains, settings = configuration.for_joint('')
        self._model = load(gains.model)
        return SwitchedBank(SwitchedJoint(OBSERVER, gains, settings),
                            self.settings.names(self._model), self.settings.input)

    def _connect(self) -> Subscription:
        self._discrete = self._endpoints.publisher(JointState, '~/discrete_state')
        self._encode_discrete, self._decode_event = Encoder().encode, Decoder().decode
        if any(k > 1 for k in self._model.indices):
            self._tell_acceleration()
        states = self._connect_states(self._states_came)
        # best effort too, so that every publisher of events matches
        self._listen(JointState, 'switch_event', self._event_came, answered=False, qos=QoSProfile(
            depth=50, reliability=ReliabilityPolicy.BEST_EFFORT))
        return states

    def _orders(self) -> Sequence[Sequence[str]]:
        return self.bank.orders

    def _wanted(self) -> str:
        return ', '.join(self.bank.names)

    def _restarted(self) -> str:
        return 'the system starts'

    # Messages

    def _states_came(self, stamp_ns: int, layout: Layout, raw: bytes) -> None:
        pairs = self.bank.take(stamp_ns, layout.names, layout.numbers(raw, 0),
                               layout.numbers(raw, 2))
        names = self.bank.names if pairs else ()
        self._answer(stamp_ns, layout.frame_id, names, pairs,
                     lambda: self.bank.deviations() if pairs else [])
        if pairs:
            z, _, _ = self.bank.system.discrete()
            self._discrete.publish(self._encode_discrete(
                stamp_ns, layout.frame_id, self._model.names, z))

    def _event_came(self, raw: bytes, info: Mapping[str, Any]) -> None:
        event = self._decode_event(raw)
        mode = event.names[0] if event.names else ''
        said = self.bank.system.event(event.stamp_ns, mode, event.positions)
        if said in REFUSED:
            words = said.replace('_', ' ')
            self.get_logger().warning(f"the event '{mode}' is not used: {words}")
