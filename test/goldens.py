# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Holds what the package puts out, to the last bit, while its inside is rebuilt.

    nice .venv/bin/python test/goldens.py make FILE.json       compute and write
    nice .venv/bin/python test/goldens.py check FILE.json      compute, compare, list; exit 1 if any
    ... check FILE.json --tolerance 0.02 --numeric             is any figure off by more than 2 %?
    ... check FILE.json --with OTHER.json                      compare two files, compute nothing
    --only REGEX    only jobs and ids in which it is found (what is gone is then not told)
    --full          the long benchmarks too
    --jobs N        processes (2)                               --all    list every id that differs

It runs the installed package (`make install` first) through its command line and files, so that it
survives what is moved inside. The file has two parts:

exact    id -> hash. A topic: number of messages and hash of their stamps and bytes; 'by joint':
         of (stamp, position, velocity) of every joint with a finite velocity, whatever message it
         stands in, which outlives a change of the messages' shape; 'summary': of what --json says
         but for paths and times; 'refused': the exit code and the line of a parameter refused.
numeric  id -> figure. Errors of `evaluate`, median standard deviations, benchmarks. Equal within
         --tolerance, relative (default 1e-9), or within what `FLOORS` says.

Ids of replay are replay/BAG/OBSERVER[ PARAMETER=VALUE]/WAY/TOPIC, where the way is plain or
compiled, or 'both' where these are the same. If 'by joint' holds
and the topic does not, only the shape changed; if estimate holds and estimate_stddev does not, only
the deviations did; if simulate/BAG differs, look there first: all that was made of the bag follows.

Left out: outputs of live nodes alone (a test holds them to replay's), `bench speed` (times),
pictures and HTML (their makers put versions and ids into them).
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import importlib
import io
import json
import math
import os
import pkgutil
import re
import shutil
import struct
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from importlib.metadata import entry_points
from multiprocessing import get_context
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT))  # benchmarks; the packages are the installed ones
FLOORS = {'delay_s': 1e-5, 'delay': 1e-5, 'coverage_95': 5e-3, 'bias': 1e-3}
SEED = '3'
ANGLES = ('edge_adaptive', 'finite_difference', 'hybrid_angle', 'kalman', 'pll', 'super_twisting')
MECHANICAL = ('geso', 'hgo', 'ehgo', 'smo')
MOTOR = ('resistance=0.06', 'inductance=33.75e-6', 'flux=1.9e-3', 'pole_pairs=7')

# bags with positions on /joint_states, and of poses: bag -> what replay is told
POSE = '/vicon/Group466CF/Group466CF/pose:pose.'
SHIPPED = {
    'dfki_double_pendulum/at_rest_500hz_duplicate_stamp': (),
    'dfki_double_pendulum/sys_id_500hz': (),
    'dfki_double_pendulum/trajectory_665hz': (),
    'dfki_simple_pendulum/energy_shaping_200hz': (),
    'dfki_simple_pendulum/gravity_compensation_1000hz': (),
    'dfki_simple_pendulum/sac_200hz_multiturn': (),
    'dfki_simple_pendulum/system_identification_300hz': (),
    'joint_state_one_message/array_msgs': (),
    'simulated/random_with_faults': (),
    'simulated/sine_12bit': (),
    'simulated/trapezoid_raw_counts': (
        '--angle',
        '/angle:data',
        '--set',
        'counts_per_revolution=4096',
    ),
    **{
        f'vicon/{name}': ('--angle', POSE + 'orientation.yaw')
        for name in ('yawbag', 'flybag', 'yx2bag')
    },
    'vicon/flybag/../flybag': ('--angle', POSE + 'position.z', '--set', 'wrap_period=0'),
}
TOGETHER = {
    'super_twisting': ('order=1; form=implicit', 'order=3; form=taylor'),
    'hybrid_angle': ('form=paper; order=2', 'injection=sat; order=2'),
    'adaptive': ('form=paper; law=gradient', 'load=true; memory=5'),
}
DRIVES = ('drive_profile', 'drive_reversal', 'drive_startup')
# made here: name -> (plant, seconds, settings)
MADE = {
    'encoder': ('encoder', 4, ()),
    'encoder two joints': ('encoder', 4, ('joints=[left, right]', 'profile=random')),
    'encoder chirp': ('encoder', 6, ('profile=chirp', 'counts_per_revolution=1024')),
    'encoder faults': (
        'encoder',
        6,
        (
            'profile=random',
            'noise=0.002',
            'outliers=0.005',
            'repeated=0.05',
            'dropped=0.05',
            'duplicated=0.02',
            'stamp_jitter=0.0002',
            'gap_every=1.5',
            'burst_every=2',
        ),
    ),
    'encoder slow': ('encoder', 20, ('rate=5', 'amplitude=1')),
    'encoder repeats': ('encoder', 4, ('update_every=2', 'rate=224')),
    'dc_motor': ('dc_motor', 6, ()),
    'dc_motor load': ('dc_motor', 6, ('load=0.3', 'coulomb=0.05')),
    'gripper': ('gripper', 7, ()),
    'cart_pendulum': ('cart_pendulum', 4, ()),
    'robotic_leg': ('robotic_leg', 3, ()),
    'pendulum': ('pendulum', 8, ()),
    'pmsm': ('pmsm', 1, ()),
    'pmsm pairs': ('pmsm', 0.5, ('publish=single', 'publish_rate=2000', 'dead_time=1e-6')),
    'pmsm faults': (
        'pmsm',
        0.5,
        ('lost=0.01', 'repeated=0.01', 'overtaken=0.01', 'profile=reversal'),
    ),
}
COUNTED = ('pole_pairs', 'steps', 'periods')  # varied by hand, or of the plant
MODELS = {
    'cart_pendulum': ('model=cart_pendulum',),
    'robotic_leg': ('model=robotic_leg',),
    'pendulum': ('model=single_joint', 'joints=[joint]'),
}


