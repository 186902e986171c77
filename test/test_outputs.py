# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The outputs of every observer on small streams have the figures in outputs.csv.

    python test/test_outputs.py        writes outputs.csv anew, after an intended change

Each line has figures of one output: its number of values, mean, rms and last value, all to a
millionth. The streams are short and full of trouble, so that most lines of the code matter to one.
"""

import contextlib
import csv
import io
import itertools
import math
import tempfile
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
import pytest

from estimator_pkg import VelocityEstimator, cli
from estimator_pkg.bags.definitions import jazzy
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.evaluation.entries import angle_observers
from estimator_pkg.observers.angle.smoother import Smoother
from estimator_pkg.sensor.stamp_repair import COLLECTING, LEFT_ALONE, REPAIRED, StampRepair

TABLE = Path(__file__).with_name('outputs.csv')
BAGS = Path(__file__).resolve().parents[1] / 'bags'
STATES = (COLLECTING, LEFT_ALONE, REPAIRED)
TOLERANCE = 1e-6
TURN = 2.0 * math.pi
START_NS = 1_700_000_000_000_000_000

# ---- streams of one angle


def streams_of_an_angle():
    """{name: (stamps [ns], readings [rad])}, the same on each machine."""
    random = np.random.default_rng(7)
    time = np.arange(700) * 2e-3
    sine = 1.2 * np.sin(2.0 * math.pi * 1.5 * time)
    ramps = np.cumsum(np.interp(time, [0.3, 0.5, 0.8, 0.85, 1.1], [0, 20, 20, -5, 0])) * 2e-3
    creep = 0.05 * time + 0.002 * np.sin(2.0 * math.pi * 2.0 * time)
    stair = np.where(time < 0.5, 0.0, np.floor((time - 0.5) * 8.0) * 0.1)

    def counts(angle, number=4096):
        return np.floor(angle * number / TURN) * TURN / number

    found = {
        'sine': (time, counts(sine)),
        'noise': (time, sine + 2e-3 * random.standard_normal(700)),
        'coarse': (time, counts(ramps, 64)),
        'ramps': (time, counts(ramps)),
        'wrapped': (time, np.mod(counts(3.0 * ramps), TURN)),
        'creep': (time, counts(creep, 2000)),
        'steps': (time, stair),
        'floats': (time[:300] * 10.0, np.interp(time[:300], time, sine)),
        'blow': (time, counts(np.where(time < 0.7, 0.0, 12.0 * (time - 0.7)))),
        'vibration': (time, counts(0.4 * time + 0.004 * np.sin(2.0 * math.pi * 83.0 * time))),
        'residue': (time, np.where(time < 0.4, 1e-13 * np.sin(time * 900.0), counts(creep * 20))),
        'repeats': (time, counts(np.repeat(sine[::2], 2))),
        'outliers': (time, counts(ramps) + np.where(np.arange(700) % 97 == 50, 0.9, 0.0)),
    }
    moved = ramps + 6.0 * time + 1.9 * (time > 0.7)
    moved[:3] += 2.0  # the first readings are no good, and later the angle is another for ever
    found['moved'] = time, np.mod(counts(moved, 8192), TURN)
    late = time.copy()
    late[::83] += 3e-3
    late[1::83] += 1.1e-3
    found['late'] = late, counts(sine)
    uneven = np.sort(time + random.uniform(-4e-4, 4e-4, 700))
    found['uneven'] = uneven, counts(np.interp(uneven, time, ramps))
    holes = time + 0.15 * (time > 0.4) + 0.9 * (time > 0.8) + 3.0 * (time > 1.1)
    found['holes'] = holes, counts(np.mod(8.0 * np.minimum(holes, 0.9), TURN))
    wrong, back = time.copy(), counts(sine)
    wrong[200], wrong[300], wrong[400:] = wrong[199], wrong[295], wrong[400:] - 0.5
    back[[100, 101, 250]] = math.nan, math.inf, 1e4
    found['faults'] = wrong, back
    return {
        name: (START_NS + np.round(1e9 * times).astype(np.int64), readings)
        for name, (times, readings) in found.items()
    }


VARIANTS = {  # other observers run at their defaults
    'edge_adaptive': ({}, {'quantum': TURN / 4096, 'prefer': 'fast'}, {'prefer': 'smooth'}),
    'hybrid_angle': (
        {},
        {'order': 2, 'injection': 'sat', 'quantum': TURN / 4096},
        {'injection': 'saw', 'max_speed': 15.0},
        {'injection': 'tan', 'order': 2, 'form': 'paper', 'bandwidth_hz': 8.0},
        {'form': 'paper', 'bandwidth_hz': 6.0, 'unwrap': True},
    ),
    'kalman': (
        {},
        {'model': 'constant_velocity', 'quantum': TURN / 4096},
        {'noise': 1e-3},
        {'model': 'constant_velocity', 'bandwidth_hz': 6.0},
    ),
    'pll': ({}, {'bandwidth_hz': 5.0, 'low_speed_bound': False}, {'damping': 1.5}),
    'finite_difference': ({}, {'bandwidth_hz': 200.0}),
    'super_twisting': ({}, {'order': 1, 'quantum': TURN / 4096}, {'order': 3}),
}
NAMES = [*VARIANTS, *(name for name in angle_observers() if name not in VARIANTS)]
CASES = [(name, gains) for name in NAMES for gains in VARIANTS.get(name, ({},))]


def words(gains):
    return ' '.join(f'{name}={value}' for name, value in gains.items())


def figures(values):
    """The number of finite values, their mean, rms and the last."""
    values = np.asarray(values, float).ravel()
    values = values[np.isfinite(values)]
    if not len(values):
        return (0, 0.0, 0.0, 0.0)
    return len(values), values.mean(), np.sqrt(np.mean(values**2)), values[-1]


def of_angle(observer, gains, stream):
    estimator = VelocityEstimator(observer, **gains)
    out = estimator.run(*STREAMS[stream])
    names = ('position', 'velocity', 'acceleration', 'position_stddev', 'velocity_stddev')
    yield from ((name, figures(getattr(out, name))) for name in names)
    for name, number in (Counter(out.status.tolist()) + Counter(estimator.dropped)).items():
        yield name, (number, 0.0, 0.0, 0.0)


def of_smoother(stream, **given):
    smoother = Smoother(0.05, TURN, **given)
    rows, last, waiting = [], None, []
    for stamp, reading in zip(*(column.tolist() for column in STREAMS[stream])):
        if not math.isfinite(reading) or (last is not None and stamp <= last):
            continue
        smoother.add(stamp, reading, reading, last is not None and stamp - last > 500_000_000)
        waiting.append(stamp)
        while waiting and waiting[0] + 50_000_000 <= stamp:
            waiting.pop(0)
            rows.append(smoother.result())
        last = stamp
    for name, column in zip(('position', 'velocity', 'of position', 'of velocity'), zip(*rows)):
        yield name, figures(column)
    yield 'learnt', figures([smoother.jerk, smoother.noise, smoother.quantum])


def stamps_of(kind):
    """(stamps [ns], angles of two joints, shape (n, 2)) of a device of 1 kHz: stamps are late."""
    random, count = np.random.default_rng(3), 9000
    number = np.arange(count)
    gone = np.flatnonzero(number % 311 == 300)
    pauses = np.zeros(count)
    pauses[gone] = np.resize([2e6, 7e6, 3e7, 4e8, 1e6, 1.6e9, 1.2e6], len(gone))
    late = {
        'late': random.uniform(0.0, 1e6, count),
        'bursts': (-number % 4) * 1e6 + random.uniform(0.0, 1e5, count),
        'drift': 1e-4 * number * 1e6 + random.exponential(2e5, count),
        'holes': random.uniform(0.0, 8e5, count) + 1e6 * np.cumsum(random.random(count) < 0.01),
        'jump': random.uniform(0.0, 5e5, count) + 4e9 * (number > 7000) - 9e9 * (number > 8000),
        'irregular': np.cumsum(random.uniform(-8e5, 8e5, count)),
        'rest': random.uniform(0.0, 4e4, count) + 1e6 * np.cumsum(random.random(count) < 0.01),
        'equal': (number % 2 == 0) * 1e6,
        'gaps': random.uniform(0.0, 2e5, count) + np.cumsum(pauses),
        'faults': random.uniform(0.0, 7e5, count)
        + 5e9 * (number > 60)
        + 3e6 * np.maximum(number - 6000, 0),
    }[kind]
    stamps = START_NS + (number * 1_000_000 + np.round(late).astype(np.int64))
    moving = np.where(kind == 'rest', np.minimum(number, 2500), number)
    angle = np.round(4.0 * np.sin(4e-3 * moving) * 651.9) / 651.9
    both = np.stack([np.mod(angle, TURN), np.mod(0.5 * angle, TURN)], axis=1)
    if kind == 'equal':  # and some messages come twice
        again = np.sort(np.concatenate([number, number[::97]]))
        stamps, both = stamps[again], both[again]
    if kind == 'gaps':  # one joint or both are not there when messages come again
        both[gone[::2], 0], both[gone[1::3], 1] = math.nan, math.nan
    if kind == 'faults':
        both[::11, 1], both[500::700, 0], stamps[400::900] = math.nan, 1e12, 0
    return stamps.tolist(), both.tolist()


def of_stamp_repair(kind):
    repair = StampRepair(lambda name: TURN)
    stamps, angles = stamps_of(kind)
    used = ('a', 'b') if kind in ('rest', 'equal', 'gaps', 'faults') else ('a',)
    states, out = Counter(), []
    for stamp, positions in zip(stamps, angles):
        out.append(repair(stamp, used, positions[: len(used)]) - stamp)
        states[STATES.index(repair.state)] += 1
    yield 'stamps', figures(np.array(out) * 1e-9)
    yield 'fit', figures([repair.period, repair.drift, repair.jitter, repair.offset])
    yield 'states', figures([states[state] for state in range(len(STATES))])


KINDS = ['late', 'bursts', 'drift', 'holes', 'jump', 'irregular', 'rest', 'equal', 'gaps', 'faults']
STREAMS = streams_of_an_angle()

# ---- observers that know more, from bags

MOTOR = 'resistance=0.06 inductance=33.75e-6 flux=1.9e-3 pole_pairs=7'
MADE = {
    'dc_motor': ('dc_motor', 1.2, 'load=0.3 coulomb=0.05 rate=500'),
    'gripper': ('gripper', 2.5, 'rate=100'),
    'cart_pendulum': ('cart_pendulum', 0.8, 'rate=500'),
    'robotic_leg': ('robotic_leg', 0.5, 'rate=500'),
    'pmsm': ('pmsm', 0.2, 'lost=0.01 repeated=0.01 overtaken=0.01'),
}
DRIVEN = [
    *((f'{bag}', f'{each}', f'model={bag} {more}') for bag in ('cart_pendulum', 'robotic_leg')
      for each, more in (('geso', ''), ('geso', 'disturbance_hz=1'), ('hgo', ''), ('ehgo', ''),
                         ('smo', ''))),
    ('dc_motor', 'adaptive', ''),
    ('dc_motor', 'adaptive', 'form=paper law=gradient'),
    ('dc_motor', 'adaptive', 'load=true memory=0.5'),
    ('gripper', 'switched', ''),
    ('gripper', 'switched', 'memory=1 steps=2'),
    ('pmsm', 'pmsm', MOTOR),
    ('pmsm', 'pmsm', MOTOR + ' variant=hybrid'),
    ('pmsm', 'pmsm', MOTOR + ' variant=continuous voltage_delay=1.5'),
]  # fmt: skip


def with_set(text):
    return list(itertools.chain.from_iterable(('--set', word) for word in text.split()))


def quietly(*given, silent=False):
    """Run a command; `silent`: it makes no estimate, which is exit code 1."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        assert cli.main([str(word) for word in given]) == silent, given


