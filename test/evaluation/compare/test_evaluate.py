# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The command evaluate on small bags whose answers are known."""

import json
import math
import struct
from pathlib import Path

import numpy as np
import pytest
from bag_making import STORE
from joint_bags import write_bag

from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.cli import main
from estimator_pkg.evaluation import text
from estimator_pkg.evaluation.reference.late import common_lag
from estimator_pkg.evaluation.reference.reference import Reference
from estimator_pkg.messages.joint_state import TYPE, Encoder
from estimator_pkg.observers import DEFAULT

BAGS = Path(__file__).resolve().parents[3] / 'bags'

T = STORE.types
TURN = 2.0 * math.pi
START = 1_700_000_000_000_000_000
MEASUREMENT, TRUTH, ESTIMATE = '/joint_states', '/ground_truth/joint_states', '/observer/estimate'


def stamps_of(seconds=4.0, rate=500.0, start=START):
    return [start + round(i * 1e9 / rate) for i in range(1, int(seconds * rate) + 1)]


def motion(stamp, late=0.0):
    t = (stamp - START) * 1e-9 - late
    return 12.0 / TURN * math.sin(TURN * t) + 6.0 * t, 12.0 * math.cos(TURN * t) + 6.0


def wrapped(angle):
    return (angle + math.pi) % TURN - math.pi


def measured(stamps, joint='a', late=0.0):
    return [(s, (joint,), (wrapped(motion(s, late)[0]),), ()) for s in stamps]


def true(stamps, joint='a', late=0.0, bias=0.0, position=True):
    return [
        (s, (joint,), (motion(s)[0],) if position else (), (motion(s, late)[1] + bias,))
        for s in stamps
    ]


def estimated(stamps, joint='a', late=0.0, bias=0.0):
    return [
        (s, (joint,), (wrapped(motion(s, late)[0]),), (motion(s, late)[1] + bias,)) for s in stamps
    ]


@pytest.fixture(scope='module')
def good(tmp_path_factory):
    """Measurement, truth, and estimates 6 ms late and 0.1 rad/s high."""
    stamps = stamps_of()
    return write_bag(
        tmp_path_factory.mktemp('evaluate') / 'good',
        {
            MEASUREMENT: measured(stamps),
            TRUTH: true(stamps),
            ESTIMATE: estimated(stamps[10:], late=0.006, bias=0.1),
        },
    )


def evaluate(tmp_path, *words):
    """The result as JSON."""
    out = tmp_path / 'out.json'
    assert main(['evaluate', *words, '--json', str(out)]) == 0
    return json.loads(out.read_text(), parse_constant=pytest.fail)


def fails(capsys, *words, code=1):
    """The one line of the error."""
    assert main(['evaluate', *words]) == code
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    return lines[0]


# ---------------------------------------------------------------- the numbers


def test_errors_and_delay_are_those_put_in(good, tmp_path):
    joint = evaluate(tmp_path, good)['bags'][good]['estimates'][ESTIMATE]['joints']['a']
    assert joint['samples'] == {'received': 2000, 'used': 2000, 'dropped': {}}
    assert joint['matched'] == {
        'estimates': 1990,
        'compared': 1990,
        'interpolated': 0,
        'unmatched': 0,
    }
    assert joint['velocity']['mean_abs'] < joint['velocity']['rms']
    late = 12.0 * 2.0 * math.sin(TURN * 0.003)  # amplitude of a sine minus itself 6 ms later
    assert joint['velocity']['bias'] == pytest.approx(0.1, abs=0.01)
    assert joint['velocity']['rms'] == pytest.approx(
        math.hypot(late / math.sqrt(2.0), 0.1), rel=0.02
    )
    assert joint['velocity']['max_abs'] == pytest.approx(late + 0.1, rel=1e-3)
    assert joint['velocity']['delay_s'] == pytest.approx(0.006, abs=1e-4)
    assert joint['velocity']['noise'] is None  # the truth is never constant, and JSON has no nan
    assert joint['position']['delay_s'] == pytest.approx(0.006, abs=1e-6)
    assert joint['position']['max_abs'] < 0.11  # across the wraps, which the truth does not have


