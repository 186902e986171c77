"""The edge-aware adaptive observer: a Kalman filter of an angle for which nothing need be tuned.

    a' = -a/FADE + w,  v' = a,  x' = v,       w white jerk of a density that is found on line

What differs from a Kalman filter is what it makes of a reading (`edge_interval`: a count is an
interval, an edge is a time), how fast it listens (`edge_bandwidth`) and that it learns its sensor
(`edge_sensor`). The one thing a user says is the quantum, and even that is checked. The derivation
is in docs/observers/edge_adaptive.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from estimator_pkg.observers.angle import LOST_AFTER, OUTSIDE, is_angle
from estimator_pkg.observers.circle import Circle, wrap
from estimator_pkg.observers.contract import (
    COASTING,
    INITIALISING,
    TRACKING,
    Functions,
    Observer,
)
from estimator_pkg.observers.convention import begin, follow, present
from estimator_pkg.observers.edge_bandwidth import (
    STEADY,
    Laws,
    begin_band,
    follow_band,
    follow_sway,
    manoeuvred,
    swayed,
    widened,
)
from estimator_pkg.observers.edge_interval import HELD, NOTHING, interval, within
from estimator_pkg.observers.edge_sensor import (
    FIRST_STEPS,
    SURPRISE,
    TOO_LARGE,
    TOO_SMALL,
    agreement,
    begin_sensor,
    follow_noise,
    follow_sensor,
    follow_steps,
    quantum_of,
    tells_quantum,
    vibration,
)
from estimator_pkg.parameters import parameter

# The constants, all of them; docs/observers/edge_adaptive.md says where each comes from.
RATE = 0.3        # of the slow law: log density per unit of its product and of filter memory
SLACK = {'smooth': 0.6, 'balanced': 0.3, 'fast': 0.0}   # of that product
SHARE = 0.2       # memory of the slow law's low-pass, over the filter's
SIGMAS = 3.0      # slack of the cumulative sums; prediction this far outside its cell is held
ALARM = 12.0      # of the cumulative sums: four samples of twice the slack
BLUR = 0.03       # quanta: no edge is known better; and either end of an interval, of its width
LONGEST = 2.0     # [s] longest memory; the start's too
FADE = 0.3        # [s] memory of the acceleration
MEMORY = 32.0     # samples: memory of the noise, and of the innovations' size
STRAY = 2.0       # quanta: beyond them one sample alone is never believed
CONFIRMED = 4.0   # samples after which a start, a gap or a doubt has settled
CALM = 0.5        # of its variance the speed keeps at least, however small the innovations are

SWERVE = 0.1      # half turns per sample by which a starting speed may change at most in a sample
VAGUE = 100.0     # the same in quanta, where there is no turn
SLIGHT = 0.3      # a rise of the log density by less changes next to nothing of what was told
UNTOLD = 0.05     # of its variance an innovation has at least, were it to count in sigmas


@dataclass(frozen=True)
class Gains:
    """Parameters of `edge_adaptive`."""

    quantum: float = parameter(
        0.0, unit='rad', range=(0.0, 10.0), structural=False,
        description='smallest step of the measurement (2 pi / counts); 0: found from the smallest '
                    'step seen')
    prefer: str = parameter(
        'balanced', unit='', choices=('smooth', 'balanced', 'fast'),
        among=('smooth', 'balanced', 'fast'),
        description='what to give way to where noise and delay are at odds',
        equation='slack of the bandwidth law: 0.6, 0.3 or 0')


def prepare(design: tuple, dt: float) -> tuple:
    """What depends on dt alone: (dt, dt^2/2, part of the acceleration kept, q11, q01, q00).

    q : what white jerk of density 1 adds within dt to that element of the covariance. q02 is half
        of q11, q12 is dt^2/2, q22 is dt.
    """
    square = dt * dt
    cube = square * dt
    return (dt, 0.5 * square, FADE / (FADE + dt), cube / 3.0, 0.125 * cube * dt,
            0.05 * cube * square)


def predicted(p: tuple, density: float, coefficients: tuple) -> tuple:
    """The covariance one sample later."""
    p00, p01, p02, p11, p12, p22 = p
    dt, half, kept, q11, q01, q00 = coefficients
    r12 = p12 + dt * p22
    r02 = p02 + dt * p12 + half * p22
    r01 = p01 + dt * p11 + half * p12
    shaken = density * q11
    return (p00 + dt * (p01 + r01) + half * (p02 + r02) + density * q00,
            r01 + dt * r02 + density * q01,
            kept * r02 + 0.5 * shaken,
            p11 + dt * (p12 + r12) + shaken,
            kept * r12 + density * half,
            kept * kept * p22 + density * dt)


def corrected(p: tuple, s: float, known: float) -> tuple:
    """The covariance after an innovation of variance `s`, of which the part `known` was learnt."""
    p00, p01, p02, p11, p12, p22 = p
    part = known / s
    k0, k1 = p00 * part, p01 * part
    return (p00 - k0 * p00, p01 - k0 * p01, p02 - k0 * p02, p11 - k1 * p01, p12 - k1 * p02,
            p22 - part * p02 * p02)


def build(gains: Gains, circle: Circle) -> Functions:
    """The functions at these gains.

    State: (motion: position [rad], velocity, acceleration); covariance; band (see
    `edge_bandwidth`); sensor, steps (see `edge_sensor`); convention; lock: (status, samples since
    a start, a gap or a doubt, time [s] for which the readings were far off); sway (see
    `edge_bandwidth`).
    """
    def design() -> tuple:
        outside = OUTSIDE * circle.period if circle.period > 0.0 else math.inf
        laws = Laws(RATE, SLACK[gains.prefer], SHARE, SIGMAS, ALARM, MEMORY)
        return (float(circle.period), float(circle.unwrap), float(gains.quantum), outside,
                (laws.rate, laws.slack, laws.share, laws.sigmas, laws.alarm,
                 laws.memory))

    def init(measurement: float, design: tuple) -> tuple:
        quantum = design[2]
        floor = quantum * quantum / 12.0
        return ((measurement, 0.0, 0.0, 0.0), (floor, 0.0, 0.0, 0.0, 0.0, 0.0), begin_band(0.0),
                begin_sensor(quantum, BLUR), FIRST_STEPS, begin(measurement),
                (INITIALISING, 1.0, 0.0), STEADY)

    def again(measurement: float, design: tuple, sensor: tuple, steps: tuple, convention: tuple
              ) -> tuple:
        """A start after lock was lost: what is known of the sensor stays."""
        fresh = init(measurement, design)
        return (fresh[0], fresh[1], fresh[2], sensor, steps, convention, fresh[6], STEADY)

    def started(measurement: float, change: float, coefficients: tuple, quantum: float,
                noise: float, period: float) -> tuple:
        """(motion, covariance, band): a straight line through the first two readings."""
        rate = 1.0 / coefficients[0]
        floor = quantum * quantum / 12.0 + noise
        bend = max(VAGUE * quantum, SWERVE * 0.5 * period)
        bend *= bend / 3.0
        return ((measurement, change * rate, 0.0, 0.0),
                (floor, floor * rate, 0.0, (2.0 * floor + 0.25 * bend) * rate * rate,
                 0.5 * bend * rate * rate * rate, bend * rate * rate * rate * rate),
                begin_band(quantum * quantum / LONGEST ** 5))

    def waiting(rested: float, quantum: float) -> tuple:
        """The covariance at the first change after so long a rest [s]: no speed is known.

        It shows the quantum. Was it an edge of a shaft that still stands, or has it begun to move?
        The next reading tells.
        """
        rate = 1.0 / (rested if rested < LONGEST else LONGEST)
        least = quantum * quantum / 12.0
        return (least, 0.0, 0.0, 0.0, 0.0, least * rate * rate * rate * rate)

    def stood(edge: float, p: tuple) -> tuple:
        """(motion, covariance, band) of a shaft that stands at an edge, after `waiting`."""
        return ((edge, 0.0, 0.0, 0.0),
                (p[0], 0.0, 0.0, math.sqrt(p[0] * p[5]), 0.0, p[5]),
                begin_band(12.0 * p[0] / LONGEST ** 5))

    def step(state: tuple, coefficients: tuple, design: tuple, measurement: float,
             given: float) -> tuple:
        motion, p, band, sensor, steps, convention, lock, sway = state
        dt = coefficients[0]
        period, laws = design[0], design[4]
        change = measurement - convention[0]
        if change + change >= period or change + change < -period:
            change = wrap(change, period)
        quantum = sensor[0]
        if change != 0.0 and tells_quantum(steps, change, sensor[6], quantum):
            size = abs(measurement) + abs(convention[0])
            steps = follow_steps(steps, change, sensor[6], sensor[7], size, design[2])
            quantum = quantum_of(steps, design[2])
            if quantum != sensor[0] and sensor[0] > 0.0:
                scale = quantum / sensor[0]
                band = (band[0] * scale * scale,) + band[1:]
        stepped, rested = sensor[4], sensor[7]
        sensor = follow_sensor(sensor, change, dt, quantum, MEMORY, BLUR)
        last, convention = convention[0], follow(convention, measurement, period)
        status, count, astray = lock
        if p[3] == 0.0 < p[5] and stepped * change <= 0.0:   # it was an edge, and no start
            motion, p, band = stood(last - 0.5 * stepped, p)
        if p[3] == 0.0:      # no speed is known: the second reading, or the first that differs
            if p[5] == 0.0 < quantum and rested > CONFIRMED * dt:
                p = waiting(rested, quantum)
            elif quantum > 0.0:
                motion, p, band = started(measurement, change, coefficients, quantum, sensor[1],
                                          period)
            return (motion, p, band, sensor, steps, convention,
                    (TRACKING if count + 1.0 >= CONFIRMED and quantum == 0.0 else status,
                     count + 1.0, astray), sway)
        x, v, a, idle = motion
        moved = v * dt + a * coefficients[1]
        off = measurement - x - moved
        if off + off >= period or off + off < -period:
            off = wrap(off, period)
        v += a * dt
        a *= coefficients[2]
        p = predicted(p, band[0], coefficients)
        swing = sway[0] - quantum * quantum / 6.0 - 2.0 * sensor[1]
        if swing > 0.0:
            p = swayed(p, swing, dt)
        idle += dt
        if off > design[3] or off < -design[3]:
            # an eighth of a turn off: no reading of this shaft, or not of this speed
            astray += dt
            if astray > LOST_AFTER:
                return again(measurement, design, sensor, steps, convention)
            return ((measurement - off, v, a, idle), p, band, sensor, steps, convention,
                    (COASTING if status != INITIALISING else status, 0.0, astray), sway)
        noise, ahead, half = sensor[1], change - moved, 0.5 * quantum
        if count > 0.0:
            sway = follow_sway(sway, ahead, SURPRISE * (sensor[2] + quantum * quantum), MEMORY)
        else:     # it moved away from a reading that was not believed
            sway = (sway[0], 0.0, 0.0)
        kind, centre, edges = NOTHING, 0.0, 0.0
        # of most readings it is plain that they tell nothing: no edge, and none was expected
        if (ahead > half or ahead < -half or off > half or off < -half
                or 12.0 * p[0] > quantum * quantum):
            edges = math.sqrt(noise)
            kind, centre, half = interval(off, ahead, quantum, p[0], edges, SIGMAS * edges)
        if kind != NOTHING:
            s = p[0] + noise + 16.0 * BLUR * BLUR * half * half
            d, left = within(centre, half, math.sqrt(s))
            known = 1.0 - left
            z = d / math.sqrt(s * (known if known > UNTOLD else UNTOLD))
            beyond = z > ALARM or z < -ALARM
            if beyond:
                z = ALARM if z > 0.0 else -ALARM
            least = (quantum * quantum + 12.0 * noise) / LONGEST ** 5
            shaken = vibration(sensor)
            if shaken > least:
                least = shaken
            before = band
            band, growth, date, product = follow_band(band, z, known * p[0] / s, idle, least,
                                                      laws)
            idle = 0.0
            if beyond and date == 0.0 and (d > STRAY * quantum or d < -STRAY * quantum):
                band = before[:3] + band[3:7] + before[7:]
                return ((measurement - off, v, a, idle), p, band, sensor, steps, convention,
                        (COASTING if status != INITIALISING else status, 0.0, astray), sway)
            score = d * d / s - known
            if growth > 0.0:
                s -= p[0]
                p = widened(p, growth)
                s += p[0]
            if date > 0.0 or growth > SLIGHT:   # the same reading tells a vaguer prediction more
                if date > 0.0:
                    p = manoeuvred(p, d, date + dt)
                kind, centre, half = interval(off, ahead, quantum, p[0], edges, SIGMAS * edges)
                s = p[0] + noise + 16.0 * BLUR * BLUR * half * half
                d, left = within(centre, half, math.sqrt(s))
                known = 1.0 - left
            if kind != HELD and (score < 0.0 or product < 1.0):
                likelier = follow_noise(noise, score * noise / s, sensor[2], quantum, MEMORY, BLUR)
                if likelier != noise:
                    sensor = sensor[:1] + (likelier,) + sensor[2:]
            pull = d / s
            off -= p[0] * pull
            v += p[1] * pull
            a += p[2] * pull
            if kind != HELD:     # that an edge did not come moves the estimate, but is no reading
                p = corrected(p, s, known)
            turn = (v + v) * dt
            if (turn > period or turn < -period) and period > 0.0:
                # faster than half a turn per sample: lock was lost
                return again(measurement, design, sensor, steps, convention)
        if status != TRACKING:
            count += 1.0
            if count >= CONFIRMED and p[3] * dt * dt < quantum * quantum + 12.0 * noise:
                status, astray = TRACKING, 0.0
            lock = (status, count, astray)
        return (measurement - off, v, a, idle), p, band, sensor, steps, convention, lock, sway

    def bound(sensor: tuple) -> float:
        """The largest speed [rad/s] that a reading unchanged for so long allows."""
        return (sensor[6] + 2.0 * SIGMAS * math.sqrt(sensor[1])) / sensor[7]

    def output(state: tuple, coefficients: tuple, design: tuple, measurement: float,
               given: float) -> tuple:
        x, v, a, _ = state[0]
        sensor = state[3]
        if sensor[7] > 0.0:
            most = bound(sensor)
            v = most if v > most else -most if v < -most else v
        return (present(state[5], x, design[0], design[1]), v, a, state[6][0])

    def stddev(state: tuple, coefficients: tuple, design: tuple) -> tuple[float, float]:
        p, sensor = state[1], state[3]
        floor = sensor[0] * sensor[0] / 12.0   # where in its count the encoder changes is not known
        if p[3] == 0.0:
            return math.sqrt(floor), math.sqrt(2.0 * floor) / coefficients[0]
        squares = state[2][7]
        sigma = math.sqrt(p[3] * (squares if squares > CALM else CALM)) if p[3] > 0.0 else 0.0
        if sensor[7] > 0.0:
            most = bound(sensor)
            sigma = most if sigma > most else sigma
        return math.sqrt(p[0] + floor if p[0] > 0.0 else floor), sigma

    def resume(state: tuple, coefficients: tuple, design: tuple, measurement: float) -> tuple:
        motion, p, band, sensor, steps, convention, lock, sway = state
        quantum = sensor[0]
        status = COASTING if lock[0] == TRACKING else lock[0]
        return ((measurement, motion[1], 0.0, 0.0),
                (quantum * quantum / 12.0, 0.0, 0.0, p[3], 0.0, p[5]),
                (band[0], 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, band[7]),
                (quantum, sensor[1], sensor[2], 0.0, 0.0, 0.0, quantum, 0.0, math.inf, 0.0,
                 0.0), steps,
                follow(convention, measurement, design[0]), (status, 0.0, lock[2]), STEADY)

    def why(state: tuple, design: tuple) -> str:
        given, found = design[2], quantum_of(state[4], 0.0)
        said = agreement(state[4], given)
        if said == TOO_LARGE:
            return (f'quantum {given:.4g} is too large: steps of {found:.4g} were seen, which is '
                    'used instead')
        if said == TOO_SMALL:
            return (f'quantum {given:.4g} is too small: no step below {found:.4g} was seen, which '
                    'is used instead')
        return ''

    return Functions(design, prepare, init, step, output, stddev, resume, lambda dt: None,
                     lambda dt: math.nan, is_angle, why=why)


OBSERVER = Observer(
    name='edge_adaptive', summary='finds bandwidth and noise by itself: say how many counts the '
                                  'encoder has, or not even that',
    gains=Gains, build=build,
    reference='docs/observers/edge_adaptive.md: edges as times, truncated Gaussians, innovation '
              'correlation (Mehra 1970), cumulative sums (Page 1954)',
    gives_acceleration=lambda gains: True)
