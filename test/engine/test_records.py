# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Records, vectors, static modules and several results: plain and C, equal to the last bit."""

import ctypes
import importlib
import shutil
import subprocess
import textwrap

import numpy as np
import pytest
from engine_build import WARNINGS, build, write

pytestmark = pytest.mark.skipif(shutil.which('gcc') is None, reason='needs gcc')

SHARED = '''
    """What the observers share."""
    import math

    from estimator_pkg.record import plain

    HALF = 0.5
    FIRST, SECOND = 1, -2
    WEIGHTS = (0.25, -0.5, 1e-300)
    FAST = True
    LIMIT = 2.0 * math.pi  # [rad]


    def wrap(angle: float, period: float) -> float:
        """Return the angle within half a period."""
        return angle - period * math.floor(angle / period + HALF)


    def clamp(x: float, limit: float) -> tuple[float, bool]:
        if x > limit:
            return limit, True
        if x < -limit:
            return -limit, True
        return x, False


    @plain
    def users(function: object) -> float:
        return function()


    def either(flag: bool, a, b):
        """For any type."""
        return a if flag else b
'''
TRACK = '''
    """A driver of records, generic over the observer."""
    from __future__ import annotations

    from typing import Annotated, Any, TYPE_CHECKING

    from engine_pkg import shared
    from engine_pkg.shared import FAST as QUICK
    from engine_pkg.shared import WEIGHTS, clamp, either
    from estimator_pkg.record import record

    if TYPE_CHECKING:
        import nothing_here as observer

    COUNT = 3
    Pair = Annotated[list[float], 2]


    @record
    class Mark:
        """A mark of the track."""

        at: float  # [rad]
        seen: bool


    @record
    class Track:
        """One joint."""

        seen: bool  # between two of eight bytes
        last: float  # [s]
        marks: Annotated[list[Mark], COUNT]
        old: bool
        p: Annotated[list[list[float]], 2, COUNT]
        counts: Annotated[list[int], 2]
        mark: Mark
        state: 'observer.State'
        states: Annotated[list[observer.State], 2]
        new: float
        pair: Pair


    def turn(track: Track) -> float:
        track.last += 1.0
        return track.last


    def total(p: Annotated[list[list[float]], 2, COUNT]) -> float:
        s = 0.0
        for i in range(2):
            row = p[i]
            for j in range(COUNT):
                s += row[j] * WEIGHTS[j]
        return s


    def spread(values: list[float], scale: float = 2.0, *, shift: float = 1.0) -> float:
        """Change a vector of any count."""
        values[0] = values[0] * scale + shift
        return values[0] - values[-1]


    def extremes(mark: Mark, other: Mark, x: float) -> tuple[float, float]:
        """The outputs may be what is read here."""
        return other.at + x, mark.at - x


    def update(track: Track, observer: Any, x: float, n: int) -> float:
        """One step of the track.

        With a second paragraph */ in it.
        """
        marks, mark = track.marks, track.mark
        state = track.state  # a pointer
        kept = Mark()
        kept.take(mark)
        mark.at, mark.seen = clamp(x, shared.LIMIT)
        mark.at, kept.at = extremes(mark, kept, x)
        for i in range(COUNT):
            one = marks[i]
            fresh = Mark()
            fresh.at += one.at + x
            # A comment between statements.
            if fresh.at > 1.0:
                one.take(fresh)
            one.seen = not one.seen
        for i in range(1, COUNT):
            one = marks[i - 1]
            one.at -= 0.5
        for each in (track.mark, marks[0], kept):
            each.at += 0.125
        track.p[0][1], track.p[1][0] = track.p[1][0] + x, track.p[0][1] - 1.0
        track.p[-1][-1] = total(track.p) + kept.at
        track.counts[1] += n // 2
        track.counts[0] = track.counts[1]
        gap = spread(track.pair)
        track.new = gap + spread(track.p[1], shift=x, scale=0.5)
        track.seen = track.old = QUICK and kept.seen
        d, left = clamp(turn(track), 3.0)
        best = either(left, d, x)
        if track.counts[0] > 10**9:
            best = shared.users('of a user')
        step = either(track.seen, n, 1)
        other = track.states[0] if left else track.states[1]
        if observer.LINEAR and x == x:
            observer.step(state, x * best)
        else:
            observer.step(state, -x)
            if not observer.LINEAR:
                observer.special(other, step)
        if not observer.LINEAR and observer.special(other, 2) > 0.0:
            track.last -= 1.0
        observer.step(other, shared.wrap(x, 2.0))
        if not observer.LINEAR:
            return observer.special(state, step)
        elif QUICK:
            return kept.at + d
        else:
            return missing(state)


    def message(tracks: list[Track], observer: Any, xs: 'NDArray[np.float64]',
                which: 'NDArray[np.int8]', out: 'NDArray[np.float64]', count: int) -> None:
        for k in range(count):
            track = tracks[k]
            which[k] += 1
            out[k] = update(track, observer, xs[k], which[k])


    def plain(mark: Mark, x: float) -> tuple[float, bool]:
        """For a record that no observer changes."""
        return mark.at * x, mark.seen and x > 0.0
'''
LINE = '''
    from estimator_pkg.record import record

    LINEAR = True


    @record
    class State:
        """Of the line."""

        x: float
        n: int


    def step(state: State, x: float) -> None:
        state.x += x
        state.n += 1
'''
CURVE = """
    from engine_pkg.shared import SECOND as FIRST
    from estimator_pkg.record import record

    LINEAR = not True


    @record
    class State:
        flag: bool
        x: float


    def step(state: State, x: float) -> None:
        state.flag = x > state.x
        state.x = 0.5 * (state.x + x)


    def special(state: State, n: int) -> float:
        state.x = -state.x + FIRST
        return state.x * n
"""

