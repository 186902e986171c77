# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The live table of the demo: that of `watch`, and the errors against the truth."""

from __future__ import annotations

import math
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from estimator_pkg.circle import wrap
from estimator_pkg.messages.joint_state import Decoder, JointState
from estimator_pkg.nodes.watching import Watching
from estimator_pkg.watch import table

if TYPE_CHECKING:
    from rclpy.node import Node
    from rich.console import Group

KEPT = 200  # messages kept per topic, to match estimates with truth by stamp


class Moment(NamedTuple):
    """Velocities at one stamp [rad/s]: true, difference of the readings, estimate."""

    true: float
    difference: float
    estimate: float


class Listener:
    """Keeps the newest messages of measurement, truth and estimate by their stamps."""

    def __init__(self, node: Node, topics: tuple[str, str, str]) -> None:
        from rclpy.qos import qos_profile_sensor_data
        from sensor_msgs.msg import JointState as Message

        self._kept: list[dict[int, JointState]] = [{} for _ in topics]
        for topic, kept in zip(topics, self._kept):
            take = partial(self._take, kept, Decoder())
            node.create_subscription(Message, topic, take, qos_profile_sensor_data, raw=True)

    def _take(self, kept: dict[int, JointState], decoder: Decoder, raw: bytes) -> None:
        message = decoder.decode(raw)
        kept[message.stamp_ns] = message
        if len(kept) > KEPT:
            del kept[min(kept)]

    def moment(self) -> Moment | None:
        """Return the newest stamp of which everything has arrived, else None."""
        measured, truth, estimates = self._kept
        for before, stamp in reversed(list(pairwise(sorted(measured)))):
            if stamp not in truth or stamp not in estimates:
                continue
            velocity = estimates[stamp].velocities[0]
            if not math.isnan(velocity):
                angles = (measured[each].positions[0] for each in (stamp, before))
                moved = wrap(next(angles) - next(angles), 2.0 * math.pi)
                difference = moved / ((stamp - before) * 1e-9)
                return Moment(truth[stamp].velocities[0], difference, velocity)
        return None


def picture(moment: Moment, watching: Watching, seconds: float) -> Group:
    """Return the display: what the observer reports, and true, differenced, estimated velocity."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    compared = Table('velocity', box=None, pad_edge=False)
    for header in ('now, rad/s', 'error, rad/s'):
        compared.add_column(header, justify='right', width=14)
    compared.add_row('true', f'{moment.true:+.3f}')
    for name in ('difference', 'estimate'):
        value = getattr(moment, name)
        compared.add_row(name, f'{value:+.3f}', f'{value - moment.true:+.3f}')
    begun = Text(f't {seconds:.1f} s, {watching.count} estimates', style='dim')
    return Group(begun, table(watching.joints), Text(), compared)
