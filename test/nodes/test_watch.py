# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""`watch`: the table of a running observer, and clean ends."""

import io
import json
import math
import os
import select
import signal
import subprocess
import sys
import time

import dds
import pytest
from rich.console import Console

from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.nodes.watching import Joint
from estimator_pkg.watch import table


def test_every_table_fits_80_columns():
    joints = {
        'a_joint_with_quite_a_long_name': Joint(
            -12345.678, 9.9e11, 1234.5678, 'not_observable', 'the signals ' * 12, 12345.678, 10**9
        ),
        'elbow': Joint(),
        '\x1b[2Jevil': Joint(0.1, -0.2, 0.3, 'tracking', '', 500.0, 10, 1),
    }

    console = Console(file=io.StringIO(), width=80)
    console.print(table(joints))
    lines = [line.rstrip() for line in console.file.getvalue().splitlines()]
    assert max(map(len, lines)) <= 80
    assert lines[0].startswith('joint ') and lines[0].endswith('rate Hz  dropped')
    assert lines[2].split() == ['elbow', '-', '-', '-', '-', '-', '0']
    assert lines[3].split()[1:] == ['+0.1000', '-0.2000', '0.3', 'tracking', '500', '1']
    assert '\x1b' not in lines[3]
    assert any('not_observable: the signals' in line for line in lines[4:])


def watch(*words, **options):
    return subprocess.Popen(
        [sys.executable, '-m', 'estimator_pkg.cli', 'watch', *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, 'PYTHONUNBUFFERED': '1'},
        **options,
    )


@pytest.mark.long
def test_a_running_observer_from_start_to_end(probe, tmp_path):
    """Values, states and counters as published; Ctrl-C ends it; so does the end of the node."""
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import JointState

    publisher = probe.node.create_publisher(JointState, '/joint_states', qos_profile_sensor_data)
    encode = Encoder().encode

    def feed(until):
        """Publish a joint that turns at 2 rad/s, each tenth stamp twice, and one at rest."""
        begun, number = time.monotonic(), 0
        while not until():
            assert time.monotonic() < begun + dds.PATIENCE
            now = time.time_ns()
            angle = math.remainder(2.0 * now * 1e-9, 2.0 * math.pi)
            for _ in range(2 if number % 10 == 0 else 1):
                publisher.publish(encode(now, '', ['elbow', 'wrist'], [angle, 0.5]))
            number += 1
            probe.executor.spin_once(timeout_sec=0.01)

    with dds.NodeProcess('estimator_pkg.nodes.executables joint_observer') as node:
        first = watch('--duration', '1.5', '--json', str(tmp_path / 'seen.json'))
        wrong = watch('/nonsense')
        feed(lambda: None not in (first.poll(), wrong.poll()))
        assert wrong.returncode == 1 and wrong.communicate()[1].count('\n') == 1
        text, errors = first.communicate()
        assert first.returncode == 0, errors
        assert max(map(len, text.splitlines())) <= 80
        seen = json.loads((tmp_path / 'seen.json').read_text())
        elbow = seen['joints']['elbow']
        assert elbow['velocity'] == pytest.approx(2.0, abs=0.5)
        assert elbow['state'] == 'tracking' and 0.0 < elbow['interval'] < 2.0
        assert 0 < elbow['dropped'] < elbow['received'] and 20.0 < elbow['rate'] < 120.0
        assert 'wrist' in seen['joints'] and seen['estimates'] > 20

        third = watch()
        fourth = watch()
        for each in (third, fourth):
            feed(lambda each=each: select.select([each.stdout], [], [], 0.0)[0])
        assert third.stdout.readline().startswith('/joint_observer  ')
        fourth.send_signal(signal.SIGINT)  # a clean end
        text, errors = fourth.communicate(timeout=30)
        assert fourth.returncode == 0 and not errors and text.endswith(' estimates received\n')
        node.signal(signal.SIGINT)
        text, errors = third.communicate(timeout=30)
        assert third.returncode == 1 and '/joint_observer has gone' in errors
        assert 'Traceback' not in text + errors
