# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A plugin of mypy: what `estimator_pkg.record.record` adds to the class that it decorates."""

from collections.abc import Callable

from mypy.nodes import ARG_POS, Argument, Var
from mypy.plugin import ClassDefContext, Plugin
from mypy.plugins.common import add_attribute_to_class, add_method_to_class
from mypy.types import AnyType, Instance, NoneType, TypeOfAny


def add_members(context: ClassDefContext) -> bool:
    """Add take, write, read, of and dtype."""
    api, cls, anything = context.api, context.cls, AnyType(TypeOfAny.special_form)
    itself, nothing = Instance(cls.info, []), NoneType()
    for name, kind, result in [
        ('take', itself, nothing),
        ('write', anything, nothing),
        ('read', anything, itself),
        ('of', anything, anything),
    ]:
        argument = Argument(Var('other', kind), kind, None, ARG_POS)
        of_class = name in ('read', 'of')
        add_method_to_class(api, cls, name, [argument], result, is_classmethod=of_class)
    for name in ('dtype', 'fields', 'generic'):
        add_attribute_to_class(api, cls, name, anything, is_classvar=True)
    return True


class Records(Plugin):
    """The plugin."""

    def get_class_decorator_hook_2(self, fullname: str) -> Callable[[ClassDefContext], bool] | None:
        """Return the hook of the decorator."""
        return add_members if fullname == 'estimator_pkg.record.record' else None


def plugin(version: str) -> type[Plugin]:
    """Return the plugin, as mypy looks for it."""
    return Records
