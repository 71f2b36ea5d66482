"""Create the landscape, the weather and the fire of a scenario."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from firemodel.ensemble.uncertainty import UNMEASURED, Uncertainty
from firemodel.errors import FireModelError
from firemodel.input_warnings import FireInputs, input_warnings, time_zero_warnings
from firemodel.landscape.default import jacksboro
from firemodel.landscape.flat import flat_landscape
from firemodel.landscape.gridded_wind import from_grid_north, with_wind_stack
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.rasterise import burnable_cells, with_barriers
from firemodel.physics.fuels import FUEL_MODELS, FuelModel
from firemodel.physics.rothermel import Moisture
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.physics.wind_field import WindGrids
from firemodel.simulate import cells_of_file
from firemodel.spread.fire_scheme import (
    BURNING,
    Burning,
    Closing,
    Fire,
    check_burning,
    check_ignitions,
)
from firemodel.spread.fire_scheme import Ignition as CellIgnition
from firemodel.spread.schemes import ACCELERATION, SCHEMES, new_fire
from mission_service.config.fire_sections import (
    FuelMoisture,
    Ignition,
    LandscapeSection,
    WeatherFile,
)
from mission_service.config.input_files import input_files
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.config.wind_section import WindGridsSection
from mission_service.errors import ScenarioError

WEATHER_TABLES = {"time_zero", "duration_s", "landscape", "weather", "weather_file"}
WEATHER_TABLES |= {"wind_grids", "terrain_wind"}
TERRAIN_TABLES = {"landscape", "terrain_wind"}
STALLED = 100  # updates without growth before a check for burning cells


def landscape_of(scenario: Scenario) -> Landscape:
    """Return the landscape of a scenario, with its barriers."""
    return landscape_in(scenario.landscape)


def landscape_in(section: LandscapeSection) -> Landscape:
    """Return the landscape described by a table [landscape], with its barriers."""
    if section.source == "jacksboro":
        found = jacksboro(section.rows, section.cols, section.cell_size_m)
    elif section.source == "flat":
        assert section.lat_deg is not None
        assert section.lon_deg is not None
        grid = (section.rows, section.cols, section.cell_size_m)
        place = (section.lat_deg, section.lon_deg)
        found = flat_landscape(*grid, *place, section.elevation_m, section.fuel_model)
    else:
        found = _from_rasters(section)
    if section.barriers:
        from firemodel.landscape.readers.shapes import read_shapes

        shapes = [shape for path in section.barriers for shape in read_shapes(path, found)]
        found = with_barriers(found, shapes)
    return found


def home_of(section: VehicleSection, landscape: Landscape) -> tuple[float, float, float]:
    """Return lat_deg, lon_deg and altitude_amsl_m of a vehicle's home on the ground."""
    place = (section.home_lat_deg, section.home_lon_deg)
    return *place, float(landscape.elevation_at(*landscape.xy_of_lat_lon(*place)))


def _from_rasters(section: LandscapeSection) -> Landscape:
    from firemodel.landscape.readers.rasters import read_landscape

    files: Path | dict[str, Path] | dict[str, tuple[Path, int]] = section.layers
    if section.file is not None:
        files = section.file
        if section.bands:
            files = {layer: (section.file, band) for layer, band in section.bands.items()}
    return read_landscape(
        files,
        units=section.units,
        missing=section.missing,
        crs=section.crs,
        nodata=section.nodata,
        fuel_codes=section.fuel_codes,
        custom_fuels=custom_fuels_of(section),
    )


def custom_fuels_of(section: LandscapeSection) -> dict[int, FuelModel]:
    """Return the fuel models of a scenario's .fmd and .adj files, by code."""
    from firemodel.landscape.readers.fuel_files import read_fuels, with_rate_factors

    found = {} if section.custom_fuels is None else read_fuels(section.custom_fuels)
    if section.rate_factors is not None:
        found |= with_rate_factors(FUEL_MODELS | found, section.rate_factors)
    return found


