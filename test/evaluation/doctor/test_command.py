# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""`doctor` on bags and on a running topic: report, parameter file, page, exit codes."""

import contextlib
import io
import json
import math
import os
import re
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import browser
import numpy as np
import pytest
from joint_bags import write_bag

from estimator_pkg import observers, params_file
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.cli import main
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.evaluation.checks.readings import Readings
from estimator_pkg.evaluation.doctor.choice import DEFAULT, JointRanking, choose, sentences
from estimator_pkg.evaluation.doctor.examine import examine
from estimator_pkg.evaluation.entries import Entry, angle_observers
from estimator_pkg.evaluation.ranking.verdict import ComparedPair, Verdict
from estimator_pkg.evaluation.reference.smoother import smoother
from estimator_pkg.evaluation.reference.smoother.noise import ReadingNoise
from estimator_pkg.messages import vector3
from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.streams.angle import AngleStream

BAGS = Path(__file__).resolve().parents[3] / 'bags'
START = 1_700_000_000_000_000_000


def bag(path, joints, rate=250.0, seconds=12.0, stamped=True, topic='/joint_states'):
    """A bag of joint states: name -> position over time."""
    times = [START + round(k / rate * 1e9) for k in range(int(rate * seconds))]
    angles = [[float(of((t - START) * 1e-9)) for of in joints.values()] for t in times]
    rows = [(t * stamped, [*joints], y, (), t + 200_000) for t, y in zip(times, angles)]
    return write_bag(path, {topic: rows})


def swing(t, count=2.0 * math.pi / 4096):
    angle = 2.0 * math.sin(2.0 * t) + 0.5 * math.sin(11.0 * t)
    return round(angle / count) * count


@pytest.fixture(scope='module')
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp('doctor')
    path = bag(folder / 'arm', {'elbow': swing, 'wrist': lambda t: 0.25})
    words = ['--out', str(folder / 'params.yaml'), '--html', str(folder / 'page.html')]
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert main(['doctor', path, *words, '--json', str(folder / 'result.json')]) == 0
    return folder, out.getvalue(), json.loads((folder / 'result.json').read_text())


@pytest.mark.long
def test_the_report_fits_80_columns_and_ends_in_a_verdict(report):
    _, text, result = report
    assert max(len(line) for line in text.splitlines() if str(report[0]) not in line) <= 80
    assert 'all joints\n  PASS  rate               250 Hz' in text
    assert '1 WARN, 0 FAIL; WARN: motion' in text
    assert 'one count is 0.001534 rad, 4096 per turn' in text.replace('\n' + ' ' * 27, ' ')
    verdict = text[text.index('VERDICT') :]
    assert f'elbow:\n  Use {result["observer"]} ' in verdict
    assert 'wrist:\n  No ranking: the joint does not move enough' in verdict
    assert re.search(r' rad/s rms,\s+-?[\d.]+\s\+-\s[\d.]+\sms\slate', verdict)
    checks = {each['check']: each for each in result['joints']['elbow']['findings']}
    assert not [name for name, each in checks.items() if each['value'].startswith(name)]
    assert checks['low-passed']['delay_s'] == pytest.approx(1.0 / (2.0 * math.pi * 50.0), abs=1e-3)
    assert checks['resolution']['counts_per_turn'] == pytest.approx(4096.0)


@pytest.mark.long
def test_the_file_is_one_that_the_node_takes_and_the_page_has_it(report):
    folder, _, result = report
    page = (folder / 'page.html').read_text()
    assert page.index('Verdict') < page.index('Parameter file') < page.index('Checks')
    assert f'orange: {result["observer"]}' in page and ', recommended' in page
    assert 'ros__parameters' in page and 'WARN">WARN' in page and '<script src' not in page
    text = (folder / 'params.yaml').read_text()
    assert max(map(len, text.splitlines())) <= 80
    values = params_file.load(folder / 'params.yaml')
    common, overrides = params_file.split(values)
    assert common.pop('observer') == result['observer']
    Configuration(observers.find(result['observer']), common, overrides)
    assert overrides['elbow']['quantum'] == pytest.approx(2.0 * math.pi / 4096, rel=1e-4)


def tilts(path):
    """A bag of tilts, one number in messages of another type."""
    with BagWriter(path) as writer:
        writer.add_topic('/imu/tilt', vector3.TYPE)
        for k in range(1000):
            now = START + k * 4_000_000
            writer.write('/imu/tilt', now, vector3.encode(now, '', swing(k / 250.0), 0.0))
    return path


