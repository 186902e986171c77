# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The page of evaluate --html: its content, its size, and that it works in a browser offline."""

import base64
import html
import json
import math
import re
import shlex
from pathlib import Path
from types import SimpleNamespace

import browser
import numpy as np
import pytest
from joint_bags import write_bag

from estimator_pkg import params_file
from estimator_pkg.bags.series import of_positions
from estimator_pkg.cli import main
from estimator_pkg.evaluation import plots
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.ranking.verdict import Verdict
from estimator_pkg.evaluation.report import findings
from estimator_pkg.evaluation.report.page import choice, ordered, parameter_file, use

BAGS = Path(__file__).resolve().parents[3] / 'bags'
PENDULUM = BAGS / 'dfki_simple_pendulum' / 'gravity_compensation_1000hz'
FAULTS = BAGS / 'simulated' / 'random_with_faults'
TURN = 2.0 * math.pi


@pytest.fixture(scope='module')
def page(tmp_path_factory):
    """A page of two bags: path, result."""
    path = tmp_path_factory.mktemp('report') / 'page.html'
    words = shlex.split('--observer hybrid_angle --observer finite_difference --from 0.5')
    words += ['--data', str(path.with_name('numbers.npz')), '--html', str(path)]
    result = path.with_name('result.json')
    assert main(['evaluate', str(PENDULUM), str(FAULTS), *words, '--json', str(result)]) == 0
    return path, json.loads(result.read_text())


@pytest.mark.long
def test_the_page_is_small_and_stands_alone(page):
    path, _ = page
    text = path.read_text()
    assert path.stat().st_size < 5e6
    assert '<script src' not in text and '<link rel' not in text
    assert not re.search(r'@import|url\(\s*["\']?http', text)
    assert 'name="viewport" content="width=device-width' in text  # phones
    assert 'truth of pendulum against the measured position: lag ' in text


@pytest.mark.long
def test_many_bags_begin_with_one_table_and_findings_say_what_to_do(page):
    path, result = page
    first = path.read_text().partition('<h2')[0]
    for place, (bag, found) in enumerate(result['bags'].items(), 1):
        assert f'<a href="#bag_{place}">{Path(bag).name}</a>' in first
        for estimate in found['estimates'].values():
            for joint in estimate['joints'].values():
                assert f'{joint["velocity"]["rms"]:.4f}' in first
    assert first.count('<b>') >= 1
    said = '\n'.join(result['bags'][str(FAULTS)]['findings'])
    assert '3 holes, the longest 304 ms, at 4.38 s' in said
    assert '28 of 2524 samples dropped' in said and '4096 per turn' in said


@pytest.mark.long
def test_every_compared_sample_is_in_the_data(page):
    path, result = page
    assert 'in numbers.npz (numpy.load)' in path.read_text()
    data = np.load(path.with_name('numbers.npz'))
    found = result['bags'][str(FAULTS)]['estimates']['hybrid_angle']['joints']['wheel']
    base = f'{str(FAULTS).strip("/")}/wheel/hybrid_angle'
    assert len(data[f'{base}/velocity']) == found['matched']['compared']
    error = data[f'{base}/velocity'] - data[f'{base}/reference']
    assert np.sqrt(np.mean(error**2)) == pytest.approx(found['velocity']['rms'])


# ---------------------------------------------------------------- in a browser without network


@pytest.fixture(scope='module')
def driver():
    driver = browser.start()
    yield driver
    driver.quit()


PANEL = """[...Bokeh.documents[0].all_models].filter(
    each => each.type === 'Figure' && each.title.text.startsWith(arguments[0]))[0]"""
SHADOWS = """(() => { const found = [];
    const look = root => { for (const each of root.querySelectorAll('*')) {
        if (each.classList.contains('%s')) found.push(each);
        if (each.shadowRoot) look(each.shadowRoot); } };
    look(document); return found%s })()"""


def of_panel(driver, title, what):
    return driver.execute_script(f'const panel = {PANEL}; return {what}', title)


