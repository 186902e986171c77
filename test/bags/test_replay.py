# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Replay gives what the driver gives message by message, and loses nothing silently."""

import itertools
import json
import math
import shutil
from pathlib import Path

import bag_making as make
import pytest
from answers import estimated
from bag_making import OTHER, START, STATES, STORE
from hypothesis import example, given, settings
from hypothesis import strategies as st

from estimator_pkg import cli, observers
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.series import joint_series
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.driver.bank import Bank
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.messages.block import from_messages
from estimator_pkg.messages.joint_state import TYPE, Decoder, Encoder
from estimator_pkg.streams.angle import AngleSettings, AngleStream

NAMES = [['a', 'b'], ['b', 'a'], ['c'], ['a'], ['a', 'a'], [], ['b', 'c', 'a']]
ESTIMATE, STDDEV = '/joint_observer/estimate', '/joint_observer/estimate_stddev'


def configuration(name='finite_difference', **values):
    return Configuration(observers.find(name), values, {'b': {'bandwidth_hz': 77.0}})


def stream_of(setup, only=(), skip='nan'):
    return AngleStream(AngleSettings(joints=only or None, no_estimate=skip), setup)


def in_blocks(raws, cuts, setup, only=(), skip='nan'):
    """The stream, and its answers to blocks that end at `cuts`."""
    stream = stream_of(setup, only, skip)
    stream.history = {}
    found = [{} for _ in raws]
    edges = [0, *sorted(cut for cut in cuts if cut < len(raws)), len(raws)]
    for low, high in itertools.pairwise(edges):
        part = raws[low:high]
        block = from_messages([0] * len(part), range(len(part)), range(len(part)), part)
        for answers in stream.feed_block([0], block):
            for row, message in zip(answers.rows.tolist(), answers.raw):
                found[low + row][answers.output] = message.tobytes()
    return stream, found


@st.composite
def streams(draw):
    """Messages of joints that come and go, with bad values and stamps."""
    encode, now, raws = Encoder().encode, START, []
    step = 1_000_000
    regular = draw(st.integers(0, 3))
    efforts = draw(st.booleans())
    for i in range(draw(st.integers(1, 120))):
        names = NAMES[regular] if draw(st.integers(0, 9)) else draw(st.sampled_from(NAMES))
        now += step
        stamp = now
        odd = draw(st.integers(0, 40))
        if odd < 8:
            stamp = [now - step, now - 3 * step, 0, now + 10**12, now - 10**10, -5, now, now][odd]
            if odd == 4:
                now = stamp  # the bag loops
        if odd == 8:
            now += 10**9
        width = len(names) if odd != 9 else draw(st.integers(0, 3))
        positions = [0.01 * i + 0.3 * j for j in range(width)]
        if odd == 10 and positions:
            positions[-1] = draw(st.sampled_from([math.nan, math.inf, -math.inf, 1e300]))
        raws.append(
            encode(
                stamp,
                draw(st.sampled_from(['', 'base'])) if odd == 11 else 'base',
                names,
                positions,
                (),
                [0.1 * i, -0.2, 0.3][: len(names) - (odd == 12)] if efforts else (),
            )
        )
    return raws


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@example([Encoder().encode(START, '', ['a', 'b'], [0.0, 1e300])], [], 'pll', (), 'nan', True)
@given(
    raws=streams(),
    cuts=st.lists(st.integers(0, 120), max_size=8),
    name=st.sampled_from(['finite_difference', 'hybrid_angle', 'pll']),
    only=st.sampled_from([(), ('a',), ('b', 'nobody')]),
    skip=st.sampled_from(['nan', 'nan', 'skip']),
    unwrap=st.booleans(),
)
def test_blocks_of_any_size_give_what_single_messages_give(raws, cuts, name, only, skip, unwrap):
    setup = configuration(name, unwrap=unwrap)
    blocks, found = in_blocks(raws, cuts, setup, only, skip)
    single = stream_of(setup, only, skip)
    assert found == [dict(*single.feed(0, raw, 0)) for raw in raws]
    assert blocks.messages() == single.messages()
    assert list(blocks.bank.joints) == list(single.bank.joints)
    for joint, other in zip(blocks.bank.joints.values(), single.bank.joints.values()):
        assert joint.counts == other.counts


def replay(*words, code=0):
    assert cli.main(['replay', *map(str, words)]) == code