@pytest.mark.long
@pytest.mark.parametrize(
    'topic, field, words, expected',
    [
        (
            '/imu/tilt',
            'vector.x',
            ['--wrap-period', '0'],
            {'input': 'field', 'field_type': vector3.TYPE, 'wrap_period': 0.0},
        ),
        (
            '/angle',
            'data',
            ['--set', 'counts_per_revolution=4096', '--set', 'quantum=0.002'],
            {'input': 'angle', 'angle_type': 'Int32', 'counts_per_revolution': 4096},
        ),
    ],
)
def test_the_file_of_an_angle_names_input_and_topic(
    topic, field, words, expected, tmp_path, capsys
):
    path = BAGS / 'simulated/trapezoid_raw_counts' if topic == '/angle' else tilts(tmp_path / 'b')
    out = tmp_path / 'p.yaml'
    assert (
        main(['doctor', str(path), '--angle', f'{topic}:{field}', '--out', str(out), *words]) == 0
    )
    remap = '' if topic == '/angle' else f'-r angle:={topic}'
    more = f' \\\n  {remap}' if remap else ''
    node = f'node: joint_observer --ros-args --params-file {out}{more}\n'
    assert node in capsys.readouterr().out
    text = out.read_text()
    assert remap in text and text.count('quantum:') == 1
    values = params_file.load(out)
    assert values.items() >= expected.items()
    (port,) = AngleStream.of(values).inputs
    with open_bag(path) as found:
        assert port.topic == 'angle' and port.type == found.topics[topic].type
    assert (port.field or 'data') == field


@pytest.mark.long
@pytest.mark.parametrize('command', ['doctor', 'evaluate', 'tune'])
def test_metres_are_not_called_rad(command, tmp_path, capsys):
    path, out = bag(tmp_path / 'lift', {'lift': swing}, seconds=4.0), tmp_path / 'p.yaml'
    words = ['--out', str(out)] if command != 'evaluate' else []
    words += ['--trials', '1', '--observer', 'kalman'] if command == 'tune' else []
    assert main([command, path, '--wrap-period', '0', *words]) == 0
    text = capsys.readouterr().out + (out.read_text() if words else '')
    assert 'm/s or rad/s' in text and not re.search(r'(?<!or)\s\[?rad', text)


@pytest.mark.long
@pytest.mark.parametrize('wrong', [False, True])
def test_a_reference_that_its_readings_contradict_is_warned_of(
    wrong, tmp_path, monkeypatch, capsys
):
    """With the noise that a fit once found: 0.33 rad, where it was 2 mrad."""
    noise = iter(2e-3 * np.random.default_rng(0).standard_normal(3000))
    path = bag(tmp_path / 'bag', {'joint': lambda t: math.sin(2.0 * t) + next(noise)})
    if wrong:
        fitted = ReadingNoise(0.33, 3.5e-6, 0.0, False)
        monkeypatch.setattr(smoother, 'white', lambda *_: fitted)
    text = 'takes 0.33 rad for noise, but the readings scatter by 0.002'
    assert main(['evaluate', path, '--observer', 'kalman']) == 0
    evaluated = ' '.join(capsys.readouterr().out.split())
    assert main(['doctor', path]) == 0
    found = ' '.join(capsys.readouterr().out.split())
    assert (f'{text} rad; every error here may be wrong: judge by a measured' in evaluated) is wrong
    assert (f'WARN reference the off-line reference {text} rad -> judge by' in found) is wrong
    assert (f'{text} rad; every error' in found) is wrong


def wrong(kind, t):
    """(stamp offset [s], reading) of a joint at time t; the second is wrong in one way."""
    angle = math.sin(2.0 * t) + 3.0 * t
    turned = (angle + math.pi) % (2.0 * math.pi) - math.pi
    if kind == 'degrees':
        return 0.0, math.degrees(turned)
    late = round(250.0 * t) % 3 == 0
    return (-0.02 if late and t > 0.1 else 0.0), turned


