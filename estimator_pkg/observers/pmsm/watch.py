"""What the sensorless observer knows of its own truth: residuals, and the reasons they give.

All is computed from internal signals. What no residual can see: an error of the inductance, a delay
of the voltage, a constant bias of the angle (docs/papers/pmsm.md says how large).
"""

from __future__ import annotations

import math

# Reasons, as bits. An estimate counts only after none of them was there for the hold time.
LOW_EMF = 1  # back-EMF too small against noise, resistance drop and the least that counts
MISALIGNED = 2  # the back-EMF does not lie where the frame says
INCONSISTENT = 4  # the estimated speed is not the speed at which the back-EMF turns
FLUX_RANGE = 8  # the flux linkage is outside the range to believe
RESET = 16  # the frame or the flux was reset just now
SEARCHING = 32  # start, gap, or the rotor has only just become observable
NO_VOLTAGE = 64  # all voltages are exactly zero: not connected
TOO_FAST = 128  # the rotor turns about half a turn per sample, or more
BLIND = LOW_EMF | NO_VOLTAGE | TOO_FAST

REASONS = {
    NO_VOLTAGE: 'all voltages are zero: is the voltage connected?',
    TOO_FAST: 'the rotor turns about half an electrical turn per sample or more: '
    'a higher sample rate is needed (it counts again after standstill or ~/reset)',
    LOW_EMF: 'back-EMF too small (slow or at rest): only a bound of the speed is known',
    SEARCHING: 'finding the rotor',
    RESET: 'frame or flux was reset',
    FLUX_RANGE: 'flux linkage outside its range (wrong resistance, voltage or motor data?)',
    MISALIGNED: 'the back-EMF is not where the estimated angle says',
    INCONSISTENT: 'the estimated speed is not the speed at which the back-EMF turns',
}

ALIGNED = math.tan(math.radians(8.0))  # the frame may be so far off the back-EMF
CONSISTENT = 0.05  # relative disagreement of the two speeds
LEAST_DISAGREEMENT = 0.05  # of the speed at the smallest back-EMF, beside the noise
SIGMAS = 0.9  # noise allowed in the disagreement, of the noise in the least back-EMF
TINY = 1e-300  # keeps a quotient finite
LEAST_EMF = 5.0  # standard deviations of h that the back-EMF must exceed
LEAVES = 2.0  # it must be so many times larger to count again
HALF_TURN = 0.85  # of half a turn per sample: too near to aliasing
RUN_AWAY = 4.0  # xi_hat so many times out of range begins again
UNCONNECTED = 0.010  # s of exactly zero voltage
CLIP = 16.0  # an innovation counts in the noise at most as so many variances

# (level of |h| [V], h averaged [V], mean speed at which y turns [rad/s], mean disagreement [rad/s],
#  variance of the innovation [A^2], time at zero voltage [s], time in order [s], reasons)
Watch = tuple[float, complex, float, float, float, float, float, int]


def begin_watch(power: float) -> Watch:
    """Before the first step; `power` is a first guess of the innovation's variance [A^2]."""
    return (0.0, complex(0.0, 0.0), 0.0, 0.0, power, 0.0, 0.0, SEARCHING | LOW_EMF)


def least_emf(
    power: float, current: complex, of_noise: float, emf_min: float, drop: float
) -> float:
    """The back-EMF [V] that is needed to see the rotor.

    Parameters
    ----------
    power : variance of the innovation [A^2].
    of_noise : back-EMF that the innovation's standard deviation calls for [V/A].
    emf_min : the least whatever noise and current are [V].
    drop : resistance [ohm] by which the current may falsify the back-EMF.
    """
    least = of_noise * math.sqrt(power)
    if least < emf_min:
        least = emf_min
    drop *= abs(current)
    return drop if drop > least else least


def emf_of_noise(noise: tuple[float, float, float]) -> float:
    """The back-EMF that the innovation's standard deviation calls for [V/A].

    Parameters
    ----------
    noise : from `prepare_noise`.
    """
    of_h, of_innovation, of_integral = noise
    return LEAST_EMF * math.sqrt(of_h / of_innovation)


