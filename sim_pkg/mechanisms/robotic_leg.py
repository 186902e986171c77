# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulator ``robotic_leg``: the leg of section 5.2 with its excitation."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from estimator_pkg.models.load import load
from estimator_pkg.parameters import structural
from sim_pkg.chunks import MEASURED, TRUTH
from sim_pkg.contract import Message, Simulator
from sim_pkg.mechanisms.stream import MechanismParameters, Vector, merged, stream

START = (2.2, 1.8, 0.4)


@dataclass(frozen=True)
class Parameters(MechanismParameters):
    """The parameters of the simulator."""

    rate: float = structural(1000.0, unit='Hz', range=(1.0, 1e5), description='samples per second')
    quantum: tuple[float, ...] = structural(
        (1.0 / 500.0, 2.0 * math.pi / 256.0, 2.0 * math.pi / 256.0),
        unit='m, rad, rad',
        kind=list,
        range=(0.0, 10.0),
        description='quantum of the encoders, for all or each; 0: exact',
    )
    force: float = structural(0.0535, unit='N', range=(0.0, 1e6), description='amplitude of u1')
    torque: float = structural(0.067, unit='N m', range=(0.0, 1e6), description='amplitude of u2')
    omega: float = structural(
        10.0, unit='rad/s', range=(0.0, 1e4), description='angular frequency of u1 and u2'
    )


def generate(parameters: Parameters, duration: float, seed: int) -> Iterator[list[Message]]:
    """Yield chunks of messages; see `sim_pkg.contract`."""
    p = parameters
    mechanics = load('robotic_leg', merged({}, p.model_parameters))

    def drive(time: float, y: Vector, v: Vector) -> Vector:
        return (p.force * math.cos(p.omega * time), p.torque * math.sin(p.omega * time))

    return stream(mechanics, p, START, (0.0,) * 3, drive, duration, seed)


SIMULATOR = Simulator(
    name='robotic_leg',
    summary="the paper's robotic leg with its excitation",
    parameters=Parameters,
    topics=lambda p: (MEASURED, TRUTH),
    generate=generate,
)
