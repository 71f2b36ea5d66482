"""Defines the tables of landscape, weather, ignitions, fire, ensemble and estimate."""

from datetime import datetime
from pathlib import Path
from typing import Annotated, ClassVar, Literal
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from pydantic import Field, field_validator, model_validator

from firemodel.ensemble.uncertainty import Uncertainty
from firemodel.landscape import LAYERS
from firemodel.landscape.wind_options import North
from firemodel.physics import CrownMethod
from firemodel.spread.schemes import (
    AIR_TEMPERATURE_C,
    FIREBRANDS_PER_HA,
    P_SPREAD,
    UPDATE_S,
    SchemeName,
)
from mission_service.config.relief_section import SimulatedBatteriesSection
from mission_service.config.section_base import (
    Finite,
    Latitude,
    Line,
    Longitude,
    NotNegative,
    Positive,
    Section,
)

Bearing = Annotated[float, Field(ge=0, le=360)]
Percent = Annotated[float, Field(ge=0, le=400)]
Celsius = Annotated[float, Field(ge=-100, le=2000)]
LogSd = Annotated[float, Field(ge=0, le=1)]  # the standard deviation of a logarithm

DEFAULT_ERRORS = Uncertainty()
RASTER_KEYS = (
    *("bands", "units", "missing", "crs", "nodata"),
    *("fuel_codes", "custom_fuels", "rate_factors"),
)


class LandscapeSection(Section):
    """The landscape of the fire: the terrain that ships with matplotlib, level ground, or rasters.

    Level ground ("flat") is centred on ``lat_deg``, ``lon_deg`` and has one fuel and the elevation
    ``elevation_m``. Rasters are given as one file per layer, or as one ``file`` with all layers.
    This one file is an .lcp, or a stack whose bands are described in the file or named in
    ``bands``. ``fuel_codes`` replaces codes of the fuel raster. ``custom_fuels`` is a .fmd file
    with further fuel models, and ``rate_factors`` is an .adj file with factors of the spread rate.
    """

    source: Literal["jacksboro", "flat", "files"] = "jacksboro"
    rows: Annotated[int, Field(ge=20, le=4000)] = 200
    cols: Annotated[int, Field(ge=20, le=4000)] = 200
    cell_size_m: Positive = 30.0
    lat_deg: Annotated[float, Field(ge=-80, le=84)] | None = None  # latitudes that UTM zones cover
    lon_deg: Longitude | None = None
    elevation_m: Annotated[float, Field(ge=-500, le=9000)] = 0.0
    fuel_model: int = 1
    file: Path | None = None
    bands: dict[str, Annotated[int, Field(ge=1)]] = Field(default={})
    fuel: Path | None = None
    elevation: Path | None = None
    slope: Path | None = None
    aspect: Path | None = None
    canopy_cover: Path | None = None
    canopy_height: Path | None = None
    canopy_base: Path | None = None
    canopy_bulk_density: Path | None = None
    units: dict[str, str] = Field(default={})
    missing: Literal["refuse", "unburnable"] = "refuse"
    crs: str | None = None
    nodata: Finite | None = None
    fuel_codes: dict[int, Annotated[int, Field(ge=1, le=32767)]] = Field(default={})
    custom_fuels: Path | None = None
    rate_factors: Path | None = None
    barriers: tuple[Path, ...] = ()

    @property
    def layers(self) -> dict[str, Path]:
        """The files of the layers that are given as separate files."""
        found = {name: getattr(self, name) for name in LAYERS}
        return {name: path for name, path in found.items() if path is not None}

    @model_validator(mode="after")
    def _files_named(self) -> "LandscapeSection":
        if self.source != "flat":
            self._refuse(("lat_deg", "lon_deg", "elevation_m", "fuel_model"))
        elif self.lat_deg is None or self.lon_deg is None:
            raise ValueError('source = "flat" requires lat_deg and lon_deg, the centre of the grid')
        if self.source != "files":
            if self.file or self.layers:
                raise ValueError('raster files require source = "files"')
            self._refuse(RASTER_KEYS)
        elif (self.file is None) == (not self.layers):
            raise ValueError(
                'source = "files" requires `file`, or `fuel` together with the other layers'
            )
        else:
            self._refuse(("rows", "cols", "cell_size_m"))
        if self.bands and self.file is None:
            raise ValueError("`bands` requires `file`, a raster stack")
        return self

    def _refuse(self, keys: tuple[str, ...]) -> None:
        """Raise ValueError for a key that has no effect with this source."""
        for key in keys:
            if getattr(self, key) != type(self).model_fields[key].default:
                raise ValueError(
                    f'`{key}` has no effect with source = "{self.source}"; leave it out'
                )


