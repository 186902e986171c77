# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Small plots of a report page as SVG: they follow the legend, the dark and the page's width."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.printable import escaped

Array = NDArray[np.float64]

COLOURS = 7  # `--c0` to `--c6` of page.css
DASHES = ((), (7, 3), (2, 3), (9, 3, 2, 3), (5, 2), (12, 4), (4, 3, 1, 3))
WIDTH, HEIGHT = 430, 250
LEFT, RIGHT, TOP, BOTTOM = 56, 12, 24, 42
FINE = 0.4  # points of a line are at least so far apart [pixels]
MOST = 600  # points of a line


class Style(NamedTuple):
    """Colour and dashes of an estimate's lines, the same in all plots."""

    colour: str
    dash: tuple[int, ...]

    def svg(self) -> str:
        """Return it as attributes of a line."""
        dash = f' stroke-dasharray="{" ".join(map(str, self.dash))}"' if self.dash else ''
        return f'style="stroke:var({self.colour})"{dash}'


def styles(sources: Iterable[str]) -> dict[str, Style]:
    """Return a style for each; colours and dashes both differ between neighbours."""
    return {
        source: Style(f'--c{i % COLOURS}', DASHES[(i + i // COLOURS) % len(DASHES)])
        for i, source in enumerate(sources)
    }


class Axis(NamedTuple):
    """Range and label of an axis."""

    label: str
    low: float
    high: float
    log: bool = False

    @staticmethod
    def around(label: str, values: Iterable[Array], log: bool = False, zero: bool = False) -> Axis:
        """Return an axis that shows all finite values, arrays of any shape, with some room."""
        known = np.concatenate([np.zeros(0), *(np.ravel(each) for each in values)])
        known = known[np.isfinite(known) & ((known > 0.0) | (not log))]
        if not len(known):
            return Axis(label, *((0.1, 1.0) if log else (0.0, 1.0)), log)
        low, high = float(known.min()), float(known.max())
        if log:
            low, high = low / 1.15, max(high * 1.15, low * 2.0)
            return Axis(label, low, high, True)
        room = 0.06 * max(high - low, 1e-9, 1e-6 * abs(high))
        return Axis(label, 0.0 if zero and low >= 0.0 else low - room, high + room)

    def part(self, value: Any) -> Any:
        """Return where a value is: 0 at the low end, 1 at the high end."""
        if self.log:
            with np.errstate(divide='ignore', invalid='ignore'):
                return np.log(np.asarray(value) / self.low) / math.log(self.high / self.low)
        return (np.asarray(value) - self.low) / (self.high - self.low)

    def ticks(self) -> list[tuple[float, str]]:
        """Return the values with a label."""
        if self.log:
            decades = math.log10(self.high / self.low)
            factors: tuple[float, ...] = (1, 2, 5) if decades < 2.5 else (1,)
            if decades < 1.0:
                factors = (1, 1.5, 2, 3, 4, 5, 7)
            every = max(1, round(decades / 6))
            powers = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
            values = [k * 10.0**p for p in powers if p % every == 0 for k in factors]
            return [(v, f'{v:g}') for v in values if self.low <= v <= self.high]
        rough = (self.high - self.low) / 5.0
        power = 10.0 ** math.floor(math.log10(rough))
        step = next(k * power for k in (1, 2, 5, 10) if k * power >= rough * 0.999)
        first = math.ceil(self.low / step - 1e-9)
        values = [step * k for k in range(first, first + 20) if step * k <= self.high + 1e-9 * step]
        decimals = max(0, -math.floor(math.log10(step) + 1e-9))
        return [(v, f'{v:.{decimals}f}' if decimals < 6 else f'{v:.2g}') for v in values]


class Plot:
    """A plot that grows by lines, points and bars.

    Arrays have shape (n,), in the units of the axes; the edges of n bars have shape (n + 1,).

    Parameters
    ----------
    styles : by estimate, see `styles`.
    """

    def __init__(
        self,
        title: str,
        x: Axis,
        y: Axis,
        styles: Mapping[str, Style],
        width: int = WIDTH,
        height: int = HEIGHT,
    ) -> None:
        self._title, self._x, self._y, self._styles = title, x, y, styles
        self._width, self._height = width, height
        self._inside: list[str] = []
        self._above: list[str] = []

    def at(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Return pixels."""
        wide, high = self._width - LEFT - RIGHT, self._height - TOP - BOTTOM
        return LEFT + wide * self._x.part(x), TOP + high * (1.0 - self._y.part(y))

    def line(
        self, source: str, x: Array, y: Array, kind: str = 'line', follows: bool = True
    ) -> Plot:
        """Add a line of an estimate, or with ``source=''`` one of a `kind` of page.css.

        Parameters
        ----------
        follows : the legend brings the line forward and back.
        """
        style = self._styles[source].svg() if source else ''
        if source and follows:
            style += f' data-s="{escaped(source)}"'
        for path in self._paths(np.asarray(x, float), np.asarray(y, float)):
            self._inside.append(f'<path class="{kind}" {style} d="{path}"/>')
        return self

    def _paths(self, x: Array, y: Array) -> Iterable[str]:
        px, py = self.at(x, y)
        known = np.isfinite(px) & np.isfinite(py)
        for part in np.split(np.arange(len(px)), np.flatnonzero(np.diff(known)) + 1):
            if not len(part) or not known[part[0]]:
                continue
            if len(part) > MOST:
                column = np.floor(px[part] / FINE).astype(int)
                part = part[np.append(True, np.diff(column) != 0)]
            points = zip(np.clip(px[part], -1e4, 1e4), np.clip(py[part], -1e4, 1e4))
            yield 'M' + 'L'.join(f'{a:.1f} {b:.1f}' for a, b in points)

    def bars(self, edges: Array, heights: Array, low: float) -> Plot:
        """Add a histogram."""
        for a, b, height in zip(edges[:-1], edges[1:], heights):
            if height > low:
                (left, top), (right, bottom) = self.at(a, height), self.at(b, low)
                self._inside.append(
                    f'<rect class="bars" x="{left:.1f}" y="{top:.1f}" '
                    f'width="{max(right - left - 0.5, 0.5):.1f}" height="{bottom - top:.1f}"/>'
                )
        return self

    def gaps(self, x: Array, y: float) -> Plot:
        """Add triangles."""
        for value in x:
            a, b = self.at(value, y)
            self._inside.append(f'<path class="gap" d="M{a - 4:.1f} {b + 4:.1f}h8l-4 -8z"/>')
        return self

    def marks(self, marks: Sequence[tuple[str, float, float, bool]]) -> Plot:
        """Add labelled points of estimates: (source, x, y, ringed); labels do not overlap."""
        taken: list[tuple[float, float, float]] = []
        for source, x, y, ringed in sorted(marks, key=lambda each: each[2]):
            a, b = (float(each) for each in self.at(x, y))
            if not (LEFT <= a <= self._width - RIGHT and TOP <= b <= self._height - BOTTOM):
                continue
            style, name = self._styles[source], escaped(source)
            ring = f'<circle cx="{a:.1f}" cy="{b:.1f}" r="8" class="axis" fill="none"/>'
            wide = 7.3 * len(source) + 14
            left = a + 10 if a + wide < self._width else a - wide
            height = b + 4
            while any(
                abs(height - other) < 13 and left < end and start < left + wide
                for other, start, end in taken
            ):
                height -= 3
            taken.append((height, left, left + wide))
            self._above.append(
                f'<g data-label="{name}">{ring if ringed else ""}<circle cx="{a:.1f}" '
                f'cy="{b:.1f}" r="4.5" style="fill:var({style.colour})"/>'
                f'<text class="halo" x="{left:.1f}" y="{height:.1f}">{name}</text></g>'
            )
        return self

    def svg(self) -> str:
        """Return the plot."""
        right, bottom = self._width - RIGHT, self._height - BOTTOM
        parts = [
            f'<svg class="plot" viewBox="0 0 {self._width} {self._height}" role="img" '
            f'aria-label="{escaped(self._title)}">',
            f'<text class="title" x="{LEFT}" y="15">{escaped(self._title)}</text>',
        ]
        for value, text in self._x.ticks():
            x, _ = self.at(value, self._y.low)
            parts.append(f'<path class="grid" d="M{x:.1f} {TOP}V{bottom}"/>')
            parts.append(f'<text x="{x:.1f}" y="{bottom + 15}" text-anchor="middle">{text}</text>')
        for value, text in self._y.ticks():
            _, y = self.at(self._x.low, value)
            parts.append(f'<path class="grid" d="M{LEFT} {y:.1f}H{right}"/>')
            parts.append(f'<text x="{LEFT - 5}" y="{y + 4:.1f}" text-anchor="end">{text}</text>')
        parts += [
            f'<text x="{(LEFT + right) / 2}" y="{self._height - 8}" text-anchor="middle">'
            f'{escaped(self._x.label)}</text>',
            f'<text transform="translate(13 {(TOP + bottom) / 2}) rotate(-90)" '
            f'text-anchor="middle">{escaped(self._y.label)}</text>',
            f'<svg x="{LEFT}" y="{TOP}" width="{right - LEFT}" height="{bottom - TOP}" '
            f'viewBox="{LEFT} {TOP} {right - LEFT} {bottom - TOP}">{"".join(self._inside)}</svg>',
            f'<rect class="axis" x="{LEFT}" y="{TOP}" width="{right - LEFT}" '
            f'height="{bottom - TOP}" fill="none"/>',
            *self._above,
            '</svg>',
        ]
        return ''.join(parts)
