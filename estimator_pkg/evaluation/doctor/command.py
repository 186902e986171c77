# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``velocity_estimator doctor``: what is wrong with a measurement, and what to do with it."""

from __future__ import annotations

import argparse
import contextlib
import io
import math
import time
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from estimator_pkg import destination, streams, whole_file
from estimator_pkg.bags import log_file, unpacking
from estimator_pkg.bags.reader import Bag, open_bag
from estimator_pkg.bags.selection import ESTIMATE_SUFFIXES, TRUTH_NAMESPACE
from estimator_pkg.bags.wiring import Setup, wired
from estimator_pkg.cli import Command, add_set
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.evaluation import plots
from estimator_pkg.evaluation.checks.row import WARN, Check, Finding
from estimator_pkg.evaluation.compare import requested
from estimator_pkg.evaluation.doctor import drive, report, second
from estimator_pkg.evaluation.doctor.choice import Choice, choose
from estimator_pkg.evaluation.doctor.examine import Examined, examine, is_drive, readings
from estimator_pkg.evaluation.options import (
    PERIOD_KEY,
    WRAP_PERIOD,
    check_joints,
    check_window,
    joint_arguments,
    window_arguments,
    wrap_periods,
)
from estimator_pkg.evaluation.text import started, wrapped
from estimator_pkg.evaluation.tuning.live import recorded
from estimator_pkg.messages.joint_state import TYPE
from estimator_pkg.parameters import parse_assignments
from estimator_pkg.printable import show
from estimator_pkg.progress import progress
from estimator_pkg.streams.contract import Request
from estimator_pkg.streams.drive import DriveStream

