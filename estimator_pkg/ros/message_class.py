# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Message classes by the names of their types, which come from users, bags and other nodes."""

from __future__ import annotations

import importlib
import importlib.util
import os
import re
from pathlib import Path
from typing import Any

TYPE_NAME = re.compile(r'([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)', re.ASCII)
INTERFACES = 'rosidl_interfaces'  # resource of the ament index: the types of a package


def message_class(type_name: str) -> Any | None:
    """Return the Python class of 'package/msg/Name'; None if its package is not installed.

    Only packages in the ament index are imported, and only from the place that the index names.
    """
    named = TYPE_NAME.fullmatch(type_name)
    if named is None:
        return None
    package, name = named.groups()
    try:
        from ament_index_python.packages import get_package_prefix

        prefix = get_package_prefix(package)
        found = importlib.util.find_spec(package)  # of a package: this imports nothing
        if found is None or not any(
            _within(place, prefix) for place in found.submodule_search_locations or ()
        ):
            return None
        return getattr(importlib.import_module(f'{package}.msg'), name, None)
    except (ImportError, LookupError, ValueError):
        return None


def _within(place: str, prefix: str) -> bool:
    """Return True if a folder is below a prefix, by its own path or by its real path."""
    return any(
        Path(way(place)).is_relative_to(way(prefix)) for way in (os.path.abspath, os.path.realpath)
    )


def packages_with_messages() -> list[str]:
    """Return the packages of this machine that define interfaces."""
    from ament_index_python import get_resources

    return sorted(get_resources(INTERFACES))


def message_types(package: str) -> list[str]:
    """Return the message types of an installed package, as in 'geometry_msgs/msg/Pose'."""
    from ament_index_python import get_resource

    try:
        content, _ = get_resource(INTERFACES, package)
    except (LookupError, ValueError):
        return []
    names = (f'{package}/{Path(line).with_suffix("")}' for line in content.split())
    return sorted({name for name in names if TYPE_NAME.fullmatch(name)})
