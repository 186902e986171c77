# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The verdict on estimates of one joint, which of them to use, and its sentences."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from estimator_pkg.evaluation.text import number

NEVER_SHOWN = 'the angle alone shows neither errors that turn with the joint nor a constant latency'
LOSES = 0.03  # a simpler candidate with this much more error is not used
VAGUE_BOUND = 300.0  # a larger bound is no help [%]
EQUAL_WITHIN = 30.0  # estimates whose errors differ by less may be called equal [%]


@dataclass(frozen=True)
class ComparedPair:
    """Two estimates compared.

    first, second : names; the first has the smaller error.
    sign : 1: the first is better; 0: they cannot be distinguished, or print the same error.
    difference : by how much the second error is larger [%].
    resolution : the smallest difference that would be declared [%].
    events : times in the record of the few events that make half of their difference [s]; ():
        there are many.
    """

    first: str
    second: str
    sign: int
    difference: float
    resolution: float
    events: tuple[float, ...] = ()

    @property
    def within(self) -> float:
        """Upper bound of the difference [%]."""
        return self.difference + self.resolution

    def sentence(self) -> str:
        """Return the result of the pair."""
        if self.sign:
            return f'{self.first} is better than {self.second} (95 %)'
        within = percent(self.within)
        return f'{self.first} and {self.second} cannot be distinguished: within {within} %'


@dataclass(frozen=True)
class Verdict:
    """The ranking of the estimates of one joint.

    best : the name with the smallest error; '' if nothing can be ranked.
    default : the estimate that is used where it is as good as the best; '': none.
    ties : names that are as good as the best, as far as the readings show.
    rms : expected rms error by name, the reference's own variance added [rad/s]; best first.
    pairs : all pairs, best first.
    question_hz : frequency of an oscillation that is motion or sensor noise; nan: none.
    other : the best if it is sensor noise; '': the same, or as good.
    cautions : what limits the verdict, most important first; the last one always applies.
    why : why nothing can be ranked; '' otherwise.
    unranked : names with too few estimates.
    tunable : False if gains must not be chosen from this motion (rest, constant speed).
    """

    best: str = ''
    default: str = ''
    ties: tuple[str, ...] = ()
    rms: Mapping[str, float] = field(default_factory=dict)
    pairs: tuple[ComparedPair, ...] = ()
    question_hz: float = math.nan
    other: str = ''
    cautions: tuple[str, ...] = (NEVER_SHOWN,)
    why: str = ''
    unranked: tuple[str, ...] = ()
    tunable: bool = True

    @property
    def choice(self) -> str:
        """The estimate to use, by the rule of `chosen`; the default if nothing can be ranked."""
        return chosen(self.rms, (self.default,), self.better) if self.best else self.default

    def pair(self, one: str, other: str) -> ComparedPair | None:
        """Return the pair of these names, in the order of their errors."""
        return next(
            (each for each in self.pairs if {each.first, each.second} == {one, other}), None
        )

    def better(self, one: str, other: str) -> int:
        """Return 1 if `one` is better than `other`, -1 if it is worse, 0 if that is not known."""
        found = self.pair(one, other)
        return 0 if found is None else found.sign * (1 if found.first == one else -1)

    def sentences(self, use: str | None = None) -> list[str]:
        """Return the verdict in words; the cautions are last.

        Parameters
        ----------
        use : the estimate that is used; None: the choice.
        """
        cautions = [text[:1].upper() + text[1:] + '.' for text in self.cautions]
        if not self.best:
            keep = f'; use {self.default} as it is' if self.default else ''
            return [f'No ranking: {self.why}{keep}.', *cautions]
        use = self.choice if use is None else use
        of_best = [pair for pair in self.pairs if pair.first == self.best]
        other = bool(self.default) and use != self.default
        if len(self.rms) > 1 and not other and not any(pair.sign for pair in self.pairs):
            found = [self._all_alike(of_best)]
        else:
            found = [self._best(use), *self._pairs(of_best)]
        pair = self.pair(self.best, self.default)
        if pair is not None and pair.events and not pair.sign:
            times = listed([f'{number(each, 3)} s' for each in pair.events])
            found.append(
                f'Few events decide: half of the difference of {pair.first} and {pair.second} is '
                f'at {times}.'
            )
        if self.other:
            found.append(
                f'{self.other} is best if the {percent(self.question_hz)} Hz are sensor '
                f'noise, {self.best} if they are motion: answer with --motion-hz.'
            )
        return [*found, *cautions]

    def _all_alike(self, of_best: Sequence[ComparedPair]) -> str:
        within = max(pair.within for pair in of_best)
        keep = f': keep {self.default}' if self.default else ''
        if within <= EQUAL_WITHIN:
            return f'All are equal within {percent(within)} % here{keep}.'
        most = f' (within {percent(within)} %)' if within < VAGUE_BOUND else ''
        return f'None can be distinguished here{most}{keep}.'

    def _best(self, use: str) -> str:
        own, pair = f'{shown(self.rms[self.best])} rad/s rms', self.pair(self.best, self.default)
        if len(self.rms) == 1:
            return f'{self.best}: {own}.'
        if pair is None:
            return f'{self.best} is best: {own}.'
        known = '95 % sure' if pair.sign else 'not significant'
        return (
            f'{self.best} is best: {own}; {self.default} makes {shown(self.rms[self.default])}, '
            f'{percent(pair.difference)} % more ({known}): '
            f'{"keep" if use == self.default else "use"} {use}.'
        )

    def _pairs(self, of_best: Sequence[ComparedPair]) -> list[str]:
        worse = [pair.second for pair in of_best if pair.sign]
        found = [f'{self.best} is better than {listed(worse)} (95 %).'] if worse else []
        ties = [pair for pair in of_best if not pair.sign]
        found += [f'{pair.sentence()}.' for pair in ties if pair.within <= EQUAL_WITHIN]
        vague = [pair.second for pair in ties if pair.within > EQUAL_WITHIN]
        more = f'{self.best} and {listed(vague)} cannot be distinguished.' if vague else ''
        return found + [more] * bool(vague)

    def as_dict(self) -> dict[str, Any]:
        """Return the verdict for ``--json``."""
        return {
            'best': self.best,
            'choice': self.choice,
            'default': self.default,
            'ties': list(self.ties),
            'rms': dict(self.rms),
            'pairs': [
                {
                    'names': [each.first, each.second],
                    'sign': each.sign,
                    'difference_percent': each.difference,
                    'resolution_percent': each.resolution,
                    'events_s': list(each.events),
                    'text': each.sentence(),
                }
                for each in self.pairs
            ],
            'question_hz': self.question_hz,
            'other': self.other or None,
            'cautions': list(self.cautions),
            'why': self.why,
            'unranked': list(self.unranked),
            'sentences': self.sentences(),
        }


