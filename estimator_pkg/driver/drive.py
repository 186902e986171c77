"""Many samples of a drive at once: currents and voltages in, electrical and mechanical state out.

The same track (guard and observer) as for a joint; a measurement is the tuple
(i_alpha, i_beta, u_alpha, u_beta).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.compiled import compiled
from estimator_pkg.driver.guard import AFTER_GAP, DUPLICATE
from estimator_pkg.driver.track import make_track
from estimator_pkg.observers.contract import INITIALISING

LONGEST_COAST = 10 ** 9  # ns; after a longer gap nothing is said of the way in between

COLUMNS = ('electrical_angle', 'electrical_speed', 'flux_linkage', 'valid')


class DriveEstimates(NamedTuple):
    """One row per sample received.

    rows : shape (n, 4), `COLUMNS`: rad, rad/s, Wb, 0 or 1; nan where withheld or where the sample
        was dropped.
    status : shape (n,), see `observers.contract`.
    reasons : shape (n,), bits of `observers.pmsm_watch.REASONS`.
    verdict : shape (n,), see `guard`.
    """

    rows: NDArray[np.float64]
    status: NDArray[np.int8]
    reasons: NDArray[np.int16]
    verdict: NDArray[np.int8]

    @property
    def electrical_angle(self) -> NDArray[np.float64]:
        """rad; shape (n,)."""
        return self.rows[:, 0]

    @property
    def electrical_speed(self) -> NDArray[np.float64]:
        """rad/s; shape (n,)."""
        return self.rows[:, 1]

    @property
    def flux_linkage(self) -> NDArray[np.float64]:
        """Wb; shape (n,)."""
        return self.rows[:, 2]


def empty(count: int) -> DriveEstimates:
    """Room for `count` samples."""
    return DriveEstimates(np.full((count, len(COLUMNS)), np.nan),
                          np.full(count, INITIALISING, np.int8), np.zeros(count, np.int16),
                          np.zeros(count, np.int8))


def make_drive_batch(functions: Any) -> Callable[..., tuple]:
    """A loop over samples through guard and observer; compile it, or call it as it is."""
    track_functions = make_track(functions)
    advance, row_of, coast = track_functions.advance, functions.row, functions.coast

    def batch(track: tuple, design: tuple, limits: tuple, stamps: NDArray[np.int64],
              samples: NDArray[np.float64], rows: NDArray[np.float64], status: NDArray[np.int8],
              reasons: NDArray[np.int16], verdict: NDArray[np.int8]) -> tuple:
        (last_ns, before_ns, late, dt_ns, mean_dt, coefficients, state, running, kept, reading,
         earlier, repeats) = track
        for k in range(len(stamps)):
            sample = samples[k]
            measurement = (sample[0], sample[1], sample[2], sample[3])
            old_ns, old_coefficients, old_state = last_ns, coefficients, state
            track, said = advance(track, design, limits, stamps[k], measurement, 0.0)
            verdict[k] = said
            (last_ns, before_ns, late, dt_ns, mean_dt, coefficients, state, running, kept, reading,
             earlier, repeats) = track
            if said == AFTER_GAP:
                gap = stamps[k] - old_ns
                if gap <= LONGEST_COAST:  # on by what was turned in it
                    state = coast(old_state, old_coefficients, design, measurement, gap * 1e-9)
                    track = (last_ns, before_ns, late, dt_ns, mean_dt, coefficients, state, running,
                             kept, reading, earlier, repeats)
            if said < DUPLICATE:
                row = rows[k]
                row[0], row[1], row[2], row[3], status[k], reasons[k] = row_of(state, coefficients,
                                                                               design)
        return track

    return batch


@lru_cache(maxsize=16)
def _twin(batch: Callable[..., tuple]) -> Callable[..., tuple]:
    """As `compiled`, known again by identity: finding its key takes as long as a short batch."""
    return compiled(batch)


def run(batch: Callable[..., tuple], track: tuple, design: tuple, limits: tuple,
        stamps: NDArray[np.int64], samples: NDArray[np.float64], *, fast: bool
        ) -> tuple[tuple, DriveEstimates]:
    """The track after these samples, and the estimates.

    Parameters
    ----------
    stamps : shape (n,), int64 nanoseconds.
    samples : shape (n, 4) [A, A, V, V].
    fast : compile, where Numba is there.
    """
    out = empty(len(stamps))
    if fast:
        track = _twin(batch)(track, design, limits, np.ascontiguousarray(stamps, np.int64),
                             np.ascontiguousarray(samples, float), *out)
    else:  # lists hold Python's own numbers, which are several times faster than numpy's
        told = [values.tolist() for values in out]
        track = batch(track, design, limits, np.asarray(stamps).tolist(),
                      np.asarray(samples).tolist(), *told)
        for name, values in zip(out._fields, told):
            getattr(out, name)[:] = values
    return track, out