# ---- the package's inside: this function alone knows of it --------------------------------------


def compile_from(samples: float) -> None:
    """Observers are compiled from so many samples on: 0 always, inf never (where replay chooses).

    The length stands in constants of this name; every module that has one is told.
    """
    package = importlib.import_module('estimator_pkg')
    told = 0
    for module in pkgutil.walk_packages(package.__path__, 'estimator_pkg.'):
        with contextlib.suppress(ImportError):
            found = importlib.import_module(module.name)
            if hasattr(found, 'COMPILE_FROM'):
                found.COMPILE_FROM = samples  # type: ignore[attr-defined]  a constant of the module found
                told += 1
    if not told:
        raise RuntimeError(
            'no module has COMPILE_FROM: tell goldens.py how replay is made to compile'
        )


# ---- running and hashing ------------------------------------------------------------------------


def command(*words: str) -> tuple[int, str, str]:
    """(exit code, stdout, stderr) of `velocity_estimator` with these words, in this process."""
    if words[0] == 'bench':
        from benchmarks.__main__ import main

        words = words[1:]
    else:
        main = next(iter(entry_points(group='console_scripts', name='velocity_estimator'))).load()
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = main(list(words))
        except SystemExit as leaving:
            code = leaving.code
    return int(code or 0), out.getvalue(), err.getvalue()


def done(*words: str) -> str:
    """The stdout of a command that must succeed."""
    code, out, err = command(*words)
    if code:
        raise RuntimeError(f'{" ".join(words)}: exit code {code}: {err}')
    return out


def short(*parts: bytes) -> str:
    """A hash of 64 bits."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part)
    return digest.hexdigest()[:16]


def text(value: Any) -> str:
    """A hash of text, or of data as JSON; floats count to the last bit."""
    if not isinstance(value, str):
        value = json.dumps(value, sort_keys=True)
    return short(value.encode())


def topics(bag: str) -> dict[str, list[tuple[int, bytes, str]]]:
    """Topic -> (log time, payload, type) of a bag of one MCAP file, read by the mcap library."""
    from mcap.reader import make_reader

    (path,) = Path(bag).glob('*.mcap')
    found: dict[str, list[tuple[int, bytes, str]]] = {}
    with path.open('rb') as file:
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            kind = schema.name if schema else ''
            found.setdefault(channel.topic, []).append((message.log_time, message.data, kind))
    return found


def of_topic(messages: list[tuple[int, bytes, str]]) -> str:
    """Number of messages, and the hash of their log times and payloads in order."""
    return f'{len(messages)} ' + short(
        *(part for time_ns, data, _ in messages for part in (struct.pack('<q', time_ns), data))
    )


class Cdr:
    """Little-endian CDR from its first bytes on; a decoder that is not the package's own."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data[4:], 0

    def uint32(self) -> int:
        """The next uint32."""
        self.at += -self.at % 4
        self.at += 4
        return int.from_bytes(self.data[self.at - 4 : self.at], 'little')

    def string(self) -> str:
        """The next string."""
        length = self.uint32()
        self.at += length
        return self.data[self.at - length : self.at - 1].decode()

    def doubles(self) -> tuple[float, ...]:
        """The next sequence of doubles."""
        count = self.uint32()
        if count:
            self.at += -self.at % 8
        self.at += 8 * count
        return struct.unpack(f'<{count}d', self.data[self.at - 8 * count : self.at])