@pytest.mark.parametrize(
    'words, compared',
    [(('--from', '1'), 1500), (('--to', '3'), 1491), (('--from', '1', '--to', '3'), 1001)],
)
def test_the_part_counts_from_the_first_measurement(good, tmp_path, words, compared):
    joint = evaluate(tmp_path, good, *words)['bags'][good]['estimates'][ESTIMATE]
    assert joint['joints']['a']['matched']['compared'] == compared


def test_truth_at_other_stamps_is_interpolated_and_said_so(tmp_path, capsys):
    stamps = stamps_of()
    bag = write_bag(
        tmp_path / 'bag',
        {
            TRUTH: true([s + 700_000 for s in stamps if not 1.0 < (s - START) * 1e-9 < 2.0]),
            ESTIMATE: estimated(stamps),
        },
    )
    joint = evaluate(tmp_path, bag)['bags'][bag]['estimates'][ESTIMATE]['joints']['a']
    # the first estimate comes before the truth; those in its hole have none either
    assert joint['matched'] == {
        'estimates': 2000,
        'compared': 1499,
        'interpolated': 1499,
        'unmatched': 501,
    }
    assert joint['velocity']['max_abs'] < 3e-4
    out = ' '.join(capsys.readouterr().out.split())
    assert '1499 have an interpolated truth, 501 none' in out


def test_samples_are_counted_by_kind(tmp_path):
    stamps = stamps_of()
    rows = measured(stamps)
    rows[50] = (rows[49][0], *rows[50][1:])  # a duplicate
    rows[60] = (rows[60][0], ('a',), (math.nan,), ())
    bag = write_bag(
        tmp_path / 'bag', {MEASUREMENT: rows, TRUTH: true(stamps), ESTIMATE: estimated(stamps)}
    )
    samples = evaluate(tmp_path, bag)['bags'][bag]['estimates'][ESTIMATE]['joints']['a']['samples']
    assert samples == {'received': 2000, 'used': 1998, 'dropped': {'duplicate': 1, 'non_finite': 1}}


def test_observers_and_recorded_estimates_stand_in_one_table(good, tmp_path, capsys):
    words = '--observer', 'all', '--estimate', ESTIMATE
    estimates = evaluate(tmp_path, good, *words)['bags'][good]['estimates']
    assert list(estimates)[-1] == ESTIMATE
    assert {'finite_difference', 'hybrid_angle', 'kalman', 'pll'} <= set(estimates)
    for name in ('finite_difference', 'pll'):
        assert 0.003 < estimates[name]['joints']['a']['velocity']['delay_s'] < 0.02
    printed = capsys.readouterr().out
    assert all(f'\n{name} ' in printed for name in estimates)


def test_several_bags_and_joints(good, tmp_path):
    stamps = stamps_of(2.0)
    other = write_bag(
        tmp_path / 'other',
        {
            TRUTH: true(stamps, 'a') + true(stamps, 'b'),
            ESTIMATE: estimated(stamps, 'b', bias=-0.2) + estimated(stamps, 'stray'),
        },
    )
    found = evaluate(tmp_path, good, other)['bags']
    assert list(found) == [good, other]
    joints = found[other]['estimates'][ESTIMATE]['joints']
    assert list(joints) == ['b']
    assert joints['b']['velocity']['bias'] == pytest.approx(-0.2)
    assert found[other]['notes'] == ["joint 'stray' has no truth"]


# ---------------------------------------------------------------- the reference


@pytest.fixture(scope='module')
def late_reference(tmp_path_factory):
    """A truth that lags the position by 2 ms and reads 0.05 rad/s low."""
    stamps = stamps_of(8.0)
    return write_bag(
        tmp_path_factory.mktemp('evaluate') / 'late',
        {
            MEASUREMENT: measured(stamps),
            TRUTH: true(stamps, late=0.002, bias=-0.05, position=False),
            ESTIMATE: estimated(stamps),
        },
    )


