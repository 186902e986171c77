# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The figures of docs/observers/edge_adaptive*.md.

python -m docs.tools.edge_adaptive_figures docs/figures
"""

from __future__ import annotations

import argparse
import ast
import importlib
import pkgutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import preference
from benchmarks.accuracy import ALL, drawn
from benchmarks.signals import START_ANGLE, Motion, Samples, Signal, beat, constant, sine, trapezoid
from estimator_pkg.driver import joint as driver_joint
from estimator_pkg.driver.joint import Joint
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.observers.angle import edge
from estimator_pkg.observers.angle.edge import constants as edge_constants
from estimator_pkg.observers.angle.edge.interval import INTERVAL
from estimator_pkg.observers.angle.edge.sensor import vibration
from estimator_pkg.progress import progress

Array = NDArray[np.float64]
ENTRY = Entry('edge_adaptive', 'edge_adaptive')
KALMAN = Entry('kalman acceleration', 'kalman')
CONSTANTS = (
    'RATE',
    'SLACK',
    'SHARE',
    'SIGMAS',
    'BLUR',
    'LONGEST',
    'FADE',
    'MEMORY',
    'STRAY',
    'CONFIRMED',
    'RESTED',
)
FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0)
COLUMNS = ('slow', 'sine', 'trapezoid', 'reversal', 'noise', 'beat', 'fast beat', '100 Hz')
DRAWS = 4


MODULES = tuple(
    importlib.import_module(f'{edge.__name__}.{found.name}')
    for found in pkgutil.iter_modules(edge.__path__)
)


@contextmanager
def replaced(**values: Any) -> Iterator[None]:
    """Replace names in all modules of the observer, and run it as plain Python, in the block."""
    values['functions_of'] = lambda module: None
    before = [
        (module, name, getattr(module, name))
        for module in (*MODULES, driver_joint)
        for name in values
        if hasattr(module, name)
    ]
    for module, name, _ in before:
        setattr(module, name, values[name])
    try:
        yield
    finally:
        for module, name, value in before:
            setattr(module, name, value)


def scaled(name: str, factor: float) -> dict[str, Any]:
    """Return all constants where one is `factor` times its value, and those derived from it."""
    names: dict[str, Any] = {}
    for line in ast.parse(Path(edge_constants.__file__).read_text()).body:
        exec(compile(ast.Module([line], []), '<constants>', 'exec'), names)
        if isinstance(line, ast.Assign) and ast.unparse(line.targets[0]) == name:
            value = names[name]
            names[name] = (
                {key: factor * one for key, one in value.items()}
                if isinstance(value, dict)
                else factor * value
            )
    return {key: value for key, value in names.items() if key.isupper()}


def cells_alone(
    off: float, ahead: float, quantum: float, variance: float, noise: float, flickers: bool
) -> tuple[int, float, float]:
    """Return a reading's weight if only its cell counted."""
    return INTERVAL, off, 0.5 * quantum


def traced(joint: Joint, samples: Samples) -> dict[str, Array]:
    """Return estimate, standard deviation, density, cumulative sums, vibration and sway."""
    rows = []
    for stamp, angle in zip(samples.stamps.tolist(), samples.angle.tolist()):
        joint.update(stamp, angle)
        position, velocity, _, _ = joint.estimate()
        state = joint.state
        band = state.band
        rows.append(
            (
                position,
                velocity,
                *joint.stddev(),
                band.density,
                band.up,
                band.down,
                vibration(state.sensor),
                state.sway.mean,
            )
        )
    columns: Array = np.array(rows, np.float64).T
    return dict(
        zip(
            (
                'position',
                'velocity',
                'position_stddev',
                'stddev',
                'density',
                'up',
                'down',
                'vibration',
                'sway',
            ),
            columns,
        )
    )


def signal(motion: Motion, **more: Any) -> Signal:
    """Return a signal that is in no table."""
    return Signal('figure', '', motion, **more)


def seconds(samples: Samples) -> Array:
    """Time since the first sample [s]."""
    return (samples.stamps - samples.stamps[0]) * 1e-9


