# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Single numbers out of messages of any type, held to what rosbags decodes."""

import math
import time

import numpy as np
import pytest
from bag_making import STORE, Stores, get_typestore
from hypothesis import given, settings
from hypothesis import strategies as st
from joint_state_bytes import block_of
from rosbags.typesys import get_types_from_msg

from estimator_pkg.bags.definitions import fields_of
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.field import Field

T = STORE.types
ODOMETRY = 'nav_msgs/msg/Odometry'


def values_of(type_name, path, raws):
    """(value, stamp, frame_id) of each message; None where it has none or is malformed."""
    field = Field(fields_of(type_name, ''), type_name, path)
    groups, malformed = field.decode_block(block_of(raws))
    found = [None] * len(raws)
    for group in groups:
        for i, row in enumerate(group.rows.tolist()):
            stamp = None if group.stamps_ns is None else int(group.stamps_ns[i])
            found[row] = (
                None if group.values is None else (float(group.values[i]), stamp, group.frame_id)
            )
    assert all(found[row] is None for row in malformed)
    for row, raw in enumerate(raws):  # one by one the same, to the last bit
        try:
            stamp, frame, value = field.decode(raw)
        except MalformedMessageError:
            assert row in malformed
        else:
            assert repr(found[row]) == repr(None if value is None else (value, stamp, frame))
    return found