def joints(messages: list[tuple[int, bytes, str]]) -> dict[str, list[tuple[int, float, float]]]:
    """Joint -> (stamp, position, velocity), of sensor_msgs/JointState, finite velocities alone."""
    found: dict[str, list[tuple[int, float, float]]] = {}
    for _, data, _ in messages:
        cdr = Cdr(data)
        stamp = cdr.uint32() * 1_000_000_000 + cdr.uint32()
        cdr.string()
        names = [cdr.string() for _ in range(cdr.uint32())]
        for name, position, velocity in zip(names, cdr.doubles(), cdr.doubles()):
            if math.isfinite(velocity):
                found.setdefault(name, []).append((stamp, position, velocity))
    return found


def by_joint(found: dict[str, list[tuple[int, float, float]]]) -> str:
    """Number of estimates, and their hash, joint by joint."""
    return f'{sum(map(len, found.values()))} ' + short(
        *(
            part
            for name in sorted(found)
            for part in (name.encode(), *(struct.pack('<qdd', *row) for row in found[name]))
        )
    )


Found = tuple[dict[str, str], dict[str, float | None]]


# ---- jobs: each gives its part of both tables ---------------------------------------------------


def simulate(name: str) -> Found:
    """A bag that is made here; its topics."""
    plant, seconds, settings = MADE[name]
    out = f'made/{name}'
    done(
        'simulate',
        plant,
        '--duration',
        str(seconds),
        '--seed',
        SEED,
        '--out',
        out,
        *setting(settings),
    )
    return {
        f'simulate/{name}{topic}': of_topic(messages) for topic, messages in topics(out).items()
    }, {}


def setting(values: tuple[str, ...]) -> list[str]:
    """The words of --set."""
    return [word for value in values for word in ('--set', value)]


def replay(
    label: str,
    bag: str,
    words: tuple[str, ...],
    compiled: bool,
    sigma: bool = False,
    copied: bool = False,
) -> Found:
    """What replay writes and says."""
    import numpy as np

    compile_from(0 if compiled else math.inf)
    where = f'replay/{label}'
    with tempfile.TemporaryDirectory(dir='.') as folder:
        out, said = f'{folder}/out', f'{folder}/said.json'
        code, _, err = command(
            'replay', bag, *words, '--out', out, '--json', said, *(() if copied else ('--copy',))
        )
        if code:
            return {f'{where}/refused': f'{code} {text(err.replace(folder, ""))}'}, {}
        summary = json.loads(Path(said).read_text())
        exact = {}
        numeric: dict[str, float | None] = {}
        for key in ('elapsed_s', 'out', 'bag'):
            summary.pop(key, None)
        exact[f'{where}/summary'] = text(summary)
        for topic, messages in topics(out).items():
            own = topic if copied else '/' + topic.rsplit('/', 1)[1]
            exact[f'{where}{own}'] = of_topic(messages)
            if messages[0][2].endswith('/JointState') and own.startswith('/estimate'):
                found = joints(messages)
                exact[f'{where}{own} by joint'] = by_joint(found)
                if sigma and own == '/estimate_stddev':
                    for name, rows in found.items():
                        numeric[f'sigma/{label.rsplit("/", 1)[0]}/{name}'] = float(
                            np.median([velocity for _, _, velocity in rows])
                        )
    return exact, numeric


def evaluate(label: str, bag: str, words: tuple[str, ...]) -> Found:
    """Errors of all angle observers at their defaults."""
    compile_from(math.inf)
    with tempfile.TemporaryDirectory(dir='.') as folder:
        code, _, err = command(
            'evaluate', bag, '--observer', 'all', *words, '--json', f'{folder}/e.json'
        )
        if code:
            return {f'evaluate/{label}/refused': f'{code} {text(err.replace(folder, ""))}'}, {}
        result = json.loads(Path(f'{folder}/e.json').read_text())
    numeric = {}
    for one in result['bags'].values():
        for observer, estimates in one['estimates'].items():
            for joint, numbers in estimates['joints'].items():
                for key in ('rms', 'mean_abs', 'delay_s'):
                    numeric[f'evaluate/{label}/{observer}/{joint}/{key}'] = numbers['velocity'][key]
                numeric[f'evaluate/{label}/{observer}/{joint}/coverage_95'] = numbers.get(
                    'coverage_95'
                )
    return {}, numeric


