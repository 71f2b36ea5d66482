"""Define the layers of a fire: description, unit, and classes with colours and labels.

GeoTIFFs, NetCDF files, QGIS styles and maps all use these layers. The colours of an ordered layer
become darker from class to class, so that their order is visible without colour vision.
"""

import math
from bisect import bisect_left
from collections.abc import Sequence
from datetime import datetime, timedelta
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.physics.fuels import FUEL_MODELS, NON_BURNABLE
from firemodel.spread.fire_scheme import Fire

MAX_ARRIVAL_CLASSES = 12
SHORT_FIRE_S = 3 * 3600.0  # a shorter fire has classes shorter than an hour
ARRIVAL_STEPS_MIN = (1, 2, 5, 10, 15, 30, 60, 120, 180, 360, 720)  # longer classes are whole days
CHAIN_PER_H_M_S = 20.1168 / 3600.0
KW_M_PER_BTU_FT_S = 3.4592


class ColourClass(NamedTuple):
    """A class of values, with its colour (#rrggbb).

    ``upto`` is the value of a code, or the upper limit of a range. A range begins at the limit of
    the previous class.
    """

    upto: float
    colour: str
    label: str

    @property
    def rgb(self) -> tuple[int, int, int]:
        """The colour as red, green and blue from 0 to 255."""
        return rgb_of(self.colour)


class FuelGroup(NamedTuple):
    """A group of similar fuels; ``colour`` (#rrggbb) is that of the first code."""

    name: str
    codes: tuple[int, ...]
    colour: str


class Layer(NamedTuple):
    """The meaning of a raster's values, and the classes in which they are drawn.

    ``unit`` is spelt as in UDUNITS; it is "1" for a fraction and "" for codes. The classes of codes
    are single values (``categorical``). Other classes are ranges, and the last one has no upper
    limit.
    """

    description: str
    unit: str
    classes: tuple[ColourClass, ...]
    categorical: bool = False


def rgb_of(colour: str) -> tuple[int, int, int]:
    """Convert #rrggbb to red, green and blue from 0 to 255."""
    red, green, blue = (int(colour[place : place + 2], 16) for place in (1, 3, 5))
    return red, green, blue


def class_of(layer: Layer, value: float) -> int:
    """Return the index of the range to which a value belongs."""
    return min(bisect_left([each.upto for each in layer.classes], value), len(layer.classes) - 1)