def _edges(plt: Any) -> Any:
    """Draw creep, and a beat near one count per sample, the same in a moving frame."""
    figure, axes = plt.subplots(1, 2, figsize=(8, 3.6))
    for axis, speed, frame, title in (
        (axes[0], 0.1, 0.0, '0.1 counts per sample'),
        (axes[1], 1.1, 1.0, '1.1 counts per sample, in a moving frame'),
    ):
        quantum = signal(constant(1.0)).quantum
        motion = constant(speed * 1000.0 * quantum)
        samples = signal(motion).samples(duration=1.5)
        joint = ENTRY.joint(quantum=quantum)
        found = traced(joint, samples)
        part = slice(1000, 1045)
        sample: Array = np.arange(len(samples.angle), dtype=np.float64)[part]
        back = frame * (sample - sample[0])
        at: Array = (sample + 1.0) * 1e-3
        true = motion(at)[0] + START_ANGLE
        count = np.floor(true / quantum) - back
        base = count[0]
        axis.step(sample, count - base, where='post', color='0.6', label='count: lower end of cell')
        axis.step(sample, count - base + 1.0, where='post', color='0.8', label='upper end')
        axis.plot(sample, true / quantum - back - base, 'k-', lw=1, label='true angle')
        # the published position is the middle of the reading's cell
        shown = np.unwrap(found['position'])[part] / quantum + 0.5
        shown += np.round((true / quantum - shown)[0] / 4096.0) * 4096.0
        axis.plot(sample, shown - back - base, '.', color='tab:red', ms=4, label='estimate')
        for k in np.flatnonzero(np.diff(count)) + 1:
            axis.plot(
                [sample[k]] * 2,
                [count[k] - base, count[k] - base + (speed - frame)],
                color='tab:blue',
                lw=4,
                solid_capstyle='butt',
                label='position of the edge'
                if k == np.flatnonzero(np.diff(count))[0] + 1
                else None,
            )
        axis.set(title=title, xlabel='sample', ylabel='quanta')
    axes[0].legend(fontsize=8)
    return figure


def _beats(plt: Any) -> Any:
    """Draw a beat, with the reading as a cell and as the intersection of two cells."""
    one = signal(beat(1, 1, 0.025))
    samples = one.samples(duration=4.0)
    figure, axes = plt.subplots(2, 1, figsize=(8, 5), sharex=True)
    time = seconds(samples)
    with replaced(interval=cells_alone):
        cells = traced(ENTRY.joint(quantum=one.quantum), samples)
    edges = traced(ENTRY.joint(quantum=one.quantum), samples)
    for found, color, label in (
        (cells, 'tab:orange', 'reading as a cell'),
        (edges, 'tab:blue', 'edges in a moving frame'),
    ):
        error = np.abs(found['velocity'] - samples.velocity)
        axes[0].semilogy(time, np.maximum(error, 1e-8), color=color, lw=0.8, label=label)
        axes[1].semilogy(time, found['density'], color=color, lw=0.8)
    axes[0].set(
        ylabel='|error| [rad/s]', ylim=(1e-7, 10.0), title='1.025 counts per sample, constant'
    )
    axes[0].legend()
    axes[1].set(ylabel='density of jerk [(rad/s^3)^2 s]', xlabel='time [s]')
    return figure


def _bandwidth(plt: Any) -> Any:
    """Draw the trapezoid: density and alarms."""
    one = signal(trapezoid(20.0, 100.0, 0.8))
    samples = one.samples(duration=4.2)
    found = traced(ENTRY.joint(quantum=one.quantum), samples)
    time = seconds(samples)
    part = time > 1.5
    figure, axes = plt.subplots(3, 1, figsize=(8, 6.5), sharex=True)
    axes[0].plot(time[part], samples.velocity[part], 'k', lw=1)
    axes[0].plot(time[part], found['velocity'][part], color='tab:red', lw=0.8)
    axes[0].set(ylabel='velocity [rad/s]', title='0 to 20 rad/s at 100 rad/s^2')
    error = (found['velocity'] - samples.velocity)[part]
    axes[1].fill_between(
        time[part],
        -1.96 * found['stddev'][part],
        1.96 * found['stddev'][part],
        color='0.85',
        label='+-1.96 standard deviations',
    )
    axes[1].plot(time[part], error, color='tab:red', lw=0.8, label='error')
    axes[1].set(ylabel='error [rad/s]', ylim=(-0.6, 0.6))
    axes[1].legend(fontsize=8)
    axes[2].semilogy(time[part], found['density'][part], label='density [(rad/s^3)^2 s]')
    spikes = np.maximum(found['up'], found['down'])[part]
    axes[2].semilogy(
        time[part],
        np.maximum(spikes, 1e-3),
        color='tab:green',
        lw=0.5,
        label='larger cumulative sum',
    )
    axes[2].axhline(edge_constants.ALARM, color='tab:green', ls=':', lw=0.8)
    axes[2].set(xlabel='time [s]')
    axes[2].legend(fontsize=8)
    return figure


