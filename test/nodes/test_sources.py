# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Other sensors beside the angle, live: what each fault of theirs does, and what is said of it."""

import re
import time

import dds
import numpy as np

from estimator_pkg import observers
from estimator_pkg.driver.configuration import SensorSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.parameters import build

MODULE = 'estimator_pkg.nodes.executables joint_observer'
RATE, SECONDS, FAULT = 500, 14.0, (5.0, 8.0)
QUANTUM = 2.0 * np.pi / 4096
TIME = np.arange(int(RATE * SECONDS)) / RATE
ANGLE, SPEED = 0.5 * np.sin(4.0 * TIME) + 0.1 * TIME, 2.0 * np.cos(4.0 * TIME) + 0.1
FAULTS = {
    'fine': lambda told: told,
    'dead': lambda told: 0.0 * told,
    'stuck': lambda told: np.full_like(told, told[0]),
    'biased': lambda told: told + 0.5,
    'reversed': lambda told: -told,
    'late': lambda told: np.interp(TIME[: len(told)] - 0.02, TIME[: len(told)], told),
    'wrong_joint': lambda told: np.cos(7.0 * TIME[: len(told)]),
    'saturated': lambda told: np.clip(told, -1.0, 1.0),
}


def told(fault, rng):
    gyro = SPEED - 0.03 + 0.005 * rng.standard_normal(len(TIME))
    rows = (FAULT[0] <= TIME) & (FAULT[1] > TIME)
    gyro[rows] = FAULTS[fault](gyro[rows])
    return gyro


def messages(sensors, names, gyros, readings):
    """The messages of the angle, each after that of the sensors."""
    sensed, measured = Encoder(), Encoder()
    for k, reading in enumerate(readings.tolist()):
        stamp, same = 10**18 + round(TIME[k] * 1e9), [reading] * len(names)
        sensors.publish(sensed.encode(stamp, '', names, same, gyros[k].tolist()))
        time.sleep(0.001)  # it takes another way
        yield measured.encode(stamp, '', names, same)


def of_the_angle_alone(readings):
    observer = observers.find('edge_adaptive')
    joint = Joint(observer, build(observer.gains, {'quantum': QUANTUM}), build(SensorSettings, {}))
    stamps = 10**18 + np.round(TIME * 1e9).astype(np.int64)
    return joint.run(stamps, readings).velocity


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def test_each_fault_of_a_source_is_withheld_named_and_taken_again(probe, tmp_path):
    from sensor_msgs.msg import JointState

    names = list(FAULTS)
    rng = np.random.default_rng(1)
    gyros = np.array([told(name, rng) for name in names]).T
    readings = np.floor(ANGLE / QUANTUM + 0.3) * QUANTUM
    sources = '\n'.join(
        f'    source.g_{name}: {{topic: sensors, field_type: sensor_msgs/msg/JointState, '
        f"field: 'velocity[{k}]', joint: {name}, ratio: 1.0}}"
        for k, name in enumerate(names)
    )
    file = tmp_path / 'params.yaml'
    file.write_text(
        '/**:\n  ros__parameters:\n'
        f'    sources: [{", ".join(f"g_{name}" for name in names)}]\n    quantum: {QUANTUM}\n'
        f'{sources}\n'
    )
    words = dds.ros_args(remap=('joint_states:=/s/measured', '__ns:=/s', '__node:=o'), file=file)
    with (
        dds.NodeProcess(MODULE, *words) as process,
        dds.Observer(probe, '/s/o', '/s/measured') as live,
    ):
        sensors = probe.node.create_publisher(JointState, '/s/sensors', 100)
        live.connect()
        probe.until(sensors.get_subscription_count)
        probe.until(lambda: sensors.get_subscription_count() == len(names))
        answers = live.feed(messages(sensors, names, gyros, readings))
        live.next_report()
        for name in names[1:]:
            process.prints(f'{name}: g_{name} is withheld: it says ')
            process.prints(f'{name}: g_{name} agrees again and is used')
    assert 'Traceback' not in process.output
    assert 'g_fine is withheld' not in process.output
    alone = of_the_angle_alone(readings)
    rows = TIME > 1.0
    for k, name in enumerate(names):
        entry = {item.key: item.value for item in live.statuses[name].values}
        said = re.match(r'used, bias (\S+) \+- \S+ rad/s', entry[f'source g_{name}'])
        assert said and abs(float(said[1]) - 0.03) < 1e-3, entry
        error = np.array([answer.velocities[k] for answer in answers]) - SPEED
        ratio = rms(error[rows]) / rms(alone[rows] - SPEED[rows])
        assert ratio < (0.5 if name == 'fine' else 1.05), (name, ratio)
