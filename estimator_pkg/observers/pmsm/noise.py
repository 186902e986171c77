# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Variances of back-EMF, innovation, angle, speed and flux under current noise.

Around a converged state the fast part is linear. Its response to white noise n on each current
follows exactly from the sampled system (a discrete Lyapunov equation of order two). Below the
bandwidth of the fast part, the noise of the back-EMF estimate is (R + j omega L) n. The slow part
then acts as a phase-locked loop.
"""

from __future__ import annotations

import math

ROUNDING = 1e-30  # smallest innovation variance, where the estimate equals each measurement


def power_of(number: complex) -> float:
    """Return |number|^2."""
    return number.real * number.real + number.imag * number.imag


def together(one: complex, other: complex) -> float:
    """Return Re(one other*), the scalar product of two vectors."""
    return one.real * other.real + one.imag * other.imag


def covariance(
    e11: float, e12: float, e21: float, e22: float, b1: complex, b2: complex
) -> tuple[float, float, float]:
    """Return (P11, Re P12, P22) of P = E P E' + b b*, by Cramer's rule."""
    a11, a12, a13 = 1.0 - e11 * e11, -2.0 * e11 * e12, -e12 * e12
    a21, a22, a23 = -e11 * e21, 1.0 - e11 * e22 - e12 * e21, -e12 * e22
    a31, a32, a33 = -e21 * e21, -2.0 * e21 * e22, 1.0 - e22 * e22
    r1, r2, r3 = power_of(b1), together(b1, b2), power_of(b2)
    m1, m2, m3 = a22 * a33 - a23 * a32, a21 * a33 - a23 * a31, a21 * a32 - a22 * a31
    total = a11 * m1 - a12 * m2 + a13 * m3
    p11 = r1 * m1 - a12 * (r2 * a33 - a23 * r3) + a13 * (r2 * a32 - a22 * r3)
    p12 = a11 * (r2 * a33 - a23 * r3) - r1 * m2 + a13 * (a21 * r3 - r2 * a31)
    p22 = a11 * (a22 * r3 - r2 * a32) - a12 * (a21 * r3 - r2 * a31) + r1 * m3
    return p11 / total, p12 / total, p22 / total


def prepare_noise(
    inductance: float, k_p: float, k_i: float, scheme: tuple, omega: float
) -> tuple[float, float, float]:
    """Return three variances per unit variance of white noise on each current.

    The noise is white in the turning frame too. The frame speed `omega` [rad/s] changes its effect
    (the terms -j omega of the scheme), which matters where the rotor turns far within a sample.

    Returns
    -------
    Variances of one component of h [V^2/A^2], of one component of the innovation i_frame - i, and
    of the fast part of the integral of h [V^2 s^2/A^2].
    """
    (dt, e11, e12, e21, e22, iu, ia, iw, idd, idw, hu, ha, hw, hdd, hdw) = scheme
    # x_k+1 = E x_k + b0 n_k + b1 n_k+1; w = x - b1 n has white drive E b1 + b0
    c1, c2 = complex(idd, -omega * idw), complex(hdd, -omega * hdw)
    b1 = e11 * c1 + e12 * c2 + complex(ia, -omega * iw) - c1
    b2 = e21 * c1 + e22 * c2 + complex(ha, -omega * hw) - c2
    p11, p12, p22 = covariance(e11, e12, e21, e22, b1, b2)
    of_h = p22 + power_of(c2)
    of_innovation = max(p11 + power_of(1.0 - c1), ROUNDING)
    # integral of h = L (i - h kp/ki) + a slow part
    ratio = k_p / k_i
    x11, x12, x22 = p11 + power_of(c1), p12 + together(c1, c2), of_h
    of_integral = inductance * inductance * (x11 - 2.0 * ratio * x12 + ratio * ratio * x22)
    return of_h, of_innovation, of_integral


def through_four_poles(
    c3: float, c2: float, c1: float, d3: float, d2: float, d1: float, d0: float
) -> float:
    """Return the integral of |c(j w)/d(j w)|^2 over w/(2 pi): unit white noise filtered by c/d.

    c = c3 s^3 + c2 s^2 + c1 s and d = s^4 + d3 s^3 + d2 s^2 + d1 s + d0, all poles stable (the
    table of James, Nichols and Phillips, 1947, for order four).
    """
    return (c3 * c3 * (d1 * d2 - d0 * d3) + (c2 * c2 - 2.0 * c1 * c3) * d1 + c1 * c1 * d3) / (
        2.0 * (d1 * d2 * d3 - d0 * d3 * d3 - d1 * d1)
    )


def deviations(
    variance: float,
    size: float,
    x: float,
    k_eta: float,
    gamma: float,
    resistance: float,
    inductance: float,
    epsilon: float,
    natural: float,
    damping_out: float,
    dt: float,
    gains: tuple[float, float, float],
) -> tuple[float, float, float]:
    """Return one standard deviation of electrical angle [rad], its speed [rad/s] and xi [1/Wb].

    Noise n of the current appears in the back-EMF as (R + j omega L + L s) n. With its radial part
    n2 and its tangential part n1, damping d = k_eta chi and stiffness k = gamma chi^2, the angle
    error of the frame is (xi s n2 + (k_eta s + gamma chi) n1) / (s^2 + d s + k); its rate is the
    speed error.

    Parameters
    ----------
    variance : variance of the noise on each current [A^2].
    size, x : |h| [V] and xi_hat [1/Wb].
    epsilon : time constant of the fast part [s].
    natural, damping_out : natural frequency [rad/s] and damping of the low-pass on the speed;
        natural 0: no low-pass.
    dt : sample time [s].
    gains : from `prepare_noise`.
    """
    of_h, of_innovation, of_integral = gains
    omega = size * abs(x)
    density = variance * dt
    slow = (resistance * resistance + omega * omega * inductance * inductance) * density
    damping = k_eta * size  # 2 zeta omega_n of the slow loop
    stiffness = gamma * size * size  # omega_n^2
    if damping <= 0.0 or stiffness <= 0.0:
        return math.pi / math.sqrt(3.0), math.sqrt(x * x * of_h * variance), abs(x)
    both = x * x + k_eta * k_eta
    of_angle = (
        both * of_integral * variance
        + 0.5 * slow * x * x / damping
        + 0.5 * slow / (size * size) * (damping + stiffness / damping)
    )
    of_xi = (
        0.5
        * slow
        * (x * x * stiffness + stiffness * stiffness / (size * size))
        / (damping * size * size)
    )
    of_speed = x * x * of_h * variance  # of |h| xi: the speed output without a low-pass
    if natural > 0.0:
        e, w = 2.0 * damping_out * natural, natural * natural
        d3, d2, d1, d0 = (
            damping + e,
            stiffness + damping * e + w,
            damping * w + stiffness * e,
            stiffness * w,
        )
        pull = gamma * size
        of_speed = (
            w
            * w
            * slow
            * (
                through_four_poles(0.0, x, 0.0, d3, d2, d1, d0)
                + through_four_poles(0.0, k_eta, pull, d3, d2, d1, d0)
            )
        )
        # L s n: filtered by the slow loop or by the fast part, whichever gives less
        fast = through_four_poles(x, 0.0, 0.0, d3, d2, d1, d0) + through_four_poles(
            k_eta, pull, 0.0, d3, d2, d1, d0
        )
        f = 2.0 / epsilon
        corner = 0.5 * f * f
        of_fast = (
            both
            * corner
            * corner
            * through_four_poles(
                0.0, 0.0, 1.0, e + f, w + e * f + corner, w * f + e * corner, w * corner
            )
        )
        of_speed += w * w * inductance * inductance * density * min(fast, of_fast)
        of_speed = min(of_speed, both * of_h * variance)
    return math.sqrt(of_angle), math.sqrt(of_speed), math.sqrt(of_xi)


def low_pass_weight(pole: float, dt: float) -> float:
    """Return the weight of the newest sample in a first-order low-pass matched to dt [s].

    `pole` [1/s] is its magnitude; 0: no low-pass, weight 1.
    """
    if pole <= 0.0:
        return 1.0
    return 1.0 - math.exp(-pole * dt)
