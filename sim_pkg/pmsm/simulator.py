# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulator ``pmsm``: a motor in its drive; it publishes currents, voltages and truth."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UsageError
from estimator_pkg.messages import drive_samples, vector3
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.observers.maths.clarke import phases
from estimator_pkg.parameters import structural
from estimator_pkg.streams.drive import ELECTRICAL
from sim_pkg.chunks import JointStates, in_order, sizes
from sim_pkg.contract import Message, Simulator, Topic, diverged
from sim_pkg.joints.sensor import random_stream
from sim_pkg.pmsm.drive import Drive
from sim_pkg.pmsm.parameters import PmsmParameters

BATCHES, SINGLE = 'batches', 'single'
SAMPLES = Topic('drive_samples', drive_samples.TYPE)
CURRENT = Topic('current', vector3.TYPE)
VOLTAGE = Topic('voltage', vector3.TYPE)
TRUTH = Topic('ground_truth/joint_states', JOINT_STATE, truth=True)
TRUE_FLUX = Topic('ground_truth/flux_linkage', vector3.TYPE, truth=True)
TRUE_SAMPLES = Topic('ground_truth/samples', drive_samples.TYPE, truth=True)

AHEAD = 0.01  # simulated time per chunk for single samples [s]
HELD = 1.5  # delay of an overtaken batch, in batches
SECOND = 1e9
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PmsmSimulatorParameters(PmsmParameters):
    """The parameters of the simulator: the drive, and what it publishes."""

    joint: str = structural(
        'motor',
        description='name of the joint in the truth; the name with _electrical has the electrical '
        'quantities',
    )
    publish: str = structural(
        BATCHES,
        choices=(BATCHES, SINGLE),
        description='batches: drive_samples; single: one message per sample on current and voltage',
    )
    batch: int = structural(200, unit='samples', range=(1, 100000), description='samples per batch')
    publish_rate: float = structural(
        0.0,
        unit='Hz',
        range=(0.0, 200000.0),
        description='published samples per second; sample_rate must be an integer multiple of it. '
        'Current at the stamp, mean voltage since the previous one; 0: every sample',
    )
    phase_values: bool = structural(
        False, description='current and voltage carry the phases a, b, c instead of alpha and beta'
    )
    true_samples: bool = structural(
        True,
        description='with batches: publish electrical angle, speed and flux of every sample on '
        'ground_truth/samples',
    )
    lost: float = structural(
        0.0, range=(0.0, 1.0), description='fraction of batches that never arrive'
    )
    repeated: float = structural(
        0.0, range=(0.0, 1.0), description='fraction of batches that arrive twice'
    )
    overtaken: float = structural(
        0.0, range=(0.0, 1.0), description='fraction of batches that arrive after the next one'
    )

    def __post_init__(self) -> None:
        """Check what a range cannot express; raise UsageError."""
        super().__post_init__()
        if not self.joint:
            raise UsageError("parameter 'joint' must not be empty: set a joint name")
        if self.publish_rate and abs(self.sample_rate / self.publish_rate - self.every) > 1e-6:
            raise UsageError(
                f'publish_rate = {self.publish_rate:g} Hz does not divide '
                f'sample_rate = {self.sample_rate:g} Hz: choose a rate that does'
            )
        if self.phase_values and self.publish == BATCHES:
            raise UsageError(
                "phase_values = true with publish = 'batches', which carry alpha and beta: set "
                "publish to 'single'"
            )

    @property
    def every(self) -> int:
        """Samples of the drive per published one."""
        if not self.publish_rate:
            return 1
        return max(1, round(self.sample_rate / self.publish_rate))


def topics(parameters: PmsmSimulatorParameters) -> tuple[Topic, ...]:
    """Return the topics: measurement and truth."""
    if parameters.publish == SINGLE:
        return CURRENT, VOLTAGE, TRUTH, TRUE_FLUX
    if parameters.true_samples:
        return SAMPLES, TRUTH, TRUE_FLUX, TRUE_SAMPLES
    return SAMPLES, TRUTH, TRUE_FLUX


class Rows(NamedTuple):
    """Published rows, shape (n,) each; `values` and `true` as in `drive_samples`."""

    stamps_ns: NDArray[np.int64]
    values: Floats
    true: Floats
    speed: Floats
    angle: Floats


