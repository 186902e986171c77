# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Processes of the live benchmarks, in their own ROS domain."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import psutil

from benchmarks import outside
from benchmarks.drive import MOTOR
from estimator_pkg.errors import UserError
from estimator_pkg.ros.runtime import prepare_environment

JOINTS = 7  # in each message
MODULE = 'estimator_pkg.nodes.executables {}'
NULL, NULL_DRIVE = 'null_node', 'null_drive'
# The observer nodes with input joint_states, and the arguments that they need for these joints.
# `mechanical_observer` and `switched_observer` take one of the joints, the others all.
NODES: dict[str, tuple[str, ...]] = {
    'joint_observer': (),
    'adaptive_observer': (),
    'mechanical_observer': ('--ros-args', '-p', 'joints:=[joint_0]'),
    'switched_observer': ('--ros-args', '-p', 'joints:=[joint_0]'),
    'wheel_odometry': (
        *('--ros-args', '-p', 'radius:=[0.1]', '-p', 'track:=0.5'),
        *('-p', 'wheels_left:=[joint_0]', '-p', 'wheels_right:=[joint_1]'),
    ),
}
DRIVES: dict[str, tuple[str, ...]] = {  # the same with currents and voltages as input
    'pmsm_observer': (
        *('--ros-args', '-p', 'input:=current_voltage'),
        *(word for name, value in MOTOR.items() for word in ('-p', f'{name}:={value}')),
    )
}


@contextmanager
def process(
    *words: str,
    domain: int,
    extra: tuple[str, ...] = (),
    module: str = MODULE.format('joint_observer'),
) -> Iterator[subprocess.Popen]:
    """Run a role of `roles`, or 'node' for `module`, as a process that ends with the block."""
    prepare_environment()
    where = outside()
    where['env'] |= {'ROS_DOMAIN_ID': str(domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    program = (
        ['-m', *module.split()] if words == ('node',) else ['-m', 'benchmarks.live.roles', *words]
    )
    child = subprocess.Popen(
        [sys.executable, *program, *extra],
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        **where,
    )
    try:
        yield child
    finally:
        if child.poll() is None:
            child.send_signal(signal.SIGINT)
        try:
            child.wait(10)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


@contextmanager
def observer(name: str, domain: int) -> Iterator[subprocess.Popen]:
    """Run one of `NODES` or `DRIVES`, or a null node, as a process that ends with the block."""
    if name in (NULL, NULL_DRIVE):
        with process(name, domain=domain) as child:
            yield child
        return
    words = (NODES | DRIVES)[name]
    with process('node', domain=domain, extra=words, module=MODULE.format(name)) as child:
        yield child


def result(child: subprocess.Popen, timeout: float = 60.0) -> dict:
    """Return the JSON in the last line that a role printed, after it has ended; raise UserError."""
    role = ' '.join(map(str, child.args[2:]))  # type: ignore[index]  # a list: see `process`
    try:
        output, _ = child.communicate(timeout=timeout)
        return json.loads(output.splitlines()[-1])
    except subprocess.TimeoutExpired as error:
        raise UserError(f'{role} did not end within {timeout:g} s: try again') from error
    except (IndexError, json.JSONDecodeError) as error:
        raise UserError(f'{role} ended without a result: try again') from error


def cpu(meter: psutil.Process) -> float:
    """Return the CPU time that a process has used [s]."""
    times = meter.cpu_times()
    return times.user + times.system
