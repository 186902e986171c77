# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Which observer and which gains to use for the joints of a measurement, ranked without truth.

Each observer estimates the velocity of each joint, at its defaults and with a few bandwidths. Gains
are chosen on the first part of the record, and dropped where they are worse on the rest (95 %). Of
all that are left, the one with the least error on the whole record is used, by the rule of
`ranking.verdict.chosen`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.estimate import VALID
from estimator_pkg.evaluation.checks.readings import Readings, late_by
from estimator_pkg.evaluation.delay import UNKNOWN_DELAY, Delay, measured
from estimator_pkg.evaluation.entries import Entry, angle_observers
from estimator_pkg.evaluation.ranking.ranking import at_reference, rank
from estimator_pkg.evaluation.ranking.verdict import Verdict, chosen, shown
from estimator_pkg.evaluation.reference.motion import ReferenceMotion
from estimator_pkg.observers import DEFAULT
from estimator_pkg.parameters import declared

Array = NDArray[np.float64]

TRIED_HZ = (4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0)  # those that are tried [Hz],
BELOW = 6.0  # up to this fraction of the sample rate
PREFER = ('smooth', 'fast')
TRAINED = 0.7  # part of the record on which gains are chosen
BASELINE = 'finite_difference'


class JointRanking(NamedTuple):
    """What one joint's candidates do.

    verdict : of the candidates at their defaults, and of the best gains of each observer.
    held_out : the same on the part of the record that chose no gains.
    best : observer -> its best candidate on the first part.
    delays : candidate -> delay; nan: not determined.
    """

    verdict: Verdict
    held_out: Verdict
    best: Mapping[str, Entry]
    delays: Mapping[str, Delay]

    @property
    def compared(self) -> bool:
        """True if the motion ranks the candidates: noise alone does not choose an observer."""
        return bool(self.verdict.best) and self.verdict.tunable

    def gains(self, observer: str) -> Entry:
        """Return its best candidate, or its defaults if they are better on held-out data (95 %)."""
        found = self.best[observer]
        worse = self.held_out.better(found.label, observer) < 0
        return Entry(observer, observer) if worse else found


@dataclass(frozen=True)
class Choice:
    """The observer for all joints, and the gains of each.

    observer : its name. gains : joint -> values that differ from the defaults, without the quantum.
    tuned : True if it is not the default as it is. more : by how much the error of that is larger
    [%]. sure : True if this is significant for a joint.
    """

    observer: str = DEFAULT
    gains: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    tuned: bool = False
    more: float = 0.0
    sure: bool = False

    def label(self, joint: str) -> str:
        """Return the name of this joint's candidate."""
        return _label(self.observer, self.gains.get(joint, {}))


def _label(observer: str, values: Mapping[str, Any]) -> str:
    return ' '.join(
        [observer, *(f'{v:g} Hz' if k == 'bandwidth_hz' else str(v) for k, v in values.items())]
    )


def candidates(rate: float) -> list[Entry]:
    """Return the candidates at this sample rate [Hz], the defaults first."""
    found = [Entry(name, name) for name in angle_observers()]
    for name in angle_observers():
        gains = declared(type(Entry('', name).joint().observer.gains()))
        if 'bandwidth_hz' in gains:
            found += [_entry(name, bandwidth_hz=hz) for hz in TRIED_HZ if BELOW * hz <= rate]
        elif 'prefer' in gains:
            found += [_entry(name, prefer=each) for each in PREFER]
    return found


def _entry(observer: str, **values: Any) -> Entry:
    return Entry(_label(observer, values), observer, tuple(values.items()))


def estimates(seen: Readings, reference: ReferenceMotion, entry: Entry, rows: NDArray) -> Array:
    """Return the velocities [rad/s] of a candidate at the reference's stamps, shape (n,), or nan.

    Parameters
    ----------
    rows : shape (k,), indices of the readings that it takes, in the order of their arrival.
    """
    more = {'quantum': seen.own_quantum} if seen.own_quantum else {}
    joint = entry.joint(wrap_period=seen.period, **more)
    stamps = seen.stamps_ns[rows]
    out = joint.run(stamps, seen.position[rows])
    good = out.used & np.isin(out.status, VALID)
    return at_reference(reference, stamps[good], out.velocity[good])


