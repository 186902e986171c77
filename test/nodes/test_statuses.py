# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The statuses of joints over time, and gains that give no numbers."""

import dataclasses
import math
import re

import motors
import pytest
from fault_cases import MOTOR, MS
from own_node import BEGIN, logged

from estimator_pkg.errors import UsageError
from estimator_pkg.estimate import LOST, MISCONFIGURED, TRACKING
from estimator_pkg.messages import drive_samples
from estimator_pkg.streams.angle import AngleSettings, AngleStream


def test_what_is_not_estimated_is_reported_but_not_each_standstill(own, capfd):
    """Seconds of a motor: at rest at the start, then it turns, stops, and loses its voltage."""
    live, row = own('drive', **MOTOR), 0
    motor = live.node.stream.joint

    def seconds(count, turns, voltage=1.0):
        """Feed `count` seconds; return the errors about missing estimates."""
        nonlocal row
        for _ in range(count):
            for stamps, values in motors.steady(50, row, turns):
                raw = drive_samples.encode(stamps, values * (1.0, 1.0, voltage, voltage))
                live.node.stream.feed(0, raw, 0)
            row += 50
            live.now += 1.0
            live.node.health.look()
        said = logged(capfd.readouterr().err)
        return [line for level, line in said if level == 'ERROR' and 'no estimate' in line]

    (said,) = seconds(8, 0.0)
    assert 'no estimate for 4 s, though messages come on /drive_samples: back-EMF' in said
    assert not seconds(3, 100.0) and motor.estimate()[3] == TRACKING
    assert not seconds(8, 0.0) and motor.needs_motion
    (said,) = seconds(8, 100.0, voltage=0.0)
    assert 'all voltages are zero: is the voltage connected?' in said


def test_a_slow_stream_is_not_lost_between_two_samples_and_a_misconfigured_joint_when_none_comes(
    own,
):
    live = own('angle', timeout=0.5)
    feed, statuses = live.node.stream.feed, live.node.health.watch.statuses
    for k in range(8):  # 0.5 Hz: lost after four sample times
        feed(0, live.encode(BEGIN + 2000 * k * MS, '', ('slow',), (0.1 * k,)), 0)
        live.pass_time(2.0)
        assert statuses['slow'][0] != LOST and (k < 5 or statuses['slow'][0] == TRACKING)
    for k in range(200):  # and a fast one
        feed(0, live.encode(BEGIN + (20_000 + k) * MS, '', ('fast',), (0.1,)), 0)
    live.pass_time(0.8)
    assert (statuses['fast'][0], statuses['slow'][0]) == (LOST, TRACKING)
    live = own('angle', observer='hybrid_angle', form='paper', epsilon=0.1)
    statuses = live.node.health.watch.statuses
    for k in range(40):  # 25 Hz: too slow for these gains
        live.node.stream.feed(0, live.encode(BEGIN + 40 * k * MS, '', ('j',), (0.01 * k,)), 0)
        live.pass_time(0.1)
    assert statuses['j'][0] == MISCONFIGURED and 'epsilon' in statuses['j'][1]
    live.pass_time(live.node.stream.bank.joints['j'].silence + 0.2)
    assert statuses['j'][0] == LOST


def test_a_stuck_bit_of_an_encoder_is_a_warning_until_it_was_right_for_a_minute(own):
    """It turns for 8 s and is wrong from 5 to 8 s."""
    arm = own('angle', stamp_source='publisher')
    for k in range(71 * 200):
        count = int(13.3 * min(k, 1600))
        count &= ~8 if 1000 <= k < 1600 else ~0
        if k < 1700 or k % 4 == 0:  # at rest a fourth of the samples is enough
            raw = arm.encode(1, '', ('a',), (count % 4096 * math.pi / 2048,))
            arm.node.stream.feed(0, raw, BEGIN + 5 * k * MS)
        if k % 100 == 0:
            arm.now = arm.begun + k / 200
            arm.node.health.look()
    for when, entry in arm.diagnostics:
        if when - arm.begun < 5 or when - arm.begun > 70:
            assert entry.level == b'\x00', when
        elif 7 < when - arm.begun < 65:
            assert entry.level == b'\x01' and 'of the counter is stuck' in entry.message


def fragile(observer):
    """This observer, which gives no numbers at a bandwidth of 123 Hz."""

    class Broken(observer):
        @staticmethod
        def prepare(coefficients, design, dt):
            raise OverflowError('math range error')

    class Fragile(observer):
        @classmethod
        def bound(cls, gains):
            return Broken if gains.bandwidth_hz == 123.0 else observer

    return Fragile


@dataclasses.dataclass(frozen=True)
class FragileSettings(AngleSettings):
    def find_observer(self):
        return fragile(super().find_observer())


class Fragile(AngleStream):
    SETTINGS = FragileSettings


def test_gains_that_give_no_numbers_are_refused(own):
    reported = r'numbers become too large or too small for these gains \(math range error\)'
    live = own(Fragile, observer='hybrid_angle')
    live.node.stream.feed(0, live.encode(BEGIN, '', ['a'], [0.0]), 0)
    assert re.fullmatch(reported, live.set(bandwidth_hz=123.0))
    assert live.node.get_parameter('bandwidth_hz').value != 123.0
    with pytest.raises(UsageError, match=f'hybrid_angle: {reported}'):
        own(Fragile, observer='hybrid_angle', bandwidth_hz=123.0)