class FuelMoisture(Section):
    """The moisture of the fuels as a percentage of their dry weight."""

    dead_1h_pct: Percent = 6.0
    dead_10h_pct: Percent = 8.0
    dead_100h_pct: Percent = 10.0
    live_herb_pct: Percent = 70.0
    live_woody_pct: Percent = 100.0


class WeatherEntry(FuelMoisture):
    """The weather from ``at_s`` on; the wind applies 6.1 m (20 ft) above the vegetation."""

    at_s: NotNegative
    wind_speed_m_s: Annotated[float, Field(ge=0, le=100)]
    wind_from_deg: Bearing


class WeatherFile(FuelMoisture):
    """A weather file (.raws, .wxs, .wtr, .csv); ``start`` is mission time 0, in local time.

    A .wtr file has no wind; ``wind`` is the .wnd file (default: the file with the same name). The
    weather file may also be an inputs file of FARSITE. The moistures in this table are used if the
    weather file has no moistures; ``fuel_moistures`` is an .fms file with moistures of single
    fuels. With ``conditioned``, dead fuels start with these moistures, which then follow
    temperature, humidity and rain by ``dead_fuel_model``: "time_lag", the same everywhere, or
    "nelson", by elevation, slope, aspect, sun and shade. ``station_elevation_m`` is the elevation
    of the weather station, by default the mean of the landscape. With ``north`` = "grid", wind
    directions are clockwise from the north of the landscape's grid, as FARSITE reads them.
    """

    path: Path
    wind: Path | None = None
    fuel_moistures: Path | None = None
    start: datetime | None = None
    north: North = "true"
    conditioned: bool = False
    dead_fuel_model: Literal["time_lag", "nelson"] = "time_lag"
    station_elevation_m: Annotated[float, Field(ge=-500, le=9000)] | None = None

    @model_validator(mode="after")
    def _conditioned(self) -> "WeatherFile":
        if self.dead_fuel_model == "nelson" and not self.conditioned:
            raise ValueError('dead_fuel_model = "nelson" requires conditioned = true')
        if self.station_elevation_m is not None and self.dead_fuel_model != "nelson":
            raise ValueError(
                'station_elevation_m has no effect without dead_fuel_model = "nelson"; leave it out'
            )
        return self


class Ignition(Section):
    """An ignition at mission time ``at_s``, given by a point or by the shapes in a file."""

    lat_deg: Latitude | None = None
    lon_deg: Longitude | None = None
    file: Path | None = None
    at_s: NotNegative = 0.0

    @model_validator(mode="after")
    def _one_of_both(self) -> "Ignition":
        point = (self.lat_deg is not None, self.lon_deg is not None)
        if any(point) != all(point) or (self.file is None) != all(point):
            raise ValueError("specify either lat_deg and lon_deg, or `file`")
        return self


class SuppressionLine(Section):
    """A control line, given by points or by the lines in a file.

    The construction begins at mission time ``at_s`` and advances by ``rate_m_h``; without a rate
    the line is complete at ``at_s``. ``points`` are latitude and longitude. For polygons in a file,
    the lines follow the outlines.
    """

    points: Annotated[tuple[tuple[Latitude, Longitude], ...], Field(min_length=2)] | None = None
    file: Path | None = None
    at_s: NotNegative = 0.0
    rate_m_h: Annotated[float, Field(gt=0, le=1e5)] | None = None

    @model_validator(mode="after")
    def _one_of_both(self) -> "SuppressionLine":
        if (self.points is None) == (self.file is None):
            raise ValueError("specify either `points` or `file`")
        return self


