# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulator ``cart_pendulum``: the laboratory of section 6, open loop or balanced upright."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from estimator_pkg.errors import UsageError
from estimator_pkg.models.load import load
from estimator_pkg.parameters import structural
from sim_pkg.chunks import MEASURED, TRUTH
from sim_pkg.contract import Message, Simulator
from sim_pkg.mechanisms.stream import CHUNK, MechanismParameters, Vector, merged, stream

OPEN, TRUE_VELOCITY, OBSERVER = 'open', 'true_velocity', 'observer'
CONSTANT, FORWARD, BACKWARD = 9.27, 3.98, 2.87  # N/A, N, N
LIMIT = 60.0  # of the motor's force [N]
PATIENCE = 0.05  # longest wait for an estimate [s]
CART_AMPLITUDE, CART_PERIOD = 0.2, 10.0  # m, s: of the cart's reference
SOFT = 0.02  # width of the smoothed sign function in the friction compensation [m/s]

PLANT = {
    'force_constant': CONSTANT,
    'friction_forward': FORWARD,
    'friction_backward': BACKWARD,
    'friction_speed': 2e-3,
}


@dataclass(frozen=True)
class Parameters(MechanismParameters):
    """The parameters of the simulator; the input is the motor's current [A]."""

    quantum: tuple[float, ...] = structural(
        (7.85e-4, 1.8e-5),
        unit='rad, m',
        kind=list,
        range=(0.0, 10.0),
        description='quantum of the encoders, for both or each; 0: exact',
    )
    control: str = structural(
        OPEN,
        choices=(OPEN, TRUE_VELOCITY, OBSERVER),
        description='open: excitation of the hanging pendulum; true_velocity: balanced upright '
        'with the true velocities; observer (live only): with those of the topic `estimate`',
    )
    amplitude: float = structural(
        2.5, unit='A', range=(0.0, 100.0), description='amplitude of the open-loop chirp'
    )
    start_angle: float = structural(
        0.05, unit='rad', range=(-0.5, 0.5), description='start angle of the balanced pendulum'
    )


class Feedback:
    """The newest estimated velocities, passed from a live node to the controller.

    The controller waits for the estimate of its own sample, so a busy machine slows the loop down
    instead of opening it.
    """

    def __init__(self) -> None:
        self.velocities: Vector | None = None
        self._fresh = threading.Event()

    def put(self, velocities: Vector) -> None:
        """Store a new estimate; one with NaN or infinity is ignored."""
        if all(map(math.isfinite, velocities)):
            self.velocities = velocities
            self._fresh.set()

    def take(self) -> Vector | None:
        """Return the newest estimate; wait up to `PATIENCE` for one that was not returned yet."""
        self._fresh.wait(PATIENCE)
        self._fresh.clear()
        return self.velocities


def current(time: float, amplitude: float) -> float:
    """Return the excitation of section 6.2 [A]: a chirp, a rest, a square wave."""
    if time < 5.0:
        return amplitude * math.sin(2.0 * math.pi * (2.0 * time + 0.7 * time**2))
    if time < 6.0:
        return 0.0
    return 0.8 if math.floor(4.0 * (time - 6.0) + 1e-9) % 2 == 0 else -0.8


def triangle(time: float) -> tuple[float, float]:
    """Return the cart's reference [m] and its rate [m/s]: a triangle from 0, rising first."""
    phase = time / CART_PERIOD + 0.25
    phase -= math.floor(phase)
    slope = 4.0 * CART_AMPLITUDE / CART_PERIOD
    if phase < 0.5:
        return CART_AMPLITUDE * (4.0 * phase - 1.0), slope
    return CART_AMPLITUDE * (3.0 - 4.0 * phase), -slope


def balancing_force(y: Sequence[float], v: Sequence[float], reference: float, rate: float) -> float:
    """Return the force on the cart [N] of section 6.3, with compensation of the Coulomb friction.

    The paper prints the law with the wrong overall sign (as printed, a pole lies at +30.8 1/s).

    Parameters
    ----------
    y, v : measured positions and estimated velocities (pendulum [rad], cart [m]).
    reference, rate : of the cart [m, m/s].
    """
    force = 104.0 * y[0] + 20.0 * v[0] + 21.0 * (y[1] - reference) + 23.0 * (v[1] - rate)
    return force + (FORWARD if v[1] >= 0.0 else BACKWARD) * math.tanh(v[1] / SOFT)


def generate(
    parameters: Parameters, duration: float, seed: int, feedback: Feedback | None = None
) -> Iterator[list[Message]]:
    """Yield chunks of messages; see `sim_pkg.contract`.

    Raises
    ------
    UsageError : `control: observer` without a live node, or an invalid parameter of the plant.
    """
    p = parameters
    mechanics = load('cart_pendulum', merged(PLANT, p.model_parameters))
    if p.control == OBSERVER and feedback is None:
        raise UsageError(
            "'control: observer' needs velocities from the topic `estimate`: run the live node "
            'cart_pendulum_sim, or set another control'
        )
    rest, waits = (0.0, 0.0), p.control == OBSERVER

    def excite(time: float, y: Vector, v: Vector) -> Vector:
        return (current(time, p.amplitude),)

    def released() -> bool:
        return not waits or (feedback is not None and feedback.velocities is not None)

    def balance(time: float, y: Vector, v: Vector) -> Vector:
        if waits and feedback is not None:
            v = feedback.take() or v
        force = balancing_force(y, v, *triangle(time))
        return (min(max(force, -LIMIT), LIMIT) / CONSTANT,)

    if p.control == OPEN:
        return stream(mechanics, p, (math.pi, 0.0), rest, excite, duration, seed)
    start, chunk = (p.start_angle, 0.0), 1 if waits else CHUNK
    return stream(
        mechanics, p, start, rest, balance, duration, seed, chunk=chunk, released=released
    )


SIMULATOR = Simulator(
    name='cart_pendulum',
    summary='a pendulum on a driven cart with asymmetric dry friction',
    parameters=Parameters,
    topics=lambda p: (MEASURED, TRUTH),
    generate=generate,
)
