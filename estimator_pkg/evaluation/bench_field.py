"""``bench accuracy --field``: ours and the peers, each at one setting and at its best per column.

Every estimator has one gain that is swept over a grid. "Best" is the lowest error of each column,
"one setting" the grid point that is, in the geometric mean, the least above these. Peers
are the installed libraries, each fed with what it takes: unwrapped readings, and the true sample
times where it can use them. PyNumDiff's methods look ahead; they are the referee, no rivals.
"""

from __future__ import annotations

import math
import textwrap
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import registry
from estimator_pkg.evaluation.entries import Entry, at_defaults
from estimator_pkg.evaluation.plot import check
from estimator_pkg.evaluation.signals import RATE, SIGNALS, SKIPPED, Samples, Signal
from estimator_pkg.evaluation.text import number, table
from estimator_pkg.parameters import declared
from estimator_pkg.progress import progress

Array = NDArray[np.float64]

OURS_AT = 13        # grid points of an observer of ours,
PEERS_AT = 9        # and of a peer
DURATION = 6.0      # [s] of each column
FLOOR = 0.01        # [rad/s] errors below this are as good as none when one setting is chosen
EDGE = 0.1          # [s] left out at the end too: what looks ahead does not see it whole


@dataclass(frozen=True)
class Estimator:
    """A row: velocities from samples, at one value of its gain.

    values : the grid; (None,) where there is nothing to set.
    causal : it does not look ahead.
    """

    name: str
    estimate: Callable[[Samples, Any], Array]
    values: tuple[Any, ...]
    causal: bool = True


def ours() -> list[Estimator]:
    """Every angle observer over the search of its first gain."""
    found = []
    for entry in at_defaults():
        gains = declared(registry.find(registry.OBSERVERS, entry.observer).gains)
        sought = [each for each in gains.values() if each.search is not None]
        values: tuple[Any, ...] = (None,)
        if sought:
            low, high = sought[0].search or (1.0, 1.0)
            values = tuple(float(each) for each in np.geomspace(low, high, OURS_AT))
        found.append(Estimator(entry.label, _runner(entry, sought[0].name if sought else ''),
                               values))
    return found


def _runner(entry: Entry, gain: str) -> Callable[[Samples, Any], Array]:
    def estimate(samples: Samples, value: Any) -> Array:
        joint = entry.joint(**({gain: value} if gain else {}))
        return joint.run(samples.stamps, samples.angle, fast=True).velocity
    return estimate


def peers() -> tuple[list[Estimator], list[str]]:
    """(what is installed, what is not)."""
    found, missing = [], []
    for make in (_filterpy, _control, _pynumdiff):
        try:
            found += make()
        except ImportError as error:
            missing.append(error.name or str(error))
    return found, missing


