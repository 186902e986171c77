# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

# ruff: noqa: E501, RUF001 (a page of the documentation stands here as it is printed)
"""The standard deviation beside an estimate: right at constant speed, measured in motion.

    PYTHONPATH=test python test/observers/angle/test_stddev.py > docs/coverage.md

writes the table of what the 95 % interval covers in motion; a test holds the table to that.
"""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from observer_cases import label, make, stamps, tunable_variants, variants, wrapped
from test_frequency_response import CASES, DT, bandwidths, joint_of

from estimator_pkg.observers.contract import TRACKING

TABLE = Path(__file__).parents[3] / 'docs' / 'coverage.md'
NOISE = 1e-3


def constant(t):
    return 3.0 * t, np.full(len(t), 3.0)


def slow_sine(t):
    w = 2.0 * math.pi
    return np.sin(w * t), w * np.cos(w * t)


def fast_sine(t):
    w = 10.0 * math.pi
    return 0.2 * np.sin(w * t), 0.2 * w * np.cos(w * t)


def trapezoid(t):
    """+-10 rad/s, with 100 rad/s^2 between: a period of 1 s."""
    velocity = np.clip(40.0 * np.abs((t - 0.125) % 1.0 - 0.5) * 2.5 - 25.0, -10.0, 10.0)
    return np.cumsum(velocity) * (t[1] - t[0]), velocity


def covered(name, gains, profile, seed, count=40_000):
    """Part of the tracked samples whose 95 % interval holds the true velocity, and their number."""
    t = np.arange(count) * DT
    position, velocity = profile(t)
    joint = make(name, gains)
    measured = position + np.random.default_rng(seed).normal(0.0, NOISE, count)
    out = joint.run(stamps(count, DT), wrapped(measured))
    tracked = out.status == TRACKING
    error = np.abs(out.velocity - velocity)[tracked]
    return float(np.mean(error < 1.96 * out.velocity_stddev[tracked])), int(tracked.sum())


