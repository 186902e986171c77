# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The built library is used where it fits the sources; else there is one line of reason."""

import ctypes
import shutil
import subprocess
import sys
import time

import pytest
from engine_build import WARNINGS, build, write

from estimator_pkg.engine import calls, sources
from estimator_pkg.engine.entries import entries, installed
from estimator_pkg.engine.load import PACKAGE, load
from estimator_pkg.engine.translate import translate

pytestmark = pytest.mark.skipif(shutil.which('gcc') is None, reason='needs gcc')
HELPER = 'def twice(x: float) -> float:\n    return 2.0 * x\n'
MAIN = """
from loaded_helper import twice


def four(x: float) -> float:
    return twice(twice(x))
"""
AGAIN = 'install the package again'


@pytest.fixture
def built(tmp_path):
    write(tmp_path, 'loaded_helper', HELPER)
    write(tmp_path, 'loaded_main', MAIN)
    _, library = build(tmp_path, ('loaded_main', 'four', {}, 'four'))
    assert library.four(1.5) == 6.0
    return tmp_path / 'engine.so'


def refused(path):
    library, reason = load.__wrapped__(path, path.parent)
    assert library is None and '\n' not in reason
    return reason


def test_the_functions_have_types(built):
    library, reason = load.__wrapped__(built, built.parent)
    assert reason == '' and isinstance(library, ctypes.PyDLL)
    assert library.four.restype is ctypes.c_double
    with pytest.raises(ctypes.ArgumentError):
        library.four('text')
    with pytest.raises(TypeError):
        library.four()


def test_it_is_loaded_once(built):
    assert load(built, built.parent) is load(built, built.parent)


def test_a_missing_library_names_the_remedy(tmp_path):
    assert refused(tmp_path / '_engine.so') == (
        'no engine was built: install a C compiler, then the package again'
    )


@pytest.mark.parametrize('name', ['loaded_main.py', 'loaded_helper.py'])
def test_an_edit_of_a_source_makes_it_stale(built, name):
    path = built.parent / name
    text = path.read_text()
    path.write_text(text + '# edited\n')
    assert refused(built) == f'engine.so was made from other sources: {AGAIN}'
    path.write_text(text.replace('\n', '\r\n'), newline='')  # git on Windows
    assert load.__wrapped__(built, built.parent)[0] is not None
    path.unlink()
    assert refused(built) == f'engine.so was made from other sources: {AGAIN}'


def test_an_edit_of_the_translator_makes_it_stale(built, monkeypatch):
    monkeypatch.setattr(sources, 'TRANSLATOR', 'entries expressions')
    assert refused(built) == f'engine.so was made from other sources: {AGAIN}'


@pytest.mark.parametrize('size', [0, 10, 63, 64, 1000, 0.5, 0.99])
def test_a_file_that_is_cut_short_is_refused(built, size):
    data = built.read_bytes()
    cut = built.with_name('cut.so')
    cut.write_bytes(data[: size if isinstance(size, int) else int(size * len(data))])
    reason = refused(cut)
    assert reason.startswith('cut.so cannot be loaded (') and reason.endswith(AGAIN)


def test_another_file_is_refused(built):
    other = built.with_name('other.so')
    other.write_text('#!/bin/sh\n' * 100)
    assert 'invalid ELF header' in refused(other) or 'cannot be loaded' in refused(other)
    foreign = bytearray(built.read_bytes())
    foreign[18] ^= 0xFF  # of another processor
    other.write_bytes(foreign)
    assert 'cannot be loaded' in refused(other)


def test_the_library_of_somebody_else_is_refused(tmp_path):
    (tmp_path / 'else.c').write_text('int nothing(void) { return 0; }\n')
    subprocess.run(['gcc', '-shared', '-fPIC', 'else.c', '-o', 'else.so'], cwd=tmp_path, check=True)
    reason = refused(tmp_path / 'else.so')
    assert 'undefined symbol: velocity_estimator_digest' in reason


def test_the_package_is_installed_with_its_engine():
    library, reason = load()
    assert library is not None, reason


@pytest.fixture(scope='module')
def text():
    return translate(entries(installed(), PACKAGE.parent), PACKAGE.parent)


@pytest.mark.long
@pytest.mark.parametrize(
    'compiler',
    [
        'gcc -std=c99 -fsyntax-only',
        'g++ -std=c++17 -fsyntax-only -x c++',
        pytest.param('gcc -std=c99 -O2 -c', marks=pytest.mark.slow),  # pip compiles with -O2, too
    ],
)
def test_the_engine_of_the_package_compiles_without_a_warning(text, tmp_path, compiler):
    if shutil.which(compiler.split()[0]) is None:
        pytest.skip(f'needs {compiler}')
    assert all(f' {entry.name}(' in text for entry in entries(installed(), PACKAGE.parent))
    (tmp_path / 'engine.c').write_text(text)
    command = [*compiler.split(), *WARNINGS, 'engine.c']
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.long
def test_the_hash_of_all_sources_takes_milliseconds(text):
    read = [name for name in text.split('"') if name.endswith('.py ')]
    times = []
    for _ in range(5):
        begun = time.perf_counter()
        sources.digest(PACKAGE.parent, [name.strip() for name in read])
        times.append(time.perf_counter() - begun)
    assert len(read) > 10 and min(times) < 0.01


def test_a_stale_engine_is_reported_once(tmp_path):
    """By the process that would use it; its workers are silent."""
    (tmp_path / '_engine.so').touch()
    script = (
        'from multiprocessing import get_context\nfrom pathlib import Path\n'
        'from estimator_pkg.engine import calls\n'
        'from estimator_pkg.observers.angle.kalman import Kalman\n'
        f'calls.LIBRARY = Path({str(tmp_path / "_engine.so")!r})\n'
        'calls.load = lambda: (None, "_engine.so was made from other sources: install again")\n'
        'calls.functions_of(Kalman), calls.available()\n'
        'fork = get_context("fork").Process(target=calls.available)\n'
        'calls._refused.cache_clear()\nfork.start()\nfork.join()\n'
    )
    done = subprocess.run([sys.executable, '-c', script], text=True, capture_output=True)
    assert done.returncode == 0 and not done.stdout
    assert done.stderr.count('\n') == 1
    assert done.stderr.startswith('warning: _engine.so was made from other sources: install again;')


def test_a_machine_without_an_engine_is_silent(monkeypatch, capsys):
    monkeypatch.setattr(calls, 'LIBRARY', PACKAGE / 'nothing.so')
    monkeypatch.setattr(calls, 'load', lambda: (None, 'no engine was built'))
    assert not calls.available() and capsys.readouterr().err == ''
