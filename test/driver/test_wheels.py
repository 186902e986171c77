# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Odometry of simulated bases: its intervals, its pose, slip, and gyros that are wrong."""

from statistics import NormalDist

import numpy as np
import pytest
import wheel_runs as runs

from estimator_pkg.bags.definitions import fields_of
from estimator_pkg.errors import UsageError
from estimator_pkg.messages.field import Field
from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.observers.wheels import CONTRADICTION, arc
from estimator_pkg.streams.wheels import WheelStream
from sim_pkg.joints.second import imu

ALWAYS = {  # (fault, from when on [s]): profile, rate [Hz]; all profiles are in the slow tests
    ('bias 0.05', 0): ('circle', 50),
    ('bias 0.05', 20): ('slalom', 200),
    ('bias 0.3', 0): ('slalom', 50),
    ('bias 0.3', 20): ('spins', 50),
    ('drift', 0): ('straight', 50),
    ('drift', 20): ('stops', 50),
    ('reversed', 0): ('circle', 50),
    ('reversed', 20): ('stops', 50),
    ('in deg/s', 0): ('slalom', 50),
    ('in deg/s', 20): ('circle', 50),
    ('swapped', 0): ('spins', 50),
    ('swapped', 20): ('slalom', 50),
}


def table():
    """Return every fault, from the start and at 20 s of 60 s, on every profile."""
    rows = []
    for (fault, start), (usual, usual_rate) in ALWAYS.items():
        for seed, profile in enumerate(runs.PROFILES):
            rate, marks = (50, 100, 200, 500, 50)[seed], (pytest.mark.long, pytest.mark.slow)
            if profile == usual:
                rate, marks = usual_rate, pytest.mark.long
            rows.append(pytest.param(fault, start, profile, rate, seed, marks=marks))
    return rows


@pytest.mark.parametrize(('fault', 'start', 'profile', 'rate', 'seed'), table())
def test_a_contradiction_is_covered(fault, start, profile, rate, seed):
    """The intervals contain the truth, whether wheels or gyro are wrong."""
    swapped = start if fault == 'swapped' else None
    result = runs.run(runs.drive(profile, rate, seed, swapped=swapped), fault, start)
    yaw, _, yaw_rate = result.covered()
    assert yaw >= 0.9 and yaw_rate >= 0.9
    if fault == 'in deg/s' and profile in ('circle', 'slalom', 'spins'):
        assert 'another unit' in result.base.rejected
    elif profile != 'straight' and (fault, start) != ('bias 0.05', 0):
        assert result.base.doubts or profile == 'stops'


@pytest.mark.long
@pytest.mark.parametrize(('profile', 'rms'), [('straight', 0.001), ('slalom', 0.003)])
def test_a_clean_drive(profile, rms):
    result = runs.run(runs.drive(profile, rate=100.0))
    yaw, _, yaw_rate = result.covered()
    assert result.rms() < rms
    assert 0.95 <= yaw_rate <= 1.0 and 0.95 <= yaw <= 1.0
    assert not result.base.notices and not result.base.doubts
    assert f'bias {runs.GYRO_BIAS}' in result.base.text().replace('0.0199', '0.02')


@pytest.mark.long
@pytest.mark.parametrize('ground', [0.0, 0.003])
def test_wheels_alone(ground):
    drive = runs.drive('slalom', rate=100.0, seconds=20.0, ground=ground)
    result = runs.run(drive, gyro=False, travel_noise=ground)
    assert 0.9 < result.covered()[2] <= 1.0


@pytest.mark.long
@pytest.mark.parametrize('gyro', [False, True])
def test_the_pose_is_in_its_covariance(gyro):
    """NEES of drives whose constants are spread as the parameters say: its mean would be 3."""
    found, spread = [], [NormalDist().inv_cdf((k + 0.5) / 12.0) for k in range(12)]
    for seed in range(12):
        places = seed, 5 * seed % 12, 7 * seed % 12
        geometry = tuple(1 + a * spread[k] for a, k in zip((0.002, 0.002, 0.02), places))
        profile = ('slalom', 'circle')[seed % 2]
        drive = runs.drive(profile, seed=seed, seconds=15.0, ground=0.003, geometry=geometry)
        found.append(runs.run(drive, gyro=gyro, radius_stddev=0.002, track_stddev=0.02).nees())
    assert 0.7 < np.mean(found) < 4.5, found  # chi-square of 36 over 12: 95 % in 1.8 to 4.5
    assert max(found) < 17.0  # chi-square of 3: one in 1400


@pytest.mark.long
def test_slip_is_named_and_covered():
    drive = runs.drive('slalom', rate=100.0, seconds=20.0, slip=0.5)
    alone, both = (runs.run(drive, gyro=gyro) for gyro in (False, True))
    worst = [np.abs(each.errors[300:, 4]).max() for each in (alone, both)]
    assert worst[1] < 0.7 * worst[0]
    assert both.base.doubts == 2 and both.covered().min() > 0.9
    assert both.base.notices[0].startswith(f'{CONTRADICTION} (the wheels turn the base at ')
    assert both.nees() < 17.0


