# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Find a ROS domain that is unused on this machine, for processes that must be isolated."""

from __future__ import annotations

import random
import socket

DOMAINS = range(1, 101)
# DDS (RTPS 9.6.1): the ports of a domain start at 7400 + 250 domain; every participant listens on
# the first one, and the first participant of this machine also on the first one + 10.
# A domain's last port would be that of a 120th participant: who reserves the domain keeps it bound.
BASE, STEP, FIRST, LAST = 7400, 250, 10, 249

_reserved: list[socket.socket] = []


def free_domain() -> int:
    """Return a domain without a participant on this machine; any, if all seem to be in use.

    It is reserved while this process runs: another process does not get it from this function,
    even if it has no participant (yet, or between two tests).
    """
    domains = list(DOMAINS)
    random.SystemRandom().shuffle(domains)
    for domain in domains:
        begin = BASE + STEP * domain
        reservation = _bound(begin + LAST)
        if reservation is not None and all(map(_can_be_bound, (begin, begin + FIRST))):
            _reserved.append(reservation)
            return domain
    return domains[0]


def _can_be_bound(port: int) -> bool:
    trial = _bound(port)
    if trial is None:
        return False
    trial.close()
    return True


def _bound(port: int) -> socket.socket | None:
    """Return a socket bound to a port; None: another one is."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.bind(('', port))
    except OSError:
        made.close()
        return None
    return made
