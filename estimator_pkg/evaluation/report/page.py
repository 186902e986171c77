# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A self-contained page: the verdict, a parameter file, a picture, a table, findings and plots."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from estimator_pkg import __version__, destination, whole_file
from estimator_pkg.evaluation import plots
from estimator_pkg.evaluation.compare.comparison import Comparison, Row
from estimator_pkg.evaluation.compare.many import LeftOut
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.ranking.verdict import Verdict
from estimator_pkg.evaluation.report import figures, opening, tradeoff
from estimator_pkg.evaluation.report.findings import NO_FINDINGS, grouped, look, of_joint, sentences
from estimator_pkg.evaluation.report.tables import Overview, table, worth
from estimator_pkg.observers import DEFAULT
from estimator_pkg.printable import escaped
from estimator_pkg.progress import progress
from estimator_pkg.streams.drive import ELECTRICAL

PER_ESTIMATE, SHARED = 4, 4  # numbers per instant: velocity, error, deviation, status; and others
USE = (
    'Drag to zoom; Ctrl and the wheel zoom, too. The tools beside a plot pan, reset and save it. '
    'On a touch screen a swipe scrolls the page: tap a tool before you zoom or pan. '
    'The pointer shows the values of all estimates at one instant. The names below show and hide '
    'an estimate in all plots.'
)


