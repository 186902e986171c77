# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The files next to an exported header: its check, its build and its README."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

from estimator_pkg import whole_file
from estimator_pkg.errors import UserError
from estimator_pkg.export import filled, template, vectors
from estimator_pkg.export.header import Exported

FLAGS = '-O2 -std=c99 -Wall -Wextra -ffp-contract=off -fwrapv'
FLOAT = (
    'It computes in float, and the package in\ndouble: the rms difference of the velocity '
    'must be at most 1e-4 rad/s.'
)
READ = {  # per kind: what reads the sensor, and the arguments of update
    'angle': ('counts * (@REAL@)(6.283185307179586 / 4096)', 'joint'),
    'drive': ('i_alpha, i_beta, u_alpha, u_beta', 'drive'),
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
    shape, kind = vectors.interface(joint), joint.observer.kind
    values = {
        'PREFIX': exported.prefix,
        'OBSERVER': joint.observer.name,
        'REAL': 'float' if single else 'double',
        'FLAGS': FLAGS,
        'READINGS': shape.readings,
        'READING': shape.call,
        'NUMBERS': ',\n            '.join(f'out.{name}' for name in shape.numbers),
        'COUNT': len(shape.numbers),
        'TOLERANCE': '1e-4' if single else '0.0',
        'SINGLE': str(single).lower(),
        'WHAT': ' (rad/s, of the velocity)' if single else '',
        'JUDGED': 'rms' if single else 'worst',
        'SAMPLES': len(samples.stamps),
        'CHECK': FLOAT if single else 'With the same libm they are equal\nto the last bit.',
    }
    call, values['THING'] = READ[kind]
    values['CALL'] = filled(call, values)
    values['READ'] = template(f'read_{kind}.c', values).rstrip()
    files = {f'{exported.prefix}.h': exported.header}
    files['vectors.h'] = vectors.header(exported.prefix, joint, samples)
    files |= {name: template(name, values) for name in ('main.c', 'CMakeLists.txt')}
    try:
        out.mkdir(parents=True)
    except FileExistsError:
        raise UserError(f"'{out}' exists: name another folder, or remove it") from None
    for name, text in files.items():
        whole_file.write_text(out / name, text)
    done = checked(out)
    values['COST'] = f'`sizeof({exported.prefix})` is the memory that it needs.'
    if done:
        lines = (f'    {line}' for line in done[1])
        values['COST'] = '\n'.join(['On the machine that wrote it:', '', *lines, ''])
    whole_file.write_text(out / 'README.md', template('README.md', values))
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
