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

from estimator_pkg.observers.pmsm.state import Design, Scheme

LEAST_INNOVATION = 1e-30  # smallest innovation variance, where the estimate equals each measurement
DAMPING = 0.46  # of the low-pass on the speed: little delay for its noise and -3 dB frequency


def covariance(
    e11: float, e12: float, e21: float, e22: float, r1: float, r2: float, r3: float
) -> tuple[float, float, float]:
    """Return (P11, Re P12, P22) of P = E P E' + [[r1, r2], [r2, r3]], by Cramer's rule."""
    a11, a12, a13 = 1.0 - e11 * e11, -2.0 * e11 * e12, -e12 * e12
    a21, a22, a23 = -e11 * e21, 1.0 - e11 * e22 - e12 * e21, -e12 * e22
    a31, a32, a33 = -e21 * e21, -2.0 * e21 * e22, 1.0 - e22 * e22
    m1, m2, m3 = a22 * a33 - a23 * a32, a21 * a33 - a23 * a31, a21 * a32 - a22 * a31
    total = a11 * m1 - a12 * m2 + a13 * m3
    p11 = r1 * m1 - a12 * (r2 * a33 - a23 * r3) + a13 * (r2 * a32 - a22 * r3)
    p12 = a11 * (r2 * a33 - a23 * r3) - r1 * m2 + a13 * (a21 * r3 - r2 * a31)
    p22 = a11 * (a22 * r3 - r2 * a32) - a12 * (a21 * r3 - r2 * a31) + r1 * m3
    return p11 / total, p12 / total, p22 / total


def noise_gains(design: Design, scheme: Scheme, omega: float) -> tuple[float, float, float]:
    """Return three variances per unit variance of white noise on each current.

    The noise is white in the turning frame too. The frame speed `omega` [rad/s] changes its effect
    (the terms -j omega of the scheme), which matters where the rotor turns far within a sample.

    Returns
    -------
    Variances of one component of h [V^2/A^2], of one component of the innovation i_frame - i, and
    of the fast part of the integral of h [V^2 s^2/A^2].
    """
    # x_k+1 = E x_k + b0 n_k + b1 n_k+1; w = x - c n has white drive b = E c + b0 + b1 - c, where
    # all that has an imaginary part is -omega times a weight
    e11, e12, e21, e22 = scheme.e11, scheme.e12, scheme.e21, scheme.e22
    c1, c2, d1, d2 = scheme.idd, scheme.hdd, -omega * scheme.idw, -omega * scheme.hdw
    b1 = e11 * c1 + e12 * c2 + scheme.ia - c1
    b2 = e21 * c1 + e22 * c2 + scheme.ha - c2
    j1 = e11 * d1 + e12 * d2 + -omega * scheme.iw - d1
    j2 = e21 * d1 + e22 * d2 + -omega * scheme.hw - d2
    p11, p12, p22 = covariance(
        e11, e12, e21, e22, b1 * b1 + j1 * j1, b1 * b2 + j1 * j2, b2 * b2 + j2 * j2
    )
    of_h = p22 + (c2 * c2 + d2 * d2)
    of_innovation = max(p11 + ((1.0 - c1) * (1.0 - c1) + d1 * d1), LEAST_INNOVATION)
    # integral of h = L (i - h kp/ki) + a slow part
    ratio = design.k_p / design.k_i
    x11, x12, x22 = p11 + (c1 * c1 + d1 * d1), p12 + (c1 * c2 + d1 * d2), of_h
    square = design.inductance * design.inductance
    of_integral = square * (x11 - 2.0 * ratio * x12 + ratio * ratio * x22)
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
    design: Design, scheme: Scheme, power: float, size: float, x: float
) -> tuple[float, float, float]:
    """Return one standard deviation of electrical angle [rad], its speed [rad/s] and xi [1/Wb].

    Noise n of the current appears in the back-EMF as (R + j omega L + L s) n. With its radial part
    n2 and its tangential part n1, damping d = k_eta chi and stiffness k = gamma chi^2, the angle
    error of the frame is (xi s n2 + (k_eta s + gamma chi) n1) / (s^2 + d s + k); its rate is the
    speed error.

    Parameters
    ----------
    power : innovation variance [A^2].
    size, x : |h| [V] and xi_hat [1/Wb].
    """
    of_h, of_innovation, of_integral = noise_gains(design, scheme, size * x)
    variance = design.noise_power if design.noise_power > 0.0 else power / of_innovation
    omega, k_eta, gamma = size * abs(x), design.k_eta, design.gamma
    resistance, inductance = design.resistance, design.inductance
    density = variance * scheme.dt
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
    of_xi = 0.5 * slow * (x * x * stiffness + stiffness * stiffness / (size * size))
    of_xi = of_xi / (damping * size * size)
    of_speed = x * x * of_h * variance  # of |h| xi: the speed output without a low-pass
    if design.natural > 0.0:
        of_speed = behind_low_pass(design, slow, density, damping, stiffness, size, x)
        of_speed = min(of_speed, both * of_h * variance)
    return math.sqrt(of_angle), math.sqrt(of_speed), math.sqrt(of_xi)


def behind_low_pass(
    design: Design,
    slow: float,
    density: float,
    damping: float,
    stiffness: float,
    size: float,
    x: float,
) -> float:
    """Return the variance of the low-passed speed [rad^2/s^2].

    Parameters
    ----------
    slow, density : power spectral densities of (R + j omega L) n [V^2 s] and of n [A^2 s].
    damping, stiffness : of the slow loop. size, x : as in `deviations`.
    """
    natural, k_eta = design.natural, design.k_eta
    e, w = 2.0 * DAMPING * natural, natural * natural
    d3, d2 = damping + e, stiffness + damping * e + w
    d1, d0 = damping * w + stiffness * e, stiffness * w
    pull = design.gamma * size
    of_speed = through_four_poles(0.0, x, 0.0, d3, d2, d1, d0)
    of_speed += through_four_poles(0.0, k_eta, pull, d3, d2, d1, d0)
    of_speed = w * w * slow * of_speed
    # L s n: filtered by the slow loop or by the fast part, whichever gives less
    by_slow = through_four_poles(x, 0.0, 0.0, d3, d2, d1, d0)
    by_slow += through_four_poles(k_eta, pull, 0.0, d3, d2, d1, d0)
    f = 2.0 / design.epsilon
    corner = 0.5 * f * f
    by_fast = through_four_poles(
        0.0, 0.0, 1.0, e + f, w + e * f + corner, w * f + e * corner, w * corner
    )
    by_fast = (x * x + k_eta * k_eta) * corner * corner * by_fast
    inductance = design.inductance
    return of_speed + w * w * inductance * inductance * density * min(by_slow, by_fast)


def low_pass_weight(pole: float, dt: float) -> float:
    """Return the weight of the newest sample in a first-order low-pass matched to dt [s].

    `pole` [1/s] is its magnitude; 0: no low-pass, weight 1.
    """
    if pole <= 0.0:
        return 1.0
    return 1.0 - math.exp(-pole * dt)
