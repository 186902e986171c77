# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""True motions in closed form: position, velocity and acceleration, exact at any time.

Stamps are irregular, so nothing is integrated: each profile is a function of time only.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.parameters import structural

Array = NDArray[np.float64]
Motion = tuple[Array, Array, Array]  # position [rad], velocity [rad/s], acceleration [rad/s^2]
Profile = Callable[[Array], Motion]  # times [s], shape (n,) -> three arrays of shape (n,)


SINES = 32  # number of sines in the random motion
# The levels of the velocity staircase, as fractions of the largest velocity.
STAIRS = (
    0.0,
    0.25,
    0.5,
    0.75,
    1.0,
    0.75,
    0.5,
    0.25,
    0.0,
    -0.25,
    -0.5,
    -0.75,
    -1.0,
    -0.75,
    -0.5,
    -0.25,
)
NAMES = ('constant', 'sine', 'trapezoid', 'chirp', 'steps', 'figure_4', 'figure_6', 'random')


@dataclass(frozen=True)
class ProfileParameters:
    """How the shaft moves."""

    profile: str = structural(
        'sine',
        choices=NAMES,
        description='the true motion; figure_4 and figure_6 are those of the hybrid-angle paper',
    )
    velocity: float = structural(
        10.0,
        unit='rad/s',
        range=(-1e5, 1e5),
        description='constant: the velocity; trapezoid and steps: the largest velocity; '
        'random: the rms velocity',
    )
    acceleration: float = structural(
        50.0,
        unit='rad/s^2',
        range=(0.0, 1e7),
        description='trapezoid and steps: acceleration between two velocities; 0: jump',
    )
    hold_time: float = structural(
        1.0, unit='s', range=(0.001, 1e5), description='trapezoid and steps: time at each velocity'
    )
    amplitude: float = structural(
        5.0, unit='rad', range=(0.0, 1e6), description='sine and chirp: amplitude of the position'
    )
    frequency: float = structural(
        0.3,
        unit='Hz',
        range=(1e-4, 1e4),
        description='sine: its frequency; chirp: start of the sweep; random: upper end of the '
        'velocity band',
    )
    frequency_end: float = structural(
        5.0, unit='Hz', range=(1e-4, 1e4), description='chirp: frequency at which the sweep turns'
    )
    sweep_time: float = structural(
        20.0,
        unit='s',
        range=(0.001, 1e5),
        description='chirp: time from frequency to frequency_end, the same for each octave; then '
        'it sweeps back, and repeats',
    )
    mean_velocity: float = structural(
        0.0, unit='rad/s', range=(-1e5, 1e5), description='added to the velocity of every profile'
    )
    start_angle: float = structural(
        0.0, unit='rad', range=(-1e6, 1e6), description='position at the start'
    )


def constant(velocity: float) -> Profile:
    """Return a profile with a constant `velocity` [rad/s]."""
    return pieces([(1.0, velocity, velocity)])


def sine(amplitude: float, frequency: float) -> Profile:
    """Return a profile whose position is `amplitude` [rad] times a sine of `frequency` [Hz]."""
    omega = 2.0 * math.pi * frequency

    def motion(time: Array) -> Motion:
        position = amplitude * np.sin(omega * time)
        return position, amplitude * omega * np.cos(omega * time), -omega * omega * position

    return motion


def pieces(parts: Sequence[tuple[float, float, float]], *, repeat: bool = False) -> Profile:
    """Return a profile with a piecewise linear velocity.

    Parameters
    ----------
    parts : (duration [s], first velocity, last velocity [rad/s]) of each piece. The velocity may
        jump between two pieces and has the later value there. Pieces of zero duration are skipped.
    repeat : start again after the last piece; else the last piece is extrapolated.
    """
    durations, first, last = np.array([part for part in parts if part[0] > 0.0]).T
    ends = np.cumsum(durations)
    starts = ends - durations
    slopes = (last - first) / durations
    travelled = np.cumsum(0.5 * (first + last) * durations)
    passed = travelled - 0.5 * (first + last) * durations

    def motion(time: Array) -> Motion:
        cycle = np.floor(time / ends[-1]) if repeat else np.zeros_like(time)
        within = time - cycle * ends[-1]
        piece = np.clip(np.searchsorted(starts, within, side='right') - 1, 0, None)
        since = within - starts[piece]
        slope = slopes[piece]
        position = passed[piece] + (first[piece] + 0.5 * slope * since) * since
        return position + cycle * travelled[-1], first[piece] + slope * since, slope.copy()

    return motion


def trapezoid(velocity: float, acceleration: float, hold_time: float) -> Profile:
    """Return: rest, `velocity`, rest, minus `velocity`, each for `hold_time` [s], repeated."""
    return _held((0.0, velocity, 0.0, -velocity), acceleration, hold_time)


def steps(velocity: float, acceleration: float, hold_time: float) -> Profile:
    """Return a staircase of velocities up to `velocity`, down to minus it, repeated."""
    return _held([part * velocity for part in STAIRS], acceleration, hold_time)