@pytest.mark.parametrize(
    ('words', 'delay', 'bias', 'notes'),
    [
        (['--no-correct-reference'], -0.002, 0.05, 0),
        pytest.param([], 0.0, 0.05, 1, marks=pytest.mark.long),  # a certain lag, but no bias
        (['--correct-reference'], 0.0, 0.0, 1),
    ],
)
def test_what_is_removed_of_a_truth_is_what_is_asked(
    late_reference, tmp_path, capsys, words, delay, bias, notes
):
    found = evaluate(tmp_path, late_reference, *words)['bags'][late_reference]
    assert found['reference']['a']['lag_s'] == pytest.approx(0.002, abs=1e-5)
    assert found['reference']['a']['bias'] == pytest.approx(-0.05, abs=2e-3)
    joint = found['estimates'][ESTIMATE]['joints']['a']
    assert joint['velocity']['delay_s'] == pytest.approx(delay, abs=2e-4)
    assert joint['velocity']['bias'] == pytest.approx(bias, abs=5e-3)
    assert joint['position']['rms'] is None  # this truth has no position
    assert 'lag 2.00 +- ' in capsys.readouterr().out
    assert len(found['notes']) == notes
    assert all('the truth is 2.00' in each for each in found['notes'])


@pytest.mark.long
def test_a_late_sensor_is_no_late_truth(tmp_path):
    stamps = stamps_of(8.0)
    early = write_bag(  # and so is every estimate
        tmp_path / 'early',
        {
            MEASUREMENT: measured(stamps, late=0.002),
            TRUTH: true(stamps),
            ESTIMATE: estimated(stamps, late=0.002),
        },
    )
    found = evaluate(tmp_path, early)['bags'][early]
    assert found['notes'] == []
    joint = found['estimates'][ESTIMATE]['joints']['a']
    assert joint['velocity']['delay_s'] == pytest.approx(0.002, abs=2e-5)


@pytest.mark.parametrize(
    ('lags', 'common'),
    [
        ([(1e-3, 1e-5), (1.01e-3, 1e-5)], 1.005e-3),
        ([(1e-3, 1e-5), (math.nan, math.nan)], 1e-3),
        ([(1e-3, 1e-5), (2e-3, 1e-5)], None),
        ([(1e-3, 4e-4)], None),
        ([(-1e-3, 1e-5)], None),
        ([(5e-5, 1e-6)], None),
    ],
)
def test_a_lag_is_removed_only_if_it_is_significant_and_common(lags, common):
    every = {i: Reference(*lag, 0.0, 1e-3, 1.0, 1e-3, 0.1, 0.1) for i, lag in enumerate(lags)}
    found = common_lag(every)
    assert found is None if common is None else found.lag == pytest.approx(common)


def test_the_row_says_where_the_reference_cannot_tell(tmp_path, capsys):
    random = np.random.default_rng(1)
    stamps = stamps_of(4.0)
    noisy = [(s, ('a',), (), (motion(s)[1] + 0.1 * random.standard_normal(),)) for s in stamps]
    bag = write_bag(
        tmp_path / 'bag',
        {
            MEASUREMENT: measured(stamps),
            TRUTH: noisy,
            '/good/estimate': estimated(stamps),
            '/bad/estimate': estimated(stamps, bias=0.3),
        },
    )
    found = evaluate(tmp_path, bag)['bags'][bag]
    assert found['reference']['a']['noise'] == pytest.approx(0.1, rel=0.2)
    assert found['estimates']['/good/estimate']['joints']['a']['reference_cannot_tell'] is True
    assert found['estimates']['/bad/estimate']['joints']['a']['reference_cannot_tell'] is False
    printed = capsys.readouterr().out
    good_line = next(line for line in printed.splitlines() if line.startswith('/good/estimate'))
    bad_line = next(line for line in printed.splitlines() if line.startswith('/bad/estimate'))
    assert ' * ' in good_line and ' * ' not in bad_line
    assert "below the reference's own error" in printed


