"""What the gains of an observer of mechanisms mean, for ``velocity_estimator list``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from estimator_pkg import observers, registry
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.observers.circle import Circle
from estimator_pkg.observers.mechanical import MechanicalFunctions
from estimator_pkg.observers.mechanical_gains import MEANINGS, in_words
from estimator_pkg.parameters import build


def meanings(name: str, values: Mapping[str, Any], rate: float) -> dict[str, dict[str, str]]:
    """What the gains mean, by model: of the one that is set, else of every built-in one.

    Empty for what is no observer of mechanisms.

    Parameters
    ----------
    name : of the observer.
    values : parameters that differ from their defaults.
    rate : samples per second.

    Raises
    ------
    UsageError, UserError : values that cannot be used, or that this observer does not have.
    """
    if not rate > 0.0:
        raise UsageError(f'--rate must be above 0, not {rate:g}')
    record = observers.find(name) if name in registry.names(registry.OBSERVERS) else None
    if record is None or record.kind != 'mechanical':
        if values:
            raise UsageError(f"'--set' is for observers of mechanisms, not for '{name}'")
        return {}
    models = [str(values['model'])] if 'model' in values else registry.names(registry.MODELS)
    found: dict[str, dict[str, str]] = {}
    for model in models:
        gains: Any = build(record.gains, {**values, 'model': model}, owner=name)
        try:
            functions = record.build(gains, Circle())
        except UserError as error:
            if len(models) == 1:
                raise
            found[model] = {'refused': str(error)}
            continue
        assert isinstance(functions, MechanicalFunctions)
        words = in_words(functions.describe(1.0 / rate))
        why = functions.limits(1.0 / rate)
        found[model] = {**words, **({'refused': why} if why else {})}
    return found


def as_text(found: Mapping[str, Mapping[str, str]], rate: float) -> str:
    """`meanings` for a terminal."""
    lines = [f'  what the gains mean at {rate:g} Hz (--rate, --set NAME=VALUE for others):']
    for model, words in found.items():
        lines.append(f'    {model}')
        lines += [f'      {MEANINGS.get(name, name)}: {text}' for name, text in words.items()]
    return '\n'.join(lines)