def _held(levels: Sequence[float], acceleration: float, hold_time: float) -> Profile:
    parts = []
    for level, following in zip(levels, [*levels[1:], levels[0]]):
        ramp = abs(following - level) / acceleration if acceleration > 0.0 else 0.0
        parts += [(hold_time, level, level), (ramp, level, following)]
    return pieces(parts, repeat=True)


def chirp(amplitude: float, first: float, last: float, sweep_time: float) -> Profile:
    """Return a sine of `amplitude` [rad] that sweeps from `first` to `last` [Hz] and back.

    The logarithm of the frequency is linear in time. Position and velocity are continuous where
    the sweep turns.
    """
    octaves = math.log(last / first)
    slope = octaves / sweep_time
    # phase [rad] of one sweep, in closed form: 2 pi first (exp(slope t) - 1) / slope
    one_way = (
        2.0 * math.pi * first * sweep_time * (math.expm1(octaves) / octaves if octaves else 1.0)
    )

    def sweep(start: float, time: Array, rate: float) -> tuple[Array, Array]:
        grown = np.expm1(rate * time) / rate if rate else time
        return 2.0 * math.pi * start * grown, 2.0 * math.pi * start * np.exp(rate * time)

    def motion(time: Array) -> Motion:
        cycle = np.floor(time / (2.0 * sweep_time))
        within = time - cycle * 2.0 * sweep_time
        back = within >= sweep_time
        up, up_rate = sweep(first, within, slope)
        down, down_rate = sweep(last, within - sweep_time, -slope)
        phase = np.where(back, one_way + down, up) + cycle * 2.0 * one_way
        omega = np.where(back, down_rate, up_rate)
        alpha = np.where(back, -slope, slope) * omega
        sin, cos = np.sin(phase), np.cos(phase)
        return (
            amplitude * sin,
            amplitude * omega * cos,
            amplitude * (alpha * cos - omega * omega * sin),
        )

    return motion


def figure_4() -> Profile:
    """Return 10 rad/s to 2 s, linear to -20 rad/s at 2.05 s, then constant (the figure: to 8 s)."""
    return pieces([(2.0, 10.0, 10.0), (0.05, 10.0, -20.0), (1.0, -20.0, -20.0)])


def figure_6(decay_time: float = 0.15) -> Profile:
    """Return 150 (1 - exp(-t / 0.5)) rad/s to 5 s, then a decay with `decay_time` [s]."""
    top, rise, switch = 150.0, 0.5, 5.0
    reached = top * -math.expm1(-switch / rise)
    travelled = top * (switch + rise * math.expm1(-switch / rise))

    def motion(time: Array) -> Motion:
        out = time >= switch
        rising = np.exp(-np.minimum(time, switch) / rise)
        falling = np.exp(-(np.maximum(time, switch) - switch) / decay_time)
        position = np.where(
            out,
            travelled + reached * decay_time * (1.0 - falling),
            top * (time - rise * (1.0 - rising)),
        )
        velocity = np.where(out, reached * falling, top * (1.0 - rising))
        acceleration = np.where(out, -reached / decay_time * falling, top / rise * rising)
        return position, velocity, acceleration

    return motion


def smooth_random(velocity: float, bandwidth: float, random: np.random.Generator) -> Profile:
    """Return a random motion from 0 rad with no velocity content above `bandwidth` [Hz].

    Parameters
    ----------
    velocity : rms over a long time [rad/s].
    random : draws the phases, and one frequency from each of `SINES` equal parts of the band.
    """
    chosen = (np.arange(SINES) + 0.1 + 0.8 * random.random(SINES)) / SINES
    omega = 2.0 * math.pi * bandwidth * chosen
    phase = 2.0 * math.pi * random.random(SINES)
    size = velocity * math.sqrt(2.0 / SINES)
    offset = size * np.sum(np.cos(phase) / omega)

    def motion(time: Array) -> Motion:
        angle = time[:, None] * omega + phase
        sin, cos = np.sin(angle), np.cos(angle)
        return (
            offset - size * np.sum(cos / omega, axis=1),
            size * np.sum(sin, axis=1),
            size * np.sum(omega * cos, axis=1),
        )

    return motion


def make_profile(
    parameters: ProfileParameters, random: np.random.Generator, *, ratio: float = 1.0
) -> Profile:
    """Return the motion that the parameters describe.

    Parameters
    ----------
    random : generator for the random profile; the other profiles do not draw from it.
    ratio : scales the motion relative to the start angle.
    """
    p = parameters
    profile = {
        'constant': lambda: constant(p.velocity),
        'sine': lambda: sine(p.amplitude, p.frequency),
        'trapezoid': lambda: trapezoid(p.velocity, p.acceleration, p.hold_time),
        'chirp': lambda: chirp(p.amplitude, p.frequency, p.frequency_end, p.sweep_time),
        'steps': lambda: steps(p.velocity, p.acceleration, p.hold_time),
        'figure_4': figure_4,
        'figure_6': figure_6,
        'random': lambda: smooth_random(p.velocity, p.frequency, random),
    }[p.profile]()

    def motion(time: Array) -> Motion:
        position, velocity, acceleration = profile(time)
        return (
            p.start_angle + ratio * (position + p.mean_velocity * time),
            ratio * (velocity + p.mean_velocity),
            ratio * acceleration,
        )

    return motion
