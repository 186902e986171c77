# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Known inputs without ROS: when an effort acts, effort_command's messages, who takes them."""

import math
import struct

import pytest
from answers import estimated

from estimator_pkg import cli, observers
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.driver.adaptive import AdaptiveBank, AdaptiveConfiguration
from estimator_pkg.driver.efforts import (
    COMMANDED,
    EFFORT_COMMAND,
    EFFORT_FIELD,
    MEASURED,
    Acting,
    DrivenSettings,
)
from estimator_pkg.errors import UsageError
from estimator_pkg.messages import joint_state, multi_array
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import Decoder, Encoder
from estimator_pkg.streams.adaptive import AdaptiveSettings
from estimator_pkg.streams.driven import ARRAY, BY_NAME, EffortCommands

MS = 1_000_000
START = 10**15
NAN = math.nan


def acted(source, settings, samples, commands=()):
    """What acted at each sample: (ms, effort) each; commands come before samples of their time."""
    acting, found, before = Acting(1, source, settings), [], 0
    waiting = list(commands)
    for at, effort in samples:
        while waiting and waiting[0][0] <= at:
            since, value = waiting.pop(0)
            acting.command(0, START + round(since * MS), value)
        found += acting.known_input(before, START + at * MS, (effort,), settings)
        before = START + at * MS
    return found


SAMPLES = [(0, 1.0), (2, 2.0), (4, 4.0), (6, 8.0)]


@pytest.mark.parametrize(
    'effort_is, delay, expected',
    [
        (None, 0.0, [1.0, 2.0, 4.0, 8.0]),  # the mean since the sample before, as it came
        (MEASURED, 0.002, [NAN, NAN, 2.0, 4.0]),
        (MEASURED, 0.001, [NAN, NAN, 3.0, 6.0]),
        (COMMANDED, 0.0, [NAN, 1.0, 2.0, 4.0]),  # from the stamp of its sample on
        (COMMANDED, 0.001, [NAN, NAN, 1.5, 3.0]),
    ],
)
def test_when_the_effort_of_a_sample_acts(effort_is, delay, expected):
    settings = DrivenSettings(effort_is=effort_is, input_delay=(delay,))
    assert acted(EFFORT_FIELD, settings, SAMPLES) == pytest.approx(expected, nan_ok=True)


@pytest.mark.parametrize(
    'effort_is, delay, expected',
    [
        (None, 0.0, [NAN, 1.5, 2.0, 2.0]),
        (COMMANDED, 0.001, [NAN, NAN, 2.0, 2.0]),
        (MEASURED, 0.0, [NAN, 2.0, 2.0, 2.0]),
    ],
)  # 2.0 acted since the command before
def test_when_an_effort_command_acts(effort_is, delay, expected):
    settings = DrivenSettings(effort_is=effort_is, input_delay=(delay,))
    found = acted(EFFORT_COMMAND, settings, [(at, NAN) for at, _ in SAMPLES], [(0, 1.0), (1, 2.0)])
    assert found[1:] == pytest.approx(expected[1:], nan_ok=True)


@pytest.mark.parametrize('source', [EFFORT_FIELD, EFFORT_COMMAND])
@pytest.mark.parametrize('garbage', [1e9, -1e300, math.inf, NAN])
def test_garbage_is_no_input(source, garbage):
    efforts = [(0, 1.0), (1, garbage), (2, 3.0), (3, 3.0)]
    found = acted(source, DrivenSettings(), efforts, efforts)
    assert not any(abs(effort) >= 1e9 for effort in found) and found[-1] == 3.0
    if source == EFFORT_FIELD:
        assert math.isnan(found[1])


def test_scale_sign_and_timeout():
    settings = DrivenSettings(input_scale=(-2.0,), input_timeout=0.004)
    assert acted(EFFORT_FIELD, settings, SAMPLES) == [-2.0, -4.0, -8.0, -16.0]
    found = acted(EFFORT_COMMAND, settings, [(at, NAN) for at in (0, 2, 4, 6, 8)], [(0, 1.0)])
    assert found == pytest.approx([-2.0, -2.0, -2.0, -2.0, NAN], nan_ok=True)


@pytest.mark.parametrize('effort_is', [MEASURED, COMMANDED])
@pytest.mark.parametrize('delay', [0.0, 0.002])
def test_a_hole_longer_than_the_timeout_leaves_the_effort_known(effort_is, delay):
    """The timeout is for commands that stop. An effort beside its position was there all the time,
    and that it acts late changes nothing.
    """
    settings = DrivenSettings(effort_is=effort_is, input_delay=(delay,), input_timeout=0.004)
    samples = [(at, 1.0) for at in (*range(10), *range(15, 30))]
    found = acted(EFFORT_FIELD, settings, samples)
    assert found[4:] == [1.0] * (len(samples) - 4)


