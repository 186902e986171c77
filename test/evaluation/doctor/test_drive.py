# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The checks of a drive find what is wrong with it, and nothing on one without a fault."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from motors import MOTOR

from estimator_pkg import params_file, streams
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.wiring import wired
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.cli import main
from estimator_pkg.evaluation.doctor import drive
from estimator_pkg.evaluation.reference.back_emf import Drive, back_emf, of_angles, signals
from estimator_pkg.evaluation.reference.motion import motion
from estimator_pkg.messages import drive_samples, vector3
from estimator_pkg.streams.contract import Request

BAGS = Path(__file__).resolve().parents[3] / 'bags'
REVERSAL = BAGS / 'simulated/drive_reversal'
BATCHES = 'std_msgs/msg/Float64MultiArray'
DATA = [word for name, value in MOTOR.items() for word in ('--set', f'{name}={value}')]


@pytest.fixture(scope='module')
def bare(tmp_path_factory):
    """The bag of a simulated drive without anything that shows the truth."""
    path = tmp_path_factory.mktemp('drive') / 'bare'
    with open_bag(REVERSAL) as bag, BagWriter(path) as out:
        out.add_topic('/drive_samples', BATCHES)
        for message in bag.messages(['/drive_samples']):
            out.write('/drive_samples', message.log_ns, bytes(message.raw))
    return str(path)


def turning(speed, rate=20_000.0, seconds=0.5, noise=0.0, flux=MOTOR['flux']):
    """Signals of a motor whose electrical speed is `speed(t)`; and its angle."""
    time = np.arange(int(seconds * rate)) / rate
    fine = np.linspace(0.0, seconds, 40 * len(time))
    angle = np.cumsum(speed(fine)) * (fine[1] - fine[0])
    theta = np.interp(time, fine, angle)
    random = np.random.default_rng(0)
    current = 10.0 * np.exp(1j * (theta + 0.5 * np.pi))
    flux_linkage = flux * np.exp(1j * theta) + MOTOR['inductance'] * current
    voltage = np.zeros(len(time), complex)
    mean = 0.5 * (current[1:] + current[:-1])
    voltage[1:] = np.diff(flux_linkage) * rate + MOTOR['resistance'] * mean
    read = current + noise * (random.standard_normal((len(time), 2)) @ [1.0, 1j])
    stamps = 10**18 + np.rint(time * 1e9).astype(np.int64)
    return Drive(stamps, read, voltage), theta


@pytest.mark.parametrize('sign', [1.0, -1.0])
@pytest.mark.parametrize('noise', [0.0, 0.1])
def test_the_angle_of_the_back_emf_is_that_of_the_rotor(sign, noise):
    def speed(t):
        return sign * (1500.0 + 500.0 * np.sin(2.0 * np.pi * 4.0 * t))

    read, theta = turning(speed, noise=noise)
    found = back_emf(read, MOTOR)
    true = np.interp(found.stamps, read.stamps, theta)
    seen = np.isfinite(found.angle)
    assert np.mean(seen) > 0.95
    off = found.angle[seen] - true[seen]
    off -= 2.0 * math.pi * np.rint(np.median(off) / (2.0 * math.pi))
    assert np.abs(off[3:-3]).max() < 0.02
    flux = np.median(found.size[seen] / np.abs(found.speed[seen]))
    assert flux == pytest.approx(MOTOR['flux'], rel=0.01)
    moved = of_angles(motion(found.stamps, found.angle, 0.0))
    error = moved.velocity - speed((moved.stamps - 10**18) * 1e-9)
    assert np.sqrt(np.mean(error[20:-20] ** 2)) < 1.5


def test_nothing_is_seen_at_standstill_and_turns_are_not_lost_across_it():
    read, theta = turning(lambda t: 1500.0 * np.cos(2.0 * np.pi * 2.0 * t), noise=0.05)
    found = back_emf(read, MOTOR)
    true = np.interp(found.stamps, read.stamps, theta)
    speed = np.gradient(true, found.stamps * 1e-9)
    seen = np.isfinite(found.angle)
    assert not seen[np.abs(speed) < 20.0].any() and seen[np.abs(speed) > 300.0].mean() > 0.95
    off = found.angle[seen] - true[seen]
    assert np.ptp(off) < 0.1


def test_a_motor_at_rest_shows_nothing():
    read, _ = turning(lambda t: 0.0 * t, noise=0.05)
    assert back_emf(read, MOTOR) is None


@pytest.mark.long
def test_a_drive_gets_a_verdict_and_a_file(bare, tmp_path, capsys):
    out, page = tmp_path / 'p.yaml', tmp_path / 'p.html'
    result = tmp_path / 'r.json'
    files = '--out', str(out), '--html', str(page), '--json', str(result)
    assert main(['doctor', bare, *DATA, *files]) == 0
    text = ' '.join(capsys.readouterr().out.split())
    assert 'Use pmsm with these motor data; mend first: lost samples.' in text
    assert 'WARN lost samples' in text and 'PASS flux linkage' in text
    values = params_file.load(out, 'pmsm_observer')
    assert values['flux'] == MOTOR['flux'] and values['observer'] == 'pmsm'
    html = page.read_text()
    assert '<h2>Verdict</h2>' in html
    for title in ('electrical speed', 'current', 'voltage', 'time since the sample before'):
        assert f'"{title} [' in html
    (joint,) = json.loads(result.read_text())['joints'].values()
    assert joint['verdict'] is None


