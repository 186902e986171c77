# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator identify``: fit a model's parameters to a recording and validate them."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from estimator_pkg import destination, whole_file
from estimator_pkg.bags import unpacking
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.selection import measurement_topic
from estimator_pkg.cli import Command, add_set
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.evaluation import parameter_file
from estimator_pkg.evaluation.identify.data import recording
from estimator_pkg.evaluation.identify.fit import DELAY, ROUNDS, fit
from estimator_pkg.evaluation.identify.joint import first_guess
from estimator_pkg.evaluation.identify.model import unknowns
from estimator_pkg.evaluation.identify.wheels import NAMES, UNITS, identified
from estimator_pkg.models.load import load
from estimator_pkg.models.single_joint import Parameters
from estimator_pkg.parameters import build, parse_assignments
from estimator_pkg.printable import show
from estimator_pkg.progress import progress

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
    if parsed.out:
        destination.check(parsed.out)
        if Path(parsed.out).exists():
            raise UserError(f'{parsed.out} exists already: choose another file, or remove it first')
    of_base = parsed.model == WHEELS
    if of_base and (parsed.joint or parsed.start):
        raise UsageError(
            f'--joint and --start are not for --model {WHEELS}: name the wheels with --set '
            "'wheels_left=[...]' and 'wheels_right=[...]'"
        )
    if not of_base and (parsed.loops or parsed.distance is not None):
        raise UsageError(f'--loops and --distance are for --model {WHEELS}')
    result, lines, node, written = (_of_base if of_base else _of_model)(parsed, fixed, start)
    show(*lines)
    if parsed.out:
        name = Path(parsed.bag).name
        head = [f'Identified from {name}', *lines[1:]]
        text = parameter_file.as_yaml(head, written, node=WHEELS if of_base else '/**')
        whole_file.write_text(Path(parsed.out), text)
        show(f'{parsed.out}: parameters of {node}')
    return {'bag': str(parsed.bag), 'model': parsed.model, **result, 'out': parsed.out}


Found = tuple[dict[str, Any], list[str], str, dict[str, Any]]  # result, lines, node, parameters


def _of_model(
    parsed: argparse.Namespace, fixed: Mapping[str, Any], start: Mapping[str, Any]
) -> Found:
    """Identify a mechanism."""
    fitted = unknowns(parsed.model, fixed, start)
    with open_bag(parsed.bag, parsed.unpack_limit) as bag:
        topic = measurement_topic(bag, parsed.measurement)
        samples, names = recording(bag, topic, fitted.make(fitted.start), parsed.joint)
    delay = 0.0
    if parsed.model == JOINT_MODEL:
        guess = first_guess(samples, build(Parameters, {**start, **fixed}))
        delay = guess.pop(DELAY)
        guess = {name: value for name, value in guess.items() if name in fitted.names}
        fitted = unknowns(JOINT_MODEL, fixed, {**guess, **start})
    with progress('identify', 2 * ROUNDS) as advance:
        found = fit(samples, fitted, delay, advance)
    texts = fitted.texts(found.values[: len(fitted.names)])
    load(parsed.model, texts)  # what is found must pass the checks of every model
    values = dict(zip(found.names, found.values.tolist()))
    deviations = dict(zip(found.names, found.deviations.tolist()))
    units = dict(zip(found.names, (*fitted.units, 's')))
    lines = [
        f'{parsed.bag}: {parsed.model}, {", ".join(names)}; {found.pieces[0]} pieces to identify, '
        f'{found.pieces[1]} to validate',
        *(_shown(name, values[name], deviations[name], units[name]) for name in values),
        f'  explains {100.0 * found.explained:.2f} % of the motion beyond constant velocity '
        f'in that part, {100.0 * found.explained_elsewhere:.2f} % in the held-out part',
    ]
    for name, here, there in zip(names, found.residual, found.residual_elsewhere):
        lines.append(
            f'  {name}: residual {here:.3g} rms in that part, {there:.3g} in the held-out part'
        )
    if found.explained_elsewhere < LEAST_EXPLAINED:
        lines.append(
            '  the model explains little of the held-out motion: do not rely on it; use a low '
            'disturbance bandwidth only'
        )
    result = {
        'joints': list(names),
        'values': values,
        'stddev': deviations,
        'explained': found.explained,
        'explained_elsewhere': found.explained_elsewhere,
        'residual': found.residual.tolist(),
        'residual_elsewhere': found.residual_elsewhere.tolist(),
        'pieces': list(found.pieces),
    }
    written = {
        'model': parsed.model,
        'joints': names,
        'input_delay': float(f'{max(0.0, values.get(DELAY, 0.0)):.6g}'),
        'model_parameters': texts,
    }
    return result, lines, 'mechanical_observer', written


def _of_base(
    parsed: argparse.Namespace, fixed: Mapping[str, Any], start: Mapping[str, Any]
) -> Found:
    """Identify a base on wheels."""
    with open_bag(parsed.bag, parsed.unpack_limit) as bag:
        topic = measurement_topic(bag, parsed.measurement)
        lengths, deviations, about = identified(bag, topic, fixed, parsed.loops, parsed.distance)
    (left, right, track), (of_left, of_right, of_track) = lengths.tolist(), deviations.tolist()
    lines = [
        f'{parsed.bag}: {WHEELS} on {topic}',
        *(_shown(*each, 'm') for each in zip(NAMES, lengths, deviations)),
        '  ' + ', '.join(f'{name} {value:.3g} {UNITS[name]}' for name, value in about.items()),
    ]
    written = {
        **fixed,
        'radius': [float(f'{left:.6g}'), float(f'{right:.6g}')],
        'track': float(f'{track:.6g}'),
        'radius_stddev': float(f'{max(of_left / left, of_right / right):.2g}'),
        'track_stddev': float(f'{of_track / track:.2g}'),
    }
    found = {
        'values': dict(zip(NAMES, lengths.tolist())),
        'stddev': dict(zip(NAMES, deviations.tolist())),
        **about,
    }
    return found, lines, WHEELS, written


def _shown(name: str, value: float, deviation: float, unit: str) -> str:
    return f'  {name} = {value:.5g} +- {deviation:.2g} {unit}'.rstrip()


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
