# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The picture of a tuning run: noise against delay of every trial."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from estimator_pkg.evaluation.image import check, save
from estimator_pkg.printable import drawn


def front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Return the Pareto front: indices of (delay, noise) that no other beats in both, by delay."""
    order = sorted(range(len(points)), key=lambda i: (abs(points[i][0]), points[i][1]))
    kept: list[int] = []
    for i in order:
        if not kept or points[i][1] < points[kept[-1]][1]:
            kept.append(i)
    return kept


def draw(tuned: Sequence[Mapping[str, Any]], path: str, observer: str) -> None:
    """Draw every trial, the Pareto front of noise against delay, and the chosen gains.

    Raises
    ------
    UserError : the plot cannot be written.
    """
    check(path)
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.5 * len(tuned), 4.8), layout='constrained')
    axes = figure.subplots(1, len(tuned), squeeze=False)[0]
    for axis, each in zip(axes, tuned):
        points = [point for _, _, point in each['trials'] if point]
        _, _, best = min(each['trials'], key=lambda trial: trial[1], default=(None, 0.0, None))

        def scatter(where: Sequence[Any], axis: Any = axis, **look: Any) -> None:
            axis.scatter([late * 1e3 for late, _ in where], [noise for _, noise in where], **look)

        scatter(points, s=14, color='0.65', label='tried')
        line = [points[i] for i in front(points)]
        axis.plot(
            [late * 1e3 for late, _ in line],
            [noise for _, noise in line],
            '-o',
            markersize=4,
            color='tab:blue',
            label='Pareto front',
        )
        if best:
            scatter([best], s=130, marker='*', color='tab:red', zorder=5, label='chosen')
        if each['default_point']:
            look = {'facecolors': 'none', 'edgecolors': 'black'}
            scatter([each['default_point']], s=50, marker='s', zorder=4, label='defaults', **look)
        axis.set_xlabel('delay [ms]')
        axis.set_ylabel('noise [rad/s rms]')
        if points and min(noise for _, noise in points) > 0.0:
            axis.set_yscale('log')
        if not points:
            axis.text(0.5, 0.5, 'the motion shows no delay', ha='center', transform=axis.transAxes)
        axis.set_title(drawn(f'{observer}: {each["joint"] or "all joints"}'))
        axis.grid(alpha=0.3)
        if points:
            axis.legend(fontsize='small')
    save(figure, path)
