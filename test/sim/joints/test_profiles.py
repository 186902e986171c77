# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The true motions: derivatives that fit together, and the values that their names promise."""

import math

import numpy as np
import pytest

from estimator_pkg.parameters import build, declared
from sim_pkg.joints.profiles import (
    NAMES,
    ProfileParameters,
    chirp,
    figure_4,
    figure_6,
    make_profile,
    pieces,
    smooth_random,
    steps,
)


def motion(profile, seed=0, **values):
    parameters = build(ProfileParameters, {'profile': profile, **values})
    return make_profile(parameters, np.random.default_rng(seed))


def profiles():
    yield from ((name, motion(name)) for name in NAMES)
    yield 'with offsets', motion('chirp', mean_velocity=3.0, start_angle=-7.0, sweep_time=2.0)
    yield 'downward chirp', chirp(1.0, 5.0, 0.5, 3.0)
    yield 'chirp of one frequency', chirp(1.0, 2.0, 2.0, 3.0)
    yield 'sawtooth of velocity', pieces([(1.5, -2.0, 5.0), (0.5, 5.0, -2.0)], repeat=True)


@pytest.mark.parametrize(('name', 'profile'), list(profiles()))
def test_derivatives_fit_numeric_differentiation(name, profile):
    step = 1e-5
    time = np.random.default_rng(1).uniform(0.0, 30.0, 4000)
    ends = [profile(time + shift) for shift in (-step, 0.0, step)]
    # where the acceleration jumps within the step, the difference straddles two pieces
    smooth = np.abs(ends[2][2] - ends[0][2]) <= 1e-2 * np.abs(ends[1][2]).max()
    assert smooth.mean() > 0.99
    (before, velocity_before, _), (_, velocity, acceleration), (after, velocity_after, _) = ends
    scale = 1.0 + np.abs(velocity).max()
    assert np.abs((after - before) / (2 * step) - velocity)[smooth].max() < 2e-5 * scale
    scale = 1.0 + np.abs(acceleration).max()
    numeric = (velocity_after - velocity_before) / (2 * step)
    assert np.abs(numeric - acceleration)[smooth].max() < 2e-5 * scale


@pytest.mark.long
@pytest.mark.parametrize(('name', 'profile'), list(profiles()))
def test_position_is_continuous_and_any_time_can_be_asked_for(name, profile):
    time = np.linspace(0.0, 40.0, 100_001)
    position, velocity, _ = profile(time)
    travelled = np.diff(position)
    assert np.abs(travelled).max() <= 4.004e-4 * np.abs(velocity).max() + 1e-9
    backwards = [column[::-1] for column in profile(time[::-1])]
    np.testing.assert_array_equal(position, backwards[0])
    np.testing.assert_array_equal(velocity, backwards[1])
    assert np.isfinite(profile(np.array([-0.01]))[0]).all()  # a jittered stamp before the start


@pytest.mark.parametrize('acceleration', [0.0, 25.0])
def test_steps_visit_every_level_with_the_given_acceleration(acceleration):
    profile = steps(8.0, acceleration, 0.5)
    cycle = 16 * (0.5 + (2.0 / acceleration if acceleration else 0.0))
    _, velocity, slope = profile(np.linspace(0.0, cycle, 16_000, endpoint=False))
    levels, counts = np.unique(np.round(velocity[slope == 0.0], 9), return_counts=True)
    np.testing.assert_allclose(levels, np.linspace(-8.0, 8.0, 9))
    inner = counts[1:-1]
    assert inner.max() - inner.min() <= 4  # visited twice each, the two ends once
    assert set(np.unique(slope)) == ({0.0} if acceleration == 0.0 else {-25.0, 0.0, 25.0})


@pytest.mark.long
def test_chirp_sweeps_between_its_frequencies_and_back():
    profile = chirp(1.0, 0.5, 8.0, 10.0)
    time = np.linspace(0.0, 40.0, 2_000_001)
    position = profile(time)[0]
    rising = time[1:][(position[:-1] < 0.0) & (position[1:] >= 0.0)]
    frequency = 1.0 / np.diff(rising)
    middle = 0.5 * (rising[1:] + rising[:-1])

    def expected(at):
        within = at % 20.0
        return 0.5 * 16.0 ** ((10.0 - abs(within - 10.0)) / 10.0)

    turning = np.abs(middle % 10.0 - 5.0) > 4.0  # a period is not short against the turn
    np.testing.assert_allclose(frequency[~turning], expected(middle[~turning]), rtol=0.01)
    assert np.abs(position).max() == pytest.approx(1.0, abs=1e-6)


def test_paper_figures():
    """Spec 1, section 4: the profiles of Figures 4 and 6."""
    _, velocity, acceleration = figure_4()(np.array([0.0, 1.999, 2.025, 2.05, 8.0, 100.0]))
    np.testing.assert_allclose(velocity, [10.0, 10.0, -5.0, -20.0, -20.0, -20.0])
    assert acceleration[2] == pytest.approx(-600.0)
    assert figure_4()(np.array([8.0]))[0][0] == pytest.approx(20.0 - 0.25 - 119.0)
    for decay in (0.15, 0.05):
        time = np.array([0.0, 0.5, 4.999999, 5.0, 5.0 + decay])
        position, velocity, acceleration = figure_6(decay)(time)
        top = 150.0 * (1.0 - math.exp(-10.0))
        np.testing.assert_allclose(
            velocity, [0.0, 150.0 * (1.0 - math.exp(-1.0)), top, top, top / math.e], rtol=1e-6
        )
        assert acceleration[0] == pytest.approx(300.0)
        assert acceleration[3] == pytest.approx(-150.0 / decay, rel=1e-4)
        assert position[3] == pytest.approx(150.0 * (5.0 - 0.5 * (1.0 - math.exp(-10.0))))


def test_random_motion_keeps_to_its_band_and_rms():
    profile = smooth_random(4.0, 2.0, np.random.default_rng(3))
    time = np.arange(0.0, 400.0, 0.01)
    position, velocity, _ = profile(time)
    assert position[0] == pytest.approx(0.0, abs=1e-9)
    assert np.sqrt(np.mean(velocity**2)) == pytest.approx(4.0, rel=0.05)
    spectrum = np.abs(np.fft.rfft(velocity * np.hanning(len(velocity)))) ** 2
    frequency = np.fft.rfftfreq(len(velocity), 0.01)
    assert spectrum[frequency > 2.01].sum() < 1e-6 * spectrum.sum()
    for low in (0.0, 0.5, 1.0, 1.5):  # and fills it
        part = spectrum[(frequency >= low) & (frequency < low + 0.5)].sum() / spectrum.sum()
        assert part == pytest.approx(0.25, abs=0.05)


def test_every_profile_parameter_matters():
    """A declared parameter that no profile reads would be a lie."""
    time = np.linspace(0.1, 30.0, 500)
    for name, parameter in declared(ProfileParameters).items():
        if name == 'profile':
            continue
        other = {name: parameter.default * 1.5 + 0.5}
        changed = [
            profile
            for profile in NAMES
            if np.abs(motion(profile)(time)[0] - motion(profile, **other)(time)[0]).max() > 1e-3
        ]
        assert changed, name
