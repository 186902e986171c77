# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Drives without an encoder: the node `pmsm_observer`. Currents and voltages to speed and flux."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from estimator_pkg import observers
from estimator_pkg.driver.bank import Rows, taken
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.drive import DriveEstimates, DriveJoint
from estimator_pkg.driver.joint import Joint
from estimator_pkg.driver.pairs import CURRENT, VOLTAGE, AlphaBeta, CurrentsAndVoltages, Phases
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.messages import drive_samples, vector3
from estimator_pkg.observers.contract import Observer
from estimator_pkg.parameters import structural
from estimator_pkg.sensor.guard import DUPLICATE
from estimator_pkg.streams.answer import Answering
from estimator_pkg.streams.contract import (
    ESTIMATE,
    STDDEV,
    Answer,
    Output,
    Port,
    Request,
    Stream,
    StreamSettings,
)
from estimator_pkg.streams.history import History

DRIVE_SAMPLES, CURRENT_VOLTAGE = 'drive_samples', 'current_voltage'
ALPHA_BETA, ABC = 'alpha_beta', 'abc'
ELECTRICAL = '_electrical'  # suffix of the joint's name
FLUX = Output('flux_linkage', vector3.TYPE, on_demand=True)
SAMPLES = Output('estimate_samples', drive_samples.TYPE)
PORTS = {
    DRIVE_SAMPLES: (Port('drive_samples', drive_samples.TYPE),),
    CURRENT_VOLTAGE: (Port('current', vector3.TYPE), Port('voltage', vector3.TYPE)),
}


@dataclass(frozen=True)
class DriveSettings(StreamSettings):
    """Parameters of the node `pmsm_observer`, without those of its observer."""

    observer: str = structural('pmsm', description='observer of a drive')
    joint: str = structural(
        'motor',
        description='name of the joint: mechanical speed and relative position have this name, '
        'electrical quantities this name and _electrical',
    )
    input: str = structural(
        DRIVE_SAMPLES,
        choices=(DRIVE_SAMPLES, CURRENT_VOLTAGE),
        description='input: batches (drive_samples, std_msgs/Float64MultiArray), or the '
        'topics current and voltage (geometry_msgs/Vector3Stamped) paired by stamp',
    )
    sample_period: float = structural(
        0.0,
        unit='s',
        range=(0.0, 0.1),
        description='time between two rows of a batch; other stamps are refused. 0: taken from '
        'the stamps',
    )
    frame: str = structural(
        ALPHA_BETA,
        choices=(ALPHA_BETA, ABC),
        description='current and voltage: x alpha and y beta; or x, y, z the phases a, b, c of a '
        'star without neutral',
    )
    pair_tolerance: float = structural(
        2e-5,
        unit='s',
        range=(0.0, 1.0),
        description='largest difference of the stamps of a pair of current and voltage',
    )
    sum_tolerance: float = structural(
        0.1,
        range=(0.0, 10.0),
        description='allowed sum of the phase currents over the recent largest one; currents '
        'beyond it are not used',
    )

    def find_observer(self) -> type[Observer]:
        """Return the observer; raise UsageError if it is no drive observer, or without a joint."""
        if not self.joint:
            raise UsageError("parameter 'joint' must not be empty: set a name")
        found = observers.find(self.observer)
        if found.kind != DriveStream.KIND:
            raise UsageError(
                f"observer '{found.name}' does not use currents and voltages: choose pmsm"
            )
        return found


class Motor:
    """The one joint of a drive, with the interface of `Joints`."""

    only: frozenset[str] = frozenset()
    mismatched = refused = expired = 0

    def __init__(self, name: str, joint: DriveJoint, configuration: Configuration) -> None:
        self.joints: Mapping[str, Joint] = {name: joint}
        self._joint = joint
        self.configuration = configuration
        self.empty = 0  # batches without a row

    def warm_up(self) -> None:
        """Prepare everything that the first sample needs."""
        self._joint.warm_up()

    def why_silent(self, name: str) -> str:
        """Return '': the stream knows the reason."""
        return ''


