# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One stream per family of observers: messages in, messages out, the same live and in replay.

The entry point of a stream, in the group ``velocity_estimator.streams``, has the name that is the
``kind`` of its observers.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from estimator_pkg import observers, registry
from estimator_pkg.parameters import Parameter, build, declared

if TYPE_CHECKING:
    from estimator_pkg.streams.contract import Stream

USUAL = 'angle'  # the default kind


def named(kind: str) -> type[Stream]:
    """Return the stream of this kind of observers; raise UsageError if there is none."""
    stream: type[Stream] = registry.find(registry.STREAMS, kind)
    return stream


def of_observer(observer: str) -> type[Stream]:
    """Return the stream of this observer; raise UsageError for an unknown observer."""
    return named(observers.find(observer).kind)


def parameters(observer: str, values: Mapping[str, Any] | None = None) -> dict[str, Parameter]:
    """Return the parameters of this observer and its node, by name; raise UsageError.

    Parameters
    ----------
    values : parameters by name, of which some may name groups of others (see `Stream.groups`).
    """
    stream, own = of_observer(observer), declared(of_observer(observer).SETTINGS)
    settings = build(stream.SETTINGS, {k: v for k, v in (values or {}).items() if k in own})
    groups = {
        f'{prefix}.{name}': parameter
        for prefix, declaring in stream.groups(settings).items()
        for name, parameter in declared(declaring).items()
    }
    return {**stream.parameters(observer), **own, **groups}


def every() -> list[type[Stream]]:
    """Return all streams, sorted by kind."""
    return [named(kind) for kind in registry.names(registry.STREAMS)]
