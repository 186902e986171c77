# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The clocks of the devices on one topic, for `stamp_repair`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.sensor.stamp_repair import StampRepair
from estimator_pkg.streams.arrays import Samples

DEVICES = 64  # more sets of names than these begin again


class Clocks:
    """The devices of one topic: messages that name the same joints come from one of them.

    Parameters
    ----------
    periods : (joint) -> its wrap period [rad]; 0: none.
    """

    def __init__(self, periods: Callable[[str], float]) -> None:
        self._periods = lru_cache(maxsize=1024)(periods)
        self._devices: dict[Sequence[str], StampRepair] = {}
        self._of: dict[str, StampRepair] = {}

    def __call__(self, stamp_ns: int, names: Sequence[str], positions: Sequence[float]) -> int:
        """Return when the readings of a message were taken [ns]; see `StampRepair`."""
        names = tuple(names)
        device = self._devices.get(names)
        if device is None:
            if len(self._devices) >= DEVICES:
                self.reset()
            device = self._devices[names] = StampRepair(self._periods)
            self._of.update(dict.fromkeys(names, device))
        return device(stamp_ns, names, positions)

    def block(self, groups: Sequence[Samples]) -> list[NDArray[np.int64]]:
        """Return times [ns], shape (n,), of each group: as a call for each message, in order."""
        times = [np.array(group.stamps_ns, np.int64) for group in groups]
        calls = sorted(
            (row, index, at)
            for index, group in enumerate(groups)
            for at, row in enumerate(group.rows.tolist())
        )
        stamps = [group.stamps_ns.tolist() for group in groups]
        positions = [group.positions.tolist() for group in groups]
        for _, index, at in calls:
            times[index][at] = self(stamps[index][at], groups[index].names, positions[index][at])
        return times

    def reset(self) -> None:
        """Start again."""
        self._devices.clear()
        self._of.clear()

    def about(self, name: str) -> dict[str, Any]:
        """Return what is known of the clock of a joint's device, for the status."""
        device = self._of.get(name)
        if device is None:
            return {}
        return {
            'stamp_repair': device.state,
            'stamp_offset_s': device.offset,
            'stamp_drift_ppm': 1e6 * device.drift,
            'stamp_jitter_s': device.jitter,
            'device_period_s': device.period,
        }
