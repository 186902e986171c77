# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The report of `doctor`: text of 80 columns, a parameter file, and a page."""

from __future__ import annotations

import math
import textwrap
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from estimator_pkg import yaml_text
from estimator_pkg.estimate import VALID
from estimator_pkg.evaluation import parameter_file, plots
from estimator_pkg.evaluation.checks.readings import Readings, to_mend
from estimator_pkg.evaluation.checks.row import FAIL, LEVELS, PASS, WARN, Finding
from estimator_pkg.evaluation.doctor import second
from estimator_pkg.evaluation.doctor.choice import Choice, sentences
from estimator_pkg.evaluation.doctor.examine import Examined
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.plots import Curve
from estimator_pkg.evaluation.ranking.verdict import Verdict, percent
from estimator_pkg.evaluation.text import WIDTH, for_node, units
from estimator_pkg.observers import DEFAULT
from estimator_pkg.printable import printable
from estimator_pkg.streams.angle import AngleStream

NAME_COLUMNS = 19  # columns of a check's name
ALL_JOINTS = 'all joints'


def blocks(examined: Sequence[Examined]) -> list[tuple[str, list[Finding]]]:
    """Return (heading, findings): those that are the same for all joints, then those of each."""

    def key(finding: Finding) -> tuple[str, ...]:
        return finding[:4]

    same = set.intersection(*({key(found) for found in each.findings} for each in examined))
    same = same if len(examined) > 1 else set()
    found = [(ALL_JOINTS, [each for each in examined[0].findings if key(each) in same])]
    for each in examined:
        own = [finding for finding in each.findings if key(finding) not in same]
        found.append((each.readings.name or 'joint', own))
    return [each for each in found if each[1]]


def verdicts(examined: Sequence[Examined], choice: Choice) -> dict[str, list[str]]:
    """Return the verdict on each joint in words."""
    found = {}
    for each in examined:
        name = each.readings.name
        if each.said:
            found[name] = list(each.said)
        elif each.refused:
            found[name] = Verdict(cautions=(), why=to_mend(each.refused)).sentences()
        elif each.answer is None:
            keep = f'The file keeps {choice.observer} at its defaults for it.'
            why = 'the joint does not move enough' if each.readings.rows.size else 'no readings'
            found[name] = [f'No ranking: {why}. {keep}']
        else:
            found[name] = sentences(name, each.answer, choice)
        if each.sources:
            lines = ', '.join(f'{k}: {yaml_text.scalar(v)}' for k, v in each.sources.items())
            found[name].append(f'Use the second sensor with {lines}.')
    period = {each.readings.name: each.readings.period for each in examined}
    found = {name: [units(each, period[name]) for each in said] for name, said in found.items()}
    same = set.intersection(*map(set, found.values())) if len(found) > 1 else set()
    common = [sentence for sentence in next(iter(found.values()), []) if sentence in same]
    found = {name: [each for each in said if each not in same] for name, said in found.items()}
    return found | ({ALL_JOINTS: common} if common else {})


def text(examined: Sequence[Examined], choice: Choice) -> str:
    """Return the findings and the verdict as text of 80 columns."""
    lines = []
    for heading, findings in blocks(examined):
        lines += [printable(heading)]
        for each in findings:
            lead = f'  {each.level}  {each.check:<{NAME_COLUMNS}}'
            lines += _wrapped(each.value, lead)
            if each.level != PASS and each.remedy:
                lines += _wrapped(f'-> {each.remedy}', ' ' * len(lead))
        lines.append('')
    lines += [summary(examined), '', 'VERDICT']
    for name, said in verdicts(examined, choice).items():
        lines.append(printable(f'{name or "joint"}:'))
        for sentence in said:
            lines += _wrapped(sentence, '  ')
    return '\n'.join(lines)


def _wrapped(words: str, lead: str) -> list[str]:
    return textwrap.wrap(
        printable(words),
        WIDTH,
        initial_indent=lead,
        subsequent_indent=' ' * len(lead),
        break_long_words=True,
        break_on_hyphens=False,
    ) or [lead]


def summary(examined: Sequence[Examined]) -> str:
    """Return the number of findings by level, and the checks that do not pass."""
    levels = Counter(found.level for _, findings in blocks(examined) for found in findings)
    said = ', '.join(f'{levels[level]} {level}' for level in LEVELS)
    named = [
        f'{level}: '
        + ', '.join(
            dict.fromkeys(
                found.check for each in examined for found in each.findings if found.level == level
            )
        )
        for level in (FAIL, WARN)
        if levels[level]
    ]
    return '\n'.join(
        textwrap.wrap('; '.join([f'{sum(levels.values())} checks: {said}', *named]), WIDTH)
    )


