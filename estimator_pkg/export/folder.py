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
FLOAT = (
    'It computes in float, and the package in\ndouble: the rms difference of the velocity '
    'must be at most 1e-4 rad/s.'
)
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
            if (j != 1 && {single}) continue;
            error = fmax(error, off == off ? off : INFINITY);
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
    printf("%d bytes of state\\n", (int)sizeof joint);
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

`{prefix}.h` is the observer `{observer}` of velocity_estimator: guard for stamps and readings,
sensor stage and observer, with the gains that its first lines list. It is C99 and C++17, needs
`<math.h>`, `<stdbool.h>` and `<stdint.h>` only, allocates nothing and has no global state. One
struct `{prefix}` is the whole state of one {thing}. Other gains mean another export.

## Use

```c
#include "{prefix}.h"

static {prefix} state;                    // before the timer starts: {prefix}_init(&state);
volatile {real} velocity;                 // [rad/s]

void TIM3_IRQHandler(void)                // every 1 ms, for example
{{
    static int64_t now_ns;                // 64 bits never overflow
    TIM3->SR = 0;
    now_ns += 1000000;
{read}
    if ({prefix}_update(&state, now_ns, {call})) {{
        {prefix}_estimate estimate;
        {prefix}_get(&state, &estimate);
        if (estimate.status == 1 || estimate.status == 2) {{  // tracking, coasting
            velocity = estimate.velocity;
        }}
    }}
}}
```

Stamps may be of any clock that moves forward and begins above 0: only differences matter. A sample
with a NaN, or with a stamp that is not newer, is counted in `state.counts` and not used.

## Check

    cmake -B build && cmake --build build && ./build/check

or `cc {flags} main.c -o check -lm`,
then `./check`. It compares {count} samples with the estimates of the package. {check}

- Without `-ffp-contract=off` a compiler may fuse a product and a sum, which changes last bits.
  After a decision that depends on one, estimates differ for a while: the check lists such flips.
- Another libm rounds `exp`, `sin`, `erfc` and others otherwise, with the same effect.
  `./check 1e-9` allows it.

## Cost

{cost}
Time and code size on microcontrollers: docs/firmware.md of velocity_estimator. It also shows what
to log, and how to see from the log that all is right.
"""
COUNTS = """\
    static uint16_t last;
    static int32_t counts;
    const uint16_t timer = TIM2->CNT;     // counts of the encoder
    counts += (int16_t)(timer - last);    // right across an overflow of the 16-bit counter
    last = timer;"""
READ = {  # per kind: what reads the sensor, and the arguments of update
    'angle': (COUNTS, 'counts * ({real})(6.283185307179586 / 4096)', 'joint'),
    'drive': (
        '    {real} i_alpha, i_beta, u_alpha, u_beta;  // [A], [V]\n'
        '    read_drive(&i_alpha, &i_beta, &u_alpha, &u_beta);  // yours',
        'i_alpha, i_beta, u_alpha, u_beta',
        'drive',
    ),
}


def write(out: Path, exported: Exported, samples: vectors.Samples) -> tuple[bool, list[str]] | None:
    """Write all files into a new folder, and check the header.

    Returns
    -------
    (passed, lines that the check prints), or None without a C compiler.

    Raises
    ------
    UserError : the folder exists.
    """
    single, joint = exported.float32, exported.joint
    shape = vectors.interface(joint)
    names = {
        'prefix': exported.prefix,
        'observer': joint.observer.name,
        'real': 'float' if single else 'double',
        'flags': FLAGS,
    }
    main = MAIN.format(
        **names,
        readings=shape.readings,
        call=shape.call,
        numbers=',\n            '.join(f'out.{name}' for name in shape.numbers),
        count=len(shape.numbers),
        tolerance='1e-4' if single else '0.0',
        single=str(single).lower(),
        what=' (rad/s, of the velocity)' if single else '',
        judged='rms' if single else 'worst',
    )
    rows = vectors.header(exported.prefix, joint, samples)
    try:
        out.mkdir(parents=True)
    except FileExistsError:
        raise UserError(f"'{out}' exists: name another folder, or remove it") from None
    whole_file.write_text(out / f'{exported.prefix}.h', exported.header)
    whole_file.write_text(out / 'main.c', main)
    whole_file.write_text(out / 'vectors.h', rows)
    whole_file.write_text(out / 'CMakeLists.txt', CMAKE.format(**names))
    done = checked(out)
    read, call, thing = READ[joint.observer.kind]
    readme = README.format(
        **names,
        read=read.replace('{real}', names['real']),
        call=call.replace('{real}', names['real']),
        thing=thing,
        count=len(samples.stamps),
        check=FLOAT if single else 'With the same libm they are equal\nto the last bit.',
        cost='\n'.join(['On the machine that wrote it:', '', *(f'    {x}' for x in done[1]), ''])
        if done
        else f'`sizeof({exported.prefix})` is the memory that it needs.',
    )
    whole_file.write_text(out / 'README.md', readme)
    return done


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
