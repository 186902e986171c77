# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The command tune, and the search behind it."""

import argparse
import math
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from joint_bags import write_bag as joint_bag
from tune_runs import START, fails, held, tuned, write_bag

from estimator_pkg import params_file
from estimator_pkg.cli import main
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.evaluation import pairs
from estimator_pkg.evaluation.compare.many import expanded
from estimator_pkg.evaluation.tuning import command, output
from estimator_pkg.evaluation.tuning import tune as tuning
from estimator_pkg.evaluation.tuning.objective import PREFERENCES, Compared, Errors, _score, cost
from estimator_pkg.evaluation.tuning.search import Range, Trial, search
from estimator_pkg.observers.angle.hybrid import observer as hybrid_angle

pytest.importorskip('optuna', reason='not run: Optuna is not installed')

BAGS = Path(__file__).resolve().parents[3] / 'bags'
PENDULUMS = BAGS / 'dfki_simple_pendulum'
COUNTS = BAGS / 'simulated' / 'trapezoid_raw_counts'
YAW = BAGS / 'vicon' / 'yawbag'
TURN = 2.0 * math.pi
PLANE = {'a': Range(0.5, 500.0), 'b': Range(1e-3, 1e3)}


def test_a_joint_without_a_name_has_no_gains_of_its_own(tmp_path, capsys):
    bag = write_bag(tmp_path / 'bag', {'': 0.5, 'b': 1.0}, seconds=2.0)
    words = ['--observer', 'pll', '--trials', '2', '--per-joint']
    line = fails(capsys, bag, *words, '--out', str(tmp_path / 'gains.yaml'))
    assert "has a joint without a name, ''" in line and 'together' not in line
    found, _ = tuned(tmp_path, bag, *words, '--joint', 'b')
    assert [each['joints'] for each in found['tuned']] == [['b']]


# ---------------------------------------------------------------- the search

LANDSCAPES = {
    'a round bowl': lambda v: (
        1.0
        + math.log(v['a'] / 20.0) ** 2
        + 0.3 * math.log(v['b'] * 2) ** 2
        + 0.4 * math.log(v['a'] / 20.0) * math.log(v['b'] * 2)
    ),
    'an edge': lambda v: (
        0.05 * v['a'] ** 0.5 + 3.0 / v['a'] + abs(math.log10(v['b'] * v['a'] / 7.0))
    ),
    'noise against lag': lambda v: 0.02 * v['a'] + 4.0 / v['a'] + 0.1 * v['b'] + 0.02 / v['b'],
}


@pytest.mark.long
@pytest.mark.parametrize('name', LANDSCAPES)
def test_forty_trials_are_as_good_as_a_grid_of_four_hundred(name):
    landscape = LANDSCAPES[name]
    grid = min(
        landscape({'a': a, 'b': b})
        for a in np.geomspace(0.5, 500.0, 20)
        for b in np.geomspace(1e-3, 1e3, 20)
    )
    for seed in range(2):
        found = search(
            PLANE,
            {'a': 45.0, 'b': 10.0},
            lambda batch: [Trial(each, landscape(each)) for each in batch],
            40,
            seed,
        )
        assert len(found.trials) == 40
        assert found.best.cost <= 1.05 * grid, seed


def test_gains_that_cannot_work_are_passed_over():
    found = search(
        PLANE,
        {'a': 400.0, 'b': 1.0},
        lambda batch: [
            Trial(each, math.inf if each['a'] > 100.0 else 1.0 + abs(math.log(each['a'] / 90.0)))
            for each in batch
        ],
        40,
    )
    assert found.best.values['a'] <= 100.0
    assert found.best.cost < 1.1


def test_interrupted_it_keeps_the_best():
    calls = []

    def judge(batch):
        calls.append(batch)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return [Trial(each, abs(math.log(each['a'] / 30.0))) for each in batch]

    found = search(PLANE, {'a': 45.0, 'b': 1.0}, judge, 40)
    assert found.interrupted and len(found.trials) == 16
    assert found.best.cost == min(trial.cost for trial in found.trials)


# ---------------------------------------------------------------- the command


@pytest.mark.long
def test_tuned_gains_beat_the_defaults_on_what_was_held_out(tmp_path):
    """And the defaults are within a factor of 1.5 of them: four recordings, the last 30 % each."""
    words = shlex.split('--observer hybrid_angle --prefer balanced --trials 16')
    found, _ = tuned(tmp_path, str(PENDULUMS), *words)
    (each,) = found['tuned']
    assert each['held_out'] and len(each['bags']) == 4
    assert each['best']['cost'] < each['default']['cost']
    assert each['default']['cost'] < 1.5 * each['best']['cost']