def weather_of(scenario: Scenario) -> WeatherStream:
    """Return the weather of a scenario, from its entries or its weather file, and its wind.

    The weather of a scenario with wind grids, wind over terrain, moisture zones or wind directions
    from grid north is computed once, and again if the files change.
    """
    file = scenario.weather_file
    if (
        scenario.wind_grids is None
        and scenario.terrain_wind is None
        and (file is None or (file.dead_fuel_model != "nelson" and file.north == "true"))
    ):
        return _weather(scenario)
    return _stored(_CacheKey(scenario, WEATHER_TABLES))


class _CacheKey:
    """A scenario as a cache key: equal if the tables and their files are unchanged."""

    def __init__(self, scenario: Scenario, tables: set[str]) -> None:
        self.scenario = scenario
        found = (path.stat() for path in input_files(scenario, tables) if path.exists())
        stamps = tuple((file.st_mtime_ns, file.st_size) for file in found)
        self._key = scenario.model_dump_json(include=tables), stamps

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _CacheKey) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


@lru_cache(maxsize=2)
def _stored(inputs: _CacheKey) -> WeatherStream:
    return _weather(inputs.scenario)


@lru_cache(maxsize=2)
def _terrain(inputs: _CacheKey) -> WindGrids:
    from firemodel.wind import responses_of

    landscape = landscape_of(inputs.scenario)
    with ThreadPoolExecutor(2) as threads:  # the kernels release the GIL
        return responses_of(landscape, station_of(inputs.scenario, landscape), threads.map)


def station_of(scenario: Scenario, landscape: Landscape) -> tuple[int, int] | None:
    """Return the cell of the station in [terrain_wind], or None without a station.

    Raises ScenarioError for a station outside the landscape.
    """
    section = scenario.terrain_wind
    place = None if section is None else section.station
    if place is None:
        return None
    x_m, y_m = landscape.xy_of_lat_lon(*place)
    if not landscape.contains(x_m, y_m):
        raise ScenarioError(
            f"terrain_wind: the station at lat {place[0]}, lon {place[1]} is outside the landscape"
        )
    row, col = landscape.row_col_of(x_m, y_m)
    return round(float(row)), round(float(col))


def _weather(scenario: Scenario) -> WeatherStream:
    if scenario.weather_file is not None:
        found = _from_file(scenario.weather_file, scenario)
    else:
        found = WeatherStream(tuple(Weather(**entry.model_dump()) for entry in scenario.weather))
    if scenario.wind_grids is not None:
        return _in_wind(found, scenario.wind_grids, scenario)
    if scenario.terrain_wind is not None:
        from firemodel.wind import over_terrain

        responses = _terrain(_CacheKey(scenario, TERRAIN_TABLES))
        return over_terrain(found, responses, landscape_of(scenario))
    return found


def _in_wind(
    weather: WeatherStream, section: WindGridsSection, scenario: Scenario
) -> WeatherStream:
    """Return a weather stream with the wind from grids."""
    from firemodel.landscape.readers.wind_files import WindFiles, read_wind

    pairs = tuple((each.speed, each.direction, each.time_given) for each in section.pairs)
    place = section.unit, section.height, section.north, section.crs
    starts = (section.start, weather.source and weather.source.start, scenario.time_zero)
    landscape = landscape_of(scenario)
    stack = read_wind(
        WindFiles(section.path, pairs, section.at_s, *place),
        landscape,
        [start for start in starts if start is not None],
        scenario.duration_s,
    )
    return with_wind_stack(weather, stack, landscape, section.interval_s)


