# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""`ros2 doctor`: which of our nodes estimate nothing, and why.

Only ros2doctor imports this module, through the entry points `ros2doctor.checks` and
`ros2doctor.report`. Its interface was read in ros2doctor 0.32 (Jazzy).
"""

from __future__ import annotations

from ros2cli.node.direct import DirectNode
from ros2doctor.api import DoctorCheck, DoctorReport, Report, Result
from ros2doctor.api.format import doctor_error

from estimator_pkg.ros.observers import why_nothing

CATEGORY = 'velocity_estimator'


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
    with DirectNode(None) as node:
        return why_nothing(node.node)
