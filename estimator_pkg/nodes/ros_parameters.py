# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""ROS parameters made from declarations (see `estimator_pkg.parameters`).

Typing is dynamic, so that 20 and 20.0 are the same. This module checks type, finiteness and range,
because rclpy does not check the range if an integer is set for a float. The on-set callback checks
a change and can refuse it with the reason; the post-set callback applies it.

Every parameter has a type and a value. A parameter that the observer chooses has its automatic
value, so ``--params-file`` reads the file that ``ros2 param dump`` writes.

The node is made with ``allow_undeclared_parameters=True``, because an override per joint
(``per_joint.<joint>.<parameter>``) may come before its joint.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    SetParametersResult,
)
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from estimator_pkg.errors import UsageError, UserError, suggestion
from estimator_pkg.parameters import Parameter, build, declared
from estimator_pkg.params_file import OVERRIDES, check_leaves, override, parameter_suggestion
from estimator_pkg.printable import printable

T = TypeVar('T')
Values = dict[str, Any]
QOS = 'qos_overrides.'

_TYPES = {
    float: ParameterType.PARAMETER_DOUBLE,
    int: ParameterType.PARAMETER_INTEGER,
    bool: ParameterType.PARAMETER_BOOL,
    str: ParameterType.PARAMETER_STRING,
    tuple: ParameterType.PARAMETER_STRING_ARRAY,
    list: ParameterType.PARAMETER_DOUBLE_ARRAY,
}


