# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Small modules, translated, compiled with every warning as an error, and loaded."""

import importlib.util
import os
import struct
import subprocess
import sys
import textwrap

from estimator_pkg.engine.load import load
from estimator_pkg.engine.translate import FLAGS, Entry, translate

WARNINGS = ['-Wall', '-Wextra', '-Werror']
MORE = os.environ.get('ENGINE_TEST_CFLAGS', '').split()  # the sanitizers


def write(root, name, text):
    """Write a module and import it; other modules of the same root may be imported by it."""
    path = root / f'{name}.py'
    path.write_text(textwrap.dedent(text))
    if str(root) not in sys.path:
        sys.path.insert(0, str(root))
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def build(root, *entries, warnings=WARNINGS):
    """Return the C text of entry points and the loaded library."""
    text = translate([Entry(*entry) for entry in entries], root)
    (root / 'engine.c').write_text(text)
    command = ['gcc', *FLAGS, *warnings, *MORE, '-fPIC', '-shared', 'engine.c', '-o', 'engine.so']
    done = subprocess.run([*command, '-lm'], cwd=root, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    library, reason = load.__wrapped__(root / 'engine.so', root)
    assert library is not None, reason
    return text, library


def bits(value):
    """Return what two equal results share: the bits of a number, with one NaN."""
    if isinstance(value, float):
        return 'nan' if value != value else struct.pack('<d', value)
    return value
