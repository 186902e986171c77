"""Any number of joints, which may come, go and change order from message to message."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.joint import Joint
from estimator_pkg.observers.contract import COASTING, TRACKING


class Received:
    """Counts messages of joint states that cannot be used.

    Attributes
    ----------
    mismatched : those whose arrays did not fit their names.
    empty : those without a position.
    """

    joints: Mapping[str, Any]

    def __init__(self) -> None:
        self.mismatched = self.empty = 0

    def fits(self, names: Sequence[str], positions: Sequence[float]) -> bool:
        """Whether there are positions, one for each name; counted where not."""
        if not positions:
            self.empty += 1
            return False
        if len(names) != len(positions):
            self.mismatched += 1
            return False
        return True

    def rehearse(self) -> None:
        """Let what a first sample needs be made before it comes."""
        for joint in self.joints.values():
            joint.rehearse()

    def why_silent(self, name: str) -> str:
        """Why there may be no usable sample of a joint, where that can be known; else ''."""
        return ''


class Bank(Received):
    """The joints of one stream, made as they appear.

    Parameters
    ----------
    configuration : observer, gains and settings.
    only : names of the joints to estimate; empty: every joint that appears.
    """

    def __init__(self, configuration: Configuration, only: Iterable[str] = ()) -> None:
        super().__init__()
        self.configuration = configuration
        self.only = frozenset(only)
        self.joints: dict[str, Joint] = {}
        self._newest: Joint | None = None

    def rehearse(self) -> None:
        """Make a joint that is nobody's: the first ones take its functions."""
        self._newest = self._make('')
        self._newest.rehearse()

    def joint(self, name: str) -> Joint | None:
        """The joint called `name`, made at its first appearance; None if it is not wanted."""
        joint = self.joints.get(name)
        if joint is None and (not self.only or name in self.only):
            joint = self._newest = self.joints[name] = self._make(name)
        return joint

    def _make(self, name: str) -> Joint:
        return Joint(self.configuration.observer, *self.configuration.for_joint(name),
                     self._newest)

    def update(self, stamp_ns: int, names: Sequence[str], positions: Sequence[float]
               ) -> list[tuple[str, Joint, tuple[float, float, float, int]]]:
        """One message in; (name, joint, estimate) of every joint whose estimate may be published.

        Parameters
        ----------
        stamp_ns : stamp of the measurement, int nanoseconds.
        names, positions : as in a JointState [rad or m]; of unequal length: counted, not used.
        """
        if not self.fits(names, positions):
            return []
        valid = []
        for name, position in zip(names, positions):
            joint = self.joints.get(name) or self.joint(name)
            if joint is not None and joint.update(stamp_ns, position):
                estimate = joint.estimate()
                if estimate[3] == TRACKING or estimate[3] == COASTING:
                    valid.append((name, joint, estimate))
        return valid