def store_of(kind, definition):
    """Return a type store with this type."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, kind))
    return store


def header(i, frame='base'):
    return T['std_msgs/msg/Header'](
        stamp=T['builtin_interfaces/msg/Time'](sec=5 + i, nanosec=7), frame_id=frame
    )


def pose(i, yaw):
    return T['geometry_msgs/msg/Pose'](
        position=T['geometry_msgs/msg/Point'](x=1.0 * i, y=-2.0 * i, z=3.0),
        orientation=T['geometry_msgs/msg/Quaternion'](
            x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2)
        ),
    )


def odometry(i, frame='base', child='foot'):
    return T[ODOMETRY](
        header=header(i, frame),
        child_frame_id=child,
        pose=T['geometry_msgs/msg/PoseWithCovariance'](
            pose=pose(i, 0.3 * i), covariance=np.arange(36) + 0.5 * i
        ),
        twist=T['geometry_msgs/msg/TwistWithCovariance'](
            twist=T['geometry_msgs/msg/Twist'](
                linear=T['geometry_msgs/msg/Vector3'](x=9.0, y=8.0, z=7.0 + i),
                angular=T['geometry_msgs/msg/Vector3'](x=0.0, y=0.0, z=0.0),
            ),
            covariance=np.zeros(36),
        ),
    )


@pytest.mark.parametrize('little', [True, False])
@pytest.mark.parametrize(
    'path, wanted',
    [
        ('pose.pose.position.y', lambda i: -2.0 * i),
        ('pose.covariance[7]', lambda i: 7 + 0.5 * i),
        ('twist.twist.linear.z', lambda i: 7.0 + i),
        ('header.stamp.sec', lambda i: 5.0 + i),
    ],
)
def test_fields_of_odometry(path, wanted, little):
    frames = ['base', 'tool', '', 'some_longer_frame']
    children = ['', 'foot', 'ab']
    raws = [
        bytes(
            STORE.serialize_cdr(
                odometry(i, frames[i % 4], children[i % 3]), ODOMETRY, little_endian=little
            )
        )
        for i in range(24)
    ]
    for i, (value, stamp, frame) in enumerate(values_of(ODOMETRY, path, raws)):
        assert value == wanted(i)
        if not path.startswith('header'):
            assert (stamp, frame) == ((5 + i) * 10**9 + 7, frames[i % 4])


@settings(max_examples=30, deadline=None)
@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_yaw_is_right_under_roll_and_pitch(roll, pitch, yaw):
    cr, sr, cp, sp, cy, sy = (
        f(0.5 * angle) for angle in (roll, pitch, yaw) for f in (math.cos, math.sin)
    )
    message = T['geometry_msgs/msg/QuaternionStamped'](
        header=header(1),
        quaternion=T['geometry_msgs/msg/Quaternion'](
            x=sr * cp * cy - cr * sp * sy,
            y=cr * sp * cy + sr * cp * sy,
            z=cr * cp * sy - sr * sp * cy,
            w=cr * cp * cy + sr * sp * sy,
        ),
    )
    kind = 'geometry_msgs/msg/QuaternionStamped'
    raw = bytes(STORE.serialize_cdr(message, kind))
    ((found, stamp, _),) = values_of(kind, 'quaternion.yaw', [raw])
    assert math.remainder(found - yaw, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert stamp == 6 * 10**9 + 7


@pytest.mark.parametrize(
    'name, value',
    [('Float64', 2.5), ('Float32', 0.5), ('Int64', -(2**40)), ('UInt16', 65535), ('Bool', True)],
)
def test_single_numbers(name, value):
    kind = f'std_msgs/msg/{name}'
    raw = bytes(STORE.serialize_cdr(T[kind](data=value), kind))
    assert values_of(kind, 'data', [raw]) == [(float(value), None, '')]


@pytest.mark.long
@settings(max_examples=80, deadline=None)
@given(cut=st.integers(0, 700), noise=st.binary(max_size=40))
def test_bytes_that_are_no_message_are_malformed(cut, noise):
    whole = bytes(STORE.serialize_cdr(odometry(3), ODOMETRY))
    found = values_of(ODOMETRY, 'pose.pose.position.y', [whole[:cut], whole, noise])
    assert found[1][0] == -6.0
    needed = 4 + whole[4:].index(np.float64(-6.0).tobytes()) + 8
    assert (found[0] is None) == (cut < needed)


@pytest.mark.parametrize(
    'path, said',
    [
        ('pose.pose.positon.x', "has no field 'positon': did you mean 'position'?"),
        ('pose.pose.position', 'is a geometry_msgs/msg/Point: name one of its fields, x, y, z'),
        ('pose.pose.orientation', "take its yaw with 'pose.pose.orientation.yaw'"),
        ('pose.pose.orientation.yaw.x', 'yaw has no fields'),
        ('pose.covariance', "is a list: name an element, as in 'covariance[0]'"),
        ('pose.covariance[36]', 'has 36 elements'),
        ('pose[0].pose', 'is not a list'),
        ('header.frame_id', 'is a string: name a numeric field'),
        ('header.stamp.sec.x', 'has no fields of its own'),
        ('pose..x', 'is not a field'),
        ('a[b]', 'is not a field'),
    ],
)
def test_wrong_paths_say_what_is_right(path, said):
    with pytest.raises(UsageError) as caught:
        Field(fields_of(ODOMETRY, ''), ODOMETRY, path)
    assert said in str(caught.value)


def test_types_come_from_the_bag_first():
    own = 'float32 other\nfloat64 angle\n'
    reading = 'my_msgs/msg/Reading'
    assert not Field(fields_of(reading, own), reading, 'angle').is_integer
    with pytest.raises(UserError, match='has no definition of my_msgs/msg/Reading'):
        fields_of('my_msgs/msg/Reading', '')
    for text in ('this is no definition {', 'float64 x\nfloat64 x', 'Unknown x', 'float64'):
        assert 'pose' in fields_of(ODOMETRY, text)(ODOMETRY)


@pytest.mark.parametrize('types', [1, 3000])
def test_a_definition_of_many_fields_ends_at_once(types):
    lines = '\n'.join(f'float64 f{i}' for i in range(60_000 // types))
    parts = [f'{"=" * 80}\nMSG: p/T{i}\n{lines}' for i in range(types if types > 1 else 0)]
    first = lines if types == 1 else '\n'.join(f'T{i} t{i}' for i in range(types))
    begun = time.process_time()
    with pytest.raises(UserError, match='no definition of p/msg/Many that can be read'):
        fields_of('p/msg/Many', '\n'.join([first, *parts]))
    assert time.process_time() - begun < 1.0


def nested(levels, fields, last='float64 x'):
    """A definition whose types nest, with so many fields each."""
    kinds = [f'p/T{level}' for level in range(1, levels)]
    bodies = ['\n'.join(f'{kind} f{i}' for i in range(fields)) for kind in kinds] + [last]
    return f'\n{"=" * 80}\n'.join(
        f'MSG: p/T{level}\n{body}\nfloat64 last' if level else f'{body}\nfloat64 last'
        for level, body in enumerate(bodies)
    )


@pytest.mark.timeout(30)
@pytest.mark.parametrize(
    'definition',
    [
        nested(25, 10),
        nested(40, 1),
        nested(3, 2, 'p/T0 again'),
        'p/T0 again\nfloat64 last',
        'p/T1[1000000000] many\nfloat64 last\n' + '=' * 80 + '\nMSG: p/T1\nfloat64[0] none',
    ],
    ids=['wide', 'deep', 'in itself, late', 'in itself', 'long'],
)
def test_a_type_with_too_many_fields_is_refused(definition):
    with pytest.raises(
        UsageError, match='p/msg/T0 cannot be read: it has more than 100,000 fields'
    ):
        Field(fields_of('p/msg/T0', definition), 'p/msg/T0', 'last')


OWN = """\
string[] labels
std_msgs/Empty nothing
my_msgs/Part[] parts
wstring comment
================================================================================
MSG: my_msgs/Part
bool on
float32[<=3] readings
int64 angle
string unit
std_msgs/Header header
string note
================================================================================
MSG: std_msgs/Empty
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def test_a_header_after_the_number_gives_its_stamp():
    """In a type of the machine: texts, an empty message and lists before it, an odd type after."""
    kind = 'my_msgs/msg/Reading'
    types = store_of(kind, OWN).types

    def part(i, readings):
        time = types['builtin_interfaces/msg/Time'](sec=5 + i, nanosec=7)
        return types['my_msgs/msg/Part'](
            on=True,
            readings=np.array(readings, np.float32),
            angle=-i,
            unit='counts',
            header=types['std_msgs/msg/Header'](stamp=time, frame_id='f' * i),
            note='x' * i,
        )

    fields = fields_of(kind, OWN)
    angle = Field(fields, kind, 'parts[1].angle')
    reading = Field(fields, kind, 'parts[1].readings[1]')
    assert angle.is_integer and not reading.is_integer
    with pytest.raises(UsageError, match='cannot be read: a wstring'):
        Field(fields_of(kind, 'wstring a\nfloat64 b\n'), kind, 'b')
    whole = [
        types[kind](
            labels=['', 'ab', 'c' * i],
            nothing=types['std_msgs/msg/Empty'](),
            parts=[part(j, [0.5] * (i % 3) + [1.5 * j]) for j in range(i % 4)],
            comment='',
        )
        for i in range(1, 13)
    ]
    # rosbags writes no wstring: the message ends before it
    short = 'my_msgs/msg/Short'
    cut = store_of(short, OWN.replace('wstring comment\n', ''))
    for little in (True, False):
        for i, message in enumerate(whole, 1):
            same = cut.types[short](message.labels, message.nothing, message.parts)
            raw = bytes(cut.serialize_cdr(same, short, little_endian=little))
            if i % 4 < 2:
                assert angle.decode(raw).value is None
                continue
            assert angle.decode(raw) == (6 * 10**9 + 7, 'f', -1.0)
            found = reading.decode(raw)
            assert found.stamp_ns == 6 * 10**9 + 7
            assert found.value == {0: None, 1: 1.5, 2: 0.5}[i % 3]