def place(driver, title):
    """Scroll to a panel; return the middle of its frame in the window."""
    return driver.execute_script(
        f"""const view = Bokeh.index.find_one_by_id(({PANEL}).id);
        view.el.scrollIntoView({{block: 'center'}});
        const box = view.el.getBoundingClientRect();
        return [box.left + view.frame.bbox.left + view.frame.bbox.width / 2,
                box.top + view.frame.bbox.top + view.frame.bbox.height / 2].map(Math.round)""",
        title,
    )


@pytest.mark.page
def test_on_a_wide_screen(page, driver):
    """Panels, tools, the values at the pointer, the legend, paper."""
    from selenium.webdriver.common.action_chains import ActionChains

    browser.on_screen(driver, page[0], 1280)
    assert [line for line in driver.get_log('browser') if line['level'] == 'SEVERE'] == []
    assert browser.asked_for(driver) == set()
    for title in ('measured position', 'velocity', 'error and 95 % interval', 'status'):
        assert of_panel(driver, title, 'panel.inner_width') > 900
    tools = of_panel(driver, 'velocity', 'panel.toolbar.tools.map(x => x.type)')
    assert {f'{tool}Tool' for tool in ('Pan', 'BoxZoom', 'WheelZoom', 'Reset', 'Save')} < {*tools}
    shared = {of_panel(driver, title, 'panel.x_range.id') for title in ('velocity', 'status')}
    assert len(shared) == 1  # a drag zooms all panels, and the vertical axis follows
    assert of_panel(driver, 'velocity', 'panel.window_axis') == 'x'
    width = (
        'return [...document.querySelectorAll(".scroll")].map(x => x.scrollWidth - x.clientWidth)'
    )
    assert set(driver.execute_script(width)) == {0}  # no table is cut

    x, y = place(driver, 'velocity')
    mouse = ActionChains(driver)
    mouse.w3c_actions.pointer_action.move_to_location(x - 30, y)
    mouse.w3c_actions.pointer_action.move_to_location(x, y)
    mouse.perform()
    texts = '.map(x => x.shadowRoot.textContent).find(text => text.includes("time"))'
    tip = browser.until(driver, SHADOWS % ('bk-Tooltip', texts))
    number = r'-?\d[\d.e+-]*'
    for name in ('hybrid_angle', 'finite_difference'):
        shown = rf'{name}:\s*{number} rad/s, error {number}, ± {number}, tracking'
        assert re.search(shown, tip), tip
    assert re.search(rf'reference:\s*{number} rad/s', tip)

    buttons = driver.find_elements('css selector', '.legend button')
    assert len(buttons) == 2
    name = buttons[1].get_attribute('data-s')
    lines = f"""return [...Bokeh.documents[0].all_models]
        .filter(each => each.type === 'GlyphRenderer' && each.name === '{name}')
        .map(each => each.visible)"""
    assert len(driver.execute_script(lines)) >= 8  # of two bags
    for seen in ('false', 'true'):
        driver.execute_script('arguments[0].click()', buttons[1])
        assert {str(each).lower() for each in driver.execute_script(lines)} == {seen}
        assert buttons[1].get_attribute('aria-pressed') == seen

    paper = driver.execute_cdp_cmd('Page.printToPDF', {'preferCSSPageSize': True})
    text = base64.b64decode(paper['data'])
    across = driver.execute_script('return document.documentElement.scrollWidth')
    points = float(re.search(rb'/MediaBox ?\[0 0 ([\d.]+)', text)[1])
    assert points / 0.75 >= across - 60  # points of paper are 3/4 of a pixel
    pictures = driver.execute_script('return document.querySelectorAll(".plot").length')
    assert text.count(b'/Subtype /Image') + text.count(b'/Subtype/Image') >= pictures


RIGHT = """return Math.max(...[...document.querySelectorAll(arguments[0])]
    .map(each => each.getBoundingClientRect().right))"""
LINES = """return [...document.querySelectorAll('.scroll td.text')].map(each => {
    const range = document.createRange();
    range.selectNodeContents([...each.childNodes].filter(x => x.nodeType === 3).at(-1) ?? each);
    return range.getClientRects().length; })"""


