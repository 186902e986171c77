# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The edge-aware adaptive observer."""

from __future__ import annotations

from typing import TypeAlias

from estimator_pkg.observers.angle.edge import observer as law
from estimator_pkg.observers.angle.edge import sigma
from estimator_pkg.observers.contract import Observer


class EdgeAdaptive(Observer):
    """The default observer of an angle; its functions are in `observer`."""

    name = 'edge_adaptive'
    summary = (
        'finds bandwidth and noise by itself: say how many counts the encoder has, or not even that'
    )
    reference = (
        'docs/observers/edge_adaptive.md: edges as times, truncated Gaussians, innovation '
        'correlation (Mehra 1970), cumulative sums (Page 1954)'
    )
    gains = law.Gains
    SINGLE_ANGLE = True
    EDGES = True
    TURNS = True
    Design: TypeAlias = law.Design
    Coefficients: TypeAlias = law.Coefficients
    State: TypeAlias = law.State
    design = staticmethod(law.design)
    prepare = staticmethod(law.prepare)
    start = staticmethod(law.start)
    step = staticmethod(law.step)
    estimate = staticmethod(law.estimate)
    deviation = staticmethod(sigma.deviation)
    resume = staticmethod(law.resume)
    restart = staticmethod(law.restart)
    why = staticmethod(law.why)

    @staticmethod
    def gives_acceleration(gains: law.Gains) -> bool:
        """Return True: the acceleration is a state."""
        return True
