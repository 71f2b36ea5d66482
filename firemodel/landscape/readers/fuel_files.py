"""Read FARSITE's fuel files: custom models (.fmd), moistures (.fms), rate factors (.adj)."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from firemodel.errors import FireModelError
from firemodel.physics.fuels import (
    FUEL_MODELS,
    LB_FT2_PER_TON_ACRE,
    NON_BURNABLE,
    FuelModel,
)
from firemodel.physics.rothermel import M_PER_FT, Moisture

CM_PER_FT = 100.0 * M_PER_FT
LB_FT2_PER_TONNE_HA = 0.1 / 4.88242764  # kg/m² per tonne/ha, kg/m² per lb/ft²
J_KG_PER_BTU_LB = 2326.0
# Factors that convert the units of an .fmd file to lb/ft² (load), 1/ft (SAV), ft (depth) and Btu/lb
# (heat).
FMD_UNITS = {
    "ENGLISH": (LB_FT2_PER_TON_ACRE, 1.0, 1.0, 1.0),
    "METRIC": (LB_FT2_PER_TONNE_HA, CM_PER_FT, 1.0 / CM_PER_FT, 1.0 / J_KG_PER_BTU_LB),
}
FMD_FIELDS = (
    "number, code, five loads, static or dynamic, three SAVs, depth, extinction moisture, two "
    "heats, name; or the same without code, type and name"
)
MAX_CODE = 32767
MAX_PCT = 400.0


def read_fuels(path: Path) -> dict[int, FuelModel]:
    """Read custom fuel models from an .fmd file.

    The first line of the file may be ENGLISH (default; tons/acre, 1/ft, ft, Btu/lb) or METRIC
    (tonnes/ha, 1/cm, cm, J/kg). A line of 13 numbers, as in older files, is a static model.

    Args:
        path: The file.

    Returns:
        The fuel model of each code.

    Raises:
        FireModelError: The file cannot be used; the message names file, line, field and value.
    """
    units = FMD_UNITS["ENGLISH"]
    found: dict[int, FuelModel] = {}
    for line, fields in rows_of(path):
        where = f"{path} line {line}"
        if fields[0].upper() in FMD_UNITS:
            units = FMD_UNITS[fields[0].upper()]
            continue
        code = _code(where, fields[0])
        if code in FUEL_MODELS or code in NON_BURNABLE or code in found:
            fault = "occurs twice in the file" if code in found else "is a standard fuel model"
            raise FireModelError(f"{where}: fuel code {code} {fault}; assign it another number")
        found[code] = _fuel(where, fields, units)
    if not found:
        raise FireModelError(f"{path}: contains no fuel model; add a line with {FMD_FIELDS}")
    return found


def _fuel(where: str, fields: list[str], units: tuple[float, float, float, float]) -> FuelModel:
    dynamic, name = False, f"custom {fields[0]}"
    if len(fields) >= 15 and fields[7].lower() in ("static", "dynamic"):
        dynamic = fields[7].lower() == "dynamic"
        name = " ".join([fields[1], *fields[15:]])
        texts = fields[2:7] + fields[8:15]
    elif len(fields) == 13:
        texts = fields[1:]
    else:
        raise FireModelError(f"{where}: {len(fields)} fields; required are {FMD_FIELDS}")
    values = [number(where, "a value", text, 0.0, 1e9) for text in texts]
    loads = [value * units[0] for value in values[:5]]
    savs = [value * units[1] for value in values[5:8]]
    depth_ft, extinction = values[8] * units[2], values[9] / 100.0
    heats = [value * units[3] for value in values[10:12]]
    for fault, wrong in (
        (
            "all loads of dead fuel are 0; use landscape.fuel_codes for a code that does not burn",
            not any(loads[:3]),
        ),
        (
            "a load is above 100 tons/acre; check the units",
            max(loads) > 100.0 * LB_FT2_PER_TON_ACRE,
        ),
        (
            "the SAV of a class with a load must be 10 to 10000 1/ft; check the units",
            _has_implausible_sav(loads, savs),
        ),
        ("the depth must be 0.01 to 40 ft; check the units", not 0.01 <= depth_ft <= 40.0),
        ("the extinction moisture must be 1 to 100 %", not 0.01 <= extinction <= 1.0),
        ("heat must be 3000 to 20000 Btu/lb; check the units", not _plausible_heats(heats)),
    ):
        if wrong:
            raise FireModelError(f"{where}: fuel model {fields[0]}: {fault}")
    used = [sav if sav > 0.0 else 1500.0 for sav in savs]
    one, ten, hundred, herb, woody = loads
    return FuelModel(
        name,
        *(one, ten, hundred, herb, woody),
        sav_1h=used[0],
        depth_ft=depth_ft,
        extinction_moisture=extinction,
        sav_herb=used[1],
        sav_woody=used[2],
        heat_btu_lb=heats[0],
        dynamic=dynamic,
        heat_live_btu_lb=None if heats[1] == heats[0] else heats[1],
    )


def _has_implausible_sav(loads: list[float], savs: list[float]) -> bool:
    """Return True if a class with a load (1 h, herbaceous, woody) has an implausible SAV."""
    pairs = zip((loads[0], loads[3], loads[4]), savs, strict=True)
    return any(load > 0.0 and not 10.0 <= sav <= 10_000.0 for load, sav in pairs)


def _plausible_heats(heats: list[float]) -> bool:
    return all(3000.0 <= heat <= 20_000.0 for heat in heats)


def with_rate_factors(fuels: Mapping[int, FuelModel], path: Path) -> dict[int, FuelModel]:
    """Return the fuel models in an .adj file, with their spread rate factors.

    Each line of the file contains a fuel code and a factor. ``fuels`` are all burnable fuel models.
    Raises FireModelError for an unknown code, a code that occurs twice in the file, a factor that
    is not from 0 to 100, or a file without factors; the message names file and line.
    """
    found: dict[int, FuelModel] = {}
    codes: set[int] = set()
    for line, fields in rows_of(path):
        where = f"{path} line {line}"
        if len(fields) < 2:
            raise FireModelError(
                f"{where}: must contain a fuel code and a factor of the spread rate"
            )
        code = _code(where, fields[0])
        if code in codes:
            raise FireModelError(
                f"{where}: fuel code {code} occurs twice in the file; remove one of the lines"
            )
        codes.add(code)
        factor = number(where, "the factor", fields[1], 0.0, 100.0)
        if code in fuels:
            found[code] = replace(fuels[code], rate_factor=factor)
        elif code not in NON_BURNABLE:
            raise FireModelError(
                f"{where}: fuel code {code} is unknown; remove the line, or describe the fuel in a "
                ".fmd file (landscape.custom_fuels)"
            )
    if not codes:
        raise FireModelError(
            f"{path}: contains no factor; add a line with a fuel code and a factor"
        )
    return found


def moistures_in(path: Path, rows: Iterator[tuple[int, list[str]]]) -> dict[int, Moisture]:
    """Return the moistures (fractions) of each code in the rows of an .fms file (``rows_of``)."""
    found: dict[int, Moisture] = {}
    for line, fields in rows:
        where = f"{path} line {line}"
        if not 6 <= len(fields) <= 7:
            raise FireModelError(
                f"{where}: {len(fields)} fields; required are a fuel code and the moistures of "
                "1-h, 10-h, 100-h, live herbaceous and live woody fuel"
            )
        code = _code(where, fields[0], least=0)
        if code in found:
            raise FireModelError(
                f"{where}: fuel code {code} occurs twice in the file; remove one of the lines"
            )
        pct = [number(where, "a moisture", text, 0.5, MAX_PCT) for text in fields[1:6]]
        found[code] = Moisture(*(value / 100.0 for value in pct))
    if not found:
        raise FireModelError(f"{path}: contains no moistures; add a line with fuel code 0")
    return found


def rows_of(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the number and the fields of each line of a text file; ``#`` starts a comment.

    Fields are separated by spaces, tabs or commas. Raises FireModelError for an unreadable file.
    """
    for line, text in enumerate(text_of(path).splitlines(), 1):
        fields = text.partition("#")[0].replace(",", " ").split()
        if fields:
            yield line, fields


def text_of(path: Path) -> str:
    """Return the text of a file. Raises FireModelError if the file cannot be read as UTF-8."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise FireModelError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise FireModelError(f"{path}: is not text in UTF-8; save it in UTF-8") from None


def number(where: str, name: str, text: str, least: float, most: float) -> float:
    """Return the number in a field.

    Raises FireModelError for other text and for a number outside the limits.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not least <= value <= most:
        raise FireModelError(
            f"{where}: {name} is {text!r}; it must be a number from {least:g} to {most:g}"
        )
    return value


def _code(where: str, text: str, least: int = 1) -> int:
    if not text.isascii() or not text.isdigit() or not least <= int(text) <= MAX_CODE:
        raise FireModelError(
            f"{where}: fuel code {text!r} must be a whole number from {least} to {MAX_CODE}"
        )
    return int(text)