@pytest.mark.page
def test_on_a_phone(page, driver):
    """It fits, a swipe over a plot scrolls until a tool is tapped, and it may be dark."""

    def touch(kind, *points):
        points = [{'x': x, 'y': y} for x, y in points]
        what = {'type': f'touch{kind}', 'touchPoints': points}
        driver.execute_cdp_cmd('Input.dispatchTouchEvent', what)

    driver.execute_cdp_cmd('Emulation.setTouchEmulationEnabled', {'enabled': True})
    try:
        browser.on_screen(driver, page[0], 400)
        assert driver.execute_script('return document.documentElement.scrollWidth') <= 400
        assert driver.execute_script(RIGHT, '.scroll td:nth-child(2)') <= 400  # the first number
        assert set(driver.execute_script(LINES)[-2:]) == {1}  # usual names are whole
        x, y = place(driver, 'velocity')
        before = driver.execute_script('return scrollY')
        touch('Start', (x, y))
        for up in range(10, 130, 10):
            touch('Move', (x, y - up))
        touch('End')
        browser.until(driver, f'scrollY > {before} + 50')
        zoom = 'panel.toolbar.tools.find(each => each.type === "BoxZoomTool").active'
        assert not of_panel(driver, 'velocity', zoom)
        icons = SHADOWS % ('bk-tool-icon-box-zoom', '.at(-1)')  # of the last joint
        browser.until(driver, f"({icons}.scrollIntoView({{block: 'center'}}), true)")
        box = browser.until(driver, f'{icons}.getBoundingClientRect()')
        touch('Start', (box['left'] + 5, box['top'] + 5))
        touch('End')
        of_any = 'Bokeh.documents[0].all_models].some(x => x.type === "BoxZoomTool" && x.active)'
        browser.until(driver, f'[...{of_any}')
        dark = 'return getComputedStyle(document.querySelector(".plot")).filter.includes("invert")'
        assert not driver.execute_script(dark)
        browser.prefer(driver, 'dark')
        assert driver.execute_script(dark)
    finally:
        driver.execute_cdp_cmd('Emulation.setTouchEmulationEnabled', {'enabled': False})


LONG = 'a_joint_of_a_robot_with_a_long_name_' * 4
HOSTILE = "</script><img src=x onerror=document.title='hit'>$$x$$ @time '\\"


@pytest.mark.page
def test_names_break_nothing_and_are_text(driver, tmp_path):
    stamps = [10**9 + 4 * 10**6 * k for k in range(1000)]
    moved = [math.sin(4e-3 * k) for k in range(1000)]
    rows = [(t, [LONG, HOSTILE], (q, q), (q, q)) for t, q in zip(stamps, moved)]
    bag = write_bag(tmp_path / LONG[:100], {'/joint_states': rows, f'/{LONG}/estimate': rows})
    path = tmp_path / 'page.html'
    assert main(['evaluate', bag, '--html', str(path)]) == 0
    browser.on_screen(driver, path, 400)
    assert driver.execute_script('return document.documentElement.scrollWidth') <= 400
    for part in ('.legend button', '.verdict', '.plot', 'h2', 'h3', 'td:nth-child(2)'):
        assert driver.execute_script(RIGHT, part) <= 400, part
    assert driver.title == 'Velocity estimates'
    assert not driver.find_elements('css selector', 'img')
    assert HOSTILE in driver.execute_script('return document.body.textContent')
    assert browser.asked_for(driver) == set()


# ---------------------------------------------------------------- no truth


def report(tmp_path, *words):
    """(text of the page, what is said of each bag)."""
    page, result = tmp_path / 'page.html', tmp_path / 'result.json'
    assert main(['evaluate', *words, '--html', str(page), '--json', str(result)]) == 0
    return page.read_text(), json.loads(result.read_text())['bags']


@pytest.mark.long
def test_without_truth_the_page_has_the_verdict(tmp_path):
    """The pendulum chatters by less than a count: the better observer is known, with a caution."""
    page, found = report(
        tmp_path,
        str(PENDULUM),
        *shlex.split('--reference smoother --observer hybrid_angle --observer pll'),
    )
    verdict = found[str(PENDULUM)]['verdict']['pendulum']
    assert verdict['best'] == 'hybrid_angle' and verdict['pairs'][0]['sign'] == 1
    assert any('taken for tones of the counts' in each for each in verdict['cautions'])
    for sentence in verdict['sentences']:
        assert sentence.rstrip('.') in html.unescape(page)
    assert page.count('<tr class="best">') == 1 and '<table' not in page.partition('<h2')[0]


