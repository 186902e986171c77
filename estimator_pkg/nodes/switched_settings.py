"""What is set of `switched_observer` as a whole. Imports no ROS."""

from __future__ import annotations

from dataclasses import dataclass

from estimator_pkg.errors import UsageError
from estimator_pkg.models.switched import SwitchedModel
from estimator_pkg.nodes.effort_settings import EffortSettings
from estimator_pkg.parameters import parameter


@dataclass(frozen=True)
class SwitchedNodeSettings(EffortSettings):
    """Parameters of the node `switched_observer` beside those of its observer."""

    joints: tuple[str, ...] | None = parameter(
        None, unit='', kind=tuple, structural=True,
        description="names of the joints in the topic, in the order of the model's outputs; unset: "
                    "the model's own names")

    def names(self, model: SwitchedModel) -> tuple[str, ...]:
        """The joints; raises UsageError if they are not as many as the model's outputs."""
        names = tuple(name for name in self.joints or () if name) or model.joints
        if len(names) != len(model.joints) or len(set(names)) < len(names):
            raise UsageError(f"parameter 'joints' must name the model's {len(model.joints)} "
                             f'output{"" if len(model.joints) == 1 else "s"}, each once, not '
                             f'{", ".join(names)}')
        return names