def numbers(value):
    """All numbers in a message, in order."""
    if isinstance(value, (int, float)):
        yield float(value)
    elif isinstance(value, np.ndarray):
        yield from value.astype(float).tolist()
    elif isinstance(value, (list, tuple)):
        for each in value:
            yield from numbers(each)
    elif hasattr(value, '__dataclass_fields__'):
        for name in value.__dataclass_fields__:
            if name != 'header':
                yield from numbers(getattr(value, name))
    elif isinstance(value, str):
        with contextlib.suppress(ValueError):
            yield float(value)


def columns(message):
    """(name, numbers) of each column of a batch of samples, else of the whole message."""
    if not hasattr(message, 'layout'):
        return [('', numbers(message))]
    rows = message.data.reshape(-1, message.layout.dim[-1].size)
    return [(f' {k}', column.tolist()) for k, column in enumerate(rows.T)]


SILENT = ('geso model=robotic_leg disturbance_hz=1', 'adaptive form=paper law=gradient')


def of_bag(folder, bag, observer, text):
    found = defaultdict(list)
    with tempfile.TemporaryDirectory(dir=folder) as place:
        out = Path(place) / 'out'
        words = [folder / bag, '--observer', observer, *with_set(text), '--out', out]
        quietly('replay', *words, silent=f'{observer} {text}'.strip() in SILENT)
        with open_bag(out) as opened:
            for message in opened.messages():
                kind = opened.topics[message.topic].type
                name = message.topic.rpartition('/')[2]
                if '_observer/' in message.topic:
                    for column, values in columns(
                        jazzy().deserialize_cdr(bytes(message.raw), kind)
                    ):
                        found[name + column].extend(values)
    for name, values in sorted(found.items()):
        yield name, figures(values)


