"""The three fires on which the rules of a team are judged: uneven, even, wind turning.

Chosen by what is in them, not by how a planner fares: what the papers' fires have (two fuels and
changing weather; no unevenness; wind that turns by 180° half-way), on 200 x 200 cells of 30 m,
none of them reaching an edge, four hours flown at 20 m/s, a lap taking one to ten minutes.
"""

from firemodel.physics.weather import WeatherStream
from mission_service.experiments.fires import (
    BRUSH,
    HOUR_S,
    SHORT_GRASS,
    Burn,
    burn,
    flat,
    of_one_fuel,
    of_two_fuels,
    wind,
)

SPEED_M_S = 20.0
TALL_GRASS = 3


def uneven() -> Burn:
    """Brush in the north, grass in the south, wind that freshens, veers and drops again."""
    weather = WeatherStream(
        (wind(0.0, 4.0, 30.0), wind(2.0 * HOUR_S, 6.0, 60.0), wind(3.5 * HOUR_S, 3.0, 20.0))
    )
    land = flat(of_two_fuels(BRUSH, SHORT_GRASS))
    return burn("uneven", "anyangle", land, weather, (75, 150), 5.0 * HOUR_S, SPEED_M_S)


def even() -> Burn:
    """Tall grass under a breath of wind; the vehicles come when it is large enough for six."""
    weather = WeatherStream((wind(0.0, 0.5, 0.0),))
    land = flat(of_one_fuel(TALL_GRASS))
    return burn(
        "even", "anyangle", land, weather, (100, 100), 6.0 * HOUR_S, SPEED_M_S, 2.0 * HOUR_S
    )


def wind_turning() -> Burn:
    """Short grass, the wind turning from north to south after three hours."""
    weather = WeatherStream((wind(0.0, 3.0, 0.0), wind(3.0 * HOUR_S, 3.0, 180.0)))
    land = flat(of_one_fuel(SHORT_GRASS))
    return burn("wind turning", "anyangle", land, weather, (85, 100), 5.0 * HOUR_S, SPEED_M_S)


def team_fires() -> list[Burn]:
    """All three."""
    return [uneven(), even(), wind_turning()]