class FireSection(Section):
    """The scheme of fire spread, and the area that has already burned at the start.

    With ``precise``, paths of the any-angle scheme may also bend in the middle of a cell's edge.
    ``crown`` is the method by which crown fire is computed, for landscapes with canopy layers;
    ``foliar_moisture_pct`` is the moisture of the needles, on which the ignition of crowns depends.
    With ``spotting``, burning crowns emit ``firebrands_per_ha``, which may ignite fuel at
    ``air_temperature_c``. With ``acceleration``, new fires begin slowly. ``perimeter`` is a file
    with polygons of the area that has burned by ``burning_at_s``. ``perimeter_feature`` is the
    number of the only feature to use, if not all are used. With ``repair_perimeter``, closed lines
    and invalid polygons become valid polygons. ``arrival`` is a raster of arrival times.
    ``p_spread`` and ``update_s`` apply to the probabilistic scheme. A fire of the probabilistic
    scheme can also start with ``initial_cells`` cells, which are grown from the ignitions.
    """

    scheme: SchemeName = "anyangle"
    wind_limit: bool = False
    precise: bool = False
    crown: CrownMethod = "none"
    foliar_moisture_pct: Annotated[float, Field(ge=0, le=400)] = 100.0
    spotting: bool = False
    firebrands_per_ha: Annotated[float, Field(ge=0, le=1000)] = FIREBRANDS_PER_HA
    air_temperature_c: Annotated[float, Field(ge=-40, le=60)] = AIR_TEMPERATURE_C
    acceleration: bool = False
    perimeter: Path | None = None
    perimeter_feature: Annotated[int, Field(ge=1)] | None = None
    repair_perimeter: bool = False
    arrival: Path | None = None
    arrival_unit: Literal["seconds", "minutes", "hours", "days"] = "seconds"
    burning_at_s: NotNegative = 0.0
    p_spread: Annotated[float, Field(gt=0, le=1)] = P_SPREAD
    update_s: Positive = UPDATE_S
    initial_cells: Annotated[int, Field(ge=1)] | None = None

    @model_validator(mode="after")
    def _one_fire(self) -> "FireSection":
        if self.perimeter is not None and self.arrival is not None:
            raise ValueError("specify either `perimeter` or `arrival`, not both")
        for name in ("repair_perimeter", "perimeter_feature"):
            if getattr(self, name) and self.perimeter is None:
                raise ValueError(f"{name} has no effect without `perimeter`; leave it out")
        if self.crown != "none" and self.scheme == "probabilistic":
            raise ValueError('`crown` has no effect with scheme = "probabilistic"; leave it out')
        if self.acceleration and self.scheme == "probabilistic":
            raise ValueError('`acceleration` has no effect with scheme = "probabilistic"')
        if self.spotting and (self.crown == "none" or self.scheme != "anyangle"):
            raise ValueError('`spotting` requires `crown` and scheme = "anyangle"')
        if self.initial_cells is not None:
            if self.scheme != "probabilistic":
                raise ValueError('initial_cells requires scheme = "probabilistic"')
            if self.perimeter is not None or self.arrival is not None:
                raise ValueError("specify only one of initial_cells, `perimeter` and `arrival`")
        return self


class EnsembleSection(Section):
    """The standard deviations of the errors in a fire's inputs, for ensembles and forecasts.

    ``firemodel/ensemble/uncertainty.py`` states the sources of the defaults. Factors are log-normal
    with a median of 1. Each error is constant during a fire and independent of the other errors.
    """

    wind_log_sd: LogSd = DEFAULT_ERRORS.wind_log_sd
    wind_turn_sd_deg: Annotated[float, Field(ge=0, le=180)] = DEFAULT_ERRORS.wind_turn_sd_deg
    spread_log_sd: LogSd = DEFAULT_ERRORS.spread_log_sd
    fuel_log_sd: LogSd = DEFAULT_ERRORS.fuel_log_sd
    moisture_log_sd: LogSd = DEFAULT_ERRORS.moisture_log_sd
    ignition_sd_m: Annotated[float, Field(ge=0, le=100_000)] = DEFAULT_ERRORS.ignition_sd_m


