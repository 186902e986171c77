"""What is set of `adaptive_observer` as a whole. Imports no ROS."""

from __future__ import annotations

from dataclasses import dataclass

from estimator_pkg.parameters import parameter


@dataclass(frozen=True)
class AdaptiveNodeSettings:
    """Parameters of the node `adaptive_observer` beside those of its observer."""

    joints: tuple[str, ...] | None = parameter(
        None, unit='', kind=tuple, structural=True,
        description='names of the joints to estimate; unset: every joint that appears')
    input_scale: float = parameter(
        1.0, unit='', range=(-1e9, 1e9), structural=True,
        description='the effort of the topic times this is the input u of the model; a negative '
                    'one turns the sense round')
    parameters_file: str = parameter(
        '', unit='', structural=True,
        description='where ~/save writes what was learnt; read at start if it is there. With '
                    'adapt: false the node starts frozen on it')
    stamp_source: str = parameter(
        'header', unit='', choices=('header', 'publisher'), structural=True,
        description='time of a message: its header stamp, or the time at which its publisher sent '
                    'it')

    @property
    def only(self) -> tuple[str, ...]:
        """The joints to estimate; empty: all."""
        return tuple(name for name in self.joints or () if name)
