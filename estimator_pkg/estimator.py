# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The library: one joint's velocity estimator, without ROS.

>>> from estimator_pkg import VelocityEstimator
>>> estimator = VelocityEstimator(quantum=0.001534)
>>> estimator.update(1_000_000_000, 0.0).status
'initialising'
"""

from __future__ import annotations

import math
import operator
import reprlib
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimator_pkg import observers
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.joint import Joint
from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.estimate import INITIALISING, MISCONFIGURED, STATUS_NAMES
from estimator_pkg.estimate import VALID as PUBLISHED
from estimator_pkg.sensor.guard import DUPLICATE, UNSTABLE_GAINS, VERDICTS
from estimator_pkg.stamps import MOST_NS, stamps_of

__all__ = ['Estimate', 'EstimateArrays', 'UsageError', 'VelocityEstimator', 'differentiate']

VALID = tuple(STATUS_NAMES[status] for status in PUBLISHED)
NAN = math.nan
NAME_IT = "use observer='{0}'"  # what to do to have another observer's gain


class Estimate(NamedTuple):
    """The newest estimate of one joint.

    Attributes
    ----------
    stamp_ns : the time that the estimate is valid for [ns]: the stamp of its sample.
    position : [rad or m], in the convention of the measurement.
    velocity : [rad/s or m/s].
    acceleration : [rad/s^2 or m/s^2]; NaN where the observer does not estimate it.
    position_stddev, velocity_stddev : one standard deviation of position and velocity.
    status : initialising, tracking, coasting, not observable or misconfigured.
    used : whether the last sample reached the observer. If not, this is the estimate before it.
    dropped : why the guard dropped the last sample (duplicate, late, ...), or ''.
    """

    stamp_ns: int
    position: float
    velocity: float
    acceleration: float
    position_stddev: float
    velocity_stddev: float
    status: str
    used: bool
    dropped: str

    @property
    def valid(self) -> bool:
        """Whether the velocity can be used: the status is tracking or coasting."""
        return self.status in VALID


class EstimateArrays(NamedTuple):
    """The estimates of n samples: the fields of `Estimate` as arrays of shape (n,).

    Row i is what `VelocityEstimator.update` returns for sample i. Of several joints the shape is
    (n, joints).
    """

    stamp_ns: NDArray[np.int64]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    position_stddev: NDArray[np.float64]
    velocity_stddev: NDArray[np.float64]
    status: NDArray[np.str_]
    used: NDArray[np.bool_]
    dropped: NDArray[np.str_]

    @property
    def valid(self) -> NDArray[np.bool_]:
        """True where the velocity can be used: the status is tracking or coasting."""
        return np.isin(self.status, VALID)


NO_ESTIMATE = Estimate(0, NAN, NAN, NAN, NAN, NAN, STATUS_NAMES[INITIALISING], False, '')
REASONS = np.array([''] * DUPLICATE + list(VERDICTS[DUPLICATE:]))  # by verdict


class VelocityEstimator:
    """Estimates the velocity of one joint from stamped samples of its position.

    Parameters
    ----------
    observer : name of an observer that needs the angle alone; `observers.DEFAULT` without one.
    parameters : gains of the observer and settings of the joint (wrap_period, unwrap, gap_max,
        ...), by name. `velocity_estimator list NAME` lists them.

    Raises
    ------
    UsageError : an unknown name (the nearest one is suggested), a value out of range, gains that
        contradict each other, or an observer that needs more than an angle.
    """

    def __init__(self, observer: str = observers.DEFAULT, **parameters: Any) -> None:
        kind = observers.find(observers.DEFAULT).kind
        try:
            self._observer = observers.find(str(observer))
        except UsageError as error:  # which suggests observers of every kind
            known = suggestion(str(observer), observers.of_kind(kind))
            raise UsageError(f"unknown observer '{observer}': {known}") from error
        if self._observer.kind != kind:
            raise UsageError(
                f"observer '{observer}' needs more inputs than an angle: use its node "
                f'or one of {", ".join(observers.of_kind(kind))}'
            )
        self._configuration = Configuration(self._observer, parameters, remedy=NAME_IT)
        self._joint = self._make(self._configuration)
        self._last = NO_ESTIMATE

    def update(self, stamp_ns: int, angle: float) -> Estimate:
        """Take one sample and return the newest estimate.

        If the guard drops the sample, the estimate is the one before it, with `used` False and
        the reason in `dropped`. A sample dropped as 'misconfigured' gives NaN: the gains are
        unstable at the sample rate (see `why`).

        Parameters
        ----------
        stamp_ns : time of the measurement [ns], an integer.
        angle : measured position [rad or m].

        Raises
        ------
        UsageError : a stamp that is not an integer of 64 bits, or an angle that is not a number.
        """
        try:
            stamp_ns, angle = operator.index(stamp_ns), float(angle)
            if not -MOST_NS <= stamp_ns <= MOST_NS:
                raise OverflowError('the stamp is beyond 64 bits')
        except (TypeError, ValueError, OverflowError) as error:
            raise UsageError(
                'update needs an integer stamp [ns] and a number [rad or m], not '
                f'{reprlib.repr(stamp_ns)} and {reprlib.repr(angle)} ({error}): '
                'round(1e9 * seconds) makes a stamp'
            ) from error
        joint = self._joint
        if joint.update(stamp_ns, angle):
            position, velocity, acceleration, status = joint.estimate()
            self._last = Estimate(
                stamp_ns,
                position,
                velocity,
                acceleration,
                *joint.stddev(),
                STATUS_NAMES[status],
                True,
                '',
            )
            return self._last
        why = VERDICTS[joint.verdict]
        if joint.verdict == UNSTABLE_GAINS:
            self._last = Estimate(stamp_ns, NAN, NAN, NAN, NAN, NAN, why, False, why)
        else:
            self._last = self._last._replace(used=False, dropped=why)
        return self._last

    def run(self, times: ArrayLike, angles: ArrayLike) -> EstimateArrays:
        """Take many samples and return all estimates, the same as those of `update`.

        Parameters
        ----------
        times : shape (n,), in the order in which the samples came: integers [ns], floating-point
            seconds or datetime64. A time of 0 or less is no stamp.
        angles : shape (n,), measured positions [rad or m]. Of shape (n, joints), each column goes
            through a new estimator with the parameters of this one, which takes no sample.

        Raises
        ------
        UsageError : arrays of other shapes or types, or times too coarse for the sample time.
        """
        stamps, positions = _samples(times, angles)
        if positions.ndim == 2:
            joints = [
                VelocityEstimator(self.observer, **self._configuration.common).run(stamps, column)
                for column in positions.T
            ]
            return EstimateArrays._make(np.stack(columns, axis=1) for columns in zip(*joints))
        found = self._joint.run(stamps, positions)
        verdict = found.verdict
        answered = (verdict < DUPLICATE) | (verdict == UNSTABLE_GAINS)
        status = np.where(verdict == UNSTABLE_GAINS, MISCONFIGURED, found.status)
        rows: list[Any] = [stamps, *found[:5], np.array(STATUS_NAMES)[status]]
        if not answered.all():  # a dropped sample repeats the row before; row 0: the last estimate
            row = np.maximum.accumulate(np.where(answered, np.arange(1, len(stamps) + 1), 0))
            rows = [
                np.concatenate((np.array([before]), column))[row]
                for before, column in zip(self._last, rows)
            ]
        out = EstimateArrays._make([*rows, verdict < DUPLICATE, REASONS[verdict]])
        if len(stamps):
            self._last = Estimate(*(column[-1].item() for column in out))
        return out

    def reset(self) -> None:
        """Start again as if no sample had come. The counters continue."""
        self._joint.reset()
        self._last = NO_ESTIMATE

    def set(self, **parameters: Any) -> None:
        """Change parameters from the next sample on. The estimate continues.

        Raises
        ------
        UsageError : as when the estimator is made; a structural parameter; or gains that are
            unstable at the measured sample rate. Nothing is changed then.
        """
        values = {**self._configuration.common, **parameters}
        configuration = Configuration(self._observer, values, remedy=NAME_IT)
        for name, parameter in configuration.parameters().items():
            if name in parameters and parameter.structural:
                raise UsageError(f"parameter '{name}' is structural: make a new VelocityEstimator")
        joint, other = self._joint, self._make(configuration)
        why = other.limit(joint.mean_dt) if joint.mean_dt > 0.0 else None
        if why:
            raise UsageError(why)
        joint.try_step(other.design)
        self._configuration = configuration
        joint.set_settings(other.settings)
        joint.set_gains(other.gains)

    @property
    def observer(self) -> str:
        """The observer's name."""
        return self._observer.name

    @property
    def parameters(self) -> dict[str, Any]:
        """The values of all parameters by name."""
        return {**asdict(self._joint.gains), **asdict(self._joint.settings)}

    @property
    def estimate(self) -> Estimate:
        """What `update` returned last; NaN and 'initialising' before the first sample."""
        return self._last

    @property
    def received(self) -> int:
        """Number of samples received: used and dropped ones."""
        return self._joint.received

    @property
    def used(self) -> int:
        """Number of samples that reached the observer."""
        return self._joint.used

    @property
    def dropped(self) -> dict[str, int]:
        """Number of dropped samples by reason; reasons that did not occur are left out."""
        return self._joint.dropped()

    @property
    def why(self) -> str:
        """Why the status is what it is, in words; '' where there is nothing to say."""
        return self._joint.why()

    def __getstate__(self) -> tuple[Any, ...]:
        return self.observer, self._configuration.common, self._joint.numbers(), self._last

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        observer, parameters, numbers, last = state
        self.__init__(observer, **parameters)  # type: ignore[misc]
        self._joint.set_numbers(numbers)
        self._last = last

    def __repr__(self) -> str:
        values = ''.join(
            f', {name}={value!r}' for name, value in self._configuration.common.items()
        )
        return f'VelocityEstimator({self.observer!r}{values})'

    def _make(self, configuration: Configuration) -> Joint:
        """A joint of these gains that has taken no sample."""
        try:
            joint = Joint(self._observer, *configuration.for_joint(''))
            joint.warm_up()
        except (ArithmeticError, ValueError) as error:
            raise UsageError(f'these gains give no estimates ({error})') from error
        return joint


