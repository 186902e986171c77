# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A base whose wheels slip, live."""

import time

import dds
import numpy as np
import wheel_runs as runs

from sim_pkg.mechanisms import base

MODULE = 'estimator_pkg.nodes.executables wheel_odometry'
PLANT = {'slip': 0.5, 'rate': 50.0}


def test_slip_is_on_the_terminal_and_in_the_status(probe, tmp_path):
    """It ends 7.5 s after the start, and the odometry is that of the same messages off line."""
    from nav_msgs.msg import Odometry
    from sensor_msgs.msg import Imu

    file, seconds = tmp_path / 'params.yaml', 8.5
    file.write_text(
        '/**:\n  ros__parameters:\n    radius: [0.1]\n    track: 0.5\n    gyro_topic: imu\n'
        f'    quantum: {runs.QUANTUM}\n'
    )
    words = dds.ros_args(remap=('joint_states:=/w/measured', '__ns:=/w', '__node:=o'), file=file)
    found = []
    with (
        dds.NodeProcess(MODULE, *words) as process,
        dds.Observer(probe, '/w/o', '/w/measured') as live,
    ):
        gyro = probe.node.create_publisher(Imu, '/w/imu', 100)
        probe.node.create_subscription(
            Odometry, '/w/o/odometry', lambda raw: found.append(runs.decode(raw)), 500, raw=True
        )
        live.connect()
        probe.until(gyro.get_subscription_count)

        def messages():
            for topic, _, raw in runs.messages(PLANT, seconds, 1):
                if topic == base.GYRO.name:
                    gyro.publish(raw)
                    time.sleep(0.002)  # it takes another way
                elif topic == base.MEASURED.name:
                    yield raw

        def said():
            return [item.value for item in live.statuses['wheel_left_joint'].values]

        live.feed(messages())
        process.prints('slip: the wheels turn the base at ')
        probe.until(lambda: '; slips 1; gyro used, bias 0.0' in ' '.join(said()))
        assert 'none' in said()
    off_line = runs.run(PLANT, seconds, 1, runs.made(gyro_topic='imu'))
    assert len(found) >= len(off_line.time) - 2
    row = np.argmin(np.abs(off_line.time - (found[-1].stamp_ns - runs.START) * 1e-9))
    assert np.abs(found[-1].pose - off_line.pose[row]).max() < 1e-6
    assert 'Traceback' not in process.output
