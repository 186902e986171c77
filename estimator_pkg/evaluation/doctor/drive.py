# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A drive without an encoder: what is wrong with its currents, voltages and motor data.

The off-line electrical angle of the back-EMF (`evaluation.reference.back_emf`) needs no flux
linkage, so it checks the configured one. A resistance that does not fit changes the amplitude of
the back-EMF with the current.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from estimator_pkg import params_file
from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.wiring import Setup
from estimator_pkg.evaluation import parameter_file
from estimator_pkg.evaluation.checks.readings import Readings, plural
from estimator_pkg.evaluation.checks.row import FAIL, PASS, WARN, Check, Finding
from estimator_pkg.evaluation.doctor.examine import Examined
from estimator_pkg.evaluation.matching import exact, pieces
from estimator_pkg.evaluation.plots import COLOURS, Curve, Style, ahead, sample_times
from estimator_pkg.evaluation.reference.back_emf import BackEmf, Drive, back_emf, needed, signals
from estimator_pkg.evaluation.reference.motion import ReferenceMotion, motion
from estimator_pkg.evaluation.text import for_node, number
from estimator_pkg.streams.drive import ELECTRICAL, DriveSettings, DriveStream

PMSM = 'pmsm'
LOST_PART = 0.01  # a larger fraction of lost samples is reported
SEEN_PART = 0.5  # a smaller fraction of angles with enough back-EMF is reported
FLUX_TOLERANCE = 0.15  # a larger relative difference of the flux linkage is reported
RESISTANCE_TOLERANCE = 0.2  # the same of the resistance, if it is outside its 95 % interval
NORMAL = 1.96  # half of a 95 % interval [standard deviations]
BLOCK_WINDOWS, LEAST_BLOCKS = 10, 20  # windows that are averaged; least number of such blocks
SHOWN_POWER = 250.0  # least power of a current that shows the resistance, over that of the noise
CORRELATED_BLOCKS = 20.0  # neighbouring blocks share disturbances: fewer are independent
SYSTEMATIC = 0.02  # relative error of a resistance without any noise
HALF = 0.35, 0.7  # a resistance of this part of the one given: that was line to line
CLEARLY = 0.5  # so is one whose half, with half of the inductance, leaves less than this part
SLOWEST_RATE = 500.0  # a lower rate is that of a wrong unit of time [Hz]
TURNING_TIME = 0.02  # time over which currents and voltages turn together [s],
OPPOSED = 3.0  # or against each other: by this factor
ANY = {'resistance': 1.0, 'inductance': 1e-3, 'flux': 0.1, 'pole_pairs': 1}  # to read the topics
MOTOR_UNITS = {
    'resistance': 'ohm, one phase to the star point: half of line to line',
    'inductance': 'H, one phase to the star point: half of line to line',
    'flux': 'Wb, flux linkage of the magnets',
    'pole_pairs': 'half of the number of poles',
}
FEWEST_SAMPLES = 100  # without which nothing is examined


def _signal(what: str, unit: str) -> Check:
    text = f'amplitude {{rms}} {unit} rms, up to {{most}} {unit}'
    zero = f'{text} -> the {what} is zero throughout: is it connected?'
    return Check(what, f'amplitude [{unit}]', 'zero throughout', {'there': text, 'zero': zero})


