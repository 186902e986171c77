# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Additions to the pages when the site is built (mkdocs hook).

``{{ parameters NAME }}`` becomes the table of an observer's declared parameters. A block of LaTeX
after three backquotes and ``math`` (which GitHub typesets by itself) becomes MathML, so a browser
needs neither a script nor a network for it.
"""

import re

from estimator_pkg import registry
from estimator_pkg.evaluation.text import markdown
from estimator_pkg.listing import default_text
from estimator_pkg.parameters import declared

PLACE = re.compile(r'\{\{ parameters (\w+) \}\}')
MATHEMATICS = re.compile(r'^```math\n(.*?)\n```$', re.DOTALL | re.MULTILINE)


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


def typeset(latex):
    """Return a displayed formula as HTML."""
    from latex2mathml.converter import convert

    return f'<div class="mathematics">{convert(latex, display="block")}</div>'


def on_page_markdown(markdown, page=None, **_):
    """Return a page's text with tables and formulas; mkdocs calls this for each page."""
    folder, _, name = page.file.src_uri.removesuffix('.md').partition('/') if page else ('', '', '')
    if folder == 'observers' and not PLACE.search(markdown):
        markdown += f'\n\n## Parameters\n\n{{{{ parameters {name} }}}}\n'
    markdown = MATHEMATICS.sub(lambda found: typeset(found.group(1)), markdown)
    return PLACE.sub(lambda found: parameter_table(found.group(1)), markdown)