def as_yaml(
    examined: Sequence[Examined],
    choice: Choice,
    origin: str,
    settings: Mapping[str, Any],
    remaps: Sequence[str] = (),
) -> str:
    """Return a parameter file for `joint_observer`.

    Parameters
    ----------
    origin : what the readings are from. settings : parameters that the user set, and those of the
        input. remaps : of the node's topics.

    It is empty while nothing can be recommended for any joint: no gains fit readings that are
    wrong. One of several keeps the defaults.
    """
    if all(each.refused for each in examined):
        return ''
    quanta = {
        each.readings.name: 0.0 if each.refused else each.readings.own_quantum for each in examined
    }
    lines = [
        f'Made by velocity_estimator doctor from {origin}.',
        *for_node(AngleStream.NODE, remaps),
    ]
    how = f'{choice.observer} with these gains' if any(choice.gains.values()) else choice.observer
    if choice.tuned:
        certain = '95 % sure' if choice.sure else 'not significant'
        lines.append(
            f'{how}: {DEFAULT} at its defaults, the default, has {percent(choice.more)} % more '
            f'error ({certain}).'
            if math.isfinite(choice.more)
            else f'{how}: {DEFAULT}, the default, has too few estimates.'
        )
    elif any(each.answer is not None and each.answer.compared for each in examined):
        lines.append(f'{how}, the default: no other has 3 % less error, or surely less (95 %).')
    else:
        lines.append(f'{how}, the default: no joint moves enough to compare observers.')
    for name, said in verdicts(examined, choice).items():
        lines += [f'{name or "joint"}: {sentence}' for sentence in said[:2]]
    sources = second.together([each.sources for each in examined])
    values = {'observer': choice.observer} | dict(settings) | sources
    gains = {
        each.readings.name: dict(choice.gains.get(each.readings.name, {})) for each in examined
    }
    if len(examined) > 1:
        for each in examined:
            if each.readings.free:
                gains[each.readings.name]['wrap_period'] = each.readings.period
    return parameter_file.as_yaml(lines, values, quanta, gains)


def page(examined: Sequence[Examined], choice: Choice, origin: str, parameters: str) -> str:
    """Return the report as a page, readable on a phone and in the dark."""
    said = []
    for name, verdict in verdicts(examined, choice).items():
        first = 0 if name == ALL_JOINTS else 1
        said.append((name, ''.join(verdict[:first]), verdict[first:]))
    found = {
        each.readings.name: each.panels or panels(each.readings, _recommended(each, choice))
        for each in examined
        if each.panels or len(each.readings.rows) > 1
    }
    numbers = sum(2 + sum(map(len, each.values())) for each in found.values())  # of an instant
    drawn = [
        plots.over_time(curves, plots.MOST_NUMBERS // numbers, whole=True)
        for curves in found.values()
    ]
    return plots.page(
        'doctor.html',
        [plot for plot, _ in drawn],
        title=f'Doctor: {origin}',
        origin=origin,
        verdicts=said,
        parameters=parameters,
        summary=summary(examined).replace('\n', ' '),
        blocks=blocks(examined),
        joints=[(name, note) for name, (_, note) in zip(found, drawn)],
    )


def _recommended(examined: Examined, choice: Choice) -> Entry | None:
    """Return the observer with the gains that the verdict names; None if nothing is recommended."""
    name = examined.readings.name
    if examined.refused or examined.readings.at_rest:
        return None
    return Entry(choice.label(name), choice.observer, tuple(choice.gains.get(name, {}).items()))


def panels(readings: Readings, recommended: Entry | None = None) -> dict[str, list[Curve]]:
    """Return position, velocities and sample times of a joint, by title.

    Parameters
    ----------
    recommended : the observer that the verdict names; None: none.
    """
    rows, estimates = readings.rows, readings.difference
    time = (readings.stamps_ns[rows] - readings.start_ns) * 1e-9
    later = plots.ahead(time)
    rows, time = rows[later], time[later]
    grey, blue = (plots.Style(each).line for each in (plots.GREY, plots.COLOURS[0]))
    unit = units('rad', readings.period)
    recorded = readings.velocity[rows]
    difference = np.where(estimates.used, estimates.velocity, np.nan)[rows]
    velocities = [Curve('finite difference', f'@ {unit}/s', time, difference, blue)]
    if np.isfinite(recorded).any():
        velocities.insert(0, Curve('in the messages', f'@ {unit}/s', time, recorded, grey))
    title = f'velocity [{unit}/s]; blue: finite difference'
    title += '; grey: in the messages' * (len(velocities) > 1)
    if recommended is not None:
        more = {'quantum': readings.own_quantum} if readings.own_quantum else {}
        made = recommended.joint(wrap_period=readings.period, **more).run(
            readings.stamps_ns, readings.position
        )
        shown = made.used & np.isin(made.status, VALID)
        estimate = np.where(shown, made.velocity, np.nan)[rows]
        orange = plots.Style(plots.COLOURS[1]).line
        velocities.append(Curve(recommended.label, f'@ {unit}/s', time, estimate, orange))
        title += f'; orange: {recommended.label}, recommended'
    return {
        f'position [{unit}]': [Curve('position', f'@ {unit}', time, readings.position[rows], blue)],
        title: velocities,
    } | plots.sample_times(time)