def prepare_watch(
    weights: tuple[float, float, float],
    noise: tuple,
    window: float,
    dt: float,
    known_power: float,
    emf_min: float,
    drop: float,
    xi_low: float,
    xi_high: float,
    when_blind: int,
) -> tuple:
    """The limits of `look`.

    Parameters
    ----------
    weights : of the newest sample in the averages of h, of speeds, of the innovation's power.
    noise : from `prepare_noise`.
    window : time constant of the average of speeds [s].
    known_power : the innovation's variance where the noise is given, else 0.
    when_blind : a reason to add where the rotor cannot be seen, or xi_hat has run away.
    """
    return (
        *weights,
        dt,
        known_power,
        emf_of_noise(noise),
        emf_min,
        drop,
        xi_low,
        xi_high,
        HALF_TURN * math.pi / dt,
        LEAST_DISAGREEMENT * emf_min,
        SIGMAS / window,
        when_blind,
    )


def look(
    watch: Watch,
    event: int,
    h: complex,
    speed: float,
    turning: float,
    innovation: complex,
    current: complex,
    voltage: complex,
    x: float,
    limits: tuple,
) -> Watch:
    """The watch one sample further.

    Parameters
    ----------
    event : reasons that the step itself gives (RESET, SEARCHING).
    speed, turning : |h| x, and the speed at which y turned during the sample [rad/s].
    innovation : measured minus estimated current, in whatever frame [A].
    limits : from `prepare_watch`.
    """
    level, mean_h, rate, slip, power, idle, calm, before = watch
    (
        fast,
        slow,
        memory,
        dt,
        known_power,
        of_noise,
        emf_min,
        drop,
        xi_low,
        xi_high,
        fastest,
        floor,
        sigmas,
        when_blind,
    ) = limits
    level += fast * (abs(h) - level)
    mean_h += fast * (h - mean_h)
    rate += (fast if before & SEARCHING else slow) * (turning - rate)
    slip += slow * (speed - turning - slip)
    if known_power > 0.0:
        power = known_power
    else:
        real, imag = innovation.real, innovation.imag
        square = 0.5 * (real * real + imag * imag)
        if square > CLIP * power:
            square = CLIP * power
        power += memory * (square - power)
    idle = idle + dt if voltage == 0.0 else 0.0
    least = of_noise * math.sqrt(power)  # as `least_emf`, without the call
    if least < emf_min:
        least = emf_min
    drop *= abs(current)
    if drop > least:
        least = drop
    reasons = event
    if level < (least * LEAVES if before & LOW_EMF else least):
        reasons |= LOW_EMF | when_blind
    if idle > UNCONNECTED:
        reasons |= NO_VOLTAGE | when_blind
    if before & TOO_FAST and level > emf_min:
        # beyond half a turn per sample all samples are those of a slower rotor that turns back, or
        # of a frame that does: that it is over is sure only at rest
        reasons |= TOO_FAST
    elif not -fastest < rate < fastest:
        reasons |= TOO_FAST
    elif not -fastest < speed < fastest:
        reasons |= INCONSISTENT
    if not abs(mean_h.real) <= -ALIGNED * mean_h.imag:
        reasons |= MISALIGNED
    size = abs(x)
    if not xi_low <= size <= xi_high:
        reasons |= FLUX_RANGE
        if size > RUN_AWAY * xi_high:
            reasons |= when_blind
    allowed = CONSISTENT * abs(speed) + floor * size + sigmas * least / (level + TINY)
    if not -allowed < slip < allowed:
        reasons |= INCONSISTENT
    return (level, mean_h, rate, slip, power, idle, calm + dt if reasons == 0 else 0.0, reasons)


def describe(reasons: int) -> str:
    """The reasons in words, the gravest first; empty where there are none."""
    return '; '.join(text for bit, text in REASONS.items() if reasons & bit)
