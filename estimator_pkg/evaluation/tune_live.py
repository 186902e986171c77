"""``tune --live``: what a standing node has just seen, and its new gains if they are wanted."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from estimator_pkg.bags import record
from estimator_pkg.errors import UserError

if TYPE_CHECKING:
    from rclpy.parameter import Parameter

PATIENCE = 5.0  # [s] for a node to be found, and to answer
TURN = 0.05     # [s] between looks


@contextmanager
def recorded(topic: str, truth: str, seconds: float) -> Iterator[str]:
    """A bag of what comes on `topic` (and on `truth`, if anything does) for so long [s].

    It is gone when the context ends.

    Raises
    ------
    UserError : nothing came.
    """
    with TemporaryDirectory(prefix='velocity_estimator_') as folder:
        path = str(Path(folder) / 'live')
        record.run(argparse.Namespace(topics=[topic, truth], out=path, duration=seconds))
        yield path


def apply(node: str, gains: Mapping[str, float]) -> None:
    """Sets parameters of a running node; its state goes on.

    Parameters
    ----------
    gains : by the node's own parameter names.

    Raises
    ------
    UserError : no such node, no answer, or it refuses a value (why, in its own words).
    """
    from estimator_pkg.bags.live import live
    with live('gain_setter') as here:
        from rclpy.parameter import Parameter
        from rclpy.parameter_client import AsyncParameterClient
        name = node if node.startswith('/') else f'/{node}'
        client = AsyncParameterClient(here.node, name)
        end = time.monotonic() + PATIENCE
        while not client.services_are_ready():
            if time.monotonic() > end or here.stopping:
                raise UserError(f"no node '{name}' whose parameters could be set")
            here.spin(TURN)
        asked: list[Parameter] = [Parameter(key, value=value) for key, value in gains.items()]
        future = client.set_parameters_atomically(asked)
        end = time.monotonic() + PATIENCE
        while not future.done():
            if time.monotonic() > end or here.stopping:
                raise UserError(f"the node '{name}' does not answer")
            here.spin(TURN)
        answer: Any = future.result()
        if not answer.result.successful:
            raise UserError(f"the node '{name}' keeps its gains: {answer.result.reason}")


def node_names(tuned: list[dict[str, Any]]) -> dict[str, float]:
    """The gains by the node's parameter names: common ones, and ``joints.<joint>.<gain>``."""
    found = {}
    for each in tuned:
        prefix = f'joints.{each["joint"]}.' if each['joint'] else ''
        found.update({prefix + name: float(f'{value:.6g}')
                      for name, value in each['gains'].items()})
    return found
