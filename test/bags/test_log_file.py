# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Logs, .csv, .mat and .npz, are read as a bag of joint states, by four commands."""

import json
import math
import shlex
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from estimator_pkg import cli
from estimator_pkg.bags.log_file import Columns
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.series import joint_series
from estimator_pkg.errors import UserError

DFKI = Path(__file__).resolve().parents[2] / 'bags' / 'dfki_double_pendulum' / 'sys_id_500hz'
COUNT = 300
TIME = np.arange(COUNT) * 2e-3
ANGLE = np.round(np.sin(5.0 * TIME), 4)
DATES = np.datetime64('2024-05-01T12:00:00') + (TIME * 1e6).round().astype('timedelta64[us]')
EPOCH_NS = 1_714_564_800_000_000_000


def rows(form, separator=','):
    """Lines of a CSV: `form` has {t} [s], {q} [rad], {d} [deg] and i, the number of the row."""
    lines = (
        form.format(i=i, t=t, q=q, d=math.degrees(q), ms=1e3 * t, ns=EPOCH_NS + 2_000_000 * i)
        for i, (t, q) in enumerate(zip(TIME, ANGLE))
    )
    return '\n'.join(lines).replace('|', separator) + '\n'


GERMAN = rows('{ms:.3f}|{d:.6f}|ok', ';').replace('.', ',')
# name: (bytes, the options that the error adds)
CSVS = {
    'crlf': ('t,q\n' + rows('{t:.6f}|{q:.4f}'), '--time t --angle q'),
    'spaces': ('time, pos\n' + rows('{t:.6f}| {q:.4f}'), '--time time --angle pos'),
    'quoted': (
        '"time (ms)","enc (deg)"\n' + rows('"{ms:.3f}"|"{d:.6f}"'),
        "--time 'time (ms)' --time-unit ms --angle 'enc (deg)' --unit deg",
    ),
    'semicolons, decimal commas': (
        'Zeit [ms];Winkel [°];Kommentar\n' + GERMAN,
        "--time 'Zeit [ms]' --time-unit ms --angle 'Winkel [°]' --unit deg",
    ),
    'quoted decimal commas': (
        't,x\n' + '\n'.join(f'"{t:.4f}","{q:.4f}"'.replace('.', ',') for t, q in zip(TIME, ANGLE)),
        '--time t --angle x',
    ),
    'tabs': ('t\tq\n' + rows('{t:.6f}|{q:.4f}', '\t'), '--time t --angle q'),
    'savetxt': ('# t q\n' + rows('{t:.18e}|{q:.18e}', ' '), '--time t --angle q'),
    'no names': (rows('{t:.6f}|{q:.4f}'), '--time 0 --angle 1'),
    'preamble and units': (
        '# a rig\nrate,500\n\ntime,theta,i\ns,rad,A\n' + rows('{t:.6f}|{q:.4f}|1'),
        '--time time --angle theta',
    ),
    'last line': ('t,q\n' + rows('{t:.6f}|{q:.4f}') + 'end of log\n', '--time t --angle q'),
    'ns since 1970': (
        't [ns],q\n' + rows('{ns}|{q:.4f}'),
        "--time 't [ns]' --time-unit ns --angle q",
    ),
    'dates': (
        'datetime,q\n' + '\n'.join(f'{t}Z,{q}' for t, q in zip(DATES, ANGLE)),
        '--time datetime --angle q',
    ),
}


def written(folder, name):
    """The file, and the options of its error."""
    text, options = CSVS[name]
    path = folder / 'log.csv'
    coding = {'semicolons, decimal commas': 'cp1252', 'tabs': 'utf-16'}.get(name, 'utf-8')
    path.write_bytes(text.replace('\n', '\r\n' if name == 'crlf' else '\n').encode(coding))
    return path, options


def columns(options):
    """`Columns` of a command line with these options."""
    words = shlex.split(options)
    pairs = list(zip(words[::2], words[1::2]))
    found = dict(pairs)
    return Columns(
        'velocity_estimator doctor log.csv',
        found.get('--time'),
        found.get('--time-unit'),
        tuple(value for name, value in pairs if name == '--angle'),
        found.get('--unit'),
        float(found['--counts']) if '--counts' in found else None,
    )


def read(path, options):
    with open_bag(path, columns=columns(options)) as bag:
        return joint_series(bag, '/joint_states')


def assert_is_the_motion(series, tolerance=1e-6):
    used = series.stamps_ns[:COUNT]
    assert series.stamps_ns.dtype == np.int64 and used[0] > 0
    assert np.abs(used - used[0] - 2_000_000 * np.arange(COUNT)).max() <= 500
    assert np.abs(series.position[:COUNT] - ANGLE).max() < tolerance


@pytest.mark.parametrize('name', CSVS)
def test_a_csv_and_the_line_to_type(name, tmp_path):
    path, options = written(tmp_path, name)
    with pytest.raises(UserError) as found:
        read(path, '')
    assert str(found.value).endswith(f', as in: velocity_estimator doctor log.csv {options}')
    (series,) = read(path, options).values()
    assert_is_the_motion(series)
    first = EPOCH_NS if '1970' in name or name == 'dates' else 10**9
    assert abs(series.stamps_ns[0] - first) < 200
    last = {'last line': [0]}.get(name, [])  # a row that is no row has no time
    assert series.stamps_ns[COUNT:].tolist() == last


