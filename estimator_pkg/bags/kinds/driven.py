"""What replays have in common whose observers know an input, as the nodes of `nodes/driven.py`."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

from estimator_pkg.bags.kinds.contract import PUBLISHER, Setup
from estimator_pkg.bags.kinds.efforts import EFFORTS
from estimator_pkg.bags.kinds.one_by_one import OneByOne
from estimator_pkg.messages.joint_state import Decoder, Encoder
from estimator_pkg.nodes.effort_settings import EffortSettings


class Sample(NamedTuple):
    """One message of the measurement in SI units; `efforts` is empty where it carries none."""

    stamp_ns: int
    frame_id: str
    names: Sequence[str]
    positions: Sequence[float]
    efforts: Sequence[float]


class Commanded(Protocol):
    """A bank of joints whose efforts may come on a topic of their own."""

    def command(self, stamp_ns: int, names: Sequence[str], efforts: Sequence[float]) -> Any:
        """Efforts that act from this stamp on."""


class DrivenReplay(OneByOne):
    """Takes positions with efforts, and commands.

    Parameters
    ----------
    bank : takes the commands. orders : names of the joints, all and those that have an input.
    """

    def __init__(self, setup: Setup, settings: EffortSettings, bank: Commanded,
                 orders: Sequence[Sequence[str]]) -> None:
        super().__init__()
        self._topic = setup.topics[0].name
        self._command = bank.command
        self._commands = settings.commands(orders)
        self._by_publisher = settings.stamp_source == PUBLISHER
        self._layout = Decoder().layout
        self._encode, self._encode_stddev = Encoder().encode, Encoder().encode

    def take(self, topic: str, raw: bytes, publish_ns: int) -> list[dict[int, bytes]]:
        """See `OneByOne`."""
        if topic == self._topic:
            self.received += 1
            layout = self._layout(raw)
            return [self.answer(Sample(
                publish_ns if self._by_publisher else layout.stamp_ns(raw), layout.frame_id,
                layout.names, layout.numbers(raw, 0), layout.numbers(raw, 2)))]
        if topic == EFFORTS:
            self._command(*self._commands.decode(raw, publish_ns))
        else:
            self.event(raw)
        return []

    @abstractmethod
    def answer(self, sample: Sample) -> dict[int, bytes]:
        """The answer to a sample: the bytes by output."""

    def event(self, raw: bytes) -> None:
        """A message of a further topic, for kinds that listen to one."""

    def encoded(self, sample: Sample, names: Sequence[str],
                estimates: Sequence[Sequence[float]], deviations: Sequence[Sequence[float]]
                ) -> dict[int, bytes]:
        """Estimate and standard deviation of these joints, each position and velocity first."""
        return {
            0: self._encode(sample.stamp_ns, sample.frame_id, names,
                            [each[0] for each in estimates], [each[1] for each in estimates]),
            1: self._encode_stddev(sample.stamp_ns, sample.frame_id, names,
                                   [each[0] for each in deviations],
                                   [each[1] for each in deviations])}
