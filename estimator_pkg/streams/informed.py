# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Single angles with further sensors: the node `joint_observer` with `sources`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from estimator_pkg import observers
from estimator_pkg.driver.bank import Bank
from estimator_pkg.driver.configuration import AS_ACCELERATION, Configuration, SourceSettings
from estimator_pkg.driver.fused import FusedJoint
from estimator_pkg.errors import UsageError
from estimator_pkg.messages.block import Block
from estimator_pkg.messages.field import Field
from estimator_pkg.streams.angle import AngleSettings, AngleStream
from estimator_pkg.streams.contract import PUBLISHER, Answer, Answers, Port


class InformedBank(Bank):
    """Joints with the sources that inform them."""

    sources: Mapping[str, SourceSettings]

    def of_joint(self, joint: str) -> list[tuple[int, str, SourceSettings]]:
        """Return (number, name, settings) of each source of a joint."""
        return [
            (number, name, source)
            for number, (name, source) in enumerate(self.sources.items())
            if source.joint in ('', joint)
        ]

    def _make(self, name: str) -> Any:
        return FusedJoint(
            self.configuration.observer, *self.configuration.for_joint(name), self.of_joint(name)
        )


class InformedStream(AngleStream):
    """See `Stream`."""

    def __init__(self, settings: AngleSettings, configuration: Configuration) -> None:
        self._sources: Mapping[str, SourceSettings] = {
            name.split('.', 1)[1]: source for name, source in settings.groups.items()
        }
        if not hasattr(configuration.observer, 'inform'):
            able = ', '.join(
                name
                for name in observers.of_kind('angle')
                if hasattr(observers.find(name), 'inform')
            )
            raise UsageError(
                f"'sources': observer '{configuration.observer.name}' takes no other sensor: use "
                f'one of {able}'
            )
        for name, source in self._sources.items():
            if source.kind == AS_ACCELERATION and source.ratio == 0.0:
                raise UsageError(
                    f"'source.{name}.ratio' of an acceleration is not learnt: set it (1.0 for one "
                    'in rad/s^2)'
                )
        super().__init__(settings, configuration)
        self._fields: list[Field] = []

    def _bank(self, settings: AngleSettings, configuration: Configuration) -> Bank:
        bank = InformedBank(configuration, settings.only)
        bank.sources = self._sources
        return bank

    def _others(self) -> list[Port]:
        return [
            Port(
                source.topic or name,
                source.field_type,
                answered=False,
                optional=True,
                field=source.field,
            )
            for name, source in self._sources.items()
        ]

    def read_field(self, field: Field, port: int = 0) -> None:
        """See `Stream`."""
        if port == 0:
            super().read_field(field)
        else:
            self._fields.append(field)

    def take(self, port: int, raw: bytes, publish_ns: int) -> Sequence[Answer]:
        """See `Stream`."""
        if port == 0:
            return super().take(port, raw, publish_ns)
        stamp_ns, _, value = self._fields[port - 1].decode(raw)
        if stamp_ns is None or self.settings.stamp_source == PUBLISHER:
            stamp_ns = publish_ns
        if value is not None:
            for joint in self.bank.joints.values():
                joint.receive(port - 1, stamp_ns, value)
        return ()

    def feed_block(self, ports: Sequence[int], block: Block) -> Iterable[Answers] | None:
        """See `Stream`: messages of several topics are taken one by one."""
        return None

    def about(self, name: str) -> Mapping[str, Any]:
        """See `Stream`."""
        sensors = self.bank.joints[name].sensors.values()
        return {**super().about(name), **{f'source {each.name}': each.text() for each in sensors}}

    def notices(self) -> list[str]:
        """See `Stream`."""
        found = super().notices()
        for name, joint in self.bank.joints.items():
            for sensor in joint.sensors.values():
                found += [f'{name}: {notice}' for notice in sensor.notices]
                sensor.notices.clear()
        return found
