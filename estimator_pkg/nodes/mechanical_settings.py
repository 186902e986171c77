"""What is set of `mechanical_observer` as a whole; imports no ROS, because replay reads it too."""

from __future__ import annotations

from dataclasses import dataclass

from estimator_pkg import observers
from estimator_pkg.driver.mechanism import COMMAND, FIELD
from estimator_pkg.errors import UsageError
from estimator_pkg.observers.contract import Observer
from estimator_pkg.parameters import parameter


@dataclass(frozen=True)
class MechanicalNodeSettings:
    """Parameters of the node `mechanical_observer` beside those of its observer."""

    observer: str = parameter(
        'geso', unit='', structural=True, description='geso, hgo, ehgo or smo')
    mechanisms: tuple[str, ...] = parameter(
        ('mechanism',), unit='', structural=True,
        description='a name for each mechanism; joints.<mechanism>.<parameter> sets a parameter of '
                    'one of them')
    input: str = parameter(
        FIELD, unit='', choices=(FIELD, COMMAND), structural=True,
        description='where the inputs come from: the effort field of joint_states, which acted '
                    'since the sample before, or the topic effort_command, which acts from its '
                    'stamp on')
    stamp_source: str = parameter(
        'header', unit='', choices=('header', 'publisher'), structural=True,
        description='time of a message: its header stamp, or the time at which its publisher sent '
                    'it')

    def find_observer(self) -> Observer:
        """The observer; raises UsageError if it is none of mechanisms."""
        found = observers.find(self.observer)
        if found.kind != 'mechanical':
            raise UsageError(f"observer '{found.name}' is none of mechanisms: take geso, hgo, ehgo "
                             'or smo')
        return found