def _from_file(section: WeatherFile, scenario: Scenario) -> WeatherStream:
    from firemodel.landscape.readers.inputs_files import read_fuel_moistures
    from firemodel.landscape.readers.weather_files import read_weather

    moisture = Moisture(*(getattr(section, name) / 100.0 for name in FuelMoisture.model_fields))
    own = read_fuel_moistures(section.fuel_moistures) if section.fuel_moistures else None
    zones = None
    if section.dead_fuel_model == "nelson":
        from firemodel.landscape.zone_moistures import ZoneConditions

        zones = ZoneConditions(landscape_of(scenario), section.station_elevation_m)
    found = read_weather(
        section.path,
        start=section.start,
        moisture=moisture,
        conditioned=section.conditioned,
        zones=zones,
        wind=section.wind,
        fuel_moistures=own,
    )
    return found if section.north == "true" else from_grid_north(found, landscape_of(scenario))


def cells_of_ignition(ignition: Ignition, landscape: Landscape) -> list[tuple[int, int]]:
    """Return the cells (row, column) that a scenario's ignition lights."""
    if ignition.file is not None:
        return cells_of_file(ignition.file, landscape)
    assert ignition.lat_deg is not None
    assert ignition.lon_deg is not None
    return [landscape.cell_of_lat_lon(ignition.lat_deg, ignition.lon_deg)]


def cells_lit(points: Sequence[tuple[float, float]], landscape: Landscape) -> list[tuple[int, int]]:
    """Return the burnable cells (row, column) that a point or line in (lat, lon) touches."""
    places = landscape.xy_of_places(points)
    shape = shapely.Point(places[0]) if len(places) == 1 else shapely.LineString(places)
    return burnable_cells([shape], landscape)


def burning_of(scenario: Scenario, landscape: Landscape) -> Burning | None:
    """Return the initial fire of a scenario; None if it has only ignitions, or if nothing burns."""
    from firemodel.spread.burning import burning_from_arrival, burning_from_perimeter

    section = scenario.fire
    if section.initial_cells is not None:
        return _grown(scenario, landscape, section.initial_cells)
    if section.perimeter is not None:
        from firemodel.landscape.readers.shapes import read_shapes

        shapes = read_shapes(
            section.perimeter,
            landscape,
            repair=section.repair_perimeter,
            feature=section.perimeter_feature,
        )
        _check_polygons(section.perimeter, shapes)
        return burning_from_perimeter(shapes, landscape, section.burning_at_s)
    if section.arrival is not None:
        from firemodel.landscape.readers.rasters import read_arrival

        arrival_s = read_arrival(
            section.arrival, landscape, unit=section.arrival_unit, crs=scenario.landscape.crs
        )
        return burning_from_arrival(arrival_s, landscape, section.burning_at_s)
    return None


def _grown(scenario: Scenario, landscape: Landscape, cells: int) -> Burning:
    """Return an initial fire of at least ``cells`` cells, grown using the probabilistic scheme."""
    from firemodel.spread.burning import burning_from_arrival

    fire = new_fire(
        "probabilistic",
        landscape,
        weather_of(scenario),
        [
            (row, col, 0.0)
            for each in scenario.ignition
            for row, col in cells_of_ignition(each, landscape)
        ],
        p_spread=scenario.fire.p_spread,
        update_s=1.0,
        seed=(scenario.seed, 1),
    )
    before = stalled = 0
    while (burned := int(np.count_nonzero(fire.burned()))) < cells:
        stalled = stalled + 1 if burned == before else 0
        if stalled and stalled % STALLED == 0 and not (fire.state_at(fire.time_s) == BURNING).any():
            raise ScenarioError(
                f"fire.initial_cells = {cells}: no burnable cell is left after {burned} cells; "
                "reduce the number, or move the ignition"
            )
        before = burned
        fire.advance(fire.time_s + 1.0)  # one update of the automaton
    at_s = scenario.fire.burning_at_s
    return burning_from_arrival(np.where(fire.burned(), at_s, np.inf), landscape, at_s)


