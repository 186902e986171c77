# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Names that a hostile bag may carry: they stay names in every file, line, table and page."""

import io
import json
import math
import subprocess
import sys
from pathlib import Path

import nursery
import pytest
import yaml

from estimator_pkg import params_file, yaml_text
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.evaluation import parameter_file
from estimator_pkg.messages.joint_state import TYPE, Encoder
from estimator_pkg.printable import PrintableStream, printable, show
from estimator_pkg.progress import progress

IMPORTS = '\n    model: own_models:Arm\n    #'
NAMES = [
    'y',
    IMPORTS,
    "arm'",
    'a: !!python/name:os.system ""',
    'x\u2028model: own:Arm\u2029',
    '\x85x',
    '# no',
    'a\rb',
    '\u202egnp',
    '\x1b[2J',
    '"',
    "it's\n",
    '- a',
    '{a: b}',
    '\\',
    '&a',
    '',
    '%TAG',
    '\ufeff',
    '1',
    '...',
    'a' * 300 + ' b' * 300,
]


def holds_only(text, names):
    """Each line of `text` is a comment, or belongs to the document that was meant."""
    assert all(line.isprintable() for line in text.splitlines())
    content = yaml.safe_load(text)
    assert list(content) == names
    assert yaml_text.read(text) == content
    return content


@pytest.mark.parametrize('name', [*NAMES, '\ud800'])  # ROS reads no lone surrogate
def test_a_name_stays_a_name_in_what_is_written(name):
    assert yaml_text.read(yaml_text.scalar([name])) == [name]
    assert holds_only(yaml_text.block({name: [name, 1.0]}), [name]) == {name: [name, 1.0]}
    line = yaml_text.comment(name)
    assert line.startswith('# ') and line.isprintable() and yaml.safe_load(line) is None
    values = {'model': name, 'joints': (name, 'b'), 'input_delay': 0.0}
    text = parameter_file.as_yaml([f'Identified from {name}'], values)
    written = holds_only(text, ['/**'])['/**']['ros__parameters']
    assert written == {**values, 'joints': [name, 'b']}


RCL = """
import json, sys
import estimator_pkg.ros.runtime
import rclpy
rclpy.init(args=['--ros-args', '--params-file', sys.argv[1]])
node = rclpy.create_node('x', start_parameter_services=False)
print(json.dumps({name: each.value for name, each in node._parameter_overrides.items()}))
"""


@pytest.mark.long
def test_ros_reads_what_is_written(tmp_path):
    """The parser of rcl takes our quotes and escapes as PyYAML does."""
    path = tmp_path / 'x.yaml'
    lines = [f'    p{number}: {yaml_text.scalar(name)}' for number, name in enumerate(NAMES)]
    lines += [
        f'    all: {yaml_text.scalar(NAMES)}',
        f'    {yaml_text.key("per_joint.y")}: {{a: 1}}',
    ]
    path.write_text('/**:\n  ros__parameters:\n' + '\n'.join(lines) + '\n')
    done = subprocess.run(
        [sys.executable, '-c', RCL, str(path)], capture_output=True, text=True, timeout=100
    )
    assert done.returncode == 0, done.stderr
    assert (
        json.loads(done.stdout)
        == params_file.load(path)
        == {
            **{f'p{number}': name for number, name in enumerate(NAMES)},
            'all': NAMES,
            'per_joint.y.a': 1,
        }
    )


EVIL = (
    'evil\x1b[2J\x1b]0;title\x07\nfake: ok\r\u202egnp.\u2028$\\foo$ '
    '<script>alert(1)</script> [/] \x9b'
)
FRAME = 'frame\x1b[31m\nfake'


def hostile_bag(path):
    """Two hostile joints with efforts on hostile topics, in a folder of a hostile name."""
    encode, start = Encoder().encode, 10**18
    with BagWriter(path) as bag:
        for topic in ('/joint_states', '/ground_truth/joint_states', f'/{EVIL}/estimate'):
            bag.add_topic(topic, TYPE)
        for k in range(1500):
            now, t = start + k * 2_000_000, k * 0.002
            angle = [round(600 * math.sin(5 * t)) / 600, 0.3 * math.sin(3 * t)]
            speed = [5 * math.cos(5 * t), 0.9 * math.cos(3 * t)]
            names = [EVIL, 'b']
            bag.write('/joint_states', now, encode(now, FRAME, names, angle, []))
            for topic in ('/ground_truth/joint_states', f'/{EVIL}/estimate'):
                bag.write(topic, now, encode(now, FRAME, names, angle, speed))
    return path


@pytest.fixture(scope='module')
def hostile(tmp_path_factory):
    return hostile_bag(tmp_path_factory.mktemp('bags') / 'a\x1b[2J\nfake: b\u202e[red]')


def ran(*words, code=0):
    """What the command printed, which no terminal obeys and in which no name makes a line."""
    ended, *texts = nursery.run('estimator_pkg.cli', *map(str, words))
    assert ended == code, texts
    for text in texts:
        assert 'Traceback' not in text
        for line in text.splitlines():
            assert line.isprintable(), line
            assert not line.lstrip(' -*').startswith(('fake', 'gnp.')), line
    return texts


