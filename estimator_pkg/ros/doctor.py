# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""`ros2 doctor`: which of our nodes estimate nothing, and why.

Only ros2doctor imports this module, through the entry points `ros2doctor.checks` and
`ros2doctor.report`. Its interface was read in ros2doctor 0.32 (Jazzy).
"""

from __future__ import annotations

from functools import partial
from time import monotonic
from typing import Any

import rclpy
from ros2cli.node.direct import DirectNode
from ros2doctor.api import DoctorCheck, DoctorReport, Report, Result
from ros2doctor.api.format import doctor_error

from estimator_pkg.ros.observers import listen, observers

CATEGORY = 'velocity_estimator'
ESTIMATING = {'tracking', 'coasting'}
PATIENCE = 3.0  # [s] for ~/status, which is latched, and /diagnostics, which comes once a second
DISCOVERY = 1.0  # [s] for the first node, beyond the 0.5 s of ros2cli


class EstimateCheck(DoctorCheck):  # type: ignore[misc]  # without ros2cli it is Any
    """Reports each observer node that estimates nothing, as an error."""

    def category(self) -> str:
        """Return the name that links check and report."""
        return CATEGORY

    def check(self) -> Result:
        """Return one error for each such node."""
        result = Result()
        for name, why in found().items():
            if why:
                doctor_error(f'{name} estimates nothing: {why}')
                result.add_error()
        return result


class EstimateReport(DoctorReport):  # type: ignore[misc]  # without ros2cli it is Any
    """Lists the observer nodes."""

    def category(self) -> str:
        """Return the name that links check and report."""
        return CATEGORY

    def report(self) -> Report:
        """Return the nodes, each with 'estimates' or the reason why not."""
        report = Report('VELOCITY ESTIMATOR NODES')
        for name, why in found().items():
            report.add_to_report('node', name)
            report.add_to_report('estimates', why or 'yes')
        if not report.items:
            report.add_to_report('node', 'none')
        return report


def found() -> dict[str, str]:
    """Return the observer nodes of the graph: name -> '' or why it estimates nothing."""
    statuses: dict[str, list[Any]] = {}
    diagnoses: dict[str, str] = {}
    with DirectNode(None) as node:
        end = monotonic() + DISCOVERY
        while not (names := observers(node)) and monotonic() < end:
            rclpy.spin_once(node.node, timeout_sec=0.1)
        for name in names:
            take = (partial(each.__setitem__, name) for each in (statuses, diagnoses))
            listen(node, name, *take)
        end = monotonic() + PATIENCE
        while not (names <= statuses.keys() & diagnoses.keys()) and monotonic() < end:
            rclpy.spin_once(node.node, timeout_sec=0.1)
    return {name: _why(statuses.get(name), diagnoses.get(name, '')) for name in sorted(names)}


def _why(entries: list[Any] | None, diagnosis: str) -> str:
    """Return why a node estimates nothing; '' if one of its joints has an estimate."""
    if entries is None:
        return f'its status did not arrive within {PATIENCE:g} s'
    for entry in entries:
        if any(item.key == 'status' and item.value in ESTIMATING for item in entry.values):
            return ''
    reasons = [f'{entry.name}: {entry.message}' for entry in entries] or ['no joint has appeared']
    return '; '.join([*reasons, *([diagnosis] if diagnosis not in ('', 'ok') else [])])
