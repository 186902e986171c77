# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The numbers of the pages are those that the commands give (docs/tools/figures.yaml)."""

from pathlib import Path

import pytest

from docs.tools import figures

ROOT = Path(__file__).resolve().parents[1]
LONG = (pytest.mark.slow, pytest.mark.timeout(7200))
ENTRIES = [
    pytest.param(entry, marks=LONG if entry.get('slow') else (), id=f'{entry["page"]}-{number}')
    for number, entry in enumerate(figures.entries())
]


@pytest.mark.long
@pytest.mark.parametrize('entry', ENTRIES)
def test_a_page_prints_what_its_command_gives(entry):
    page = (ROOT / entry['page']).read_text()
    assert figures.filled(page, entry)[1] == [], 'make figures writes them'


def test_a_wrong_figure_is_found_and_mended():
    entry = {'run': [], 'text': 'three is {{3.0:.2f}} and four {{4.0:.1f}}'}
    assert figures.filled('a page: three is\n3.02 and four 4.0.', entry)[1] == []
    page, differ = figures.filled('a page: three is\n3.12 and four 4.0.', entry)
    assert page == 'a page: three is\n3.00 and four 4.0.' and len(differ) == 1
    assert figures.filled('three was 3.00', entry)[1]
    lines = {'run': [], 'lines': "'| a | 1.00 | 2e-05 |\\n| b2 | 7 |'"}
    assert figures.filled('| a | 1.01 | 2e-05 |\n...\n| b2 | 7 |', lines)[1] == []
    page, differ = figures.filled('| a | 1.10 | 2e-05 |\n...\n| b2 | 7 |', lines)
    assert page == '| a | 1.00 | 2e-05 |\n...\n| b2 | 7 |' and len(differ) == 1
    assert figures.filled('nothing of it', lines)[1]
    exact = {'run': [], 'text': '{{7}} rows', 'tolerance': 0.0}
    assert figures.filled('8 rows', exact)[1] and not figures.filled('7 rows', exact)[1]