def chosen(
    errors: Mapping[str, float], simpler: Sequence[str], better: Callable[[str, str], int]
) -> str:
    """Return the candidate to use, by the one rule of `doctor`, `evaluate` and `tune`.

    It is that with the least error, unless a simpler one is as good.

    A simpler one is as good if the pair cannot be distinguished (95 %) and its error is less than
    3 % larger. So a difference that is not significant is believed if it is large: on series with
    truth, the measured least error is nearly always the true one.

    Parameters
    ----------
    errors : by candidate [rad/s], or in any other unit; not empty.
    simpler : candidates that have less to set, simplest first: the default is the first. Those
        without an error are ignored.
    better : its result for two candidates is positive if the first is better (95 %).
    """
    best = min(errors, key=errors.__getitem__)
    most = (1.0 + LOSES) * errors[best]
    return next(
        (
            name
            for name in simpler
            if name == best or (errors.get(name, most) < most and better(best, name) <= 0)
        ),
        best,
    )


def shown(rms: float) -> str:
    """Return an rms error [rad/s] as a verdict prints it."""
    return number(rms, 2)


def percent(value: float) -> str:
    """Return a percentage or frequency with two digits."""
    return number(value, 2) if value < 100.0 else f'{value:.0f}'


def listed(names: Sequence[str]) -> str:
    """Return names as part of a sentence."""
    return ' and '.join([', '.join(names[:-1]), names[-1]] if len(names) > 1 else names)
