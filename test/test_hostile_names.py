"""Names that a hostile bag may carry: they stay names in every file, line, table and page."""

from __future__ import annotations

import json
import subprocess
import sys
from types import SimpleNamespace

import pytest
import yaml

from estimator_pkg import params_file, yaml_text
from estimator_pkg.driver import adaptive_file
from estimator_pkg.errors import UsageError
from estimator_pkg.evaluation.identify import command as identify
from estimator_pkg.evaluation.tuning import output
from estimator_pkg.observers import adaptive

IMPORTS = '\n    model: own_models:Arm\n    #'
NAMES = ['y', IMPORTS, "arm'", 'a: !!python/name:os.system ""', 'x\u2028model: own:Arm\u2029',
         '\x85x', '# no', 'a\rb', '\u202egnp', '\x1b[2J', '"', "it's\n", '- a', '{a: b}']


def holds_only(text, names):
    """Each line of `text` is a comment, or belongs to the document that was meant."""
    assert all(line.isprintable() for line in text.splitlines())
    content = yaml.safe_load(text)
    assert list(content) == names
    assert yaml_text.read(text) == content
    return content


def trial(joint, bags):
    found = {'error': 0.1, 'delay_s': 0.01, 'noise': 0.02, 'cost': 0.1,
             'by_joint': {joint: {'error': 0.1, 'delay_s': 0.01, 'noise': 0.02, 'cost': 0.1},
                          'b': {'error': 0.1, 'delay_s': 0.01, 'noise': 0.02, 'cost': 0.1}}}
    return {'joint': joint, 'joints': [joint, 'b'], 'bags': bags, 'judged_on': bags,
            'held_out': 0.3, 'evaluations': 3, 'interrupted': False, 'best': found,
            'default': found, 'gains': {'bandwidth_hz': 20.0}, 'default_gains': {}, 'idle': [joint]}


@pytest.mark.parametrize('name', NAMES)
def test_tune_writes_names_as_names(name):
    from estimator_pkg import observers
    from estimator_pkg.parameters import declared
    wishes = SimpleNamespace(entry=SimpleNamespace(observer='pll'), preference=name,
                             gains=declared(observers.find('pll').gains))
    text = output.as_yaml(wishes, {'angle_joint': name, 'joints': (name,)},
                          [trial(name, [name])], 0.3)
    values = holds_only(text, ['/**'])['/**']['ros__parameters']
    assert values == {'observer': 'pll', 'angle_joint': name, 'joints': [name],
                      f'joints.{name}': {'bandwidth_hz': 20.0}}


@pytest.mark.parametrize('name', NAMES)
def test_identify_writes_names_as_names(name, tmp_path):
    import numpy as np
    found = SimpleNamespace(names=('inertia',), deviations=[0.1], values=np.array([1.0]),
                            explained_elsewhere=0.9)
    out = tmp_path / 'x.yaml'
    identify._write(out, name, (name, 'b'), ('inertia=1.0',), found, f'/tmp/{name}')
    assert holds_only(out.read_text(), ['/**'])['/**']['ros__parameters'] == {
        'model': name, 'joints': [name, 'b'], 'input_delay': 0.0,
        'model_parameters': ['inertia=1.0']}


class Said:
    """A joint that has learnt."""

    adapted, trusted, theta, names = 1.0, True, (1.0, 2.0, 3.0, 4.0), ()
    parameters = (SimpleNamespace(stddev=0.5),) * 4


@pytest.mark.parametrize('name', NAMES)
def test_save_writes_names_as_names(name, tmp_path):
    gains = adaptive.OBSERVER.gains()
    bank = SimpleNamespace(reports=lambda: {name: Said},
                           joints={name: SimpleNamespace(gains=gains)})
    out = tmp_path / 'motor.yaml'
    assert adaptive_file.save(str(out), bank) == [name]
    holds_only(out.read_text(), ['adaptive_parameters', 'joints'])
    assert list(adaptive_file.load(str(out))) == [name]
    assert adaptive_file.save(str(out), bank) == [name]


@pytest.mark.parametrize('text, said', [
    ('joints: [a, b]', "'joints' must hold each joint's name"), ('joints: 3', "'joints' must hold"),
    ('joints: {a: 3}', "of joint 'a' are damaged"), ('joints: a', "'joints' must hold"),
    ('joints: {y: {order: true, a: [1.0], b: [1.0]}}', "of joint 'y' are damaged"),
    ('joints: {a: {order: 1, a: [1.0], b: [1.0], stddev: [1.0]}}', "of joint 'a' are damaged"),
    ('joints: {a: {order: 1, a: [1.0], b: [1.0], trusted: 3}}', "of joint 'a' are damaged"),
    ('joints: !!python/name:os.system ""', 'holds no parameters'), ('joints: {[a]: 1}', 'no para')])
def test_a_wrong_parameters_file_is_one_line(text, said, tmp_path):
    path = tmp_path / 'motor.yaml'
    path.write_text(f'adaptive_parameters: 1\n{text}\n')
    with pytest.raises(UsageError, match=said) as caught:
        adaptive_file.load(str(path))
    assert '\n' not in str(caught.value)
    path.write_text('adaptive_parameters: 1\njoints:\n')
    assert adaptive_file.load(str(path)) == {}


RCL = """
import json, sys
import estimator_pkg.nodes.runtime
import rclpy
rclpy.init(args=['--ros-args', '--params-file', sys.argv[1]])
node = rclpy.create_node('x', start_parameter_services=False)
print(json.dumps({name: each.value for name, each in node._parameter_overrides.items()}))
"""


def test_ros_reads_what_is_written(tmp_path):
    """The parser of rcl takes our quotes and escapes as PyYAML does."""
    path = tmp_path / 'x.yaml'
    lines = [f'    p{number}: {yaml_text.scalar(name)}' for number, name in enumerate(NAMES)]
    lines += [f'    all: {yaml_text.scalar(NAMES)}', f'    {yaml_text.key("joints.y")}: {{a: 1}}']
    path.write_text('/**:\n  ros__parameters:\n' + '\n'.join(lines) + '\n')
    done = subprocess.run([sys.executable, '-c', RCL, str(path)], capture_output=True, text=True,
                          timeout=100)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == params_file.load(path) == {
        **{f'p{number}': name for number, name in enumerate(NAMES)}, 'all': NAMES, 'joints.y.a': 1}
