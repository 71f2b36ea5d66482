"""Parses the arguments of ``fire info``, and describes the files in these arguments."""

import json
import math
from pathlib import Path
from typing import Any

from firemodel.landscape.info import Description, describe, describe_rasters
from mission_service.errors import MissionServiceError

HOW = "specify one file, or the layers of a landscape, each as LAYER=FILE"


def describe_files(
    words: tuple[str, ...], crs: str | None, nodata: float | None, units: tuple[str, ...]
) -> Description:
    """Return the description of one file, or of the landscape given by LAYER=FILE arguments.

    ``units`` are LAYER=UNIT arguments. Raises MissionServiceError for malformed arguments.
    """
    pairs = _pairs(units, "--unit", "write it as LAYER=UNIT")
    if len(words) == 1 and "=" not in words[0]:
        path = Path(words[0])
        if not pairs:
            return describe(path, crs=crs, nodata=nodata)
        return describe_rasters(path, units=pairs, crs=crs, nodata=nodata)
    layers = {layer: Path(name) for layer, name in _pairs(words, "files", HOW).items()}
    return describe_rasters(layers, units=pairs, crs=crs, nodata=nodata)


def json_of(found: Description) -> str:
    """Return a description as JSON, in which numbers that are not finite are null."""
    return json.dumps(_finite(found), allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _pairs(words: tuple[str, ...], where: str, how: str) -> dict[str, str]:
    found = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not (name and equals and value):
            raise MissionServiceError(f"{where}: {word}: {how}")
        if name in found:
            raise MissionServiceError(f"{where}: {name} is specified twice; specify it once")
        found[name] = value
    return found
