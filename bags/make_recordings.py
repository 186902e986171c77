# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Makes the recordings in this folder from the files they come from.

    python bags/make_recordings.py DATA [--out FOLDER]

DATA holds the sources that README.md names: the folders dfki_simple_pendulum, dfki_double_pendulum
(CSV), bags/vicon and bags/joint_state_one_message (rosbag2, copied as they are), each with its
LICENSE. What exists in FOLDER already is left alone. The same sources make the same bytes.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.cli import main as velocity_estimator
from estimator_pkg.messages.joint_state import TYPE, Encoder

START_NS = 1_000_000_000 * 1_000_000_000  # the CSVs count from 0, which as a stamp means 'unset'
MEASUREMENT = '/joint_states'
TRUTH = '/ground_truth/joint_states'
LICENSE = 'LICENSE'


class Columns(NamedTuple):
    """Names of the columns of one joint in a CSV file."""

    joint: str
    position: str
    velocity: str
    torque: str


PENDULUM = (Columns('pendulum', 'position', 'velocity', 'torque'),)
DOUBLE = (Columns('shoulder', 'pos1', 'vel1', 'tau1'), Columns('elbow', 'pos2', 'vel2', 'tau2'))
MEASURED = (
    Columns('shoulder', 'pos_meas1', 'vel_meas1', 'tau_meas1'),
    Columns('elbow', 'pos_meas2', 'vel_meas2', 'tau_meas2'),
)

CSV = {
    'dfki_simple_pendulum/energy_shaping_200hz': PENDULUM,
    'dfki_simple_pendulum/gravity_compensation_1000hz': PENDULUM,
    'dfki_simple_pendulum/sac_200hz_multiturn': PENDULUM,
    'dfki_simple_pendulum/system_identification_300hz': PENDULUM,
    'dfki_double_pendulum/at_rest_500hz_duplicate_stamp': DOUBLE,
    'dfki_double_pendulum/sys_id_500hz': DOUBLE,
    'dfki_double_pendulum/trajectory_665hz': MEASURED,
}
COPIED = ('vicon/yawbag', 'vicon/flybag', 'vicon/yx2bag', 'joint_state_one_message/array_msgs')
DRIVE = [
    '--set',
    'publish_rate=5000',
    '--set',
    'batch=50',
    '--set',
    'current_noise=0.05',
    '--set',
    'true_samples=false',
]
SIMULATED: dict[str, list[str]] = {
    'simulated/sine_12bit': ['--duration', '5', '--seed', '1', '--set', 'profile=sine'],
    'simulated/random_with_faults': [
        '--duration',
        '6',
        '--seed',
        '2',
        '--set',
        'profile=random',
        '--set',
        'rate=500',
        '--set',
        'noise=0.001',
        '--set',
        'stamp_jitter=1e-4',
        '--set',
        'dropped=0.02',
        '--set',
        'duplicated=0.01',
        '--set',
        'repeated=0.02',
        '--set',
        'outliers=0.002',
        '--set',
        'gap_every=2',
    ],
    'simulated/trapezoid_raw_counts': [
        '--duration',
        '4',
        '--seed',
        '3',
        '--set',
        'profile=trapezoid',
        '--set',
        'rate=500',
        '--set',
        'convention=raw_counts',
    ],
    'simulated/gyro': [
        '--duration',
        '5',
        '--seed',
        '4',
        '--set',
        'rate=500',
        '--set',
        'gyro_rate=250',
        '--set',
        'gyro_delay=0.004',
    ],
    'simulated/motor_encoder': [
        '--duration',
        '5',
        '--seed',
        '5',
        '--set',
        'rate=500',
        '--set',
        'amplitude=1',
        '--set',
        'motor_ratio=100',
        '--set',
        'backlash=0.02',
    ],
}
DRIVES: dict[str, list[str]] = {
    'simulated/drive_startup': [
        '--duration',
        '1',
        '--seed',
        '1',
        '--set',
        'profile=standstill',
        *DRIVE,
    ],
    'simulated/drive_profile': ['--duration', '0.7', '--seed', '2', *DRIVE],
    'simulated/drive_reversal': [
        '--duration',
        '1',
        '--seed',
        '3',
        '--set',
        'profile=reversal',
        *DRIVE,
        '--set',
        'speed_rpm=3000',
        '--set',
        'lost=0.05',
        '--set',
        'repeated=0.05',
    ],
}
BASES: dict[str, list[str]] = {
    'simulated/base_with_slip': [
        '--duration',
        '12',
        '--seed',
        '4',
        '--set',
        'rate=50',
        '--set',
        'track=0.52',
        '--set',
        'travel_noise=0.001',
        '--set',
        'slip=0.5',
    ]
}


def main(words: list[str] | None = None) -> int:
    """Make what is missing; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('data', metavar='DATA', type=Path, help='folder with the sources')
    parser.add_argument('--out', metavar='FOLDER', type=Path, default=Path(__file__).parent)
    parsed = parser.parse_args(words)
    for name, columns in CSV.items():
        target = parsed.out / name
        if not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            convert(parsed.data / f'{name}.csv', target, columns)
            print(target)
        shutil.copyfile(parsed.data / Path(name).parent / LICENSE, target.parent / LICENSE)
    for name in COPIED:
        target, source = parsed.out / name, parsed.data / 'bags' / name
        if not target.exists():
            target.mkdir(parents=True)
            for file in source.iterdir():
                shutil.copyfile(file, target / file.name)
            print(target)
        shutil.copyfile(source.parent / LICENSE, target.parent / LICENSE)
    for plant, runs in (('encoder', SIMULATED), ('pmsm', DRIVES), ('base', BASES)):
        for name, words in runs.items():
            target = parsed.out / name
            if not target.exists():
                target.parent.mkdir(parents=True, exist_ok=True)
                if velocity_estimator(['simulate', plant, '--out', str(target), *words]):
                    return 1
    return 0


def convert(source: Path, target: Path, joints: tuple[Columns, ...]) -> None:
    """One CSV file as a bag: measurement and truth apart, stamps as they are."""
    with open(source, encoding='utf-8') as file:
        header = [name.strip() for name in file.readline().split(',')]
        table = np.loadtxt(file, delimiter=',')
    column = {name: table[:, index] for index, name in enumerate(header)}
    stamps = START_NS + np.round(column['time'] * 1e9).astype(np.int64)
    positions, velocities, torques = (
        np.stack([column[getattr(joint, what)] for joint in joints], axis=1).tolist()
        for what in ('position', 'velocity', 'torque')
    )
    names = [joint.joint for joint in joints]
    measured, true = Encoder(), Encoder()
    with BagWriter(target) as bag:
        bag.add_topic(MEASUREMENT, TYPE)
        bag.add_topic(TRUTH, TYPE)
        for stamp_ns, position, velocity, torque in zip(
            stamps.tolist(), positions, velocities, torques
        ):
            bag.write(
                MEASUREMENT, stamp_ns, measured.encode(stamp_ns, '', names, position, (), torque)
            )
            bag.write(TRUTH, stamp_ns, true.encode(stamp_ns, '', names, (), velocity))


if __name__ == '__main__':
    sys.exit(main())