def _check_polygons(path: Path, shapes: list[BaseGeometry]) -> None:
    for number, shape in enumerate(shapes, start=1):
        kinds = {part.geom_type for part in shapely.get_parts(shapely.get_parts(shape))}
        if kinds != {"Polygon"}:
            raise ScenarioError(
                f"{path}: feature {number} contains {', '.join(sorted(kinds - {'Polygon'}))}; a "
                "perimeter must contain only polygons: remove the other shapes, use them as an "
                "ignition, or convert closed lines to polygons with fire.repair_perimeter = true"
            )


def warnings_on(scenario: Scenario, landscape: Landscape) -> list[str]:
    """Return the warnings about inputs that are valid but probably unintended.

    The warnings concern repaired perimeters, keys of an inputs file that have no effect, and a
    ``time_zero`` whose date differs from that of the weather. The fire model's ``input_warnings``
    are included.
    """
    lines = []
    if scenario.fire.perimeter is not None and scenario.fire.repair_perimeter:
        from firemodel.landscape.readers.shapes import repairs_of

        lines += repairs_of(scenario.fire.perimeter, scenario.fire.perimeter_feature)
    if scenario.weather_file is not None:
        lines += _ignored_in(scenario.weather_file)
    weather = weather_of(scenario)
    inputs = FireInputs(landscape, weather, ignitions_of(scenario, landscape), scenario.duration_s)
    return [*lines, *input_warnings(inputs), *time_zero_warnings(weather, scenario.time_zero)]


def _ignored_in(section: WeatherFile) -> list[str]:
    """Return a line listing the keys of an inputs file that have no effect, if there are any."""
    from firemodel.landscape.readers.inputs_files import is_inputs_file, read_inputs

    if not is_inputs_file(section.path):
        return []
    keys = read_inputs(section.path).ignored()
    return [f"{section.path}: the run ignores {', '.join(keys)}"] if keys else []


def fire_of(scenario: Scenario, landscape: Landscape, weather: WeatherStream | None = None) -> Fire:
    """Return a scenario's fire at its start, in ``weather`` or else in the scenario's weather.

    Raises ScenarioError if nothing burns.
    """
    require_fire(scenario)
    ignitions, burning = ignitions_of(scenario, landscape), burning_of(scenario, landscape)
    stream, settings = weather or weather_of(scenario), settings_of(scenario)
    return _fire(scenario, landscape, stream, ignitions, burning, **settings)


def reported_fire(scenario: Scenario, landscape: Landscape) -> Fire:
    """Return the reported fire, for estimates; it may have no burning cells.

    The fire has no acceleration, because the time of a real ignition is not well known.
    """
    ignitions, burning = ignitions_of(scenario, landscape), burning_of(scenario, landscape)
    settings = _settings_of_estimates(scenario)
    return _fire(scenario, landscape, weather_of(scenario), ignitions, burning, **settings)


def require_fire(scenario: Scenario) -> None:
    """Raise ScenarioError unless the scenario has an ignition, a burn or an initial fire."""
    lit = scenario.ignition or scenario.burn_flown is not None
    if not (lit or scenario.fire.perimeter or scenario.fire.arrival):
        raise ScenarioError(
            f"{scenario.name}: nothing burns: add an ignition, fire.perimeter or fire.arrival"
        )


def check_fire(scenario: Scenario, landscape: Landscape) -> None:
    """Raise the errors that ``reported_fire`` would raise, without loading a spread scheme."""
    burning, at_s = burning_of(scenario, landscape), 0.0
    weather_of(scenario)
    if burning is not None:
        check_burning(burning, landscape)
        at_s = burning.at_s
    check_ignitions(landscape, ignitions_of(scenario, landscape), at_s)
    closings_of(scenario, landscape)
    if scenario.fire.crown != "none":
        from firemodel.spread.crown_spread import canopy_of

        canopy_of(landscape, scenario.fire.foliar_moisture_pct)