@pytest.mark.long
def test_the_yaml_is_what_the_node_takes(tmp_path):
    bag = write_bag(tmp_path / 'bag', {'a': 0.5, 'b': 3.0})
    found, out = tuned(
        tmp_path,
        bag,
        *shlex.split(
            '--observer hybrid_angle --per-joint --trials 16 --set order=2 --set noise=0 '
            '--set per_joint.b.timeout=2'
        ),
    )
    text = out.read_text()
    assert '# Joint a, from' in text and bag in text and '[rad/s]' in text
    common, overrides = params_file.split(params_file.load(out))
    assert common.pop('observer') == 'hybrid_angle'
    assert set(overrides) == {'a', 'b'} and common == {'order': 2, 'noise': 0.0}
    assert overrides['b']['timeout'] == 2.0 and "'per_joint.a':" in text
    gains, _ = Configuration(hybrid_angle.HybridAngle, common, overrides).for_joint('b')
    assert gains.bandwidth_hz == found['tuned'][1]['gains']['bandwidth_hz']
    # the quick joint needs more bandwidth than the slow one
    assert overrides['b']['bandwidth_hz'] > 1.3 * overrides['a']['bandwidth_hz']


@pytest.mark.long
def test_what_is_preferred_is_what_one_gets(tmp_path, capsys):
    bag = write_bag(tmp_path / 'bag', {'a': 2.0})
    found = {}
    for preference in ('smooth', 'fast'):
        words = ['--observer', 'pll', '--trials', '16', '--prefer', preference]
        found[preference], out = tuned(tmp_path, bag, *words)
        for text in (out.read_text(), capsys.readouterr().out):
            assert re.search(r'tuned .*  [\d.]+ \+- [\d.]+  ', text)
    smooth, fast = (found[each]['tuned'][0] for each in ('smooth', 'fast'))
    assert fast['tried']['bandwidth_hz'] > smooth['tried']['bandwidth_hz']
    assert fast['best']['delay_s'] < smooth['best']['delay_s']
    assert fast['best']['noise'] > smooth['best']['noise']


@pytest.mark.long
def test_the_result_does_not_depend_on_the_workers(tmp_path):
    """Neither on processes of this machine, nor on those of a Dask cluster."""
    distributed = pytest.importorskip('distributed', reason='not run: Dask is not installed')
    bag = write_bag(tmp_path / 'bag', {'a': 1.0, 'b': 2.0}, seconds=2.0)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
    ) as cluster:
        scheduler = '--scheduler', cluster.scheduler_address
        texts = set()
        for words in ((), ('--jobs', '2'), scheduler):
            _, out = tuned(tmp_path, bag, '--observer', 'pll', '--trials', '10', *words)
            texts.add(out.read_text())
        assert main(['evaluate', bag, '--observer', 'pll', *scheduler]) == 0
    assert len(texts) == 1


def test_a_delay_that_the_motion_does_not_tell_costs_the_whole_error():
    for delay, expected in ((math.nan, 0.6), (0.001, 0.3)):
        errors = Errors(0.3, delay, math.nan, 0.0, 1.0)
        assert cost(errors, 0.0, PREFERENCES['fast']) == pytest.approx(expected)


@pytest.mark.parametrize(
    'sign, difference, gained, why',
    [
        (1, 2.0, 0.01, ''),
        (1, 0.1, 1e-5, 'cost no less than the defaults'),  # the same number as printed
        (0, 2.0, 0.01, 'cannot be distinguished'),
        (0, 4.0, 0.01, ''),  # 3 % or more is believed
        (-1, -4.0, 0.01, 'is better than the tuned set'),
    ],
)
def test_the_defaults_stay_where_they_are_as_good(sign, difference, gained, why):
    pair = Compared(sign, difference, 9.0 - 8.0 * abs(sign), 2)
    found = tuning.why_defaults(pair, {'cost': 0.2 + gained}, {'cost': 0.2})
    assert why in found and bool(why) == bool(found)
    each = tuning.Tuned('', [], [], {}, [], found, pair=pair._asdict())
    text = ' '.join(output._said(each))
    assert ('in 2 parts of the record' in text) is (sign == 0)
    assert ('not significant' in text) is (not why and sign == 0)


