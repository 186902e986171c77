"""Messages of the topic effort_command: efforts by name, or an array in the order of the joints."""

from __future__ import annotations

from collections.abc import Sequence

from estimator_pkg.messages import multi_array
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import Decoder

JOINT_STATE, ARRAY = 'JointState', 'Float64MultiArray'

Command = tuple[int, Sequence[str], Sequence[float]]  # (stamp [ns], names, efforts)


class EffortCommands:
    """Decodes a stream of them.

    Parameters
    ----------
    kind : JOINT_STATE (efforts by name) or ARRAY (numbers alone; they have no stamp).
    orders : names that the numbers of an array may stand for; its length says which.
    by_publisher : the stamp is the time at which a message was sent, as it is of every array.
    """

    def __init__(self, kind: str, orders: Sequence[Sequence[str]], by_publisher: bool) -> None:
        self._names = {len(names): tuple(names) for names in orders} if kind == ARRAY else None
        self._by_publisher = by_publisher
        self._layout = Decoder().layout

    def decode(self, raw: bytes, sent_ns: int) -> Command:
        """The command in `raw`, which was sent at `sent_ns`.

        Raises
        ------
        MalformedMessageError : no such message, or an array of another length.
        """
        if self._names is not None:
            numbers = multi_array.numbers(raw)
            names = self._names.get(len(numbers))
            if names is None:
                raise MalformedMessageError(f'{len(numbers)} numbers, where there are '
                                            f'{" or ".join(map(str, self._names))} joints')
            return sent_ns, names, numbers
        layout = self._layout(raw)
        efforts = layout.numbers(raw, 2)
        if len(efforts) != len(layout.names):
            raise MalformedMessageError(f'{len(layout.names)} names, but {len(efforts)} efforts')
        return sent_ns if self._by_publisher else layout.stamp_ns(raw), layout.names, efforts