def test_a_bag_without_any_comparison_has_a_page_and_a_plot(tmp_path):
    stamps = [10**9 + 4 * 10**6 * k for k in range(5)]
    bag = write_bag(tmp_path / 'bag', {'/joint_states': [(t, ['j'], (0.5,), ()) for t in stamps]})
    plot = tmp_path / 'plot.png'
    page, found = report(tmp_path, bag, '--plot', str(plot))
    assert not found[bag]['estimates'] and plot.stat().st_size
    assert 'Use edge_adaptive as it is.' in page and 'class="legend"' not in page


@pytest.mark.parametrize(
    ('option', 'name', 'said'),
    [('--html', 'no/p.svg', 'does not exist'), ('--plot', 'p.svg', 'is a folder')],
)
def test_no_folder_is_one_line(option, name, said, tmp_path, capsys):
    (tmp_path / 'p.svg').mkdir()
    words = ['evaluate', str(FAULTS), '--observer', 'pll', option, str(tmp_path / name)]
    assert main(words) == 1
    printed, reported = capsys.readouterr()
    assert said in reported and reported.count('\n') == 1 and not printed


@pytest.mark.parametrize(
    'jump, said', [(0.0, ''), (3.0, 'j: 1 jump that no joint can make, up to 3')]
)
def test_the_findings_on_the_readings_are_those_of_doctor(jump, said):
    angle = np.sin(3e-3 * np.arange(4000))
    angle[2000:] += jump
    stamps = 10**9 + 10**6 * np.arange(4000)
    nothing = SimpleNamespace(rows=[], refused={}, notes=())
    seen = findings.look(of_positions(stamps, (angle + math.pi) % TURN - math.pi), 10**9, TURN)
    found = ' '.join(findings.of_joint(nothing, 'j', seen))
    assert found.startswith(said) and bool(found) == bool(said)


# ---------------------------------------------------------------- what is drawn


def test_outliers_do_not_crush_the_picture():
    line = np.sin(np.linspace(0.0, 20.0, 5000))
    assert plots.limits([line]) is None
    low, high = plots.limits([line, np.where(np.arange(5000) == 77, 500.0, line)])
    assert -5.0 < low <= -1.0 and 1.0 <= high < 5.0
    assert plots.limits([np.full(10, np.nan)]) is None


def curve(name, time, values, kind='line'):
    return plots.Curve(name, '@', time, values, {}, name, kind)


def test_a_long_record_keeps_each_extreme_and_its_instants_are_of_all_curves():
    time = np.arange(600_000) * 1e-3
    a, b = np.sin(time), np.cos(time)
    a[31_415], b[577_777] = 5.0, -3.0
    kept = (time < 100.0) | (time > 101.0)
    curves = [curve('a', time[kept], a[kept]), curve('b', time, b)]
    times, note = plots.instants(curves, 20_000)
    assert len(times) <= 20_010 and f'{len(times)} of 600000 instants' in note
    first, second = (each.at(times) for each in curves)
    assert np.nanmax(first) == 5.0 and np.nanmin(second) == -3.0
    assert np.array_equal(np.isnan(first), (times >= 100.0) & (times <= 101.0))
    assert np.isnan(first).any() and np.isfinite(second).all()
    at = np.rint(times[np.isfinite(first)] * 1e3).astype(int)
    assert np.allclose(first[np.isfinite(first)], a[at], atol=1e-3)
    assert plots.instants([curve('a', time[:20_000], a[:20_000])], 20_000)[1] == ''


