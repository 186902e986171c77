"""Which kind of observer a bag is to be replayed with; a kind is one file, and an entry point.

A kind is what an observer takes in: one angle, a mechanism's positions and efforts, a drive's
currents and voltages. Its entry point in the group ``velocity_estimator.kinds`` has the name that
its observers carry as ``kind``.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from estimator_pkg import observers, params_file, registry
from estimator_pkg.bags.kinds.contract import Kind
from estimator_pkg.bags.reader import Bag
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.parameters import declared

USUAL = 'angle'     # where nothing says otherwise


def named(kind: str) -> Kind:
    """The kind of this name."""
    return registry.find(registry.KINDS, kind)


def of_observer(observer: str) -> Kind:
    """The kind of this observer.

    Raises
    ------
    UsageError : no such observer.
    """
    return named(observers.find(observer).kind)


def wanted(bag: Bag, observer: str | None, params: str | None, values: dict[str, Any],
           node: str | None = None) -> Kind:
    """The kind that is asked for: by observer or parameters, else by what the bag has.

    Parameters
    ----------
    params, values : parameter file, and parameters that were set beside it.
    node : name of the node whose section of the file is meant; None: the kinds' own.
    """
    if observer:
        return of_observer(observer)
    known = [named(name) for name in registry.names(registry.KINDS)]
    if params:
        sections = params_file.section_names(params)
        for kind in known:
            with suppress(UsageError):  # said where the file is used
                said = params_file.load(params, node or kind.node).get('observer')
                if isinstance(said, str):
                    return of_observer(said)
        for kind in known:
            if kind.node in sections:
                return kind
    if isinstance(values.get('observer'), str):
        return of_observer(values['observer'])
    given = set(values)
    if params:
        with suppress(UsageError):
            given |= set(params_file.of_this_node(params_file.load(params, node or known[0].node)))
    if given and not _knows(USUAL, given):
        for name in registry.names(registry.KINDS):
            if _knows(name, given):
                return named(name)
    return next((kind for kind in known if kind.recognises(bag)), named(USUAL))


def _knows(kind: str, given: set[str]) -> bool:
    """True if all these parameters, as named in files and on command lines, are of this kind."""
    of = named(kind)
    known = {'observer', *declared(of.settings)}
    for name in registry.names(registry.OBSERVERS):
        with suppress(UserError):   # one that cannot be imported is told where it is asked for
            if observers.find(name).kind == kind:
                known |= set(of.parameters(name))
    return {params_file.parameter_of(name) for name in given} <= known


def parameters(kind: Kind, params: str | None, assignments: dict[str, Any],
               observer: str | None, node: str | None = None) -> dict[str, Any]:
    """Parameters of the kind's node by name, from a file, from --set and from --observer.

    Raises
    ------
    UserError, UsageError : the file cannot be read, or has no section for the node.
    """
    values = params_file.load(params, node or kind.node) if params else {}
    values.update(assignments)
    if observer:
        values['observer'] = observer
    if not isinstance(values.get('observer', ''), str):
        raise UsageError(f"parameter 'observer' must be text, not {values['observer']!r}")
    return params_file.of_this_node(values)