def words_of_the_package() -> Found:
    """Help, lists, and the parameter files."""
    known = json.loads(done('list', '--json', '-'))
    exact = {
        'help/velocity_estimator': text(done('--help')),
        'list': text(done('list')),
        'list --json': text(known),
    }
    for name in known['commands']:
        exact[f'help/{name}'] = text(done(name, '--help'))
    for part, entries in known.items():
        for name in entries if part != 'settings of each joint' else ():
            exact[f'list/{name}'] = text(done('list', name))
    for path in sorted(Path('config').glob('*.yaml')):
        exact[f'config/{path.name}'] = text(path.read_text())
    return exact, {}


def written(label: str, *words: str) -> Found:
    """A file of parameters that a command writes."""
    compile_from(math.inf)
    with tempfile.TemporaryDirectory(dir='.') as folder:
        out = f'{folder}/gains.yaml'
        done(*words, '--out', out)
        return {f'written/{label}': text(Path(out).read_text())}, {}


def bench(part: str, *words: str) -> Found:
    """The figures of a part of `bench accuracy`."""
    with tempfile.TemporaryDirectory(dir='.') as folder:
        command('bench', 'accuracy', '--part', part, *words, '--json', f'{folder}/b.json')
        result = json.loads(Path(f'{folder}/b.json').read_text())
    result.pop('machine', None)
    return {}, {f'bench/{part}{key}': value for key, value in figures(result)}


def figures(data: Any, path: str = '') -> Iterator[tuple[str, float]]:
    """(path, number) of every number in JSON; entries of lists go by the words that they carry."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from figures(value, f'{path}/{key}')
    elif isinstance(data, list):
        seen: dict[str, int] = {}
        for entry in data:
            label = (
                ' '.join(
                    str(entry[key])
                    for key in ('observer', 'name', 'told', 'gain', 'tuning', 'signal', 'column')
                    if isinstance(entry, dict) and entry.get(key)
                )
                or '-'
            )
            seen[label] = seen.get(label, 0) + 1
            again = f' ({seen[label]})' if seen[label] > 1 else ''
            yield from figures(entry, f'{path}/{label}{again}')
    elif isinstance(data, (int, float)) and not isinstance(data, bool):
        yield path, float(data)


def variants(observer: str, known: dict[str, Any]) -> Iterator[str]:
    """Every other choice of the observer's parameters, one at a time."""
    for name, told in known['observers'][observer]['parameters'].items():
        if (name == 'model' and observer != 'kalman') or name in COUNTED:
            continue
        choices = [choice for choice in told['choices'] if '.' not in choice]
        if told['type'] == 'bool':
            choices = ['false' if told['default'] else 'true']
        elif told['type'] == 'int' and told['minimum'] is not None:
            choices = list(range(int(told['minimum']), min(int(told['maximum']), 4) + 1))
        for choice in choices:
            if choice != told['default']:
                yield f'{name}={choice}'


Job = tuple[Callable[..., Found], tuple]