def shaking(quanta: float) -> Motion:
    """A slow swing, and after 3 s a vibration of 7 samples' period at 200 Hz and 2048 counts."""
    pulsation, size = 2.0 * np.pi * 200.0 / 7.0, quanta * 2.0 * np.pi / 2048.0

    def motion(time: Array) -> tuple[Array, Array]:
        on = time >= 3.0
        return (
            np.sin(2.0 * time) + np.where(on, size * np.sin(pulsation * (time - 3.0)), 0.0),
            2.0 * np.cos(2.0 * time)
            + np.where(on, size * pulsation * np.cos(pulsation * (time - 3.0)), 0.0),
        )

    return motion


def _vibration(plt: Any) -> Any:
    """Draw vibrations with a period of a few samples: how they are detected, and the effect."""
    figure, axes = plt.subplots(2, 2, figsize=(8, 6), sharex=True)
    for (above, below), quanta in zip(axes.T, (4.0, 1.3)):
        one = signal(shaking(quanta), rate=200.0, counts=2048)
        samples = one.samples(duration=4.0)
        found = traced(ENTRY.joint(quantum=one.quantum), samples)
        kalman = KALMAN.joint(quantum=one.quantum).run(samples.stamps, samples.angle)
        time = seconds(samples)
        part = (time > 2.8) & (time < 3.7)
        above.plot(time[part], samples.velocity[part], 'k.-', lw=1, ms=3, label='true')
        above.plot(
            time[part],
            kalman.velocity[part],
            color='tab:orange',
            lw=1,
            label='Kalman filter, acceleration',
        )
        above.plot(
            time[part], found['velocity'][part], color='tab:red', lw=1, label='edge_adaptive'
        )
        above.set(title=f'{quanta:g} quanta, rate / 7')
        below.semilogy(time[part], found['density'][part], label='density [(rad/s^3)^2 s]')
        least = found['vibration'][part]
        below.semilogy(
            time[part],
            np.where(least > 0.0, least, np.nan),
            color='tab:green',
            lw=0.8,
            label='lower bound, from persistent third differences',
        )
        sway = found['sway'][part] / one.quantum**2
        below.semilogy(
            time[part],
            np.where(sway > 0.01, sway, np.nan),
            color='tab:purple',
            lw=0.8,
            label='sway [quanta^2]',
        )
        below.axhline(1.0 / 6.0, color='tab:purple', ls=':', lw=0.8, label='detection threshold')
        below.set(xlabel='time [s]', ylim=(1e-4, 1e10))
    axes[0, 0].set(ylabel='velocity [rad/s]')
    axes[0, 0].legend(fontsize=8, loc='lower left')
    axes[1, 1].legend(fontsize=8, loc='upper right')
    return figure


def _sigma(plt: Any) -> Any:
    """Draw error and standard deviation for a slow reversal, and for the sine."""
    figure, axes = plt.subplots(2, 1, figsize=(8, 5.5))
    for axis, motion, title, span in (
        (axes[0], sine(0.1, 0.5), '0.1 rad/s at 0.5 Hz', (3.0, 6.0)),
        (axes[1], sine(5.0, 2.0), '5 rad/s at 2 Hz', (3.0, 4.0)),
    ):
        one = signal(motion)
        samples = one.samples(duration=6.2)
        found = traced(ENTRY.joint(quantum=one.quantum), samples)
        time = seconds(samples)
        part = (time > span[0]) & (time < span[1])
        error = (found['velocity'] - samples.velocity)[part]
        axis.fill_between(
            time[part],
            -1.96 * found['stddev'][part],
            1.96 * found['stddev'][part],
            color='0.85',
            label='+-1.96 standard deviations',
        )
        axis.plot(time[part], error, color='tab:red', lw=0.8, label='error')
        largest = found['stddev'][part].max()  # at a reversal it may be far outside the axis
        axis.set(title=f'{title}, standard deviations up to {largest:.2g} rad/s', ylabel='rad/s')
        axis.set_ylim(-3.0 * np.abs(error).max(), 3.0 * np.abs(error).max())
    axes[1].set(xlabel='time [s]')
    axes[0].legend(fontsize=8)
    return figure


