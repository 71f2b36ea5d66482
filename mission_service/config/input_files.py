"""Lists the input files of a scenario."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mission_service.config.scenario import Scenario


def input_files(scenario: Scenario, tables: set[str]) -> list[Path]:
    """Return the files named by a scenario's tables, and the grids named by an .atm file."""
    from firemodel.landscape.readers.wind_files import listed_grids

    paths = sorted(set(_paths_in(scenario.model_dump(include=tables))))
    return [each for path in paths for each in (path, *listed_grids(path))]


def _paths_in(data: Any) -> Iterator[Path]:
    if isinstance(data, Path):
        yield data
    elif isinstance(data, dict | list | tuple):
        for part in data.values() if isinstance(data, dict) else data:
            yield from _paths_in(part)