@pytest.mark.parametrize(
    ('fault', 'profile', 'said'),
    [
        ('silent', 'slalom', 'it is silent for 0.5'),
        ('stuck', 'slalom', 'it is stuck at 0.2'),
        ('in deg/s', 'circle', 'it is in another unit: it shows'),
        ('bias 0.3', 'stops', 'rad/s while the wheels stand'),
    ],
)
def test_after_a_rejection_the_wheels_are_alone(fault, profile, said):
    drive = runs.drive(profile, seconds=20.0)
    alone, result = runs.run(drive, gyro=False), runs.run(drive, fault, 5.0)
    assert said in result.base.notices[-1] and said in result.base.text()
    assert np.abs(result.found[-1, 4] - alone.found[-1, 4]) < 1e-9
    turned = result.found[-100:, 2] - result.found[-100, 2]
    assert turned == pytest.approx(alone.found[-100:, 2] - alone.found[-100, 2], abs=1e-9)
    assert np.abs(result.errors[-1, 2]) < 0.02


def test_an_arc_and_its_derivatives():
    h = 1e-6
    for turn in (0.0, 1e-5, -2e-4, 0.3, -2.0):
        step, by = arc(0.7, turn, 0.4)
        parts = np.linspace(0.4, 0.4 + turn, 20001)
        middle = 0.5 * (parts[1:] + parts[:-1])
        whole = 0.7 * np.array([np.cos(middle).mean(), np.sin(middle).mean()])
        assert step == pytest.approx([*whole, turn], abs=1e-8)
        if abs(turn) < 0.01:
            for k, (distance, angle) in enumerate(((0.7 + h, turn), (0.7, turn + h))):
                assert by[:, k] == pytest.approx(
                    (arc(distance, angle, 0.4)[0] - step) / h, abs=1e-4
                )


# The stream


def made(**values):
    """A stream, with a field of an IMU if it has a gyro."""
    names = {'wheels_left': ['left'], 'wheels_right': ['right']}
    stream = WheelStream.of({'radius': [0.1], 'track': 0.5, **names, **values})
    if values.get('gyro_topic'):
        kind = 'sensor_msgs/msg/Imu'
        stream.read_field(Field(fields_of(kind, ''), kind, 'angular_velocity.z'), 1)
    return stream


def fed(stream, t, names, angles):
    """Answers to wheels at these angles at t [s]."""
    raw = Encoder().encode(runs.START + round(t * 1e9), '', names, angles)
    return list(stream.feed(0, raw, 0))


@pytest.mark.parametrize('late', [0.0, 0.003])
def test_wheels_in_separate_messages(late):
    """The odometry is that of the base at 2 m/s on a circle, at the stamp of the last wheel."""
    stream = made()
    for row in range(300):
        t = 0.01 * row
        answers = fed(stream, t, ['left'], [18.0 * t % runs.PERIOD])
        answers += fed(stream, t + late, ['right'], [22.0 * (t + late) % runs.PERIOD])
    assert [set(answer) for answer in answers] == [{0, 1}, {0, 1}, {2}]  # estimates leave first
    assert stream.base.twist == pytest.approx([2.0, 0.8], abs=1e-6)
    assert stream.base.pose[2] == pytest.approx(0.8 * (t + late), abs=0.03)


def test_a_wrong_gyro_topic_is_reported():
    stream, notices = made(gyro_topic='imu_wrong'), []
    for row in range(500):
        fed(stream, 0.01 * row, ['left', 'right'], [0.08 * row, 0.08 * row])
        notices += stream.notices()
    assert notices == ["the gyro is not used: it is silent for 3 s: check 'gyro_topic'"]
    assert 'silent' in stream.about('left')['base']


def test_the_clock_is_set_back_and_the_base_is_reset():
    """The pose goes on, and the gyro is used again; a reset begins at zero."""
    stream = made(gyro_topic='imu')
    for turn in (1, 2):
        for row in range(400):
            t = 0.01 * row
            fed(stream, t, ['left', 'right'], [8.0 * t, 8.0 * t])
            stream.feed(1, imu(runs.START + round((t + 0.005) * 1e9), 0.02, 0), 0)
        assert stream.base.pose[0] == pytest.approx(3.17 * turn, abs=0.03)
        assert not stream.base.rejected and not stream.base.doubt
    assert stream.reset().endswith('the pose is zero')
    fed(stream, 4.0, ['left', 'right'], [32.0, 32.0])
    assert not stream.base.pose.any()


def test_a_pause_of_the_wheels_is_in_the_covariance_and_named():
    """Wrapped wheels may have turned any number of times."""
    stream, notices = made(), []
    for row in [*range(300), *range(400, 500)]:
        if row == 400:
            before = stream.base.covariance[0, 0]
        fed(stream, 0.01 * row, ['left', 'right'], [0.08 * row, 0.08 * row])
        notices += stream.notices()
    assert stream.base.covariance[0, 0] > before + 0.1
    assert 'turns in it are not in the pose' in ' '.join(notices)


@pytest.mark.parametrize(
    ('values', 'said'),
    [
        ({'radius': None}, "'radius' is not set"),
        ({'track': None}, "'track' is not set"),
        ({'wheels_left': ['a', 'b']}, "has 2 names and 'wheels_right' 1"),
        ({'wheels_left': ['a'], 'wheels_right': ['a']}, "'a', 'a'.* each another joint"),
        ({'wheels_left': ['']}, 'each another joint'),
        ({'radius': [0.1, 0.1, 0.1]}, "'radius' has 3 numbers"),
        ({'radius': [-0.1]}, 'radius'),
        ({'gyro_topic': 'imu', 'gyro_ratio': 0.0}, "'gyro_ratio' is 0"),
    ],
)
def test_a_base_that_is_none_is_refused(values, said):
    given = {'radius': [0.1], 'track': 0.5, **values}
    with pytest.raises(UsageError, match=said) as reported:
        WheelStream.of({name: value for name, value in given.items() if value is not None})
    assert '\n' not in str(reported.value)