class Source:
    """An endless source of published rows: every n-th sample of the drive (`every`)."""

    def __init__(self, parameters: PmsmSimulatorParameters, seed: int) -> None:
        self._drive = Drive(parameters, seed)
        self._parameters = parameters
        self._first = True

    def take(self, count: int) -> Rows:
        """Return the next `count` rows."""
        parameters, every = self._parameters, self._parameters.every
        # no sample precedes the first row, so it has no mean: it is the drive's own sample
        length = count * every - (every - 1 if self._first else 0)
        begun = self._drive.count
        record = self._drive.run(length)
        if not np.isfinite(record.truth).all():
            raise diverged(begun / parameters.sample_rate)
        picked = np.arange(0 if self._first else every - 1, length, every)
        values = record.samples[picked]
        if every > 1:
            start = 1 if self._first else 0
            means = record.samples[start:, 2:].reshape(-1, every, 2).mean(axis=1)
            values[start:, 2:] = means
        self._first = False
        speed, theta, flux = record.truth[picked, :3].T
        true = np.stack(
            [
                (theta + math.pi) % (2.0 * math.pi) - math.pi,
                speed * parameters.pole_pairs,
                flux,
                np.ones(count),
            ],
            axis=1,
        )
        stamps = np.round((begun + picked) * (SECOND / parameters.sample_rate)).astype(np.int64)
        return Rows(stamps, values, true, speed, theta / parameters.pole_pairs)


def generate(
    parameters: PmsmSimulatorParameters, duration: float, seed: int
) -> Iterator[list[Message]]:
    """Yield a batch at a time: measurement and truth (see `sim_pkg.contract`)."""
    rate = parameters.sample_rate / parameters.every
    size = parameters.batch if parameters.publish == BATCHES else max(1, round(AHEAD * rate))
    return in_order(_chunks(parameters, sizes(duration, rate, size), seed))


def _chunks(
    parameters: PmsmSimulatorParameters, counts: Iterator[int], seed: int
) -> Iterator[tuple[list[Message], int]]:
    source = Source(parameters, seed)
    speak = _batch if parameters.publish == BATCHES else _single
    chance = random_stream(seed, 'batches')
    truth = JointStates(TRUTH, (parameters.joint, parameters.joint + ELECTRICAL))
    for count in counts:
        rows = source.take(count)
        yield speak(parameters, rows, truth, chance.random(3)), int(rows.stamps_ns[-1]) + 1


def _batch(
    parameters: PmsmSimulatorParameters, rows: Rows, truth: JointStates, chance: Floats
) -> list[Message]:
    """Return a batch, due at its last sample, and its truth, which always arrives."""
    due = int(rows.stamps_ns[-1])
    length = len(rows.stamps_ns) * parameters.every / parameters.sample_rate
    leaves = due + round(HELD * length * SECOND) if chance[2] < parameters.overtaken else due
    copies = 0 if chance[0] < parameters.lost else 2 if chance[1] < parameters.repeated else 1
    messages = [
        Message(leaves, SAMPLES.name, partial(_samples, rows.stamps_ns, rows.values))
    ] * copies
    messages += _truth(truth, rows, -1)
    if parameters.true_samples:
        messages.append(
            Message(due, TRUE_SAMPLES.name, partial(_samples, rows.stamps_ns, rows.true))
        )
    return messages


def _single(
    parameters: PmsmSimulatorParameters, rows: Rows, truth: JointStates, chance: Floats
) -> list[Message]:
    """Return each sample on current and voltage, and its truth."""
    messages = []
    for row, (stamp, value) in enumerate(zip(rows.stamps_ns.tolist(), rows.values.tolist())):
        for topic, vector in ((CURRENT, value[:2]), (VOLTAGE, value[2:])):
            three = phases(*vector) if parameters.phase_values else (*vector, 0.0)
            messages.append(Message(stamp, topic.name, partial(_vector, stamp, three)))
        messages += _truth(truth, rows, row)
    return messages


def _truth(states: JointStates, rows: Rows, row: int) -> list[Message]:
    """Return speed, angle and flux of one row, due at its stamp."""
    stamp = int(rows.stamps_ns[row])
    angle, speed, flux, _ = rows.true[row].tolist()
    positions, velocities = (float(rows.angle[row]), angle), (float(rows.speed[row]), speed)
    return [
        states.message(stamp, stamp, positions, velocities),
        Message(stamp, TRUE_FLUX.name, partial(_vector, stamp, (flux, 0.0, 0.0))),
    ]


def _samples(stamps_ns: NDArray[np.int64], values: Floats, start_ns: int) -> bytes:
    return drive_samples.encode(stamps_ns + start_ns, values)


def _vector(stamp_ns: int, vector: tuple[float, float, float], start_ns: int) -> bytes:
    return vector3.encode(start_ns + stamp_ns, '', *vector)


SIMULATOR = Simulator(
    name='pmsm',
    summary='a permanent-magnet motor in its drive: currents, voltages and truth',
    parameters=PmsmSimulatorParameters,
    topics=topics,
    generate=generate,
)