MOTOR_DATA = Check(
    'motor data',
    'which of the four are set',
    'any missing (FAIL)',
    {'missing': 'not given: {names} -> set {units}'},
)
SAMPLES = Check(
    'samples',
    'usable samples',
    f'fewer than {FEWEST_SAMPLES} (FAIL)',
    {'few': '{n} usable samples -> record currents and voltages for a second'},
)
RATE = Check(
    'rate',
    'sample rate',
    f'below {SLOWEST_RATE:g} Hz: milliseconds were taken for seconds',
    {
        'rate': '{hz} Hz, {n} samples',
        'slow': '{hz} Hz, {n} samples -> check the unit of the stamps: milliseconds as seconds? '
        'A drive is sampled at kHz',
    },
)
LOST = Check(
    'lost samples',
    'missing samples, and the longest gap',
    f'above {100 * LOST_PART:g} %',
    {
        'few': '{percent} %, longest gap {gap} ms',
        'often': '{percent} %, longest gap {gap} ms -> send each sample',
    },
)
ORDER = Check(
    'order of stamps',
    'jumps of the clock',
    'the clock jumps back (FAIL); the longest run is judged',
    {
        'none': 'no jump back',
        'jumps': 'the clock jumps back {many} -> one run or simulation per record; the longest is '
        'judged here',
    },
)
CURRENT, VOLTAGE = _signal('current', 'A'), _signal('voltage', 'V')
PHASES = Check(
    'phases',
    'whether currents and voltages turn the same way',
    'they turn in opposite directions: two phases of one are swapped',
    {
        'same': 'turn the same way',
        'unseen': 'this record does not show it',
        'opposed': 'currents and voltages turn in opposite directions -> two phases are swapped '
        'in one of them: give both in the order a, b, c',
    },
)
SHOWS = 'shows the rotor for {percent:.0f} % of the time, up to {fastest} rad/s (electrical)'
BACK_EMF = Check(
    'back-EMF',
    'how long it shows the rotor',
    'for less than half of the time; never (FAIL)',
    {
        'seen': SHOWS,
        'seldom': f'{SHOWS} -> nothing is judged while the motor is slow: turn it faster',
        'never': 'too small in every sample -> turn the motor faster; check voltages and flux, and '
        'that resistance and inductance are of one phase (half of line to line)',
    },
)
FLUX = Check(
    'flux linkage',
    'flux linkage that fits best',
    f'{100 * FLUX_TOLERANCE:g} % from the parameter',
    {
        'fits': '{fitted} Wb, given {given} Wb',
        'wrong': '{fitted} Wb, given {given} Wb -> set flux to {fitted}, or check resistance, '
        'voltages and scaling',
    },
)
RESISTANCE = Check(
    'resistance',
    'resistance that fits best',
    f'{100 * RESISTANCE_TOLERANCE:g} % from the parameter and outside the 95 % interval of the one '
    'that fits; line to line; negative (the current is counted out of the motor)',
    {
        'half': 'half of {given} ohm, with half of the inductance, fits better -> {remedy}',
        'fits': '{fitted} +- {half} ohm (95 %) fits best, given {given} ohm -> {remedy}',
        'unseen': 'this record does not show it -> {remedy}',
    },
)
CHECKS = (
    *(MOTOR_DATA, SAMPLES, RATE, LOST, ORDER, CURRENT, VOLTAGE, PHASES),
    *(BACK_EMF, FLUX, RESISTANCE),
)


def examine(bag: Bag, setup: Setup, missing: Sequence[str] = ()) -> Examined:
    """Return all findings on the drive of a bag.

    Parameters
    ----------
    missing : motor data that nobody gave; the setup has any values for them.
    """
    name = f'{setup.values.get("joint", DriveSettings.joint)}{ELECTRICAL}'
    drive = signals(bag, setup)
    panels = _panels(drive)
    if missing:
        found = _of_samples(drive)
        units = '; '.join(f'{each} ({MOTOR_UNITS[each]})' for each in missing)
        words = {'names': ', '.join(missing), 'units': units}
        found.append(MOTOR_DATA.found(FAIL, ['missing'], {}, words))
        options = ' '.join(f'--set {each}=...' for each in missing)
        said = f'The motor data are needed: add {options}, or --params FILE.'
        return Examined(_nothing(name), found, said=(said,), panels=panels)
    found, moved = checked(drive, setup.values)
    if moved is not None and not moved.seldom:
        run = max(pieces(moved.stamps), key=len)
        time = (moved.stamps[run] - drive.stamps[0]) * 1e-9
        speed = Curve('back-EMF', '@ rad/s', time, moved.plain[run], Style(COLOURS[0]).line)
        panels = {'electrical speed [rad/s] of the back-EMF': [speed]} | panels
    wrong = ', '.join(each.check for each in found if each.level != PASS)
    said = f'Use {PMSM} with these motor data' + (f'; mend first: {wrong}.' if wrong else '.')
    return Examined(_nothing(name), found, said=(said,), panels=panels)


def _nothing(name: str) -> Readings:
    """Return the readings of a joint without an encoder."""
    stamps, values = np.zeros(0, np.int64), np.zeros(0)
    return Readings(name, stamps, stamps, values, values, math.tau)


