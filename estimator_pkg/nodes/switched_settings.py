"""What is set of `switched_observer` as a whole. Imports no ROS."""

from __future__ import annotations

from dataclasses import dataclass

from estimator_pkg.errors import UsageError
from estimator_pkg.models.switched import SwitchedModel
from estimator_pkg.parameters import parameter


@dataclass(frozen=True)
class SwitchedNodeSettings:
    """Parameters of the node `switched_observer` beside those of its observer."""

    joints: tuple[str, ...] | None = parameter(
        None, unit='', kind=tuple, structural=True,
        description="names of the joints in the topic, in the order of the model's outputs; unset: "
                    "the model's own names")
    input_scale: float = parameter(
        1.0, unit='', range=(-1e9, 1e9), structural=True,
        description='the effort of the topic times this is the input u of the model; a negative '
                    'one turns the sense round')
    stamp_source: str = parameter(
        'header', unit='', choices=('header', 'publisher'), structural=True,
        description='time of a message: its header stamp, or the time at which its publisher sent '
                    'it; events always have their header stamp')

    def names(self, model: SwitchedModel) -> tuple[str, ...]:
        """The joints; raises UsageError if they are not as many as the model's outputs."""
        names = tuple(name for name in self.joints or () if name) or model.joints
        if len(names) != len(model.joints) or len(set(names)) < len(names):
            raise UsageError(f"parameter 'joints' needs {len(model.joints)} different names, not "
                             f'{", ".join(names)}')
        return names
