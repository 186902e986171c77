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

from estimator_pkg.sensor.guard import DUPLICATE

COUNT = 3000  # samples of a motion
COUNTS = 4096  # of the simulated encoder, a turn
MS = 1_000_000  # [ns]


class Samples(NamedTuple):
    """Samples in their order: stamps, shape (n,) [ns], and readings, shape (n, m)."""

    stamps: NDArray[np.int64]
    readings: NDArray[np.float64]


def simulated(seed: int = 0) -> Samples:
    """Return an encoder of a joint that rests, creeps, swings and turns, at 1 kHz with jitter."""
    chance = random.Random(seed)
    stamps, angles, angle = [], [], 0.3
    for k in range(COUNT):
        t = k * 1e-3
        speed = 0.0 if 0.8 < t < 1.0 else 12.0 * math.sin(4.0 * t) * math.sin(0.9 * t)
        angle += 1e-3 * (speed if t < 2.5 else 0.1)
        count = round((angle + chance.gauss(0.0, 2e-4)) * COUNTS / math.tau)
        angles.append(count * math.tau / COUNTS - math.tau * math.floor(count / COUNTS + 0.5))
        stamps.append(1_000 * MS + k * MS + chance.randrange(-50_000, 50_000))
    return Samples(np.array(stamps, np.int64), np.array(angles)[:, None])


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
    """Yield (used, numbers of the estimate, status) of each sample, of a new joint of an angle."""
    joint = type(joint)(joint.observer, joint.gains, joint.settings)
    out = joint.run(samples.stamps, np.ascontiguousarray(samples.readings[:, 0]))
    columns = out.position, out.velocity, out.acceleration, out.position_stddev
    for row in zip(out.verdict, *columns, out.velocity_stddev, out.status):
        used, *numbers, status = (value.item() for value in row)
        yield used < DUPLICATE, numbers, status


def text(value: float) -> str:
    """Return a double in C, exact."""
    if math.isfinite(value):
        return float(value).hex() if value else repr(float(value))
    return 'NAN' if value != value else f'{"-" if value < 0.0 else ""}INFINITY'


def header(prefix: str, joint: Any, samples: Samples) -> str:
    """Return the samples and what is expected of them as a C header."""
    lines = [
        f'/* Samples for {prefix}.h, and the estimates of the package: see main.c. */',
        '#include <math.h>',
        '#include <stdbool.h>',
        '#include <stdint.h>',
        '',
        '/* stamp [ns], reading, used, estimate in the order of its fields, status */',
        'typedef struct {',
        '    int64_t stamp_ns;',
        f'    double reading[{samples.readings.shape[1]}];',
        '    bool used;',
        '    double estimate[5];',
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