# ---------------------------------------------------------------- without a truth


def coarse(stamps, count):
    """Readings in steps of `count` [rad]."""
    return [(s, ('a',), (wrapped(math.floor(motion(s)[0] / count) * count),), ()) for s in stamps]


def test_without_truth_the_smoother_is_the_reference(tmp_path, capsys):
    stamps = stamps_of()
    bag = write_bag(
        tmp_path / 'bag',
        {MEASUREMENT: coarse(stamps, TURN / 4096), ESTIMATE: estimated(stamps, bias=0.3)},
    )
    found = evaluate(tmp_path, bag)['bags'][bag]
    velocity = found['estimates'][ESTIMATE]['joints']['a']['velocity']
    assert velocity['bias'] == pytest.approx(0.3, abs=0.005)
    assert found['truth'] == 'the off-line smoother' and not found['refused']
    known = found['reference']['a']
    assert known['origin'] == 'smoother' and 0.001 < known['noise'] < 0.05
    assert known['smoother']['quantum'] == pytest.approx(TURN / 4096, rel=0.01)
    assert "the off-line smoother's own error is" in capsys.readouterr().out


def test_a_joint_that_moves_too_little_is_not_ranked(tmp_path, capsys):
    stamps = stamps_of(4.0, 100.0)
    bag = write_bag(
        tmp_path / 'bag',
        {MEASUREMENT: coarse(stamps, TURN / 4), ESTIMATE: estimated(stamps, bias=0.02)},
    )
    found = evaluate(tmp_path, bag)['bags'][bag]
    assert found['refused']['a'].startswith('a: No ranking: the reading changes only')
    assert found['estimates'][ESTIMATE]['joints']['a']['reference_cannot_tell'] is True
    assert 'No ranking: the reading changes only' in capsys.readouterr().out


def test_without_truth_the_estimates_are_ranked(tmp_path, capsys):
    """A coarse reading and a bias of 2 rad/s: the better estimate is declared."""
    stamps = stamps_of(4.0, 200.0)
    other = '/other/estimate'
    bag = write_bag(
        tmp_path / 'bag',
        {
            MEASUREMENT: coarse(stamps, TURN / 64),
            ESTIMATE: estimated(stamps, bias=0.02),
            other: estimated(stamps, bias=2.0),
        },
    )
    verdict = evaluate(tmp_path, bag)['bags'][bag]['verdict']['a']
    assert verdict['best'] == ESTIMATE and verdict['ties'] == []
    assert verdict['rms'][other] == pytest.approx(2.0, rel=0.15)
    assert verdict['pairs'][0]['sign'] == 1
    out = ' '.join(capsys.readouterr().out.split())
    for sentence in verdict['sentences']:
        assert sentence in out
    assert f'{ESTIMATE} is better than {other} (95 %).' in out


def test_samples_without_a_stamp(tmp_path, capsys):
    stamps = stamps_of()
    path = tmp_path / 'bag'
    with BagWriter(path) as bag:
        bag.add_topic(MEASUREMENT, TYPE)
        for stamp, names, positions, _ in coarse(stamps, TURN / 4096):
            bag.write(MEASUREMENT, stamp + 5, Encoder().encode(0, '', names, positions, ()), stamp)
    words = (str(path), '--observer', 'pll')
    assert '--set stamp_source=publisher' in fails(capsys, *words)
    by_publisher = ('--set', 'stamp_source=publisher')
    found = evaluate(tmp_path, *words, *by_publisher)['bags'][str(path)]
    assert found['estimates']['pll']['joints']['a']['samples']['used'] == len(stamps)
    assert 0.05 < found['estimates']['pll']['joints']['a']['velocity']['rms'] < 1.0
    # what replay makes of it is judged by the same times
    assert main(['replay', *words, *by_publisher, '--out', str(tmp_path / 'out')]) == 0
    again = evaluate(tmp_path, str(tmp_path / 'out'))['bags'][str(tmp_path / 'out')]
    replayed = again['estimates']['/joint_observer/estimate']['joints']['a']
    assert replayed['velocity'] == found['estimates']['pll']['joints']['a']['velocity']


