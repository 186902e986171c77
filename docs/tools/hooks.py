# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Additions to the pages when the site is built (mkdocs hook).

``{{ parameters NAME }}`` becomes the table of an observer's declared parameters, and
``{{ changelog }}`` the text of CHANGELOG.rst. A block of LaTeX
after three backquotes and ``math``, and LaTeX between ``$`` and backquotes within a line (GitHub
typesets both by itself), become MathML, so a browser needs neither a script nor a network for it.
Powers and indices in the text, as in q^2/12 and P_00, are raised and lowered.
"""

import re
from pathlib import Path

from estimator_pkg import registry
from estimator_pkg.evaluation.text import markdown
from estimator_pkg.listing import default_text
from estimator_pkg.parameters import declared

CHANGELOG = Path(__file__).resolve().parents[2] / 'CHANGELOG.rst'
PLACE = re.compile(r'\{\{ parameters (\w+) \}\}')
MATHEMATICS = re.compile(r'^```math\n(.*?)\n```$', re.DOTALL | re.MULTILINE)
INLINE = re.compile(r'\$`([^`]+)`\$')
# Searches find pages for users first, however often these have the word.
LAST = re.compile('papers/|parameters/simulators|evidence|theory|architecture|engine|language')
KEPT = re.compile(  # code, formulas, tags and links
    r'^```.*?^```$|^(?: {4}|\t).*?$|`[^`\n]+`|<math.*?</math>|<[^>\n]+>|\]\([^)\n]*\)|https?://\S+',
    re.DOTALL | re.MULTILINE,
)
POWER = re.compile(r"(?<=[\w)\]'])\^(?:\(((?:[^()\s]|\([^()]*\))+)\)|(-?\w+))")
INDEX = re.compile(r'(?<![\w/.])([A-Za-z\u0370-\u03ff])_([a-z]{1,3}|\d{1,2})(?![\w/])')
PROSE = re.compile(
    r'<table>(?=\s*<thead>(?:(?!</thead>).)*<th[^>]*>(?:meaning|content)</th>\s*</tr>)', re.DOTALL
)
OPERATOR = re.compile(r'<mo>([A-Za-z]{2,})</mo>(<mo stretchy="false">&#x00028;</mo>)?')


def parameter_table(name):
    """Return the Markdown table of an observer's parameters."""
    gains = registry.find(registry.OBSERVERS, name).gains
    return markdown(
        ('name', 'default', 'unit', 'range', 'meaning'),
        [
            (f'`{each.name}`', default_text(each), each.unit, each.range_text(), each.description)
            for each in declared(gains).values()
        ],
    )


def changelog():
    """Return CHANGELOG.rst, without its title, as Markdown."""
    text = CHANGELOG.read_text().partition('=\n\n')[2]
    text = re.sub(r'(?m)^(.+)\n-{3,}$', r'## \1', text)
    return re.sub(r'`([^`<]+) <([^>]+)>`_', r'[\1](\2)', text).replace('``', '`')


def typeset(latex, display='block'):
    """Return a formula as MathML; `display` is 'block' or 'inline'."""
    from latex2mathml.converter import convert

    # the converter knows as fences only what is between \left and \right, and spaces no tag
    latex = re.sub(r'(?<!\\left)\\lvert\b', r'\\left|', latex)
    latex = re.sub(r'(?<!\\right)\\rvert\b', r'\\right|', latex)
    latex = re.sub(r'\\tag\{(\w+)\}', r'\\qquad (\1)', latex)
    formula = convert(latex, display=display).replace('<mover>', '<mover accent="true">')
    return OPERATOR.sub(_operator, formula)


def _operator(found):
    """Return a named operator with the space around it: none before a bracket."""
    name, bracket = found.groups()
    after = '0' if bracket else '0.167em'
    return f'<mo form="prefix" lspace="0.167em" rspace="{after}">{name}</mo>{bracket or ""}'


def raised(text):
    """Return text with powers and indices as HTML; code, formulas and links are kept."""
    parts, end = [], 0
    for kept in [*KEPT.finditer(text), None]:
        plain = text[end : kept.start() if kept else len(text)]
        plain = POWER.sub(lambda found: f'<sup>{found[1] or found[2]}</sup>', plain)
        parts.append(INDEX.sub(r'\1<sub>\2</sub>', plain))
        if kept:
            parts.append(kept[0])
            end = kept.end()
    return ''.join(parts)


def on_page_markdown(markdown, page=None, **_):
    """Return a page's text with tables and formulas; mkdocs calls this for each page."""
    if page and LAST.search(page.file.src_path):
        page.meta.setdefault('search', {'boost': 0.1})
    markdown = markdown.replace('{{ changelog }}', changelog())
    markdown = MATHEMATICS.sub(
        lambda found: f'<div class="mathematics">{typeset(found.group(1))}</div>', markdown
    )
    # a tag of mathematics at the beginning of a line would be a paragraph of its own
    markdown = INLINE.sub(
        lambda found: f'<span>{typeset(found.group(1), "inline")}</span>', markdown
    )
    return raised(PLACE.sub(lambda found: parameter_table(found.group(1)), markdown))


def on_page_content(html, **_):
    """Return a page's HTML; tables that end in sentences are marked for site.css, for phones."""
    return PROSE.sub('<table data-prose>', html)
