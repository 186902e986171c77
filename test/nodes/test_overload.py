# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""More than a node can do: too many messages, too many names."""

from __future__ import annotations

import os
from itertools import pairwise
from pathlib import Path

import dds
import pytest
from stream_roles import Flood

from estimator_pkg.streams.adaptive import AdaptiveStream
from estimator_pkg.streams.angle import AngleStream

BEGIN = 1_700_000_000_000_000_000  # [ns]
MS = 1_000_000


# ---------------------------------------------------------------- messages faster than callbacks

ANSWERED = 0.5  # [s] of the node's CPU time, which does not depend on what else the machine does


class Watched:
    """The process of a node: its CPU time, its memory, and what its /diagnostics say."""

    def __init__(self, probe, name, process):
        from diagnostic_msgs.msg import DiagnosticArray

        self._pid, self._name = process.pid, f'/{name}'
        self.reported: list[float] = []  # CPU time at each report [s]
        self.values: dict[str, str] = {}
        probe.node.create_subscription(DiagnosticArray, '/diagnostics', self._diagnosed, 10)

    def _diagnosed(self, message):
        for status in message.status:
            if status.name.partition(':')[0] == self._name:
                self.reported.append(self.cpu())
                self.values.update({item.key: item.value for item in status.values})

    def cpu(self):
        """CPU time since its start [s]."""
        text = Path(f'/proc/{self._pid}/stat').read_text()
        user, system = text.rpartition(')')[2].split()[11:13]
        return (int(user) + int(system)) / os.sysconf('SC_CLK_TCK')

    def memory(self):
        """Memory in use [MB]."""
        text = Path(f'/proc/{self._pid}/statm').read_text()
        return int(text.split()[1]) * os.sysconf('SC_PAGE_SIZE') / 1e6

    def counted(self):
        """Messages received and lost, by the node's own account."""
        return int(self.values['messages_received']) + int(self.values['lost_by_dds'])


def requests(name):
    """(class, name, request) of services that must answer."""
    from rcl_interfaces.srv import GetParameters
    from std_srvs.srv import Trigger

    yield GetParameters, f'/{name}/get_parameters', GetParameters.Request(names=['use_sim_time'])
    yield Trigger, f'/{name}/reset', Trigger.Request()


def test_a_flood_starves_neither_services_nor_reports_and_is_counted(probe):
    """The node gets more than it can handle: it still answers, and says what it lost."""
    name = 'adaptive_observer'
    with (
        dds.NodeProcess(f'estimator_pkg.nodes.executables {name}', *dds.ros_args()) as process,
        Flood(8000.0, 60) as source,
    ):
        node = Watched(probe, name, process)
        probe.until(lambda: len(node.reported) > 1)
        before, first = node.memory(), len(node.reported)
        longest = 0.0, ''
        for _ in range(3):
            for request in requests(name):
                begun = node.cpu()
                probe.call(*request)
                longest = max(longest, (node.cpu() - begun, request[1]))
        probe.until(lambda: len(node.reported) > first + 2)
        between = max(b - a for a, b in pairwise(node.reported[first:]))
        grown = node.memory() - before
        source.go_on()
        probe.until(lambda: source.said)
        published = source.said[0]['published']
        probe.until(lambda: node.counted() >= published)
        now = len(node.reported)
        probe.until(lambda: len(node.reported) > now)
        assert node.counted() == published, node.values
        assert int(node.values['lost_by_dds']) > 0.1 * published
        assert longest[0] < ANSWERED, f'{longest} s'
        assert between < 1.0 + ANSWERED, f'reports are {between} s apart'
        assert grown < 5.0, f'its memory grew by {grown} MB'


# ---------------------------------------------------------------- names without end


def feed(live, names, k):
    args = (BEGIN + k * MS, tuple(names), (0.01 * k,) * len(names))
    bank = live.node.stream.bank
    if isinstance(live.node.stream, AdaptiveStream):
        bank.take(*args, (0.1,) * len(names))
    else:
        bank.update(*args)


@pytest.mark.parametrize('kind', [AngleStream, AdaptiveStream])
def test_joints_expire_unless_they_are_named(own, kind, capfd):
    live = own(kind, joints_max=2, expiry=0.02, **{'per_joint.kept.wrap_period': 0.0})
    for k in range(3):
        feed(live, ['kept', 'old', f'new_{k}'], k)
    live.node.health.look()
    before = live.node.health._totals()
    assert before['received'] == 9 and before['dropped.refused'] == 2
    assert before['received'] == before['used'] + sum(
        count for key, count in before.items() if key.startswith('dropped.')
    )
    live.now += 1.1
    live.node.health.look()
    assert set(live.node.stream.bank.joints) == {'kept'}
    after = live.node.health._totals()
    assert after['joints_expired'] == 2 and after['received'] == 9
    assert after['used'] == before['used']
    said = capfd.readouterr().err
    assert 'removed: no sample for 0.02 s (expiry)' in said and "'joints_max'" in said
    feed(live, ['old'], 9)
    assert live.node.stream.bank.joints['old'].used == 1
