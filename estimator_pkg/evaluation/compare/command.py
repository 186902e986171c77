"""``velocity_estimator evaluate``: estimates against the truth that a bag carries, or against
an off-line reference where there is none.
"""

from __future__ import annotations

import argparse
import contextlib
import math
from typing import Any

from estimator_pkg import interrupts
from estimator_pkg.bags import unpacking
from estimator_pkg.cli import Command
from estimator_pkg.errors import UsageError
from estimator_pkg.evaluation.compare import asked
from estimator_pkg.evaluation.compare.comparison import Comparison, compare
from estimator_pkg.evaluation.compare.many import LeftOut, expanded, on_each
from estimator_pkg.evaluation.compare.words import describe
from estimator_pkg.evaluation.options import AUTO, MEASUREMENT, SMOOTHER, TRUTH, Options
from estimator_pkg.evaluation.report import plot
from estimator_pkg.evaluation.report.full_data import FullData
from estimator_pkg.evaluation.report.page import Report
from estimator_pkg.evaluation.workers import workers
from estimator_pkg.printable import printable, show


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    parser.add_argument(
        'bags',
        nargs='+',
        metavar='BAG',
        help='bag folder, .mcap or .db3 file, or a folder with bags in it',
    )
    parser.add_argument(
        '--measurement',
        metavar='TOPIC',
        help='JointState with the measured positions (default: the only one '
        f'that is neither truth nor estimate, else {MEASUREMENT})',
    )
    parser.add_argument(
        '--angle',
        metavar='TOPIC:FIELD',
        help='the measurement is a number in messages of any type, as of replay',
    )
    parser.add_argument(
        '--truth', metavar='TOPIC', help=f'JointState with the true velocities (default {TRUTH})'
    )
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
        help='run this observer on the measurement, at its defaults but for --set '
        "and --params; repeatable, or 'all' for those of single angles",
    )
    parser.add_argument(
        '--params',
        metavar='YAML',
        help='parameter file of the node of the --observer; one that names an '
        'observer holds for that one alone',
    )
    parser.add_argument(
        '--set',
        metavar='KEY=VALUE',
        action='append',
        default=[],
        help='set a parameter of every --observer that has it; repeatable',
    )
    parser.add_argument(
        '--skip',
        type=float,
        default=0.0,
        metavar='S',
        help='leave out so many seconds at the beginning',
    )
    parser.add_argument(
        '--wrap-period',
        type=float,
        default=2.0 * math.pi,
        metavar='RAD',
        help='period of the positions; 0 for prismatic joints (default 2 pi)',
    )
    parser.add_argument(
        '--correct-reference',
        action='store_true',
        help="take the truth's own lag and bias, as fitted to the measured position, off it first",
    )
    parser.add_argument(
        '--reference',
        choices=(AUTO, 'truth', SMOOTHER),
        default=AUTO,
        help='what velocities are compared with: the truth in the bag, or an '
        'off-line smoother of the measured positions (default: the smoother '
        'where there is no truth)',
    )
    parser.add_argument(
        '--html',
        metavar='FILE',
        help='write one page with tables, plots that zoom and what to do next',
    )
    parser.add_argument(
        '--data', metavar='FILE', help='write every sample that was compared (.npz, for numpy.load)'
    )
    unpacking.arguments(parser)
    parser.add_argument(
        '--jobs', type=int, default=1, metavar='N', help='local processes, for many bags'
    )
    parser.add_argument('--scheduler', metavar='ADDRESS', help='a Dask scheduler, in their place')
    parser.add_argument('--plot', metavar='FILE', help='draw velocities and errors (PNG, SVG, PDF)')


def options(parsed: argparse.Namespace) -> Options:
    """The arguments as `Options`; raises UsageError."""
    if not (math.isfinite(parsed.skip) and parsed.skip >= 0.0):
        raise UsageError('--skip must be a time of 0 s or more')
    if not (math.isfinite(parsed.wrap_period) and parsed.wrap_period >= 0.0):
        raise UsageError('--wrap-period must be an angle of 0 or more')
    observers = tuple(asked.entries(parsed.observer, parsed.params, parsed.set))
    return Options(
        parsed.measurement,
        parsed.truth,
        tuple(parsed.estimate),
        observers,
        parsed.skip,
        parsed.wrap_period,
        parsed.correct_reference,
        parsed.reference,
        parsed.angle,
        parsed.unpack_limit,
    )


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Compares, prints, draws."""
    chosen = options(parsed)
    if parsed.plot:
        plot.check(parsed.plot)
    bags = expanded(parsed.bags)
    result: dict[str, Any] = {}
    drawn: list[Comparison] = []
    left_out: list[LeftOut] = []
    interrupted = False
    with contextlib.ExitStack() as stack:
        run_many = stack.enter_context(workers(parsed.jobs, parsed.scheduler))
        page = (
            stack.enter_context(Report(parsed.html, len(bags), chosen.wrap_period, parsed.data))
            if parsed.html
            else None
        )
        data = stack.enter_context(FullData(parsed.data)) if parsed.data else None
        try:
            for comparison in on_each(run_many, compare, bags, chosen, left_out=left_out):
                with interrupts.gently():  # a bag is judged as a whole or not at all
                    told = describe(comparison)
                    print(told + '\n')
                    result[comparison.bag] = comparison.as_dict()
                    if data is not None:
                        data.add(comparison)
                    if page is not None:
                        said = page.add(comparison)
                        result[comparison.bag]['findings'] = said
                        lines = told.split('\n')
                        show(*(f'- {each}' for each in said if printable(each) not in lines), '')
                    if parsed.plot:
                        drawn.append(comparison)
                if interrupts.came() and len(result) < len(bags):
                    raise KeyboardInterrupt
        except KeyboardInterrupt:
            if not result:
                raise
            interrupted = True
            interrupts.say(f'interrupted: {len(result)} of {len(bags)} bags are judged')
        interrupts.finish()
        if page is not None:
            page.leave_out(left_out)
    if parsed.html:
        show(f'page: {parsed.html}')
    if parsed.data:
        show(f'data: {parsed.data}')
    if parsed.plot:
        plot.draw(drawn, parsed.plot)
        show(f'plot: {parsed.plot}')
    return {
        'bags': result,
        'interrupted': interrupted,
        'left_out': {each.path: each.why for each in left_out},
    }


COMMAND = Command(
    'estimates against truth: errors, delay, noise, samples used and dropped', arguments, run
)
