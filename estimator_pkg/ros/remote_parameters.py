"""Parameters of another node that is running: what they are, and setting them."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from estimator_pkg.ros import runtime  # noqa: F401  settles what rclpy reads  # isort: skip

from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from estimator_pkg.errors import UserError

PATIENCE = 5.0  # [s] for a node to be found, and to answer
TURN = 0.05  # [s] between looks


class Spinning(Protocol):
    """A node with its executor, as of `estimator_pkg.bags.live.live`."""

    node: Node

    @property
    def stopping(self) -> bool:
        """The process is to end."""

    def spin(self, seconds: float) -> None:
        """Let callbacks run for at most so long."""


class RemoteParameters:
    """The parameters of a node.

    Parameters
    ----------
    here : who asks.
    name : of the node; without a leading '/', in the root namespace.

    Raises
    ------
    UserError : there is no such node; later also where it does not answer.
    """

    def __init__(self, here: Spinning, name: str) -> None:
        self.name = name if name.startswith('/') else f'/{name}'
        self._here = here
        self._client = AsyncParameterClient(here.node, self.name)
        self._until(
            self._client.services_are_ready, f"no node '{self.name}' whose parameters could be set"
        )

    def get(self, names: Sequence[str]) -> dict[str, Any]:
        """What they are now, by name; None where one is not set, or the node has none such."""
        if not names:
            return {}
        future = self._client.get_parameters(list(names))
        values = self._answer(future).values
        if len(values) < len(names):  # an unknown name among them: nothing is said of any
            if len(names) == 1:
                return {names[0]: None}
            return {name: value for each in names for name, value in self.get([each]).items()}
        return {name: parameter_value_to_python(value) for name, value in zip(names, values)}

    def set(self, values: Mapping[str, Any]) -> None:
        """Set them together; raises UserError if the node refuses one (why, in its own words)."""
        asked = [
            Parameter(name, value=list(value) if isinstance(value, tuple) else value)
            for name, value in values.items()
        ]
        result = self._answer(self._client.set_parameters_atomically(asked)).result
        if not result.successful:
            raise UserError(f"the node '{self.name}' keeps its gains: {result.reason}")

    def _answer(self, future: Any) -> Any:
        self._until(future.done, f"the node '{self.name}' does not answer")
        return future.result()

    def _until(self, condition: Any, otherwise: str) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            if time.monotonic() > end or self._here.stopping:
                raise UserError(otherwise)
            self._here.spin(TURN)
