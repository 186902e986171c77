# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Lines of Python and words of documentation stay below the ceilings of ceilings.yaml.

python test/test_ceilings.py > new && mv new test/ceilings.yaml    # lowers them, raises none
"""

from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parent.parent
CEILINGS = yaml.safe_load(Path(__file__).with_name('ceilings.yaml').read_text())


def lines(paths):
    return sum(path.read_bytes().count(b'\n') for path in paths)


def counted():
    found = {name: lines((ROOT / name).rglob('*.py')) for name in ('sim_pkg', 'benchmarks')}
    for name in ('estimator_pkg', 'test'):
        found[name] = lines((ROOT / name).rglob('*.py'))
        found[f'{name}/*.py'] = lines((ROOT / name).glob('*.py'))
        for folder in {path.relative_to(ROOT).parts[1] for path in (ROOT / name).rglob('*/*.py')}:
            found[f'{name}/{folder}'] = lines((ROOT / name / folder).rglob('*.py'))
    pages = [page for page in (ROOT / 'docs').rglob('*.md') if page.parent.name != 'parameters']
    pages += [ROOT / name for name in ('README.md', 'CONTRIBUTING.md', 'CHANGELOG.rst')]
    found['docs without parameters'] = sum(len(page.read_bytes().split()) for page in pages)
    return found


def test_nothing_grows_beyond_its_ceiling():
    wrong = [
        f'{name}: {count - CEILINGS.get(name, 0)} above its ceiling'  # 0 for a folder without one
        for name, count in sorted(counted().items())
        if count > CEILINGS.get(name, 0)
    ]
    assert not wrong, '\n'.join(wrong)


if __name__ == '__main__':
    for name, count in sorted(counted().items()):
        print(f'{name}: {min(count, CEILINGS.get(name, 0))}')