def shades(count: int) -> list[str]:
    """Return ``count`` colours (#rrggbb) from light yellow to dark red."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    scale = colormaps["YlOrRd"]
    return [to_hex(scale(0.15 + 0.75 * number / max(count - 1, 1))) for number in range(count)]


def ranges(limits: Sequence[float], labels: Sequence[str]) -> tuple[ColourClass, ...]:
    """Return one class up to each of the limits, and one class above the last limit."""
    bounds = [*limits, math.inf]
    return tuple(map(ColourClass, bounds, shades(len(bounds)), labels))


def after_zero(time_zero: datetime | None) -> str:
    """Return a text that describes the origin of times in seconds."""
    if time_zero is None:
        return "seconds after mission time 0, which has no calendar date"
    return f"seconds after mission time 0, {time_zero.isoformat(timespec='seconds')}"


def arrival_layer(
    first_s: float, last_s: float, time_zero: datetime | None, what: str = "time of arrival of fire"
) -> Layer:
    """Return the arrival time layer, with classes of one hour or another round step.

    Args:
        first_s, last_s: The earliest and the latest time in the raster, in seconds.
        time_zero: The calendar time of 0 s, if there is one; labels then contain calendar times.
        what: The name of the quantity, for the description.
    """
    span_s = last_s - first_s
    days = (1440 * number for number in range(1, math.ceil(max(span_s, 0.0) / 86400.0) + 2))
    shortest_s = 3600.0 if span_s >= SHORT_FIRE_S else 0.0
    step_s = next(
        60.0 * step
        for step in (*ARRIVAL_STEPS_MIN, *days)
        if 60.0 * step >= shortest_s and span_s <= (MAX_ARRIVAL_CLASSES - 1) * 60.0 * step
    )
    first, last = math.floor(first_s / step_s), math.ceil(last_s / step_s)
    limits = [number * step_s for number in range(first + 1, max(last, first + 1) + 1)]
    labels = [_span(limit - step_s, limit, time_zero) for limit in limits]
    classes = tuple(map(ColourClass, limits, shades(len(limits)), labels))
    return Layer(f"{what}, {after_zero(time_zero)}", "s", classes)


def arrival_layer_of(fire: Fire, time_zero: datetime | None) -> Layer:
    """Return the layer of a fire's arrival times, up to the fire's current time."""
    first_s = float(fire.arrival_time_s.min())
    return arrival_layer(min(first_s, fire.time_s), fire.time_s, time_zero)


def _span(from_s: float, to_s: float, time_zero: datetime | None) -> str:
    unit_s, unit = (3600.0, "h") if from_s % 3600.0 == to_s % 3600.0 == 0.0 else (60.0, "min")
    label = f"{from_s / unit_s:g}–{to_s / unit_s:g} {unit}"
    if time_zero is None:
        return label
    return f"{label}, to {time_zero + timedelta(seconds=to_s):%Y-%m-%d %H:%M}"


def fuel_groups(codes: NDArray[np.integer]) -> list[FuelGroup]:
    """Return the groups of burnable codes; custom codes in the array form an additional group."""
    standard = {*FUEL_MODELS, *NON_BURNABLE}
    custom = tuple(code for code in np.unique(codes).tolist() if code not in standard)
    return [*FUEL_GROUPS, *([FuelGroup("custom fuel", custom, "#e8b3cf")] if custom else [])]


def fuel_layer(codes: NDArray[np.integer]) -> Layer:
    """Return the fuel code layer: a hue for each group, darker for higher codes.

    Args:
        codes: An array of fuel codes. Non-standard codes denote custom fuel models.
    """
    classes = [
        ColourClass(
            code,
            _darker(group.colour, number / len(group.codes)),
            FUEL_MODELS[code].name if code in FUEL_MODELS else group.name,
        )
        for group in fuel_groups(codes)
        for number, code in enumerate(group.codes)
    ]
    classes += [
        ColourClass(code, NON_BURNABLE_COLOURS.get(code, "#bdbdbd"), name)
        for code, name in NON_BURNABLE.items()
    ]
    return Layer("fuel model, code", "", tuple(sorted(classes)), categorical=True)


def _darker(colour: str, share: float) -> str:
    return "#" + "".join(f"{round(part * (1.0 - 0.6 * share)):02x}" for part in rgb_of(colour))


FUEL_GROUPS = (
    FuelGroup("grass", (1, 2, 3, *range(101, 110)), "#e9efb5"),
    FuelGroup("grass and shrub", tuple(range(121, 125)), "#d8c98f"),
    FuelGroup("shrub", (4, 5, 6, 7, *range(141, 150)), "#c9a9a0"),
    FuelGroup("timber and understory", tuple(range(161, 166)), "#a8cf9a"),
    FuelGroup("timber litter", (8, 9, 10, *range(181, 190)), "#8fc4bd"),
    FuelGroup("slash and blowdown", (11, 12, 13, *range(201, 205)), "#c3b1dc"),
)
NON_BURNABLE_COLOURS = {91: "#737373", 92: "#ffffff", 93: "#e6e6c8", 98: "#6baed6", 99: "#d9d9d9"}

STATE_LAYER = Layer(
    "state of the cell: 0 unburned, 1 burning, 2 burned, 3 cannot burn",
    "",
    (
        ColourClass(0, "#e5f5e0", "unburned"),
        ColourClass(1, "#d7301f", "burning"),
        ColourClass(2, "#404040", "burned"),
        ColourClass(3, "#9ecae1", "cannot burn"),
    ),
    categorical=True,
)
# Adjective classes of Scott & Burgan 2005 (RMRS-GTR-153), in chains per hour.
SPREAD_RATE_LAYER = Layer(
    "spread rate of the front at its arrival, along the slope",
    "m s-1",
    ranges(
        [limit * CHAIN_PER_H_M_S for limit in (2, 5, 20, 50, 150)],
        (
            "up to 0.7 m/min (2 ch/h): very low",
            "0.7–1.7 m/min (5 ch/h): low",
            "1.7–6.7 m/min (20 ch/h): moderate",
            "6.7–17 m/min (50 ch/h): high",
            "17–50 m/min (150 ch/h): very high",
            "above 50 m/min (150 ch/h): extreme",
        ),
    ),
)
# The fire characteristics chart of Andrews & Rothermel 1982 (INT-131): 4, 8 and 11 ft, and 100,
# 500 and 1000 Btu/ft/s.
FLAME_LENGTH_LAYER = Layer(
    "flame length of the front at its arrival (Byram 1959)",
    "m",
    ranges(
        (1.2, 2.4, 3.4),
        (
            "up to 1.2 m (4 ft): hand tools can attack",
            "1.2–2.4 m (8 ft): equipment can attack",
            "2.4–3.4 m (11 ft): attack at the head probably fails",
            "above 3.4 m (11 ft): crowning, spotting, major runs",
        ),
    ),
)
INTENSITY_LAYER = Layer(
    "fireline intensity of the front at its arrival (Byram 1959)",
    "kW m-1",
    ranges(
        [limit * KW_M_PER_BTU_FT_S for limit in (100, 500, 1000)],
        (
            "up to 346 kW/m (100 Btu/ft/s)",
            "346–1,730 kW/m (500 Btu/ft/s)",
            "1,730–3,459 kW/m (1,000 Btu/ft/s)",
            "above 3,459 kW/m (1,000 Btu/ft/s)",
        ),
    ),
)
_SECTORS = ("north", "north-east", "east", "south-east", "south", "south-west", "west")
# A cycle of colours: similar directions have similar colours, opposite directions do not.
_CYCLE = ("#cfc7d6", "#8fb3c8", "#6276ba", "#5b2f8f", "#2f1436", "#7a2250", "#b25652", "#c9a68d")
_DIRECTIONS = tuple(
    ColourClass(bound, colour, label)
    for bound, colour, label in zip(
        (*(22.5 + 45.0 * number for number in range(8)), math.inf),
        (*_CYCLE, _CYCLE[0]),
        (*_SECTORS, "north-west", "north"),
        strict=True,
    )
)
SPREAD_TOWARD_LAYER = Layer(
    "direction in which the front moved at its arrival, clockwise from true north",
    "degree",
    _DIRECTIONS,
)
WIND_FROM_LAYER = Layer(
    "direction from which the wind blows, clockwise from true north", "degree", _DIRECTIONS
)
_WIND_LIMITS_M_S = (1, 2, 4, 6, 8, 10, 15, 20)
WIND_SPEED_LAYER = Layer(
    "wind speed 6.1 m (20 ft) above the vegetation",
    "m s-1",
    ranges(
        _WIND_LIMITS_M_S,
        (
            "up to 1 m/s",
            *(f"{low}–{high} m/s" for low, high in pairwise(_WIND_LIMITS_M_S)),
            "above 20 m/s",
        ),
    ),
)
CROWN_FRACTION_LAYER = Layer(
    "fraction of the canopy fuel that burned (crown fraction burned)",
    "1",
    ranges(
        [0.0, 0.1, 0.5, 0.9],
        ("surface fire", "up to 10 %", "10–50 %", "50–90 %", "above 90 %"),
    ),
)
_WINDS = ranges(
    [0.0, 3.0, 6.0, 9.0, 12.0, 18.0],
    ("calm", "up to 3 m/s", "3–6 m/s", "6–9 m/s", "9–12 m/s", "12–18 m/s", "above 18 m/s"),
)
TORCHING_WIND_LAYER = Layer(
    "torching index: lowest wind speed at 20 ft (6.1 m) at which the surface fire ignites crowns",
    "m s-1",
    _WINDS,
)
CROWNING_WIND_LAYER = Layer(
    "crowning index: lowest wind speed at 20 ft (6.1 m) at which a crown fire is active",
    "m s-1",
    _WINDS,
)
WARM_HEIGHT_LAYER = Layer(
    "height above the ground up to which the front warms the air by more than the limit",
    "m",
    ranges(
        (20.0, 50.0, 100.0, 150.0, 300.0),
        ("up to 20 m", "20–50 m", "50–100 m", "100–150 m", "150–300 m", "above 300 m"),
    ),
)
PROBABILITY_LAYER = Layer(
    "fraction of the simulated fires in which the cell burns",
    "1",
    ranges(
        [number / 10 for number in range(1, 10)],
        [f"{10 * number}–{10 * number + 10} %" for number in range(10)],
    ),
)