class DriveStream(Stream):
    """See `Stream`.

    Attributes
    ----------
    joint : the motor. names : names of its mechanical and its electrical joint.
    """

    KIND = 'drive'
    NODE = 'pmsm_observer'
    SETTINGS = DriveSettings
    OVERRIDES = False
    WRAPS = False
    USUAL: ClassVar[tuple[str, ...]] = ('/drive_samples', '/current', '/voltage')
    UNUSED: ClassVar[Mapping[str, str]] = {
        'empty': 'have no row and are dropped: publish at least one sample in each'
    }
    settings: DriveSettings
    bank: Motor

    def __init__(self, settings: DriveSettings, configuration: Configuration) -> None:
        batches = settings.input == DRIVE_SAMPLES
        gains, of_joint = configuration.for_joint(settings.joint)
        self.joint = DriveJoint(
            configuration.observer, gains, of_joint, sample_period=settings.sample_period
        )
        self.phases = (
            Phases(settings.sum_tolerance) if settings.frame == ABC and not batches else None
        )
        self.pairs = CurrentsAndVoltages(round(settings.pair_tolerance * 1e9))
        self.names = (settings.joint, settings.joint + ELECTRICAL)
        super().__init__(
            settings,
            configuration.observer,
            Motor(settings.joint, self.joint, configuration),
            PORTS[settings.input],
            [ESTIMATE, STDDEV, FLUX, *([SAMPLES] if batches else [])],
        )
        self._answering, self._rows = Answering(self), Rows([(self.joint, 0), (self.joint, 1)])

    # Messages

    def take(self, port: int, raw: bytes, publish_ns: int) -> Sequence[Answer]:
        """See `Stream`."""
        if self.settings.input == DRIVE_SAMPLES:
            return (self._batch(raw),)
        return self._vector((CURRENT, VOLTAGE)[port], raw)

    def _batch(self, raw: bytes) -> Answer:
        """Answer a batch of samples; the newest estimate first, for controllers that wait."""
        batch = drive_samples.decode(raw)
        stamps, samples = batch
        if not len(stamps):
            self.bank.empty += 1
            return {}
        out = self.joint.take(stamps, samples)
        rows = out.rows[:, :4]
        rows[np.isnan(rows[:, 3]), 3] = 0.0
        answer = self._answer(self.joint.stamp_ns, '', self._used(stamps, out))
        if self.wanted[3]:
            answer[3] = drive_samples.encode(stamps, rows)
        return answer

    def _vector(self, kind: int, raw: bytes) -> list[Answer]:
        """Return the answer to the pair that a current [A] or a voltage [V] completes."""
        message = vector3.decode(raw)
        vector: AlphaBeta | None = message.x, message.y
        if self.phases is not None:
            turn = self.phases.current if kind == CURRENT else self.phases.voltage
            vector = turn(message.x, message.y, message.z)
        pair = vector and self.pairs.take(kind, message.stamp_ns, vector)
        if not pair:
            return []
        stamp_ns, sample = pair
        stamps = np.array([stamp_ns])
        out = self.joint.take(stamps, np.array([sample]))
        return [self._answer(stamp_ns, message.frame_id, self._used(stamps, out))]

    def _used(self, stamps: Any, out: DriveEstimates) -> bool:
        """Return True if any sample was used; count the time by status."""
        if self.history is not None:
            self.history.setdefault(self.names[0], History()).add(stamps, out.status, out.verdict)
        return bool((out.verdict < DUPLICATE).any())

    def _answer(self, stamp_ns: int, frame_id: str, used: bool) -> Answer:
        """The messages for the newest estimate; none where no sample was `used`."""
        if not used:
            return {}
        joint = self.joint
        nothing = (math.nan,) * 2  # no position is measured
        made = taken(self.names, joint.estimates(), (), self._rows, nothing)
        answer = self._answering(stamp_ns, frame_id, made)
        if self.wanted[2]:
            flux, deviation = joint.electrical()[2], joint.electrical_stddev()[2]
            answer[2] = vector3.encode(stamp_ns, frame_id, flux, deviation)
        return answer

    def _note(self, history: dict[str, History]) -> None:
        """Do nothing: `_used` counts the many samples of a message."""

    # Texts

    def reset(self) -> str:
        """See `Stream`."""
        super().reset()
        return f'{self.names[0]} is reset'

    def describe(self) -> str:
        """See `Stream`."""
        return f"'{self.names[0]}'"

    def needed(self) -> set[str]:
        """See `Stream`: currents and voltages have no names."""
        return set()

    def names_of(self, name: str) -> tuple[str, ...]:
        """See `Stream`."""
        return self.names

    def always_awake(self, name: str) -> bool:
        """See `Stream`: stamps that contradict the sample period are why no sample is used."""
        return bool(self.joint.misfit)

    def unused(self) -> dict[str, int]:
        """See `Stream`."""
        return {
            'empty': self.bank.empty,
            'unpaired': self.pairs.unpaired,
            'unbalanced': self.phases.unbalanced if self.phases is not None else 0,
        }

    def why_silent(self, name: str = '') -> str:
        """See `Stream`."""
        pairs, received, malformed = self.pairs, sum(self.received), sum(self.malformed)
        if malformed and malformed == received:
            return f'every message is malformed: {self.complaint[1]}'
        unbalanced = self._why_unbalanced()
        if unbalanced:
            return unbalanced
        if pairs.nearest_ns is not None:
            return (
                f'currents and voltages do not pair: their stamps differ by at least '
                f'{pairs.nearest_ns * 1e-9:g} s: increase pair_tolerance'
            )
        if received and not pairs.paired and not self.joint.received and not malformed:
            return 'only one of current and voltage arrives: check both topics'
        return ''

    def _why_unbalanced(self) -> str:
        """Return a note if most currents are not three phases without a neutral, else ''."""
        phases = self.phases
        if phases is None or phases.unbalanced <= self.pairs.paired:
            return ''
        return (
            f'the phase currents do not sum to zero (up to {100.0 * phases.worst:.0f} % of the '
            'largest): check for a neutral conductor, and that there are three phases'
        )

    def why(self) -> str:
        """See `Stream`."""
        return super().why() or self.why_silent()

    def _summary_of(self, name: str, joint: Joint) -> dict[str, Any]:
        found = super()._summary_of(name, joint)
        found['why'] = (
            self._why_unbalanced() or found['why'] or ('' if found['used'] else self.why_silent())
        )
        return found

    def finish(self, path: str) -> list[str]:
        """See `Stream`."""
        if not sum(self.received):
            raise UserError(f'{path} has no messages on {" and ".join(self.topics)}')
        return []

    # Bags

    @classmethod
    def recognises(cls, has: Callable[[str], bool], joints: bool) -> bool:
        """See `Stream`."""
        return not joints and any(
            all(has(port.in_bag) for port in ports) for ports in PORTS.values()
        )

    @classmethod
    def requested(
        cls, values: dict[str, Any], request: Request, has: Callable[[str], bool]
    ) -> dict[str, Any]:
        """See `Stream`."""
        if request.angle:
            raise UsageError('--angle is for observers of an angle, not for drives: omit it')
        if request.joints:
            if len(request.joints) > 1:
                raise UsageError('a drive has one joint: give --joint once')
            values['joint'] = request.joints[0]
        if 'input' not in values and not request.measurement:
            batches, *_ = PORTS[DRIVE_SAMPLES]
            if not has(f'/{batches.topic}') and all(
                has(port.in_bag) for port in PORTS[CURRENT_VOLTAGE]
            ):
                values['input'] = CURRENT_VOLTAGE
        return values
