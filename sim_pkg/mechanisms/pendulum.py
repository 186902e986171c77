# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulator ``pendulum``: a single joint with gravity, driven by a torque of several sines."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from estimator_pkg.models.load import load
from estimator_pkg.parameters import structural
from sim_pkg.chunks import MEASURED, TRUTH
from sim_pkg.contract import Message, Simulator
from sim_pkg.joints.sensor import random_stream
from sim_pkg.mechanisms.stream import MechanismParameters, Vector, merged, stream

PLANT = {'inertia': 0.05, 'damping': 0.02, 'gravity': 1.5, 'coulomb': 0.05}
SINES = 12


@dataclass(frozen=True)
class Parameters(MechanismParameters):
    """The parameters of the simulator."""

    rate: float = structural(500.0, unit='Hz', range=(1.0, 1e5), description='samples per second')
    quantum: tuple[float, ...] = structural(
        (2.0 * math.pi / 4096.0,),
        unit='rad',
        kind=list,
        range=(0.0, 10.0),
        description='quantum of the encoder; 0: exact',
    )
    torque: float = structural(
        0.6, unit='N m', range=(0.0, 1e6), description='rms of the driving torque'
    )
    lowest: float = structural(
        0.2, unit='Hz', range=(0.001, 1e4), description='lowest frequency of the torque'
    )
    highest: float = structural(
        3.0, unit='Hz', range=(0.001, 1e4), description='highest frequency of the torque'
    )


def generate(parameters: Parameters, duration: float, seed: int) -> Iterator[list[Message]]:
    """Yield chunks of messages; see `sim_pkg.contract`."""
    p = parameters
    mechanics = load('single_joint', merged(PLANT, p.model_parameters))
    random = random_stream(seed, 'torque')
    omega = (
        2.0
        * math.pi
        * (p.lowest + (p.highest - p.lowest) * (np.arange(SINES) + random.random(SINES)) / SINES)
    )
    phase = 2.0 * math.pi * random.random(SINES)
    size = p.torque * math.sqrt(2.0 / SINES)

    def drive(time: float, y: Vector, v: Vector) -> Vector:
        return (size * float(np.sum(np.sin(omega * time + phase))),)

    return stream(mechanics, p, mechanics.centre, (0.0,), drive, duration, seed)


SIMULATOR = Simulator(
    name='pendulum',
    summary='one joint with gravity and friction, driven by a torque',
    parameters=Parameters,
    topics=lambda p: (MEASURED, TRUTH),
    generate=generate,
)
