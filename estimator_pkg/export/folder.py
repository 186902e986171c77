# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The files next to an exported header: its check, its build and its README."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

from estimator_pkg import whole_file
from estimator_pkg.errors import UserError
from estimator_pkg.export import vectors
from estimator_pkg.export.header import Exported

FLAGS = '-O2 -std=c99 -Wall -Wextra -ffp-contract=off -fwrapv'
MAIN = """\
/* Compares {prefix}.h with the estimates of the package, sample by sample.
 *
 * Exit code 0: all are equal to the last bit, or the error is at most the TOLERANCE that is passed.
 */
#include <stdio.h>
#include <stdlib.h>

#include "{prefix}.h"
#include "vectors.h"

int main(int argc, char **argv)
{{
    const int count = (int)(sizeof VECTORS / sizeof VECTORS[0]);
    const double tolerance = argc > 1 ? atof(argv[1]) : {tolerance};
    int compared = 0, equal = 0, within = 0, flips = 0;
    double squares = 0.0, worst = 0.0;
    static {prefix} joint;
    {prefix}_init(&joint);
    for (int i = 0; i < count; i++) {{
        const Vector *vector = &VECTORS[i];
        {real} reading[{readings}];
        for (int j = 0; j < {readings}; j++) reading[j] = ({real})vector->reading[j];
        const bool used = {prefix}_update(&joint, vector->stamp_ns, {call});
        if (!used && !vector->used) continue;
        {prefix}_estimate out;
        {prefix}_get(&joint, &out);
        const double found[] = {{
            {numbers}
        }};
        bool same = true;
        double error = 0.0;
        for (int j = 0; j < {count}; j++) {{
            const double expected = vector->estimate[j], off = fabs(found[j] - expected);
            if (found[j] == expected || (isnan(found[j]) && isnan(expected))) continue;
            same = false;
            if ((j >= {first} && j < {last}) || !{single}) error = fmax(error, off == off ? off : INFINITY);
        }}
        const bool flip = used != vector->used || out.status != vector->status;
        if (flip) {{
            flips++;
            if (flips <= 10) printf("sample %d: used %d, status %d; in the package %d, %d\\n", i,
                    used, (int)out.status, vector->used, vector->status);
        }}
        compared++;
        equal += same && !flip;
        within += error <= 1e-9;
        worst = fmax(worst, error);
        if (!flip && error < INFINITY) squares += error * error;
    }}
    const double rms = compared ? sqrt(squares / compared) : 0.0;
    printf("%d samples: %d equal to the last bit, %d within 1e-9, %d flips of a decision\\n",
            compared, equal, within, flips);
    printf("largest error %.3g, rms %.3g{what}\\n", worst, rms);
    if (tolerance == 0.0) return equal == compared ? 0 : 1;
    return flips == 0 && {judged} <= tolerance ? 0 : 1;
}}
"""
CMAKE = """\
cmake_minimum_required(VERSION 3.10)
project({prefix} C)
set(CMAKE_C_STANDARD 99)
# The header: target_link_libraries(yours PRIVATE {prefix}) finds it.
add_library({prefix} INTERFACE)
target_include_directories({prefix} INTERFACE ${{CMAKE_CURRENT_SOURCE_DIR}})
target_compile_options({prefix} INTERFACE -ffp-contract=off -fwrapv)
# Its check.
add_executable(check main.c)
target_link_libraries(check PRIVATE {prefix} m)
enable_testing()
add_test(NAME check COMMAND check)
"""
README = """\
# {prefix}

`{prefix}.h` is the observer `{observer}` of velocity_estimator with the gains that stand at its top: guard for
stamps and readings, sensor stage, observer, calibration of the standard deviation. It is C99 and C++17, needs
`<math.h>`, `<stdbool.h>` and `<stdint.h>`, allocates nothing and has no global state. Other gains mean another
export.

## Use

```c
#include "{prefix}.h"

static {prefix} joint;                        // once, before the timer starts: {prefix}_init(&joint);
volatile {real} velocity;                     // [rad/s]

void TIM3_IRQHandler(void)                    // for example every 1 ms
{{
    static int64_t now_ns;
    static uint16_t last;
    static int32_t counts;
    const uint16_t timer = TIM2->CNT;         // counts of the encoder
    TIM3->SR = 0;
    now_ns += 1000000;                        // above 0, 64 bits: it never overflows
    counts += (int16_t)(timer - last);        // right across an overflow of the 16-bit counter
    last = timer;
    if ({prefix}_update(&joint, now_ns, {angle})) {{
        {prefix}_estimate estimate;
        {prefix}_get(&joint, &estimate);      // status 1 and 2 are valid
        if (estimate.status == 1 || estimate.status == 2) velocity = estimate.velocity;
    }}
}}
```

The angle is in {unit}.{wrap} Stamps are of any clock that moves forward; only their differences
count. A sample with a NaN, or with a stamp that is not newer, is counted in `joint.counts` and not used.

## Check

    cmake -B build && cmake --build build && ./build/check

or `cc {flags} main.c -o check -lm && ./check`. It compares {count} samples with the estimates of the package.
{check}

- `-ffp-contract=off`: without it a compiler may fuse a multiplication and an addition. The last bits then differ,
  and after a decision that hangs on them, the estimates for a while.
- Another libm rounds `exp`, `sin`, `erfc` and others otherwise, with the same effect. Run `./check 1e-9` there.

## Cost

`{prefix}` has {size} bytes of state{size_note}. docs/firmware.md of velocity_estimator has the time and the code
size on microcontrollers, and how to log what shows that all is right.
"""


