# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator evaluate``: compare estimates with the truth in a bag, or with an off-line
reference if there is none.
"""

from __future__ import annotations

import argparse
from typing import Any

from estimator_pkg import destination, interrupts
from estimator_pkg.bags import log_file, unpacking
from estimator_pkg.cli import Command, add_set
from estimator_pkg.evaluation.compare import requested
from estimator_pkg.evaluation.compare.description import describe
from estimator_pkg.evaluation.compare.evaluate import Comparison, evaluate
from estimator_pkg.evaluation.compare.many import LeftOut, expanded, on_each
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.options import (
    AUTO,
    MEASUREMENT,
    SMOOTHER,
    check_joints,
    check_window,
    joint_arguments,
    options_of,
    truth_argument,
    window_arguments,
    worker_arguments,
)
from estimator_pkg.evaluation.report import files
from estimator_pkg.evaluation.text import wrapped
from estimator_pkg.evaluation.workers import workers
from estimator_pkg.observers import DEFAULT
from estimator_pkg.printable import printable, show


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        'bags',
        nargs='+',
        metavar='BAG',
        help='bag folder, .mcap or .db3 file, a folder with bags in it, or a log',
    )
    parser.add_argument(
        '--measurement',
        metavar='TOPIC',
        help='JointState with the measured positions (default: the only one '
        f'that is neither truth nor estimate, else {MEASUREMENT})',
    )
    log_file.arguments(parser)
    truth_argument(parser)
    parser.add_argument(
        '--estimate',
        metavar='TOPIC',
        action='append',
        default=[],
        help="JointState with estimates, repeatable (default: all '.../estimate')",
    )
    parser.add_argument(
        '--observer',
        metavar='NAME',
        action='append',
        default=[],
        help='run this observer on the measurement, at its defaults except for --set '
        "and --params; repeatable, or 'all' for those of single angles (default: recorded "
        f'estimates; without them, or with --set or --params, {DEFAULT})',
    )
    parser.add_argument(
        '--params',
        metavar='YAML',
        help='parameter file of the node of the --observer; one that names an observer applies to '
        'that one only',
    )
    add_set(parser, 'set a parameter of every --observer that has it; repeatable')
    window_arguments(parser)
    parser.add_argument(
        '--correct-reference',
        action='store_true',
        default=None,
        help="remove the truth's own lag and bias, fitted to the measured position, first "
        '(default: its lag, where that is certain)',
    )
    parser.add_argument(
        '--no-correct-reference',
        dest='correct_reference',
        action='store_false',
        help='compare with the truth as it is',
    )
    parser.add_argument(
        '--reference',
        choices=(AUTO, 'truth', SMOOTHER),
        default=AUTO,
        help='reference for the velocities: the truth in the bag, or an off-line smoother of the '
        'measured positions (default: the truth, or the smoother if there is none)',
    )
    joint_arguments(parser)
    parser.add_argument(
        '--html', metavar='FILE', help='write a page: tables, zoomable plots, recommendations'
    )
    parser.add_argument(
        '--data', metavar='FILE', help='write every compared sample (.npz, for numpy.load)'
    )
    parser.add_argument(
        '--wide',
        action='store_true',
        help='show every column of the table, in more than 80 characters',
    )
    unpacking.arguments(parser)
    worker_arguments(parser, 'local processes, for many bags')
    parser.add_argument('--plot', metavar='FILE', help='draw velocities and errors (PNG, SVG, PDF)')


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Compare, print, draw; return the results by bag."""
    check_window(parsed)
    columns = log_file.columns(parsed)
    check_joints(parsed)
    observers = requested.entries(parsed.observer, parsed.params, parsed.set)
    chosen = options_of(parsed, observers, columns, parsed.estimate)
    if parsed.plot:
        files.check(parsed.plot)
    if parsed.data:
        destination.check(parsed.data)
    if parsed.html:
        from estimator_pkg.evaluation import plots
        from estimator_pkg.evaluation.report import page
        from estimator_pkg.evaluation.report.findings import findings

        destination.check(parsed.html)
        plots.check()
    bags = expanded(parsed.bags)
    result: dict[str, Any] = {}
    drawn: list[Comparison] = []
    found: dict[str, Any] = {}
    left_out: list[LeftOut] = []
    with workers(parsed.jobs, parsed.scheduler) as run_many:
        every = on_each(run_many, evaluate, bags, chosen, bool(parsed.html), left_out=left_out)
        try:
            for comparison in every:
                with interrupts.gently():  # a bag is evaluated completely or not at all
                    text, bag = (
                        describe(comparison, parsed.wide, chosen.wrap_period),
                        comparison.bag,
                    )
                    print(text + '\n')
                    result[bag] = comparison.as_dict()
                    if parsed.html:
                        found[bag] = findings(comparison, chosen.wrap_period)
                        result[bag]['findings'] = found[bag].sentences
                        said = ' '.join(text.split())
                        new = [each for each in found[bag].sentences if printable(each) not in said]
                        show(*(line for each in new for line in wrapped(f'- {each}')), '')
                    if parsed.html or parsed.plot or parsed.data:
                        drawn.append(comparison)
                if interrupts.came() and len(result) < len(bags):
                    raise KeyboardInterrupt
        except KeyboardInterrupt:
            if not result:
                raise
            interrupts.say(f'interrupted: {len(result)} of {len(bags)} bags are evaluated')
        interrupts.finish()
    if parsed.html:
        ran = chosen.observers or (Entry(DEFAULT, DEFAULT),)
        page.write(parsed.html, drawn, found, ran, chosen.wrap_period, left_out, parsed.data)
        show(f'page: {parsed.html}')
    if parsed.data:
        files.write_samples(parsed.data, drawn)
        show(f'data: {parsed.data}')
    if parsed.plot:
        files.draw(drawn, parsed.plot)
        show(f'plot: {parsed.plot}')
    return {
        'bags': result,
        'interrupted': len(result) + len(left_out) < len(bags),
        'left_out': {each.path: each.why for each in left_out},
    }


COMMAND = Command(
    'compare estimates with the truth: errors, delay, noise',
    arguments,
    run,
    examples=(
        (
            'bags/dfki_simple_pendulum/sac_200hz_multiturn --observer all',
            'every observer of single angles at its defaults',
        ),
        (
            'BAG --observer kalman --set bandwidth_hz=30 --html report.html',
            'one observer and its gains, as a page',
        ),
        ('RECORDED --from 2 --to 10', 'estimates that were recorded, between two and ten seconds'),
    ),
)