@pytest.mark.long
@pytest.mark.parametrize(
    'kind, named',
    [
        ('degrees', 'the angle is in degrees: publish radians'),
        ('unordered', 'publish in the order of the stamps'),
    ],
)
def test_nothing_is_recommended_while_a_check_fails(kind, named, tmp_path, capsys):
    """`doctor`, `evaluate` and `tune` name what to mend first, in the same words."""
    rows = []
    for k in range(2500):
        late, angle = wrong(kind, k / 250.0)
        now = START + k * 4_000_000
        both = [angle, swing(k / 250.0)]
        rows.append((now + round(late * 1e9), ['elbow', 'wrist'], both, (), now + 200_000))
    path = write_bag(tmp_path / 'arm', {'/joint_states': rows})
    out, found = tmp_path / 'params.yaml', tmp_path / 'result.json'
    page = ['--html', str(tmp_path / 'page.html'), '--json', str(found)]
    assert main(['doctor', path, '--out', str(out), *page]) == 1
    text = ' '.join(capsys.readouterr().out.split())
    result = json.loads(found.read_text())
    one = kind != 'unordered'  # the stamps of one message are those of all its joints
    if one:  # the other joint is as it was
        assert f'{out.name}: elbow: no gains in it until what FAILs is mended' in text
        overrides = params_file.split(params_file.load(out))[1]
        assert [*overrides] == ['wrist'] and out.read_text() == result['parameters']
        out.unlink()
    else:
        assert not out.exists() and f'{out.name} is not written: mend what FAILs first' in text
        assert result['parameters'] == ''
    assert result['joints']['elbow']['verdict'] is None
    assert ('Parameter file' in (tmp_path / 'page.html').read_text()) is one
    said = text[text.index('elbow: No ranking: ' if kind != 'unordered' else 'No ranking: ') :]
    why = said[said.index('No ranking') :].partition(' wrist:')[0].partition(str(tmp_path))[0]
    assert named in why and 'Mend this first: ' in why and 'Use ' not in why
    if one:
        assert 'wrist: Use ' in said
    assert main(['evaluate', path, *page]) == 0
    text = ' '.join(capsys.readouterr().out.split())
    assert why.strip() in text and 'Use ' not in text.partition('elbow: No ranking')[2][:99]
    assert ('No parameter file: mend what' in (tmp_path / 'page.html').read_text()) is not one
    words = ['--observer', 'kalman', '--joint', 'elbow', '--trials', '2', '--out', str(out)]
    assert main(['tune', path, *words]) == 0
    assert 'Mend this first' in out.read_text() and 'bandwidth' not in out.read_text()


@pytest.mark.parametrize('name', ['yx2bag', 'yawbag', 'flybag'])
def test_doctor_and_evaluate_agree(name, tmp_path, capsys):
    """On motion capture, of which two records flip by half a turn."""
    angle = '/vicon/Group466CF/Group466CF/pose:pose.orientation.yaw'
    words = [str(BAGS / 'vicon' / name), '--angle', angle, '--json', str(tmp_path / 'result.json')]
    assert main(['doctor', *words]) == int(name != 'yx2bag')
    (doctor,) = json.loads((tmp_path / 'result.json').read_text())['joints'].values()
    text = ' '.join(capsys.readouterr().out.split())
    assert main(['evaluate', *words, '--observer', 'all']) == 0
    (found,) = json.loads((tmp_path / 'result.json').read_text())['bags'].values()
    rows = {source: each['joints']['joint'] for source, each in found['estimates'].items()}
    (verdict,) = found['verdict'].values()
    if name == 'yx2bag':
        ours = doctor['verdict']['rms']
        assert verdict['rms'] == pytest.approx({each: ours[each] for each in verdict['rms']})
    else:
        assert verdict['sentences'][0] in text
        assert all(row['velocity']['rms'] < 0.4 for row in rows.values())
    low_passed = next(each for each in doctor['findings'] if each['check'] == 'low-passed')
    difference = rows['finite_difference']['velocity']
    for key in ('rms', 'delay_s', 'delay_95_s'):
        known = low_passed[key]
        assert difference[key] == (known if known is None else pytest.approx(known, rel=0.15))


def verdict(rms, better):
    """A verdict in which the pairs of `better` are declared."""
    names = sorted(rms, key=rms.__getitem__)
    pairs = tuple(
        ComparedPair(a, b, int((a, b) in better), 10.0, 5.0)
        for i, a in enumerate(names)
        for b in names[i + 1 :]
    )
    return Verdict(names[0], DEFAULT, (), rms, pairs)


TUNED = 'kalman 16 Hz'
BETTER = {(TUNED, 'kalman'), (TUNED, DEFAULT)}
GAINS = {'bandwidth_hz': 16.0}


def answered(tuned, better):
    """An answer where `TUNED` was tuned, with these errors and declared pairs."""
    rms = dict.fromkeys(angle_observers(), 1.0) | {TUNED: 0.4} | tuned
    best = {name: Entry(name, name) for name in angle_observers()}
    best['kalman'] = Entry(TUNED, 'kalman', tuple(GAINS.items()))
    found = verdict(rms, better)
    return JointRanking(found, found, best, {})