@pytest.mark.parametrize('drops', [True, False])
def test_a_truth_without_stamps_leads_to_what_works(drops, tmp_path, capsys):
    """The publishers' times would not help: the truth has none that compare with them."""
    rows = [(*row[:3], [1.0], row[0]) for row in coarse(stamps_of(), TURN / 4096)]
    bare = [(0, *row[1:]) for row in rows]
    path = write_bag(tmp_path / 'bag', {MEASUREMENT: bare if drops else rows, TRUTH: bare})
    words = [path, '--observer', 'pll']
    assert '--reference smoother' in fails(capsys, *words)
    words += ['--reference', 'smoother']
    if drops:
        assert '--set stamp_source=publisher' in fails(capsys, *words)
        words += ['--set', 'stamp_source=publisher']
    assert main(['evaluate', *words]) == 0


def test_one_reference_is_for_one_clock(good, tmp_path, capsys):
    file = tmp_path / 'pll.yaml'
    file.write_text('/**:\n  ros__parameters: {observer: pll, stamp_source: publisher}\n')
    line = fails(
        capsys, good, '--observer', 'pll', '--observer', 'kalman', '--params', str(file), code=2
    )
    assert "observers have different 'stamp_source'" in line


# ---------------------------------------------------------------- errors, one line each


@pytest.mark.parametrize(
    ('words', 'code', 'said'),
    [
        (('--truth', '/wrong', '--reference', 'smoother'), 1, ('/wrong',)),
        *(
            ((option, '/wrong'), 1, ('/wrong', MEASUREMENT, TRUTH, ESTIMATE))
            for option in ('--truth', '--estimate', '--measurement')
        ),
        (('--truth', MEASUREMENT), 1, ('has no velocities',)),
        (('--from', '100'), 1, ('no sample remains from 100', 'the record has 3.998 s')),
        (('--from', '2', '--to', '1'), 2, ('--to is 1 s: it must be above --from',)),
        (('--from', '-1'), 2, ('--from',)),
        (('--from', 'nan'), 2, ('--from',)),
        (('--wrap-period', '-1'), 2, ('wrap',)),
        (('--observer', 'finite_diference'), 2, ("did you mean 'finite_difference'",)),
    ],
)
def test_wrong_use(good, capsys, words, code, said):
    line = fails(capsys, good, *words, code=code)
    assert all(each in line for each in said)


SHORT = stamps_of(1.0)


def test_a_bag_of_a_number_has_the_option_that_reads_it(tmp_path, capsys):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/encoder', 'std_msgs/msg/Float64')
        bag.write('/encoder', START, b'\0\1\0\0' + bytes(8))
    assert '--angle /encoder:data' in fails(capsys, str(tmp_path / 'bag'))


