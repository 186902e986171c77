# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Samples with which a header is checked, and what the package computes of them."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

COUNT = 3000  # samples of a motion
COUNTS = 4096  # of the simulated encoder, a turn
MS = 1_000_000  # [ns]


class Samples(NamedTuple):
    """Samples in their order: stamps, shape (n,) [ns], and readings, shape (n, m)."""

    stamps: NDArray[np.int64]
    readings: NDArray[np.float64]


class Interface(NamedTuple):
    """How C calls a header, and the numbers of an estimate.

    call : arguments of update after the stamp, from the array `reading` of `readings` numbers.
    numbers : fields of an estimate; the second one is the velocity.
    """

    readings: int
    call: str
    numbers: list[str]


def interface(joint: Any) -> Interface:
    """Return the interface of the header of a joint or drive."""
    if joint.observer.kind == 'angle':
        fields = ['position', 'velocity', 'acceleration', 'position_stddev', 'velocity_stddev']
        return Interface(1, 'reading[0]', fields)
    fields = ['position', 'velocity', 'angle', 'speed', 'flux']
    fields += [f'{name}_stddev' for name in fields]
    return Interface(4, ', '.join(f'reading[{k}]' for k in range(4)), fields)


def simulated(joint: Any) -> Samples:
    """Return samples at 1 kHz, a drive's at 10 kHz: a motion with rests, and jitter of stamps."""
    chance = random.Random(0)
    period = 10**5 if joint.observer.kind == 'drive' else MS
    motion = {'angle': _encoder, 'drive': _drive}[joint.observer.kind]
    at = np.arange(COUNT) * period
    jitter = [chance.randrange(-period // 20, period // 20) for _ in range(COUNT)]
    return Samples(10**9 + at + jitter, np.array(list(motion(joint, chance, at * 1e-9))))


def _encoder(joint: Any, chance: random.Random, times: Any) -> Iterator[list[float]]:
    """Yield readings of an encoder on a joint that swings, rests and creeps."""
    angle = 0.3
    for t in times.tolist():
        speed = 0.0 if 0.8 < t < 1.0 else 12.0 * math.sin(4.0 * t) * math.sin(0.9 * t)
        angle += 1e-3 * (speed if t < 2.5 else 0.1)
        count = round((angle + chance.gauss(0.0, 2e-4)) * COUNTS / math.tau)
        yield [count * math.tau / COUNTS - math.tau * math.floor(count / COUNTS + 0.5)]


def _drive(joint: Any, chance: random.Random, times: Any) -> Iterator[list[float]]:
    """Yield a small current, and the voltages of a motor that turns to and fro."""
    gains, angle = joint.gains, 0.0
    for t in times.tolist():
        speed = 600.0 * math.sin(8.0 * t)
        angle += 1e-4 * speed
        emf, current = gains.flux * speed, 0.1
        cosine, sine = math.cos(angle), math.sin(angle)
        i = [current * cosine, current * sine]
        u = [gains.resistance * i[0] - emf * sine, gains.resistance * i[1] + emf * cosine]
        yield [value + chance.gauss(0.0, 1e-3) for value in (*i, *u)]


def with_faults(samples: Samples) -> Samples:
    """Return samples, and after them some of every kind that a guard sees."""
    stamps, readings = samples
    last, reading = int(stamps.max()), readings[-1]
    more: list[tuple[int, Any]] = [(0, reading), (-1, reading), (last + MS, reading)]
    more += [(last + MS, reading), (last, reading), (last - 30 * MS, reading)]
    at = last + 2 * MS
    for k, value in enumerate((math.nan, math.inf, -math.inf, 1e300, -1e10, 1e-320, -0.0)):
        more.append((at + k * MS, reading * 0.0 + value))
    for pause in (300, 900, 5_000, -8_000, 1, 1, 1, 0, 0, 10**9, -(10**9), 20):
        at += pause * MS
        more += [(at + k * MS, reading + 1e-3 * k) for k in range(8)]
        at += 8 * MS
    more += [(at + k * MS, reading + 2e-3 * (k // 2)) for k in range(200)]  # each published twice
    more += [(2**62, reading), (2**62 + 1, reading), (at + 201 * MS, reading)]
    return Samples(
        np.concatenate((stamps, np.array([stamp for stamp, _ in more], np.int64))),
        np.concatenate((readings, np.array([values for _, values in more]))),
    )


def expected(joint: Any, samples: Samples) -> Iterator[tuple[bool, Sequence[float], int]]:
    """Yield (used, numbers of the estimate, status) of each sample, of the joint from its start."""
    joint.reset()
    for stamp, reading in zip(samples.stamps.tolist(), samples.readings.tolist()):
        if joint.observer.kind == 'drive':
            used = joint.update(stamp, reading)
            position, velocity, _, status = joint.estimate()
            angles = joint.electrical()[:3]
            sigmas = [*joint.stddev(), *joint.electrical_stddev()]
            yield used, [position, velocity, *angles, *sigmas], status
        else:
            used = joint.update(stamp, reading[0])
            *numbers, status = joint.estimate()
            yield used, [*numbers, *joint.stddev()], status


def text(value: float) -> str:
    """Return a double in C, exact."""
    if math.isfinite(value):
        return float(value).hex() if value else repr(float(value))
    return 'NAN' if value != value else f'{"-" if value < 0.0 else ""}INFINITY'


def header(prefix: str, joint: Any, samples: Samples) -> str:
    """Return the samples and what is expected of them as a C header."""
    shape = interface(joint)
    lines = [
        f'/* Samples for {prefix}.h, and the estimates of the package: see main.c. */',
        '#include <math.h>',
        '#include <stdbool.h>',
        '#include <stdint.h>',
        '',
        '/* stamp [ns], reading, used, estimate in the order of its fields, status */',
        'typedef struct {',
        '    int64_t stamp_ns;',
        f'    double reading[{shape.readings}];',
        '    bool used;',
        f'    double estimate[{len(shape.numbers)}];',
        '    int status;',
        '} Vector;',
        '',
        'static const Vector VECTORS[] = {',
    ]
    for stamp, reading, (used, numbers, status) in zip(*samples, expected(joint, samples)):
        columns = ', '.join(map(text, reading)), ', '.join(map(text, numbers))
        row = f'{{{columns[0]}}}, {str(used).lower()}, {{{columns[1]}}}, {status}'
        lines.append(f'    {{{stamp}, {row}}},')
    return '\n'.join([*lines, '};', ''])
