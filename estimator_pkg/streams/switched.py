# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Systems that known events switch: the node `switched_observer`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.efforts import DrivenSettings
from estimator_pkg.driver.switched import REFUSED, SwitchedBank, SwitchedJoint
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.messages.joint_state import Decoder, Encoder
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.switched.observer import Switched
from estimator_pkg.parameters import structural
from estimator_pkg.streams.answer import ACCELERATION
from estimator_pkg.streams.contract import Answer, Output, Port
from estimator_pkg.streams.driven import DrivenStream, EffortSettings
from estimator_pkg.streams.sources import Sample

SWITCH_EVENT = Port('switch_event', JOINT_STATE, answered=False, optional=True)
DISCRETE = Output('discrete_state', JOINT_STATE, on_demand=True)


@dataclass(frozen=True)
class SwitchedSettings(EffortSettings):
    """Parameters of the node `switched_observer`, without those of its observer."""

    joints: tuple[str, ...] | None = structural(
        None,
        kind=tuple,
        description="names of the joints in the topic, in the order of the model's outputs; "
        "automatic: the model's own names",
    )

    def find_observer(self) -> type[Observer]:
        """Return the observer."""
        return Switched

    def names(self, outputs: tuple[str, ...]) -> tuple[str, ...]:
        """Return the joints; raise UsageError unless there is one per output of the model."""
        names = tuple(name for name in self.joints or () if name) or outputs
        if len(names) != len(outputs) or len(set(names)) < len(names):
            raise UsageError(
                f"parameter 'joints' must name the model's {len(outputs)} "
                f'output{"" if len(outputs) == 1 else "s"}, each once, not '
                f'{", ".join(names)}'
            )
        return names


class SwitchedStream(DrivenStream):
    """See `Stream`; ``bank.system`` is the whole system."""

    KIND = 'switched'
    NODE = 'switched_observer'
    SETTINGS = SwitchedSettings
    PER_JOINT = DrivenSettings
    OVERRIDES = False
    USUAL: ClassVar[tuple[str, ...]] = ('/joint_states', '/switch_event', '/effort_command')
    bank: SwitchedBank
    settings: SwitchedSettings

    def __init__(self, settings: SwitchedSettings, configuration: Configuration) -> None:
        gains, of_joint = configuration.for_joint('')
        system = SwitchedJoint(Switched, gains, of_joint)
        self._model, self._efforts_each = system.model, len(system.model.probe(0.0))
        bank = SwitchedBank(system, settings.names(self._model.joints), settings.input)
        accelerates = any(k > 1 for k in self._model.indices)
        super().__init__(
            settings,
            Switched,
            bank,
            bank.orders,
            events=[SWITCH_EVENT],
            outputs=[DISCRETE, *([ACCELERATION] if accelerates else [])],
        )
        self._decode_event, self._encode_discrete = Decoder().decode, Encoder().encode
        self._has_estimate = False  # the newest sample

    def answer(self, sample: Sample) -> Answer:
        """See `DrivenStream`."""
        taken = self.bank.take(sample.stamp_ns, sample.names, sample.positions, sample.efforts)
        before = self.answered
        answer = self._answering(sample.stamp_ns, sample.frame_id, taken)
        self._has_estimate = self.answered > before
        return answer

    def further(self, sample: Sample) -> Iterable[Answer]:
        """See `DrivenStream`: the discrete state."""
        if self.wanted[2] and self._has_estimate:
            z, names = self.bank.system.discrete()[0], self._model.names
            yield {2: self._encode_discrete(sample.stamp_ns, sample.frame_id, names, z)}

    def event(self, raw: bytes) -> None:
        """See `DrivenStream`."""
        event = self._decode_event(raw)
        mode = event.names[0] if event.names else ''
        self.bank.system.event(event.stamp_ns, mode, event.positions)

    # Texts

    def reset(self) -> str:
        """See `Stream`."""
        super().reset()
        return 'the system is reset'

    def describe(self) -> str:
        """See `Stream`."""
        return ', '.join(self.bank.names)

    def needed(self) -> set[str]:
        """See `Stream`."""
        return set(self.bank.names)

    def notices(self) -> list[str]:
        """See `Stream`."""
        system = self.bank.system
        refused, system.refused = system.refused, ''
        return [refused] if refused else []

    def about(self, name: str) -> Mapping[str, Any]:
        """See `Stream`: also the number of events by result."""
        counts = self.bank.system.event_counts
        return {
            **super().about(name),
            **{f'switch_events.{kind}': count for kind, count in counts.items()},
        }

    def names_of(self, name: str) -> tuple[str, ...]:
        """See `Stream`."""
        return self.bank.names

    def summary(self) -> dict[str, Any]:
        """See `Stream`."""
        return {**super().summary(), 'switch_events': dict(self.bank.system.event_counts)}

    def why(self) -> str:
        """See `Stream`."""
        if self.bank.mismatched and not self.bank.system.received:
            return (
                f'no message of {self.topics[0]} has the joints {", ".join(self.bank.names)} '
                'with the effort that the model needs'
            )
        return super().why()

    def finish(self, path: str) -> list[str]:
        """See `Stream`."""
        if self.bank.system.received == 0:
            raise UserError(f'{path}: {self.why() or "no sample arrived"}')
        warnings = []
        for kind, count in self.bank.system.event_counts.items():
            if kind in REFUSED:
                warnings.append(f'{count} switching events were not used: {kind.replace("_", " ")}')
        if not self.topics[1]:
            topic = SWITCH_EVENT.topic
            warnings.append(f'{path} has no message on /{topic}: the system never switches')
        return warnings
