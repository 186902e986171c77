# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Read and set the parameters of another running node."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from estimator_pkg.bags.live import Live  # isort: skip  before rclpy: it prepares the environment

from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from estimator_pkg.errors import UserError

ANSWER_WAIT = 5.0  # longest wait for a node to be found, and to answer [s]
CHECK_PERIOD = 0.05  # time between checks [s]


class RemoteParameters:
    """The parameters of a node.

    Parameters
    ----------
    here : the requesting node.
    name : of the other node; without a leading '/', in the root namespace.

    Raises
    ------
    UserError : there is no such node; later also if it does not answer.
    """

    def __init__(self, here: Live, name: str) -> None:
        self.name = name if name.startswith('/') else f'/{name}'
        self._here = here
        self._client = AsyncParameterClient(here.node, self.name)
        self._until(
            self._client.services_are_ready,
            f"no node '{self.name}' with parameter services: check the name ('ros2 node list')",
        )

    def get(self, names: Sequence[str]) -> dict[str, Any]:
        """Return the present values by name; None for a parameter that is unset or unknown."""
        if not names:
            return {}
        values = self._answer(lambda: self._client.get_parameters(list(names))).values
        if len(values) < len(names):  # one name is unknown: the answer is empty
            if len(names) == 1:
                return {names[0]: None}
            return {name: value for each in names for name, value in self.get([each]).items()}
        return {name: parameter_value_to_python(value) for name, value in zip(names, values)}

    def set(self, values: Mapping[str, Any]) -> None:
        """Set them together; raise UserError if the node refuses one (with its reason)."""
        requested = [
            Parameter(name, value=list(value) if isinstance(value, tuple) else value)
            for name, value in values.items()
        ]
        result = self._answer(lambda: self._client.set_parameters_atomically(requested)).result
        if not result.successful:
            raise UserError(f"the node '{self.name}' refused the gains: {result.reason}")

    def _answer(self, request: Callable[[], Any]) -> Any:
        """Return the answer to a request; it is made again once, because a node that has not
        discovered this client drops its answer.
        """
        future = request()
        if not self._came(future.done):
            future = request()
        self._until(future.done, f"the node '{self.name}' does not answer: check that it runs")
        return future.result()

    def _until(self, condition: Callable[[], Any], otherwise: str) -> None:
        if not self._came(condition):
            raise UserError(otherwise)

    def _came(self, condition: Callable[[], Any]) -> bool:
        """Wait for a condition; return False if it did not come true."""
        end = time.monotonic() + ANSWER_WAIT
        while not condition():
            if time.monotonic() > end or self._here.stopping:
                return False
            self._here.spin(CHECK_PERIOD)
        return True