def messages_of(path, topic=None):
    with open_bag(path) as bag:
        return list(bag.messages(None if topic is None else [topic]))


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    return make.ours(tmp_path_factory.mktemp('replay') / 'bag', make.content(400))


def test_the_new_bag_holds_all_and_the_estimates(tmp_path):
    content = make.content(400)
    path = make.KINDS['mcap split'](tmp_path / 'bag', content)
    out = tmp_path / 'out'
    replay(path, '--observer', 'finite_difference', '--out', out)
    raws = [raw for topic, _, raw in content if topic == STATES]
    node = stream_of(Configuration(observers.find('finite_difference')))
    answers = [dict(*node.feed(0, raw, 0)) for raw in raws]
    for output, topic in enumerate((ESTIMATE, STDDEV)):
        made = [message.raw for message in messages_of(out, topic)]
        assert made == [answer[output] for answer in answers if answer]
    found = messages_of(out)
    copied = [message for message in found if message.topic in (STATES, OTHER)]
    assert [message[:2] + (message.raw,) for message in copied] == content
    for before, message in itertools.pairwise(found):  # each estimate follows its measurement
        if message.topic == ESTIMATE:
            assert (before.topic, before.log_ns) == (STATES, message.log_ns)
    with open_bag(out) as new, open_bag(path) as old:
        for name, topic in old.topics.items():
            assert new.topics[name].qos == topic.qos or not topic.qos
        assert new.topics[ESTIMATE].qos[0].depth == 50