def test_a_late_sample_takes_no_effort_away():
    settings = DrivenSettings(effort_is=COMMANDED)
    acting = Acting(1, EFFORT_FIELD, settings)
    acting.known_input(0, START, (1.0,), settings)
    acting.known_input(START, START + 2 * MS, (2.0,), settings)
    acting.known_input(START + 2 * MS, START + MS, (9.0,), settings)  # late: it will be dropped
    assert acting.known_input(START + 2 * MS, START + 4 * MS, (3.0,), settings) == (2.0,)


@pytest.mark.parametrize('back', [50, 500, 10_000])
@pytest.mark.parametrize('delay', [0.0, 0.002])
@pytest.mark.parametrize('effort_is', [MEASURED, COMMANDED])
def test_a_clock_that_jumps_back_is_found_and_the_efforts_go_on(effort_is, delay, back):
    observer = observers.find('adaptive')
    common = {'effort_is': effort_is, 'input_delay': (delay,)}
    bank = AdaptiveBank(AdaptiveConfiguration(observer, common))
    for k in range(100):
        bank.take(START + k * MS, ('j',), (0.01 * k,), (1.0,))
    joint, used = bank.joints['j'], bank.joints['j'].used
    for k in range(100 - back, 120 - back):
        bank.take(START + k * MS, ('j',), (0.01 * k,), (1.0,))
    assert joint.events() == {'clock_jump': 1} and joint.used - used >= 13
    assert joint.received == 120 and bank.why_silent('j') == ''


@pytest.mark.parametrize('delay', [0.0, 0.002])
@pytest.mark.parametrize('source', [EFFORT_FIELD, EFFORT_COMMAND])
def test_simulated_time_begins_near_zero(source, delay):
    """Before 10 s, too, there is no sample before the first one."""
    settings = DrivenSettings(effort_is=COMMANDED, input_delay=(delay,))
    acting = Acting(1, source, settings)
    found = []
    for k in range(1, 6):
        acting.command(0, k * MS, 3.0)
        found += acting.known_input(0, k * MS, (3.0,), settings)
    assert found[3:] == [3.0, 3.0]


def test_one_number_for_all_inputs_or_each():
    settings = DrivenSettings(input_scale=(1.0, -1.0), input_delay=(0.0, 0.0))
    assert Acting(2, EFFORT_FIELD, settings).known_input(0, START, (3.0, 4.0), settings) == (
        3.0,
        -4.0,
    )
    with pytest.raises(UsageError, match="two: 'input_scale' has 2 numbers for 3 inputs"):
        settings.check_inputs(3, 'two')


# Messages


def array(numbers, dimensions=0, offset=0):
    """CDR bytes of a Float64MultiArray."""
    raw = struct.pack('<4BI', 0, 1, 0, 0, dimensions)
    for _ in range(dimensions):
        raw += struct.pack('<I2s2xII', 2, b'x\0', len(numbers), len(numbers))
    raw += struct.pack('<II', offset, len(numbers))
    if numbers:
        raw += b'\0' * (-(len(raw) - 4) % 8)
    return raw + struct.pack(f'<{len(numbers)}d', *numbers)


def test_arrays_stand_for_all_joints_or_the_driven_ones():
    commands = EffortCommands(ARRAY, [('a', 'b', 'c'), ('b',)], False)
    assert commands.decode(array([1.0, 2.0, 3.0]), 5) == (5, ('a', 'b', 'c'), (1.0, 2.0, 3.0))
    assert commands.decode(array([7.0], dimensions=1), 6) == (6, ('b',), (7.0,))
    assert commands.decode(array([0.0, 7.0], offset=1), 6) == (6, ('b',), (7.0,))
    for raw, words in (
        (array([1.0, 2.0]), '2 numbers, but there are 3 or 1 joints'),
        (array([1.0], offset=2), 'data offset 2 is beyond'),
        (array([1.0])[:-3], 'too short'),
        (b'', 'not a CDR message'),
        (array([]), '0 numbers'),
    ):
        with pytest.raises(MalformedMessageError, match=words):
            commands.decode(raw, 5)


def test_joint_states_have_names_and_a_stamp():
    raw = Encoder().encode(START, 'base', ('a', 'b'), (), (), (1.0, 2.0))
    assert EffortCommands(BY_NAME, [], False).decode(raw, 5) == (START, ('a', 'b'), (1.0, 2.0))
    assert EffortCommands(BY_NAME, [], True).decode(raw, 5)[0] == 5
    with pytest.raises(MalformedMessageError, match='2 names, but 1 efforts'):
        EffortCommands(BY_NAME, [], False).decode(
            Encoder().encode(START, '', ('a', 'b'), (), (), (1.0,)), 5
        )