def _panels(drive: Drive) -> dict[str, list[Curve]]:
    """Return the panels of currents, voltages and sample times, by title."""
    time = (drive.stamps - drive.stamps[:1]) * 1e-9
    later = ahead(time)
    time = time[later]
    if len(time) < 2:
        return {}
    panels = {}
    for what, values, unit in (('current', drive.current, 'A'), ('voltage', drive.voltage, 'V')):
        axes = {'alpha': values.real[later], 'beta': values.imag[later]}
        panels[f'{what} [{unit}]; blue: alpha, orange: beta'] = [
            Curve(f'{what} {axis}', f'@ {unit}', time, each, Style(colour).line)
            for (axis, each), colour in zip(axes.items(), COLOURS)
        ]
    return panels | sample_times(time)


def checked(
    drive: Drive, values: Mapping[str, Any]
) -> tuple[list[Finding], ReferenceMotion | None]:
    """Return the findings on a drive with these motor data, and the motion that it shows."""
    found = _of_samples(drive)
    emf = back_emf(drive, values)
    if emf is None or not np.isfinite(emf.angle).any():
        return [*found, BACK_EMF.found(FAIL, ['never'])], None
    moved = motion(emf.stamps, emf.angle, 0.0)
    swapped = any(each.check == PHASES.name and each.level == WARN for each in found)
    seen = np.isfinite(emf.angle)
    fastest = number(float(np.max(np.abs(emf.speed[seen]))), 4)
    words = {'percent': 100.0 * float(np.mean(seen)), 'fastest': fastest}
    found.append(_either(BACK_EMF, float(np.mean(seen)) < SEEN_PART, words))
    return found + ([] if moved is None or swapped else _of_motor(emf, moved, values)), moved


def _of_samples(drive: Drive) -> list[Finding]:
    """Return the findings on stamps and signals."""
    if len(drive.stamps) < FEWEST_SAMPLES:
        return [SAMPLES.found(FAIL, ['few'], {}, {'n': len(drive.stamps)})]
    steps = np.diff(drive.stamps) * 1e-9
    back = int(np.count_nonzero(steps < 0.0))
    steps = steps[steps > 0.0]
    step = float(np.median(steps))
    lost = float(np.sum(np.rint(steps / step) - 1.0)) / (len(steps) + 1)
    words = {
        'hz': f'{1.0 / step:.6g}',
        'n': len(drive.stamps),
        'percent': f'{100.0 * lost:.2g}',
        'gap': number(float(np.max(steps)) * 1e3, 2),
        'many': plural(back, 'time'),
    }
    found = [
        _either(RATE, 1.0 / step < SLOWEST_RATE, words),
        _either(LOST, lost > LOST_PART, words),
        _either(ORDER, back > 0, words, {'clock_jumps': back}, FAIL),
    ]
    for check, values in ((CURRENT, drive.current), (VOLTAGE, drive.voltage)):
        most = float(np.max(np.abs(values)))
        rms = float(np.sqrt(np.mean(np.abs(values) ** 2)))
        words = {'rms': number(rms, 3), 'most': number(most, 3)}
        found.append(_either(check, most == 0.0, words, level=FAIL))
    return [*found, _sense(drive)]


def _either(
    check: Check,
    wrong: bool,
    words: Mapping[str, Any],
    numbers: Mapping[str, Any] = {},
    level: str = WARN,
) -> Finding:
    """Return the finding with the first text of the row where it passes, else with the second."""
    text = list(check.texts)[wrong]
    return check.found(level if wrong else PASS, [text], numbers, words)


def _sense(drive: Drive) -> Finding:
    """Return whether currents and voltages turn the same way.

    Of two vectors that turn the same way, the product of one with the conjugate of the other is
    nearly constant; of two that turn against each other, the product itself is.
    """
    count = max(4, round(TURNING_TIME / (float(np.median(np.abs(np.diff(drive.stamps)))) * 1e-9)))
    whole = len(drive.stamps) // count * count
    current, voltage = (each[:whole].reshape(-1, count) for each in (drive.current, drive.voltage))
    same, against = (
        float(np.sum(np.abs(np.mean(current * each, axis=1))))
        for each in (np.conj(voltage), voltage)
    )
    if against > OPPOSED * same:
        return PHASES.found(WARN, ['opposed'])
    return PHASES.found(PASS, ['same' if same > OPPOSED * against else 'unseen'])


