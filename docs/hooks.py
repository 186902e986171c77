"""Fills ``{{ parameters NAME }}`` in a page with the table that the code declares (mkdocs hook)."""

import re

from estimator_pkg import registry
from estimator_pkg.evaluation.text import markdown
from estimator_pkg.listing import default_text
from estimator_pkg.parameters import declared

PLACE = re.compile(r'\{\{ parameters (\w+) \}\}')


def parameter_table(name):
    """The Markdown table of an observer's parameters."""
    gains = registry.find(registry.OBSERVERS, name).gains
    return markdown(('name', 'default', 'unit', 'range', 'meaning'), [
        (f'`{each.name}`', default_text(each), each.unit, each.range_text(), each.description)
        for each in declared(gains).values()])


def on_page_markdown(markdown, page=None, **_):
    """Called by mkdocs with the text of each page; an observer's page always has its table."""
    folder, _, name = page.file.src_uri.removesuffix('.md').partition('/') if page else ('', '', '')
    if folder == 'observers' and not PLACE.search(markdown):
        markdown += f'\n\n## Parameters\n\n{{{{ parameters {name} }}}}\n'
    return PLACE.sub(lambda found: parameter_table(found.group(1)), markdown)
