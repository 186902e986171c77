# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Mechanisms with a model: the node `mechanical_observer`. Positions and inputs to velocities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from estimator_pkg import observers
from estimator_pkg.circle import Circle
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.joint import Tried
from estimator_pkg.driver.mechanism import MechanismBank, MechanismSettings, check_names, steps_of
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.messages import diagnostics
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.mechanism.gains import in_words
from estimator_pkg.observers.mechanism.parameters import default_numbers
from estimator_pkg.parameters import structural
from estimator_pkg.streams.contract import Answer, Output
from estimator_pkg.streams.driven import DrivenStream, EffortSettings
from estimator_pkg.streams.sources import Sample

GAINS = Output('gains', diagnostics.TYPE, latched=True)


@dataclass(frozen=True)
class MechanicalSettings(EffortSettings):
    """Parameters of the node `mechanical_observer`, without those of its observer."""

    observer: str = structural('geso', description='geso, hgo, ehgo or smo')
    mechanisms: tuple[str, ...] = structural(
        ('mechanism',),
        description='a name for each mechanism; per_joint.<mechanism>.<parameter> sets a parameter '
        'of one of them',
    )

    def find_observer(self) -> type[Observer]:
        """Return the observer; raise UsageError if it does not use a mechanism model."""
        found = observers.find(self.observer)
        if found.kind != MechanicalStream.KIND:
            raise UsageError(
                f"observer '{found.name}' does not use a mechanism model: choose geso, "
                'hgo, ehgo or smo'
            )
        return found


class MechanicalStream(DrivenStream):
    """See `Stream`; ``bank.joints`` are mechanisms."""

    KIND = 'mechanical'
    NODE = 'mechanical_observer'
    SETTINGS = MechanicalSettings
    PER_JOINT = MechanismSettings
    WRAPS = False  # the model defines which of its positions are angles
    KEPT = 'mechanism'
    bank: MechanismBank
    settings: MechanicalSettings

    def __init__(self, settings: MechanicalSettings, configuration: Configuration) -> None:
        bank = MechanismBank(configuration, settings.mechanisms, settings.input)
        super().__init__(settings, configuration.observer, bank, bank.orders, outputs=[GAINS])
        self._meaning: dict[str, dict[str, str]] = {}  # of the gains, by mechanism
        self._unexplained = set(bank.joints)
        self._notices = self._of_models()
        self._due = False  # True if ~/gains has new content

    def try_gains(self, configuration: Configuration) -> None:
        """See `Stream`: checks each mechanism; common values need not suit any of them."""
        check_names(configuration, self.settings.mechanisms)

    def _build(self, configuration: Configuration, joint: str) -> Tried:
        """Return what the gains of this mechanism imply ('': of one without override)."""
        settings: Any
        observer: Any = self.observer
        gains, settings = configuration.for_joint(joint)
        circle = Circle(settings.wrap_period, settings.unwrap)
        tried = Tried(steps_of(observer), gains, circle)
        inputs = tried.design.plan.mechanics.inputs
        settings.check_inputs(max(1, inputs), self._called(joint))
        return tried

    def answer(self, sample: Sample) -> Answer:
        """See `DrivenStream`."""
        taken = self.bank.update(sample.stamp_ns, sample.names, sample.positions, sample.efforts)
        answer = self._answering(sample.stamp_ns, sample.frame_id, taken)
        self._explain()
        if self._due:
            self._due = False
            answer[2] = diagnostics.encode(
                sample.stamp_ns,
                [
                    diagnostics.Status(
                        diagnostics.OK, name, name, self.observer.name, diagnostics.packed(words)
                    )
                    for name, words in self._meaning.items()
                ],
            )
        return answer

    def _explain(self) -> None:
        """Describe the effect of new gains at the measured rate."""
        if not self._unexplained:
            return
        new = [name for name in self._unexplained if self.bank.joints[name].mean_dt > 0.0]
        for name in new:
            mechanism = self.bank.joints[name]
            self._meaning[name] = in_words(mechanism.plan.describe(mechanism.mean_dt))
        self._unexplained.difference_update(new)
        self._due = self._due or bool(new)

    def _gains_changed(self, name: str) -> None:
        self._unexplained.add(name)

    def _of_models(self) -> list[str]:
        """Return a notice for each mechanism whose model has the default parameters."""
        found = []
        for name in self.bank.joints:
            gains = self.bank.configuration.for_joint(name)[0]
            numbers = default_numbers(gains)
            if not numbers:
                continue
            found.append(
                f"mechanism '{name}' has the default model_parameters of {gains.model} "
                f"({numbers}): set your own; 'velocity_estimator identify' estimates them "
                'from a recording'
            )
        return found

    def describe(self) -> str:
        """See `Stream`."""
        return ', '.join(
            joint for mechanism in self.bank.joints.values() for joint in mechanism.names
        )

    def needed(self) -> set[str]:
        """See `Stream`."""
        return {joint for mechanism in self.bank.joints.values() for joint in mechanism.names}

    def about(self, name: str) -> Mapping[str, Any]:
        """See `Stream`: also stamps without a joint, and the effect of the gains."""
        self._explain()
        return {
            **super().about(name),
            'incomplete': self.bank.joints[name].incomplete,
            **self._meaning.get(name, {}),
        }

    def names_of(self, name: str) -> tuple[str, ...]:
        """See `Stream`."""
        return self.bank.joints[name].names

    def _summary_of(self, name: str, joint: Any) -> dict[str, Any]:
        return {**super()._summary_of(name, joint), 'incomplete': joint.incomplete}

    def finish(self, path: str) -> list[str]:
        """See `Stream`: raises if a mechanism never got all joints (wrong names)."""
        for mechanism in self.bank.joints.values():
            if mechanism.received == 0:
                why = mechanism.why_silent()
                raise UserError(
                    f"topic '{self.topics[0]}' of {path} never has all joints of "
                    f"mechanism '{mechanism.name}' ({', '.join(mechanism.names)}) at one time: "
                    + (f'{why}; if they have other names, ' if why else '')
                    + "set its joint names with the parameter 'joints'"
                )
        return self.notices()
