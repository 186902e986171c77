# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Find a ROS domain that is unused on this machine, for processes that must be isolated."""

from __future__ import annotations

import random
import socket

DOMAINS = range(1, 101)
# DDS (RTPS 9.6.1): the ports of a domain start at 7400 + 250 domain; every participant listens on
# the first one, and the first participant of this machine also on the first one + 10.
BASE, STEP, FIRST = 7400, 250, 10


def free_domain() -> int:
    """Return a domain without a participant on this machine; any, if all seem to be in use."""
    domains = list(DOMAINS)
    random.SystemRandom().shuffle(domains)
    return next(filter(is_free, domains), domains[0])


def is_free(domain: int) -> bool:
    """Return True if no participant of this domain listens on this machine."""
    begin = BASE + STEP * domain
    return all(_can_be_bound(port) for port in (begin, begin + FIRST))


def _can_be_bound(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as trial:
        try:
            trial.bind(('', port))
        except OSError:
            return False
    return True
