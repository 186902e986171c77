# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The command ``demo``: two nodes over real DDS for ten seconds, recorded and evaluated."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import shlex
import shutil
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from estimator_pkg import interrupts
from estimator_pkg.cli import INTERRUPTED, Command
from estimator_pkg.cli import main as velocity_estimator
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.evaluation.text import interval, wrapped
from estimator_pkg.observers import DEFAULT
from estimator_pkg.printable import show
from estimator_pkg.ros.domain import free_domain
from estimator_pkg.ros.runtime import prepare_environment
from estimator_pkg.streams.angle import AngleSettings
from sim_pkg.demo.processes import Child

MEASURED, TRUTH = '/joint_states', '/ground_truth/joint_states'
OBSERVER = '/joint_observer'
ESTIMATE, STDDEV = f'{OBSERVER}/estimate', f'{OBSERVER}/estimate_stddev'
COUNTS = 4096
RATE = 500  # samples per second
EXAMPLE = Path('bags/dfki_double_pendulum/sys_id_500hz')  # in the folder of the sources
PATIENCE = 20.0  # longest wait for the first estimate [s]
DIFFERENCE = 'finite_difference'
# Standstill, slow motion across the counts, and fast motion through the wraps, both ways.
MOTION = {
    'profile': 'trapezoid',
    'velocity': 20.0,
    'acceleration': 40.0,
    'hold_time': 0.7,
    'counts_per_revolution': COUNTS,
    'rate': float(RATE),
    'wait_for_subscribers': 3,
    'wait_for_truth_subscribers': 2,
}  # the recorder and this process; the node is the third


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add = parser.add_argument
    add('--duration', type=float, default=10.0, metavar='S', help='of the run [s] (default: 10)')
    out = 'folder for the bag and the plot (default: demo_output)'
    add('--out', default='demo_output', metavar='DIR', help=out)
    run = f'observer to run (default: {DEFAULT})'
    add('--observer', default=DEFAULT, metavar='NAME', help=run)


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Run the demonstration; return the paths of bag and plot and the number of estimates.

    Raises
    ------
    UsageError : a duration outside 0.5 to 3600 s, or no observer of single angles.
    UserError : a process failed; the message contains its last line of output.
    """
    if not 0.5 <= parsed.duration <= 3600.0:
        raise UsageError(f'--duration {parsed.duration:g} is not between 0.5 and 3600 s')
    AngleSettings(observer=parsed.observer).find_observer()
    prepare_environment()
    environment = os.environ | {
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        # an own domain, so that two demos on one machine do not receive each other's messages
        'ROS_DOMAIN_ID': os.environ.get('ROS_DOMAIN_ID') or str(free_domain()),
    }
    os.environ.update(environment)
    folder = Path(parsed.out)
    folder.mkdir(parents=True, exist_ok=True)
    name = time.strftime('run_%Y%m%d_%H%M%S')
    bag, plot = folder / name, folder / f'{name}.png'
    count = _watch(parsed, bag, environment)
    print(f'\n{count} estimates in {parsed.duration:g} s. The error, from the recorded bag:\n')
    with TemporaryDirectory(prefix='velocity_estimator_') as scratch:
        found = Path(scratch) / 'result.json'
        words = ['evaluate', bag, '--estimate', ESTIMATE, '--observer', DIFFERENCE, '--from', '1']
        code = velocity_estimator([*map(str, [*words, '--plot', plot, '--json', found])])
        said = verdict(json.loads(found.read_text()), parsed.observer) if code == 0 else ''
    show('', f'bag   {bag}')
    if said:
        show(f'plot  {plot}', '', *wrapped(said), '', 'Next:', *following(bag))
    return {
        'ok': code == 0 and count > 0,
        'interrupted': code > INTERRUPTED,
        'bag': str(bag),
        'plot': str(plot),
        'estimates': count,
    }


def verdict(result: Mapping[str, Any], observer: str) -> str:
    """Return what the run has shown, in words.

    Parameters
    ----------
    result : of ``evaluate``, with the recorded estimate and the finite difference.
    """
    (bag,) = result['bags'].values()
    rows = {
        source: next(iter(found['joints'].values()))['velocity']
        for source, found in bag['estimates'].items()
    }
    ours, theirs = rows[ESTIMATE], rows[DIFFERENCE]
    late = [
        'an unknown time'
        if row['delay_s'] is None
        else interval(1e3 * row['delay_s'], 1e3 * row['delay_95_s'], 'ms')
        for row in (ours, theirs)
    ]
    ratio = theirs['rms'] / ours['rms'] if ours['rms'] else math.inf
    compared = f'{ratio:.1f} times smaller than' if ratio > 1.05 else 'not smaller than'
    return (
        f'Verdict: {observer} has an error of {ours["rms"]:.2g} rad/s rms and is {late[0]} late. '
        f'This error is {compared} that of the low-passed finite difference, '
        f'{theirs["rms"]:.2g} rad/s rms and {late[1]} late.'
    )


def following(bag: Path) -> list[str]:
    """Return the commands from here to a node with its own gains, for two terminals.

    Parameters
    ----------
    bag : recording of the demo, for a folder without recordings of robots.
    """
    name, topics = str(EXAMPLE), ''
    if not EXAMPLE.is_dir():  # the bag of the demo has estimates, too
        name, topics = shlex.quote(str(bag)), f' --topics {MEASURED}'
    scripts = Path(sys.prefix, 'bin')
    if shutil.which('joint_observer'):
        front = ''
    elif (scripts / 'joint_observer').is_file():
        front = f'{shlex.quote(os.path.relpath(scripts))}/'
    else:
        front = 'ros2 run velocity_estimator '
    return [
        f'    {front}velocity_estimator doctor {name} --out my_robot.yaml',
        f'    {front}joint_observer --ros-args --params-file my_robot.yaml -p use_sim_time:=true',
        '    # in a second terminal',
        f'    {front}velocity_estimator play {name}{topics} --clock --loop',
    ]


def _watch(parsed: argparse.Namespace, bag: Path, environment: dict[str, str]) -> int:
    """Start the processes, show their values, end them; return the number of estimates."""
    topics = MEASURED, TRUTH, ESTIMATE, STDDEV
    nodes = 'estimator_pkg.nodes.executables', 'sim_pkg.nodes.executables'
    observer = {'quantum': 2.0 * math.pi / COUNTS, 'observer': parsed.observer}
    motion = MOTION | {'duration': parsed.duration + PATIENCE}
    with contextlib.ExitStack() as stack:
        children = []
        for name, module, words in (
            ('joint_observer', nodes[0], _ros('joint_observer', observer)),
            ('record', 'estimator_pkg.cli', ['record', *topics, '--out', str(bag)]),
            ('encoder_sim', nodes[1], _ros('encoder_sim', motion)),
        ):
            with interrupts.held():  # else it might leave a process that nobody ends
                child = Child(name, module, words, environment)
                stack.callback(child.end)
            children.append(child)
        return _show(parsed, children)


def _ros(executable: str, parameters: Mapping[str, Any]) -> list[str]:
    """Return the words that start a node with these parameters."""
    pairs = (('-p', f'{key}:={value}') for key, value in parameters.items())
    return [executable, '--ros-args', *(word for pair in pairs for word in pair)]


def _show(parsed: argparse.Namespace, children: list[Child]) -> int:
    """Show the table until the time is up; return the number of estimates."""
    from estimator_pkg.bags.live import live
    from estimator_pkg.nodes.watching import Watching
    from estimator_pkg.watch import FRAME, Screen
    from sim_pkg.demo.live import Listener, picture

    with live('demo') as here, Screen() as screen:
        listener = Listener(here.node, (MEASURED, TRUTH, ESTIMATE))
        watching = Watching(here.node, OBSERVER)
        show(f'encoder_sim: {COUNTS} counts at {RATE} Hz  ->  joint_observer: {parsed.observer}')
        begun = frame = time.monotonic()
        started = math.inf
        while (now := time.monotonic()) < started + parsed.duration:
            here.spin(FRAME / 4.0)
            if here.stopping:
                raise KeyboardInterrupt
            if now < frame:
                continue
            frame = now + FRAME
            for child in children:
                child.check()
            watching.look()
            moment = listener.moment()
            if moment is not None:
                started = min(started, now)
                screen.show(picture(moment, watching, now - started))
            elif now > begun + PATIENCE:
                raise UserError(
                    f'no estimate within {PATIENCE:g} s; last line of the observer: '
                    f'{children[0].last_line()}'
                )
        return watching.count


COMMAND = Command(
    summary='run simulator and observer over real DDS: live table, bag, plot',
    arguments=arguments,
    run=run,
    examples=(
        ('', 'ten seconds of simulator and observer, then the error'),
        ('--observer hybrid_angle --duration 20 --out try', 'another observer, for longer'),
    ),
)