def begun_again(
    scenario: Scenario,
    landscape: Landscape,
    burning: Burning | None,
    weather: WeatherStream,
    at_s: float,
) -> Fire:
    """Return the ``reported_fire`` restarted at ``at_s``, with the later ignitions.

    ``burning`` is the state of the fire at that time, or None if nothing has burned.
    """
    later = [each for each in ignitions_of(scenario, landscape) if each[2] > at_s]
    settings = _settings_of_estimates(scenario)
    found = _fire(scenario, landscape, weather, later, burning, **settings)
    found.advance(at_s)
    return found


def ignitions_of(scenario: Scenario, landscape: Landscape) -> list[CellIgnition]:
    """Return the cells ignited in the scenario: row, column, time in s."""
    section = scenario.fire
    ignitions: list[CellIgnition] = [
        (row, col, ignition.at_s)
        for ignition in scenario.ignition
        for row, col in cells_of_ignition(ignition, landscape)
        if section.initial_cells is None  # with ``initial_cells`` they are part of the initial fire
    ]
    if scenario.burn is not None:
        ignitions += [
            (row, col, line.at_s)
            for line in scenario.burn.lit
            for row, col in cells_lit(line.points, landscape)
        ]
    return ignitions


def closings_of(scenario: Scenario, landscape: Landscape) -> list[Closing]:
    """Return the closings of a scenario's control lines."""
    if not scenario.suppression:
        return []
    from firemodel.landscape.readers.shapes import read_shapes
    from firemodel.spread.control_lines import closings_along

    found = []
    for number, each in enumerate(scenario.suppression):
        if each.file is not None:
            lines = read_shapes(each.file, landscape)
        else:
            assert each.points is not None
            lines = [shapely.LineString(landscape.xy_of_places(each.points))]
        try:
            found += closings_along(lines, landscape, each.at_s, each.rate_m_h or math.inf)
        except FireModelError as error:
            raise ScenarioError(f"{scenario.name}: suppression.{number}: {error}") from None
    return found


def _fire(
    scenario: Scenario,
    landscape: Landscape,
    weather: WeatherStream,
    ignitions: list[CellIgnition],
    burning: Burning | None,
    **settings: Any,
) -> Fire:
    name, seed = scenario.fire.scheme, scenario.seed
    closings = closings_of(scenario, landscape)
    return new_fire(
        name, landscape, weather, ignitions, burning, seed=seed, closings=closings, **settings
    )


def _settings_of_estimates(scenario: Scenario) -> dict[str, Any]:
    found = settings_of(scenario)
    found.pop(ACCELERATION, None)
    return found


def settings_of(scenario: Scenario) -> dict[str, Any]:
    """Return the settings of the scenario's spread scheme."""
    return {each: getattr(scenario.fire, each) for each in SCHEMES[scenario.fire.scheme].settings}


def uncertainty_of(scenario: Scenario) -> Uncertainty:
    """Return the standard deviations of the errors in the scenario's table [ensemble]."""
    return Uncertainty(**scenario.ensemble.model_dump())


def estimate_errors(scenario: Scenario) -> Uncertainty:
    """Return the distributions of [ensemble], or ``UNMEASURED`` if that table has only defaults."""
    given = uncertainty_of(scenario)
    return UNMEASURED if given == Uncertainty() else given


def fire_position(scenario: Scenario, landscape: Landscape) -> tuple[float, float]:
    """Return the reported position (x, y) of the fire: its ignition, or a point inside the fire.

    In a burn, the position of the firing boss is returned instead.
    """
    planner, burn = scenario.planner, scenario.burn_flown
    if burn is not None:
        boss = burn.stations[0]
        return landscape.xy_of_lat_lon(boss.lat_deg, boss.lon_deg)
    if planner.ignition_known:
        first = scenario.ignition[0]
        return landscape.xy_of_lat_lon(first.lat_deg, first.lon_deg)
    return landscape.xy_of_lat_lon(planner.reported_lat_deg, planner.reported_lon_deg)
