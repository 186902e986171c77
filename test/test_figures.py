"""The numbers of the pages are those that the commands give (docs/figures.yaml)."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def script():
    spec = importlib.util.spec_from_file_location('docs_figures', ROOT / 'docs' / 'figures.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


FIGURES = script()
LONG = (pytest.mark.slow, pytest.mark.timeout(7200))
ENTRIES = [pytest.param(entry, marks=LONG if entry.get('slow') else (),
                        id=f"{entry['page']}-{number}")
           for number, entry in enumerate(FIGURES.entries())]


@pytest.mark.parametrize('entry', ENTRIES)
def test_a_page_prints_what_its_command_gives(entry):
    page = (ROOT / entry['page']).read_text()
    assert FIGURES.filled(page, entry)[1] == [], 'make figures writes them'


def test_a_wrong_figure_is_found_and_mended():
    entry = {'run': [], 'text': 'three is {{3.0:.2f}} and four {{4.0:.1f}}'}
    assert FIGURES.filled('a page: three is\n3.02 and four 4.0.', entry)[1] == []
    page, differ = FIGURES.filled('a page: three is\n3.12 and four 4.0.', entry)
    assert page == 'a page: three is\n3.00 and four 4.0.' and len(differ) == 1
    assert FIGURES.filled('three was 3.00', entry)[1]
    lines = {'run': [], 'lines': "'| a | 1.00 | 2e-05 |\\n| b2 | 7 |'"}
    assert FIGURES.filled('| a | 1.01 | 2e-05 |\n...\n| b2 | 7 |', lines)[1] == []
    page, differ = FIGURES.filled('| a | 1.10 | 2e-05 |\n...\n| b2 | 7 |', lines)
    assert page == '| a | 1.00 | 2e-05 |\n...\n| b2 | 7 |' and len(differ) == 1
    assert FIGURES.filled('nothing of it', lines)[1]
    exact = {'run': [], 'text': '{{7}} rows', 'tolerance': 0.0}
    assert FIGURES.filled('8 rows', exact)[1] and not FIGURES.filled('7 rows', exact)[1]