def test_without_truth_the_back_emf_judges_the_estimates(bare, tmp_path, capsys):
    result = tmp_path / 'r.json'
    assert main(['evaluate', str(REVERSAL), '--observer', 'pmsm', *DATA, '--json', '-']) == 0
    known = json.loads(capsys.readouterr().out)['bags'][str(REVERSAL)]
    joint = known['estimates']['pmsm']['joints']['motor_electrical']
    assert main(['evaluate', bare, '--observer', 'pmsm', *DATA, '--json', str(result)]) == 0
    alone = json.loads(result.read_text())['bags'][bare]
    without = alone['estimates']['pmsm']['joints']['motor_electrical']
    assert without['velocity']['delay_s'] == pytest.approx(joint['velocity']['delay_s'], abs=1e-4)
    reported = alone['verdict']['motor_electrical']['rms']['pmsm']
    assert 0.3 < joint['velocity']['rms'] / reported < 1.5  # here one in 50 samples has a truth


def test_what_is_missing_is_named_with_its_unit(bare, tmp_path, capsys):
    out = tmp_path / 'p.yaml'
    assert main(['doctor', bare, '--set', 'flux=0.0019', '--out', str(out)]) == 1
    text = ' '.join(capsys.readouterr().out.split())
    assert 'FAIL motor data not given: resistance, inductance, pole_pairs' in text
    assert 'ohm, one phase to the star point' in text and '--set pole_pairs=...' in text
    assert '# resistance:' in out.read_text() and params_file.load(out, 'pmsm_observer')
    assert main(['evaluate', bare]) == 1
    assert 'add --observer pmsm and its motor data' in capsys.readouterr().err


def written(path, parts, batches):
    """A bag of drives one after another, as batches or as pairs of messages."""
    topics = ['/drive_samples'] if batches else ['/current', '/voltage']
    with BagWriter(path) as bag:
        for topic in topics:
            bag.add_topic(topic, BATCHES if batches else vector3.TYPE)
        log = 10**18
        for stamps, current, voltage in parts:
            rows = np.column_stack([current, voltage]).view(float)
            for part in np.split(np.arange(len(stamps)), range(50, len(stamps), 50)):
                log += 10_000_000
                if batches:
                    bag.write(topics[0], log, drive_samples.encode(stamps[part], rows[part]))
                    continue
                for stamp, row in zip(stamps[part].tolist(), rows[part].tolist()):
                    bag.write(topics[0], log, vector3.encode(stamp, '', *row[:2]))
                    bag.write(topics[1], log, vector3.encode(stamp, '', *row[2:]))
    return str(path)


@pytest.mark.long
@pytest.mark.parametrize('batches', [True, pytest.param(False, marks=pytest.mark.slow)])
def test_runs_of_a_drive_are_not_mixed(batches, tmp_path):
    parts = [
        turning(lambda t: -1500.0 + 250.0 * np.cos(12.0 * t), 5000.0, 0.4, 0.02)[0],
        turning(lambda t: 2500.0 + 250.0 * np.cos(12.0 * t), 5000.0, 0.8, 0.02)[0],
    ]
    path, result = written(tmp_path / 'bag', parts, batches), tmp_path / 'r.json'
    assert main(['doctor', path, *DATA, '--json', str(result)]) == 1
    found = json.loads(result.read_text())
    (joint,) = found['joints'].values()
    checks = {each['check']: each for each in joint['findings']}
    assert checks['order of stamps']['clock_jumps'] == 1
    assert {name for name, each in checks.items() if each['level'] != 'PASS'} == {'order of stamps'}
    assert checks['flux linkage']['flux'] == pytest.approx(MOTOR['flux'], rel=0.02)
    assert found['parameters'] == ''  # while a check FAILs


def recorded(path, values):
    """Signals of the bag, read with these parameters."""
    with open_bag(path) as bag:
        setup = wired(streams.named('drive'), bag, values, Request(None, None))
        return signals(bag, setup)


def checks(read, values):
    """Findings on these signals with these motor data, by check."""
    return {each.check: each for each in drive.checked(read, values)[0]}