def plan(full: bool, known: dict[str, Any]) -> list[Job]:
    """All that is computed of bags, the long ones first."""
    jobs: list[Job] = []
    if full:
        jobs += [(bench, ('recordings',)), (bench, ('field',))]
    jobs += [(bench, ('defaults', '--draws', '4')), (bench, ('drive',)), (words_of_the_package, ())]
    angles = {name: (f'bags/{name}', words) for name, words in SHIPPED.items()}
    angles |= {name: (f'made/{name}', ()) for name in MADE if name.startswith('encoder')}
    angles['dc_motor'] = ('made/dc_motor', ())
    for name, (bag, words) in angles.items():
        label = name.replace('/../flybag', ' z')
        jobs.append((evaluate, (label, bag, words)))
        for observer in ANGLES:
            for way in ('plain', 'compiled'):
                jobs.append(
                    (
                        replay,
                        (
                            f'{label}/{observer}/{way}',
                            bag,
                            ('--observer', observer, *words),
                            way == 'compiled',
                            way == 'plain',
                        ),
                    )
                )
    settings = (
        'unwrap=true',
        'wrap_period=0',
        'quantum=0.0015339807878856412',
        'gap_max=0.01',
        'bandwidth_hz=20',
    )
    for name in ('simulated/random_with_faults', 'dfki_simple_pendulum/sac_200hz_multiturn'):
        for observer in ANGLES:
            for value in (*variants(observer, known), *settings, *TOGETHER.get(observer, ())):
                told = ('--observer', observer, *setting(tuple(value.split('; '))))
                for way in ('plain', 'compiled'):
                    jobs.append(
                        (
                            replay,
                            (
                                f'{name}/{observer} {value}/{way}',
                                f'bags/{name}',
                                told,
                                way == 'compiled',
                            ),
                        )
                    )

    def driven(name: str, observer: str, *values: str, bag: str = '', note: str = '') -> None:
        told = ('--observer', observer, *setting(values))
        jobs.append(
            (replay, (f'{name}/{observer}{note}/plain', bag or f'made/{name}', told, False, True))
        )

    for name, values in MODELS.items():
        for observer in MECHANICAL:
            driven(name, observer, *values)
            for value in variants(observer, known):
                driven(name, observer, *values, value, note=f' {value}')
        driven(name, 'geso', *values, 'disturbance_hz=1', note=' disturbance_hz=1')
    for observer in MECHANICAL[1:]:
        driven(
            'dfki_double_pendulum/sys_id_500hz',
            observer,
            'model=two_links',
            'joints=[shoulder, elbow]',
            bag='bags/dfki_double_pendulum/sys_id_500hz',
        )
    for name in ('dc_motor', 'dc_motor load'):
        driven(name, 'adaptive')
        for value in (
            *variants('adaptive', known),
            'memory=5',
            "known=['k/J=0']",
            'torque_constant=0.6',
            *TOGETHER['adaptive'],
        ):
            driven(name, 'adaptive', *value.split('; '), note=f' {value}')
    for name in ('dfki_simple_pendulum/sac_200hz_multiturn', 'dfki_double_pendulum/sys_id_500hz'):
        driven(name, 'adaptive', 'gravity=true', bag=f'bags/{name}', note=' gravity=true')
    driven('gripper', 'switched')
    for value in (*variants('switched', known), 'memory=1', 'steps=2'):
        driven('gripper', 'switched', value, note=f' {value}')

    for name in (*DRIVES, 'pmsm', 'pmsm pairs', 'pmsm faults'):
        bag = f'bags/simulated/{name}' if name in DRIVES else f'made/{name}'
        told = ('input=current_voltage',) if name == 'pmsm pairs' else ()
        for value in (
            '',
            *(variants('pmsm', known) if name in ('drive_startup', 'pmsm pairs') else ()),
        ):
            for way in ('plain', 'compiled')[: 1 if name == 'pmsm pairs' else 2]:
                values = (
                    *MOTOR,
                    *told,
                    *((value,) if value else ()),
                    f'compile={str(way == "compiled").lower()}',
                )
                jobs.append(
                    (
                        replay,
                        (
                            f'{name}/pmsm{" " * bool(value)}{value}/{way}',
                            bag,
                            ('--observer', 'pmsm', *setting(values)),
                            False,
                            not value and way == 'plain',
                        ),
                    )
                )
    # with the messages of the bag copied, by file, by joint, under another name
    short_bag = 'bags/dfki_double_pendulum/at_rest_500hz_duplicate_stamp'
    jobs.append((replay, ('copied', short_bag, (), False, False, True)))
    jobs.append(
        (
            replay,
            (
                'joint and name',
                short_bag,
                ('--joint', 'elbow', '--name', 'arm/own'),
                False,
                False,
                True,
            ),
        )
    )
    for name in ('joint_observer', 'adaptive_observer', 'switched_observer', 'pmsm_observer'):
        bag = {
            'joint_observer': short_bag,
            'adaptive_observer': 'made/dc_motor',
            'switched_observer': 'made/gripper',
            'pmsm_observer': 'bags/simulated/drive_startup',
        }[name]
        jobs.append(
            (replay, (f'by config/{name}', bag, ('--params', f'config/{name}.yaml'), False))
        )
    record = 'bags/dfki_simple_pendulum/system_identification_300hz'
    jobs += [
        (
            written,
            (
                'tune kalman',
                'tune',
                record,
                '--observer',
                'kalman',
                '--trials',
                '8',
                '--seed',
                '1',
                '--jobs',
                '1',
            ),
        ),
        (
            written,
            (
                'tune hybrid_angle',
                'tune',
                record,
                '--observer',
                'hybrid_angle',
                '--trials',
                '8',
                '--seed',
                '1',
                '--jobs',
                '1',
            ),
        ),
        (written, ('identify pendulum', 'identify', 'made/pendulum')),
        (
            written,
            (
                'identify cart_pendulum',
                'identify',
                'made/cart_pendulum',
                '--model',
                'cart_pendulum',
            ),
        ),
    ]
    return jobs


