"""What every node's process does: environment, executor, clean ends.

Import this module before rclpy and numpy: it settles the environment that they read.
"""

from __future__ import annotations

import importlib
import os
import re
import signal
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from estimator_pkg.errors import UserError

if TYPE_CHECKING:
    from rclpy.executors import Executor
    from rclpy.node import Node

SPIN = 0.1  # [s] EventsExecutor.spin() dispatches nothing on the PyPI wheels, spin_once does


def settle_environment() -> None:
    """Let ROS from PyPI find its packages, and keep BLAS on one thread (small matrices only)."""
    index = os.path.join(sys.prefix, 'share', 'ament_index')
    if not os.environ.get('AMENT_PREFIX_PATH') and os.path.isdir(index):
        os.environ['AMENT_PREFIX_PATH'] = sys.prefix
    for library in ('OMP', 'OPENBLAS', 'MKL'):
        os.environ.setdefault(f'{library}_NUM_THREADS', '1')


settle_environment()


def make_executor() -> Executor:
    """The executor that costs least where it exists, else the usual one."""
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        from rclpy.executors import SingleThreadedExecutor
        return SingleThreadedExecutor()
    return EventsExecutor()


def run(make_node: Callable[[], Node], args: list[str] | None = None) -> int:
    """Run a node until it is interrupted; returns the exit code.

    Parameters
    ----------
    make_node : makes the node, once ROS is initialised. What it imports then is imported after
        Ctrl-C has become quiet.
    args : command line; None: that of the process.
    """
    program = os.path.basename(sys.argv[0])
    started = False

    def interrupted(number: int, frame: Any) -> None:
        if not started:  # later ROS ends its context, and the loop below ends with it
            raise SystemExit(0)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interrupted)
    import rclpy
    from rclpy.logging import LoggingSeverity, set_logger_level
    from rclpy.utilities import remove_ros_args
    try:
        set_logger_level('rcl', LoggingSeverity.FATAL)  # it would log the error told below
        rclpy.init(args=args)
        set_logger_level('rcl', LoggingSeverity.UNSET)
        started = True
    except Exception as error:  # of rcl, for a command line it cannot parse
        print(f'{program}: wrong ROS arguments: {_first_line(error)}', file=sys.stderr)
        return 2
    rest = remove_ros_args([program, *args] if args is not None else sys.argv)[1:]
    if rest:
        rclpy.try_shutdown()
        return _usage(program, rest[0])
    executor = node = None
    try:
        node = make_node()
        executor = make_executor()
        executor.add_node(node)
        while rclpy.ok():
            executor.spin_once(timeout_sec=SPIN)
        return 0
    except (KeyboardInterrupt, Exception) as error:
        if not rclpy.ok():  # an interrupt took the context away under a call
            return 0
        if not isinstance(error, UserError):
            raise
        print(f'{program}: {error}', file=sys.stderr)
        return error.exit_code
    finally:
        if executor is not None:
            executor.shutdown()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


def executable(module: str, name: str) -> tuple[Callable[..., int], Callable[[str], Any]]:
    """What the module of an executable consists of: (main, module's __getattr__).

    The node's class is imported when it is asked for: ROS takes a while, and an interrupt before
    that ends the process quietly.

    Parameters
    ----------
    module, name : where the node's class is.
    """
    def find(attribute: str) -> Any:
        if attribute != name:
            raise AttributeError(f'no attribute {attribute!r} here; the class is {name}')
        return getattr(importlib.import_module(module), name)

    def main(args: list[str] | None = None) -> int:
        """Run the node until it is interrupted; returns the exit code."""
        return run(lambda: find(name)(), args)

    return main, find


def _usage(program: str, word: str) -> int:
    helped = word in ('-h', '--help')
    print(f'usage: {program} [--ros-args [-p PARAMETER:=VALUE ...] [--params-file FILE] '
          '[-r FROM:=TO ...]]' + ('' if helped else f"; not '{word}'"),
          file=sys.stdout if helped else sys.stderr)
    return 0 if helped else 2


def _first_line(error: Exception) -> str:
    text = str(error).strip() or type(error).__name__
    return re.sub(r', at \S+:\d+', '', text.splitlines()[0])  # where in the source of rcl
