"""What is set of `mechanical_observer` as a whole; imports no ROS, because replay reads it too."""

from __future__ import annotations

from dataclasses import dataclass

from estimator_pkg import observers
from estimator_pkg.errors import UsageError
from estimator_pkg.nodes.effort_settings import EffortSettings
from estimator_pkg.observers.contract import Observer
from estimator_pkg.parameters import parameter


@dataclass(frozen=True)
class MechanicalNodeSettings(EffortSettings):
    """Parameters of the node `mechanical_observer` beside those of its observer."""

    observer: str = parameter(
        'geso', unit='', structural=True, description='geso, hgo, ehgo or smo')
    mechanisms: tuple[str, ...] = parameter(
        ('mechanism',), unit='', structural=True,
        description='a name for each mechanism; joints.<mechanism>.<parameter> sets a parameter of '
                    'one of them')

    def find_observer(self) -> Observer:
        """The observer; raises UsageError if it is none of mechanisms."""
        found = observers.find(self.observer)
        if found.kind != 'mechanical':
            raise UsageError(f"observer '{found.name}' is none of mechanisms: take geso, hgo, ehgo "
                             'or smo')
        return found