def test_a_band_ends_where_a_gap_begins():
    from bokeh.models import ColumnDataSource

    time = np.array([0.0, 0.01, 0.02, 1.0, 1.01, 1.02])
    curves = [curve('a', time, np.ones(6)), curve('a', time, 5.0 * np.ones(6), 'band')]
    plot, _ = plots.over_time({'error': curves}, 1000)
    (data,) = {each.id: each.data for each in plot.select({'type': ColumnDataSource})}.values()
    line, band = (data[name] for name in list(data)[-2:])
    hole = (data['time'] > 0.02) & (data['time'] < 1.0)
    assert np.isclose(data['time'][hole], [0.021, 0.999], atol=1e-3).all()
    assert np.isnan(line[hole]).all() and np.array_equal(band, np.where(hole, 0.0, 5.0))


def test_a_status_lasts_until_the_next():
    steps = curve('a', np.array([1.0, 2.0, 3.0]), np.array([0, 1, 2], np.int8), 'step')
    assert steps.at(np.array([0.5, 1.0, 1.9, 2.0, 9.0])).tolist()[1:] == [0.0, 0.0, 1.0, 2.0]
    assert math.isnan(steps.at(np.array([0.5]))[0])


# ---------------------------------------------------------------- the first screen


def row(source, error, late, coverage=0.95, joint='j'):
    """An estimate that is `late` seconds late and noisy by `error`."""
    time = np.arange(4000) * 1e-3
    random = np.random.default_rng(len(source))
    estimate = np.sin(3.0 * (time - late)) + error * random.standard_normal(4000)
    truth = np.sin(3.0 * time)
    rms = float(np.sqrt(np.mean((estimate - truth) ** 2)))
    return SimpleNamespace(
        source=source,
        joint=joint,
        time=time,
        truth=truth,
        estimate=estimate,
        velocity={'rms': rms, 'delay_s': late, 'delay_95_s': 1e-4, 'noise': error},
        coverage=coverage,
        reference_cannot_tell=False,
    )


def test_the_verdict_in_words():
    best, raw = row('edge_adaptive', 0.02, 0.0006, 0.94), row('finite_difference', 0.12, 0.0032)
    comparison = SimpleNamespace(bag='a/b', verdicts={}, raw={'j': raw})
    assert use({'j': best}, comparison, {}) == [
        'Use edge_adaptive as it is. Its error is 0.02 rad/s rms, that of finite_difference 0.12.'
    ]
    verdict = Verdict('pll', 'kalman', (), {'pll': 0.1, 'edge_adaptive': 0.2})
    rows = ordered([best, row('pll', 0.2, 0.0)], verdict)
    assert [each.source for each in rows] == ['pll', 'edge_adaptive']
    assert choice(rows, verdict).source == 'pll'
    assert choice(rows[::-1], None) is best


@pytest.mark.parametrize('error, source', [(0.98, 'edge_adaptive'), (0.95, 'pll')])
def test_against_the_truth_too_the_default_stays_only_if_it_is_as_good(error, source):
    rows = [row('edge_adaptive', 0.02, 0.0), row('pll', 0.02, 0.0)]
    rows[1].estimate = rows[1].truth + error * (rows[0].estimate - rows[0].truth)
    rows[1].velocity['rms'] *= error
    assert choice(rows, None).source == 'pll'  # the same errors, all smaller
    rows[1].time = rows[1].time + 1e-5  # no common samples: the pair is not known
    assert choice(rows, None).source == source


def test_the_parameter_file_is_one_that_the_node_loads(tmp_path):
    entries = {'pll': Entry('pll', 'pll', (('bandwidth_hz', 30.0),))}
    comparison = SimpleNamespace(bag='a/b', verdicts={})
    best = {'j': row('pll', 0.1, 0.0)}
    text = parameter_file(comparison, best, entries, {'j': TURN / 4096}, TURN)
    path = tmp_path / 'params.yaml'
    path.write_text(text)
    values = params_file.load(path)
    assert values['observer'] == 'pll' and values['bandwidth_hz'] == 30.0
    assert values['quantum'] == pytest.approx(TURN / 4096, rel=1e-3)


def test_findings_that_are_equal_but_for_the_joint_are_one_sentence():
    assert findings.grouped(['a: x', 'b: x', 'c: y'], 'ab') == ['all 2 joints: x', 'c: y']
