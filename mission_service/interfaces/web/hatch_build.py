"""Hatch's hook: the map is in every wheel. One that is built already is taken as it is."""

import os
import sys
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

sys.path.insert(0, os.getcwd())  # noqa: PTH109 (hatch builds in the project's folder)

from mission_service.interfaces.web.build import NODE_FROM_PYPI, PAGE, build_map, has_node


class MapHook(BuildHookInterface):  # type: ignore[misc]
    """Builds the map where it is missing."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """A Node.js, where the machine has none."""
        return [] if PAGE.exists() or has_node() else [NODE_FROM_PYPI]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Before files are collected."""
        if not PAGE.exists():
            build_map()