@pytest.mark.parametrize('weights', PREFERENCES.values())
def test_a_constant_velocity_in_truth_and_estimate_costs_nothing(weights):
    time = 2e-3 * np.arange(4000)
    truth = np.sin(3.0 * time)
    estimate = truth + np.random.default_rng(1).normal(0.0, 0.05, len(time))
    block = pairs.blocks(time)
    slow, fast = (
        _score(time, estimate + speed, truth + speed, weights, block) for speed in (0.0, 20.0)
    )
    assert fast == pytest.approx(slow, rel=1e-6)


@pytest.mark.long
def test_ctrl_c_keeps_the_best(tmp_path):
    """Every process of the terminal gets the signal."""
    bag = write_bag(tmp_path / 'bag', {'a': 1.0}, seconds=3.0)
    out = tmp_path / 'gains.yaml'
    script = (
        'import sys, os, signal\n'
        'from estimator_pkg.evaluation.tuning import tune\n'
        'real, count = tune.relative, [0]\n'
        'def total(*words):\n'
        '    count[0] += 1\n'
        '    if count[0] == 20: os.killpg(0, signal.SIGINT)\n'
        '    return real(*words)\n'
        'tune.relative = total\n'
        'from estimator_pkg.cli import main\n'
        'sys.exit(main(sys.argv[1:]))\n'
    )
    words = ['tune', bag, '--observer', 'pll', '--out', str(out), '--jobs', '2']
    done = subprocess.run(
        [sys.executable, '-c', script, *words],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        start_new_session=True,
    )
    assert done.returncode == 0, done.stderr
    assert 'interrupted' in done.stdout and 'Traceback' not in done.stderr
    assert params_file.load(out)['observer'] == 'pll'
    assert 'after 16 trials' in out.read_text() and '# interrupted: ' in out.read_text()


# ---------------------------------------------------------------- errors, one line each


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp('tune') / 'bag', {'a': 1.0}, seconds=3.0)


@pytest.mark.long
def test_an_unreachable_scheduler(bag, tmp_path, capsys, monkeypatch):
    pytest.importorskip('distributed', reason='not run: Dask is not installed')
    monkeypatch.setattr('estimator_pkg.evaluation.workers.SCHEDULER_WAIT', '0.5s')
    words = ['--observer', 'pll', '--out', tmp_path / 'g.yaml', '--scheduler', 'tcp://127.0.0.1:9']
    line = fails(capsys, bag, *words)
    assert 'no Dask scheduler answers' in line
    assert not (tmp_path / 'g.yaml').exists()


def test_a_gain_that_nothing_observes_stays_at_its_default(tmp_path):
    still = write_bag(tmp_path / 'still', {'a': 1e-9}, seconds=3.0)
    found, out = tuned(tmp_path, still, '--observer', 'pll')
    assert "depends on 'bandwidth_hz'" in found['tuned'][0]['why']
    assert params_file.load(out) == {'observer': 'pll'}


# ---------------------------------------------------------------- without truth


@pytest.mark.parametrize(
    ('joints', 'more', 'why'),
    [
        ({'a': 1e-9}, {}, 'it moves too little'),
        ({'a': 1.0}, {'seconds': 0.012}, 'too few readings'),
        ({'a': 1.0}, {'counts': 6, 'rate': 100.0}, ''),
    ],
)
def test_without_truth_a_file_is_always_written(tmp_path, capsys, joints, more, why):
    bag = write_bag(tmp_path / 'bag', joints, truth=False, **more)
    found, out = tuned(tmp_path, bag, '--observer', 'kalman', '--trials', '8')
    (each,) = found['tuned']
    assert why in each['why'] and why in out.read_text() and why in capsys.readouterr().out
    assert params_file.load(out)['observer'] == 'kalman'


def test_a_joint_at_constant_speed_keeps_the_defaults_with_its_quantum(tmp_path):
    bag, count = str(tmp_path / 'bag'), TURN / 4096
    stamps = [START + k * 2_000_000 for k in range(3000)]
    angles = [math.floor(7.0 * k / 500.0 / count) * count for k in range(3000)]
    rows = [(stamp, ('a',), [angle], ()) for stamp, angle in zip(stamps, angles)]
    joint_bag(bag, {'/joint_states': rows})
    found, out = tuned(tmp_path, bag, '--observer', 'pll')
    assert 'constant speed' in found['tuned'][0]['why']
    gains = params_file.load(out)
    assert gains == {'observer': 'pll', 'quantum': pytest.approx(count, rel=1e-4)}