class ThermalCameraSection(Section):
    """The settings that all sensors of thermal images have in common.

    ``field_of_view_deg`` is the horizontal field of view (default: that in the image's metadata).
    ``distortion`` is k1, k2, p1, p2, k3 (Brown-Conrady, as defined by OpenCV). Pixels of at least
    ``hot_c`` are burning; pixels up to ``warm_difference_c`` above the background are cool. Images
    of grey levels require ``hot_level``. The next keys are standard deviations of the camera's
    position (of each horizontal axis), altitude and direction (of the rotation about each axis of
    the camera), and of the landscape's elevation. Pixels that are placed on the ground by the
    camera's pose are not used if the standard deviation of their position is above
    ``max_position_sd_m``. Images older than ``max_age_s`` on arrival are not used.
    """

    TABLE: ClassVar[str]

    field_of_view_deg: Annotated[float, Field(ge=1, le=150)] | None = None
    distortion: tuple[Finite, Finite, Finite, Finite, Finite] = (0.0, 0.0, 0.0, 0.0, 0.0)
    hot_c: Annotated[float, Field(ge=50, le=1500)] = 200.0
    warm_difference_c: Annotated[float, Field(ge=1, le=500)] = 20.0
    hot_level: Annotated[float, Field(gt=0, le=255)] | None = None
    position_sd_m: Annotated[float, Field(ge=0, le=1000)] = 1.5
    altitude_sd_m: Annotated[float, Field(ge=0, le=1000)] = 1.5
    direction_sd_deg: Annotated[float, Field(ge=0, le=45)] = 0.5
    elevation_sd_m: Annotated[float, Field(ge=0, le=1000)] = 2.0
    max_position_sd_m: Annotated[float, Field(gt=0, le=1000)] = 8.0
    max_age_s: Annotated[float, Field(gt=0, le=21_600)] = 3600.0


class ThermalFramesSection(ThermalCameraSection):
    """The images of thermal cameras that arrive in a folder, for the sensor ``thermal_frames``.

    ``kelvin_per_count`` converts 16-bit counts to kelvins. If a file contains no pose, the pose is
    that of the vehicles' telemetry: ``file_time_sd_s`` is the standard deviation of the times of
    files, and ``fixed_pitch_deg`` is the pitch of a camera without a gimbal, relative to the
    airframe.
    """

    TABLE = "estimate.thermal_frames"

    folder: Line | None = None
    kelvin_per_count: Annotated[float, Field(gt=0, le=10)] = 0.01
    file_time_sd_s: Annotated[float, Field(ge=0, le=10)] = 0.2
    fixed_pitch_deg: Annotated[float, Field(ge=-90, le=0)] | None = None


class ThermalVideoSection(ThermalCameraSection):
    """The video of a thermal camera with MISB ST 0601 metadata, for the sensor ``thermal_video``.

    ``source`` is ``udpin:HOST:PORT`` or a file, which may still be written. With
    ``grey_level_range_c``, grey levels 0 and 255 have these temperatures, and the temperatures of
    other levels are interpolated linearly. With ``use_corner_points``, frames are placed by their
    corner points even if the metadata contain a pose; ``corner_sd_m`` is the standard deviation of
    the corner points (of each horizontal axis). Heights above the ellipsoid require ``geoid_m``,
    the height of mean sea level above the ellipsoid. ``leap_seconds`` are subtracted from time
    stamps if the metadata state no offset from UTC.
    """

    TABLE = "estimate.thermal_video"

    source: Line | None = None
    grey_level_range_c: tuple[Celsius, Celsius] | None = None
    use_corner_points: bool = False
    corner_sd_m: Annotated[float, Field(gt=0, le=1000)] = 15.0
    geoid_m: Annotated[float, Field(ge=-150, le=150)] | None = None
    leap_seconds: Annotated[int, Field(ge=0, le=100)] = 0
    position_sd_m: Annotated[float, Field(ge=0, le=1000)] = 3.0
    altitude_sd_m: Annotated[float, Field(ge=0, le=1000)] = 3.0
    direction_sd_deg: Annotated[float, Field(ge=0, le=45)] = 1.0

    @model_validator(mode="after")
    def _rising(self) -> "ThermalVideoSection":
        grey_range_c = self.grey_level_range_c
        if grey_range_c is not None and grey_range_c[0] >= grey_range_c[1]:
            raise ValueError("grey_level_range_c needs a lower and a higher temperature")
        if grey_range_c is not None and self.hot_level is not None:
            raise ValueError("specify either grey_level_range_c or hot_level")
        return self


