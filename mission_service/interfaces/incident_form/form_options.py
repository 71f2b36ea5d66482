"""Converts a completed form to the options of ``mission-service incident new``. Pure."""

import re
from pathlib import Path

import msgspec

from mission_service.errors import MissionServiceError

FILE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,99}")


class LayerFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A raster of the landscape: its layer, its uploaded file and its unit ("" if stated)."""

    name: str
    file: str
    unit: str = ""


class Form(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The fields of the page, written like the options of the command; "" if not completed.

    ``landscape``, ``weather``, ``perimeter`` and the files of ``layers`` are names of uploaded
    files.
    """

    box: str = ""
    fuel_model: str = ""
    landscape: str = ""
    layers: tuple[LayerFile, ...] = ()
    missing: str = ""
    wind: str = ""
    weather: str = ""
    start: str = ""
    moistures: str = ""
    ignitions: tuple[str, ...] = ()
    perimeter: str = ""
    aircraft: tuple[str, ...] = ()
    time_zero: str = ""
    hours: str = ""
    real: bool = False


def options_of(form: Form, folder: Path) -> list[str]:
    """Return the options for a form.

    Args:
        form: The completed form.
        folder: The folder of the uploaded files.

    Returns:
        Arguments for the command line, such as ``--wind=5,225``.

    Raises:
        MissionServiceError: A file has not been uploaded.
    """

    def path(name: str) -> str:
        return str(uploaded(name, folder)) if name else ""

    options = [
        ("box", form.box),
        ("fuel-model", form.fuel_model),
        ("landscape", path(form.landscape)),
        ("missing", form.missing),
        ("wind", form.wind),
        ("weather", path(form.weather)),
        ("start", form.start),
        ("moistures", form.moistures),
        ("perimeter", path(form.perimeter)),
        ("time-zero", form.time_zero),
        ("hours", form.hours),
        *(("layer", f"{each.name}={path(each.file)}") for each in form.layers),
        *(("unit", f"{each.name}={each.unit}") for each in form.layers if each.unit),
        *(("ignition", each) for each in form.ignitions),
        *(("vehicle", each) for each in form.aircraft),
    ]
    # With "=", because a value may begin with a minus sign.
    found = [f"--{name}={value}" for name, value in options if value]
    return [*found, "--real"] if form.real else found


def uploaded(name: str, folder: Path) -> Path:
    """Return the path of an uploaded file. Raises MissionServiceError if there is none."""
    if FILE_NAME.fullmatch(name) is None or not (folder / name).is_file():
        raise MissionServiceError(f"{name}: no such file has been uploaded; choose it again")
    return folder / name