def write(out: Path, exported: Exported, samples: vectors.Samples, size: str = '') -> None:
    """Write all files into a new folder.

    Raises
    ------
    UserError : the folder exists.
    """
    made, single = exported, exported.float32
    shape = vectors.interface(made.joint)
    names = {
        'prefix': made.prefix,
        'observer': made.joint.observer.name,
        'real': 'float' if single else 'double',
        'flags': FLAGS,
    }
    main = MAIN.format(
        **names,
        readings=shape.readings,
        call=shape.call,
        numbers=',\n            '.join(f'out.{name}' for name in shape.numbers),
        count=len(shape.numbers),
        first=shape.velocities.start,
        last=shape.velocities.stop,
        tolerance='1e-4' if single else '0.0',
        single=str(single).lower(),
        what=' (rad/s, of the velocity)' if single else '',
        judged='rms' if single else 'worst',
    )
    period = made.joint.settings.wrap_period
    counts = 'counts * 1.5339808e-3f' if single else 'counts * 1.5339807878856412e-3'
    checked = (
        'It is computed in float there and in double here: the check passes if the rms difference '
        'of the\nvelocity is at most 1e-4 rad/s.'
        if single
        else 'With the same libm they are equal to the last bit.'
    )
    readme = README.format(
        **names,
        angle=counts,
        unit='rad' if period else 'rad or m',
        wrap=f' It may wrap after {period:.6g} rad, or count turns.' if period else '',
        count=len(samples.stamps),
        check=checked,
        size=size or 'about 1 to 2 thousand',
        size_note='' if size else f' (`sizeof({made.prefix})`)',
    )
    files = {
        f'{made.prefix}.h': made.header,
        'main.c': main,
        'vectors.h': vectors.header(made.prefix, made.joint, samples),
        'CMakeLists.txt': CMAKE.format(**names),
        'README.md': readme,
    }
    try:
        out.mkdir(parents=True)
    except FileExistsError:
        raise UserError(f"'{out}' exists: name another folder, or remove it") from None
    for name, text in files.items():
        whole_file.write_text(out / name, text)


def checked(out: Path) -> tuple[bool, list[str]] | None:
    """Compile and run the check of an exported folder; return (passed, lines), None without cc."""
    compiler = shutil.which('cc') or shutil.which('gcc') or shutil.which('clang')
    if compiler is None:
        return None
    binary = out / '.check'
    try:
        command = [compiler, *FLAGS.split(), str(out / 'main.c'), '-o', str(binary), '-lm']
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            return False, [f'{compiler} refuses main.c: {done.stderr.splitlines()[0]}']
        done = subprocess.run([str(binary)], capture_output=True, text=True)
        return done.returncode == 0, done.stdout.splitlines()
    finally:
        binary.unlink(missing_ok=True)
