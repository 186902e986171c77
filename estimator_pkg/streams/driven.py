# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Shared by streams of observers with a known input: positions with efforts."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, ClassVar

from estimator_pkg.driver.efforts import EFFORT_COMMAND, EFFORT_FIELD
from estimator_pkg.messages import multi_array
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.messages.joint_state import Decoder
from estimator_pkg.observers.contract import Observer
from estimator_pkg.parameters import structural
from estimator_pkg.streams.answer import Answering
from estimator_pkg.streams.contract import (
    ESTIMATE,
    PUBLISHER,
    STDDEV,
    Answer,
    Output,
    Port,
    Stream,
    StreamSettings,
)
from estimator_pkg.streams.sources import JointStates, Sample

BY_NAME, ARRAY = 'JointState', 'Float64MultiArray'

Command = tuple[int, Sequence[str], Sequence[float]]  # (stamp [ns], names, efforts)


class EffortCommands:
    """Decodes a stream of effort commands.

    Parameters
    ----------
    kind : BY_NAME (efforts by name) or ARRAY (numbers only, without a stamp).
    orders : possible names for the numbers of an array; its length selects one.
    by_publisher : the stamp is the time at which a message was sent, as for every array.
    """

    def __init__(self, kind: str, orders: Sequence[Sequence[str]], by_publisher: bool) -> None:
        self._names = {len(names): tuple(names) for names in orders} if kind == ARRAY else None
        self._by_publisher = by_publisher
        self._layout = Decoder().layout

    def decode(self, raw: bytes, sent_ns: int) -> Command:
        """Decode the command in `raw`, which was sent at `sent_ns`.

        Raises
        ------
        MalformedMessageError : not such a message, or an array of another length.
        """
        if self._names is not None:
            numbers = multi_array.numbers(raw)
            names = self._names.get(len(numbers))
            if names is None:
                raise MalformedMessageError(
                    f'{len(numbers)} numbers, but there are '
                    f'{" or ".join(map(str, self._names))} joints'
                )
            return sent_ns, names, numbers
        layout = self._layout(raw)
        efforts = layout.numbers(raw, 2)
        if len(efforts) != len(layout.names):
            raise MalformedMessageError(f'{len(layout.names)} names, but {len(efforts)} efforts')
        return sent_ns if self._by_publisher else layout.stamp_ns(raw), layout.names, efforts


@dataclass(frozen=True)
class EffortSettings(StreamSettings):
    """The source of a node's efforts, and the time of its messages."""

    input: str = structural(
        EFFORT_FIELD,
        choices=(EFFORT_FIELD, EFFORT_COMMAND),
        description='source of the efforts: the effort field of joint_states, or the topic '
        'effort_command (see effort_is for when they act)',
    )
    effort_command_type: str = structural(
        BY_NAME,
        choices=(BY_NAME, ARRAY),
        description='type of the topic effort_command: sensor_msgs/JointState, efforts by name; or '
        'std_msgs/Float64MultiArray, one number per joint (or per joint with an input), in the '
        'order of the joints, with the time of publishing',
    )
    stamp_source: str = structural(
        'header',
        choices=('header', 'publisher'),
        description='time of a message: its header stamp, or the time of publishing; events always '
        'have their header stamp',
    )


class DrivenStream(Stream):
    """Takes positions with efforts, and commands.

    Parameters
    ----------
    orders : possible joint names for the numbers of a Float64MultiArray: of all joints, and of
        those with an input.
    events : a further input. outputs : further outputs.
    """

    USUAL: ClassVar[tuple[str, ...]] = ('/joint_states', '/effort_command')
    MISMATCH = (
        'their arrays differ in length, or a joint or an effort that the observer needs is '
        'missing (with input: effort_command, efforts have their own topic)'
    )
    settings: EffortSettings
    _efforts_each = 1  # that an observer takes at once

    def __init__(
        self,
        settings: EffortSettings,
        observer: type[Observer],
        bank: Any,
        orders: Sequence[Sequence[str]],
        *,
        events: Sequence[Port] = (),
        outputs: Sequence[Output] = (),
    ) -> None:
        by_publisher = settings.stamp_source == PUBLISHER
        inputs = [Port('joint_states', JOINT_STATE), *events]
        self._efforts = -1  # number of the port; -1: none
        if settings.input == EFFORT_COMMAND:
            array = settings.effort_command_type == ARRAY
            self._efforts = len(inputs)
            inputs.append(
                Port('effort_command', multi_array.TYPE if array else JOINT_STATE, answered=False)
            )
        outputs = (ESTIMATE, STDDEV, *outputs)
        super().__init__(settings, observer, bank, inputs, outputs)
        self._commands = EffortCommands(settings.effort_command_type, orders, by_publisher)
        self._sample = JointStates(by_publisher).sample
        self._answering = Answering(self)

    def take(self, port: int, raw: bytes, publish_ns: int) -> Iterable[Answer]:
        """See `Stream`."""
        if port == 0:
            sample = self._sample(raw, publish_ns)
            return chain((self.answer(sample),), self.further(sample))
        if port == self._efforts:
            self.bank.command(*self._commands.decode(raw, publish_ns))
        else:
            self.event(raw)
        return ()

    @abstractmethod
    def answer(self, sample: Sample) -> Answer:
        """Return the answer to a sample."""

    def further(self, sample: Sample) -> Iterable[Answer]:
        """Return what else answers a sample, made after the answer has left."""
        return ()

    def event(self, raw: bytes) -> None:
        """Take a message of the port of events."""

    def _build(self, configuration: Any, joint: str) -> Any:
        made = super()._build(configuration, joint)
        configuration.for_joint(joint)[1].check_inputs(self._efforts_each, self._called(joint))
        return made

    def about(self, name: str) -> Mapping[str, Any]:
        """See `Stream`."""
        settings: Any = self.bank.joints[name].settings
        return {'input': self.settings.input, 'input_unit': settings.input_unit}
