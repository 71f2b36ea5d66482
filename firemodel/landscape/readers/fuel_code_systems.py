"""Recognise fuel codes of systems other than those of Anderson and Scott & Burgan.

Some systems use the same numbers for other fuels: code 1 is spruce-lichen woodland in the Canadian
system, but short grass in Anderson's. A raster with codes of another system can be recognised by
its other codes, or by a Cell2Fire lookup table in the same folder.
"""

import csv
import re
from collections.abc import Collection, Mapping
from pathlib import Path

from firemodel.physics.fuels import NON_BURNABLE, FuelModel

NO_FUEL = 0  # FARSITE's code for ground without fuel
# The codes of each system, in the order in which they are tried.
SYSTEMS = {
    "Canadian FBP": {
        *(1, 2, 3, 4, 5, 6, 7, 11, 12, 13, 21, 22, 23, 31, 32, 40, 50, 60, 70, 80, 90),
        *range(100, 106),
        *(code for code in range(405, 1000, 5) if code % 100),
    },
    "Kitral (Chile)": {*range(1, 32)},
    "Portuguese (ICNF)": {*range(98, 100), *range(211, 215), *range(221, 228), *range(231, 238)},
    "CORINE land cover": {
        *(111, 112, 121, 122, 123, 124, 131, 132, 133, 141, 142, 211, 212, 213, 221, 222, 223),
        *(231, 241, 242, 243, 244, 311, 312, 313, 321, 322, 323, 324, 331, 332, 333, 334, 335),
        *(411, 412, 421, 422, 423, 511, 512, 521, 522, 523),
    },
    "European (FirEUrisk)": {
        *(1111, 1112, 1121, 1122, 1211, 1212, 1221, 1222, 1301, 1302),
        *(21, 22, 23, 31, 32, 33, 41, 42, 51, 52, 53, 61, 62, 7),
    },
    "Australian (AFDRS)": {*range(3001, 3100)},
}
# The first part of a Cell2Fire lookup table's name, and the system of its codes.
TABLES = {
    "fbp": "Canadian FBP",
    "kitral": "Kitral (Chile)",
    "portugal": "Portuguese (ICNF)",
}
CUSTOM = range(14, 90)  # FARSITE's recommended range of custom codes
ADVICE = (
    "translate each code into one of Anderson or Scott & Burgan (landscape.fuel_codes, as in "
    "fuel_codes = {21 = 1}), or describe the fuels in a .fmd file (landscape.custom_fuels)"
)


def renamed_code(path: Path, codes: Collection[int], fuels: Mapping[int, FuelModel]) -> str:
    """Return text about the first code that means another fuel in a table in the raster's folder.

    ``codes`` are the codes in the raster, ``fuels`` the fuel models of this run. The text is empty
    if no table contradicts the models.
    """
    for table in sorted(path.parent.glob("*_lookup_table.csv")):
        system = TABLES.get(table.name.split("_")[0].lower(), table.name)
        for code, name in sorted(names_in(table).items()):
            if code in codes and code in fuels and not _same_fuel(code, name, fuels[code]):
                return (
                    f"{path}: {table.name} in the same folder uses fuel codes of the system "
                    f"{system}, in which code {code} is {name}, not {fuels[code].name}; {ADVICE}"
                )
    return ""


def advice_on(codes: Collection[int], fuels: Mapping[int, FuelModel]) -> str:
    """Return the remedy for unknown codes, with the name of their system if it is recognised."""
    judged = {*codes} - {*NON_BURNABLE, NO_FUEL}
    unknown = judged - {*fuels}
    for system, known in SYSTEMS.items():
        if judged <= known:
            return f"these codes belong to the system {system}: {ADVICE}"
    if all(code in CUSTOM for code in unknown):
        return "14-89 are custom fuels: describe them in a .fmd file (landscape.custom_fuels)"
    return f"if a code means no data, declare it as nodata; otherwise {ADVICE}"


def names_in(table: Path) -> dict[int, str]:
    """Return the fuel type of each code in a Cell2Fire lookup table; empty for other files."""
    try:
        rows = list(csv.DictReader(table.read_text(encoding="utf-8-sig").splitlines()))
        return {int(row["grid_value"]): row[_column_of_types(row)].strip() for row in rows}
    except (OSError, ValueError, LookupError, AttributeError, StopIteration, csv.Error):
        return {}


def _column_of_types(row: Mapping[str, str]) -> str:
    return next(name for name in row if name and name.strip() == "fuel_type")


def _same_fuel(code: int, name: str, fuel: FuelModel) -> bool:
    """Return True if a name such as GR1, FM1, NFFL 1 or 1 denotes this fuel model."""
    plain = re.sub(r"\W", "", name).upper()
    return plain == fuel.name.split()[0].upper() or bool(
        re.fullmatch(rf"(FM|NFFL|FBFM|ANDERSON)?0*{code}", plain)
    )