def answer(
    seen: Readings, reference: ReferenceMotion, rows: NDArray, motion_hz: float | None = None
) -> JointRanking:
    """Return the verdict on all candidates of one joint.

    Parameters
    ----------
    reference : its motion.
    rows : shape (k,), indices of the readings from which that was made, as for `estimates`.
    motion_hz : highest frequency at which the joint moves [Hz]; None: not known.
    """
    entries = {entry.label: entry for entry in candidates(1.0 / seen.step)}
    velocity = {label: estimates(seen, reference, entry, rows) for label, entry in entries.items()}
    first, last = int(reference.stamps[0]), int(reference.stamps[-1])
    cut = first + round(TRAINED * (last - first))

    def ranked(labels: Sequence[str], begin: int, end: int) -> Verdict:
        part = reference.between(begin - 1, end)
        kept = (reference.stamps > begin - 1) & (reference.stamps <= end)
        return rank({each: velocity[each][kept] for each in labels}, part, DEFAULT, motion_hz)

    trained = ranked(list(entries), first, cut)
    best = {name: Entry(name, name) for name in angle_observers()}
    for label in reversed(list(trained.rms)):
        best[entries[label].observer] = entries[label]
    labels = list(dict.fromkeys([*angle_observers(), *(each.label for each in best.values())]))
    whole = ranked(labels, first, last)
    held_out = ranked(labels, cut + 1, last)
    if not trained.tunable or not whole.best:
        best = {name: Entry(name, name) for name in angle_observers()}
    counted = reference.firm
    delays = {
        label: measured(
            reference.time[counted], velocity[label][counted], reference.velocity[counted]
        ).known
        for label in {*labels, *(each.label for each in best.values())}
    }
    return JointRanking(whole, held_out, best, delays)


def choose(answers: Mapping[str, JointRanking]) -> Choice:
    """Return the choice for the joints of one node, which has one observer.

    The error of a candidate is the geometric mean over the joints. It is better than another one
    (95 %) if it is so for a joint. An observer at its defaults is simpler than any gains, and the
    default observer is the simplest.
    """
    kept = {joint: each for joint, each in answers.items() if each.compared}
    if not kept:
        return Choice()
    errors: dict[str, float] = {}
    entries: dict[str, dict[str, Entry]] = {}
    for observer in angle_observers():
        plain = Entry(observer, observer)
        tuned = {joint: each.gains(observer) for joint, each in kept.items()}
        for name, own in ((observer, dict.fromkeys(kept, plain)), (f'{observer} tuned', tuned)):
            if all(own[joint].label in each.verdict.rms for joint, each in kept.items()):
                rms = [each.verdict.rms[own[joint].label] for joint, each in kept.items()]
                errors[name] = math.exp(sum(map(math.log, rms)) / len(rms))
                entries[name] = own
    if not errors:
        return Choice()

    def better(one: str, other: str) -> int:
        """Return 1 if a joint's estimate is better (95 %), else 0."""
        return max(
            each.verdict.better(entries[one][joint].label, entries[other][joint].label)
            for joint, each in kept.items()
        )

    plain_ones = sorted(filter(errors.__contains__, angle_observers()), key=errors.__getitem__)
    used = chosen(errors, [DEFAULT, *plain_ones], better)
    own = entries[used]
    return Choice(
        next(iter(own.values())).observer,
        {joint: dict(each.values) for joint, each in own.items() if each.values},
        used != DEFAULT,
        100.0 * (errors.get(DEFAULT, math.inf) / errors[used] - 1.0),
        DEFAULT not in errors or better(used, DEFAULT) > 0,
    )


def sentences(joint: str, made: JointRanking, choice: Choice) -> list[str]:
    """Return the verdict on a joint in words."""
    label, verdict = choice.label(joint), made.verdict
    said = []
    if label in verdict.rms:
        values = choice.gains.get(joint, {})
        how = 'with ' + ', '.join(f'{k}: {v}' for k, v in values.items()) if values else 'as it is'
        said.append(
            f'Use {choice.observer} {how}: {_quality(label, made)}. Your finite difference, '
            f'low-passed: {_quality(BASELINE, made)}.'
        )
        if made.compared and chosen(verdict.rms, (label,), verdict.better) != label:
            used = {made.gains(each).label for each in made.best}.union(made.best)
            why = (
                'all joints have one observer'
                if verdict.best in used
                else f'it is worse on the last {100.0 - 100.0 * TRAINED:.0f} % alone (95 %)'
            )
            said.append(f'{verdict.best} is not used: {why}.')
    return said + verdict.sentences(label)


def _quality(label: str, made: JointRanking) -> str:
    error, late = made.verdict.rms.get(label, math.nan), made.delays.get(label, UNKNOWN_DELAY)
    return f'error {shown(error)} rad/s rms, {late_by(late)}'
