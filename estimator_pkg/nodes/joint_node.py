"""The class of the node `joint_observer`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from estimator_pkg.nodes.base import ObserverNode  # first: settles what rclpy reads  # isort: skip

import std_msgs.msg
from rclpy.subscription import Subscription

from estimator_pkg import observers
from estimator_pkg.driver.bank import Bank
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.errors import UsageError
from estimator_pkg.messages.joint_state import Layout
from estimator_pkg.messages.number import decoder as number_decoder
from estimator_pkg.nodes.ros_parameters import Values
from estimator_pkg.nodes.settings import ANGLE, NodeSettings
from estimator_pkg.observers.contract import Observer

NODE_OF = {'angle_and_input': 'adaptive_observer', 'drive': 'pmsm_observer',
           'mechanical': 'mechanical_observer', 'switched': 'switched_observer'}  # by kind


class JointObserver(ObserverNode):
    """Estimates the velocity of every joint whose angle it receives.

    Parameters, errors and attributes as of `ObserverNode`.
    """

    NAME = 'joint_observer'
    SETTINGS = NodeSettings
    settings: NodeSettings
    bank: Bank

    def _find_observer(self) -> Observer:
        self.settings.check()
        found = observers.find(self.settings.observer)
        if found.kind != 'angle':
            hint = f': run the node {NODE_OF[found.kind]}' if found.kind in NODE_OF else ''
            raise UsageError(f"observer '{found.name}' does not work from an angle alone{hint}")
        return found

    def _configured(self, common: Mapping[str, Any], overrides: Mapping[str, Values]
                    ) -> Configuration:
        return super()._configured(self.settings.implied(common), overrides)

    def _make_bank(self, configuration: Configuration) -> Bank:
        self._gives_acceleration = any(
            self._observer.gives_acceleration(configuration.for_joint(joint)[0])
            for joint in ('', *configuration.overrides))
        return Bank(configuration, self.settings.only, self.settings.joints_max)

    def _connect(self) -> Subscription:
        if self._gives_acceleration:
            self._tell_acceleration()
        if self.settings.input == ANGLE:
            self._number = number_decoder(self.settings.angle_type)
            self._angle = self.settings.raw_angle.angle
            self._names = (self.settings.angle_joint,)
            return self._listen(getattr(std_msgs.msg, self.settings.angle_type), 'angle',
                                self._angle_came)
        return self._listen_to_states('joint_states', self._states_came)

    def _wanted(self) -> str:
        return ', '.join(self.settings.only) or super()._wanted()

    # Messages

    def _states_came(self, stamp_ns: int, layout: Layout, raw: bytes) -> None:
        self._answer_joints(stamp_ns, layout.frame_id,
                            self.bank.update(stamp_ns, layout.names, layout.numbers(raw, 0)))

    def _angle_came(self, raw: bytes, info: Mapping[str, Any]) -> None:
        angle = self._angle(self._number(raw))
        stamp_ns = info['source_timestamp']
        self._answer_joints(stamp_ns, '', self.bank.update(stamp_ns, self._names, (angle,)))