MODULES = {'shared': SHARED, 'track': TRACK, 'line': LINE, 'curve': CURVE}


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    root = tmp_path_factory.mktemp('records')
    package = root / 'engine_pkg'
    package.mkdir()
    (package / '__init__.py').write_text('')
    write(root, 'unused', '')  # it puts the root into sys.path
    for name, text in MODULES.items():
        (package / f'{name}.py').write_text(textwrap.dedent(text))
    modules = {name: importlib.import_module(f'engine_pkg.{name}') for name in MODULES}
    entries = []
    for name in ('line', 'curve'):
        static = {'observer': f'engine_pkg.{name}'}
        entries += [
            ('engine_pkg.track', 'update', static, f'{name}_update'),
            ('engine_pkg.track', 'message', static, f'{name}_message'),
        ]
    entries.append(('engine_pkg.track', 'plain', {}, 'plain'))
    text, library = build(root, *entries)
    return root, modules, text, library


def filled(dtype, rng):
    """Return four records at random."""
    array = np.zeros(4, dtype)

    def fill(view):
        for name in view.dtype.names or ():
            field = view[name]
            if field.dtype.names:
                fill(field)
            elif field.dtype.kind == 'f':
                field[...] = rng.normal(size=field.shape)
            else:
                field[...] = rng.integers(0, 2, size=field.shape)

    fill(array)
    return array


@pytest.mark.parametrize('name', ['line', 'curve'])
def test_a_track_of_records_is_equal(made, name):
    _, modules, _, library = made
    rng = np.random.default_rng(2)
    observer, Track = modules[name], modules['track'].Track.of(modules[name])
    array = filled(Track.dtype, rng)
    tracks = [Track.read(element) for element in array]
    for n, x in enumerate([*rng.normal(size=60) * 3.0, 0.0, -0.0, 5e-324, 1e300]):
        i = n % 4
        expected = modules['track'].update(tracks[i], observer, float(x), n)
        got = getattr(library, f'{name}_update')(array[i:].ctypes.data, float(x), n)
        assert repr(got) == repr(expected)
        assert repr(Track.read(array[i])) == repr(tracks[i])