# ---- the table


def cases():
    """(group, function of a folder that gives the rows) of every case."""
    for (observer, gains), stream in itertools.product(CASES, STREAMS):
        yield (
            f'{observer} {words(gains)}'.strip(),
            stream,
            lambda _, o=observer, g=gains, s=stream: of_angle(o, g, s),
        )
    for stream in STREAMS:
        yield 'smoother', stream, lambda _, s=stream: of_smoother(s)
        yield 'smoother, quantum', stream, lambda _, s=stream: of_smoother(s, quantum=TURN / 4096)
    for kind in KINDS:
        yield 'stamp_repair', kind, lambda _, k=kind: of_stamp_repair(k)
    for bag, observer, text in DRIVEN:
        yield (
            f'{observer} {text}'.strip(),
            bag,
            lambda folder, b=bag, o=observer, t=text: of_bag(folder, b, o, t),
        )


def make_bags(folder):
    for name, (plant, seconds, text) in MADE.items():
        quietly('simulate', plant, '--duration', seconds, '--seed', 3, *with_set(text),
                '--out', folder / name)  # fmt: skip


def rows_of(name, stream, function, folder):
    for output, values in function(folder):
        yield [name, stream, output, *(f'{value:.8g}' for value in values)]


def expected():
    found = defaultdict(dict)
    with TABLE.open(newline='') as file:
        for name, stream, output, *values in list(csv.reader(file))[1:]:
            found[name, stream][output] = [float(value) for value in values]
    return found


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp('outputs')
    make_bags(made)
    return made


@pytest.fixture(scope='module')
def table():
    return expected()


@pytest.mark.parametrize(
    'name, stream, function', [pytest.param(*case, id=f'{case[0]}-{case[1]}') for case in cases()]
)
@pytest.mark.long
def test_outputs(name, stream, function, table, request):
    folder = request.getfixturevalue('folder') if stream in MADE else None
    found = {row[2]: [float(value) for value in row[3:]] for row in
             rows_of(name, stream, function, folder)}  # fmt: skip
    assert set(found) == set(table[name, stream]), 'new outputs: python test/test_outputs.py'
    for output, values in found.items():
        scale = TOLERANCE * max(1e-12, *map(abs, table[name, stream][output][1:]))
        assert values == pytest.approx(table[name, stream][output], rel=TOLERANCE, abs=scale), (
            output
        )


if __name__ == '__main__':
    with tempfile.TemporaryDirectory() as place, TABLE.open('w', newline='') as out:
        make_bags(Path(place))
        writer = csv.writer(out, lineterminator='\n')
        writer.writerow(['observer', 'stream', 'output', 'number', 'mean', 'rms', 'last'])
        for name, stream, function in cases():
            writer.writerows(rows_of(name, stream, function, Path(place)))
