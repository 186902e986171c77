"""From the messages of a drive to the messages that answer them: the same live and in replay."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np

from estimator_pkg.driver.drive import DriveEstimates
from estimator_pkg.driver.drive_joint import DriveJoint
from estimator_pkg.driver.guard import DUPLICATE
from estimator_pkg.driver.joint import Joint
from estimator_pkg.driver.pairs import CURRENT, VOLTAGE, Pairs, Phases, Vector
from estimator_pkg.messages import drive_samples, vector3
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.observers.contract import COASTING, STATUS_NAMES, TRACKING

T = TypeVar('T')
ELECTRICAL = '_electrical'  # follows the joint's name


class Answer(NamedTuple):
    """CDR bytes: JointStates, a table of samples (None where single samples came), the flux."""

    estimate: bytes
    stddev: bytes | None
    samples: bytes | None
    flux: bytes | None


class DriveStream:
    """A motor behind its topics; what a node watches of a bank, it has too.

    Parameters
    ----------
    joint : the motor.
    name : of its joint.
    pair_tolerance : s.
    phases : None where vectors are (alpha, beta); else what takes three phases.

    Attributes
    ----------
    stddev_wanted, flux_wanted : whether these messages are made.
    messages, empty, malformed : batches, or currents and voltages: all, without a row, with another
        layout (`complaint` says what was wrong with the last one).
    statuses : how many samples were used in which status.
    joints : the motor by the name of its joint.
    """

    configuration: Any = None  # as of banks; the motor is made already
    only: frozenset[str] = frozenset()
    mismatched = refused = expired = 0

    def __init__(self, joint: DriveJoint, name: str, *, pair_tolerance: float = 0.0,
                 phases: Phases | None = None) -> None:
        self.joint, self.phases = joint, phases
        self.names = (name, name + ELECTRICAL)
        self.joints: dict[str, Joint] = {name: joint}
        self.pairs = Pairs(round(pair_tolerance * 1e9))
        self.stddev_wanted = self.flux_wanted = False
        self.messages = self.empty = self.malformed = 0
        self.complaint = ''
        self.statuses: Counter[str] = Counter()
        self._encode, self._encode_stddev = Encoder().encode, Encoder().encode

    def touched(self) -> tuple[str, ...]:
        """The joints that may have had a sample."""
        return tuple(self.joints)

    def rehearse(self) -> None:
        """Let what a first sample needs be made before it comes."""
        self.joint.warm_up()
        if not self.joint.fast:
            self.joint.rehearse()

    def batch(self, raw: bytes) -> Answer:
        """The answer to a batch of samples; raises MalformedMessageError if it is none."""
        stamps, samples = self._decoded(drive_samples.decode, raw)
        if not len(stamps):
            self.empty += 1
            return self._answer(0, '', False)
        out = self.joint.take(stamps, samples)
        told = out.rows[:, :4]
        told[np.isnan(told[:, 3]), 3] = 0.0
        used = self._note(out)
        answer = self._answer(self.joint.stamp_ns if used else int(stamps[-1]), '', used)
        return answer._replace(samples=drive_samples.encode(stamps, told))

    def current(self, raw: bytes) -> list[Answer]:
        """The answers that a current [A] completes."""
        return self._vector(CURRENT, raw)

    def voltage(self, raw: bytes) -> list[Answer]:
        """The answers that a voltage [V] completes."""
        return self._vector(VOLTAGE, raw)

    def _vector(self, kind: int, raw: bytes) -> list[Answer]:
        message = self._decoded(vector3.decode, raw)
        vector: Vector | None = message.x, message.y
        if self.phases is not None:
            turn = self.phases.current if kind == CURRENT else self.phases.voltage
            vector = turn(message.x, message.y, message.z)
        if vector is None:
            return []
        answers = []
        for pair in self.pairs.put(kind, message.stamp_ns, vector):
            out = self.joint.take(np.array([pair.stamp_ns]), np.array([pair.sample]))
            answers.append(self._answer(pair.stamp_ns, message.frame_id, self._note(out)))
        return answers

    def _decoded(self, decode: Callable[[bytes], T], raw: bytes) -> T:
        """The message in `raw`, counted; raises MalformedMessageError if it is none."""
        self.messages += 1
        try:
            return decode(raw)
        except MalformedMessageError as error:
            self.malformed += 1
            self.complaint = str(error)
            raise

    def _note(self, out: DriveEstimates) -> bool:
        """Count the statuses; True if any sample was used."""
        statuses = out.status[out.verdict < DUPLICATE]
        for status, count in enumerate(np.bincount(statuses).tolist()):
            if count:
                self.statuses[STATUS_NAMES[status]] += count
        return len(statuses) > 0

    def _answer(self, stamp_ns: int, frame_id: str, used: bool) -> Answer:
        """The messages for the newest estimate; without a joint where it does not count."""
        joint = self.joint
        position, velocity, spare, status = joint.estimate()
        flux = deviations = None
        if used and (status == TRACKING or status == COASTING):
            names: tuple[str, ...] = self.names
            angle, speed = joint.electrical()[:2]
            positions, velocities = [position, angle], [velocity, speed]
        else:
            names, positions, velocities = (), [], []
        estimate = self._encode(stamp_ns, frame_id, names, positions, velocities)
        if self.stddev_wanted:
            pairs = []
            if names:
                pairs = [joint.stddev(), joint.electrical_stddev()[:2]]
            deviations = self._encode_stddev(stamp_ns, frame_id, names, [p[0] for p in pairs],
                                             [p[1] for p in pairs])
        if self.flux_wanted:
            linkage = deviation = math.nan
            if used and not joint.misfit:
                linkage, deviation = joint.electrical()[2], joint.electrical_stddev()[2]
            flux = vector3.encode(stamp_ns, frame_id, linkage, deviation)
        return Answer(estimate, deviations, None, flux)

    def why_silent(self, name: str = '') -> str:
        """Why no sample may be coming although messages do; '' where nothing is known."""
        pairs = self.pairs
        if self.malformed and self.malformed == self.messages:
            return f'every message is malformed: {self.complaint}'
        unbalanced = self.why_unbalanced()
        if unbalanced:
            return unbalanced
        if pairs.apart_ns is not None:
            return (f'currents and voltages do not pair: their stamps are {pairs.apart_ns * 1e-9:g}'
                    ' s apart at best (pair_tolerance)')
        if self.messages and not pairs.paired and not self.joint.received and not self.malformed:
            return 'only one of currents and voltages comes'
        return ''

    def why_unbalanced(self) -> str:
        """That most currents are no three phases without a neutral; '' where they are."""
        phases = self.phases
        if phases is None or phases.unbalanced <= self.pairs.paired:
            return ''
        return (f'the phase currents do not sum to zero (up to {100.0 * phases.worst:.0f} % of the '
                'largest): a neutral, or not three phases?')
