# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator export``: a tuned observer as C99 header, or in a controller."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Any

import numpy as np

from estimator_pkg import streams
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.selection import measurement_topic
from estimator_pkg.bags.series import joint_series
from estimator_pkg.bags.wiring import parameters
from estimator_pkg.cli import Command, add_set
from estimator_pkg.errors import UsageError, UserError, suggestion
from estimator_pkg.export import folder, ros2_control, vectors
from estimator_pkg.export.header import FAMILIES, SIZES, exported
from estimator_pkg.parameters import parse_assignments
from estimator_pkg.printable import show


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument('observer', metavar='OBSERVER', help="see 'velocity_estimator list'")
    parser.add_argument('--out', required=True, metavar='DIR', help='folder to make')
    parser.add_argument('--params', metavar='YAML', help='parameter file of the node, as of tune')
    add_set(parser, 'set a parameter (may be repeated)')
    parser.add_argument(
        '--joint',
        metavar='NAME',
        help='joint whose parameters are used, and after which the header is named; with --bag, '
        'the joint in it (default: its only one)',
    )
    parser.add_argument(
        '--float32', action='store_true', help='compute in float, for a small floating-point unit'
    )
    parser.add_argument(
        '--ros2-control',
        action='store_true',
        help='write a package with a controller of ros2_control that runs the observer',
    )
    parser.add_argument('--name', help='with --ros2-control: name of package and controller')
    parser.add_argument(
        '--bag',
        metavar='BAG',
        help=f'check the header on its first {vectors.COUNT} samples (default: a simulated motion)',
    )


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Write the folder, check it if there is a C compiler, and return what was written."""
    out = Path(parsed.out)
    if out.exists():
        raise UserError(f"'{out}' exists: name another folder, or remove it")
    stream = streams.of_observer(parsed.observer)
    if stream.KIND not in FAMILIES:
        raise UsageError(f"'{parsed.observer}' cannot be exported: {SIZES}")
    assignments = parse_assignments(parsed.set)
    values = parameters(stream, parsed.params, assignments, parsed.observer)
    if parsed.ros2_control or parsed.name is not None:
        return ros2_control.run(parsed, out, stream, values)
    configuration = stream.of(values).bank.configuration
    gains, settings = configuration.for_joint(parsed.joint or '')
    prefix = re.sub(r'\W+', '_', (parsed.joint or parsed.observer).lower(), flags=re.ASCII)
    prefix = f'joint_{prefix}' if prefix[:1].isdigit() else prefix
    kind = configuration.observer.kind
    period = float(values.get('sample_period', 0.0))
    made = exported(configuration.observer, gains, settings, prefix, parsed.float32, period)
    if parsed.bag is None:
        samples = vectors.simulated(made.joint)
    elif kind == 'angle':
        samples = _recorded(parsed)
    else:
        raise UsageError(f"--bag is for observers of one angle, not '{parsed.observer}': omit it")
    samples = vectors.with_faults(samples)
    done = folder.write(out, made, samples)
    lines = len(made.header.splitlines())
    print(f'{out / prefix}.h: {parsed.observer}, {lines} lines of C99')
    passed, said = done or (None, ['no C compiler here: main.c is not run'])
    print(*said, sep='\n')
    if passed is False and parsed.float32:
        remedy = 'use double'
        if getattr(made.joint.design, 'estimated', False):
            remedy = (
                f'{parsed.observer} learns the noise from the innovation, which float changes: add '
                '--set quantum=STEP (2 pi / counts) or --set bandwidth_hz=HZ, or use double'
            )
        show(f'float32 is not within 1e-4 rad/s of double with these gains: {remedy}')
    return {
        'observer': parsed.observer,
        'out': str(out),
        'header': f'{prefix}.h',
        'prefix': prefix,
        'lines': lines,
        'samples': len(samples.stamps),
        'passed': passed,
        'check': said,
        'ok': passed is not False or parsed.float32,
    }


def _recorded(parsed: argparse.Namespace) -> vectors.Samples:
    """Return the first samples of the joint in the bag."""
    with open_bag(parsed.bag) as bag:
        found = joint_series(bag, measurement_topic(bag))
        joint = parsed.joint or next(iter(found))
        if joint not in found:
            raise UsageError(
                f"joint '{joint}' is not in {parsed.bag}: {suggestion(joint, list(found))}"
            )
        if parsed.joint is None and len(found) > 1:
            raise UsageError(
                f'{parsed.bag} has the joints {", ".join(found)}: choose one with --joint'
            )
        series = found[joint]
    rows = slice(vectors.COUNT)
    return vectors.Samples(series.stamps_ns[rows], np.array(series.position[rows])[:, None])


COMMAND = Command(
    summary='write a tuned observer as a C99 header, for firmware and C++',
    arguments=arguments,
    run=run,
    examples=(
        ('edge_adaptive --out firmware', 'the default observer with its default gains'),
        (
            'edge_adaptive --ros2-control --name arm_velocity --out src/arm_velocity',
            'a controller of ros2_control',
        ),
        (
            'kalman --params tuned.yaml --joint elbow --bag drive.mcap --out elbow --float32',
            'gains that tune found, in float, checked on the bag',
        ),
    ),
)
