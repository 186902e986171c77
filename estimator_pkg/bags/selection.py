# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Select the topic of the measurement in a bag."""

from __future__ import annotations

from estimator_pkg.bags.reader import CDR, Bag
from estimator_pkg.errors import UserError
from estimator_pkg.messages.joint_state import TYPE
from estimator_pkg.streams.angle import ANGLE_TYPES

TRUTH_NAMESPACE = '/ground_truth/'
USUAL_MEASUREMENT = '/joint_states'
NUMBER_TYPES = {f'std_msgs/msg/{kind}' for kind in ANGLE_TYPES}
ESTIMATE_SUFFIXES = (
    '/estimate',
    '/estimate_stddev',
    '/smoothed',
    '/smoothed_stddev',
)  # topics that our nodes publish


def measurement_topic(bag: Bag, named: str | None = None) -> str:
    """Return the topic of JointStates that is the measurement.

    Parameters
    ----------
    named : the user's choice; None: the only one that is neither truth nor estimate, else
        /joint_states.

    Raises
    ------
        UserError : the topic does not exist, has another type or no CDR messages, or there are
            several candidates.
    """
    if named is not None:
        found = bag.topics.get(named)
        if found is not None and found.count and found.type != TYPE and found.serialization == CDR:
            raise UserError(
                f"topic '{named}' of {bag.path} is {found.type}, not {TYPE}: select a "
                f'number in it with --angle {named}:FIELD'
            )
        return bag.require(named, [TYPE]).name
    bag.check_messages()
    names = measured_topics(bag)
    if USUAL_MEASUREMENT in names:
        names = [USUAL_MEASUREMENT]
    if len(names) == 1:
        return bag.require(names[0], [TYPE]).name
    if names:
        raise UserError(
            f'{bag.path} has several topics of joint states: choose one with '
            f'--measurement ({", ".join(sorted(names))})'
        )
    raise UserError(
        f'{bag.path} has no measured joint states: choose a topic with --measurement, or '
        f'a number with --angle {a_number(bag)}; it has {bag.listing()}'
    )


def a_number(bag: Bag) -> str:
    """Return what ``--angle`` takes for the first number in the bag; 'TOPIC:FIELD': none."""
    numbers = (
        each.name for each in bag.topics.values() if each.type in NUMBER_TYPES and each.count
    )
    return next((f'{name}:data' for name in numbers), 'TOPIC:FIELD')


def measured_topics(bag: Bag, *, empty: bool = False) -> list[str]:
    """Return JointState topics that are neither truth nor estimate; `empty`: also empty ones."""
    return [
        topic.name
        for topic in bag.topics.values()
        if topic.type == TYPE
        and (topic.count or empty)
        and TRUTH_NAMESPACE not in f'{topic.name}/'
        and not topic.name.endswith(ESTIMATE_SUFFIXES)
    ]