def _filterpy() -> list[Estimator]:
    from filterpy.common import Q_discrete_white_noise
    from filterpy.kalman import KalmanFilter

    def estimate(samples: Samples, ratio: float) -> Array:
        angle, steps = np.unwrap(samples.angle), np.diff(samples.stamps) * 1e-9
        kalman = KalmanFilter(3, 1)
        kalman.x = np.array([[angle[0]], [0.0], [0.0]])
        kalman.H = np.array([[1.0, 0.0, 0.0]])
        kalman.R = np.array([[(2.0 * math.pi / 4096) ** 2 / 12.0]])
        kalman.P = np.diag([1e-6, 1e3, 1e5])
        velocity = np.zeros(len(angle))
        for i, h in enumerate(steps, 1):
            kalman.F = np.array([[1.0, h, 0.5 * h * h], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
            kalman.Q = Q_discrete_white_noise(3, dt=h, var=ratio)
            kalman.predict()
            kalman.update(angle[i])
            velocity[i] = kalman.x[1, 0]
        return velocity

    return [Estimator('filterpy Kalman, 3 states', estimate,
                      tuple(float(each) for each in np.geomspace(1e-2, 1e6, PEERS_AT)))]


def _control() -> list[Estimator]:
    import control

    def estimate(samples: Samples, ratio: float) -> Array:
        angle, h = np.unwrap(samples.angle), 1.0 / RATE  # its gain holds for one sample time
        a = np.array([[1.0, h, 0.5 * h * h], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
        g = np.array([[h ** 3 / 6.0], [h * h / 2.0], [h]])
        c = np.array([[1.0, 0.0, 0.0]])
        gain = np.asarray(control.dlqe(a, g, c, np.array([[ratio]]), np.array([[2e-7]]))[0])
        # dlqe's gain corrects before the step
        state, velocity = np.array([angle[0], 0.0, 0.0]), np.zeros(len(angle))
        correct = gain[:, 0]
        for i, reading in enumerate(angle):
            state = state + correct * (reading - state[0])
            velocity[i] = state[1]
            state = a @ state
        return velocity

    return [Estimator('python-control dlqe, 3 states', estimate,
                      tuple(float(each) for each in np.geomspace(1e3, 1e11, PEERS_AT)))]


def _pynumdiff() -> list[Estimator]:
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # of what else could be installed
        import pynumdiff
        from pynumdiff import butterdiff, rtsdiff
    assert pynumdiff

    def butter(samples: Samples, cutoff: float) -> Array:
        return butterdiff(np.unwrap(samples.angle), 1.0 / RATE, 2, cutoff)[1]

    def smoother(samples: Samples, ratio: float) -> Array:
        time = (samples.stamps - samples.stamps[0]) * 1e-9
        return rtsdiff(np.unwrap(samples.angle), time, 2, ratio)[1]

    return [Estimator('PyNumDiff butterdiff', butter,
                      tuple(float(each) for each in np.geomspace(0.004, 0.4, PEERS_AT)), False),
            Estimator('PyNumDiff rtsdiff', smoother,
                      tuple(float(each) for each in np.linspace(6.0, 14.0, PEERS_AT)), False)]


def run(estimators: Sequence[Estimator] | None = None, signals: Sequence[Signal] = SIGNALS
        ) -> dict[str, Any]:
    """The table as data: one row per estimator."""
    missing: list[str] = []
    if estimators is None:
        others, missing = peers()
        estimators = [*ours(), *others]
    drawn = {signal.name: signal.samples(duration=DURATION) for signal in signals}
    rows = []
    with progress('the field', sum(len(each.values) for each in estimators)) as advance:
        for each in estimators:
            errors = np.full((len(each.values), len(drawn)), np.inf)
            for i, value in enumerate(each.values):
                for j, samples in enumerate(drawn.values()):
                    errors[i, j] = _error(each, samples, value)
                advance(1)
            over = (errors + FLOOR) / (np.min(errors, axis=0) + FLOOR)
            one = int(np.argmin(np.mean(np.log(over), axis=1)))
            rows.append({
                'name': each.name, 'causal': each.causal, 'setting': each.values[one],
                'one': dict(zip(drawn, errors[one].tolist())),
                'best': dict(zip(drawn, np.min(errors, axis=0).tolist())),
                'best_at': dict(zip(drawn, [each.values[k] for k in np.argmin(errors, axis=0)]))})
    return {'signals': {signal.name: signal.summary for signal in signals}, 'rows': rows,
            'not_installed': missing}


def _error(estimator: Estimator, samples: Samples, value: Any) -> float:
    with np.errstate(all='ignore'):  # a gain that diverges is told as inf
        velocity = estimator.estimate(samples, value)
    time = (samples.stamps - samples.stamps[0]) * 1e-9
    counted = (time >= SKIPPED) & (time <= time[-1] - EDGE)
    error = (velocity - samples.velocity)[counted]
    if not np.isfinite(error).all() or np.max(np.abs(error)) > 1e100:
        return math.inf
    return float(np.sqrt(np.mean(error * error)))


def describe(found: dict[str, Any]) -> str:
    """The table as text: at one setting, and at the best of each column."""
    names = list(found['signals'])
    lines = [(row['name'] + ('' if row['causal'] else ' (looks ahead)'),
              *(f'{number(row["one"][name], 3)} | {number(row["best"][name], 3)}'
                for name in names)) for row in found['rows']]
    text = ('the field: velocity rms error [rad/s] at one setting | at the best of each column\n'
            + table(('estimator', *names), lines))
    if found['not_installed']:
        text += '\nnot run, not installed: ' + ', '.join(found['not_installed'])
    return text


def draw(found: dict[str, Any], path: str) -> None:
    """The chart: a column per signal, one colour per estimator."""
    check(path)
    import matplotlib
    from matplotlib.figure import Figure
    names = list(found['signals'])
    figure = Figure(figsize=(11.0, 5.5), layout='constrained')
    axis = figure.subplots()
    rows = found['rows']
    colours = matplotlib.colormaps['tab20']
    axis.set_prop_cycle('color', [colours(i) for i in (*range(0, 20, 2), *range(1, 20, 2))])
    for i, row in enumerate(rows):
        at = np.arange(len(names)) + (i - 0.5 * (len(rows) - 1)) * 0.8 / len(rows)
        one = [max(row['one'][name], 1e-6) for name in names]
        best = [max(row['best'][name], 1e-6) for name in names]
        label = row['name'] + ('' if row['causal'] else ' (looks ahead)')
        drawn = axis.plot(at, one, 'o' if row['causal'] else '^', markersize=6, label=label)
        axis.vlines(at, best, one, color=drawn[0].get_color(), linewidth=1)
        axis.plot(at, best, '_', markersize=8, color=drawn[0].get_color())
    axis.set_yscale('log')
    axis.set_ylim(bottom=1e-5)
    axis.set_xticks(range(len(names)), [
        f'{name}\n' + textwrap.fill(found['signals'][name], 20) for name in names],
                    fontsize='x-small')
    axis.set_ylabel('velocity rms error [rad/s]')
    axis.set_title('at one setting for all columns (marker) and at the best of each (bar)',
                   fontsize='medium')
    axis.grid(axis='y', alpha=0.3)
    figure.legend(loc='outside right center', fontsize='small')
    figure.savefig(path, dpi=120)