def _constants(plt: Any) -> Any:
    """Draw the effect of each constant at a quarter to four times its value, all columns."""
    chosen = tuple(one for one in ALL if one.name in COLUMNS)
    figure, axes = plt.subplots(4, 3, figsize=(8, 9.5), sharex=True, sharey=True)

    def pooled() -> dict[str, float]:
        rows = drawn([ENTRY], chosen, DRAWS, 4.0)['rows']
        return {row['signal']: row['pooled'] for row in rows}

    usual = pooled()
    with progress('constants', len(CONSTANTS)) as advance:
        for axis, name in zip(axes.flat, CONSTANTS):
            curves = []
            for factor in FACTORS:
                if factor == 1.0:
                    curves.append(usual)
                    continue
                with replaced(**scaled(name, factor)):
                    curves.append(pooled())
            for one in chosen:
                axis.loglog(
                    FACTORS,
                    [curve[one.name] / usual[one.name] for curve in curves],
                    '.-',
                    label=one.name,
                )
            axis.set(title=name, ylim=(0.3, 30.0))
            axis.set_xticks(FACTORS, [f'{factor:g}' for factor in FACTORS])
            axis.set_xticks([], minor=True)
            axis.grid(alpha=0.3)
            advance(1)
    axes[0, 0].legend(fontsize=7, ncol=2)
    for axis in axes[-1]:
        axis.set_xlabel('times its value')
    for axis in axes[:, 0]:
        axis.set_ylabel('error / usual')
    return figure


def _preference(plt: Any) -> Any:
    rows = preference.run(Path('bags'))
    figure, axes = plt.subplots(1, 2, figsize=(12.0, 4.4), sharey=True)
    kinds = {'motion': 'simulated motions', 'recording': 'recordings and captures'}
    for axis, (kind, title) in zip(axes, kinds.items()):
        for row in (row for row in rows if row['kind'] == kind):
            each = [row['results'][prefer] for prefer in preference.PREFER]
            middle = each[1]
            late = [one.delay_s / middle.delay_s for one in each]
            if not min(late) > 0.0:
                continue  # a delay near zero: no ratio
            noise = [one.noise / middle.noise for one in each]
            (line,) = axis.loglog(late, noise, '-', lw=0.9, label=row['stream'])
            for at, marker in enumerate('so^'):
                axis.loglog(late[at], noise[at], marker, color=line.get_color(), ms=5)
        ratio = np.array([0.125, 8.0])
        axis.loglog(ratio**-0.5, ratio**0.25, 'k:', lw=1.2, label='white jerk, linear')
        for which, ticks in (
            (axis.set_xticks, (0.25, 0.5, 1, 2, 4)),
            (axis.set_yticks, (0.5, 0.7, 1, 1.4, 2)),
        ):
            which(ticks, [f'{tick:g}' for tick in ticks])
            which([], minor=True)
        axis.set(title=title, xlabel='delay / that of balanced', xlim=(0.2, 5.0))
        axis.grid(alpha=0.3)
    axes[0].set_ylabel('noise / that of balanced')
    axes[0].legend(fontsize=7, loc='lower left')
    axes[1].legend(fontsize=7, loc='center left', bbox_to_anchor=(1.01, 0.5))
    axes[0].annotate('fast', (0.3, 1.75))
    axes[0].annotate('smooth', (2.3, 0.52))
    return figure


PICTURES = {
    'edge': _edges,
    'beat': _beats,
    'bandwidth': _bandwidth,
    'vibration': _vibration,
    'sigma': _sigma,
    'constants': _constants,
    'preference': _preference,
}


def draw(folder: Path, names: Sequence[str] = tuple(PICTURES)) -> list[Path]:
    """Write edge_adaptive_<name>.png into `folder`; return the paths."""
    import matplotlib

    matplotlib.use('Agg')
    import matplotlib.pyplot as plt

    written = []
    for name in names:
        figure = PICTURES[name](plt)
        figure.tight_layout()
        path = folder / f'edge_adaptive_{name}.png'
        figure.savefig(path, dpi=110)
        plt.close(figure)
        written.append(path)
    return written


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw the requested figures, all by default."""
    parser = argparse.ArgumentParser(description='pictures of the edge-aware adaptive observer')
    parser.add_argument('folder', type=Path, help='output folder')
    parser.add_argument('--only', action='append', choices=tuple(PICTURES), default=[])
    parsed = parser.parse_args(arguments)
    for path in draw(parsed.folder, parsed.only or tuple(PICTURES)):
        print(path)
    return 0


if __name__ == '__main__':
    sys.exit(main())
