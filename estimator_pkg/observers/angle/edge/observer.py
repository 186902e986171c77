"""The edge-aware adaptive observer: a Kalman filter of an angle for which nothing need be tuned.

    a' = -a/FADE + w,  v' = a,  x' = v,       w white jerk of a density that is found on line

What differs from a Kalman filter (`covariance`) is what it makes of a reading
(`interval`: a count is an interval, an edge is a time), how fast it listens
(`bandwidth`), that it learns its sensor (`sensor`) and how it starts (`start`). The
one thing a user says is the quantum, and even that is checked. The derivation is in
docs/observers/edge_adaptive.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from estimator_pkg.observers.angle.core import LOST_AFTER, OUTSIDE, is_angle
from estimator_pkg.observers.angle.edge.bandwidth import (
    STEADY,
    Laws,
    began,
    begin_band,
    follow_band,
    follow_sway,
)
from estimator_pkg.observers.angle.edge.clock import UNEVEN, UNKNOWN, elapsed
from estimator_pkg.observers.angle.edge.covariance import (
    corrected,
    manoeuvred,
    predicted,
    swayed,
    widened,
)
from estimator_pkg.observers.angle.edge.interval import HELD, NOTHING, cell, interval, within
from estimator_pkg.observers.angle.edge.sensor import (
    FINEST,
    FIRST_STEPS,
    JUMP,
    RESIDUE,
    ROUNDING,
    SURPRISE,
    TOO_LARGE,
    TOO_SMALL,
    agreement,
    begin_sensor,
    first_step,
    follow_noise,
    follow_sensor,
    follow_steps,
    quantum_of,
    tells_quantum,
    vibration,
)
from estimator_pkg.observers.angle.edge.start import (
    RECENT,
    SETTLES,
    START,
    UNSURE,
    bent,
    doubted,
    later,
    settled,
    started,
    stood,
)
from estimator_pkg.observers.circle import Circle, wrap
from estimator_pkg.observers.contract import (
    COASTING,
    INITIALISING,
    TRACKING,
    Functions,
    Observer,
)
from estimator_pkg.observers.convention import begin, follow, present
from estimator_pkg.parameters import parameter

# The constants, all of them; docs/observers/edge_adaptive.md says where each comes from.
RATE = 0.3  # of the slow law: log density per unit of its product and of filter memory
SLACK = {'smooth': 0.6, 'balanced': 0.3, 'fast': 0.0}  # of that product
SHARE = 0.2  # memory of the slow law's low-pass, over the filter's
SIGMAS = 3.0  # slack of the cumulative sums; prediction this far outside its cell is held
ALARM = 12.0  # of the cumulative sums: four samples of twice the slack
BLUR = 0.03  # quanta: no edge is known better; and either end of an interval, of its width
LONGEST = 2.0  # [s] longest memory; the start's too
FADE = 0.3  # [s] memory of the acceleration
MEMORY = 32.0  # samples: memory of the noise, and of the innovations' size
STRAY = 2.0  # quanta: beyond them one sample alone is never believed
CONFIRMED = 4.0  # samples after which a start, a gap or a doubt has settled
CALM = 0.5  # of its variance the speed keeps at least, however small the innovations are

UNIT = 1.0  # [rad] quantum while none is known: before the first step all is relative to it
RESTED = 0.7  # of a cell's variance: a prediction this vague has seen no edge for long
SLIGHT = 0.3  # a rise of the log density by less changes next to nothing of what was told
PLAIN = 4.0 * BLUR * BLUR  # square quanta: a noise above it is more than the blur of the edges
UNTOLD = 0.05  # of its variance an innovation has at least, were it to count in sigmas


@dataclass(frozen=True)
class Gains:
    """Parameters of `edge_adaptive`."""

    quantum: float = parameter(
        0.0,
        unit='rad',
        range=(0.0, 10.0),
        structural=False,
        description='smallest step of the measurement (2 pi / counts); 0: found from the smallest '
        'step seen',
    )
    prefer: str = parameter(
        'balanced',
        unit='',
        choices=('smooth', 'balanced', 'fast'),
        among=('smooth', 'balanced', 'fast'),
        description='what to give way to where noise and delay are at odds',
        equation='slack of the bandwidth law: 0.6, 0.3 or 0',
    )


def prepare(design: tuple, dt: float) -> tuple:
    """What depends on dt alone; see `predicted`."""
    square = dt * dt
    cube = square * dt
    return (
        dt,
        0.5 * square,
        FADE / (FADE + dt),
        cube / 3.0,
        0.125 * cube * dt,
        0.05 * cube * square,
    )


def build(gains: Gains, circle: Circle) -> Functions:
    """The functions at these gains.

    State: motion: (position [rad], velocity, acceleration, time since a reading told something
    [s]); covariance; band (see `bandwidth`); sensor, steps (see `sensor`); convention;
    lock: (status, samples since a start, a gap or a doubt, time [s] for which the readings were far
    off); sway (see `bandwidth`); doubt (see `start`); clock (see `clock`).
    """

    def design() -> tuple:
        outside = OUTSIDE * circle.period if circle.period > 0.0 else math.inf
        laws = Laws(RATE, SLACK[gains.prefer], SHARE, SIGMAS, ALARM, MEMORY)
        return (
            float(circle.period),
            float(circle.unwrap),
            float(gains.quantum),
            outside,
            (laws.rate, laws.slack, laws.share, laws.sigmas, laws.alarm, laws.memory),
        )

    def init(measurement: float, design: tuple) -> tuple:
        quantum = design[2] if design[2] > 0.0 else UNIT
        floor = quantum * quantum / 12.0
        return (
            (measurement, 0.0, 0.0, 0.0),
            (floor, 0.0, 0.0, 0.0, 0.0, 0.0),
            begin_band(0.0),
            begin_sensor(quantum, BLUR),
            FIRST_STEPS,
            begin(measurement),
            (INITIALISING, 1.0, 0.0),
            STEADY,
            START,
            UNKNOWN,
        )

    def again(
        measurement: float,
        design: tuple,
        sensor: tuple,
        steps: tuple,
        convention: tuple,
        doubt: tuple,
        clock: tuple,
    ) -> tuple:
        """A start after lock was lost: what is known of the sensor stays."""
        fresh = init(measurement, design)
        return (
            fresh[0],
            (sensor[0] * sensor[0] / 12.0,) + fresh[1][1:],
            fresh[2],
            sensor,
            steps,
            convention,
            fresh[6],
            STEADY,
            doubt,
            clock,
        )

    def told(
        kind: int,
        centre: float,
        half: float,
        off: float,
        ahead: float,
        p: tuple,
        band: tuple,
        sensor: tuple,
        noisy: bool,
        flickers: bool,
        idle: float,
        dt: float,
        laws: tuple,
    ) -> tuple:
        """What a reading changes that tells something.

        Parameters
        ----------
        kind, centre, half, off, ahead : what it is worth, and from what; see `interval`.
        noisy, flickers : the noise is more than the edges' blur; it crosses edges by itself.
        idle : time since the last one that told something [s].

        Returns
        -------
        Whether it is believed, correction of the motion, covariance, band, sensor.
        """
        quantum, noise = sensor[0], sensor[1]
        r = noise + 16.0 * BLUR * BLUR * half * half
        s = p[0] + r
        d, left = within(centre, half, math.sqrt(s))
        known = 1.0 - left
        z = d / math.sqrt(s * (known if known > UNTOLD else UNTOLD))
        beyond = z > ALARM or z < -ALARM
        if beyond:
            z = ALARM if z > 0.0 else -ALARM
        least = (quantum * quantum + 12.0 * noise) / LONGEST**5
        if not flickers:
            shaken = vibration(sensor)
            if shaken > least:
                least = shaken
        low, variance = band[1], band[2]
        listening, growth, date, product = follow_band(band, z, known * p[0] / s, idle, least, laws)
        if beyond and date == 0.0 and (d > STRAY * quantum or d < -STRAY * quantum):
            # one sample alone: the sums and their dates alone keep it, for the next to confirm
            return (False, (0.0, 0.0, 0.0), p, band[:3] + listening[3:7] + band[7:], sensor)
        score = d * d / s - known
        if growth > 0.0:
            p = widened(p, growth)
            s = p[0] + r
        if date > 0.0 or growth > SLIGHT:  # the same reading tells a vaguer prediction more
            if date > 0.0:
                date = began(date, dt, noisy, SIGMAS, ALARM)
                if flickers and -STRAY * quantum < d < STRAY * quantum and p[3] > 0.0:
                    # flicker that begins anew: it moved in all the time that is remembered
                    date = max(date, math.sqrt(p[0] / p[3]))
                p = manoeuvred(p, d, date)
            if not flickers:
                edges = math.sqrt(noise)
                kind, centre, half = interval(off, ahead, quantum, p[0], edges, SIGMAS * edges)
            r = noise + 16.0 * BLUR * BLUR * half * half
            s = p[0] + r
            d, left = within(centre, half, math.sqrt(s))
        # flicker tells the noise from either side alike; elsewhere what is correlated is motion
        if low * low < variance if flickers else kind != HELD and (score < 0.0 or product < 1.0):
            most = noise if flickers and sensor[2] < noise else sensor[2]
            likelier = follow_noise(noise, score * noise / s, most, quantum, MEMORY, BLUR)
            if likelier != noise:
                sensor = sensor[:1] + (likelier,) + sensor[2:]
        pull = d / s
        shift = (p[0] * pull, p[1] * pull, p[2] * pull)
        if kind != HELD:  # that an edge did not come moves the estimate, but is no reading
            p = corrected(p, r, left)
        return True, shift, p, listening, sensor

    def step(
        state: tuple, coefficients: tuple, design: tuple, measurement: float, given: float
    ) -> tuple:
        motion, p, band, sensor, steps, convention, lock, sway, doubt, clock = state
        dt = coefficients[0]
        period, laws = design[0], design[4]
        change = measurement - convention[0]
        if change + change >= period or change + change < -period:
            change = wrap(change, period)
        quantum, pace = sensor[0], sensor[10]
        if clock[1] > 0.0 or dt > (1.0 + UNEVEN) * pace or dt < (1.0 - UNEVEN) * pace:
            dt, clock = elapsed(
                clock,
                dt,
                pace,
                change + convention[0] - motion[0],
                motion[1],
                motion[2],
                p,
                quantum,
                sensor[1],
            )
            if dt != coefficients[0]:
                coefficients = prepare(design, dt)
        doubted_so_far = doubt[1] > 0.0
        if doubted_so_far:
            doubt = later(doubt, dt)
            jump = steps[6]
            if jump * (change + 0.5 * jump) > 0.0:  # it lasts: all before was residue, no steps
                steps = follow_steps(FIRST_STEPS, jump, 0.0, dt, 0.0, design[2])
                quantum = quantum_of(steps, design[2])
                sensor = first_step(quantum, BLUR, jump, dt)
                motion = (convention[0] - 0.5 * jump, 0.0, 0.0, 0.0)  # at the edge
                p, band = stood(quantum, BLUR, LONGEST)
                doubt = doubted(quantum, dt, period, 0.0)
            elif jump != 0.0:  # a glitch
                change += jump
                steps = steps[:6] + (0.0,)
        first = False
        if change != 0.0 and tells_quantum(steps, change, sensor[6], sensor[7], quantum):
            first = convention[1] == convention[2]
            size = abs(measurement) + abs(convention[0])
            least = ROUNDING * size if first and design[2] == 0.0 else RESIDUE * quantum
            if -least <= change <= least or -FINEST < change < FINEST:
                measurement, change, first = convention[0], 0.0, False  # residue: it stands
            else:
                steps = follow_steps(steps, change, sensor[6], sensor[7], size, design[2])
                quantum = quantum_of(steps, design[2])
                if quantum != sensor[0]:
                    scale = quantum * quantum / (sensor[0] * sensor[0])
                    band = (band[0] * scale,) + band[1:]
                    if first:  # what was relative to UNIT
                        sensor = sensor[:1] + (scale * sensor[1],) + sensor[2:9] + (0.0, sensor[10])
                    if scale > 1.0 or first:  # as sure in quanta as it was
                        p = (
                            scale * p[0],
                            scale * p[1],
                            scale * p[2],
                            scale * p[3],
                            scale * p[4],
                            scale * p[5],
                        )
        stepped, rested = sensor[4], sensor[7]
        sensor = follow_sensor(sensor, change, dt, quantum, MEMORY, BLUR)
        was, convention = convention, follow(convention, measurement, period)
        status, count, astray = lock
        if (
            p[3] == 0.0
            or (doubted_so_far and stepped * change > 0.0 and doubt[1] == UNSURE)
            or (first and design[2] == 0.0 and rested <= CONFIRMED * dt)
        ):
            # no speed is known: the second reading, the second that moves on after a rest, or the
            # first that moves so early that it shows the quantum alone
            density = band[0]
            motion, p, band = started(measurement, change, dt, quantum, sensor[1], period, LONGEST)
            if doubt[1] == UNSURE:
                band = (density if density > band[0] else band[0],) + band[1:]
                doubt = (0.0, SETTLES, doubt[2])
            return (
                motion,
                p,
                band,
                sensor,
                steps,
                convention,
                (status, count + 1.0, astray),
                sway,
                doubt,
                clock,
            )
        x, v, a, idle = motion
        moved = v * dt + a * coefficients[1]
        off = measurement - x - moved
        if off + off >= period or off + off < -period:
            off = wrap(off, period)
        v += a * dt
        a *= coefficients[2]
        p = predicted(p, band[0], coefficients)
        square = quantum * quantum
        if sway[0] > 0.0:
            swing = sway[0] - square / 6.0 - 2.0 * sensor[1]
            if swing > 0.0:
                p = swayed(p, swing, dt)
        idle += dt
        if (
            rested > 0.0
            and change != 0.0
            and rested > MEMORY * dt
            and sensor[1] <= PLAIN * square
            and (first or 12.0 * p[0] > RESTED * square)
        ):
            doubted_so_far = False
            doubt = doubted(quantum, dt, period, 0.0 if first else doubt[2])
        if off > design[3] or off < -design[3]:
            # an eighth of a turn off: no reading of this shaft, or not of this speed
            astray += dt
            if astray > LOST_AFTER:
                return again(measurement, design, sensor, steps, convention, doubt, clock)
            return (
                (measurement - off, v, a, idle),
                p,
                band,
                sensor,
                steps,
                convention,
                (COASTING if status != INITIALISING else status, 0.0, astray),
                sway,
                doubt,
                clock,
            )
        ahead, half, calm = change - moved, 0.5 * quantum, sway
        if count > 0.0:
            sway = follow_sway(sway, ahead, SURPRISE * (sensor[2] + square), MEMORY)
        else:  # it moved away from a reading that was not believed
            sway = (sway[0], 0.0, 0.0)
        noise = sensor[1]
        noisy = noise > PLAIN * square
        if not noisy and change * stepped < 0.0 and -half < moved < half and sway[0] <= 0.0:
            # a reading that the next undoes: its noise is as unknown as an angle in its cell
            noise, noisy = square / 12.0, True
            sensor = sensor[:1] + (noise,) + sensor[2:]
        # where it crosses an edge more often than the angle does, no edge is a time
        flickers = noisy and moved * moved < noise < half * half
        kind, centre = NOTHING, 0.0
        if flickers:
            kind, centre, half = cell(off, quantum, p[0], SIGMAS * math.sqrt(noise))
        # of most readings it is plain that they tell nothing: no edge, and none was expected
        elif ahead > half or ahead < -half or off > half or off < -half or 12.0 * p[0] > square:
            edges = math.sqrt(noise)
            kind, centre, half = interval(off, ahead, quantum, p[0], edges, SIGMAS * edges)
        if kind != NOTHING:
            believed, shift, p, band, sensor = told(
                kind, centre, half, off, ahead, p, band, sensor, noisy, flickers, idle, dt, laws
            )
            idle = 0.0
            if not believed:
                if quantum != design[2] and abs(change) > JUMP * (was[2] - was[1]):
                    # what moved before was residue, or this is a glitch: the next reading tells
                    steps = steps[:6] + (change,)
                    doubt = doubted(quantum, dt, period, 0.0)
                return (
                    (measurement - off, v, a, idle),
                    p,
                    band,
                    sensor,
                    steps,
                    convention,
                    (COASTING if status != INITIALISING else status, 0.0, astray),
                    calm,
                    doubt,
                    clock,
                )
            off -= shift[0]
            v += shift[1]
            a += shift[2]
            turn = (v + v) * dt
            if (turn > period or turn < -period) and period > 0.0:
                # faster than half a turn per sample: lock was lost
                return again(measurement, design, sensor, steps, convention, doubt, clock)
        if doubted_so_far and change != 0.0:
            doubt = settled(doubt, v, change, rested, dt, square, noise)
        if status != TRACKING:
            count += 1.0
            if count >= CONFIRMED and p[3] * dt * dt < square + 12.0 * noise:
                status, astray = TRACKING, 0.0
            lock = (status, count, astray)
        return (
            (measurement - off, v, a, idle),
            p,
            band,
            sensor,
            steps,
            convention,
            lock,
            sway,
            doubt,
            clock,
        )

    def bound(sensor: tuple) -> float:
        """The largest speed [rad/s] that a reading unchanged for so long allows."""
        step = sensor[6] if sensor[6] > sensor[0] else sensor[0]
        return (step + 2.0 * SIGMAS * math.sqrt(sensor[1])) / sensor[7]

    def output(
        state: tuple, coefficients: tuple, design: tuple, measurement: float, given: float
    ) -> tuple:
        x, v, a, _ = state[0]
        sensor = state[3]
        if sensor[7] > 0.0:
            most = bound(sensor)
            v = most if v > most else -most if v < -most else v
        return (present(state[5], x, design[0], design[1]), v, a, state[6][0])

    def stddev(state: tuple, coefficients: tuple, design: tuple) -> tuple[float, float]:
        p, sensor = state[1], state[3]
        floor = sensor[0] * sensor[0] / 12.0  # where in its count the encoder changes is not known
        if design[2] == 0.0 and state[5][1] == state[5][2]:  # nothing moved: no quantum is known
            return math.inf, math.inf
        squares = state[2][7]
        variance = p[3] * (squares if squares > CALM else CALM)
        doubt = state[8]
        if p[3] <= 0.0:
            variance = doubted(sensor[0], coefficients[0], design[0], 0.0)[0]
        else:
            variance += doubt[0]
        if 0.0 < doubt[2] < RECENT:
            variance += bent(12.0 * (floor + sensor[1]), doubt[2])
        sigma = math.sqrt(variance)
        if sensor[7] > 0.0:
            most = bound(sensor)
            sigma = most if sigma > most else sigma
        return math.sqrt(p[0] + floor if p[0] > 0.0 else floor), sigma

    def resume(state: tuple, coefficients: tuple, design: tuple, measurement: float) -> tuple:
        motion, p, band, sensor, steps, convention, lock, sway, doubt, clock = state
        quantum = sensor[0]
        status = COASTING if lock[0] == TRACKING else lock[0]
        return (
            (measurement, motion[1], 0.0, 0.0),
            (quantum * quantum / 12.0, 0.0, 0.0, p[3], 0.0, p[5]),
            (band[0], 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, band[7]),
            (quantum, sensor[1], sensor[2], 0.0, 0.0, 0.0, 0.0, 0.0, math.inf, 0.0, 0.0),
            steps[:6] + (0.0,),
            follow(convention, measurement, design[0]),
            (status, 0.0, lock[2]),
            STEADY,
            (motion[1] * motion[1], SETTLES, doubt[2]),
            (0.0, clock[1]),
        )

    def restart(state: tuple, coefficients: tuple, design: tuple, measurement: float) -> tuple:
        steps = state[4]  # what is known of the quantum
        quantum = quantum_of(steps, design[2])
        return again(
            measurement,
            design,
            begin_sensor(quantum if quantum > 0.0 else UNIT, BLUR),
            steps,
            follow(state[5], measurement, design[0]),
            START,
            UNKNOWN,
        )

    def why(state: tuple, design: tuple) -> str:
        given, found = design[2], quantum_of(state[4], 0.0)
        said = agreement(state[4], given)
        if said == TOO_LARGE:
            return (
                f'quantum {given:.4g} is too large: steps of {found:.4g} were seen, which is '
                'used instead'
            )
        if said == TOO_SMALL:
            return (
                f'quantum {given:.4g} is too small: no step below {found:.4g} was seen, which '
                'is used instead'
            )
        return ''

    return Functions(
        design,
        prepare,
        init,
        step,
        output,
        stddev,
        resume,
        lambda dt: None,
        lambda dt: math.nan,
        is_angle,
        why=why,
        restart=restart,
    )


OBSERVER = Observer(
    name='edge_adaptive',
    summary='finds bandwidth and noise by itself: say how many counts the '
    'encoder has, or not even that',
    gains=Gains,
    build=build,
    reference='docs/observers/edge_adaptive.md: edges as times, truncated Gaussians, innovation '
    'correlation (Mehra 1970), cumulative sums (Page 1954)',
    gives_acceleration=lambda gains: True,
)