def test_without_out_nothing_is_written(recording, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    replay(recording, '--observer', 'finite_difference', '--json', 'result.json')
    assert [path.name for path in tmp_path.iterdir()] == ['result.json']
    result = json.loads(Path('result.json').read_text())
    assert result['messages'] == {'received': 400, 'used': 400, 'dropped': {}, 'estimates': 390}
    joint = result['joints']['a']
    assert (joint['received'], joint['used'], joint['dropped']) == (400, 400, {})
    assert joint['rate_hz'] == pytest.approx(1000.0)
    assert sum(joint['status_s'].values()) == pytest.approx(0.399)
    assert joint['status_s']['tracking'] > 0.3
    assert 'a: received 400, used 400' in capsys.readouterr().out


def test_an_observer_that_fails_is_reported_in_one_line(recording, tmp_path, capsys, monkeypatch):
    """As an observer or a model of the user's own may, at any sample."""

    def fails(self, *samples, **options):
        return {}['gone']

    monkeypatch.setattr(Bank, 'joint', fails)
    out = tmp_path / 'out'
    replay(recording, '--observer', 'hybrid_angle', '--out', out, code=1)
    said = capsys.readouterr().err
    assert said.count('\n') == 1
    assert "the observer failed: KeyError: 'gone' (line " in said and 'of test_replay.py)' in said
    assert not out.exists()


def test_every_sample_is_accounted_for(tmp_path):
    encode = Encoder().encode

    def at(i):
        return START + i * 1_000_000

    raws = [encode(at(i), '', ['a', 'b'], [0.001 * i, 0.002 * i]) for i in range(50)]
    raws += [
        encode(at(49), '', ['a', 'b'], [0.05, 0.1]),
        encode(at(48), '', ['a'], [0.05]),
        encode(at(50), '', ['a', 'b'], [math.nan, 0.1]),
        encode(0, '', ['b'], [0.1]),
        encode(at(51), '', [], []),
        encode(at(51), '', ['a', 'b'], [0.05]),
        encode(at(51), '', ['a'], []),
        b'\0\1\0\0',
        b'garbage',
    ]
    path = make.ours(tmp_path / 'bag', [(STATES, at(i), raw) for i, raw in enumerate(raws)])
    replay(
        path,
        '--observer',
        'finite_difference',
        '--json',
        tmp_path / 'json',
        '--out',
        tmp_path / 'out',
    )
    result = json.loads((tmp_path / 'json').read_text())
    counts = result['messages']
    assert counts == {
        'received': 59,
        'used': 54,
        'dropped': {'empty': 2, 'mismatched': 1, 'malformed': 2},
        'estimates': 41,
    }
    assert result['joints']['a']['dropped'] == {'duplicate': 1, 'late': 1, 'non_finite': 1}
    assert result['joints']['b']['dropped'] == {'duplicate': 1, 'zero_stamp': 1}
    for joint in result['joints'].values():
        assert joint['received'] == joint['used'] + sum(joint['dropped'].values())
    # one message leaves for each of which a sample was used
    answers = [Decoder().decode(message.raw) for message in messages_of(tmp_path / 'out', ESTIMATE)]
    assert all(answer.names for answer in answers)
    assert sum(bool(estimated(answer)) for answer in answers) == counts['estimates']
    assert len(answers) == 51 and estimated(answers[-1]) == ('b',) != answers[-1].names


def test_gaps_and_loops_in_the_summary(tmp_path):
    encode = Encoder().encode
    stamps = (
        [i * 10 for i in range(100)]
        + [2000 + i * 10 for i in range(100)]
        + [i * 10 for i in range(100)]
    )
    raws = [encode(START + stamp * 1_000_000, '', ['a'], [0.001 * stamp]) for stamp in stamps]
    path = make.ours(tmp_path / 'bag', [(STATES, START + i, raw) for i, raw in enumerate(raws)])
    replay(path, '--observer', 'finite_difference', '--json', tmp_path / 'json')
    joint = json.loads((tmp_path / 'json').read_text())['joints']['a']
    assert joint['events'] == {'outage': 1, 'clock_jump': 1}
    assert joint['status_s']['gap'] == pytest.approx(1.01)
    assert sum(joint['status_s'].values()) == pytest.approx(1.01 + 3 * 0.99)


NO_STAMP = 'a: every sample dropped: no time stamp: stamp each sample in the driver'


@pytest.mark.parametrize(
    ('step', 'names', 'positions', 'words', 'why'),
    [
        (0, ['a'], [0.1], [], f"{NO_STAMP}, or set 'stamp_source: publisher'\n"),
        (0, ['a'], [0.1], ['--set', 'stamp_source=publisher'], f'{NO_STAMP}\n'),
        (1, ['a'], [math.nan], [], 'a: every sample dropped: NaN or infinite'),
        (
            1,
            ['a', 'b'],
            [math.nan] * 2,
            [],
            'every sample dropped: NaN or infinite positions, or too large for any joint (a, b)',
        ),
        (-1, ['a'], [0.1], [], 'a: 8 of 9 samples dropped: repeated stamps'),
        (1, ['a', 'b'], [0.1], [], 'no message of /joint_states has as many positions as names'),
        (1, ['a'], [], [], 'no message of /joint_states has a position'),
    ],
)
def test_why_there_is_no_estimate(step, names, positions, words, why, tmp_path, capsys):
    """`step` between stamps; 0: there are none; less: all are equal."""
    stamps = [step and START + max(i * step, 0) for i in range(9)]
    content = [(STATES, stamp, Encoder().encode(stamp, '', names, positions)) for stamp in stamps]
    bag = make.ours(tmp_path / 'bag', content)
    replay(bag, *words, code=1)
    said = capsys.readouterr().err
    assert f'{bag}: no estimate was made: {why}' in said and said.count('\n') == 1


def test_copies_names_and_one_joint(recording, tmp_path):
    words = ['--observer', 'pll', '--copy', OTHER, '--joint', 'b', '--name', 'mine']
    replay(recording, *words, '--out', tmp_path / 'out')
    with open_bag(tmp_path / 'out') as bag:
        assert set(bag.topics) == {OTHER, '/mine/estimate', '/mine/estimate_stddev'}
        assert list(joint_series(bag, '/mine/estimate')) == ['b']


def test_what_was_estimated_before_gives_way(recording, tmp_path, capsys):
    replay(recording, '--observer', 'finite_difference', '--out', tmp_path / 'first')
    capsys.readouterr()
    replay(tmp_path / 'first', '--observer', 'pll', '--out', tmp_path / 'second')
    assert f'{ESTIMATE} of' in capsys.readouterr().err
    first, second = (
        [message.raw for message in messages_of(tmp_path / name, ESTIMATE)]
        for name in ('first', 'second')
    )
    assert len(second) == 400 and first != second


def angle_bag(path, kind, values, *, publish_step=1_000_000):
    with BagWriter(path) as bag:
        bag.add_topic('/angle', f'std_msgs/msg/{kind}')
        for i, value in enumerate(values):
            raw = STORE.serialize_cdr(
                STORE.types[f'std_msgs/msg/{kind}'](value), f'std_msgs/msg/{kind}'
            )
            bag.write('/angle', START + i * 2_000_000, bytes(raw), START + i * publish_step)
    return path


def test_raw_counts_at_their_publish_times(tmp_path):
    path = angle_bag(tmp_path / 'bag', 'Int32', [(7 * i) % 4096 for i in range(300)])
    words = ['--observer', 'finite_difference', '--angle', '/angle:data', '--joint', 'wheel']
    sets = ['--set', 'counts_per_revolution=4096', '--set', 'angle_sign=-1']
    replay(path, *words, *sets, '--out', tmp_path / 'out')
    with open_bag(tmp_path / 'out') as bag:
        series = joint_series(bag, ESTIMATE)['wheel']
    assert series.velocity[-1] == pytest.approx(-7 * 2 * math.pi / 4096 * 1000, rel=0.01)
    assert series.stamps_ns[-1] == START + 299 * 1_000_000


def test_the_parameter_file_of_a_node_with_an_angle_topic(tmp_path):
    path = angle_bag(tmp_path / 'bag', 'Float64', [0.01 * i for i in range(200)])
    params = tmp_path / 'params.yaml'
    params.write_text(
        'joint_observer: {ros__parameters: {input: angle, angle_joint: arm, '
        'observer: finite_difference, use_sim_time: true, qos_overrides: {/x: {depth: 3}}}}'
    )
    replay(path, '--params', params, '--out', tmp_path / 'out')
    with open_bag(tmp_path / 'out') as bag:
        assert joint_series(bag, ESTIMATE)['arm'].velocity[-1] == pytest.approx(10.0)


def test_stamps_of_the_publisher(tmp_path):
    raws = [Encoder().encode(0, '', ['a'], [0.01 * i]) for i in range(100)]
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic(STATES, TYPE)
        for i, raw in enumerate(raws):
            bag.write(STATES, START + 5 * i, raw, START + i * 1_000_000)
    words = ['--observer', 'finite_difference', '--set', 'stamp_source=publisher']
    replay(tmp_path / 'bag', *words, '--out', tmp_path / 'out')
    with open_bag(tmp_path / 'out') as bag:
        series = joint_series(bag, ESTIMATE)['a']
    assert series.velocity[-1] == pytest.approx(10.0)
    assert series.stamps_ns[-1] == START + 99 * 1_000_000
    # estimates were never published: their times are those at which they would have been recorded
    assert [
        (message.log_ns, message.publish_ns) for message in messages_of(tmp_path / 'out', ESTIMATE)
    ] == [(START + 5 * i, START + 5 * i) for i in range(100)]


def test_a_file_that_names_another_observer_is_not_used(recording, tmp_path, capsys):
    """Gains of one observer mean something else in another."""
    words = ['--set', 'observer=pll']
    params = tmp_path / 'params.yaml'
    found = []
    for lines in ('observer: kalman\n    bandwidth_hz: 7.0', 'observer: pll'):
        params.write_text(f'/**:\n  ros__parameters:\n    {lines}\n')
        replay(recording, '--params', params, *words, '--out', tmp_path / 'out')
        found.append(
            [each.raw for each in messages_of(tmp_path / 'out', '/joint_observer/estimate')]
        )
        shutil.rmtree(tmp_path / 'out')
        error = capsys.readouterr().err
        unused = f'warning: {params} is not used: it names another observer than pll\n'
        assert error == unused * lines.startswith('observer: kalman')
    assert found[0] and found[0] == found[1]


def test_which_topic_is_the_measurement(tmp_path, capsys):
    raw = make.content(1)[0][2]

    def bag(name, topics):
        with BagWriter(tmp_path / name) as writer:
            for topic in topics:
                writer.add_topic(topic, TYPE)
                writer.write(topic, START, raw)
        return tmp_path / name

    truth = [
        '/ground_truth/joint_states',
        '/x/ground_truth/joint_states',
        '/obs/estimate',
        '/obs/estimate_stddev',
    ]
    replay(bag('one', ['/arm/joint_states', *truth]), code=1)  # one message is no estimate
    assert 'on /arm/joint_states' in capsys.readouterr().out
    replay(bag('usual', ['/arm/joint_states', STATES, *truth]), code=1)
    assert f'on {STATES}' in capsys.readouterr().out
    replay(bag('two', ['/arm/a', '/arm/b', *truth]), code=1)
    assert 'with --measurement (/arm/a, /arm/b)' in capsys.readouterr().err
    replay(bag('none', truth), code=1)
    assert 'has no measured joint states' in capsys.readouterr().err