EVERY = {(TUNED, each) for each in angle_observers()}
BAD = answered({TUNED: 3.0, 'kalman': 2.5}, {(DEFAULT, 'kalman')})
MISSED = answered({}, BETTER)._replace(
    held_out=verdict({'kalman': 0.5, TUNED: 0.9}, {('kalman', TUNED)})
)
STEADY = answered({}, BETTER)
STEADY = STEADY._replace(verdict=replace(STEADY.verdict, tunable=False))


@pytest.mark.parametrize(
    'answers, observer, error, sure',
    [
        pytest.param([answered({}, BETTER)], 'kalman', 0.4, True, id='gains that beat defaults'),
        pytest.param([answered({TUNED: 0.98}, set())], DEFAULT, 1.0, False, id='2 %, not sure'),
        pytest.param([answered({TUNED: 0.98}, EVERY)], 'kalman', 0.98, True, id='2 %, sure'),
        pytest.param([answered({TUNED: 0.96}, set())], 'kalman', 0.96, False, id='4 %, not sure'),
        pytest.param(
            [answered({'super_twisting': 0.405}, set())],
            'super_twisting',
            0.405,
            False,
            id='an observer as it is',
        ),
        pytest.param([MISSED], DEFAULT, 1.0, False, id='worse on held-out data'),
        pytest.param([answered({}, BETTER), BAD], DEFAULT, 1.0, False, id='worse for one joint'),
        pytest.param([STEADY], DEFAULT, 1.0, False, id='noise alone'),
    ],
)
def test_the_choice(answers, observer, error, sure):
    choice = choose(dict(zip(('elbow', 'wrist'), answers)))
    assert (choice.observer, choice.tuned) == (observer, observer != DEFAULT)
    assert choice.gains == ({'elbow': GAINS} if observer == 'kalman' else {})
    assert choice.more == pytest.approx(100.0 / error - 100.0) and choice.sure is sure


@pytest.mark.long
def test_each_observer_as_it_is_has_a_delay_too():
    stamps = 10**18 + np.arange(800) * 5_000_000
    angle = np.sin(8.0 * np.arange(800) * 5e-3)
    counts = 2.0 * math.pi / 4096
    seen = Readings('', stamps, stamps, np.round(angle / counts) * counts, angle * math.nan, 0.0)
    found = examine(seen).answer
    assert all(math.isfinite(found.delays[name].late) for name in angle_observers())
    assert found.delays['pll'].late > found.delays['hybrid_angle'].late


def test_at_rest_nothing_is_compared(tmp_path):
    out = tmp_path / 'params.yaml'
    assert (
        main(['doctor', bag(tmp_path / 'still', {'elbow': lambda t: 0.5}), '--out', str(out)]) == 0
    )
    assert 'no joint moves enough to compare' in out.read_text() and '95 %' not in out.read_text()


def test_without_stamps_the_arrival_is_used(tmp_path, capsys):
    path = bag(tmp_path / 'bare', {'elbow': lambda t: 0.5}, seconds=1.0, stamped=False)
    assert main(['doctor', path]) == 1  # a check FAILs
    out = capsys.readouterr().out
    assert 'FAIL  missing stamps' in out and '250 of 250 samples have no time stamp' in out
    assert 'PASS  rate               250 Hz' in out


@pytest.mark.parametrize(
    'words, code, message',
    [
        (['nowhere'], 1, 'does not exist'),
        ([str(BAGS / 'simulated/drive_profile'), '--set', 'flux=-1'], 2, 'flux'),
        ([str(BAGS / 'vicon/yawbag'), '--angle', 'a:b', '--params', 'x'], 2, 'is for drives'),
        ([str(BAGS / 'vicon/yawbag')], 1, 'a number with --angle'),
        ([str(BAGS / 'simulated/sine_12bit'), '--set', 'observer=pll'], 2, 'so omit it'),
        ([], 2, 'one of the two'),
        (['bag', '--live', '3'], 2, 'one of the two'),
        (['--live', '0'], 2, 'between 0.5 and 3600 s'),
        (['bag', '--motion-hz', '-1'], 2, 'above 0'),
        (['bag', '--wrap-period', 'nan'], 2, '0 or more'),
    ],
)
def test_a_usage_error_is_one_line(words, code, message, capsys):
    assert main(['doctor', *words]) == code
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1


