# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The documentation: a page for every observer, and tables from the declarations."""

import argparse
import importlib.util
import json
import re
import shlex
import subprocess
import sys
import time
from importlib.metadata import entry_points
from pathlib import Path

import browser
import pytest

from docs.tools import capabilities
from estimator_pkg import registry
from estimator_pkg.errors import UserError
from estimator_pkg.messages import drive_samples
from estimator_pkg.parameters import declared

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / 'docs'


def observers():
    found = []
    for name in registry.names(registry.OBSERVERS):
        try:
            registry.find(registry.OBSERVERS, name)
        except UserError:
            continue
        found.append(name)
    return found


@pytest.mark.parametrize('name', observers())
def test_every_observer_has_a_page(name):
    text = (DOCS / 'observers' / f'{name}.md').read_text()
    for part in ('## Equation', '## When not to use it', f'{{{{ parameters {name} }}}}'):
        assert part in text, part
    assert f'(observers/{name}.md)' in (DOCS / 'choosing.md').read_text()
    pictures = re.findall(r'!\[[^\]]*\]\(([^)]+)\)', text)
    assert pictures
    for picture in pictures:
        assert (DOCS / 'observers' / picture).resolve().is_file(), picture


@pytest.mark.slow
def test_cost_and_delay_can_be_measured(capsys):
    capabilities.main([])
    rows = [line for line in capsys.readouterr().out.splitlines() if line.startswith('| ')]
    assert len(rows) == 1 + len(registry.names(registry.OBSERVERS))


# ---------------------------------------------------------------- links, pictures, commands


def pages():
    return [
        *(ROOT / each / 'README.md' for each in ('', 'bags', 'test')),
        *sorted(DOCS.glob('**/*.md')),
    ]


def prose(path):
    """The text of a page without its code."""
    text = re.sub(r'```.*?```', '', path.read_text(), flags=re.DOTALL)
    return re.sub(r'`[^`\n]*`', '', re.sub(r'(?m)^ {4}.*$', '', text))


def anchors(path):
    """What can be linked to on a page."""
    heads = re.findall(r'(?m)^#+ +(.*)$', path.read_text())
    return {re.sub(r'[ -]+', '-', re.sub(r'[^\w\- ]', '', head.lower()).strip()) for head in heads}


@pytest.mark.parametrize(
    'name', ['README', 'CONTRIBUTING', 'QUALITY_DECLARATION', 'bags/README', 'test/README']
)
def test_links_and_pictures_lead_somewhere(name):
    """Of the pages outside the site, whose own links its strict build checks."""
    page = ROOT / f'{name}.md'
    for target in re.findall(r'\]\(([^)\s]+)\)', prose(page)):
        if re.match(r'https?://|mailto:', target):
            continue
        path, _, anchor = target.partition('#')
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), f'{target} in {page.name}'
        assert there.is_relative_to(ROOT), target
        if anchor:
            assert anchor in anchors(there), f'{target} in {page.name}'


def test_the_code_for_drive_samples_makes_what_the_node_reads():
    pytest.importorskip('std_msgs', reason='not run: std_msgs is not installed')
    from rclpy.serialization import serialize_message

    [code] = re.findall(r'```python\n(.*?)```', (DOCS / 'first_drive.md').read_text(), re.DOTALL)
    exec(code, found := {})
    rows = [(1_700_000_000 + k, 5, 1.0, -2.0, 3.0, k) for k in range(3)]
    batch = drive_samples.decode(serialize_message(found['drive_samples'](rows)))
    assert batch.stamps_ns.tolist() == [(1_700_000_000 + k) * 10**9 + 5 for k in range(3)]
    assert batch.values.tolist() == [list(row[2:]) for row in rows]