COMMANDS = [  # (exit code, what is printed, words)
    (0, r'  evil\x1b[2J', ['replay', 'BAG', '--observer', 'pll', '--out', 'out\x1b\nfake']),
    (1, '', ['replay', 'BAG', '--observer', 'pll', '--joint', 'nobody\x1b[2J\nfake']),
    (1, '', ['replay', 'nowhere\x1b\nfake', '--observer', 'pll']),
    (1, '', ['replay', 'BAG', '--observer', 'pll', '--measurement', '/a\x1b\nfake']),
    (2, '', ['identify', 'BAG']),
    (1, '', ['identify', 'BAG', '--joint', EVIL]),
    (2, '', ['simulate', 'encoder', '--out', 'b', '--params', 'evil.yaml']),
    (2, '', ['simulate', 'encoder\x1b[2J\nfake', '--out', 'b']),
    (2, '', ['simulate', 'encoder', '--out', 'b', '--set', 'a\x1b\nfake=1']),
    (2, '', ['com\x1b\nfake']),
    (2, '', ['list', 'com\x1b\nfake']),
    (0, '', ['simulate', 'encoder', '--out', 'b\x1b[2J\nfake', '--duration', '0.01']),
]


@pytest.mark.long
@pytest.mark.parametrize('code, shown, words', COMMANDS)
def test_a_command_prints_names_as_names(code, shown, words, hostile, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path('evil.yaml').write_text('/**: {ros__parameters: {"evil\\e[2J\\nfake": 1}}')
    reported, _ = ran(*(str(hostile) if word == 'BAG' else word for word in words), code=code)
    assert shown in reported


@pytest.mark.long
def test_evaluate_prints_names_as_names(hostile, tmp_path):
    page = tmp_path / 'r.html'
    words = ['--html', page, '--plot', tmp_path / 'p.png', '--json', tmp_path / 'r.json']
    reported, _ = ran('evaluate', hostile, '--observer', 'pll', *words)
    assert r'evil\x1b[2J' in reported and r'\u202egnp' in reported
    assert json.dumps(EVIL)[1:-1] in (tmp_path / 'r.json').read_text()
    html = page.read_text()
    body = html[html.index('<h1>') : html.rindex('<p class="note">Made by')]
    assert '<script>alert' not in html and '\u202e' not in body and '\x1b' not in html
    assert r'evil\x1b[2J' in body and (tmp_path / 'p.png').stat().st_size


@pytest.mark.long
def test_tune_writes_names_that_replay_reads(hostile, tmp_path):
    words = ['--out', tmp_path / 'g.yaml', '--trials', '8', '--per-joint']
    reported, _ = ran('tune', hostile, '--observer', 'pll', *words)
    assert r'evil\x1b[2J' in reported
    text = (tmp_path / 'g.yaml').read_text()
    values = holds_only(text, ['/**'])['/**']['ros__parameters']
    assert set(values) == {'observer', f'per_joint.{EVIL}', 'per_joint.b'}
    ran('replay', hostile, '--params', tmp_path / 'g.yaml')


def test_a_progress_bar_takes_any_name():
    """Its library reads [/] as the end of a colour, and would raise."""

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    screen = Terminal()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, 'stderr', screen)
        with progress(f'a [/] {EVIL}', 3) as advance:
            advance(3)
    shown = screen.getvalue()
    assert '\x1b]0;' not in shown and '\x07' not in shown and '\u202e' not in shown


def test_a_stream_lets_line_ends_and_tabs_through_alone():
    shown = io.StringIO()
    stream = PrintableStream(shown)
    print('a\tb\nä \x1b[2J\u202e\udc80', file=stream)
    assert shown.getvalue() == 'a\tb\nä \\x1b[2J\\u202e\\udc80\n'
    show('a\nb', 'c', file=stream)
    assert shown.getvalue().endswith('a\\nb\nc\n')
    assert printable('é') == 'é' and printable('\u200b\x85\ue000') == '\\u200b\\x85\\ue000'
    plain = io.TextIOWrapper(io.BytesIO(), encoding='ascii')
    PrintableStream(plain).write('ä')
    plain.flush()
    assert plain.buffer.getvalue() == b'\\xe4'


@pytest.mark.dds
def test_a_node_logs_names_as_names(tmp_path):
    import dds  # at the top it would mark every test here

    params = tmp_path / 'p.yaml'
    params.write_text(
        '/**:\n  ros__parameters:\n'
        f'    joints: {yaml_text.scalar(["b", EVIL])}\n'
        f'    {yaml_text.key("unknown" + EVIL)}: 3\n'
    )
    probe = dds.Probe()
    try:
        with dds.NodeProcess(
            'estimator_pkg.nodes.executables joint_observer', *dds.ros_args(file=params)
        ) as process:
            process.prints('unknown parameter')
            text = process.output
    finally:
        probe.close()
    assert r'evil\x1b[2J' in text
    for line in text.splitlines():
        assert line.isprintable() and not line.startswith(('fake', 'gnp.')), line