@pytest.mark.long
def test_gains_are_written_where_they_beat_the_defaults_on_held_out_data(tmp_path):
    """5 rad/s at 15 Hz: 50 Hz of bandwidth are far too few."""
    bag = write_bag(tmp_path / 'bag', {'a': 15.0}, truth=False, counts=65536)
    found, out = tuned(tmp_path, bag, '--observer', 'pll', '--trials', '16')
    (each,) = found['tuned']
    assert each['why'] == '' and each['pair']['sign'] == 1
    assert params_file.load(out)['bandwidth_hz'] > 100.0
    text = ' '.join(out.read_text().replace('#', '').split())
    assert 'better than the default set (95 %)' in text and 'Judged without ground truth' in text


@pytest.mark.long
def test_without_a_name_the_better_of_the_tuned_and_the_default_observer_is_written(
    tmp_path, monkeypatch, capsys
):
    def default_is(name):
        for module in (tuning, command):
            monkeypatch.setattr(module, 'DEFAULT', name)

    default_is('finite_difference')
    bag = write_bag(tmp_path / 'bag', {'a': 12.0}, truth=False, counts=65536, seconds=4.0)
    found, out = tuned(tmp_path, bag, '--trials', '4')
    assert found['observer'] == found['sought'] != 'finite_difference'
    assert params_file.load(out)['observer'] == found['observer']
    said = ' '.join(capsys.readouterr().out.split())
    assert f'{found["sought"]} is the best linear observer here' in said
    assert 'is better than finite_difference, the default observer as it is, (95 %)' in said
    text = ' '.join(out.read_text().replace('#', '').split())
    assert 'is better than finite_difference, the default observer' in text

    default_is('edge_adaptive')
    found, out = tuned(tmp_path, bag, '--trials', '4')
    assert found['sought'] != found['observer'] == 'edge_adaptive'
    assert params_file.load(out)['observer'] == 'edge_adaptive'
    assert 'the file has edge_adaptive as it is' in found['notes']

    still = write_bag(tmp_path / 'still', {'a': 0.001}, truth=True, seconds=4.0)
    found, out = tuned(tmp_path, still, '--trials', '2')
    assert found['observer'] == 'edge_adaptive'


@pytest.mark.parametrize(
    'results, replaced',
    [
        ([(1, 1.0)], True),
        ([(1, 1.0), (0, 2.0)], True),
        ([(0, 4.0)], True),
        ([(0, 2.0)], False),
        ([(1, 1.0), (-1, -10.0)], False),
        ([], False),  # nothing shows a delay
    ],
)
def test_without_a_name_only_a_better_observer_replaces_the_default(results, replaced):
    pairs_ = [Compared(*each, 1.0) for each in results]
    assert tuning.replaces_default(pairs_) is replaced


@pytest.mark.parametrize(
    ('words', 'text'),
    [
        (['--observer', 'pll', '--seed', '-1'], '--seed is -1: it must be from 0'),
        (['--observer', 'pll', '--seed', str(2**32)], '--seed is 4294967296: it must be'),
        (['--observer', 'pll', '--motion-hz', '-1'], '--motion-hz is -1 Hz: it must be above 0'),
        (['--observer', 'pl'], "did you mean 'pll'"),
        (['--observer', 'pll', '--search', 'bandwith_hz=1:2'], "did you mean 'bandwidth_hz'"),
        (['--observer', 'pll', '--search', 'bandwidth_hz=2:1'], 'GAIN=LOW:HIGH'),
        (['--observer', 'pll', '--search', 'low_speed_bound=0:1'], 'a number or a choice'),
        (['--observer', 'edge_adaptive', '--search', 'prefer=fast|slow'], 'is not one of'),
        (['--observer', 'pll', *held('bandwidth_hz=20')], 'nothing to search'),
        (['--observer', 'pll', '--weights', '1,2'], 'three numbers'),
        (['--observer', 'pll', '--held-out', '1'], '--held-out'),
        (['--observer', 'pll', '--jobs', '0'], '--jobs'),
        (['--observer', 'pll', '--judge', 'BAG'], 'the gains are tuned on this recording'),
        (['--observer', 'geso', *held('modle=x')], "did you mean 'model'?"),
        (['--observer', 'geso', *held('model=nowhere:X')], "cannot import 'nowhere'"),
        (['--observer', 'pmsm'], 'pmsm needs the motor data'),
        (['--observer', 'all'], 'tuning needs one'),
        (['--search', 'bandwidth_hz=1:2'], 'name it with --observer'),
    ],
)
def test_wrong_use(bag, tmp_path, capsys, words, text):
    words = [bag if word == 'BAG' else word for word in words]
    assert text in fails(capsys, bag, *words, '--out', tmp_path / 'g.yaml', code=2)
    assert not (tmp_path / 'g.yaml').exists()