@pytest.mark.long
def test_the_page_of_topics_is_what_the_nodes_have():
    pytest.importorskip('rclpy', reason='not run: rclpy is not installed')
    code = f'import sys; sys.path.append({str(ROOT)!r}); from docs.tools import topics; '
    done = subprocess.run(
        [sys.executable, '-c', code + 'topics.main()'],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == (DOCS / 'topics.md').read_text(), 'python -m docs.tools.topics'


def commands():
    """(page, words) of every line of code that calls our command line."""
    found = []
    for page in pages():
        text = page.read_text().replace('\\\n', ' ')
        for line in re.findall(r'(?m)^(?: {4})?(velocity_estimator .*)$', text):
            found.append((page.name, shlex.split(line, comments=True)[1:]))
    return found


@pytest.mark.parametrize(('page', 'words'), commands(), ids=lambda each: str(each)[:60])
def test_commands_in_the_documentation_are_understood(page, words):
    command = registry.find(registry.COMMANDS, words[0])
    parser = argparse.ArgumentParser()
    command.arguments(parser)
    parser.add_argument('--json')
    parsed = parser.parse_args(words[1:])  # ends the test where an option is unknown
    for name in getattr(parsed, 'observer', None) or []:
        names = [name] if len(name) > 1 else [parsed.observer]
        assert all(each in {*registry.names(registry.OBSERVERS), 'all'} for each in names)
    bag = getattr(parsed, 'bag', None) or (getattr(parsed, 'bags', None) or [''])[0]
    if bag.startswith('bags/'):
        assert (ROOT / bag).exists()


def test_modules_and_nodes_in_the_documentation_exist():
    text = ''.join(page.read_text() for page in pages())
    for module in set(re.findall(r'python -m ([\w.]+)', text)):
        assert importlib.util.find_spec(module) is not None, module
    for script in set(re.findall(r'python ((?:test|bags)/[\w/]+\.py)', text)):
        assert (ROOT / script).is_file(), script
    scripts = {point.name for point in entry_points(group='console_scripts')}
    for node in set(re.findall(r'ros2 run velocity_estimator (\w+)', text)):
        assert node in scripts, node
    for launch in set(re.findall(r'ros2 launch velocity_estimator (\S+\.py)', text)):
        assert (ROOT / 'launch' / launch).is_file(), launch


@pytest.fixture(scope='module')
def site(tmp_path_factory):
    """The folder of the built site."""
    pytest.importorskip('mkdocs', reason='not run: mkdocs is not installed')
    folder = tmp_path_factory.mktemp('docs') / 'site'
    done = subprocess.run(
        [
            sys.executable,
            *shlex.split('-m mkdocs build --strict --quiet'),
            '--config-file',
            str(ROOT / 'mkdocs.yml'),
            '--site-dir',
            str(folder),
        ],
        capture_output=True,
        text=True,
        cwd=folder.parent,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.long
def test_the_site_is_built(site):
    page = (site / 'observers' / 'pll.html').read_text()
    assert 'bandwidth_hz' in page and '{{ parameters' not in page
    assert '<math ' in page and '<script>window.MathJax' not in page
    for name in observers():
        page = (site / 'observers' / f'{name}.html').read_text()
        formulas = ' '.join(re.findall('<math .*?</math>', page, re.DOTALL))
        assert '\\' not in formulas and '<mi>&<' not in formulas, name  # LaTeX that was not known
        assert '```' not in page, name
        for parameter in declared(registry.find(registry.OBSERVERS, name).gains):
            assert f'<code>{parameter}</code>' in page, (name, parameter)


@pytest.mark.page
@pytest.mark.long
def test_links_search_and_formulas_work_from_files(site):
    driver = browser.start()
    try:
        driver.get(f'file://{site}/index.html')
        link = driver.find_element('css selector', 'article a[href^="choosing"]')
        driver.get(link.get_attribute('href'))
        assert driver.title.startswith('Which observer?')

        driver.find_element('css selector', 'label.md-header__button[for=__search]')
        driver.execute_script("document.querySelector('#__search').click()")
        words = driver.find_element('css selector', '[data-md-component=search-query]')
        until(words.is_displayed)
        words.send_keys('encoder counts')
        until(lambda: results(driver)[:1] == [f'file://{site}/troubleshooting.html'], 30.0)

        # the subscripts of f_k: below their base, as a font with a table of mathematics places them
        driver.get(f'file://{site}/observers/finite_difference.html')
        lowered = driver.execute_script(
            """const box = each => each.getBoundingClientRect();
            return [...document.querySelectorAll('msub')].map(each => {
              const [base, index] = each.children;
              return box(index).bottom > box(base).bottom + 1; });"""
        )
        assert lowered and all(lowered)
        for entry in driver.get_log('performance'):
            message = json.loads(entry['message'])['message']
            if message['method'] == 'Network.requestWillBeSent':
                url = message['params']['request']['url']
                assert url.startswith(('file://', 'data:', 'about:')), url
        assert not [e for e in driver.get_log('browser') if e['level'] == 'SEVERE']
    finally:
        driver.quit()


def results(driver):
    """The pages that the search shows."""
    return driver.execute_script(
        "return [...document.querySelectorAll('.md-search-result__link')]"
        '.map(each => each.href.split(/[?#]/)[0])'
    )


def until(true, seconds=10.0):
    """Wait until the result of a call is true, and return it."""
    end = time.monotonic() + seconds
    while not (result := true()):
        assert time.monotonic() < end
        time.sleep(0.05)
    return result
