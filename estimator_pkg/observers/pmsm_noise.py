"""How much current noise reaches back-EMF, innovation, angle, speed and flux.

Around a converged state the fast part is linear. White noise n on each current drives it through
the sampled system exactly (a discrete Lyapunov equation of order two); below its bandwidth the
back-EMF estimate carries (R + j omega L) n. The slow part then acts as a phase-locked loop.
"""

from __future__ import annotations

import math


def covariance(e11: float, e12: float, e21: float, e22: float, b1: float, b2: float
               ) -> tuple[float, float, float]:
    """(P11, P12, P22) of P = E P E' + b b', by Cramer's rule."""
    a11, a12, a13 = 1.0 - e11 * e11, -2.0 * e11 * e12, -e12 * e12
    a21, a22, a23 = -e11 * e21, 1.0 - e11 * e22 - e12 * e21, -e12 * e22
    a31, a32, a33 = -e21 * e21, -2.0 * e21 * e22, 1.0 - e22 * e22
    r1, r2, r3 = b1 * b1, b1 * b2, b2 * b2
    m1, m2, m3 = a22 * a33 - a23 * a32, a21 * a33 - a23 * a31, a21 * a32 - a22 * a31
    total = a11 * m1 - a12 * m2 + a13 * m3
    p11 = r1 * m1 - a12 * (r2 * a33 - a23 * r3) + a13 * (r2 * a32 - a22 * r3)
    p12 = a11 * (r2 * a33 - a23 * r3) - r1 * m2 + a13 * (a21 * r3 - r2 * a31)
    p22 = a11 * (a22 * r3 - r2 * a32) - a12 * (a21 * r3 - r2 * a31) + r1 * m3
    return p11 / total, p12 / total, p22 / total


def prepare_noise(resistance: float, inductance: float, k_p: float, k_i: float, scheme: tuple
                  ) -> tuple[float, float, float]:
    """Variances per unit variance of white noise on each current.

    Returns
    -------
    (of one component of h [V^2/A^2], of one component of the innovation i_frame - i, of the fast
    part of the integral of h [V^2 s^2/A^2])
    """
    (dt, e11, e12, e21, e22, iu, ia, iw, idd, idw, hu, ha, hw, hdd, hdw) = scheme
    # x_k+1 = E x_k + b0 n_k + b1 n_k+1; w = x - b1 n has white drive E b1 + b0
    c1, c2 = idd, hdd
    b1, b2 = e11 * c1 + e12 * c2 + ia - idd, e21 * c1 + e22 * c2 + ha - hdd
    p11, p12, p22 = covariance(e11, e12, e21, e22, b1, b2)
    of_h = p22 + c2 * c2
    of_innovation = p11 + (1.0 - c1) * (1.0 - c1)
    # integral of h = L (i - h kp/ki) + a part that changes slowly
    ratio = k_p / k_i
    x11, x12, x22 = p11 + c1 * c1, p12 + c1 * c2, of_h
    of_integral = inductance * inductance * (x11 - 2.0 * ratio * x12 + ratio * ratio * x22)
    return of_h, of_innovation, of_integral


def deviations(variance: float, size: float, x: float, k_eta: float, gamma: float,
               resistance: float, inductance: float, epsilon: float, pole: float, dt: float,
               gains: tuple[float, float, float]) -> tuple[float, float, float]:
    """One standard deviation of electrical angle [rad], electrical speed [rad/s] and xi [1/Wb].

    Parameters
    ----------
    variance : of the noise on each current [A^2].
    size, x : |h| [V] and xi_hat [1/Wb].
    pole : of the low-pass on the speed [1/s]; 0: none.
    gains : from `prepare_noise`.
    """
    of_h, of_innovation, of_integral = gains
    omega = size * abs(x)
    slow = (resistance * resistance + omega * omega * inductance * inductance) * variance * dt
    damping = k_eta * size              # 2 zeta omega_n of the slow loop
    stiffness = gamma * size * size     # omega_n^2
    # the frame turns at |h| x: noise of |h| is noise of the speed, and its integral of the angle
    of_speed = x * x * of_h * variance
    if pole > 0.0:
        corner = 2.0 / (epsilon * epsilon)
        d1, d0 = pole * 2.0 / epsilon + corner, pole * corner
        d2 = pole + 2.0 / epsilon
        room = 2.0 * (d1 * d2 - d0)
        high = (inductance * pole * corner) ** 2 / room * variance * dt
        low = slow * (pole * corner) ** 2 * d2 / (d0 * room)
        filtered = x * x * (high + low)
        if filtered < of_speed:
            of_speed = filtered
    if damping <= 0.0 or stiffness <= 0.0:
        return math.pi / math.sqrt(3.0), math.sqrt(of_speed), abs(x)
    of_angle = (x * x * of_integral * variance + 0.5 * slow * x * x / damping
                + 0.5 * slow / (size * size) * (damping + stiffness / damping))
    of_xi = 0.5 * slow * (x * x * stiffness + stiffness * stiffness / (size * size)) / (
        damping * size * size)
    return math.sqrt(of_angle), math.sqrt(of_speed), math.sqrt(of_xi)


def low_pass_weight(pole: float, dt: float) -> float:
    """Weight of the newest sample in a first-order low-pass matched to dt; 1 for no low-pass."""
    if pole <= 0.0:
        return 1.0
    return 1.0 - math.exp(-pole * dt)