def test_arrays_structs_and_matrices(tmp_path):
    both = np.stack([ANGLE, 2.0 * ANGLE], axis=1)
    np.savez(tmp_path / 'log.npz', t=TIME, q=both, what='a', rate=500.0, o=np.array([{}], object))
    found = read(tmp_path / 'log.npz', '--time t --angle q[1] --angle q[0]')
    assert list(found) == ['q[1]', 'q[0]']
    assert_is_the_motion(found['q[0]'])
    np.savez(tmp_path / 'log.npz', when=DATES, q=ANGLE)
    assert_is_the_motion(read(tmp_path / 'log.npz', '--time when --angle q')['q'])
    log = {'time': TIME[:, None], 'q': both.T, 'arm': {'theta': ANGLE[None]}}
    savemat(tmp_path / 'log.mat', {'t': TIME[:, None], 'q': ANGLE[:, None], 'log': log, 'fs': 5.0})
    with pytest.raises(UserError, match=r'columns t, q, log.time, log.q\[0\], log.q\[1\], log.arm'):
        read(tmp_path / 'log.mat', '')
    for options in ('--time t --angle q', '--time log.time --angle log.arm.theta'):
        (series,) = read(tmp_path / 'log.mat', options).values()
        assert_is_the_motion(series)


@pytest.mark.parametrize(
    ('options', 'factor'),
    [('--unit deg', math.pi / 180), ('--unit mm', 1e-3), ('--unit m', 1.0),
     ('--unit count --counts 4096', math.tau / 4096)],
)  # fmt: skip
def test_units(options, factor, tmp_path):
    (tmp_path / 'log.csv').write_text('t,q\n' + rows('{ms:.0f}|{q:.4f}'))
    series = read(tmp_path / 'log.csv', f'--time t --angle q --time-unit ms {options}')['q']
    assert_is_the_motion(series._replace(position=series.position / factor))


def test_what_is_missing_or_out_of_order_is_left_to_the_guard(tmp_path, capsys):
    times = [f'{t:.4f}' for t in TIME]
    cells = [f'{q:.4f}' for q in ANGLE]
    times[100], times[150], times[200] = '', '99.0', times[190]
    cells[10], cells[20], cells[30] = '', 'n/a', 'inf'
    path = tmp_path / 'log.csv'
    path.write_text('t,q,empty\n' + '\n'.join(f'{t},{q},' for t, q in zip(times, cells)))
    words = ['replay', str(path), '--time', 't', '--angle', 'q', '--angle', 'empty', '--json', '-']
    assert cli.main(words) == 0
    printed = capsys.readouterr()
    joints = json.loads(printed.out)['joints']
    assert joints['q']['dropped'] == {'late': 1, 'non_finite': 3, 'zero_stamp': 1}
    assert joints['q']['events'] == {'outage': 1, 'stray_stamp': 1}
    assert joints['empty']['dropped'] == {'non_finite': COUNT}
    assert "2 of 300 cells of column 'q' are no numbers" in printed.err
    with open_bag(path, columns=columns('--time t --angle q')) as bag:
        times = np.array([message.log_ns for message in bag.messages()])
    assert np.all(np.diff(times) >= 0) and times[160] == 10**9 + 320_000_000


GOOD = 'time,q [deg],x,epoch,words,coarse\n' + rows('{t}|{d}|{q}|{ns}|a|1.71456e9')
MAT73 = b'MATLAB 7.3 MAT-file'.ljust(124) + b'\0\2IM' + bytes(900)
TQ = '--time t --angle q'
WRONG = [  # name of the file, its text, bytes or arrays, the options, what is said
    ('log.csv', GOOD, '--time tme --angle q', "has no column 'tme': did you mean 'time'?"),
    ('log.csv', GOOD, '--time time --angle zz', "column 'zz': it has time, q [deg], x, epoch, wor"),
    ('log.csv', GOOD, '--time time --angle "q [deg]"', 'add --unit deg (or --unit rad, if'),
    ('log.csv', GOOD, '--time words --angle x', "column 'words' has no time"),
    ('log.csv', GOOD, '--time time --angle words', "column 'words' has no number"),
    ('log.csv', GOOD, '--time epoch --angle x',
     f'{EPOCH_NS + 2_000_000 * (COUNT - 1)} s, after the year 2038: add --time-unit ns'),
    ('log.csv', GOOD, '--time coarse --angle x', 'resolution is too coarse for the sample time'),
    ('log.csv', '', TQ, 'has no row of numbers'),
    ('log.csv', 'a,b\nc,d\n', TQ, 'has no row of numbers'),
    ('log.mat', b'abc' * 100, TQ, 'cannot be read as .mat'),
    ('log.npz', b'abc' * 100, TQ, 'is not an .npz file'),
    ('log.mat', MAT73, TQ, "'-v7' in MATLAB"),
    ('log.npz', {'t': np.float32(1.7e9 + TIME), 'q': ANGLE}, TQ,
     'times near 1.7e+09 s have a resolution of 1.3e+02 s as float32'),
    ('log.npz', {'t': TIME, 'q': ANGLE[1:]}, TQ, "column 'q' has 299 rows, the time 300"),
]  # fmt: skip


