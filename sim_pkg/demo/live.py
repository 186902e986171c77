# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The live table of the demo: that of `watch`, and the errors against the truth."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from estimator_pkg.circle import wrap
from estimator_pkg.messages.joint_state import Decoder, JointState
from estimator_pkg.nodes.watching import Joint
from estimator_pkg.watch import table
from sim_pkg.demo.command import ESTIMATE, MEASURED, TRUTH

if TYPE_CHECKING:
    from rclpy.node import Node
    from rich.console import Group

KEPT = 200  # messages kept per topic, to match estimates with truth by stamp


class Moment(NamedTuple):
    """What is known of one stamp: rad, rad/s; `received` estimates came."""

    seconds: float
    angle: float
    true: float
    difference: float
    estimate: float
    received: int


class Listener:
    """Keeps the newest messages of measurement, truth and estimate by their stamps."""

    def __init__(self, node: Node) -> None:
        from rclpy.qos import qos_profile_sensor_data
        from sensor_msgs.msg import JointState as Message

        self._kept: dict[str, dict[int, JointState]] = {}
        self.count = 0  # of estimates
        self._first_ns = 0
        for topic in (MEASURED, TRUTH, ESTIMATE):
            kept = self._kept[topic] = {}
            take = partial(self._take, topic == ESTIMATE, kept, Decoder())
            node.create_subscription(Message, topic, take, qos_profile_sensor_data, raw=True)

    def _take(
        self, counts: bool, kept: dict[int, JointState], decoder: Decoder, raw: bytes
    ) -> None:
        message = decoder.decode(raw)
        kept[message.stamp_ns] = message
        if len(kept) > KEPT:
            del kept[min(kept)]
        self.count += counts

    def moment(self) -> Moment | None:
        """Return the newest stamp of which everything has arrived, else None."""
        measured, truth, estimates = self._kept.values()
        for stamp in sorted(measured.keys() & truth.keys() & estimates.keys(), reverse=True):
            before = max((each for each in measured if each < stamp), default=None)
            velocity = estimates[stamp].velocities[0]
            if before is None or math.isnan(velocity):
                continue
            angle = measured[stamp].positions[0]
            moved = wrap(angle - measured[before].positions[0], 2.0 * math.pi)
            self._first_ns = self._first_ns or stamp
            return Moment(
                (stamp - self._first_ns) * 1e-9,
                angle,
                truth[stamp].velocities[0],
                moved / ((stamp - before) * 1e-9),
                velocity,
                self.count,
            )
        return None


def picture(moment: Moment, joints: Mapping[str, Joint]) -> Group:
    """Return the display: what the observer reports, and true, differenced, estimated velocity."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    compared = Table('velocity', box=None, pad_edge=False)
    for header in ('now, rad/s', 'error, rad/s'):
        compared.add_column(header, justify='right', width=14)
    compared.add_row('true', f'{moment.true:+.3f}')
    for name, value in (('difference', moment.difference), ('estimate', moment.estimate)):
        compared.add_row(name, f'{value:+.3f}', f'{value - moment.true:+.3f}')
    begun = (
        f't {moment.seconds:.1f} s, {moment.received} estimates, measured {moment.angle:+.4f} rad'
    )
    return Group(Text(begun, style='dim'), table(joints), Text(), compared)


def line(moment: Moment, joints: Mapping[str, Joint]) -> str:
    """Return the display in one line, for where no terminal is."""
    interval = next(iter(joints.values()), Joint()).interval
    shown = f'{interval:.3f}' if math.isfinite(interval) else '-'  # not received yet
    return (
        f't {moment.seconds:5.2f} s  angle {moment.angle:+.4f} rad  true {moment.true:+8.3f}  '
        f'finite difference {moment.difference:+8.3f}  estimate {moment.estimate:+8.3f} '
        f'+- {shown}  error {moment.estimate - moment.true:+.3f} rad/s'
    )
