# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Shared by the processes of all nodes: environment, executor, clean ends.

Import this module before rclpy and numpy: it prepares the environment that they read.
"""

from __future__ import annotations

import gc
import os
import re
import sys
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING

from estimator_pkg import interrupts
from estimator_pkg.errors import UserError
from estimator_pkg.optional import missing
from estimator_pkg.printable import printable

if TYPE_CHECKING:
    from rclpy.node import Node

    from estimator_pkg.ros.executor import SteadyExecutor

MIXED = 'Sequence should be of same type'  # rcl's error for a list with booleans such as y, n, on
SPIN = 0.1  # longest time until an interrupt is noticed [s]


def prepare_environment() -> None:
    """Let ROS from PyPI find its packages, and keep BLAS on one thread (small matrices only)."""
    index = os.path.join(sys.prefix, 'share', 'ament_index')
    if not os.environ.get('AMENT_PREFIX_PATH') and os.path.isdir(index):
        os.environ['AMENT_PREFIX_PATH'] = sys.prefix
    for library in ('OMP', 'OPENBLAS', 'MKL'):
        os.environ.setdefault(f'{library}_NUM_THREADS', '1')


prepare_environment()


_report: Callable[[BaseException], None] | None = None  # of the process of a node, see `discard`


def discard(destroy: Callable[[], None], error: BaseException) -> None:
    """Destroy a node whose start failed; its process reports the error first.

    DDS may wait for ever when it destroys what it has just made.
    """
    if _report is not None:
        _report(error)
    destroy()


def make_executor() -> SteadyExecutor:
    """Return the executor with the lowest cost whose services and timers always run."""
    from estimator_pkg.ros.executor import SteadyExecutor

    return SteadyExecutor()


def run(make_node: Callable[[], Node], args: list[str] | None = None) -> int:
    """Run a node until it is interrupted; return the exit code.

    ROS's own handlers of signals would shut its context down during a call, so ours are in use: a
    signal ends the construction of the node, and ends the loop once the node runs.

    Parameters
    ----------
    make_node : makes the node, after ROS is initialised. Its imports happen after Ctrl-C has become
        quiet.
    args : command line; None: that of the process, which ends afterwards.
    """
    try:
        with interrupts.handled(background=True):
            try:
                return _run(make_node, args)
            except KeyboardInterrupt:
                interrupts.finish()
                return 0
    finally:
        if args is None:
            interrupts.limit_end()


def _run(make_node: Callable[[], Node], args: list[str] | None) -> int:
    global _report
    program = os.path.basename(sys.argv[0])
    reported: list[BaseException] = []

    def report(error: BaseException) -> None:
        """Print the error, once, if the user can correct it; from here on the process ends."""
        if args is None:
            interrupts.limit_end()
        if isinstance(error, UserError) and error not in reported:
            reported.append(error)
            print(f'{program}: {printable(error)}', file=sys.stderr, flush=True)

    try:
        import rclpy
        from rclpy.logging import LoggingSeverity, set_logger_level
        from rclpy.signals import SignalHandlerOptions
        from rclpy.utilities import remove_ros_args
    except ImportError as error:
        for word in sys.argv[1:] if args is None else args:
            if word in ('-h', '--help'):
                return _usage(program, word)
        return _missing(program, error)
    executor = node = None
    try:
        set_logger_level('rcl', LoggingSeverity.FATAL)  # it would log the error reported below
        try:
            rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        except Exception as error:  # of rcl, for a command line it cannot parse
            why = _first_line(error)
            hint = "; write texts in quotes, as in ['x', 'y']" if MIXED in why else ''
            print(f'{program}: wrong ROS arguments: {printable(why)}{hint}', file=sys.stderr)
            return 2
        set_logger_level('rcl', LoggingSeverity.UNSET)
        rest = remove_ros_args([program, *args] if args is not None else sys.argv)[1:]
        if rest:
            return _usage(program, rest[0])
        executor = make_executor()
        gc.disable()  # a collection takes long, while messages wait in a queue
        _report = report
        node = make_node()
        executor.add_node(node)
        gc.freeze()  # later collections skip all imported objects
        gc.enable()
        with interrupts.gently():
            while rclpy.ok() and not interrupts.came():
                executor.spin_once(timeout_sec=SPIN)
        return 0
    except UserError as error:
        report(error)
        return error.exit_code
    except ImportError as error:
        return _missing(program, error)
    except Exception:
        if rclpy.ok():
            raise
        return 0  # the node has shut ROS down itself, during a call
    finally:
        _report = None
        gc.enable()
        interrupts.finish()
        if args is None:
            interrupts.limit_end()
        with ExitStack() as ends:  # from last to first, each of them whatever another raises
            if node is not None:
                ends.callback(node.destroy_node)
            if executor is not None:
                ends.callback(executor.shutdown)
            ends.callback(rclpy.try_shutdown)  # the threads of a node check whether ROS is running


def _usage(program: str, word: str) -> int:
    helped = word in ('-h', '--help')
    print(
        f'usage: {program} [--ros-args [-p PARAMETER:=VALUE ...] [--params-file FILE] '
        '[-r FROM:=TO ...]]' + ('' if helped else f"; not '{printable(word)}'"),
        file=sys.stdout if helped else sys.stderr,
    )
    return 0 if helped else 2


def _missing(program: str, error: ImportError) -> int:
    """Report a library that is not installed; return the exit code."""
    line = missing(error)
    if line is None:
        raise error
    print(f'{program}: {line}', file=sys.stderr)
    return 1


def _first_line(error: Exception) -> str:
    text = str(error).strip() or type(error).__name__
    return re.sub(r', at \S+:\d+', '', text.splitlines()[0])  # without rcl's source position
