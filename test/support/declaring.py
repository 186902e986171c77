# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The classes that declare parameters."""

import dataclasses
import importlib
import inspect
import pkgutil
from functools import lru_cache

import estimator_pkg
import sim_pkg
from estimator_pkg.parameters import declared


@lru_cache
def declaring():
    """{full name: class} of both packages."""
    found = {}
    for package in (estimator_pkg, sim_pkg):
        for info in pkgutil.walk_packages(package.__path__, f'{package.__name__}.'):
            if info.name.endswith(('.launching', '__main__', '._engine')):
                continue  # needs launch, which is not on PyPI; is no module
            try:
                module = importlib.import_module(info.name)
            except ModuleNotFoundError as error:
                if (error.name or '').partition('.')[0] in ('estimator_pkg', 'sim_pkg'):
                    raise
                continue
            for _, cls in inspect.getmembers(module, inspect.isclass):
                if dataclasses.is_dataclass(cls) and declared(cls):
                    found[f'{cls.__module__}.{cls.__qualname__}'] = cls
    return found