@pytest.mark.parametrize(('name', 'content', 'options', 'said'), WRONG)
def test_what_cannot_be_read_has_a_remedy(name, content, options, said, tmp_path):
    path = tmp_path / name
    if isinstance(content, dict):
        np.savez(path, **content)
    else:
        path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(UserError) as found:
        read(path, options)
    assert said in str(found.value)


@pytest.fixture(scope='module')
def recorded(tmp_path_factory):
    """The readings of a real recording as a CSV."""
    path = tmp_path_factory.mktemp('log') / 'log.csv'
    with open_bag(DFKI) as bag:
        every = joint_series(bag, '/joint_states')
    seconds = (every['shoulder'].stamps_ns - every['shoulder'].stamps_ns[0]) * 1e-9
    table = np.column_stack([seconds, *(each.position for each in every.values())])
    np.savetxt(path, table, '%.17g', ',', header='time,shoulder,elbow', comments='')
    return path


OPTIONS = ['--time', 'time', '--angle', 'shoulder', '--angle', 'elbow']


def result(capsys, *words):
    assert cli.main([*map(str, words), '--json', '-']) == 0
    return json.loads(capsys.readouterr().out)


def test_a_log_gives_what_its_bag_gives(recorded, tmp_path, capsys):
    bag, estimates = tmp_path / 'bag', '/joint_observer/estimate'
    of_log = result(capsys, 'replay', recorded, *OPTIONS, '--out', bag)
    of_bag = result(capsys, 'replay', DFKI, '--out', tmp_path / 'other')
    for joint, of_joint in of_bag['joints'].items():
        same = 'received', 'used', 'dropped', 'events'
        assert [of_joint[each] for each in same] == [of_log['joints'][joint][each] for each in same]
    with open_bag(bag) as log, open_bag(tmp_path / 'other') as other:
        found, wanted = joint_series(log, estimates), joint_series(other, estimates)
        assert set(joint_series(log, '/joint_states')) == {'shoulder', 'elbow'}
    for joint in ('shoulder', 'elbow'):
        assert np.array_equal(found[joint].velocity, wanted[joint].velocity, equal_nan=True)
    log = result(capsys, 'evaluate', recorded, *OPTIONS, '--observer', 'kalman')['bags']
    whole = result(capsys, 'evaluate', DFKI, '--observer', 'kalman', '--reference', 'smoother')
    for joint in ('shoulder', 'elbow'):
        rms = [
            each['estimates']['kalman']['joints'][joint]['velocity']['rms']
            for each in (*log.values(), *whole['bags'].values())
        ]
        assert rms[0] == pytest.approx(rms[1], rel=1e-3)


def test_lengths_do_not_wrap(tmp_path, capsys):
    """They pass 4 m a sample, and hybrid_angle wraps whatever has a period."""
    path, out = tmp_path / 'log.csv', tmp_path / 'out'
    time = np.arange(0, 2, 2e-3)
    path.write_text('t,x\n' + '\n'.join(f'{t:.3f},{2e6 * t:.2f}' for t in time))
    words = ['--time', 't', '--angle', 'x', '--unit', 'mm', '--observer', 'hybrid_angle']
    result(capsys, 'replay', path, *words, '--out', out)
    with open_bag(out) as bag:
        series = joint_series(bag, '/joint_observer/estimate')['x']
    assert series.position[-1] == pytest.approx(2e3 * time[-1], abs=0.2)
    assert series.velocity[-1] == pytest.approx(2e3, rel=1e-3)


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        ('doctor BAG --time t', '--time is for logs (.csv, .mat, .npz): omit it'),
        ('replay BAG --angle /a:b --angle /c:d', 'one TOPIC:FIELD can be read'),
        ('evaluate LOG BAG --time t --angle q', 'others are bags: name logs or bags'),
        ('tune BAG --judge LOG --out x', 'others are bags: name logs or bags'),
        ('replay LOG --time t --angle q --unit count', '--unit count and --counts N'),
        ('replay LOG --time t --angle q --unit count --counts 0.5', 'it must be 1 or more'),
        ('doctor LOG --time t', 'as in: velocity_estimator doctor LOG --time t --angle q\n'),
        ('identify LOG --out x', 'velocity_estimator replay LOG --time t --angle q --out BAG\n'),
    ],
)
def test_options_that_do_not_fit(words, said, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path('log.csv').write_text('t,q\n' + rows('{t}|{q}'))
    names = {'BAG': str(DFKI), 'LOG': 'log.csv'}
    assert cli.main([names.get(word, word) for word in words.split()]) == 2
    assert said.replace('LOG', 'log.csv') in capsys.readouterr().err
