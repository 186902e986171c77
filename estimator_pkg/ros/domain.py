"""A ROS domain that nobody on this machine uses, for processes that shall be among themselves."""

from __future__ import annotations

import random
import socket

DOMAINS = range(1, 101)
# DDS (RTPS 9.6.1): ports of a domain begin at 7400 + 250 domain; every participant listens on the
# first one, and the first participant of this machine on the one that is 10 further.
BASE, STEP, FIRST = 7400, 250, 10


def free_domain() -> int:
    """A domain without a participant on this machine; any, where all seem to be in use."""
    domains = list(DOMAINS)
    random.SystemRandom().shuffle(domains)
    return next(filter(is_free, domains), domains[0])


def is_free(domain: int) -> bool:
    """Whether no participant of this domain listens on this machine."""
    begin = BASE + STEP * domain
    return all(_can_be_bound(port) for port in (begin, begin + FIRST))


def _can_be_bound(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as trial:
        try:
            trial.bind(('', port))
        except OSError:
            return False
    return True
