"""A bag that carries topics of another one, and new messages among them."""

from __future__ import annotations

import sys
from collections.abc import Mapping

import numpy as np

from estimator_pkg.bags import qos
from estimator_pkg.bags.feeding import Encoded
from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.messages.block import Block
from estimator_pkg.printable import show


class Output:
    """Writes the copied topics, and new ones.

    Parameters
    ----------
    copy : topics of `bag` to copy; None: all.
    types : the new topics' names and message types.

    Attributes
    ----------
    topics, own : the new topics, and their numbers in the writer.
    copied : the topics that are copied.
    """

    def __init__(self, bag: Bag, writer: BagWriter, copy: list[str] | None,
                 types: Mapping[str, str]) -> None:
        self._writer = writer
        self.topics = list(types)
        for name in copy or ():
            bag.require(name)
        wanted = set(bag.topics if copy is None else copy)
        for name in sorted(wanted & set(self.topics)):
            show(f'{name} of {bag.path} is not copied: replay makes its own (--name NODE gives '
                 'another name)', file=sys.stderr)
        self.copied = wanted - set(self.topics)
        self._numbers = {}
        for name in bag.topics:
            if name in self.copied:
                topic = bag.topics[name]
                self._numbers[name] = writer.add_topic(
                    name, topic.type, topic.qos, definition=topic.definition,
                    definition_format=topic.definition_format, type_hash=topic.type_hash,
                    serialization=topic.serialization)
        self.own = [writer.add_topic(name, kind, qos.profile(depth=50))
                    for name, kind in types.items()]

    def write_among(self, names: list[str], block: Block, made: Encoded) -> None:
        """What is copied of the block, and the new messages behind those they belong to.

        Parameters
        ----------
        names : the bag's topics, as the block counts them.
        """
        lookup = np.array([self._numbers.get(name, -1) for name in names])
        self._writer.write_block(made.merged(lookup[block.topic]))