def differentiate(
    times: ArrayLike,
    angles: ArrayLike,
    observer: str = observers.DEFAULT,
    *,
    smooth: bool = False,
    **parameters: Any,
) -> NDArray[np.float64]:
    """Return the velocity of recorded angles [rad/s or m/s]; NaN where it cannot be used.

    Parameters
    ----------
    times, angles : as for `VelocityEstimator.run`; times may begin at 0 or before.
    observer, parameters : as for `VelocityEstimator`.
    smooth : use later readings as well, which no robot has live: the off-line smoother. Its only
        parameter is `wrap_period`.

    Returns
    -------
    The shape of `angles`.

    Raises
    ------
    UsageError : as for `VelocityEstimator` and its `run`.
    """
    estimator = VelocityEstimator(observer, **parameters)
    stamps, positions = _samples(times, angles, after_zero=True)
    if not smooth:
        found = estimator.run(stamps, positions)
        return np.where(found.valid & found.used, found.velocity, NAN)
    others = sorted(set(parameters) - {'wrap_period'})
    if observer != observers.DEFAULT or others:
        raise UsageError('smooth=True runs no observer: its only parameter is wrap_period')
    from estimator_pkg.bags.series import at_stamps
    from estimator_pkg.evaluation.reference.motion import motion

    def smoothed(column: NDArray[np.float64]) -> NDArray[np.float64]:
        moved = motion(stamps, column, estimator.parameters['wrap_period'])
        if moved is None:
            return np.full(len(stamps), NAN)
        return at_stamps(stamps, moved.stamps, moved.velocity)

    return np.apply_along_axis(smoothed, 0, positions)


def _samples(
    times: ArrayLike, angles: ArrayLike, after_zero: bool = False
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return (stamps, positions): NaN where an angle is masked; raise UsageError."""
    when, values = _array(times, 'times'), _array(angles, 'angles')
    if values.size and values.dtype.kind not in 'iuf':
        raise UsageError(f'angles must be numbers [rad or m] (not {values.dtype})')
    if when.ndim != 1 or when.shape != values.shape[:1] or values.ndim > 2 or 0 in values.shape[1:]:
        raise UsageError(
            'times must have the shape (n,) and angles (n,) or (n, joints), not '
            f'{when.shape} and {values.shape}'
        )
    stamps = stamps_of(when, 's' if when.dtype.kind == 'f' else 'ns', after_zero)
    return stamps, np.ma.filled(values.astype(np.float64), NAN)


def _array(values: ArrayLike, what: str) -> NDArray[Any]:
    """Return values as an array, with its mask if it has one; raise UsageError."""
    if isinstance(values, np.ma.MaskedArray):
        return values
    try:
        return np.asarray(values)
    except (TypeError, ValueError) as error:
        raise UsageError(f'{what} must be an array of numbers ({error})') from error