@pytest.mark.parametrize(
    'own, stamped',
    [
        ('std_msgs/Header first\nfloat64 angle\nstd_msgs/Header last\n', 5),
        ('float64 angle\nfloat32 torque\nstd_msgs/Header last\n', 6),
    ],
)
def test_the_header_before_the_number_goes_before_the_one_after_it(own, stamped):
    kind = 'my_msgs/msg/Reading'
    definition = own + OWN[OWN.index(f'{"=" * 80}\nMSG: std_msgs/Header') :]
    store = store_of(kind, definition)
    sent = {'first': header(0), 'angle': 0.5, 'torque': 2.0, 'last': header(1)}
    fields = {name: value for name, value in sent.items() if f' {name}\n' in own}
    raw = bytes(store.serialize_cdr(store.types[kind](**fields), kind))
    stamp, _, value = Field(fields_of(kind, definition), kind, 'angle').decode(raw)
    assert (stamp, value) == (stamped * 10**9 + 7, 0.5)


def test_zeros_are_no_orientation():
    """Trackers and IMUs without an orientation send them; their yaw is not 0."""
    messages = [
        T['geometry_msgs/msg/Quaternion'](x=x, y=0.0, z=0.0, w=w)
        for x, w in ((0.0, 0.0), (0.0, 1.0), (math.nan, 0.0))
    ]
    kind = 'geometry_msgs/msg/Quaternion'
    raws = [bytes(STORE.serialize_cdr(each, kind)) for each in messages]
    (zero, _, _), unit, (nan, _, _) = values_of(kind, 'yaw', raws)
    assert math.isnan(zero) and math.isnan(nan) and unit[0] == 0.0