def test_an_array_needs_the_joints_by_name():
    with pytest.raises(UsageError, match="set 'joints'"):
        AdaptiveSettings(input=EFFORT_COMMAND, effort_command_type=ARRAY).find_observer()


# Who takes them


def turning(k):
    return 0.3 * math.sin(0.002 * k), math.cos(0.017 * k)


def test_the_adaptive_joint_takes_commands_as_it_takes_fields():
    """A command at each sample's stamp acts until the next: the field of the sample after it."""
    adaptive = observers.find('adaptive')

    def bank(source, **values):
        return AdaptiveBank(AdaptiveConfiguration(adaptive, values), (), source)

    field, command = bank(EFFORT_FIELD), bank(EFFORT_COMMAND)
    for k in range(400):
        position, effort = turning(k)
        field.take(START + k * MS, ('j',), (position,), (effort,))
        command.take(START + k * MS, ('j',), (position,), ())
        if k < 399:
            command.command(START + k * MS, ('x', 'j'), (9.0, turning(k + 1)[1]))
    assert command.joints['j'].used == 399  # nothing had acted before the first
    assert command.joints['j'].dropped() == {'non_finite': 1}
    late = bank(EFFORT_COMMAND)
    late.take(START, ('j',), (0.1,), ())
    assert late.why_silent('j') == (
        'no effort_command is valid for it: none had its name, check the names there'
    )
    late.command(START - 3000 * MS, ('j',), (1.0,))
    late.take(START + MS, ('j',), (0.1,), ())
    assert '3.001 s older than the position' in late.why_silent('j')
    assert field.why_silent('j') == command.why_silent('j') == ''
    same = bank(EFFORT_FIELD)
    for k in range(1, 400):
        position, effort = turning(k)
        same.take(START + k * MS, ('j',), (position,), (effort,))
    assert command.joints['j'].estimate() == same.joints['j'].estimate()


# Replay


def record(path, kind):
    """Record positions every 2 ms, and efforts in their messages, by name, or as an array."""
    encode = Encoder().encode
    with BagWriter(path) as bag:
        bag.add_topic('/joint_states', joint_state.TYPE)
        if kind != 'field':
            type_name = multi_array.TYPE if kind == 'array' else joint_state.TYPE
            bag.add_topic('/effort_command', type_name)
        for k in range(600):
            stamp, position, effort = START + 2 * k * MS, 0.3 + 1e-4 * k, turning(k)[1]
            raw, since = array([effort]), stamp - 2 * MS  # it acts from the sample before on
            if kind == 'by_name':
                raw = encode(since, '', ('joint',), (), (), (effort,))
            if kind != 'field':
                bag.write('/effort_command', since, raw)
            efforts = (effort,) if kind == 'field' else ()
            bag.write(
                '/joint_states', stamp, encode(stamp, '', ('joint',), (position,), (), efforts)
            )


COMMANDS = '--set input=effort_command'
KINDS = {
    'field': '',
    'by_name': COMMANDS,
    'array': f'{COMMANDS} --set effort_command_type=Float64MultiArray',
}


@pytest.mark.long
@pytest.mark.parametrize(
    'observer, node', [('switched', 'switched_observer'), ('geso', 'mechanical_observer')]
)
def test_replay_takes_the_topic_as_the_node_does(observer, node, tmp_path, capsys):
    """Arrays at the time of sending, and by name: the same estimates as from the effort field."""
    found, decode = {}, Decoder().decode
    for kind, more in KINDS.items():
        record(tmp_path / kind, kind)
        out = tmp_path / f'{kind}_out'
        words = f'replay {tmp_path / kind} --observer {observer} {more} --out {out}'
        assert cli.main(words.split()) == 0
        with open_bag(out) as bag:
            messages = [decode(bytes(each.raw)) for each in bag.messages([f'/{node}/estimate'])]
        assert {len(each.efforts) for each in messages} == {int(kind == 'field')}
        found[kind] = [
            (each.stamp_ns, each.positions, each.velocities) for each in messages if estimated(each)
        ]
    assert len(found['field']) > 100
    assert found['field'] == found['by_name'] == found['array']
    capsys.readouterr()
    words = f'replay {tmp_path / "field"} --observer {observer} {COMMANDS} --out {tmp_path / "x"}'
    assert cli.main(words.split()) == 1
    assert "has no topic '/effort_command'" in capsys.readouterr().err