# ---- all of it ----------------------------------------------------------------------------------


def named(job: Job) -> str:
    """How a job is called for --only."""
    function, given = job
    return '/'.join([function.__name__, *(word for word in given if isinstance(word, str))])


def start(folder: str) -> None:
    """Once in each process."""
    os.chdir(folder)


def run(job: Job) -> tuple[str, Found, float]:
    """A job in a process of the pool; what it raises names the job."""
    begun = time.perf_counter()
    function, given = job
    try:
        return named(job), function(*given), time.perf_counter() - begun
    except Exception as error:
        return (
            named(job),
            ({f'failed/{named(job)}': f'{type(error).__name__}: {error}'[:300]}, {}),
            time.perf_counter() - begun,
        )


def compute(parsed: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Both tables."""
    begun = time.perf_counter()
    os.environ.update(
        COLUMNS='80',
        LINES='50',
        NO_COLOR='1',
        TERM='dumb',
        LC_ALL='C.UTF-8',
        OMP_NUM_THREADS='1',
        OPENBLAS_NUM_THREADS='1',
    )
    exact: dict[str, Any] = {}
    numeric: dict[str, Any] = {}
    folder = tempfile.mkdtemp(prefix='goldens')
    sys.path.remove(str(Path(__file__).resolve().parent))  # the installed package, no test modules
    try:
        for name in ('bags', 'config'):
            os.symlink(ROOT / name, f'{folder}/{name}')
        os.mkdir(f'{folder}/made')
        with ProcessPoolExecutor(parsed.jobs, get_context('spawn'), start, (folder,)) as pool:
            known = json.loads(pool.submit(done, 'list', '--json', '-').result())
            jobs = [job for job in plan(parsed.full, known) if re.search(parsed.only, named(job))]
            bags = [
                name
                for name in MADE
                if not parsed.only
                or any(f'made/{name}' in job[1] or 'identify' in job[1] for job in jobs)
                or re.search(parsed.only, f'simulate/{name}')
            ]
            slow = []
            for group in ([(simulate, (name,)) for name in bags], jobs):
                waiting = [pool.submit(run, job) for job in group]
                for count, future in enumerate(as_completed(waiting), 1):
                    name, found, seconds = future.result()
                    exact.update(found[0])
                    numeric.update(found[1])
                    slow.append((seconds, name))
                    if sys.stderr.isatty():
                        print(f'\r{count} of {len(group)} ', end='', file=sys.stderr)
    finally:
        shutil.rmtree(folder)
    if parsed.times:
        for seconds, name in sorted(slow, reverse=True)[:25]:
            print(f'{seconds:7.2f} s  {name}', file=sys.stderr)
    print(
        f'{len(exact)} hashes and {len(numeric)} figures in {time.perf_counter() - begun:.0f} s',
        file=sys.stderr,
    )
    return {'exact': dict(sorted(folded(exact).items())), 'numeric': dict(sorted(numeric.items()))}


def folded(exact: dict[str, str]) -> dict[str, str]:
    """With one id for plain and compiled where they are the same."""
    found = dict(exact)
    for key, value in exact.items():
        twin = key.replace('/plain/', '/compiled/')
        if twin != key and exact.get(twin) == value:
            found[key.replace('/plain/', '/both/')] = value
            del found[key], found[twin]
    return found


def unfolded(exact: dict[str, str]) -> dict[str, str]:
    """As before `folded`."""
    return {
        key.replace('/both/', f'/{way}/'): value
        for key, value in exact.items()
        for way in (('plain', 'compiled') if '/both/' in key else ('both',))
    }


def apart(old: float | None, new: float | None, key: str) -> float:
    """The relative change; 0 within the floor of this figure, inf if only one is a number."""
    if old is None or new is None:
        return 0.0 if old is new else math.inf
    size = max(abs(old), abs(new))
    if abs(new - old) <= FLOORS.get(key.rsplit('/', 1)[1], 0.0) or size == 0.0:
        return 0.0
    return abs(new - old) / size


def compare(old: dict[str, dict], new: dict[str, dict], parsed: argparse.Namespace) -> int:
    """Lists the differences; how many there are. Only ids that were asked for are compared."""

    def asked(key: str) -> bool:
        long = key.startswith(('bench/field', 'bench/recordings')) and not parsed.full
        there = all(key in table['numeric'] for table in (old, new))  # or it was not computed
        return (not long or there) and bool(re.search(parsed.only, key))

    total = 0
    old, new = ({**table, 'exact': unfolded(table['exact'])} for table in (old, new))
    failed = [
        key
        for key in sorted(new['exact'].keys() - old['exact'].keys())
        if asked(key) and (key.startswith('failed/') or key.endswith('/refused'))
    ] * parsed.numeric
    for key in failed:  # its figures are not there to be compared
        print(f'{key}: {new["exact"][key]}')
    total += len(failed)
    for part in ('exact', 'numeric')[parsed.numeric :]:
        keys = sorted(filter(asked, old[part].keys() | new[part].keys()))
        lines: list[tuple[float, str, str]] = []
        for key in keys:
            if key not in new[part] or key not in old[part]:
                # with --only, what belongs to jobs that did not run is not missing
                if key in new[part] or not parsed.only:
                    lines.append((math.inf, key, 'new' if key in new[part] else 'gone'))
            elif part == 'exact':
                if old[part][key] != new[part][key]:
                    lines.append((math.inf, key, f'{old[part][key]} -> {new[part][key]}'))
            else:
                change = apart(old[part][key], new[part][key], key)
                if change > parsed.tolerance:
                    lines.append(
                        (change, key, f'{old[part][key]!r} -> {new[part][key]!r} ({change:.2%})')
                    )
        total += len(lines)
        print(f'{part}: {len(lines)} of {len(keys)} differ')
        if part == 'exact' and not parsed.all:
            tables: dict[str, list[str]] = {}
            for _, key, change in lines:
                group, _, output = key.rpartition('/')
                counts = {word.split()[0] for word in change.split(' -> ') if ' ' in word}
                tables.setdefault(group, []).append(
                    output
                    + (f' ({change})' if change in ('new', 'gone') or len(counts) > 1 else '')
                )
            for group, outputs in tables.items():
                print(f'  {group}: {", ".join(outputs)}')
        else:
            for _, key, change in sorted(lines, key=lambda line: (-line[0], line[1])):
                print(f'  {key}: {change}')
    return total


def main() -> int:
    """The command; its exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').split('\n\n')[0])
    parser.add_argument('verb', choices=('make', 'check'))
    parser.add_argument('file', metavar='FILE.json', type=Path)
    parser.add_argument(
        '--tolerance',
        type=float,
        default=1e-9,
        metavar='R',
        help='relative change of a figure that is no difference (default 1e-9)',
    )
    parser.add_argument('--numeric', action='store_true', help='compare the figures alone')
    parser.add_argument('--only', default='', metavar='REGEX', help='jobs and ids with this alone')
    parser.add_argument(
        '--with',
        dest='other',
        type=Path,
        metavar='OTHER.json',
        help='compare with this file, and compute nothing',
    )
    parser.add_argument(
        '--full', action='store_true', help='the benchmarks of minutes too: field and recordings'
    )
    parser.add_argument('--jobs', type=int, default=2, metavar='N', help='processes (default 2)')
    parser.add_argument(
        '--all', action='store_true', help='list every id that differs, with both values'
    )
    parser.add_argument('--times', action='store_true', help='tell what takes long')
    parsed = parser.parse_args()
    if parsed.verb == 'make':
        found = compute(parsed)
        parsed.file.write_text(json.dumps(found, indent=0) + '\n')
        failed = [key for key in found['exact'] if key.startswith('failed/')]
        print(*failed, sep='\n', end='')
        return 1 if failed else 0
    old = json.loads(parsed.file.read_text())
    new = json.loads(parsed.other.read_text()) if parsed.other else compute(parsed)
    return 1 if compare(old, new, parsed) else 0


if __name__ == '__main__':
    sys.exit(main())
