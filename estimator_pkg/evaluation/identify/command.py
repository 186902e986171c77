# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator identify``: fit a model's parameters to a recording and validate them."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from estimator_pkg import destination, whole_file
from estimator_pkg.bags import unpacking
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.selection import measurement_topic
from estimator_pkg.cli import Command, add_set
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.evaluation.identify.data import recording
from estimator_pkg.evaluation.identify.fit import DELAY, ROUNDS, FitResult, fit
from estimator_pkg.evaluation.identify.joint import identify
from estimator_pkg.evaluation.identify.model import Unknowns, unknowns
from estimator_pkg.evaluation.identify.pieces import MechanismSamples
from estimator_pkg.evaluation.identify.wheels import NAMES, UNITS, identified
from estimator_pkg.models.load import load
from estimator_pkg.parameters import build, parse_assignments
from estimator_pkg.printable import show
from estimator_pkg.progress import progress
from estimator_pkg.yaml_text import comment, scalar

JOINT_MODEL, WHEELS = 'single_joint', 'wheel_odometry'
LEAST_EXPLAINED = 0.5  # below this explained fraction of held-out motion the model is not trusted


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument('bag', metavar='BAG', help='rosbag2 folder, .mcap or .db3 file')
    parser.add_argument(
        '--model',
        metavar='NAME',
        default=JOINT_MODEL,
        help=f"a model of 'velocity_estimator list models', your own as package.module:Name, or "
        f'{WHEELS} for radius and track of a base on wheels (default {JOINT_MODEL})',
    )
    parser.add_argument(
        '--out', metavar='YAML', help='parameter file of the node that uses the model, to write'
    )
    parser.add_argument(
        '--loops',
        action='store_true',
        help=f'with --model {WHEELS}: the base drives two loops, one to the left and one to the '
        'right, each of one turn and ending where it began; without it a gyro is used',
    )
    parser.add_argument(
        '--distance',
        type=float,
        metavar='M',
        help=f'with --model {WHEELS}: length of the path, with --loops of each loop; or fix radius '
        'or track with --set',
    )
    parser.add_argument(
        '--joint',
        metavar='NAME',
        action='append',
        default=[],
        help="joint to identify; for a mechanism once for each of the model's positions, in order",
    )
    parser.add_argument(
        '--measurement', metavar='TOPIC', help='joint states with positions and efforts'
    )
    add_set(parser, 'fix a parameter of the model at a known value')
    parser.add_argument(
        '--start',
        metavar='KEY=VALUE',
        action='append',
        default=[],
        help='start the fit of a parameter here, if the default is far from the true value',
    )
    unpacking.arguments(parser)


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Fit, print, write; return the results."""
    fixed, start = parse_assignments(parsed.set), parse_assignments(parsed.start)
    out = Path(parsed.out) if parsed.out else None
    if parsed.model == WHEELS:
        return _run_wheels(parsed, fixed, out)
    if parsed.loops or parsed.distance is not None:
        raise UsageError(f'--loops and --distance are for --model {WHEELS}')
    fitted = unknowns(parsed.model, fixed, start)
    _check(out)
    with open_bag(parsed.bag, parsed.unpack_limit) as bag:
        topic = measurement_topic(bag, parsed.measurement)
        samples, names = recording(bag, topic, fitted.make(fitted.start), parsed.joint)
    delay = 0.0
    if parsed.model == JOINT_MODEL:
        fitted, delay = first_guess(samples, fitted, fixed, start)
    with progress('identify', 2 * ROUNDS) as advance:
        found = fit(samples, fitted, delay, advance)
    texts = fitted.texts(found.values[: len(fitted.names)])
    load(parsed.model, texts)  # what is found must pass the checks of every model
    units = (*fitted.units, 's')
    _print(parsed.bag, parsed.model, names, found, units)
    if out is not None:
        _write(out, parsed.model, names, texts, found, str(parsed.bag))
        show(f'{out}: parameters of mechanical_observer')
    return {
        'bag': str(parsed.bag),
        'joints': list(names),
        'model': parsed.model,
        'values': dict(zip(found.names, found.values.tolist())),
        'stddev': dict(zip(found.names, found.deviations.tolist())),
        'explained': found.explained,
        'explained_elsewhere': found.explained_elsewhere,
        'residual': found.residual.tolist(),
        'residual_elsewhere': found.residual_elsewhere.tolist(),
        'pieces': list(found.pieces),
        'out': parsed.out,
    }


def _check(out: Path | None) -> None:
    """Raise UserError unless the file can be made."""
    if out is not None:
        destination.check(out)
        if out.exists():
            raise UserError(f'{out} exists already: choose another file, or remove it first')


def _run_wheels(
    parsed: argparse.Namespace, values: dict[str, Any], out: Path | None
) -> dict[str, Any]:
    """Identify a base on wheels; print, write, return."""
    if parsed.joint or parsed.start:
        raise UsageError(
            f'--joint and --start are not for --model {WHEELS}: name the wheels with --set '
            "'wheels_left=[...]' and 'wheels_right=[...]'"
        )
    _check(out)
    with open_bag(parsed.bag, parsed.unpack_limit) as bag:
        topic = measurement_topic(bag, parsed.measurement)
        lengths, deviations, about = identified(bag, topic, values, parsed.loops, parsed.distance)
    (left, right, track), (of_left, of_right, of_track) = lengths.tolist(), deviations.tolist()
    show(f'{parsed.bag}: {WHEELS} on {topic}')
    for name, value, sigma in zip(NAMES, lengths, deviations):
        show(f'  {name} = {value:.5g} +- {sigma:.2g} m')
    for name, value in about.items():
        show(f'  {name} {value:.3g} {UNITS[name]}')
    if out is not None:
        written = {
            **values,
            'radius': [float(f'{left:.6g}'), float(f'{right:.6g}')],
            'track': float(f'{track:.6g}'),
            'radius_stddev': float(f'{max(of_left / left, of_right / right):.2g}'),
            'track_stddev': float(f'{of_track / track:.2g}'),
        }
        lines = [comment(f'Identified from {Path(parsed.bag).name}; track is the effective one.')]
        lines += [f'{WHEELS}:', '  ros__parameters:']
        lines += [f'    {name}: {scalar(value)}' for name, value in written.items()]
        whole_file.write_text(out, '\n'.join(lines) + '\n')
        show(f'{out}: parameters of {WHEELS}')
    return {
        'bag': str(parsed.bag),
        'model': WHEELS,
        'values': dict(zip(NAMES, lengths.tolist())),
        'stddev': dict(zip(NAMES, deviations.tolist())),
        **about,
        'out': parsed.out,
    }


def first_guess(
    samples: MechanismSamples, unknown: Unknowns, fixed: Mapping[str, Any], start: Mapping[str, Any]
) -> tuple[Unknowns, float]:
    """Return the start of the fit for a single joint, and its torque delay, by the weak form."""
    from estimator_pkg.models.single_joint import Parameters

    known = build(Parameters, {**start, **fixed})
    guess = identify(
        samples.time,
        samples.positions[:, 0],
        samples.inputs[:, 0] * known.torque_constant * known.gear_ratio,
        known.coulomb_speed,
    )
    values = {name: value for name, value in guess.items() if name in unknown.names}
    return (unknowns(JOINT_MODEL, fixed, {**values, **start}), guess[DELAY])


def _print(
    bag: Any, model: str, names: tuple[str, ...], found: FitResult, units: tuple[str, ...]
) -> None:
    show(
        f'{bag}: {model}, {", ".join(names)}; {found.pieces[0]} pieces to identify, '
        f'{found.pieces[1]} to validate'
    )
    for name, value, sigma, unit in zip(found.names, found.values, found.deviations, units):
        show(f'  {name} = {value:.5g} +- {sigma:.2g} {unit}'.rstrip())
    print(
        f'  explains {100.0 * found.explained:.2f} % of the motion beyond constant velocity '
        f'in that part, {100.0 * found.explained_elsewhere:.2f} % in the held-out part'
    )
    for name, here, there in zip(names, found.residual, found.residual_elsewhere):
        show(f'  {name}: residual {here:.3g} rms in that part, {there:.3g} in the held-out part')
    if found.explained_elsewhere < LEAST_EXPLAINED:
        print(
            '  the model explains little of the held-out motion: do not rely on it; use a low '
            'disturbance bandwidth only'
        )


def _write(
    path: Path,
    model: str,
    names: tuple[str, ...],
    texts: tuple[str, ...],
    found: FitResult,
    bag: str,
) -> None:
    deviations = dict(zip(found.names, found.deviations))
    values = dict(zip(found.names, found.values))
    delay = float(f'{max(0.0, float(values.get(DELAY, 0.0))):.6g}')
    lines = [
        comment(
            f'Identified from {Path(bag).name}: {100.0 * found.explained_elsewhere:.2f} % '
            'of the motion beyond constant'
        ),
        comment('velocity explained in the held-out part.'),
        '/**:',
        '  ros__parameters:',
        f'    model: {scalar(model)}',
        f'    joints: {scalar(names)}',
        f'    input_delay: {scalar(delay)}',
        '    model_parameters:',
    ]
    for text in texts:
        deviation = deviations.get(text.partition('=')[0], np.nan)
        lines.append(
            f'      - {scalar(text)}'
            + (f'  # +- {deviation:.2g}' if np.isfinite(deviation) else '')
        )
    whole_file.write_text(path, '\n'.join(lines) + '\n')


COMMAND = Command(
    "identify a model's parameters, validated on held-out data",
    arguments,
    run,
    examples=(
        (
            'bags/dfki_simple_pendulum/system_identification_300hz --out joint.yaml',
            'inertia, friction and gravity of a joint, from positions and efforts',
        ),
        ('BAG --joint elbow --set inertia=0.02', 'one joint of several, with a known parameter'),
        (
            'BAG --model wheel_odometry --set track=0.5 --out base.yaml',
            'the radii of a base on wheels, from a drive with a gyro',
        ),
    ),
)
