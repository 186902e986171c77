"""Parameters of a node, taken apart: what is set of the node, of all joints, and of single ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from estimator_pkg import params_file
from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.parameters import Parameter, build, declared

T = TypeVar('T')
OBSERVER = 'observer'


def apart(values: Mapping[str, Any], settings: type[T], known: Mapping[str, Parameter]
          ) -> tuple[T, dict[str, Any], dict[str, dict[str, Any]]]:
    """(settings of the node, common values, joint -> values).

    Parameters
    ----------
    known : what can be set beside `settings`.

    Raises
    ------
    UsageError : an unknown name, or a wrong value of the settings.
    """
    common, overrides = params_file.split(values)
    of_node = {name: common.pop(name) for name in declared(settings) if name in common}
    if OBSERVER not in declared(settings):
        common.pop(OBSERVER, None)  # the node has but one
    for name in common:
        if name not in known:
            raise UsageError(f"unknown parameter '{name}': "
                             f'{suggestion(name, {**known, **declared(settings)})}')
    return build(settings, of_node), common, overrides
