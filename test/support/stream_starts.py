# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Starts of a stream: which messages does a node leave unanswered that a relay next to it gets?

Every start has three new processes: the node, a relay (a bare subscription that notes what it gets)
and a publisher, which publishes at 1 kHz as soon as its publisher has matched both.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import dds
from stream_roles import MESSAGES, PERIOD_NS, stamp_of

TOPIC = '/stream'
PAUSE = 0.5  # [s] between the processes of a start
SLOWEST = 5  # reports in which a node on a busy machine has taken all
ORDERS = (
    'publisher first',  # it waits when the node and the relay begin
    'node first',  # its process begins when the node and the relay wait
    'node first, known process',
)  # its process is there before, its publisher is not


class Role:
    """A process of stream_roles.py."""

    def __init__(self, name: str, *words: str) -> None:
        self._child = subprocess.Popen(
            [
                *(sys.executable, str(Path(__file__).with_name('stream_roles.py')), name),
                *(words or (TOPIC,)),
            ],
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        self.said: list[Any] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._child.stdout is not None
        for line in self._child.stdout:
            with suppress(ValueError):  # DDS prints there, too
                self.said.append(json.loads(line))

    def go_on(self) -> None:
        assert self._child.stdin is not None
        self._child.stdin.write('\n')
        self._child.stdin.flush()

    def __enter__(self) -> Role:
        return self

    def __exit__(self, *error: Any) -> None:
        assert self._child.stdin is not None and self._child.stdout is not None
        self._child.stdin.close()
        try:
            self._child.wait(10.0)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        self._reader.join()
        self._child.stdout.close()


def start(probe: Any, order: str, node: str = 'joint_observer') -> dict[str, int]:
    """Start a stream once; returns numbers of messages.

    They are 'relayed', 'answered', 'missed' (relayed, not answered), and by the node's own account
    'received' and 'counted' as lost; 'first' is the number of the first one missed.
    """
    words = dds.ros_args(remap=(f'joint_states:={TOPIC}',))
    with dds.Observer(probe, f'/{node}', '/unused') as listener:
        publisher = None if order == 'node first' else Role('publish')
        if order == 'publisher first':
            publisher.go_on()
            time.sleep(2 * PAUSE)
        with (
            dds.NodeProcess(f'estimator_pkg.nodes.executables {node}', *words) as process,
            Role('relay') as relay,
        ):
            if order != 'publisher first':
                process.prints(' estimates ')
                probe.until(lambda: relay.said and listener._subscriptions[0].get_publisher_count())
                probe.spin(PAUSE)
                publisher = publisher or Role('publish')
                publisher.go_on()
            with publisher:
                probe.until(lambda: publisher.said)
                for _ in range(SLOWEST):
                    values = listener.next_report()[f'/{node}']
                    received, counted = (
                        int(values[key]) for key in ('messages_received', 'lost_by_dds')
                    )
                    if received + counted == MESSAGES and len(listener.raw_answers) >= received:
                        break
                relay.go_on()
                probe.until(lambda: len(relay.said) > 1)
    begun, relayed = publisher.said[0]['published'], set(relay.said[1]['relayed'])
    answered = {stamp_of(raw) for raw in listener.raw_answers}
    missed = sorted((stamp - begun) // PERIOD_NS for stamp in relayed - answered)
    return {
        'relayed': len(relayed),
        'answered': len(answered),
        'missed': len(missed),
        'first': missed[0] if missed else -1,
        'received': received,
        'counted': counted,
    }
