"""The documentation: a page for every observer, tables from the declarations, layouts that hold."""

import importlib.util
import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from estimator_pkg import registry
from estimator_pkg.errors import UserError
from estimator_pkg.parameters import declared

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / 'docs'
LAYOUTS = ROOT / 'layouts'
LONGER = {'edge_adaptive'}  # a derivation with sections of its own; its table is added by the hook
TOPICS = {'/joint_states', '/ground_truth/joint_states', '/joint_observer/estimate',
          '/joint_observer/estimate_stddev', '/joint_observer/status'}


def observers():
    found = []
    for name in registry.names(registry.OBSERVERS):
        try:
            registry.find(registry.OBSERVERS, name)
        except UserError:
            continue
        found.append(name)
    return found


def hooks():
    spec = importlib.util.spec_from_file_location('docs_hooks', DOCS / 'hooks.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize('name', observers())
def test_every_observer_has_a_page(name):
    text = (DOCS / 'observers' / f'{name}.md').read_text()
    if name not in LONGER:
        for part in ('## Equation', '## When not to use it', f'{{{{ parameters {name} }}}}'):
            assert part in text, part
    assert f'observers/{name}.md' in (ROOT / 'mkdocs.yml').read_text()
    assert f'(observers/{name}.md)' in (DOCS / 'choosing.md').read_text()
    pictures = re.findall(r'!\[[^\]]*\]\(([^)]+)\)', text)
    assert pictures
    for picture in pictures:
        assert (DOCS / 'observers' / picture).resolve().is_file(), picture


def test_the_tables_come_from_the_declarations():
    text = hooks().on_page_markdown('before {{ parameters pll }} after', page=None)
    gains = registry.find(registry.OBSERVERS, 'pll').gains
    for parameter in declared(gains).values():
        assert f'`{parameter.name}`' in text
        assert parameter.description in text.replace('\\|', '|')
    assert '{{' not in text


def test_the_matrix_has_a_cell_for_everything():
    lines = [line for line in (DOCS / 'choosing.md').read_text().splitlines()
             if line.startswith('| [')]
    assert len(lines) >= 12
    assert {line.count('|') for line in lines} == {11}


def test_the_site_is_built(tmp_path):
    pytest.importorskip('mkdocs', reason='not run: mkdocs is not installed')
    done = subprocess.run([sys.executable, '-m', 'mkdocs', 'build', '--strict', '--quiet',
                           '--config-file', str(ROOT / 'mkdocs.yml'), '--site-dir',
                           str(tmp_path / 'site')], capture_output=True, text=True, cwd=tmp_path,
                          timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    page = (tmp_path / 'site' / 'observers' / 'pll' / 'index.html').read_text()
    assert 'bandwidth_hz' in page and '{{ parameters' not in page
    for name in observers():
        page = (tmp_path / 'site' / 'observers' / name / 'index.html').read_text()
        for parameter in declared(registry.find(registry.OBSERVERS, name).gains):
            assert f'<code>{parameter}</code>' in page, (name, parameter)


def test_the_plotjuggler_layout():
    root = ElementTree.parse(LAYOUTS / 'plotjuggler.xml').getroot()
    assert root.tag == 'root' and root.find('tabbed_widget/Tab/Container') is not None
    splitter = root.find('.//DockSplitter')
    assert int(splitter.get('count')) == len(splitter.findall('DockArea'))
    assert len(splitter.get('sizes').split(';')) == int(splitter.get('count'))
    for curve in root.iter('curve'):
        topic, joint, field = curve.get('name').rsplit('/', 2)
        assert topic in TOPICS and joint == 'wheel' and field in ('position', 'velocity')


def test_the_foxglove_layout():
    layout = json.loads((LAYOUTS / 'foxglove.json').read_text())
    panels = set()

    def walk(node):
        if isinstance(node, str):
            panels.add(node)
        else:
            assert node['direction'] in ('row', 'column')
            walk(node['first'])
            walk(node['second'])

    walk(layout['layout'])
    assert panels == set(layout['configById'])
    for config in layout['configById'].values():
        for path in config.get('paths', []):
            assert re.sub(r'\.(position|velocity)\[0\]$', '', path['value']) in TOPICS
        if 'topicToRender' in config:
            assert config['topicToRender'] in TOPICS
