# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The verdict on estimates of one joint, and its sentences."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from estimator_pkg.evaluation.ranking.choice import chosen
from estimator_pkg.evaluation.text import number

NEVER_SHOWN = 'the angle alone shows neither errors that turn with the joint nor a constant latency'
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
    other : the verdict if it is sensor noise; None: the same.
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
    other: Verdict | None = None
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
        if not self.best:
            keep = f'; use {self.default} as it is' if self.default else ''
            return [f'No ranking: {self.why}{keep}.', *map(_sentence, self.cautions)]
        use = self.choice if use is None else use
        said = [self._first(use), *self._pairs(use), *self._events(), *self._question()]
        return [*said, *map(_sentence, self.cautions)]

    def _first(self, use: str) -> str:
        own = f'{shown(self.rms[self.best])} rad/s rms'
        if len(self.rms) == 1:
            return f'{self.best}: {own}.'
        if not self._differ(use):
            within = max(pair.within for pair in self._of_best())
            keep = f': keep {self.default}' if self.default else ''
            if within > EQUAL_WITHIN:
                most = f' (within {percent(within)} %)' if within < VAGUE_BOUND else ''
                return f'None can be distinguished here{most}{keep}.'
            return f'All are equal within {percent(within)} % here{keep}.'
        text = f'{self.best} is best: {own}'
        pair = self.pair(self.best, self.default)
        if pair is not None:
            known = '95 % sure' if pair.sign else 'not significant'
            text += (
                f'; {self.default} makes {shown(self.rms[self.default])}, '
                f'{percent(pair.difference)} % more ({known}): '
                + (f'keep {use}' if use == self.default else f'use {use}')
            )
        return f'{text}.'

    def _pairs(self, use: str) -> list[str]:
        """Return the pairs of the best, unless all are alike."""
        if not self._differ(use):
            return []
        worse = [pair.second for pair in self._of_best() if pair.sign]
        found = [f'{self.best} is better than {listed(worse)} (95 %).'] if worse else []
        ties = [pair for pair in self._of_best() if not pair.sign]
        vague = [pair.second for pair in ties if pair.within > EQUAL_WITHIN]
        found += [f'{pair.sentence()}.' for pair in ties if pair.within <= EQUAL_WITHIN]
        return found + (
            [f'{self.best} and {listed(vague)} cannot be distinguished.'] if vague else []
        )

    def _events(self) -> list[str]:
        pair = self.pair(self.best, self.default)
        if pair is None or pair.sign or not pair.events:
            return []
        times = listed([f'{number(each, 3)} s' for each in pair.events])
        return [
            f'Few events decide: half of the difference of {pair.first} and {pair.second} is at '
            f'{times}.'
        ]

    def _of_best(self) -> list[ComparedPair]:
        return [pair for pair in self.pairs if pair.first == self.best]

    def _differ(self, use: str) -> bool:
        """Return True if a pair is declared, or another estimate than the default is used."""
        other = bool(self.default) and use != self.default
        return other or any(pair.sign for pair in self.pairs)

    def _question(self) -> list[str]:
        if self.other is None:
            return []
        return [
            f'{self.other.best} is best if the {percent(self.question_hz)} Hz are sensor noise, '
            f'{self.best} if they are motion: answer with --motion-hz.'
        ]

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
            'other': None if self.other is None else self.other.best,
            'cautions': list(self.cautions),
            'why': self.why,
            'unranked': list(self.unranked),
            'sentences': self.sentences(),
        }


def shown(rms: float) -> str:
    """Return an rms error [rad/s] as a verdict prints it."""
    return number(rms, 2)


def percent(value: float) -> str:
    """Return a percentage or frequency with two digits."""
    return number(value, 2) if value < 100.0 else f'{value:.0f}'


def listed(names: Sequence[str]) -> str:
    """Return names as part of a sentence."""
    return ' and '.join([', '.join(names[:-1]), names[-1]] if len(names) > 1 else names)


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + '.'