@pytest.mark.parametrize('name', ['line', 'curve'])
def test_a_message_is_one_call(made, name):
    _, modules, _, library = made
    rng = np.random.default_rng(3)
    observer, Track = modules[name], modules['track'].Track.of(modules[name])
    array = filled(Track.dtype, rng)
    tracks = [Track.read(element) for element in array]
    xs, which, out = rng.normal(size=4), np.arange(4, dtype=np.int8), np.zeros(4)
    which_plain, out_plain = which.tolist(), [0.0] * 4
    modules['track'].message(tracks, observer, xs.tolist(), which_plain, out_plain, 4)
    each = array.ctypes.data + array.itemsize * np.arange(4)  # a list of records
    pointers = [a.ctypes.data for a in (each, xs, which, out)]
    getattr(library, f'{name}_message')(*pointers, 4)
    assert out.tolist() == out_plain and which.tolist() == which_plain
    assert [repr(Track.read(element)) for element in array] == [repr(track) for track in tracks]


def test_several_results_come_through_pointers(made):
    _, modules, _, library = made
    mark = modules['track'].Mark()
    mark.at, mark.seen = 0.1, True
    array = np.zeros(1, modules['track'].Mark.dtype)
    mark.write(array[0])
    x, seen = ctypes.c_double(), ctypes.c_bool()
    library.plain(array.ctypes.data, 3.0, ctypes.addressof(x), ctypes.addressof(seen))
    assert (x.value, seen.value) == modules['track'].plain(mark, 3.0)


def test_the_dtype_is_the_struct(made):
    """The offset of each field and the size, printed by C."""
    root, modules, _, _ = made
    records = {
        'LineTrack': modules['track'].Track.of(modules['line']),
        'CurveTrack': modules['track'].Track.of(modules['curve']),
        'Mark': modules['track'].Mark,
        'CurveState': modules['curve'].State,
    }
    prints, expected = [], []
    for name, record in records.items():
        fields = record.dtype.fields
        prints += [f'offsetof({name}, {f}{"_" * (f == "new")})' for f in fields] + [
            f'sizeof({name})'
        ]
        expected += [offset for _, offset in fields.values()] + [record.dtype.itemsize]
    body = ''.join(f'printf("%zu ", {item});' for item in prints)
    main = (
        f'#include "engine.c"\n#include <stddef.h>\n#include <stdio.h>\nint main(void) {{{body}}}'
    )
    (root / 'offsets.c').write_text(main)
    subprocess.run(['gcc', '-std=c99', 'offsets.c', '-o', 'offsets', '-lm'], cwd=root, check=True)
    printed = subprocess.run([root / 'offsets'], capture_output=True, text=True, check=True).stdout
    assert [int(number) for number in printed.split()] == expected


def test_the_text_reads_well(made):
    """Names by role, docstrings and comments, units of fields, constants by name."""
    _, _, text, _ = made
    for part in [
        '/* Return the angle within half a period. */\nstatic inline double wrap(double angle, ',
        '    double last;  // [s]\n',
        'static const double LIMIT = 6.283185307179586;  // 2.0 * math.pi; [rad]\n',
        'static const double WEIGHTS[3] = {0.25, -0.5, 1e-300};\n',
        'static inline void clamp(double x, double limit, double *x_out, bool *seen_out)\n',
        '    LineState *state = &track->state;  // a pointer\n',
        '        // A comment between statements.\n',
        'double line_update(LineTrack *track, double x, int64_t n)\n',
        'static inline double shared_either_bool_float(bool flag, double a, double b)\n',
        '        for (int64_t j = 0; j < COUNT; j++) {\n',
        '/* One step of the track.\n *\n * With a second paragraph * / in it.\n */\n',
    ]:
        assert part in text, part
    assert 'missing' not in text  # of the branch that a constant decides


@pytest.mark.skipif(shutil.which('g++') is None, reason='needs g++')
def test_the_text_is_cpp_too(made):
    root = made[0]
    command = ['g++', '-x', 'c++', '-std=c++17', *WARNINGS, '-c', 'engine.c', '-o', 'engine.o']
    done = subprocess.run(command, cwd=root, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