def test_no_readable_joint_is_exit_code_1(tmp_path, capsys):
    path = bag(tmp_path / 'nan', {'elbow': lambda t: np.nan}, seconds=0.2)
    assert main(['doctor', path]) == 1
    assert 'no position is finite' in capsys.readouterr().err


def listening(folder, *words):
    """Text and result of `doctor --live` beside a driver that publishes /arm/states."""
    import dds

    probe = dds.Probe()
    try:
        from rclpy.qos import qos_profile_sensor_data
        from sensor_msgs.msg import JointState

        publisher = probe.node.create_publisher(JointState, '/arm/states', qos_profile_sensor_data)
        encode = Encoder().encode
        process = subprocess.Popen(
            [sys.executable, '-m', 'estimator_pkg.cli', 'doctor', '--live', '2', *words]
            + ['--json', str(folder / 'result.json')],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ},
        )
        begun = time.monotonic()
        while process.poll() is None and time.monotonic() < begun + dds.PATIENCE:
            now = time.time_ns()
            publisher.publish(encode(now, '', ['elbow'], [swing(now * 1e-9 % 1e4)]))
            probe.executor.spin_once(timeout_sec=0.005)
        text, errors = process.communicate(timeout=30)
    finally:
        probe.close()
    assert process.returncode == 0, errors
    result = json.loads((folder / 'result.json').read_text())
    return text, {each['check']: each for each in result['joints']['elbow']['findings']}


@pytest.mark.dds
@pytest.mark.long
def test_a_running_topic_is_examined_and_an_estimate_of_ours_is_no_measurement(tmp_path):
    import dds

    remap = 'joint_states:=/arm/states', '~/estimate:=/joint_states', '__node:=ours'
    node = 'estimator_pkg.nodes.executables joint_observer'
    with dds.NodeProcess(node, *dds.ros_args(remap=remap)):
        text, checks = listening(tmp_path)
        assert text.startswith('/arm/states, 2 s live: /arm/states, 1 joint')
        assert checks['clock']['level'] == 'PASS' and 50.0 < checks['rate']['hz'] < 500.0
        assert checks['resolution']['counts_per_turn'] == pytest.approx(4096.0, rel=1e-3)
        assert 'topic' not in checks
        text, checks = listening(tmp_path, '--measurement', '/joint_states')
    assert checks['topic']['level'] == 'WARN'
    assert checks['topic']['value'] == '/joint_states is the estimate of /ours, not a measurement'


def test_an_estimate_in_a_bag_is_named(tmp_path, capsys):
    topic = '/joint_observer/estimate'
    path = bag(tmp_path / 'made', {'elbow': swing}, seconds=1.0, topic=topic)
    assert main(['doctor', path, '--measurement', topic]) == 0
    assert 'WARN  topic' in capsys.readouterr().out


def test_a_better_one_that_is_not_taken_is_named_with_the_reason():
    found = answered({}, BETTER)
    text = ' '.join(sentences('elbow', MISSED, choose({'elbow': MISSED})))
    assert f'Use {DEFAULT} as it is' in text and f'(95 % sure): keep {DEFAULT}.' in text
    assert 'kalman 16 Hz is not used: it is worse on the last 30 % alone (95 %).' in text
    text = ' '.join(sentences('elbow', found, choose({'elbow': found, 'wrist': BAD})))
    assert 'kalman 16 Hz is not used: all joints have one observer.' in text
    text = ' '.join(sentences('elbow', found, choose({'elbow': found})))
    assert 'is not used' not in text and ': use kalman 16 Hz.' in text
    assert 'not used' not in ' '.join(sentences('elbow', STEADY, choose({'elbow': STEADY})))


@pytest.mark.page
def test_the_page_fits_a_phone_and_is_legible_in_the_dark(tmp_path):
    path = bag(tmp_path / ('a_long_name_of_a_bag' * 4), {'elbow' * 20: math.sin}, seconds=2.0)
    page = tmp_path / 'report.html'
    assert main(['doctor', path, '--html', str(page)]) == 0
    assert '<p class="use">' in page.read_text() and '<br>' not in page.read_text()
    driver = browser.start()
    try:
        for scheme in ('light', 'dark'):
            for width in (400, 1280):
                browser.on_screen(driver, page, width, scheme)
                wide = driver.execute_script('return document.documentElement.scrollWidth')
                assert wide <= width
            colour = driver.execute_script(
                "return getComputedStyle(document.querySelector('td.PASS')).color"
            )
            green = [int(each) for each in re.findall(r'\d+', colour)][1]
            assert (green > 170) == (scheme == 'dark')
    finally:
        driver.quit()
