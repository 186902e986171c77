# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Compiled functions are kept on disk, and never used once anything they call has changed."""

import os
import textwrap

import nursery
import pytest

pytest.importorskip('numba')

MODULE = """
    import math

    SCALE = 2.0

    def inner(x):
        return math.sin(x) * SCALE

    def make(gain):
        def outer(x):
            total = 0.0
            for i in range(10):
                if i in {1, 2, 3}:
                    total += inner(x) * gain
            return total
        return outer
"""
ALONE = """
    import sys
    sys.dont_write_bytecode = True
"""
CALL = """
    import sys
    sys.path.insert(0, sys.argv[1])
    import sample
    from estimator_pkg.driver.compiled import compiled
    from estimator_pkg.driver.compiled import fingerprint
    outer = sample.make(float(sys.argv[2]))
    print(fingerprint(outer))
    if sys.argv[3] == 'True':
        twin = compiled(outer)
        print(twin(0.5), sum(twin.stats.cache_hits.values()))
        assert abs(twin(0.5) - outer(0.5)) < 1e-12
"""


def python(script, *arguments):
    """What a process of its own prints, which keeps nothing but compiled functions."""
    code, output = nursery.run_script(ALONE + script, *arguments)
    assert code == 0, output
    return output


def call(folder, gain=3.0):
    digest, value, hits = python(CALL, folder, gain, True).split()
    return digest, float(value), int(hits)


@pytest.mark.long
def test_kept_between_processes_until_something_called_changes(tmp_path):
    source = tmp_path / 'sample.py'
    source.write_text(textwrap.dedent(MODULE))
    first = call(tmp_path)
    second = call(tmp_path)
    assert first[2] == 0 and second == (first[0], first[1], 1)
    digests = {first[0], python(CALL, tmp_path, 4.0, False).strip()}  # another closed over
    stat = source.stat()
    for old, new in (
        ('SCALE = 2.0', 'SCALE = 5.0'),
        ('{1, 2, 3}', '{1, 2, 4}'),
        ('* SCALE', '/ SCALE'),
    ):
        source.write_text(textwrap.dedent(MODULE).replace(old, new))
        os.utime(source, ns=(stat.st_atime_ns, stat.st_mtime_ns))  # the file alone tells nothing
        digests.add(python(CALL, tmp_path, 3.0, False).strip())
    assert len(digests) == 5
    assert call(tmp_path)[1] == pytest.approx(first[1] / 4.0)


AROUND = """
    def around(inner):
        def whole(x):
            return inner(x) + 1.0
        return whole
"""
CALL_AROUND = """
    import importlib, sys
    sys.path.insert(0, sys.argv[1])
    import shared
    from estimator_pkg.driver.compiled import compiled
    print(compiled(shared.around(importlib.import_module(sys.argv[2]).inner))(0.5))
"""


@pytest.mark.long
def test_a_module_outlives_a_copy_of_it(tmp_path):
    """What is kept is loaded by importing the module that it came from: a copy's is no other's."""
    (tmp_path / 'shared.py').write_text(textwrap.dedent(AROUND))
    copy = tmp_path / 'copied.py'
    copy.write_text(textwrap.dedent(MODULE))
    of_copy = python(CALL_AROUND, tmp_path, 'copied')
    copy.rename(tmp_path / 'sample.py')
    assert python(CALL_AROUND, tmp_path, 'sample') == of_copy
