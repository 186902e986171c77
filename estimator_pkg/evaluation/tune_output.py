"""What `tune` leaves behind: a YAML with comments, and the picture of noise against delay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.plot import check
from estimator_pkg.evaluation.text import number
from estimator_pkg.parameters import declared

WORSE = 'on what was held out these gains are no better than the defaults: keep the defaults'


def worse(each: Mapping[str, Any]) -> bool:
    """True if the gains found do worse than the defaults where the search did not look."""
    best, default = each['best'], each['default']
    return default is not None and (best is None or best['cost'] > default['cost'])


def as_yaml(observer: Any, fixed: Mapping[str, Any], tuned: Sequence[Mapping[str, Any]],
            preference: str, held_out: float) -> str:
    """A parameter file for `joint_observer`, which says where its numbers come from.

    Parameters
    ----------
    tuned : results of `tune.tune`; one without a joint holds for all of them.
    """
    lines = [f'# Gains of {observer.name}, tuned from data (preference: {preference}).']
    for each in tuned:
        lines += _origin(each, held_out)
    lines += ['/**:', '  ros__parameters:', f'    observer: {observer.name}']
    lines += [f'    {name}: {_scalar(value)}' for name, value in fixed.items()]
    known = declared(observer.gains)
    overrides = []
    for each in tuned:
        for name, value in each['gains'].items():
            unit = known[name].unit
            about = f'  # {f"[{unit}] " if unit else ""}the default is {_default(known[name])}'
            text = f'{name}: {_scalar(float(f"{value:.6g}"))}{about}'
            if each['joint']:
                overrides.append((each['joint'], text))
            else:
                lines.append(f'    {text}')
    if overrides:
        lines.append('    joints:')
        for joint in dict.fromkeys(name for name, _ in overrides):
            lines.append(f'      {_scalar(joint)}:')
            lines += [f'        {text}' for name, text in overrides if name == joint]
    return '\n'.join(lines) + '\n'


def _origin(each: Mapping[str, Any], held_out: float) -> list[str]:
    of = f'Joint {each["joint"]}' if each['joint'] else f'Joints {", ".join(each["joints"])}'
    lines = [f'# {of}, from', *(f'#   {bag}' for bag in each['bags'])]
    where = (f'the last {held_out:.0%} of each record, which the search did not see'
             if each['held_out'] else 'the data they were tuned on')
    lines.append(f'# {each["evaluations"]} trials'
                 + (', interrupted' if each['interrupted'] else '') + f'. On {where}:')
    for label, result in (('these gains', each['best']), ('the defaults', each['default'])):
        if result is None:
            lines.append(f'#   {label}: cannot work at this sample rate')
        else:
            lines.append(f'#   {label}: error {number(result["error"])} rad/s rms, delay '
                         f'{number(result["delay_s"] * 1e3, 3)} ms, noise '
                         f'{number(result["noise"], 3)} rad/s')
    if worse(each):
        lines.append(f'# {WORSE[0].upper()}{WORSE[1:]}.')
    return lines


def _default(parameter: Any) -> str:
    return 'what follows from the others' if parameter.default is None else f'{parameter.default:g}'


def _scalar(value: Any) -> str:
    if isinstance(value, tuple):
        value = list(value)
    return yaml.safe_dump(value, default_flow_style=True, width=1000).split('\n')[0]


def front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Which of the (delay, noise) no other beats in both, by rising delay."""
    order = sorted(range(len(points)), key=lambda i: (abs(points[i][0]), points[i][1]))
    kept: list[int] = []
    for i in order:
        if not kept or points[i][1] < points[kept[-1]][1]:
            kept.append(i)
    return kept


def draw(tuned: Sequence[Mapping[str, Any]], asked: str | None, usual: Path, observer: str
         ) -> str | None:
    """Draws every trial, the Pareto front of noise against delay, and what was chosen.

    Where nobody asked and matplotlib is missing there is no picture.

    Raises
    ------
    UserError : it was asked for and cannot be drawn.
    """
    try:
        check(asked or str(usual))
    except UserError:
        if asked:
            raise
        return None
    from matplotlib.figure import Figure
    figure = Figure(figsize=(6.5 * len(tuned), 4.8), layout='constrained')
    axes = figure.subplots(1, len(tuned), squeeze=False)[0]
    for axis, each in zip(axes, tuned):
        known = [(values, cost, point) for values, cost, point in each['trials'] if point]
        points = [point for _, _, point in known]
        delays = [abs(point[0]) * 1e3 for point in points]
        noises = [point[1] for point in points]
        axis.scatter(delays, noises, s=14, color='0.65', label='tried')
        chosen = front(points)
        axis.plot([delays[i] for i in chosen], [noises[i] for i in chosen], '-o', markersize=4,
                  color='tab:blue', label='nothing is better in both')
        best = min(range(len(known)), key=lambda i: known[i][1], default=None)
        if best is not None:
            axis.scatter([delays[best]], [noises[best]], s=130, marker='*', color='tab:red',
                         zorder=5, label='chosen')
        if each['default_point']:
            late, noise = each['default_point']
            axis.scatter([abs(late) * 1e3], [noise], s=50, marker='s', facecolors='none',
                         edgecolors='black', zorder=4, label='defaults')
        axis.set_xlabel('delay [ms]')
        axis.set_ylabel('noise [rad/s rms]')
        if noises and min(noises) > 0.0:
            axis.set_yscale('log')
        axis.set_title(f'{observer}: {each["joint"] or "all joints"}')
        axis.grid(alpha=0.3)
        axis.legend(fontsize='small')
    figure.savefig(asked or str(usual), dpi=120)
    return asked or str(usual)
