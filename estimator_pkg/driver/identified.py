"""What a joint has identified, as key and value: the same live and in replay."""

from __future__ import annotations

from typing import Any

from estimator_pkg.observers.adaptive_report import Report

UNKNOWN_UNIT = 'unit of input'  # as a report calls it


def values_of(said: Report, input_unit: str = '') -> dict[str, Any]:
    """The state, and of each parameter its value, deviation, unit and whether it is trusted.

    Parameters
    ----------
    input_unit : that of the model's input; empty: not known.
    """
    values: dict[str, Any] = {'state': said.phase, 'why': said.reason, 'trusted': said.trusted,
                              'adapted_s': said.adapted, 'excitation': said.excitation,
                              'explained': said.explained}
    for item in said.parameters:
        unit = item.unit.replace(UNKNOWN_UNIT, input_unit) if input_unit else item.unit
        values.update({item.name: item.value, f'{item.name}.stddev': item.stddev,
                       f'{item.name}.unit': unit, f'{item.name}.trusted': item.trusted})
    return values
