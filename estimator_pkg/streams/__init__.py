"""One stream per family of observers: messages in, messages out, the same live and in replay.

The entry point of a stream, in the group ``velocity_estimator.streams``, has the name that its
observers carry as ``kind``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from estimator_pkg import observers, registry

if TYPE_CHECKING:
    from estimator_pkg.streams.contract import Stream

USUAL = 'angle'  # where nothing says otherwise


def named(kind: str) -> type[Stream]:
    """The stream of this kind of observers; raises UsageError where there is none."""
    return registry.find(registry.STREAMS, kind)


def of_observer(observer: str) -> type[Stream]:
    """The stream in which this observer runs; raises UsageError for an unknown observer."""
    return named(observers.find(observer).kind)


def every() -> list[type[Stream]]:
    """All of them, by name of their kind."""
    return [named(kind) for kind in registry.names(registry.STREAMS)]
