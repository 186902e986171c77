# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The pages docs/parameters/*.md: every parameter, one page a node, from the declarations.

python -m docs.tools.parameters        # writes them
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from estimator_pkg import observers, streams
from estimator_pkg.evaluation.text import markdown
from estimator_pkg.listing import Item, catalogue, default_text, meaning, settings_name
from estimator_pkg.parameters import declared
from estimator_pkg.streams.contract import Stream
from estimator_pkg.streams.mechanical import MechanicalStream

FOLDER = Path(__file__).resolve().parents[1] / 'parameters'
SET_FIRST = {  # by node: what for, what to set
    'joint_observer': {
        'an encoder of 4096 counts per turn': '`quantum: 0.001534` (2 pi / counts)',
        'a prismatic joint, or one that counts turns': '`wrap_period: 0.0`',
        'less noise; less delay': '`prefer: smooth`; `prefer: fast`',
        'some of the joints alone': "`joints: ['elbow', 'wrist']`",
        'another value for one joint': '`per_joint.elbow.prefer: fast`',
        'a driver that leaves its stamps zero': '`stamp_source: publisher`',
        'stamps that jitter, of a device that samples regularly': '`stamp_repair: regular`',
        'ros2_control or MoveIt, which need finite velocities': '`no_estimate: skip`',
        'raw counts': '`input: angle`, `angle_type: Int32`, `counts_per_revolution: 4096`',
        'a number of another message': '`input: field`, `field_type`, `field`',
        'a gyro or a second encoder as well': '`sources`, `source.<name>.topic` '
        '([page](../second_sensor.md))',
        'a linear observer with a known delay': '`observer: hybrid_angle`, `bandwidth_hz: 20.0`',
    },
    'mechanical_observer': {'a mechanism and its torque': '`model`, `model_parameters`'},
    'pmsm_observer': {
        'a motor without an encoder': '`resistance`, `inductance`, `flux`, `pole_pairs`, '
        '`speed_max`'
    },
    'adaptive_observer': {'a servo of unknown parameters': '`order`, `bandwidth_hz`'},
    'switched_observer': {'a system that switches': '`model`, `bandwidth_hz`'},
    'wheel_odometry': {
        'a base on wheels': '`wheels_left`, `wheels_right`, `radius`, `track`, `gyro_topic`'
    },
}
INTRODUCTION = """\
# Parameters

Each node has its page. The default node, `joint_observer`, needs no parameter.

{pages}

Set a parameter of a node in its parameter file (`/**` or the name of the node, then
`ros__parameters`), or with `-p name:=value`. `per_joint.<joint>.<parameter>` is for one joint.
Commands on bags take the same file with `--params`, and `--set name=value`.

- *Automatic*: the value follows from others or from the data. The value in parentheses selects this
  in a file.
- *Required*: there is no default, so set it.
- *At start only*: a running node refuses the change.

**A parameter file is code.** A value of the form `package.module:name` (of `injection` and `model`)
imports that module, in nodes and in commands. Load only files that you trust.

`ros2 param dump NODE > FILE` writes every parameter of a running node, those of single joints
included. `--params-file FILE` starts the same node again, and `replay --params FILE` reads the same
file.

`python -m docs.tools.parameters` makes these pages from the declarations in the code.
"""


def section(title: str, item: Item) -> str:
    """Return what an item is, and the table of its parameters, those that few need last."""
    source = f'\n\nFrom: {item.reference}.' if item.reference else ''
    table = markdown(
        ('name', 'default', 'unit', 'range', 'meaning'),
        [
            (f'`{p.name}`', default_text(p), p.unit, p.range_text(), meaning(p, item.live))
            for p in sorted(item.parameters, key=lambda each: each.advanced)
        ],
    )
    return f'## {title}\n\n{item.summary[0].upper()}{item.summary[1:]}.{source}\n\n{table}\n'


def sections(stream: type[Stream]) -> Iterator[str]:
    """Yield the sections of a node: its own parameters, its default observer's, then others."""
    items = {kind: {item.name: item for item in found} for kind, found in catalogue().items()}
    yield section('Node', items['nodes'][stream.NODE])
    default = declared(stream.SETTINGS).get('observer')
    running = sorted(
        observers.of_kind(stream.KIND), key=lambda name: default is None or name != default.default
    )
    for name in running:
        yield section(f'Observer {name}', items['observers'][name])
        if name == running[0]:
            of_joint = items['settings of each joint'][settings_name(stream.PER_JOINT)]
            yield section('Each joint', of_joint)
    if hasattr(stream, 'PER_SOURCE'):
        of_source = items['settings of each source'][settings_name(stream.PER_SOURCE)]
        yield section('Each source', of_source)
    if issubclass(stream, MechanicalStream):
        for name, item in items['models'].items():
            yield section(f'Model {name}', item)


def simulators() -> Iterator[str]:
    """Yield the sections of all simulators."""
    items = catalogue()
    for item in items['settings of each simulator']:
        yield section('Each simulator', item)
    for item in items['simulators']:
        yield section(f'{item.name}_sim', item)


def pages() -> dict[str, str]:
    """Return the text of each page by the name of its file."""
    found = {}
    for stream in streams.every():
        first = ''
        if stream.NODE in SET_FIRST:
            first = f'{markdown(("for", "set first"), list(SET_FIRST[stream.NODE].items()))}\n\n'
        title = f'# Parameters of {stream.NODE}\n\n[How to set them](index.md).\n\n{first}'
        found[f'{stream.NODE}.md'] = title + '\n'.join(sections(stream))
    title = '# Parameters of the simulators\n\n[How to set them](index.md).\n\n'
    found['simulators.md'] = title + '\n'.join(simulators())
    links = '\n'.join(f'- [{Path(name).stem}]({name})' for name in found)
    return {'index.md': INTRODUCTION.format(pages=links), **found}


def main() -> None:
    """Write the pages, and remove those of nodes that are gone."""
    made = pages()
    FOLDER.mkdir(exist_ok=True)
    for path in FOLDER.glob('*.md'):
        if path.name not in made:
            path.unlink()
    for name, text in made.items():
        (FOLDER / name).write_text(text, 'utf-8')


if __name__ == '__main__':
    main()
