"""The class of the node `pmsm_observer`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from estimator_pkg.nodes.base import ObserverNode  # first: settles what rclpy reads  # isort: skip

from geometry_msgs.msg import Vector3Stamped
from rclpy.subscription import Subscription
from std_msgs.msg import Float64MultiArray

from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.drive_stream import Answer, DriveStream
from estimator_pkg.nodes.pmsm_health import PmsmHealth
from estimator_pkg.nodes.pmsm_settings import DRIVE_SAMPLES, PmsmSettings
from estimator_pkg.observers.contract import Observer


class PmsmObserver(ObserverNode):
    """Estimates speed, angle and flux of a motor from its currents and voltages.

    Parameters, errors and attributes as of `ObserverNode`; ``bank`` is the motor behind its topics.
    """

    NAME = 'pmsm_observer'
    SETTINGS = PmsmSettings
    OVERRIDES = False
    HEALTH = PmsmHealth
    settings: PmsmSettings
    bank: DriveStream

    def _find_observer(self) -> Observer:
        self.settings.check()
        return self.settings.find()

    def _make_bank(self, configuration: Configuration) -> DriveStream:
        return self.settings.stream(configuration)

    def _connect(self) -> Subscription:
        self._flux = self._endpoints.on_demand(Vector3Stamped, '~/flux_linkage')
        if self.settings.input == DRIVE_SAMPLES:
            self._samples = self._endpoints.publisher(Float64MultiArray, '~/estimate_samples')
            return self._listen(Float64MultiArray, 'drive_samples', self._batch_came)
        current = self._listen(Vector3Stamped, 'current', self._vectors(self.bank.current))
        self._listen(Vector3Stamped, 'voltage', self._vectors(self.bank.voltage))
        return current

    def _wanted(self) -> str:
        return f"'{self.settings.joint}'{' (compiled)' if self.bank.joint.fast else ''}"

    def _restarted(self) -> str:
        return f'{self.settings.joint} starts'

    def _gains_changed(self, name: str) -> None:
        self.bank.joint.warm_up()

    # Messages

    def _batch_came(self, raw: bytes, info: Mapping[str, Any]) -> None:
        answer = self.bank.batch(raw)
        self._publish(answer)  # first: a controller may wait for the newest estimate
        if answer.samples is not None:
            self._samples.publish(answer.samples)

    def _vectors(self, take: Callable[[bytes], list[Answer]]) -> Any:
        def came(raw: bytes, info: Mapping[str, Any]) -> None:
            for answer in take(raw):
                self._publish(answer)
        return came

    def _publish(self, answer: Answer) -> None:
        self._estimate.publish(answer.estimate)
        if answer.stddev is not None:
            self._stddev.publish(answer.stddev)
        if answer.flux is not None:
            self._flux.publish(answer.flux)

    def _look(self) -> None:
        self.bank.stddev_wanted = self._stddev.wanted
        self.bank.flux_wanted = self._flux.wanted
