"""What is set of `adaptive_observer` as a whole. Imports no ROS."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from estimator_pkg.driver.effort_command import ARRAY
from estimator_pkg.driver.efforts import COMMAND
from estimator_pkg.errors import UsageError
from estimator_pkg.nodes.effort_settings import EffortSettings
from estimator_pkg.parameters import parameter


@dataclass(frozen=True)
class AdaptiveNodeSettings(EffortSettings):
    """Parameters of the node `adaptive_observer` beside those of its observer."""

    joints: tuple[str, ...] | None = parameter(
        None, unit='', kind=tuple, structural=True,
        description='names of the joints to estimate; unset: every joint that appears')
    joints_max: int = parameter(
        512, unit='', range=(1, 1_000_000), structural=True,
        description='joints that are kept at most; names that come beyond it get no estimate and '
                    'are counted. Joints that are named in the parameters do not count')
    expiry: float = parameter(
        600.0, unit='s', range=(0.0, 1e9), structural=True,
        description='without a sample for so long a joint is forgotten, unless the parameters name '
                    'it; what it has learnt is saved first where parameters_file is set. 0: '
                    'never')
    parameters_file: str = parameter(
        '', unit='', structural=True,
        description='where ~/save writes what was learnt; read at start if it is there. With '
                    'adapt: false the node starts frozen on it')

    def check(self) -> None:
        """What a range cannot say; raises UsageError."""
        if self.input == COMMAND and self.effort_command_type == ARRAY and not self.only:
            raise UsageError("effort_command_type 'Float64MultiArray' has no names: set 'joints' "
                             'to the joints in its order')
        folder = Path(self.parameters_file).parent
        if not folder.is_dir():
            raise UsageError(f"parameters_file '{self.parameters_file}': there is no folder "
                             f'{folder}')

    @property
    def only(self) -> tuple[str, ...]:
        """The joints to estimate; empty: all."""
        return tuple(name for name in self.joints or () if name)