@pytest.mark.long
def test_other_errors(bag, tmp_path, capsys):
    out = ('--observer', 'pll', '--out', str(tmp_path / 'g.yaml'))
    assert "no joint 'knee'" in fails(capsys, bag, *out, '--joint', 'knee')
    assert 'does not exist' in fails(capsys, str(tmp_path / 'nowhere'), *out)
    (tmp_path / 'empty').mkdir()
    assert 'contains no bag' in fails(capsys, str(tmp_path / 'empty'), *out)
    assert 'does not exist' in fails(capsys, bag, '--observer', 'pll', '--out', '/no/g.yaml')
    assert 'is a folder' in fails(capsys, bag, '--observer', 'pll', '--out', str(tmp_path))


def test_raw_counts(tmp_path, capsys):
    words = [
        'tune',
        str(COUNTS),
        *shlex.split(
            '--observer pll --angle /angle:data --trials 8 --set counts_per_revolution=4096'
        ),
        '--out',
        str(tmp_path / 'g.yaml'),
    ]
    assert main(words) == 1
    assert '--set angle_joint=wheel' in capsys.readouterr().err
    assert main([*words, '--set', 'angle_joint=wheel']) == 0
    gains = params_file.load(tmp_path / 'g.yaml')
    assert (gains['input'], gains['angle_type']) == ('angle', 'Int32')
    # as it is, it is enough to replay the bag
    assert main(['replay', str(COUNTS), '--params', str(tmp_path / 'g.yaml')]) == 0
    assert '  wheel: received 2000, used 2000' in capsys.readouterr().out


def test_a_field_of_another_type_is_in_the_file_for_the_node(tmp_path, capsys):
    topic, out = '/vicon/Group466CF/Group466CF/pose', str(tmp_path / 'g.yaml')
    words = ['--angle', f'{topic}:pose.orientation.yaw', '--observer', 'pll', '--trials', '1']
    assert main(['tune', str(YAW), *words, '--out', out]) == 0
    command_line = f'joint_observer --ros-args --params-file {out} \\\n  -r angle:={topic}'
    assert f'\nnode: {command_line}\n' in capsys.readouterr().out
    assert f'-r angle:={topic}' in Path(out).read_text()
    values = params_file.load(out)
    assert values['input'] == 'field' and values['field'] == 'pose.orientation.yaw'
    assert values['field_type'] == 'geometry_msgs/msg/PoseStamped'
    assert main(['replay', str(YAW), '--measurement', topic, '--params', out]) == 0
    assert 'received' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('words', 'topics'),
    [
        ([], ('/joint_states',)),
        (['--angle', '/encoder:data'], ('/encoder',)),
        (['--measurement', '/arm/joint_states'], ('/arm/joint_states',)),
    ],
)
def test_what_is_recorded_of_the_live_graph(words, topics, monkeypatch):
    parser = argparse.ArgumentParser()
    command.arguments(parser)
    parsed = parser.parse_args(['--live', '2', '--observer', 'pll', '--out', 'g.yaml', *words])
    monkeypatch.setattr(command.live, 'recorded', lambda *arguments: arguments)
    command.log_file.columns(parsed)
    assert command.recorded(parsed, 'pll') == (topics, '/ground_truth/joint_states', 2.0)


def test_folders_stand_for_their_bags(tmp_path):
    assert len(expanded([str(PENDULUMS)])) == 4
    one = str(PENDULUMS / 'sac_200hz_multiturn')
    assert expanded([one, one]) == [(one, '')]
    for file in (
        'single.mcap',
        'crashed/c_0.mcap',
        'crashed/c_1.mcap',
        '.busy.7.part/b_0.mcap',
        'several/first.mcap',
        'several/second.db3.zstd',
    ):
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).touch()
    assert [each.path.removeprefix(f'{tmp_path}/') for each in expanded([str(tmp_path)])] == [
        'single.mcap',
        'crashed',
        'several/first.mcap',
        'several/second.db3.zstd',
    ]
    assert expanded([str(tmp_path / 'crashed')]) == [(str(tmp_path / 'crashed'), '')]
    assert expanded([str(PENDULUMS), one])[2:] == [(one, ''), expanded([str(PENDULUMS)])[3]]