def few_counts(name, gains, counts, speed):
    """The errors [rad/s] and what sigma covers at a constant speed, `counts` per turn, 1 kHz."""
    quantum, count = 2.0 * math.pi / counts, 2000
    read = wrapped(np.floor((speed * DT * np.arange(count) + 0.1) / quantum) * quantum)
    out = make(name, gains).run(stamps(count, DT), read)
    error = np.abs(out.velocity - speed)[count // 2 :]
    return error, np.mean(error < 1.96 * out.velocity_stddev[count // 2 :])


LEAST_OF_FEW = {'kalman': 0.5, 'super_twisting': 0.35}  # their errors last from edge to edge


@pytest.mark.parametrize('counts', [4, 6])
@pytest.mark.parametrize('speed', [20.0, 200.0])
@pytest.mark.parametrize('variant', variants(), ids=label)
def test_an_edge_further_than_an_eighth_of_a_turn_is_no_outlier(variant, speed, counts):
    """The interval of hybrid_angle never covered the speed of such a sensor, at 20 rad/s."""
    name, gains = variant
    _, part = few_counts(name, gains, counts, speed)
    assert part > LEAST_OF_FEW.get(name, 0.8)


@pytest.mark.parametrize('counts', [4, 7])
def test_the_hybrid_observer_follows_few_counts_that_it_is_told(counts):
    """It held its speed at each edge before, and was wrong by 370 to 520 rad/s."""
    error, _ = few_counts('hybrid_angle', {'quantum': 2.0 * math.pi / counts}, counts, 200.0)
    assert np.sqrt(np.mean(error * error)) < 50.0


@pytest.mark.long
@pytest.mark.parametrize('given', [True, False], ids=['noise given', 'noise estimated'])
@pytest.mark.parametrize('variant', tunable_variants(), ids=label)
def test_interval_covers_at_constant_speed(variant, given):
    name, gains = variant
    gains = {**gains, 'noise': NOISE} if given else gains
    # estimates are alike over about ten samples: 40 000 of them are worth 4000 independent ones,
    # which know the coverage to 0.35 %
    part, tracked = covered(name, gains, constant, seed=1)
    assert tracked > 39_000
    assert 0.93 <= part <= 0.97


@pytest.mark.parametrize(
    'variant',
    [
        variant
        for variant in tunable_variants()
        if variant[0] in ('finite_difference', 'hybrid_angle', 'pll')
    ],
    ids=label,
)
def test_noise_that_is_estimated_is_steady_and_follows_a_change(variant):
    """White noise, twice as large from sample 8000 on: the standard deviation scatters by 2 to 3 %
    before, and has followed within 800 samples.
    """
    count = 10_000
    noise = np.random.default_rng(3).normal(0.0, NOISE, count)
    noise[8000:] *= 2.0
    measured = 3e-3 * np.arange(count) + noise
    sigma = make(*variant).run(stamps(count, 1e-3), wrapped(measured)).velocity_stddev
    before = sigma[2000:8000]
    assert np.std(before) < 0.04 * np.mean(before)
    assert 1.1 < sigma[8100] / np.mean(before) < 1.5
    assert 1.75 < sigma[8800] / np.mean(before) < 2.2


@pytest.mark.parametrize(
    'name, gains, form, bandwidth',
    [
        (name, gains, form, bandwidths(gains)[-1])
        for name, cases in CASES.items()
        for gains, form in cases
    ],
)
def test_velocity_stddev_is_the_power_of_the_response_to_white_noise(name, gains, form, bandwidth):
    """Parseval: the variance is the mean of |V/Y|^2 over the unit circle."""
    closed = form(bandwidth, DT)
    points = np.exp(2j * math.pi * (np.arange(2000) + 0.5) / 2000)
    expected = math.sqrt(np.mean([abs(closed(z)) ** 2 for z in points]))
    noise = gains.get('noise', NOISE)
    joint = joint_of(name, {**gains, 'noise': noise}, bandwidth)
    joint.run(stamps(2000, DT), np.zeros(2000))
    joint.update(joint.stamp_ns + 10**6, 1e-9)  # a change, so that no low-speed bound stands
    white = math.hypot(noise, gains.get('quantum', 0.0) / math.sqrt(12.0))
    assert joint.stddev()[1] == pytest.approx(expected * white, rel=1e-3)


@pytest.mark.long
@pytest.mark.parametrize('variant', tunable_variants(), ids=label)
def test_position_stddev_covers(variant):
    name, gains = variant
    joint = make(name, {**gains, 'noise': NOISE})
    count = 40_000
    measured = 1.0 + np.random.default_rng(5).normal(0.0, NOISE, count)
    out = joint.run(stamps(count, DT), measured)
    tracked = out.status == TRACKING
    inside = np.abs(out.position[tracked] - 1.0) < 1.96 * out.position_stddev[tracked]
    assert 0.93 <= np.mean(inside) <= 0.97


STARTS = r"""
Without the calibration, the last two columns were 30 % and 87 % for `hybrid_angle`, and 18 % and 81 % for
`kalman`. On recordings, coverage, width and interval score stand in [the benchmarks](benchmarks.md#the-interval).

## Calibration

The speed at an instant is known better when later readings have come. Five instants are h apart, with the
readings $`y_{-2}`$ to $`y_2`$. The polynomial through them has at the middle one the derivative

```math
\hat v = \frac{y_{-2} - 8 y_{-1} + 8 y_1 - y_2}{12 h}, \qquad
\operatorname{var} \hat v = \frac{130}{144} \frac{R}{h^2} \tag{3}
```

where R is the variance of the readings' noise. (The code uses the true times of the samples, which need not be
even.) The published speed $`\omega`$ had the standard deviation σ there. Then

```math
z = \frac{(\omega - \hat v)^2 - \operatorname{var} \hat v}{\sigma^2} \tag{4}
```

has the mean M, the mean square of the observer's own error in units of σ². M is averaged over 24 instants, each
weighted by $`(M/(M + \operatorname{var} \hat v/\sigma^2))^2`$, because the noise of (3) hides small errors. One z
counts at most 9 of its means. The published σ is multiplied by $`\sqrt{M - 0.25}`$ where that exceeds 1. It is
never made smaller than the observer's own, nor larger than the low-speed bound where it applies. Chance rarely makes
M exceed 1.25 when σ is right. The terms (1), (2) and (5) of a start are not scaled, because they contain the lag.

- **R** is the mean of $`(\Delta y_k - \Delta y_{k-1})^2/6`$ over pairs of neighbouring samples, and at least
  quantum²/12. The quantum is the smallest step, or the smallest difference of two, that was seen. These differences
  contain motion: a vibration of 60 Hz sampled at 300 Hz looks like noise of 0.4 times its amplitude, in fourth
  differences 0.16 times. So R is at most the mean of $`(\Delta^4 y)^2/70`$ over 96 sets of five instants, if
  that is less than half. White noise has the same mean in both. The fourth begins at twice the mean of the second
  differences, which few readings do not show, and does not lower R below quantum²/6, which single steps of a slow
  joint show.
- **h** is between 4 and 256 ms, and at least a sample time. It is doubled after 8 instants if var v̂ exceeds
  0.3 M σ². It is halved where the fourth difference of the readings exceeds 10 times its part from noise: there,
  five readings do not resolve the motion. It is doubled after 8 instants in which the reading hardly changes, and
  returns to 4 ms where a rest ends with more than four quanta in one h.
- **A vibration** looks like noise at a long h, and makes R too large. So h returns to 4 ms after 32 instants. It is
  not doubled while the mean of $`(\omega - \hat v)^2`$ at this h exceeds 1.5 times what M and the noise explain.
- **Gaps**, restarts, instants of which one is 2.5 times farther away than the next, and samples of an observer that
  does not track begin a new set of five instants. M stays.

A change of motion shows in the innovation before it shows here. Its mean square over 32 samples exceeds twice that
over 400 only by chance; what is beyond is added to the noise's variance, except in a start (below). Where the mean
over 400 exceeds 16 times that over 32, an outlier is over, and 32 samples are averaged again. This holds for
all observers but `edge_adaptive`, whose own variance follows its innovations.

The calibration runs in the driver at every instant, subscribed or not, decimated or recursive. It changes no
estimate. An instant costs about two updates, and there is one in 10 to 90 samples at 1 kHz.

Adaptive conformal inference (Gibbs and Candes 2021) was tried on the same references: M is raised by each error
outside the interval and lowered by each inside, for 5 % outside. The score was the same at the slowest rate
(0.01), and worse the faster it followed: the interval was wider by chance where it was right before.

Limitations:

- The error of the sensor itself is in the readings, and so in (3). A hum of 50 Hz or 2 mrad of eccentricity is
  covered as little as before, where the observer follows it.
- A change of motion is seen 2 h later, 8 to 500 ms. Until then the interval is that of the motion before.
- Where h must be long (creep, few counts) there are few instants: the first seconds are not calibrated.
- Vibration above 60 Hz at 4 ms is not resolved, and may make the interval wider than needed. Below that, bursts of
  it shorter than 0.3 s are found late: at 300 Hz, bursts of 61 Hz for 0.15 s are covered to 72 % (`kalman`).
- Errors that come in bursts are covered too little. Against the off-line reference `edge_adaptive` covers 71 and 75 % on
  the two joints of `trajectory_665hz`, 67 % on `sac_200hz_multiturn`, 79 % on one joint of `sys_id_500hz`, and 90 to
  100 % on the other joints (`evaluate BAG --reference smoother`). `kalman` covers 75 to 86 % on those four,
  `finite_difference` 90 to 95 %.
- White motion, which changes from sample to sample, is taken for noise of the readings (`odrive_noise*` of the
  [held-out recordings](held_out.md)).

## Where motion begins

Readings that repeat show neither noise nor motion. Three rules follow for every angle observer except
`edge_adaptive`, which has a covariance of its own.

**Before the first change.** Without `quantum` and `noise`, the variance is that of the resolution of a
float32, because no reading is known to be finer. With `quantum`, it is quantum²/12 as everywhere.

**At rest after motion.** Without `quantum`, the variance is at least the square of the smallest step
seen, divided by 400: one such innovation within the memory of the mean. The low-speed bound applies as
before: a reading unchanged for a time T allows no more than one step per T.

**A start.** A joint rests when its readings stay within 3.2 standard deviations of one angle for 0.12 s.
Until then the noise is also that of the changes of the reading, half their mean square: readings that only go one
way are a motion, however large the innovations of a lagging observer are.
The first reading outside ends the rest, and so do the first sample and a gap. So does a reading farther from
that angle than every one of the rest, once none was so for 0.12 s and 12 samples. A reading that is back in the noise
makes it a rest again, if it repeats, or if the speed is within two standard deviations of the noise; else the
motion may have begun with this reading. From then on the error of
the observer is that of a linear loop whose input was at rest until the time t ago. Its poles are at
about w, with nepers x = w t. The angle c since then is measured, so the speed is between c/t (a step of
speed) and 2 c/t (a ramp). In a third-order loop with three poles at w, a step of speed d and a ramp of
acceleration a cause the errors

```math
d\,(1 + x - x^2)\,e^{-x}, \qquad a\,t\,(1 + x)\,e^{-x}
```

of the velocity. Five times $`\sigma_1`$ covers both:

```math
\sigma_1 = \frac{c}{t}\,(1 + x + x^2)\,e^{-1.18 x} \tag{1}
```

Across a gap, the speed that was kept replaces 2 c/t, if it is larger. The acceleration may change at any
time in a start, and a loop of second order lags during the whole ramp. With the acceleration
2 (v - c/t)/t from the estimated velocity v, the error is at most 0.84 (order 3) to 1.4 (order 2, low-pass)
accelerations over w. Five times

```math
\sigma_2 = 2 \lambda \left\lvert v - \frac{c}{t} \right\rvert \frac{1}{\max(1, x)} \tag{2}
```

cover it, with λ = 0.2 for order 3, 0.36 for order 2, 0.4 for the low-pass. The paper's form has the pace of its
slowest pole, and λ is 0.36 times its lag behind a ramp. From x = 6 on, (1) no longer covers that the motion may
have begun up to 0.75 sample times earlier than assumed (below). This changes c/t by 0.75 Δt/t of itself, which is
added to the difference in (2). Without it, (2) was nearly zero when v passed c/t.

A ramp may pass a speed of a whole number of quanta q per sample. The readings then repeat one step, and the
observer follows that speed. With the acceleration a, its error is $`\sqrt{2 q a}`$ when the missing quantum comes.
From x = 6 on,

```math
\sigma_3 = \frac{1}{5} \sqrt{2 q a} = \frac{1}{5} \sqrt{\frac{4 q}{t} \left\lvert v - \frac{c}{t} \right\rvert} \tag{5}
```

is added where v is nearer to such a speed than this error, if the error is less than q w. The difference is that
of (2). In a faster ramp the steps change within two time constants of the observer, which averages them like noise.
The motion may have begun anywhere in the last sample time before the first changed reading, so t starts
there at a quarter of a sample time, and at a twentieth at the first reading, which shows no speed. The published variance is that of the noise, plus the squares of (1),
(2) and (5), until x = 10 and t = 0.25 s.

The pace w follows from the noise gain: a loop with all poles at w lets through a velocity variance
proportional to w³ Δt. For `super_twisting` it is that of its error dynamics, (L/|e|)^(1/(n+1)),
where |e| is the mean of the innovations or the newest few, if these are larger. It is at most one neper per sample.
Innovations before x = 6 are those of the transient and do not enter the noise. Without `quantum`, the variance in
the first 0.25 s of a start is at least that of the smallest step, or difference of two steps, that was seen: a speed of
nearly a whole number of counts per sample repeats one step and shows no noise.

**How soon it is calm.** At 40 rad/s², 4096 counts and 1 kHz the standard deviation is below twice its steady
value within 20 changed readings: `hybrid_angle` (orders 2 and 3), `pll`, `finite_difference` and `kalman` with
constant velocity. Three take longer, and so does their own error. Their rms error over 30 phases of the
start, in steady standard deviations:

| observer | at reading 20 | largest after it (the end of the ramp) | above 2 until reading | sigma above 2 until reading |
|---|---|---|---|---|
| `kalman`, quantum found | 2.1 | 11.4 | 74 | 80 |
| `kalman`, quantum set | 1.6 | 9.7 | 71 | 69 |
| `super_twisting`, both | 1.4 | 3.6 | 58 | 49 |
| `hybrid_angle`, form: paper, both | 7.8 | 8.1 | 55 | 62 |

No reading shows the end of the ramp before it comes. With a standard deviation of 2 before it, the error of
`kalman` would be 5.7 of them (quantum found) and 4.8 (quantum set). `super_twisting` does not need its
width between readings 20 and 46: the bound (1) falls more slowly than the error of its smallest transients.

Limitations: a start is not covered before its first reading outside the noise. A change of speed without
a rest before it is not a start. `python test/sigma_starts.py` prints the largest |error|/σ of every
observer, over the profiles of the simulator, four rates, three resolutions and four noise levels.
"""


MOTIONS = {
    'constant 3 rad/s': constant,
    'sine 1 rad, 1 Hz': slow_sine,
    'sine 0.2 rad, 5 Hz': fast_sine,
    'trapezoid 10 rad/s, 100 rad/s^2': trapezoid,
}
HEAD = f"""# Coverage of the 95 % interval

The standard deviation of an estimate begins as that of the measurement noise behind the observer, which
does not contain the lag behind a motion. Later readings show the lag, and [scale](#calibration) the
standard deviations that follow. The 95 % interval is ±1.96 of them.

The table has the covered part of the samples that were `tracking`. It was measured in simulation:
1 kHz, white noise of {NOISE * 1e3:g} mrad, noise estimated from the stream, and defaults except for
the parameters in the first column. `PYTHONPATH=test python test/observers/angle/test_stddev.py > docs/coverage.md`
makes it.

"""


def measured_row(variant):
    name, gains = variant
    return [covered(name, gains, profile, seed=1, count=10_000)[0] for profile in MOTIONS.values()]


def table():
    rows = [f'| observer | {" | ".join(MOTIONS)} |', '|---' * (len(MOTIONS) + 1) + '|']
    for variant in variants():
        cells = ' | '.join(f'{100.0 * part:.1f} %' for part in measured_row(variant))
        rows.append(f'| {described(variant)} | {cells} |')
    return HEAD + '\n'.join(rows) + '\n' + STARTS


def described(variant):
    name, gains = variant
    return ', '.join((f'`{name}`', *(f'{key}: {value}' for key, value in gains.items())))


@pytest.mark.long
@pytest.mark.parametrize('variant', variants(), ids=label)
def test_table_of_coverage_is_current(variant):
    lines = [
        line
        for line in TABLE.read_text().splitlines()
        if line.startswith(f'| {described(variant)} |')
    ]
    assert len(lines) == 1, (
        'write the table anew: PYTHONPATH=test python test/observers/angle/test_stddev.py > docs/coverage.md'
    )
    written = [float(number) / 100.0 for number in re.findall(r'([\d.]+) %', lines[0])]
    assert written == pytest.approx(measured_row(variant), abs=0.02)


if __name__ == '__main__':
    print(table(), end='')
