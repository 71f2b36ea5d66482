"""Adds the map to every wheel that hatch builds. An existing build of the map is kept."""

import os
import sys
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

sys.path.insert(0, os.getcwd())  # noqa: PTH109 (hatch builds in the project's folder)

from mission_service.interfaces.web.build import NODE_FROM_PYPI, PAGE, build_map, has_node


class MapHook(BuildHookInterface):  # type: ignore[misc]
    """The build hook of hatch that builds the map if it is missing."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """Return the Node.js package on PyPI if both the map and Node.js are missing."""
        return [] if PAGE.exists() or has_node() else [NODE_FROM_PYPI]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the map before hatch collects the files."""
        if not PAGE.exists():
            build_map()