SERVO = {'resistance': 2.1, 'inductance': 0.009, 'flux': 0.059, 'pole_pairs': 4}
SERVO_SIM = (
    *(f'{name}={value}' for name, value in SERVO.items()),
    *('inertia=5.6e-5', 'current_max=10.8', 'load_quadratic=1e-6'),
    *('coulomb=0.02', 'dc_voltage=300', 'current_noise=0.02', 'adc_range=20', 'current_hz=800'),
    *('speed_hz=25', 'speed_rpm=3000'),
)
MOTIONS = ('p1', 'ramps', 'reversal', 'standstill')
DRIVES = [
    *((MOTOR, ('current_noise=0.1', f'profile={each}'), 1) for each in MOTIONS),
    *((MOTOR, ('current_noise=0.1', f'profile={each}', 'speed_rpm=2000'), 2) for each in MOTIONS),
    (MOTOR, ('profile=constant', 'load_constant=0.1', 'current_noise=0.1'), 1),
    (MOTOR, ('publish_rate=5000', 'batch=50'), 1),
    *((SERVO, (*SERVO_SIM, f'profile={each}'), seed) for each in MOTIONS for seed in (1, 2)),
    (SERVO, (*SERVO_SIM, 'profile=constant', 'load_constant=1'), 1),
]


@pytest.fixture(scope='module')
def simulations(tmp_path_factory):
    """(motor data, signals) of drives without a fault: motions, speeds, loads, seeds."""
    folder, found = tmp_path_factory.mktemp('drives'), []
    for k, (motor, settings, seed) in enumerate(DRIVES):
        seconds = 2.0 if motor is SERVO else 1.0
        words = [word for each in (*settings, f'seed={seed}') for word in ('--set', each)]
        words += ['--out', str(folder / str(k)), '--duration', str(seconds)]
        assert main(['simulate', 'pmsm', *words]) == 0
        found.append((motor, recorded(folder / str(k), {'observer': 'pmsm', **motor})))
    return found


@pytest.mark.long
def test_drives_without_a_fault_pass(simulations):
    for motor, read in simulations:
        found = checks(read, motor)
        named = {name for name, each in found.items() if each.level != 'PASS'}
        assert named <= {'back-EMF'}  # slow for half of the time
        numbers = found['resistance'].numbers
        error = abs(numbers['resistance'] - motor['resistance'])
        assert error < max(2.5 * numbers['stddev'], 0.03 * motor['resistance'])
        assert found['flux linkage'].numbers['flux'] == pytest.approx(motor['flux'], rel=0.01)


def wrong(**factors):
    """Other motor data."""
    return lambda motor, read: (motor | {k: v * motor[k] for k, v in factors.items()}, read)


def signal(name, change):
    """Another current or voltage, or other stamps."""
    return lambda motor, read: (motor, read._replace(**{name: change(getattr(read, name))}))


def only(rows):
    """Only these samples."""
    return lambda motor, read: (motor, Drive(*(each[rows(len(each))] for each in read)))


def back(stamps):
    return stamps - 10**9 * (np.arange(len(stamps)) > len(stamps) // 2)


def swapped(turn):
    return lambda current: np.exp(2j * np.pi * turn / 3.0) * np.conj(current)


MISTAKES = {  # what is planted, the check that names it, its remedy
    'flux': (wrong(flux=1.4), 'flux linkage', 'set flux'),
    'half of the resistance': (wrong(resistance=0.5), 'resistance', 'check the resistance'),
    'twice the resistance': (wrong(resistance=2.0), 'resistance', 'line to line'),
    'line to line': (wrong(resistance=2.0, inductance=2.0), 'resistance', 'line to line'),
    'a and b swapped': (signal('current', swapped(1)), 'phases', 'swapped'),
    'a and c swapped': (signal('current', swapped(2)), 'phases', 'swapped'),
    'b and c swapped': (signal('current', np.conj), 'phases', 'swapped'),
    'counted out of the motor': (signal('current', np.negative), 'resistance', 'sign'),
    'no current': (signal('current', np.zeros_like), 'current', 'connected'),
    'no voltage': (signal('voltage', np.zeros_like), 'voltage', 'connected'),
    'a short record': (only(lambda n: slice(50)), 'back-EMF', 'turn the motor'),
    'milliseconds': (signal('stamps', lambda s: s[0] + 1000 * (s - s[0])), 'rate', 'milliseconds'),
    'a loop': (signal('stamps', back), 'order of stamps', 'one run'),
    'lost': (only(lambda n: np.arange(n) % 20 != 3), 'lost samples', 'each sample'),
    'few': (only(lambda n: slice(50)), 'samples', 'for a second'),
}
OF_A_BAG = {'motor data'}  # a test above has this check


@pytest.mark.long
@pytest.mark.parametrize('mistake', MISTAKES)
def test_a_mistake_is_named(mistake, simulations):
    plant, check, remedy = MISTAKES[mistake]
    shown = simulations[1:2] if 'resistance' in mistake or 'out of' in mistake else simulations
    for motor, read in shown:
        changed = plant(motor, read)
        finding = checks(changed[1], changed[0])[check]
        assert finding.level != 'PASS' and remedy in finding.remedy, finding
        for name in ('flux', 'resistance'):
            if mistake in (name, f'half of the {name}', f'twice the {name}'):
                assert finding.numbers[name] == pytest.approx(motor[name], rel=0.05)
        if mistake == 'line to line':
            assert f'resistance to {motor["resistance"]:g}' in finding.remedy


def test_every_row_has_a_mistake():
    named = {check for _, check, _ in MISTAKES.values()}
    assert named | OF_A_BAG == {each.name for each in drive.CHECKS}