@pytest.mark.parametrize(
    ('topics', 'words', 'said'),
    [
        (
            {MEASUREMENT: [(s, ('a',), (math.nan,), ()) for s in SHORT]},
            (),
            (f'{MEASUREMENT} has no readable joint: no position is finite',),
        ),
        (
            {MEASUREMENT: [(START, *row[1:]) for row in measured(SHORT)]},
            (),
            ("'a' has no valid estimate (499 of 500 samples dropped: ",),
        ),
        (
            {'/other': measured(SHORT), '/another': measured(SHORT), ESTIMATE: estimated(SHORT)},
            (),
            ('no truth', '--truth (here: /another, /other)', '--measurement', '--angle'),
        ),
        ({TRUTH: true(SHORT)}, (), ('no estimates', 'replay', '--observer')),
        ({TRUTH: true(SHORT)}, ('--observer', 'pll'), (MEASUREMENT,)),
        ({TRUTH: true(SHORT, 'elbow'), ESTIMATE: estimated(SHORT, 'knee')}, (), ('knee', 'elbow')),
        (
            {TRUTH: true(SHORT), ESTIMATE: estimated(stamps_of(1.0, start=START + 10**10))},
            (),
            ('do not overlap in time', '1700000010.002 to 1700000011.000 s'),
        ),
    ],
)
def test_a_bag_without_something_to_compare(tmp_path, capsys, topics, words, said):
    line = fails(capsys, write_bag(tmp_path / 'bag', topics), *words)
    assert all(each in line for each in said)


@pytest.mark.parametrize('command', ['evaluate', 'replay'])
@pytest.mark.parametrize(
    ('topic', 'field', 'why'),
    [
        (MEASUREMENT, 'position[7]', "'position' has at most 1 element"),
        (MEASUREMENT, 'velocity[0]', "'velocity' is empty"),
        ('/numbers', 'data[2]', "'data' has at most 2 elements"),
    ],
)
def test_an_angle_that_selects_nothing_is_no_other_joint(
    good, tmp_path, capsys, command, topic, field, why
):
    path = good
    if topic != MEASUREMENT:  # no joint states at all
        path = str(tmp_path / 'bag')
        with BagWriter(path) as bag:
            bag.add_topic(topic, 'std_msgs/msg/Float64MultiArray')
            for count, stamp in enumerate(stamps_of(0.1)):
                values = [0.1] * (count % 3)
                raw = struct.pack(f'<4s4I{len(values)}d', b'\0\1', 0, 0, len(values), 0, *values)
                bag.write(topic, stamp, raw)
    assert main([command, path, '--angle', f'{topic}:{field}']) == 1
    captured = capsys.readouterr()
    assert f'{path}: ' in captured.err and captured.err.count('\n') == 1
    assert f"no message of {topic} has '{field}': {why}" in captured.err
    assert command == 'replay' or captured.out == ''


@pytest.mark.parametrize('children', [['wheel', 'tool', 'lid', 'camera'], ['wheel']])
def test_an_element_that_is_of_several_frames_is_reported(tmp_path, capsys, children):
    """Each publisher of /tf sends its own transforms, so the first ones are of different frames."""
    kind, path = 'tf2_msgs/msg/TFMessage', str(tmp_path / 'bag')
    header = T['std_msgs/msg/Header'], T['builtin_interfaces/msg/Time']
    nowhere = T['geometry_msgs/msg/Vector3'](0.0, 0.0, 0.0)
    with BagWriter(path) as bag:
        bag.add_topic('/tf', kind)
        for count, stamp in enumerate(stamps_of(1.0)):
            angle = 0.5 * motion(stamp)[0]
            turn = T['geometry_msgs/msg/Quaternion'](0.0, 0.0, math.sin(angle), math.cos(angle))
            made = T['geometry_msgs/msg/TransformStamped'](
                header[0](header[1](*divmod(stamp, 10**9)), 'base'),
                children[count % len(children)],
                T['geometry_msgs/msg/Transform'](nowhere, turn),
            )
            bag.write('/tf', stamp, bytes(STORE.serialize_cdr(T[kind]([made]), kind)))
    assert main(['evaluate', path, '--angle', '/tf:transforms[0].transform.rotation.yaw']) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if 'same frame' in line]
    assert len(lines) == (len(children) > 1)
    assert all('base -> camera, base -> lid, base -> tool and 1 more; ' in line for line in lines)