APPEAR = 5.0  # longest wait for a topic of joint states [s]
ANOTHER_TOPIC = 0.5  # and for another one after the first [s]
TOPIC = Check(
    'topic',
    'whether the topic is a measurement',
    'an estimate of ours',
    {
        'ours': '{topic} is {of}, not a measurement -> name the topic of the driver with '
        '--measurement'
    },
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        'bag',
        nargs='?',
        metavar='BAG',
        help='bag folder, .mcap or .db3 file, or a log; the exit code is 1 if a check FAILs',
    )
    parser.add_argument(
        '--live',
        type=float,
        metavar='SECONDS',
        help='listen to the running topic for SECONDS, instead of a bag',
    )
    parser.add_argument(
        '--measurement',
        metavar='TOPIC',
        help='JointState with the measured positions (default: the only one, else /joint_states)',
    )
    log_file.arguments(parser)
    parser.add_argument(
        '--params', metavar='YAML', help='motor data of a drive: parameter file of pmsm_observer'
    )
    add_set(
        parser,
        'a parameter of joint_observer, such as counts_per_revolution, or of pmsm_observer, '
        'such as resistance; repeatable',
    )
    window_arguments(parser)
    joint_arguments(parser)
    parser.add_argument(
        '--out',
        metavar='YAML',
        help='write a parameter file for joint_observer, without gains of joints whose checks FAIL',
    )
    parser.add_argument('--html', metavar='FILE', help='write the report as a page with plots')
    unpacking.arguments(parser)


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Check, print and write; return findings and verdict by joint."""
    if (parsed.bag is None) == (parsed.live is None):
        raise UsageError('name a bag, or listen with --live SECONDS: one of the two')
    parsed.columns = log_file.columns(parsed)
    check_joints(parsed)
    check_window(parsed)
    for path in (parsed.out, parsed.html):
        if path is not None:
            destination.check(path)
    if parsed.html:
        plots.check()
    if parsed.bag is not None:
        return _examined(parsed, parsed.bag, parsed.bag)
    if not 0.5 <= parsed.live <= 3600.0:
        raise UsageError(f'--live is {parsed.live:g} s: it must be between 0.5 and 3600 s')
    topics, made = _running(parsed.measurement or (parsed.angle or '').partition(':')[0])
    with contextlib.ExitStack() as stack:
        with contextlib.redirect_stdout(io.StringIO()):  # where the bag is does not matter
            path = stack.enter_context(recorded(topics[:-1], topics[-1], parsed.live))
        return _examined(parsed, path, f'{", ".join(topics)}, {parsed.live:g} s live', made)


def _drive(parsed: argparse.Namespace, bag: Bag, origin: str) -> dict[str, Any]:
    """Examine a drive: the same for currents and voltages."""
    (entry,) = requested.entries([drive.PMSM], parsed.params, parsed.set)
    settings = dict(entry.values)
    values = {'observer': drive.PMSM, **drive.ANY, **settings}
    chosen = wired(DriveStream, bag, values, Request(None, None))
    found = drive.examine(bag, chosen, drive.needed(settings))
    show(*wrapped(f'{origin}: {", ".join(topic.name for topic in chosen.topics if topic)}'), '')
    missing = all(each.check == drive.MOTOR_DATA.name for each in found.failed)  # a form to fill in
    parameters = drive.as_yaml(found, origin, chosen.input | settings) if missing else ''
    return _reported(parsed, [found], Choice(drive.PMSM), origin, parameters, chosen)


def _reported(
    parsed: argparse.Namespace,
    examined: Sequence[Examined],
    choice: Choice,
    origin: str,
    parameters: str,
    setup: Setup,
) -> dict[str, Any]:
    """Print the report, write the requested files, and return the result for ``--json``.

    The names of the files are printed, and how to start the node.
    """
    print(report.text(examined, choice))
    if not parameters:
        checks = dict.fromkeys(found.check for each in examined for found in each.refused)
        none = f'{parsed.out} is not written' if parsed.out else 'No parameter file'
        show('', *wrapped(f'{none}: mend what FAILs first: {", ".join(checks)}'))
    elif parsed.out:
        faulty = [each.readings.name for each in examined if each.refused]
        if faulty:
            left = f'{", ".join(faulty)}: no gains in it until what FAILs is mended'
            show('', *wrapped(f'{parsed.out}: {left}'))
        whole_file.write_text(parsed.out, parameters)
        node = streams.named(setup.kind).NODE
        show('', f'parameters: {parsed.out}', *started(node, parsed.out, setup.remaps))
    else:
        show('', 'A parameter file of this: add --out params.yaml')
    if parsed.html:
        whole_file.write_text(parsed.html, report.page(examined, choice, origin, parameters))
        show(f'page: {parsed.html}')
    return {
        'origin': origin,
        'topic': setup.topics[0].name,
        'observer': choice.observer,
        'tuned': choice.tuned,
        'parameters': parameters,
        'joints': {
            each.readings.name: {
                'findings': [found.as_dict() for found in each.findings],
                'gains': dict(choice.gains.get(each.readings.name, {})),
                'verdict': None if each.answer is None else each.answer.verdict.as_dict(),
            }
            for each in examined
        },
        'ok': not any(each.failed for each in examined),
    }


def _examined(
    parsed: argparse.Namespace,
    path: str,
    origin: str,
    made: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, Any]:
    """Examine the readings of a bag; `made`: topic -> node of ours that publishes it."""
    with open_bag(path, parsed.unpack_limit, parsed.columns) as bag:
        if is_drive(bag, parsed.measurement, parsed.angle):
            if parsed.begin or parsed.end < math.inf:
                raise UsageError('--from and --to are for joints: omit them for a drive')
            return _drive(parsed, bag, origin)
        if parsed.params:
            raise UsageError(
                '--params is for drives: use --set for the parameters of joint_observer'
            )
        settings = parse_assignments(parsed.set)
        if 'observer' in settings:
            raise UsageError('--set observer: doctor compares all observers, so omit it')
        period, _ = wrap_periods(parsed.wrap_period, [settings])
        with progress(f'{origin}: reading', None):
            request = Request(parsed.measurement, parsed.angle)
            values = {PERIOD_KEY: period, **settings}
            chosen = wired(streams.named(streams.USUAL), bag, values, request)
            joints = readings(bag, chosen, parsed.begin, parsed.end)
            topic = chosen.topics[0].name
            others = second.candidates(bag)
    examined = []
    with progress(f'{origin}: joints', len(joints)) as advance:
        for each in joints:
            may = [other for other in others if other.may_measure(each.name, topic)]
            found = examine(each, parsed.motion_hz, topic, may)
            found.findings[:0] = _own(topic, made)
            examined.append(found)
            advance(1)
    choice = choose(
        {each.readings.name: each.answer for each in examined if each.answer is not None}
    )
    head = f'{origin}: {topic}, {len(joints)} joint{"s" * (len(joints) > 1)}'
    show(*wrapped(head), '')
    settings = chosen.input | settings
    if period != WRAP_PERIOD:
        settings.setdefault(PERIOD_KEY, period)
    if len(examined) == 1 and examined[0].readings.free:
        settings[PERIOD_KEY] = examined[0].readings.period
    parameters = report.as_yaml(examined, choice, origin, settings, chosen.remaps)
    return _reported(parsed, examined, choice, origin, parameters, chosen)


def _own(topic: str, made: Mapping[str, str]) -> list[Finding]:
    """Return the finding on a topic that is an estimate of ours; [] for any other."""
    if topic not in made and not topic.endswith(ESTIMATE_SUFFIXES):
        return []
    of = f'the estimate of {made[topic]}' if topic in made else 'an estimate of ours'
    return [TOPIC.found(WARN, ['ours'], {}, {'topic': topic, 'of': of})]


def _running(named: str) -> tuple[list[str], dict[str, str]]:
    """Return the running topics that may be a measurement, and topic -> node of ours that makes it.

    Parameters
    ----------
    named : the user's choice; '': topics of joint states, and estimates of ours only if there is
        nothing else.

    Raises
    ------
    UserError : none appears, or ROS cannot start.
    """
    from estimator_pkg.bags.live import live

    with live('doctor') as here:
        end = time.monotonic() + APPEAR
        found: list[str] = []
        while time.monotonic() < end and not here.stopping:
            here.spin(0.05)
            names = [
                name
                for name, types in here.node.get_topic_names_and_types()
                if (
                    name == named
                    if named
                    else TYPE in types
                    and TRUTH_NAMESPACE not in f'{name}/'
                    and not name.endswith(ESTIMATE_SUFFIXES)
                )
                and here.node.count_publishers(name)
            ]
            if names and not found:
                end = time.monotonic() + ANOTHER_TOPIC
            found = names
        if here.stopping:
            raise KeyboardInterrupt
        made = here.makers(found)
    if not found and not named:
        raise UserError(
            f'nobody publishes joint states ({TYPE}) within {APPEAR:g} s: start the driver, check '
            'ROS_DOMAIN_ID, or name a number with --angle TOPIC:FIELD'
        )
    return [name for name in found if name not in made] or found or [named], made


COMMAND = Command(
    'find faults of a measurement, and the observer and gains for it',
    arguments,
    run,
    examples=(
        (
            'bags/dfki_double_pendulum/sys_id_500hz --out params.yaml',
            'what is wrong with a recording, and parameters for the node',
        ),
        ('--live 10', 'listen to the running joint states for ten seconds'),
        (
            'bags/vicon/yawbag --angle /vicon/Group466CF/Group466CF/pose:pose.orientation.yaw',
            'a number in messages of any type',
        ),
        (
            'BAG --motion-hz 5 --html report.html',
            'the joints move at up to 5 Hz; the report as a page',
        ),
    ),
)
