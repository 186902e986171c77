# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""An observer and a family of another package, through entry points: live as in replay."""

import os
import subprocess
import sys

import dds
import numpy as np
import pytest
from foreign_package import OBSERVER, install

from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.messages.joint_state import TYPE, Encoder

FAMILY = '''
    """Two encoders on one shaft: the angle is the mean of both readings."""

    from dataclasses import dataclass

    from estimator_pkg import observers
    from estimator_pkg.driver.bank import Bank
    from estimator_pkg.driver.joint import JointSettings
    from estimator_pkg.messages.joint_state import TYPE, Decoder
    from estimator_pkg.parameters import parameter
    from estimator_pkg.streams.answer import Answering
    from estimator_pkg.streams.contract import Port, Stream, StreamSettings


    @dataclass(frozen=True)
    class Settings(StreamSettings):
        observer: str = parameter('twin', unit='', structural=True, description='twin')
        factor: float = parameter(1.0, unit='', range=(-9.0, 9.0), description='of the mean')

        def find_observer(self):
            return observers.find(self.observer)


    @dataclass(frozen=True)
    class OfJoint(JointSettings):
        offset: float = parameter(0.0, unit='rad', range=(-7.0, 7.0), description='of the mean')


    class TwinStream(Stream):
        KIND, NODE, SETTINGS = 'two_encoders', 'twin_observer', Settings
        PER_JOINT = OfJoint

        def __init__(self, settings, configuration):
            super().__init__(settings, configuration.observer, Bank(configuration),
                             [Port('joint_states', TYPE)])
            self._decode, self._answer = Decoder().decode, Answering(self)

        @classmethod
        def start(cls, settings, configuration):
            return cls(settings, configuration)

        def take(self, port, raw, publish_ns):
            message = self._decode(raw)
            mean = sum(message.positions) / len(message.positions)
            mean *= self.settings.factor
            mean += self.bank.configuration.for_joint('shaft')[1].offset
            taken = self.bank.update(message.stamp_ns, ('shaft',), (mean,))
            return (self._answer(message.stamp_ns, message.frame_id, taken),)
'''
NODE = """
    import sys

    from estimator_pkg.nodes.executables import of_stream

    twin_observer = of_stream('two_encoders')
    if __name__ == '__main__':
        sys.exit(twin_observer())
"""
TWIN = """
    from alpha_beta import AlphaBeta

    class Twin(AlphaBeta):
        name, kind = 'twin', 'two_encoders'
"""
FILES = {'alpha_beta.py': OBSERVER, 'twin.py': TWIN, 'twin_stream.py': FAMILY, 'twin_node.py': NODE}
ENTRY_POINTS = """
    [velocity_estimator.observers]
    twin = twin:Twin
    [velocity_estimator.streams]
    two_encoders = twin_stream:TwinStream
"""


def test_live_is_replay(probe, tmp_path, monkeypatch):
    monkeypatch.setenv('PYTHONPATH', str(install(tmp_path / 'site', FILES, ENTRY_POINTS)))
    encode = Encoder().encode
    angles = 3.0 * np.sin(0.004 * np.arange(500))
    raws = [
        encode(10**15 + k * 10**6, 'base', ('a', 'b'), (angle, angle + 0.01))
        for k, angle in enumerate(angles.tolist())
    ]
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic('/joint_states', TYPE)
        for k, raw in enumerate(raws):
            writer.write('/joint_states', 10**15 + k * 10**6, raw)
    command = ['replay', tmp_path / 'bag', '--observer', 'twin', '--set', 'offset=0.5']
    command += ['--out', tmp_path / 'out']
    script = 'import sys; from estimator_pkg.cli import main; sys.exit(main())'
    subprocess.run([sys.executable, '-c', script, *command], check=True, env=os.environ.copy())
    with open_bag(tmp_path / 'out') as bag:
        topics = [name for name in bag.topics if name.endswith('/estimate')]
        replayed = [bytes(message.raw) for message in bag.messages(topics)]
    words = dds.ros_args('offset:=0.5', remap=['joint_states:=/foreign'])
    with (
        dds.NodeProcess('twin_node', *words),
        dds.Observer(probe, '/twin_observer', '/foreign') as live,
    ):
        live.connect().feed(raws)
        assert live.raw_answers == replayed
        assert live.set(factor=-2.0).successful  # a live parameter of the stream
        assert len(live.feed([encode(10**16, 'base', ('a', 'b'), (1.0, 1.0))])) == 1
    assert live.answers.pop().positions[0] == pytest.approx(-1.5)
    speeds = [answer.velocities[0] for answer in live.answers[100:]]
    truth = 3.0 * 4.0 * np.cos(0.004 * np.arange(500))
    assert np.nanmax(np.abs(speeds - truth[100:500])) < 0.5