class RosParameters:
    """The declared parameters of a node.

    Declare with `declare` and `allow_overrides`, then call `watch` once.

    Parameters
    ----------
    usual : defaults of rclpy's own parameters by name, as it declares them.

    Attributes
    ----------
    values : checked value by name; None: automatic.
    overrides : joint -> checked value by name; None: automatic for this joint.
    instead : returns a clause on the observers that have a gain which this one lacks, or ''.
    """

    def __init__(self, node: Node, usual: Mapping[str, Any] | None = None) -> None:
        self._node, self._usual = node, {} if usual is None else usual
        # Initial values from the command line, parameter files and the constructor.
        self._initial: Values = {
            name: initial.value for name, initial in node._parameter_overrides.items()
        }
        self._known: dict[str, Parameter] = {}
        self._overridable: dict[str, Parameter] = {}
        self.values: Values = {}
        self.overrides: dict[str, Values] = {}
        self._check: Callable[[Values, dict[str, Values]], None] | None = None
        self._apply: Callable[[], None] | None = None
        self._being_set: frozenset[str] = frozenset()
        self._wrong: UsageError | None = None  # error of the change that is being checked
        self._declaring = False
        self.instead: Callable[[str], str] = lambda gain: ''

    def declare(self, cls: type[T], prefix: str = '') -> T:
        """Declare the parameters of the dataclass `cls`; return an instance with their values.

        Parameters
        ----------
        prefix : before each of their names.

        Raises
        ------
        UsageError : an initial value is wrong.
        """
        known = {
            prefix + name: replace(parameter, name=prefix + name)
            for name, parameter in declared(cls).items()
        }
        values = {
            name: parameter.check(self._initial.get(name, parameter.default))
            for name, parameter in known.items()
        }
        instance = build(cls, {name.removeprefix(prefix): v for name, v in values.items()})
        self._known.update(known)
        self.values.update(values)
        for name, parameter in known.items():
            self._declare(name, parameter, values[name])
        return instance

    def allow_overrides(self, names: Iterable[str]) -> None:
        """Accept ``per_joint.<joint>.<parameter>`` for these declared parameters, now and later.

        Raises
        ------
        UsageError : an override has a wrong initial value, or its name is that of a group of
            others.
        """
        self._overridable = {name: self._known[name] for name in names}
        check_leaves(self._initial)
        for name, value in self._initial.items():
            joint, parameter = override(name)
            if joint and parameter in self._overridable and value is not None:
                checked = self._checked(name, self._overridable[parameter], value)
                self.overrides.setdefault(joint, {})[parameter] = checked
                self._declare(name, self._overridable[parameter], checked)

    def watch(
        self, check: Callable[[Values, dict[str, Values]], None], apply: Callable[[], None]
    ) -> None:
        """Check and apply changes of parameters from now on.

        Parameters
        ----------
        check : called with the new (values, overrides) before a change; raises UserError to refuse.
        apply : called after `values` and `overrides` have changed.
        """
        self._check, self._apply = check, apply
        self._node.add_pre_set_parameters_callback(self._before_set)
        self._node.add_on_set_parameters_callback(self._on_set)
        self._node.add_post_set_parameters_callback(self._after_set)

    def changed(self) -> str:
        """Return the names of the parameters that differ from their defaults, as text."""
        names = [
            name
            for name, value in self._initial.items()
            if self._node.has_parameter(name)
            and (
                self.values[name] != self._known[name].default
                if name in self._known
                else value != self._usual.get(name)
            )
        ]
        return f'not the defaults: {", ".join(names)}' if names else 'all parameters are defaults'

    def unknown(self) -> dict[str, str]:
        """Return the initial parameters that are not declared, each with a hint for its name."""
        wrong = {}
        for name in self._initial:
            if name not in self._known and not self._node.has_parameter(name):
                wrong[name] = self._hint(name)
        return wrong

    def _hint(self, name: str) -> str:
        hint = self.instead(override(name)[1] if self._overridable else name)
        if hint:
            return hint
        joint, parameter = override(name)
        if joint and self._overridable:
            return suggestion(parameter, self._overridable)
        if name.startswith(QOS):
            declared_here = self._node.list_parameters([QOS.rstrip('.')], 0).names
            return suggestion(name, declared_here)
        return parameter_suggestion(name, self._known, self._overridable)

    def _declare(self, name: str, parameter: Parameter, value: Any) -> None:
        self._declaring = True
        try:
            self._node.declare_parameter(
                name, parameter.plain(value), _descriptor(parameter), ignore_override=True
            )
        finally:
            self._declaring = False

    @staticmethod
    def _checked(name: str, parameter: Parameter, value: Any) -> Any:
        try:
            return parameter.check(value)
        except UsageError as error:  # put the override's full name in the text
            text = str(error).replace(f"'{parameter.name}'", f"'{name}'", 1)
            raise UsageError(text) from None

    def _find(self, name: str) -> Parameter | None:
        if name in self._known:
            return self._known[name]
        joint, parameter = override(name)
        return self._overridable.get(parameter) if joint else None

    def _after(self, changes: list[RosParameter]) -> tuple[Values, dict[str, Values]]:
        """Return (values, overrides) after `changes`; raises UsageError if one is wrong."""
        values = dict(self.values)
        overrides = {joint: dict(own) for joint, own in self.overrides.items()}
        for change in changes:
            parameter = self._find(change.name)
            if parameter is None:
                continue
            value = change.value
            if change.name in self._known:
                if value is None:
                    value = parameter.default  # deleted: back to the default
                values[change.name] = parameter.check(value)
                continue
            joint, name = override(change.name)
            own = overrides.setdefault(joint, {})
            if value is None:
                own.pop(name, None)  # deleted: follows the common value again
            else:
                own[name] = self._checked(change.name, parameter, value)
            if not own:
                del overrides[joint]
        check_leaves(
            f'{OVERRIDES}.{joint}.{name}' for joint, own in overrides.items() for name in own
        )
        return values, overrides

    def _before_set(self, changes: list[RosParameter]) -> list[RosParameter]:
        """Return the changes with the declared types, so that 20 is stored as 20.0."""
        self._being_set = frozenset(change.name for change in changes)
        self._wrong = None
        for change in changes:  # rclpy refuses these without calling `_on_set`
            parameter = self._find(change.name)
            if parameter is not None and parameter.structural and not self._has(change):
                self._refused(_fixed(change.name))
        return [self._typed(change) for change in changes]

    def _typed(self, change: RosParameter) -> RosParameter:
        parameter = self._find(change.name)
        if parameter is None or change.value is None:
            return change
        try:
            value = self._checked(change.name, parameter, change.value)
        except UsageError as error:
            self._wrong = self._wrong or error
            value = parameter.default  # passes rclpy's range check; `_on_set` returns our reason
        return RosParameter(change.name, value=parameter.plain(value))

    def _on_set(self, changes: list[RosParameter]) -> SetParametersResult:
        if self._declaring:
            return SetParametersResult(successful=True)
        being_set, self._being_set = self._being_set, frozenset()
        try:
            for change in changes:
                self._settable(change.name, change.name in being_set)
            if self._wrong is not None:
                raise self._wrong
            if self._check is not None and any(self._find(change.name) for change in changes):
                self._check(*self._after(changes))
        except UserError as error:
            self._refused(error)
            return SetParametersResult(successful=False, reason=printable(error))
        return SetParametersResult(successful=True)

    def _has(self, change: RosParameter) -> bool:
        """Return True if the parameter has this value: `ros2 param load` sets every parameter."""
        return bool(
            self._node.has_parameter(change.name)
            and repr(self._node.get_parameter(change.name).value) == repr(change.value)
        )

    def _refused(self, error: UserError) -> None:
        """Log a change that is refused: rqt_reconfigure and other programs ignore the result."""
        self._node.get_logger().warning(f'parameters are not changed: {error}')

    def _settable(self, name: str, being_set: bool) -> None:
        parameter = self._find(name)
        if parameter is None:
            # Other parts of the node may declare parameters, but one that does not exist cannot be
            # set.
            if being_set and not self._node.has_parameter(name):
                raise UsageError(f"unknown parameter '{name}': {self._hint(name)}")
        elif parameter.structural and being_set:
            raise _fixed(name)

    def _after_set(self, changes: list[RosParameter]) -> None:
        known = [change.name for change in changes if self._find(change.name) is not None]
        if self._declaring or not known:
            return
        self.values, self.overrides = self._after(changes)
        for name in known:
            if not self._node.has_parameter(name):  # it was deleted, which undeclares it
                if name in self._known:
                    self._declare(name, self._known[name], self.values[name])
            elif name not in self._known:  # an override may be new
                parameter = self._find(name)
                assert parameter is not None
                self._node.set_descriptor(name, _descriptor(parameter))
        if self._apply is not None:
            self._apply()


