# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Bags of joint states for tests."""

from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.messages.joint_state import TYPE, Encoder


def write_bag(path, topics):
    """Write joint states in the order of their arrival; return the path.

    topics : name -> rows (stamp [ns], names, positions, velocities), with the time of their arrival
    [ns] as a fifth if it is another than the stamp.
    """
    every = [(name, *row, row[0])[:6] for name in topics for row in topics[name]]
    encoders = {name: Encoder() for name in topics}
    with BagWriter(path) as bag:
        for name in topics:
            bag.add_topic(name, TYPE)
        for name, stamp, names, positions, velocities, arrival in sorted(
            every, key=lambda row: row[5]
        ):
            raw = encoders[name].encode(stamp, '', names, positions, velocities)
            bag.write(name, arrival, raw)
    return str(path)
