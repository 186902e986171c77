"""Launch files, read as text: PyPI has no launch, so none of them can be run here."""

import ast
import importlib.metadata
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
FILES = sorted((ROOT / 'launch').iterdir())
ARGUMENTS = ['params_file', 'namespace', 'use_sim_time', 'name']


def nodes():
    """Names of the executables that are nodes."""
    return {
        script.name
        for script in importlib.metadata.entry_points(group='console_scripts')
        if '_pkg.nodes.' in script.value
    }


def test_every_node_has_its_launch_file():
    assert {path.name for path in FILES if path.is_file()} == {
        f'{node}.launch.py' for node in nodes()
    }


@pytest.mark.parametrize(
    'path', [path for path in FILES if path.is_file()], ids=lambda path: path.name
)
def test_a_launch_file_starts_the_node_of_its_name(path):
    name = path.name.removesuffix('.launch.py')
    tree = ast.parse(path.read_text())
    assert f'ros2 launch velocity_estimator {path.name}' in ast.get_docstring(tree)
    (function,) = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    assert function.name == 'generate_launch_description'
    returned = ast.unparse(function.body[-1])
    own_time = ', MAKES_TIME' if name.endswith('_sim') else ''
    assert returned == f"return one_node('{name}'{own_time})"
    assert f'config/{name}.yaml' in ast.get_docstring(function)
    config = yaml.safe_load((ROOT / 'config' / f'{name}.yaml').read_text())
    assert list(config) == ['/**']  # holds whatever the node is called


def test_what_they_share_has_the_arguments_and_hands_them_on():
    source = (ROOT / 'estimator_pkg/nodes/launching.py').read_text()
    calls = [
        call
        for call in ast.walk(ast.parse(source))
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name)
    ]
    (rows,) = [
        part.value
        for part in ast.walk(ast.parse(source))
        if isinstance(part, ast.Assign) and ast.unparse(part.targets[0]) == 'arguments'
    ]
    assert [row.elts[0].value for row in rows.elts] == ARGUMENTS
    (node,) = [call for call in calls if call.func.id == 'Node']
    handed = {part.slice.value for part in ast.walk(node) if isinstance(part, ast.Subscript)}
    assert handed | {'use_sim_time'} == set(ARGUMENTS)
    given = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
    assert given['executable'] == 'name'
    assert given['name'] == "given['name']"
    assert given['namespace'] == "given['namespace']"
    assert given['ros_arguments'] == "['--params-file', given['params_file']]"
    assert given['parameters'] == "[{'use_sim_time': sim_time}]"
