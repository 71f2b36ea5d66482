"""Generate random fires, and models with wrong settings, for the study of Beachly's section VII.

The truth is a fire simulated by the cellular model, with patches of different fuels, random
moistures and varying wind. The model to be corrected has the true ignitions, but one fuel, one wind
and one moisture everywhere. Coordinates are in metres, in the CRS of the landscape. The unit is a
square. Fire also burns outside the unit, but only the fire inside is evaluated.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from firemodel.ellipses.ellipse import EllipseFire, Spread, spreads_of
from firemodel.ellipses.line_ignitions import line_sources
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.anyangle import AnyAngleFire

Floats = NDArray[np.float64]

CELL_M = 5.0
UNIT_M = 340.0  # width of the paper's unit
MARGIN_M = 80.0  # width of the burnable ground around the unit
CELLS = round((UNIT_M + 2.0 * MARGIN_M) / CELL_M)
WEST_M, NORTH_M = 5e5, 4.5e6
MINUTE_S = 60.0
END_S = 80.0 * MINUTE_S
LIT_SPACING_M = 5.0
FUELS = (1, 2, 3, 5, 6, 8, 9, 101, 102, 104, 121, 122, 161, 183, 186, 188)
GUST_S = 240.0  # interval between weather entries
# Standard deviations of the errors in the model's settings (for speed and rate, of the logarithm).
# With these values the front error without corrections is about the paper's 24.8 m.
WRONG_SPEED, WRONG_DEG, WRONG_RATE = 0.5, 45.0, 0.7
MIN_BURNED, MAX_EARLY, MAX_BURNED = 0.55, 0.35, 0.97  # fractions of the unit, see ``random_burn``
MAX_UNEVEN = 4.0  # maximum ratio of the spread rates of the fastest and the slowest fuel
EARLY_S = 15.0 * MINUTE_S


@dataclass(frozen=True)
class Burn:
    """A true burn with arrival times ``arrival_s`` (y, x), and its model with wrong settings."""

    seed: int
    landscape: Landscape
    arrival_s: Floats
    model: EllipseFire


def unit_box() -> tuple[float, float, float, float]:
    """Return west, south, east and north of the unit in metres."""
    return (
        WEST_M + MARGIN_M,
        NORTH_M - MARGIN_M - UNIT_M,
        WEST_M + MARGIN_M + UNIT_M,
        NORTH_M - MARGIN_M,
    )


def random_burn(seed: int) -> Burn:
    """Return the burn for a seed.

    Random fires are simulated until one is found that is small after 15 minutes and has burned most
    but not all of the unit after 80 minutes. The result is the same on every machine.
    """
    rng = np.random.default_rng(seed)
    inner = slice(round(MARGIN_M / CELL_M), CELLS - round(MARGIN_M / CELL_M))
    while True:
        fuels = rng.choice(FUELS, size=int(rng.integers(2, 5)), replace=False)
        weather = _weather(rng)
        rates = [spreads_of(int(code), weather)[0].head_m_s for code in fuels]
        if max(rates) > MAX_UNEVEN * min(rates):
            continue
        landscape = _landscape(rng, fuels)
        lit = _lit(rng, weather.entries[0].wind_from_deg)
        fire = AnyAngleFire(landscape, weather, _ignitions(landscape, lit))
        fire.advance(END_S)
        inside = fire.arrival_time_s[inner, inner]
        early, late = (float((inside <= at_s).mean()) for at_s in (EARLY_S, END_S))
        if early <= MAX_EARLY and MIN_BURNED <= late <= MAX_BURNED:
            fire.advance(2.0 * END_S)
            model = EllipseFire(_misset(rng, fuels, weather, landscape), lit)
            return Burn(seed, landscape, fire.arrival_time_s.copy(), model)


def _landscape(rng: np.random.Generator, fuels: NDArray[np.int64]) -> Landscape:
    """Return random fuels in patches of 30 to 80 m, with per-cell noise, on rolling ground."""
    patch_cells = rng.uniform(30.0, 80.0) / CELL_M / 2.0
    rough = gaussian_filter(rng.standard_normal((CELLS, CELLS)), patch_cells)
    rough += 0.3 * rough.std() * rng.standard_normal((CELLS, CELLS))
    share = np.argsort(np.argsort(rough, axis=None)).reshape(rough.shape) / rough.size
    fuel = fuels[np.minimum((share * fuels.size).astype(int), fuels.size - 1)].astype(np.int16)
    hills = gaussian_filter(rng.standard_normal((CELLS, CELLS)), 100.0 / CELL_M / 2.0)
    height_m = 400.0 + hills / np.abs(hills).max() * rng.uniform(0.0, 8.0)
    return Landscape("EPSG:32614", WEST_M, NORTH_M, CELL_M, fuel, height_m.astype(np.float32))


def _weather(rng: np.random.Generator) -> WeatherStream:
    """Return random weather: wind that varies around its mean, and constant moistures."""
    speed_m_s, from_deg = rng.uniform(1.0, 5.0), rng.uniform(0.0, 360.0)
    dead_pct, live_pct = rng.uniform(6.0, 14.0), rng.uniform(60.0, 120.0)
    entries = []
    speed, turn_deg = 0.0, 0.0
    for at_s in np.arange(0.0, 2.0 * END_S, GUST_S):
        speed = 0.7 * speed + 0.25 * rng.standard_normal()
        turn_deg = 0.8 * turn_deg + 10.0 * rng.standard_normal()
        wind = (speed_m_s * math.exp(speed), from_deg + turn_deg)
        entries.append(_entry(float(at_s), *wind, dead_pct, live_pct))
    return WeatherStream(entries)


def _entry(
    at_s: float, speed_m_s: float, from_deg: float, dead_pct: float, live_pct: float
) -> Weather:
    dead = (dead_pct, dead_pct + 1.0, dead_pct + 2.0)
    return Weather(at_s, min(speed_m_s, 10.0), from_deg % 360.0, *dead, live_pct, live_pct)


def _lit(rng: np.random.Generator, from_deg: float) -> Floats:
    """Return random sources (n, 3): first a line along a side, then one to three lines or spots."""
    west, south, east, north = unit_box()
    middle = np.array([(west + east) / 2.0, (south + north) / 2.0])
    # The first line is across the wind on the downwind side, as in a burn; the other sources lie
    # anywhere.
    toward = math.radians(90.0 - (from_deg + 180.0)) + rng.uniform(-0.6, 0.6)
    along = np.array([-math.sin(toward), math.cos(toward)])
    ahead = np.array([math.cos(toward), math.sin(toward)])
    half_m = rng.uniform(60.0, 120.0)
    found = []
    for number in range(int(rng.integers(2, 5))):
        offset_m = rng.uniform(-60.0, 140.0) if number else rng.uniform(90.0, 140.0)
        at = middle + offset_m * ahead + rng.uniform(-60.0, 60.0) * along
        length_m = half_m if number == 0 or rng.random() < 0.5 else 1.0
        ends = np.clip(
            [at - length_m * along, at + length_m * along],
            (west + 5.0, south + 5.0),
            (east - 5.0, north - 5.0),
        )
        at_s = 0.0 if number == 0 else float(rng.uniform(0.0, 35.0) * MINUTE_S)
        found.append(line_sources(ends, at_s, LIT_SPACING_M))
    return np.concatenate(found)


def _ignitions(landscape: Landscape, lit: Floats) -> list[tuple[int, int, float]]:
    row, col = landscape.row_col_of(lit[:, 0], lit[:, 1])
    return [(round(r), round(c), float(t)) for r, c, t in zip(row, col, lit[:, 2], strict=True)]


def _misset(
    rng: np.random.Generator, fuels: NDArray[np.int64], weather: WeatherStream, landscape: Landscape
) -> tuple[Spread, ...]:
    """Return one spread for all cells: the median fuel's spread, with errors in wind and rate.

    The standard deviations are ``WRONG_SPEED``, ``WRONG_DEG`` and ``WRONG_RATE``.
    """
    given = weather.entries[0]
    wrong = _entry(
        0.0,
        given.wind_speed_m_s * math.exp(WRONG_SPEED * rng.standard_normal()),
        given.wind_from_deg + WRONG_DEG * rng.standard_normal(),
        given.dead_1h_pct,
        given.live_herb_pct,
    )
    stream = WeatherStream([wrong])
    choice = sorted(
        (spreads_of(int(code), stream, landscape.grid_deg)[0] for code in fuels),
        key=lambda spread: spread.head_m_s,
    )
    found = choice[len(choice) // 2]
    factor = math.exp(WRONG_RATE * rng.standard_normal())
    rates = ("head_m_s", "back_m_s", "flank_m_s")
    return (found._replace(**{name: getattr(found, name) * factor for name in rates}),)
