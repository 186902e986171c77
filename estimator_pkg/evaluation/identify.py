"""``velocity_estimator identify``: a model's numbers from a recording, judged on its other part."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from estimator_pkg.bags.reader import Bag, open_bag
from estimator_pkg.bags.selection import measurement_topic
from estimator_pkg.bags.series import Series, joint_series
from estimator_pkg.cli import Command
from estimator_pkg.errors import UsageError, UserError, suggestion
from estimator_pkg.evaluation import identify_joint
from estimator_pkg.models import single_joint
from estimator_pkg.models.mechanics import assignments_of
from estimator_pkg.parameters import build, parse_assignments

KNOWN = 'single_joint'
GIVEN = ('torque_constant', 'gear_ratio', 'coulomb_speed', 'period')
UNITS = {'inertia': 'kg m^2', 'damping': 'N m s/rad', 'coulomb': 'N m', 'gravity': 'N m',
         'hanging': 'rad', 'bias': 'N m', 'input_delay': 's'}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    parser.add_argument('bag', metavar='BAG', help='rosbag2 folder, .mcap or .db3 file')
    parser.add_argument('--model', metavar='NAME', default=KNOWN,
                        help=f'which model (so far {KNOWN})')
    parser.add_argument('--out', metavar='YAML',
                        help='parameter file of mechanical_observer to write')
    parser.add_argument('--joint', metavar='NAME', help='which joint, where there are several')
    parser.add_argument('--measurement', metavar='TOPIC',
                        help='joint states with positions and efforts')
    parser.add_argument('--set', metavar='KEY=VALUE', action='append', default=[],
                        help=f'what a recording cannot tell ({", ".join(GIVEN)})')


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Identifies, prints, writes."""
    if parsed.model != KNOWN:
        raise UsageError(f"'identify' knows the model {KNOWN}, not '{parsed.model}'")
    given = parse_assignments(parsed.set)
    for name in given:
        if name not in GIVEN:
            raise UsageError(f"'{name}' is not given but identified, or unknown: "
                             f'{suggestion(name, GIVEN)}')
    fixed = build(single_joint.Parameters, given, owner=f"model '{KNOWN}'")
    out = Path(parsed.out) if parsed.out else None
    if out is not None and out.exists():
        raise UserError(f'{out} exists already')
    with open_bag(parsed.bag) as bag:
        topic = measurement_topic(bag, parsed.measurement)
        name, series = _one_joint(bag, topic, parsed.joint)
    time, position, effort = _clean(series, name, fixed.period)
    constant, gear = fixed.torque_constant, fixed.gear_ratio
    found = identify_joint.identify(time, position, effort * constant * gear,
                                    fixed.coulomb_speed)
    parameters = identify_joint.parameters_of(found, fixed.coulomb_speed, constant, gear,
                                              fixed.period)
    texts = assignments_of(single_joint.MODEL, parameters)
    _print(parsed.bag, name, found)
    if out is not None:
        _write(out, name, texts, found, str(parsed.bag))
        print(f'{out}: parameters of mechanical_observer')
    return {'bag': str(parsed.bag), 'joint': name, 'model': KNOWN, 'values': found.values,
            'stddev': found.deviations, 'explained': found.explained,
            'explained_elsewhere': found.explained_elsewhere, 'residual': found.residual,
            'windows': list(found.windows), 'out': parsed.out}


def _one_joint(bag: Bag, topic: str, wanted: str | None) -> tuple[str, Series]:
    every = joint_series(bag, topic)
    if wanted is None:
        if len(every) > 1:
            raise UsageError(f"topic '{topic}' has several joints: name one with --joint "
                             f'({", ".join(every)})')
        wanted = next(iter(every))
    if wanted not in every:
        raise UserError(f"topic '{topic}' of {bag.path} has no joint '{wanted}': "
                        f'{suggestion(wanted, every)}')
    return wanted, every[wanted]


def _clean(series: Series, name: str, period: float) -> tuple[np.ndarray, ...]:
    """(time [s], position unwrapped, effort), strictly increasing in time."""
    good = np.isfinite(series.position) & np.isfinite(series.effort)
    if np.count_nonzero(good) < 0.5 * len(good) or not good.any():
        raise UserError(f"joint '{name}' has no efforts: identify needs positions and efforts in "
                        'the same messages')
    stamps = series.stamps_ns[good]
    newer = np.concatenate([[True], stamps[1:] > np.maximum.accumulate(stamps)[:-1]])
    position, effort = series.position[good][newer], series.effort[good][newer]
    if period > 0.0:
        position = np.unwrap(position, period=period)
    return (stamps[newer] - stamps[0]) * 1e-9, position, effort


def _print(bag: Any, name: str, found: identify_joint.Identified) -> None:
    print(f'{bag}: {KNOWN}, joint {name}, {found.windows[0]} windows to identify, '
          f'{found.windows[1]} to judge')
    for key, value in found.values.items():
        print(f'  {key} = {value:.5g} +- {found.deviations[key]:.2g} {UNITS[key]}')
    print(f'  explains {100.0 * found.explained:.1f} % of the torque there, '
          f'{100.0 * found.explained_elsewhere:.1f} % in the other part, where '
          f'{found.residual:.3g} N m rms are left')
    if found.explained_elsewhere < 0.5:
        print('  the model explains little of what it was not fitted to: do not trust it beyond '
              'a low disturbance')


def _write(path: Path, name: str, texts: tuple[str, ...], found: identify_joint.Identified,
           bag: str) -> None:
    lines = [f'# Identified from {Path(bag).name}: {100.0 * found.explained_elsewhere:.1f} % of '
             'the torque explained in the part that was not used.', '/**:', '  ros__parameters:',
             f'    model: {KNOWN}', f'    joints: [{name}]',
             f'    input_delay: {max(0.0, found.values["input_delay"]):.6g}',
             '    model_parameters:']
    for text in texts:
        key = text.partition('=')[0]
        spread = found.deviations.get(key)
        lines.append(f'      - {text}' + (f'  # +- {spread:.2g}' if spread is not None else ''))
    path.write_text('\n'.join(lines) + '\n')


COMMAND = Command("a model's numbers from a recording, judged on its other part", arguments, run)
