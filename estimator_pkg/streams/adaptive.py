# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Joints with unknown parameters: the node `adaptive_observer`, which also identifies them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from estimator_pkg.driver import identified as adaptive_file
from estimator_pkg.driver.adaptive import AdaptiveBank, AdaptiveConfiguration
from estimator_pkg.driver.efforts import EFFORT_COMMAND, NO_EFFORT, DrivenSettings
from estimator_pkg.driver.identified import values_of
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.messages import diagnostics
from estimator_pkg.observers.adaptive.observer import Adaptive
from estimator_pkg.observers.contract import Observer
from estimator_pkg.parameters import structural
from estimator_pkg.streams.contract import (
    Action,
    Answer,
    JointsSettings,
    Output,
    Reply,
    Request,
    Values,
)
from estimator_pkg.streams.driven import ARRAY, DrivenStream, EffortSettings
from estimator_pkg.streams.sources import Sample

IDENTIFIED = Output('identified_parameters', diagnostics.TYPE, on_demand=True)
PERIOD = 100_000_000  # time between two messages of it, by the measurement's stamps [ns]


@dataclass(frozen=True)
class AdaptiveSettings(JointsSettings, EffortSettings):
    """Parameters of the node `adaptive_observer` as a whole."""

    parameters_file: str = structural(
        '',
        description='file to which ~/save writes the identified parameters, also those of a joint '
        'that expires; read at start if it exists. With adapt: false the node starts frozen with '
        'them',
    )

    def find_observer(self) -> type[Observer]:
        """Return the observer; raise UsageError for inconsistent settings."""
        if self.input == EFFORT_COMMAND and self.effort_command_type == ARRAY and not self.only:
            raise UsageError(
                "effort_command_type 'Float64MultiArray' contains no names: set 'joints' "
                'to the joints in its order'
            )
        folder = Path(self.parameters_file).parent
        if not folder.is_dir():
            raise UsageError(
                f"parameters_file '{self.parameters_file}': the folder {folder} does not exist"
            )
        return Adaptive


class AdaptiveStream(DrivenStream):
    """See `Stream`."""

    KIND = 'angle_and_input'
    NODE = 'adaptive_observer'
    SETTINGS = AdaptiveSettings
    PER_JOINT = DrivenSettings
    SEPARATE = True
    UNUSED: ClassVar[Mapping[str, str]] = {
        **DrivenStream.UNUSED,
        'without_effort': f'have no effort and are dropped: {NO_EFFORT}',
    }
    bank: AdaptiveBank
    settings: AdaptiveSettings

    def __init__(self, settings: AdaptiveSettings, configuration: AdaptiveConfiguration) -> None:
        bank = AdaptiveBank(configuration, settings.only, settings.input)
        super().__init__(
            settings, configuration.observer, bank, [settings.only], outputs=[IDENTIFIED]
        )
        self._saved = configuration.saved
        self._reported_ns = 0
        self._seen: set[str] = set()

    @classmethod
    def configure(
        cls,
        observer: type[Observer],
        settings: AdaptiveSettings | None,
        common: Values,
        overrides: Mapping[str, Values],
    ) -> AdaptiveConfiguration:
        """See `Stream`; joints start with the parameters saved in ``parameters_file``."""
        path = settings.parameters_file if settings else ''
        saved = adaptive_file.load(path) if path and Path(path).exists() else {}
        return AdaptiveConfiguration(Adaptive, common, overrides, saved)

    def answer(self, sample: Sample) -> Answer:
        """See `DrivenStream`."""
        self._seen.update(sample.names)
        taken = self.bank.take(sample.stamp_ns, sample.names, sample.positions, sample.efforts)
        return self._answering(sample.stamp_ns, sample.frame_id, taken)

    def further(self, sample: Sample) -> Iterable[Answer]:
        """See `DrivenStream`: at 10 Hz the identified parameters."""
        if abs(sample.stamp_ns - self._reported_ns) >= PERIOD and self.bank.joints:
            self._reported_ns = sample.stamp_ns
            if self.wanted[2]:
                yield {2: diagnostics.encode(sample.stamp_ns, self._identified())}

    def _identified(self) -> list[diagnostics.Status]:
        return [
            diagnostics.Status(
                diagnostics.OK if report.trusted else diagnostics.WARN,
                name,
                name,
                f'{report.phase}: {report.reason}',
                diagnostics.packed(values_of(report, self.bank.unit(name))),
            )
            for name, report in self.bank.reports().items()
        ]

    def expire(self, names: Sequence[str]) -> bool:
        """See `Stream`; with a file, identified parameters are saved first."""
        path, reports = self.settings.parameters_file, self.bank.reports()
        if path and any(name in reports and reports[name].adapted for name in names):
            try:
                adaptive_file.save(path, self.bank)
                self._saved.update(adaptive_file.load(path))  # in case one appears again
            except UserError as error:
                self._notices.append(f'joints do not expire: {error}')
                return False
        return super().expire(names)

    # Actions

    def actions(self) -> Sequence[Action]:
        """See `Stream`."""
        return (Action('save', False, self._save), Action('freeze', True, self._freeze))

    def _freeze(self, hold: bool) -> Reply:
        return Reply(True, 'held' if hold else 'adapting', {'adapt': not hold})

    def _save(self, _: bool) -> Reply:
        path = self.settings.parameters_file
        try:
            if not path:
                raise UserError("parameter 'parameters_file' is not set: set it to a file")
            return Reply(True, f'{", ".join(adaptive_file.save(path, self.bank))}: {path}')
        except UserError as error:
            return Reply(False, str(error))

    # Texts

    def unused(self) -> dict[str, int]:
        """See `Stream`."""
        bank = self.bank
        return {
            'empty': bank.empty,
            'mismatched': bank.mismatched - bank.without_input,
            'without_effort': bank.without_input,
        }

    def _summary_of(self, name: str, joint: Any) -> dict[str, Any]:
        report = self.bank.reports().get(name)
        return {
            **super()._summary_of(name, joint),
            **({'identified': values_of(report, self.bank.unit(name))} if report else {}),
        }

    def why(self) -> str:
        """See `Stream`."""
        if self.bank.without_input and not self.bank.joints:
            return (
                f'{self.topics[0]} has no effort, which the observer needs as input of the model: '
                f'{NO_EFFORT}'
            )
        joints: dict[str, list[str]] = {}
        for name, report in self.bank.reports().items():
            joints.setdefault(f'{report.phase}: {report.reason}', []).append(name)
        return (
            '; '.join(f'{", ".join(names)}: {said}' for said, names in joints.items())
            or super().why()
        )

    def finish(self, path: str) -> list[str]:
        """See `Stream`."""
        if self._seen:
            self.require(path, self.settings.only, self._seen)
        return []

    @classmethod
    def requested(
        cls, values: dict[str, Any], request: Request, has: Callable[[str], bool]
    ) -> dict[str, Any]:
        """See `Stream`."""
        if request.joints:
            values['joints'] = list(request.joints)
        return super().requested(values, request._replace(joints=()), has)
