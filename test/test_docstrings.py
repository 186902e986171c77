# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The docstring of a public function, its class or its module gives the shapes of its arrays."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FILES = [*ROOT.glob('estimator_pkg/**/*.py'), *ROOT.glob('sim_pkg/**/*.py')]
# numpy's types and their aliases, without `Rows` and `Matrix`, which are no arrays in some files
ARRAYS = r'NDArray|ArrayLike|ndarray|\b(Array|Floats|Mask|Numbers|Stamps|Vectors|Whole)\b'


def without_shape(node, known=''):
    """Yield the names of functions of arrays whose docstrings lack a shape."""
    known += ast.get_docstring(node) or ''
    for child in node.body:
        if isinstance(child, ast.ClassDef):
            yield from without_shape(child, known)
        elif isinstance(child, ast.FunctionDef) and not child.name.startswith('_'):
            types = [each.annotation for each in ast.walk(child.args) if isinstance(each, ast.arg)]
            text = ' '.join(ast.unparse(each) for each in [*types, child.returns] if each)
            if re.search(ARRAYS, text) and 'shape' not in known + (ast.get_docstring(child) or ''):
                yield child.name


def test_public_functions_give_the_shapes_of_their_arrays():
    assert FILES
    missing = {str(path): [*without_shape(ast.parse(path.read_text()))] for path in FILES}
    assert {path: names for path, names in missing.items() if names} == {}