def test_without_estimates_the_default_observer_runs(tmp_path, capsys):
    stamps = stamps_of()
    bag = write_bag(tmp_path / 'bag', {MEASUREMENT: measured(stamps), TRUTH: true(stamps)})
    file = tmp_path / 'params.yaml'
    file.write_text(
        '/**:\n  ros__parameters:\n    observer: hybrid_angle\n    bandwidth_hz: 20.0\n'
    )
    quantum = ['--set', 'quantum=0.001']
    for words, same in (
        ([], ['--observer', DEFAULT]),
        (quantum, ['--observer', DEFAULT, *quantum]),
        (['--set', 'observer=pll'], ['--observer', 'pll']),
        (['--params', str(file)], ['--observer', 'hybrid_angle', '--set', 'bandwidth_hz=20']),
    ):
        rows, other = (
            evaluate(tmp_path, bag, *each)['bags'][bag]['estimates'] for each in (words, same)
        )
        assert rows == other and list(rows) == same[1:2]
    line = fails(capsys, bag, '--set', 'bandwidth_hz=20', code=2)
    assert "unknown parameter 'bandwidth_hz' of edge_adaptive: hybrid_angle, " in line
    assert '--observer hybrid_angle' in line
    file.write_text('pmsm_observer:\n  ros__parameters:\n    resistance: 1.0\n')
    assert 'name one with --observer' in fails(capsys, bag, '--params', str(file), code=2)


# ---------------------------------------------------------------- the plot


@pytest.mark.long
def test_plot(good, tmp_path):
    picture = tmp_path / 'errors.png'
    assert main(['evaluate', good, '--plot', str(picture)]) == 0
    assert picture.read_bytes().startswith(b'\x89PNG')


def test_an_impossible_plot_is_refused_before_the_work(good, tmp_path, capsys):
    assert 'nonsense' in fails(capsys, good, '--plot', str(tmp_path / 'errors.nonsense'))
    assert capsys.readouterr().out == ''


def test_the_table_fits_80_columns_and_wide_has_every_column(capsys):
    words = ['evaluate', str(BAGS / 'simulated' / 'random_with_faults'), '--observer', 'pll']
    assert main(words) == 0
    lines = capsys.readouterr().out.splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith('estimate '))
    assert max(map(len, lines[at : at + 2])) <= 80
    assert lines[at].endswith('max  dropped')  # neither delay nor noise has a value
    assert main([*words, '--wide']) == 0
    out = capsys.readouterr().out
    assert 'received' in out and 'duplicate 28' in out


def test_long_names_are_cut_and_numbers_are_not():
    rows = [('/a/very/long/namespace/of/a/joint_observer/estimate', 'a_joint_of_many_letters')]
    cells = [(*rows[0], *['12345.6789'] * 3)]
    header = ('estimate', 'joint', 'rms', 'max', 'bias')
    first, line = text.table(header, cells, left=2, width=80).splitlines()
    assert len(line) == 80 and line.count('12345.6789') == 3
    assert line.startswith('/a/very/') and '...' in line and first.startswith('estimate ')


@pytest.mark.parametrize('shortest, longest, refused', [(0.005, 0.01, False), (0.02, 0.1, True)])
def test_a_ranking_is_of_what_is_published(tmp_path, shortest, longest, refused):
    """A joint that is read at random times and published at 350 Hz; most readings are old."""
    random = np.random.default_rng(0)
    time = np.arange(1, 3501) / 350.0
    read = np.cumsum(random.uniform(shortest, longest, int(20.0 / shortest)))
    taken = read[np.clip(np.searchsorted(read, time) - 1, 0, None)]
    angle = np.round(0.6 * np.sin(math.pi * taken) / 3.83e-4) * 3.83e-4
    rows = [(START + round(1e9 * t), ('a',), (float(y),), ()) for t, y in zip(time, angle)]
    bag = write_bag(tmp_path / 'bag', {MEASUREMENT: rows})
    words = ['--observer', 'kalman', '--observer', 'pll']
    verdict = evaluate(tmp_path, bag, *words)['bags'][bag]['verdict']['a']
    assert (not verdict['best']) == refused
    assert ('% of the readings have no reference' in verdict['why']) == refused
