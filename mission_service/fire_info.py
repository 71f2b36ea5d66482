"""``fire info``: from the words of a command line to a description of files."""

from pathlib import Path

from firemodel.info import Description, describe, describe_rasters
from mission_service.errors import MissionServiceError


def describe_files(
    words: tuple[str, ...], crs: str | None, nodata: float | None, units: tuple[str, ...]
) -> Description:
    """Describe one file, or LAYER=FILE words that make a landscape.

    Raises MissionServiceError for words that are neither.
    """
    pairs = _pairs(units, "--unit")
    if len(words) == 1 and "=" not in words[0]:
        path = Path(words[0])
        return (
            describe_rasters(path, units=pairs, crs=crs, nodata=nodata)
            if pairs
            else describe(path, crs=crs, nodata=nodata)
        )
    layers = {layer: Path(name) for layer, name in _pairs(words, "files").items()}
    return describe_rasters(layers, units=pairs, crs=crs, nodata=nodata)


def _pairs(words: tuple[str, ...], where: str) -> dict[str, str]:
    found = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals:
            raise MissionServiceError(
                f"{where}: {word}: give one file, or each as LAYER=FILE (units as LAYER=UNIT)"
            )
        found[name] = value
    return found