class ReportPage:
    """Collects bags and writes the page at the end of `written`.

    Parameters
    ----------
    path : of the page; it appears when it is complete.
    bags : number of bags, which share the points.
    period : wrap period of the positions [rad].
    data : file with every sample, to which the page refers; None: none.
    entries : the observers that were run, with their parameters.

    Raises
    ------
    UserError : the file cannot be written, or the library is missing.
    """

    def __init__(
        self, path: str, bags: int, period: float, data: str | None, entries: Sequence[Entry]
    ) -> None:
        self.path = Path(path)
        destination.check(path)
        plots.check()
        self._data = data
        self._period = period
        self._bags = max(1, bags)
        self._entries = {entry.label: entry for entry in entries}
        self._overview = Overview()
        self._sections: list[str] = []
        self._plots = plots.Plots()
        self._sources: dict[str, None] = {}  # in the order of the first verdict
        self._chosen: dict[str, None] = {}
        self._left_out = ''

    @contextmanager
    def written(self) -> Iterator[ReportPage]:
        """Write the page at the end, unless an error occurred."""
        yield self
        with progress(f'{self.path}: page', None):
            self._write()

    def add(self, comparison: Comparison) -> list[str]:
        """Add a bag; return its findings as sentences."""
        verdicts = comparison.verdicts
        joints = list(dict.fromkeys(row.joint for row in comparison.rows))
        if not joints:
            return self._nothing(comparison)
        quanta: dict[str, float] = {}
        of_readings: dict[str, list[str]] = {}
        rows: dict[str, list[Row]] = {}
        raw: dict[str, Row] = {}
        with progress(f'{comparison.bag}: page', 3 * len(joints)) as advance:
            for joint in joints:
                if joint in comparison.measurement and not joint.endswith(ELECTRICAL):
                    found = look(
                        comparison.measurement[joint], comparison.starts[joint], self._period
                    )
                    if found is not None:
                        quanta[joint] = found.own_quantum
                        of_readings[joint] = of_joint(comparison, joint, found)
                own = [row for row in comparison.rows if row.joint == joint]
                raw_row = next((row for row in own if row.source == tradeoff.RAW), None)
                if raw_row is None:
                    raw_row = tradeoff.raw_difference(comparison, joint, own[0], self._period)
                    own += [raw_row] if raw_row is not None else []
                if raw_row is not None:
                    raw[joint] = raw_row
                rows[joint] = opening.ordered(own, verdicts.get(joint))
                advance(1)
            chosen = {
                joint: opening.choice(
                    [row for row in each if any(row is one for one in comparison.rows)],
                    verdicts.get(joint),
                )
                for joint, each in rows.items()
            }
            self._know(rows, chosen)
            findings = grouped(sentences(comparison, of_readings), joints) or [NO_FINDINGS]
            parts = self._opening(comparison, rows, chosen, raw, quanta)
            ordered = [row for joint in joints for row in rows[joint]]
            parts += [
                f'<p class="note">Velocity errors against {escaped(comparison.truth)}, at zero '
                'shift, and the delay.</p>',
                table(comparison, ordered, _ranked(chosen, verdicts), self._entries),
                worth(comparison),
            ]
            parts += [
                '<h3>Findings and recommendations</h3>',
                '<ul>' + ''.join(f'<li>{escaped(each)}</li>' for each in findings) + '</ul>',
            ]
            if not self._sections:
                parts.append('<!--legend-->')
            instants = self._instants(comparison)
            for joint in joints:
                advance(1)
                parts += self._of_joint(comparison, joint, rows[joint], chosen[joint], instants)
                advance(1)
        self._sections.append('\n'.join(parts))
        return findings

    def _nothing(self, comparison: Comparison) -> list[str]:
        """Add a bag without any comparison: the default observer."""
        verdicts = comparison.verdicts
        sentences = grouped(
            [f'{joint}: {text}' for joint, each in verdicts.items() for text in each.sentences()],
            verdicts,
        )
        bag = Path(comparison.bag)
        self._sections.append(
            f'<h2 id="{self._overview.add(comparison)}">{escaped(bag.name)}</h2>'
            + (
                ''
                if any(map(opening.faulty, verdicts.values()))
                else f'<div class="verdict"><p>Use {DEFAULT} as it is.</p></div>'
            )
            + ''.join(f'<p>{escaped(each)}</p>' for each in sentences)
        )
        return list(comparison.refused.values())

    def leave_out(self, bags: Sequence[LeftOut]) -> None:
        """Add the list of bags that could not be evaluated."""
        if bags:
            self._left_out = (
                '<h2>Skipped</h2><ul>'
                + ''.join(f'<li>{escaped(str(bag))}</li>' for bag in bags)
                + '</ul>'
            )

    def _know(self, rows: Mapping[str, Sequence[Row]], chosen: Mapping[str, Row]) -> None:
        """Note the estimates, in the order of the legend, and those that are in front."""
        first = [row.source for row in chosen.values()]
        there = {row.source for each in rows.values() for row in each}
        front = [*first, *({tradeoff.RAW} & there)]
        self._sources.update(dict.fromkeys(front))
        for each in rows.values():
            self._sources.update(dict.fromkeys(row.source for row in each))
        self._chosen.update(dict.fromkeys(front))

    def _opening(
        self,
        comparison: Comparison,
        rows: Mapping[str, Sequence[Row]],
        chosen: Mapping[str, Row],
        raw: Mapping[str, Row],
        quanta: Mapping[str, float],
    ) -> list[str]:
        """Return heading, verdict, parameter file and picture."""
        bag, verdicts, joints = Path(comparison.bag), comparison.verdicts, len(rows)
        anchor = self._overview.add(comparison)
        sentences = opening.words(chosen, raw, self._entries, verdicts)
        recommended = sum(text.startswith('Use ') for text in sentences)
        parameters = opening.parameter_file(
            comparison, chosen, self._entries, quanta, self._period, verdicts
        )
        moving = max(rows, key=lambda joint: _speed(rows[joint][0]))
        drawn = tradeoff.picture(
            tradeoff.sweeps(comparison, moving, rows[moving], self._entries, self._period),
            plots.styles(self._sources),
        )
        picture = (
            f'{self._plots.add(drawn)}<p class="note">Down and to the left is better. A point is '
            'an estimate, its line the same observer with other gains. The grey band is the Pareto '
            'front: nothing has both less delay and less noise. A dark rim marks the points on it. '
            'Noise: rms error after the delay is taken out'
            + (f', of {escaped(moving)}, which moves fastest' if joints > 1 else '')
            + '.</p>'
            if drawn is not None
            else '<p class="note">No picture of noise against delay: the motion determines no '
            'delay.</p>'
        )
        file = (
            '<div><p>The parameter file:</p><pre>' + _shown(parameters) + '</pre>'
            '<button class="copy">copy</button></div>'
            if parameters
            else '<p>No parameter file: mend what the verdict names first.</p>'
            if any(map(opening.faulty, verdicts.values()))
            else '<p>The best estimate is a recorded topic: there are no parameters to set.</p>'
        )
        return [
            f'<h2 id="{anchor}">{escaped(bag.name)}</h2>',
            f'<p class="note">{escaped(str(bag))}</p>',
            '<div class="verdict">'
            + ''.join(f'<p>{escaped(each)}</p>' for each in sentences[:recommended])
            + '</div>',
            _folded(sentences[recommended:], joints),
            f'<div class="first">{file}<div>{picture}</div></div>',
        ]

    def _instants(self, comparison: Comparison) -> int:
        """Return the largest number of instants of a joint."""
        joints = len({row.joint for row in comparison.rows})
        numbers = PER_ESTIMATE * (len(comparison.rows) + joints) + SHARED * joints
        return plots.MOST_NUMBERS // (self._bags * numbers)

    def _of_joint(
        self, comparison: Comparison, joint: str, rows: Sequence[Row], best: Row, instants: int
    ) -> list[str]:
        """Return the plots of a joint."""
        known = plots.styles(self._sources)
        panels, note = figures.group(comparison, joint, rows, instants, known, self._chosen)
        small = [
            figures.lines(plot, found, known, self._chosen)
            for plot, found in (
                figures.around_the_worst(best, rows),
                figures.error_by_speed(rows),
                figures.error_spectrum(rows),
            )
        ]
        if note:
            note = f'<p class="note">{note} {self._where()}</p>'
        return [
            f'<h3>{escaped(joint)}</h3>',
            self._plots.add(panels),
            note,
            f'<div class="small">{"".join(map(self._plots.add, small))}</div>',
        ]

    def _legend(self) -> str:
        buttons = []
        for source, style in plots.styles(self._sources).items():
            pressed = 'true' if source in self._chosen else 'false'
            buttons.append(
                f'<button data-s="{escaped(source)}" aria-pressed="{pressed}">'
                f'{style.svg()}{escaped(source)}</button>'
            )
        return (
            f'<h2>Plots</h2><p class="note">{USE}</p><div class="legend">{"".join(buttons)}</div>'
        )

    def _write(self) -> None:
        body = '\n'.join([self._overview.html(), *self._sections, self._left_out])
        body = body.replace('<!--legend-->', self._legend(), 1)
        note = f'<p class="note">Made by velocity_estimator {__version__}. {self._where()}</p>'
        page = self._plots.page(
            'Velocity estimates', f'<h1>Velocity estimates</h1>\n{body}\n{note}'
        )
        whole_file.write_text(self.path, page)

    def _where(self) -> str:
        if self._data is None:
            return 'Every compared sample: evaluate --data FILE.'
        return f'Every compared sample is in {escaped(Path(self._data).name)} (numpy.load).'


def _ranked(chosen: Mapping[str, Row], verdicts: Mapping[str, Verdict]) -> dict[str, Row]:
    """Return the chosen rows of the joints whose estimates can be ranked."""
    return {
        joint: row
        for joint, row in chosen.items()
        if (verdicts[joint].best if joint in verdicts else not row.reference_cannot_tell)
    }


def _speed(row: Row) -> float:
    """Return the rms speed of the reference, 0 if it is unknown."""
    power = float((row.truth**2).mean()) if len(row.truth) else 0.0
    return math.sqrt(power) if math.isfinite(power) else 0.0


def _folded(sentences: Sequence[str], joints: int) -> str:
    """Return sentences; those on some of several joints only when they are opened."""
    every = f'all {joints} joints: '
    shown = [text for text in sentences if joints == 1 or text.startswith(every)]
    rest = ''.join(f'<p>{escaped(each)}</p>' for each in sentences if each not in shown)
    return ''.join(f'<p>{escaped(each.removeprefix(every))}</p>' for each in shown) + (
        f'<details><summary>Each joint</summary>{rest}</details>' if rest else ''
    )


def _shown(text: str) -> str:
    """Return lines for HTML, each without unprintable characters."""
    return '\n'.join(map(escaped, text.splitlines()))