class ObservationFilesSection(Section):
    """The files of perimeters, detections and rasters, for the sensor ``observation_files``.

    Times without an offset from UTC are local times of ``time_zone``. ``position_sd_m`` is the
    standard deviation of the position of mapped shapes if their file does not state the method of
    mapping. Cells of a raster with one of ``burned_values`` have burned, and cells with one of
    ``unburned_values`` are unburned. Observations older than ``max_age_s`` are not used.
    """

    folder: Line | None = None
    time_zone: Line = "UTC"
    position_sd_m: Annotated[float, Field(ge=0, le=1000)] = 20.0
    burned_values: tuple[Finite, ...] = (1.0,)
    unburned_values: tuple[Finite, ...] = (0.0,)
    max_age_s: Annotated[float, Field(gt=0, le=21_600)] = 21_600.0

    @field_validator("time_zone")
    @classmethod
    def _known_zone(cls, name: str) -> str:
        try:
            ZoneInfo(name)
        except (ZoneInfoNotFoundError, ValueError, OSError):
            raise ValueError(f"unknown time zone {name!r}; use a name such as UTC") from None
        return name

    @model_validator(mode="after")
    def _distinct_values(self) -> "ObservationFilesSection":
        if both := set(self.burned_values) & set(self.unburned_values):
            raise ValueError(f"burned_values and unburned_values both contain {min(both):g}")
        return self


class EstimateSection(Section):
    """The ensemble that estimates a fire from observations.

    ``perimeter_error_m`` is the standard deviation of the outlines of mapped perimeters.
    ``sensors`` names the sensors (``fire/sensors.py``) to use: ``thermal_frames``,
    ``thermal_video``, ``camera_points``, ``observation_files`` or a sensor of another package.
    """

    members: Annotated[int, Field(ge=2, le=1000)] = 24
    perimeter_error_m: Annotated[float, Field(gt=0, le=1000)] = 20.0
    sensors: tuple[str, ...] = ()
    thermal_frames: ThermalFramesSection = ThermalFramesSection()
    thermal_video: ThermalVideoSection = ThermalVideoSection()
    observation_files: ObservationFilesSection = ObservationFilesSection()

    @field_validator("sensors")
    @classmethod
    def _listed_once(cls, sensors: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(sensors)) < len(sensors):
            raise ValueError("contains a sensor twice; list each sensor once")
        return sensors


class SimulatedFireSection(Section):
    """The fire that simulated cameras observe: the scenario's fire, changed by these factors.

    The estimate and the planners use the weather of the scenario, without these factors.
    ``moisture_factor`` applies to dead fuels.
    """

    wind_factor: Annotated[float, Field(ge=0, le=10)] = 1.0
    wind_turn_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0
    moisture_factor: Annotated[float, Field(ge=0.1, le=10)] = 1.0
    spread_factor: Annotated[float, Field(ge=0.05, le=20)] = 1.0


class SimulatedCameraSection(Section):
    """The simulated cameras.

    Only the key ``kind`` applies to ``ideal`` cameras. ``gps_sd_m`` and ``gimbal_sd_deg`` are
    standard deviations of the position and of the camera's direction. ``missed`` is the fraction of
    burned cells that an image shows as unburned, and ``false_alarms`` is the fraction of unburned
    cells that an image shows as burned. Smoke hides the ground up to ``smoke_m`` downwind of
    burning cells from ``visible`` cameras, but not from ``thermal`` cameras. Cameras that write
    files for ``thermal_frames`` use ``gps_sd_m`` and ``gimbal_sd_deg``; without ``poses_in_files``
    the pose of an image is that of the vehicle's telemetry.
    """

    kind: Literal["ideal", "thermal", "visible"] = "ideal"
    gps_sd_m: Annotated[float, Field(ge=0, le=1000)] = 1.5
    gimbal_sd_deg: Annotated[float, Field(ge=0, le=45)] = 0.5
    missed: Annotated[float, Field(ge=0, lt=1)] = 0.05
    false_alarms: Annotated[float, Field(ge=0, lt=1)] = 0.01
    smoke_m: Annotated[float, Field(ge=0, le=10_000)] = 300.0
    poses_in_files: bool = True


class SimulationSection(Section):
    """The simulated fire, cameras and batteries; without their tables they are not simulated.

    Without ``fire`` the cameras are not simulated either.
    """

    fire: SimulatedFireSection | None = None
    camera: SimulatedCameraSection = SimulatedCameraSection()
    batteries: SimulatedBatteriesSection | None = None