def _of_motor(emf: BackEmf, moved: ReferenceMotion, values: Mapping[str, Any]) -> list[Finding]:
    """Return the findings on flux linkage and resistance.

    Parameters
    ----------
    moved : the motion that the angles of the back-EMF show.
    """
    speed = exact(emf.stamps, moved.stamps[moved.firm], moved.plain[moved.firm])
    known = np.isfinite(speed)
    if np.count_nonzero(known) < LEAST_BLOCKS:
        return []
    size, speed, current = emf.size[known], speed[known], emf.current[known]
    flux, more, half_width = _fitted(size, np.abs(speed), current.real)
    given, resistance = float(values['flux']), float(values['resistance'])
    inductance = float(values['inductance'])
    words = {'fitted': number(flux, 4), 'given': number(given, 4)}
    wrong = abs(flux / given - 1.0) > FLUX_TOLERANCE
    found = [_either(FLUX, wrong, words, {'flux': flux})]
    halved = np.abs(size + 0.5 * (resistance + 1j * inductance * speed) * current)
    half = _rest(halved, np.abs(speed)) < CLEARLY * _rest(size, np.abs(speed))
    fits = resistance + more
    half_width = math.hypot(half_width, SYSTEMATIC * resistance)
    shown = half_width < resistance
    doubt = half or (shown and abs(more) > max(half_width, RESISTANCE_TOLERANCE * resistance))
    text = 'half' if half else 'fits' if shown else 'unseen'
    if half or HALF[0] < fits / resistance < HALF[1]:
        remedy = (
            'resistance and inductance line to line? One phase to the star point has half: set '
            f'resistance to {number(0.5 * resistance, 3)}, inductance to '
            f'{number(0.5 * inductance, 3)}'
        )
    elif fits < 0.0:
        remedy = 'turn the sign of the current: it must be counted into the motor'
    else:
        remedy = 'check the resistance (one phase to the star point, warm), and the dead time'
    words = {
        'fitted': number(fits, 3),
        'half': number(half_width, 2),
        'given': number(resistance, 3),
        'remedy': remedy if doubt else '',
    }
    numbers = {'resistance': fits, 'stddev': half_width / NORMAL}
    return [*found, RESISTANCE.found(WARN if doubt else PASS, [text], numbers, words)]


def _blocks(values: np.ndarray) -> np.ndarray:
    """Return the means of `BLOCK_WINDOWS` neighbours each, whose noise is less."""
    count = max(1, min(BLOCK_WINDOWS, len(values) // LEAST_BLOCKS))
    return values[: len(values) // count * count].reshape(-1, count).mean(axis=1)


def _rest(size: np.ndarray, speed: np.ndarray) -> float:
    """Return the size of what a flux linkage alone leaves of the amplitude."""
    size, speed = _blocks(size), _blocks(speed)
    return float(np.linalg.norm(size - speed * (size @ speed) / (speed @ speed)))


def _fitted(size: np.ndarray, speed: np.ndarray, current: np.ndarray) -> tuple[float, float, float]:
    """Return (flux linkage [Wb], missing resistance [ohm], half of its 95 % interval [ohm]).

    Least squares of the amplitude: flux times speed, plus resistance times the current along it.
    The part of the current that does not follow the speed shows the resistance, if it is not the
    noise of the sensor.
    """
    size, speed, current = _blocks(size), _blocks(speed), _blocks(current)
    power = float(speed @ speed)
    apart = current - speed * (current @ speed) / power
    noise = float(np.median(np.abs(np.diff(current, 2)))) * 1.4826 / math.sqrt(6.0)
    own = float(apart @ apart)
    if own <= SHOWN_POWER * noise**2 * len(apart):
        return float(size @ speed) / power, 0.0, math.inf
    more = float(apart @ size) / own
    flux = float((size - more * current) @ speed) / power
    rest = size - flux * speed - more * current
    return flux, more, NORMAL * math.sqrt(CORRELATED_BLOCKS * float(np.mean(rest**2)) / own)


def as_yaml(examined: Examined, origin: str, settings: Mapping[str, Any]) -> str:
    """Return a parameter file for `pmsm_observer`.

    Parameters
    ----------
    settings : parameters that the user gave, and those of the input.
    """
    lines = [
        f'Made by velocity_estimator doctor from {origin}.',
        *for_node(DriveStream.NODE),
        'Checked by the off-line angle of the back-EMF.',
        *examined.said,
    ]
    values = {'observer': PMSM, **settings}
    own = {name: value for name, value in values.items() if params_file.parameter_of(name) == name}
    written = [parameter_file.as_yaml(lines, own).rstrip()]
    for name in needed(settings):
        written.append(f'    # {name}:  # {MOTOR_UNITS[name]}')
    return '\n'.join(written) + '\n'
