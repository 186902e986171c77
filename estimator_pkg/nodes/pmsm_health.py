"""How `pmsm_observer` is: as of joints, and what only currents and voltages can be wrong in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from estimator_pkg.driver.drive_stream import DriveStream
from estimator_pkg.driver.joint import Joint
from estimator_pkg.nodes.health import Health


class PmsmHealth(Health):
    """Adds to `Health` why no sample comes of the messages."""

    NO_STAMP = 'every sample needs its own'
    WRONG: ClassVar[Mapping[str, str]] = {
        **Health.WRONG, 'unpaired': 'currents or voltages without their partner',
        'unbalanced': 'currents whose phases do not sum to zero'}
    _bank: DriveStream

    def _judge(self, name: str, joint: Joint, now: float) -> tuple[int, str]:
        if self._bank.joint.misfit:  # no sample is used then, and that is why
            return joint.estimate()[3], joint.why()
        return super()._judge(name, joint, now)

    def _totals(self) -> Any:
        totals = super()._totals()
        totals['unpaired'] = self._bank.pairs.unpaired
        if self._bank.phases is not None:
            totals['unbalanced'] = self._bank.phases.unbalanced
        return totals
