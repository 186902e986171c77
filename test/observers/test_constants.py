# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""How many numbers a law has: every literal but 0, 1, 2, 0.5 and those of a named equation."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2] / 'estimator_pkg'
# folder: the number that holds; it only falls
MOST = {'observers/angle/edge': 23, 'sensor': 226}
FREE = {0, 1, 2, 0.5}
# numbers of an equation, by the function that has it; '*': in all
EQUATIONS = {
    '*': {12.0, 1e9, 1e-9},  # q^2/12, variance of a cell; nanoseconds
    'add_manoeuvre': {29.0, 5.0, 3.0, 6.0, 10.0},  # half white acceleration, half white jerk
    'add_velocity_noise': {1.5},  # white acceleration over a sample
    'widen': {6.0},  # P_ij ~ density^((1 + i + j)/6)
    'prepare': {3.0, 0.125, 0.05},  # dt^3/3, dt^4/8, dt^5/20 of white jerk
    'ratios': {6.0, 3, 5.0},  # of powers of the density
    'begin_line': {3.0, 0.25},  # variance of a uniform distribution; half of it is a bend, squared
    'inflate_for_manoeuvre': {1.5},  # 3 SIGMAS/n m^2/2 = ALARM
    'predict': {6.0},  # q^2/6, variance of the difference of two cells
    'deviation': {4.0},  # a parabola within q for T ends 4 q/T steeper
    'start_variance': {8.0},  # (4 q/T)^2/2
    'settle': {12.0},
    'follow_phase': {0.25},  # K^2/4, critical damping
}


def constants(folder):
    """[(file, number)] of all literals of a law that no named equation has."""
    found = []
    for path in sorted((ROOT / folder).rglob('*.py')):
        tree = ast.parse(path.read_text())
        within = {
            id(node): function.name
            for function in ast.walk(tree)
            if isinstance(function, ast.FunctionDef)
            for node in ast.walk(function)
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and type(node.value) in (int, float):
                named = EQUATIONS['*'] | EQUATIONS.get(within.get(id(node), '*'), set())
                if node.value not in FREE | named:
                    found.append((path.name, node.value))
    return found


@pytest.mark.parametrize('folder', MOST)
def test_a_law_has_no_more_numbers_than_before(folder):
    found = constants(folder)
    assert len(found) <= MOST[folder], found
    assert len(found) > MOST[folder] - 3, 'fewer: lower the number'
