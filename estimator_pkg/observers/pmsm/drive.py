"""What an observer of a drive is: the functions of an observer, and what a drive wants beside them.

Observers of kind 'drive' take a sample (i_alpha, i_beta, u_alpha, u_beta): the current at the stamp
[A] and the mean voltage [V] over the interval that ends there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from estimator_pkg.observers.contract import Functions

LARGEST = 1e6  # A and V: a sample whose numbers are larger, as a vector, is garbage

Sample = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class DriveFunctions(Functions):
    """The functions of an observer of kind 'drive', which knows more than a position.

    Attributes
    ----------
    row : (state, coefficients, design) -> what `electrical` gives, status and reasons: in one call
        what every sample of a batch is asked.
    electrical : (state, coefficients, design) -> (electrical angle [rad], electrical speed [rad/s],
        flux linkage [Wb], 1.0 where it counts or 0.0); nan where it is withheld.
    electrical_stddev : (state, coefficients, design) -> one standard deviation of these three.
    speed_bound : (state, coefficients, design) -> mechanical speed that is not exceeded where the
        rotor is not observable [rad/s]; inf where nothing is known.
    reasons : (state) -> bits of `watch.REASONS`.
    coast : (state, coefficients, design, measurement, gap) -> state. After a gap of known length.
    """

    row: Callable[..., tuple]
    electrical: Callable[..., tuple]
    electrical_stddev: Callable[..., tuple]
    speed_bound: Callable[..., float]
    reasons: Callable[[tuple], int]
    coast: Callable[..., tuple]


def finite(measurement: Sample) -> bool:
    """False where one of the four numbers is NaN or infinite, or all are beyond any drive."""
    i_alpha, i_beta, u_alpha, u_beta = measurement
    # false for nan; as one comparison it costs half as much
    return (
        i_alpha * i_alpha + i_beta * i_beta + u_alpha * u_alpha + u_beta * u_beta
        < LARGEST * LARGEST
    )
