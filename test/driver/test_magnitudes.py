# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A reading of any magnitude is a matter of its own joint: it is used, or dropped and counted."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from estimator_pkg import observers, streams
from estimator_pkg.circle import is_angle
from estimator_pkg.messages import drive_samples, vector3
from estimator_pkg.messages.joint_state import Decoder, Encoder

STREAMS = {stream.KIND: stream for stream in streams.every()}
MOTOR = {'resistance': 0.06, 'inductance': 33.75e-6, 'flux': 1.9e-3, 'pole_pairs': 7}
STEP = 1_000_000  # [ns]
COUNT = 40
ANGLES = [name for name in observers.names() if observers.find(name).kind == 'angle']
CASES = {
    **{name: ('angle', {'observer': name}) for name in ANGLES},
    'unwrap': ('angle', {'unwrap': True, 'wrap_period': 0.5}),
    'regular': ('angle', {'stamp_repair': 'regular'}),
    'adaptive': ('angle_and_input', {}),
    **{
        name: (
            'mechanical',
            {
                'observer': name,
                'mechanisms': ['one', 'other'],
                'unwrap': True,
                'per_joint.one.joints': ['a'],
                'per_joint.other.joints': ['b'],
            },
        )
        for name in ('geso', 'hgo', 'ehgo', 'smo')
    },
}
MAGNITUDES = st.one_of(
    st.floats(),
    st.tuples(st.sampled_from([1.0, -1.0]), st.floats(0.0, 308.2)).map(
        lambda drawn: drawn[0] * 10.0 ** drawn[1]
    ),
)
WRONG = st.dictionaries(st.integers(1, COUNT - 1), MAGNITUDES, min_size=1, max_size=20)
FLIPS = {k: math.copysign(1e308, 0.5 - k % 2) for k in range(10, 30)}


def fed(case, wrong=None, effort=None):
    """Return a stream after two joints have come, and the velocities of the second one.

    Parameters
    ----------
    wrong, effort : positions and efforts of the first joint by number of the message.
    """
    kind, values = CASES[case]
    stream = STREAMS[kind].of(values)
    stream.go_live()
    stream.wanted[:] = [True] * len(stream.outputs)
    encode, decode = Encoder().encode, Decoder().decode
    velocities = []
    for k in range(COUNT):
        angle = 0.1 * math.sin(0.01 * k)
        first = (wrong or {}).get(k, angle), (effort or {}).get(k, 0.01 * angle)
        positions, efforts = zip(first, (angle, 0.01 * angle))
        stamp = 10**18 + k * STEP
        for answer in stream.feed(0, encode(stamp, '', ['a', 'b'], positions, (), efforts), 0):
            if 0 in answer:
                message = decode(answer[0])
                at = list(message.names).index('b')
                velocities.append((message.positions[at], message.velocities[at]))
    return stream, velocities


@pytest.mark.parametrize('case', CASES)
def test_a_reading_that_no_joint_can_have_is_dropped_and_counted(case):
    _, expected = fed(case)

    @settings(max_examples=8)
    @given(WRONG, WRONG)
    @example(FLIPS, FLIPS)
    def check(wrong, effort):
        stream, found = fed(case, wrong, effort)
        assert repr(found) == repr(expected)
        one, other = stream.bank.joints.values()
        none = {k for k, value in wrong.items() if not is_angle(value)}
        if case == 'adaptive':  # half a sample is none
            none |= {k for k, value in effort.items() if not is_angle(value)}
        assert one.samples() == {
            'received': COUNT,
            'used': COUNT - len(none),
            'dropped': {'non_finite': len(none)} if none else {},
        }
        assert other.used == COUNT

    check()


def drive(**values):
    return STREAMS['drive'].of({**MOTOR, **values})


@pytest.mark.parametrize('channel', range(4))
@given(size=MAGNITUDES)
def test_a_sample_that_no_drive_can_have_is_dropped_alone(channel, size):
    stream = drive()
    values = np.ones((5, 4))
    values[2, channel] = size
    (answer,) = stream.feed(0, drive_samples.encode(10**18 + STEP * np.arange(5), values), 0)
    used = int(3.0 + size * size < 1e12)
    assert stream.joint.samples() == {
        'received': 5,
        'used': 4 + used,
        'dropped': {} if used else {'non_finite': 1},
    }


@given(size=MAGNITUDES.filter(lambda size: not abs(size) < 1e6))
def test_currents_of_three_phases_are_balanced_as_before_a_huge_one(size):
    """Infinity as the recent largest current would balance all later ones."""
    stream = drive(input='current_voltage', frame='abc')
    for k, current in enumerate([1.0, size, 1.0]):
        stamp = 10**18 + k * STEP
        stream.feed(0, vector3.encode(stamp, '', current, -1.0, 0.0), 0)
        stream.feed(1, vector3.encode(stamp, '', 1.0, -1.0, 0.0), 0)
    assert stream.joint.samples() == {'received': 3, 'used': 2, 'dropped': {'non_finite': 1}}
    stream.feed(0, vector3.encode(stamp + STEP, '', 1.0, 1.0, 1.0), 0)
    assert stream.phases.unbalanced == 1
