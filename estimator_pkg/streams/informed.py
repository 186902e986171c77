# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Single angles with further sensors: the node `joint_observer` with `sources`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from estimator_pkg.driver.bank import Bank
from estimator_pkg.driver.configuration import Configuration, SourceSettings
from estimator_pkg.driver.fused import FusedJoint
from estimator_pkg.errors import UsageError
from estimator_pkg.messages.block import Block
from estimator_pkg.messages.field import Field
from estimator_pkg.streams.angle import AngleSettings, AngleStream
from estimator_pkg.streams.contract import PUBLISHER, Answer, Answers, Port


class InformedBank(Bank):
    """Joints with the sources that inform them."""

    sources: Mapping[str, SourceSettings]

    def _make(self, name: str) -> Any:
        own = [
            (number, source, settings)
            for number, (source, settings) in enumerate(self.sources.items())
            if settings.joint in ('', name)
        ]
        return FusedJoint(
            self.configuration.observer, *self.configuration.for_joint(name), sources=own
        )


class InformedStream(AngleStream):
    """See `Stream`."""

    NAMED_IN = "'joints' and 'source.<name>.joint'"
    bank: InformedBank

    def __init__(self, settings: AngleSettings, configuration: Configuration) -> None:
        self._sources: Mapping[str, SourceSettings] = {
            name.partition('.')[2]: source for name, source in settings.groups.items()
        }
        for name, source in self._sources.items():
            if source.ratio == 0.0:
                raise UsageError(f"'source.{name}.ratio' is 0: set it ('doctor' finds it in a bag)")
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

    # Texts

    def needed(self) -> set[str]:
        """See `Stream`."""
        return super().needed() | self._named()

    def _named(self) -> set[str]:
        """Return the joints that sources name."""
        return {each.joint for each in self._sources.values() if each.joint}

    def about(self, name: str) -> Mapping[str, Any]:
        """See `Stream`."""
        sources = self.bank.joints[name].sources.values()
        return {**super().about(name), **{f'source {each.name}': each.text() for each in sources}}

    def notices(self) -> list[str]:
        """See `Stream`."""
        found = super().notices()
        for name, joint in self.bank.joints.items():
            for source in joint.sources.values():
                found += [f'{name}: {notice}' for notice in source.notices]
                source.notices.clear()
        return found

    def finish(self, path: str) -> list[str]:
        """See `Stream`; joints of the sources must exist."""
        self.require(path, sorted(self._named()), self.bank.joints)
        return super().finish(path)
