# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Exported headers: ``python -m benchmarks.export float|cost``.

`float` prints the largest rms difference of the velocity in float from that in double [rad/s]: of a
joint with an encoder of 1024 to 65,536 counts, and of the check that `export` writes by default.
`cost` prints the time of an update with its estimate here, bytes of state, and bytes of code for
Cortex-M4F and M7 (clang -Os), next to the moving average of ten differences that firmware usually
has.
"""

from __future__ import annotations

import math
import re
import subprocess
import sys
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import registry
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.evaluation.entries import angle_observers
from estimator_pkg.export import folder, vectors
from estimator_pkg.export.header import Exported, exported

COUNTS = 1024, 4096, 65_536  # of a turn
TIMES = np.arange(10_000) * 1e-3  # [s]
SPEED = 20.0 * np.sin(4.0 * TIMES) * np.sin(0.9 * TIMES)  # [rad/s]
MOTIONS: dict[str, NDArray[Any]] = {  # the angle [rad]
    'one turn': 0.3 + np.cumsum(SPEED) * 1e-3,
    'up to 100 rad': 50.0 - 50.0 * np.cos(0.4 * TIMES),
}
MOVING = """\
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
typedef struct { double differences[10], sum, last; int64_t last_ns; int at; } moving;
typedef struct { double velocity; } moving_estimate;
static inline void moving_init(moving *self) { const moving blank = {0}; *self = blank; }
static inline bool moving_update(moving *self, int64_t stamp_ns, double angle)
{
    const double passed = (stamp_ns - self->last_ns) * 1e-9;
    double moved = angle - self->last;
    moved -= 6.283185307179586 * floor(moved / 6.283185307179586 + 0.5);
    self->last = angle;
    self->last_ns = stamp_ns;
    self->sum -= self->differences[self->at];
    self->differences[self->at] = moved / passed;
    self->sum += self->differences[self->at];
    self->at = (self->at + 1) % 10;
    return true;
}
static inline void moving_get(const moving *self, moving_estimate *out)
{
    out->velocity = self->sum / 10.0;
}
"""
TIMED = """\
#include <stdio.h>
#include <time.h>
#include "{prefix}.h"
#include "vectors.h"
int main(void)
{{
    const int count = (int)(sizeof VECTORS / sizeof VECTORS[0]);
    static {prefix} joint;
    static {prefix}_estimate out;
    double best = 1e9;
    for (int turn = 0; turn < 20; turn++) {{
        struct timespec begun, ended;
        {prefix}_init(&joint);
        clock_gettime(CLOCK_MONOTONIC, &begun);
        for (int i = 0; i < count; i++) {{
            {prefix}_update(&joint, VECTORS[i].stamp_ns, VECTORS[i].reading[0]);
            {prefix}_get(&joint, &out);
        }}
        clock_gettime(CLOCK_MONOTONIC, &ended);
        const double ns = (ended.tv_sec - begun.tv_sec) * 1e9 + ended.tv_nsec - begun.tv_nsec;
        best = ns / count < best ? ns / count : best;
    }}
    printf("%.0f %zu", best, sizeof joint + 0 * (size_t)out.velocity);
    return 0;
}}
"""
CODE = """\
#include "{prefix}.h"
void start({prefix} *self) {{ {prefix}_init(self); }}
int take({prefix} *self, int64_t at, {real} x, {prefix}_estimate *out)
{{
    const int used = {prefix}_update(self, at, x);
    {prefix}_get(self, out);
    return used;
}}
const unsigned state_bytes = sizeof({prefix});
"""
ONE = """sqrt exp log log1p expm1 sin cos tan atan acos asin sinh cosh tanh erf erfc fabs floor ceil
    rint"""
SHIM = '\n'.join(  # a math.h of declarations alone, for a compiler without a library
    [f'double {name}(double); float {name}f(float);' for name in ONE.split()]
    + [
        f'double {name}(double, double); float {name}f(float, float);'
        for name in ('atan2', 'hypot', 'pow', 'fmod', 'copysign')
    ]
    + ['double ldexp(double, int); float ldexpf(float, int);']
    + [f'#define {name}(x) __builtin_{name}(x)' for name in ('isnan', 'isinf', 'isfinite')]
    + ['#define NAN __builtin_nanf("")', '#define INFINITY __builtin_inff()', '']
)


@lru_cache
def header(name: str, float32: bool, **values: Any) -> Exported:
    """Return an exported observer."""
    observer = registry.find(registry.OBSERVERS, name)
    gains, settings = Configuration(observer, values).for_joint('')
    return exported(observer, gains, settings, name, float32)


def sampled(angle: NDArray[Any], quantum: float) -> vectors.Samples:
    """Return readings of an encoder, at 1 kHz with jitter; on one turn in [-pi, pi)."""
    readings = quantum * np.floor(angle / quantum)
    if np.ptp(angle) < math.tau:
        readings -= math.tau * np.floor(readings / math.tau + 0.5)
    jitter = np.random.default_rng(0).integers(-50_000, 50_000, len(angle))
    stamps = 10**9 + np.rint(TIMES * 1e9).astype(np.int64) + jitter
    return vectors.Samples(stamps, readings[:, None])


def difference(made: Exported, samples: vectors.Samples) -> float:
    """Return the rms difference of the velocity from that in double [rad/s]."""
    with tempfile.TemporaryDirectory() as place:
        done = folder.write(Path(place) / 'out', made, samples)
    found = re.search(r'rms (\S+)', '\n'.join(done[1])) if done else None
    if found is None:
        raise SystemExit(f'{made.prefix}: the check did not run: {done}')
    return float(found[1])


def in_float() -> None:
    """Print the differences as a table."""
    print(f'| observer | {" | ".join(MOTIONS)} | check of export |')
    variants = [(name, '') for name in angle_observers()]
    at = variants.index(('kalman', '')) + 1
    variants[at:at] = [('kalman', 'quantum'), ('kalman', 'bandwidth_hz')]
    for name, known in variants:

        def made(counts: int, name: str = name, known: str = known) -> Exported:
            value = 20.0 if known == 'bandwidth_hz' else math.tau / counts
            return header(name, True, **({known: value} if known else {}))

        worst = [
            max(difference(made(n), sampled(angle, math.tau / n)) for n in COUNTS)
            for angle in MOTIONS.values()
        ]
        check = vectors.with_faults(vectors.simulated(made(vectors.COUNTS).joint))
        worst.append(difference(made(vectors.COUNTS), check))
        cells = ' | '.join(re.sub('e-0', 'e-', f'{each:.0e}') for each in worst)
        print(f'| `{name}`{known and f", `{known}`"} | {cells} |', flush=True)


def run(*command: str, cwd: Path) -> str:
    """Return what a command prints."""
    return subprocess.run(command, cwd=cwd, check=True, capture_output=True, text=True).stdout


def code(folder: Path, prefix: str, real: str, cpu: str) -> int:
    """Return the bytes of code and constants of a header on a Cortex-M."""
    (folder / 'shim').mkdir(exist_ok=True)
    (folder / 'shim' / 'math.h').write_text(SHIM)
    (folder / 'code.c').write_text(CODE.format(prefix=prefix, real=real))
    flags = '-Os -std=c99 -ffp-contract=off -fno-math-errno -ffreestanding -mthumb -mfloat-abi=hard'
    target = '--target=thumbv7em-none-eabihf', f'-mcpu={cpu}', '-Ishim', '-c', 'code.c'
    run('clang', *flags.split(), *target, '-o', 'code.o', cwd=folder)
    sizes = run('size', '-A', 'code.o', cwd=folder).splitlines()
    parts = [line.split() for line in sizes if line.startswith(('.text', '.rodata'))]
    return sum(int(part[1]) for part in parts)


def cost(folder: Path, prefix: str, real: str) -> str:
    """Return a line of the table."""
    (folder / 'timed.c').write_text(
        '#define _POSIX_C_SOURCE 199309L\n' + TIMED.format(prefix=prefix)
    )
    flags = '-O2', '-std=c99', '-ffp-contract=off', '-fwrapv'
    run('gcc', *flags, 'timed.c', '-o', 'timed', '-lm', cwd=folder)
    ns, state = map(int, run('./timed', cwd=folder).split())
    m4, m7 = (code(folder, prefix, real, cpu) for cpu in ('cortex-m4', 'cortex-m7'))
    return f'{prefix:<18} {real:<7} {ns:>6} {state:>7} {m4:>8} {m7:>8}'


def costs() -> None:
    """Print the costs as a table."""
    print(f'{"observer":<18} {"number":<7} {"ns":>6} {"state":>7} {"M4F":>8} {"M7":>8}')
    for name in angle_observers():
        for real in ('double', 'float'):
            with tempfile.TemporaryDirectory() as place:
                made, out = header(name, real == 'float'), Path(place) / name
                folder.write(out, made, vectors.simulated(made.joint))
                print(cost(out, name, real), flush=True)
                if name == 'finite_difference':
                    (out / 'moving.h').write_text(MOVING.replace('double', real))
                    print(cost(out, 'moving', real), flush=True)


if __name__ == '__main__':
    {'float': in_float, 'cost': costs}[sys.argv[1]]()
