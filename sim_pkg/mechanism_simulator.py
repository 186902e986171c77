"""What the simulators of mechanisms share: encoders, messages, the step from sample to sample.

A message of `joint_states` carries the measured positions and, as effort, the inputs that acted
from the sample before to this one (0 for joints without a motor). The truth carries the positions
and velocities at the same stamp.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from estimator_pkg.errors import UsageError
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.models.mechanics import Mechanics
from estimator_pkg.models.motion import make_plant
from estimator_pkg.observers.circle import wrap
from estimator_pkg.parameters import parameter
from sim_pkg.contract import Message, Topic
from sim_pkg.sensor import SECOND, fixed, random_stream

MEASURED = Topic('joint_states', JOINT_STATE)
TRUTH = Topic('ground_truth/joint_states', JOINT_STATE, truth=True)

CHUNK = 16            # samples made at a time where nothing is fed back
FINEST = 5e-4         # s, longest step of the plant

Vector = tuple[float, ...]
Drive = Callable[[float, Vector, Vector], Vector]  # (time, measured, true velocity) -> inputs


@dataclass(frozen=True)
class MechanismParameters:
    """What every simulator of a mechanism has."""

    rate: float = fixed(224.0, unit='Hz', range=(1.0, 1e5), description='samples per second')
    quantum: tuple[float, ...] = fixed(
        (0.0,), unit='rad or m', kind=list, range=(0.0, 10.0),
        description='smallest step of the encoders, for all positions or each; 0: exact')
    noise: tuple[float, ...] = fixed(
        (0.0,), unit='rad or m', kind=list, range=(0.0, 10.0),
        description='standard deviation of the noise before the encoders, for all or each')
    hold: int = fixed(
        1, unit='samples', range=(1, 1000),
        description='samples for which a reading is repeated (2: encoders at half the rate)')
    model_parameters: tuple[str, ...] = parameter(
        (), unit='', structural=True,
        description="numbers of the plant as 'name=value' that differ from the simulator's "
                    'defaults: what an observer with the defaults does not know')


def topics(parameters: MechanismParameters) -> tuple[Topic, ...]:
    """Measurement and truth."""
    return MEASURED, TRUTH


def spread(name: str, values: tuple[float, ...], count: int) -> np.ndarray:
    """One number per position; raises UsageError."""
    if len(values) not in (1, count):
        raise UsageError(f"parameter '{name}' has {len(values)} numbers for {count} positions")
    return np.resize(np.array(values, float), count)


class Encoders:
    """Noise, an offset drawn once, and quantisation; readings wrap where the joint does."""

    def __init__(self, mechanics: Mechanics, quantum: np.ndarray, noise: np.ndarray, hold: int,
                 seed: int) -> None:
        self._periods, self._quantum, self._noise = mechanics.periods, quantum, noise
        self._hold, self._count = hold, 0
        self._offset = random_stream(seed, 'encoder offset').uniform(
            -0.5, 0.5, mechanics.degrees) * quantum
        self._random = random_stream(seed, 'encoder noise')
        self._last: Vector = ()

    def read(self, q: Vector) -> Vector:
        """The readings at these positions."""
        draws = self._random.standard_normal(len(q))
        if self._count % self._hold == 0:
            values = np.array(q) + self._noise * draws
            safe = np.where(self._quantum > 0.0, self._quantum, 1.0)
            steps = safe * np.floor((values + self._offset) / safe + 0.5) - self._offset
            values = np.where(self._quantum > 0.0, steps, values)
            self._last = tuple(wrap(value, period)
                               for value, period in zip(values.tolist(), self._periods))
        self._count += 1
        return self._last


def stream(mechanics: Mechanics, parameters: MechanismParameters, q: Vector, v: Vector,
           drive: Drive, duration: float, seed: int, *, chunk: int = CHUNK,
           released: Callable[[], bool] = lambda: True) -> Iterator[list[Message]]:
    """Measurement and truth, `chunk` samples at a time (see `sim_pkg.contract`).

    Parameters
    ----------
    q, v : where the mechanism starts.
    drive : the inputs, held from this sample to the next.
    released : False keeps the mechanism where it is, as by hand.
    """
    n = mechanics.degrees
    encoders = Encoders(mechanics, spread('quantum', parameters.quantum, n),
                        spread('noise', parameters.noise, n), parameters.hold, seed)
    plant = make_plant(mechanics)
    dt = 1.0 / parameters.rate
    parts = max(1, math.ceil(dt / FINEST))
    measure, true = Encoder(), Encoder()
    left = math.inf if math.isinf(duration) else max(1, math.ceil(duration * parameters.rate
                                                                  - 1e-6))
    k = 0
    effort: Vector = (0.0,) * n
    messages: list[Message] = []
    while k < left:
        due = round(k * SECOND / parameters.rate)
        reading = encoders.read(q)
        messages.append(Message(due, MEASURED.name, partial(
            _encode, measure, mechanics.joints, due, reading, (), effort)))
        shown = tuple(wrap(x, period) for x, period in zip(q, mechanics.periods))
        messages.append(Message(due, TRUTH.name, partial(
            _encode, true, mechanics.joints, due, shown, v, effort)))
        k += 1
        if k % chunk == 0:
            yield messages
            messages = []
        if released():
            u = drive((k - 1) * dt, reading, v)
            q, v = plant(mechanics.values, q, v, u, dt, parts)
            acting = [0.0] * n
            for index, value in zip(mechanics.actuated, u):
                acting[index] = value
            effort = tuple(acting)
        else:
            effort = (0.0,) * n
    if messages:
        yield messages


def _encode(encoder: Encoder, names: tuple[str, ...], stamp_ns: int, positions: Vector,
            velocities: Vector, efforts: Vector, start_ns: int) -> bytes:
    return encoder.encode(start_ns + stamp_ns, '', names, positions, velocities, efforts)


def merged(defaults: Mapping[str, object], assignments: tuple[str, ...]) -> tuple[str, ...]:
    """Assignments for `models.load.load`: the simulator's defaults, then the user's own."""
    own = {text.partition('=')[0].strip() for text in assignments}
    return (*(f'{name}={value}' for name, value in defaults.items() if name not in own),
            *assignments)