def _fixed(name: str) -> UsageError:
    return UsageError(f"parameter '{name}' is structural: set it before the node starts")


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    unit = f' [{parameter.unit}]' if parameter.unit else ''
    ranges: dict[str, Any] = {}
    low, high = parameter.minimum, parameter.maximum
    if parameter.kind in (int, float) and low is not None and high is not None:
        if parameter.automatic is not None:
            low = min(low, parameter.automatic)
        bounds = {'from_value': parameter.kind(low), 'to_value': parameter.kind(high)}
        if parameter.kind is float:
            ranges['floating_point_range'] = [FloatingPointRange(**bounds)]
        else:
            ranges['integer_range'] = [IntegerRange(**bounds)]
    return ParameterDescriptor(
        **ranges,
        type=_TYPES[parameter.kind],
        description=parameter.description + unit,
        additional_constraints=parameter.range_text(),
        read_only=parameter.structural,
        dynamic_typing=True,
    )


def in_words(error: ParameterException) -> str:
    """Return the text of rclpy's error without the parameter's name that rclpy appends."""
    return str(error).rpartition(': ')[0] or str(error)


def ros_values(values: Mapping[str, Any]) -> list[RosParameter]:
    """Return parameters for a node's ``parameter_overrides``, from plain values by name."""
    return [
        RosParameter(name, value=list(value) if isinstance(value, tuple) else value)
        for name, value in values.items()
    ]
