"""The scenario: one TOML file into frozen models that refuse what they do not know."""

import re
import tomllib
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AwareDatetime,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.link import parse_link
from mission_service.errors import ScenarioError

SHIPPED = Path(__file__).parent / "scenarios"

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Latitude = Annotated[float, Field(ge=-90, le=90)]
Longitude = Annotated[float, Field(ge=-180, le=180)]
Bearing = Annotated[float, Field(ge=0, le=360)]
Percent = Annotated[float, Field(ge=0, le=400)]
Share = Annotated[float, Field(ge=0, lt=1)]


LAYER_KEYS = (
    "fuel",
    "elevation",
    "slope",
    "aspect",
    "canopy_cover",
    "canopy_height",
    "canopy_base",
)


RASTER_KEYS = ("bands", "units", "missing", "crs", "nodata")


# A name that is no name may be the key itself.
KEY_SOURCE = r"file:.+|env:[A-Za-z_]\w*"


class Section(BaseModel):
    """A table of the file: read-only, unknown keys refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class LandscapeSection(Section):
    """Where the fire burns: the grid that ships with matplotlib, or rasters on one grid.

    Rasters are a file for each layer, or one ``file`` for all: an .lcp, or a stack whose bands say
    what they are or are named in ``bands``.
    """

    source: Literal["jacksboro", "files"] = "jacksboro"
    rows: Annotated[int, Field(ge=20, le=4000)] = 200
    cols: Annotated[int, Field(ge=20, le=4000)] = 200
    cell_size_m: Positive = 30.0
    file: Path | None = None
    bands: dict[str, Annotated[int, Field(ge=1)]] = {}
    fuel: Path | None = None
    elevation: Path | None = None
    slope: Path | None = None
    aspect: Path | None = None
    canopy_cover: Path | None = None
    canopy_height: Path | None = None
    canopy_base: Path | None = None
    units: dict[str, str] = {}
    missing: Literal["refuse", "unburnable"] = "refuse"
    crs: str | None = None
    nodata: Finite | None = None
    barriers: tuple[Path, ...] = ()

    @property
    def layers(self) -> dict[str, Path]:
        """The file of each layer that has one of its own."""
        found = {name: getattr(self, name) for name in LAYER_KEYS}
        return {name: path for name, path in found.items() if path is not None}

    @model_validator(mode="after")
    def _files_named(self) -> "LandscapeSection":
        if self.source == "jacksboro":
            if self.file or self.layers:
                raise ValueError('rasters are given, so it must say source = "files"')
            self._refuse(RASTER_KEYS)
        elif (self.file is None) == (not self.layers):
            raise ValueError('source = "files" needs either file, or fuel and the other layers')
        else:
            self._refuse(("rows", "cols", "cell_size_m"))
        if self.bands and self.file is None:
            raise ValueError("bands are those of a stack: it needs file")
        return self

    def _refuse(self, keys: tuple[str, ...]) -> None:
        """Raise for a key that would have no effect with this source."""
        for key in keys:
            if getattr(self, key) != type(self).model_fields[key].default:
                raise ValueError(f'{key} has no effect with source = "{self.source}"; leave it out')


class FuelMoisture(Section):
    """Moisture of the fuels in percent of their dry weight."""

    dead_1h_pct: Percent = 6.0
    dead_10h_pct: Percent = 8.0
    dead_100h_pct: Percent = 10.0
    live_herb_pct: Percent = 70.0
    live_woody_pct: Percent = 100.0


class WeatherEntry(FuelMoisture):
    """Weather from ``at_s`` on. Wind 6.1 m (20 ft) above the vegetation."""

    at_s: NotNegative
    wind_speed_m_s: Annotated[float, Field(ge=0, le=100)]
    wind_from_deg: Bearing


class WeatherFile(FuelMoisture):
    """A .raws, .wxs or .csv file; ``start`` is mission time 0 in the file's own time.

    Moistures that the file does not have are those given here. With ``conditioned`` the dead ones
    follow temperature, humidity and rain from these on.
    """

    path: Path
    start: datetime | None = None
    conditioned: bool = False


class Ignition(Section):
    """What starts to burn ``at_s`` seconds of mission time: a point, or the shapes of a file."""

    lat_deg: Latitude | None = None
    lon_deg: Longitude | None = None
    file: Path | None = None
    at_s: NotNegative = 0.0

    @model_validator(mode="after")
    def _one_of_both(self) -> "Ignition":
        point = (self.lat_deg is not None, self.lon_deg is not None)
        if any(point) != all(point) or (self.file is None) != all(point):
            raise ValueError("needs either lat_deg and lon_deg, or file")
        return self


class FireSection(Section):
    """How the fire spreads, and what of it burns already when the model takes over.

    ``perimeter`` is a file of polygons burned by ``burning_at_s``; ``arrival`` a raster of times of
    arrival. ``p_spread`` and ``update_s`` are those of the probabilistic scheme.
    """

    scheme: Literal["anyangle", "devs8", "probabilistic"] = "anyangle"
    wind_limit: bool = False
    perimeter: Path | None = None
    arrival: Path | None = None
    arrival_unit: Literal["seconds", "minutes", "hours", "days"] = "seconds"
    burning_at_s: NotNegative = 0.0
    p_spread: Annotated[float, Field(gt=0, le=1)] = 0.025
    update_s: Positive = 60.0

    @model_validator(mode="after")
    def _one_fire(self) -> "FireSection":
        if self.perimeter is not None and self.arrival is not None:
            raise ValueError("give either perimeter or arrival, not both")
        return self


class PlannerSection(Section):
    """The Islam & Hu planner; see mission_service/planners/perimeter.py for the rules."""

    rule: Literal["damped", "literal", "circling"] = "damped"
    alpha: NotNegative = 1.0
    first_direction: Literal["clockwise", "anticlockwise"] = "clockwise"
    ignition_known: bool = True
    reported_lat_deg: Latitude | None = None
    reported_lon_deg: Longitude | None = None
    baseline_s: Positive = 600.0
    smoothing_deg: Annotated[int, Field(ge=0, le=90)] = 10
    reversal_margin: NotNegative = 0.5
    least_gain_cells: NotNegative = 0.5
    dwell_s: NotNegative = 200.0

    @model_validator(mode="after")
    def _fire_reported(self) -> "PlannerSection":
        reported = (self.reported_lat_deg is not None, self.reported_lon_deg is not None)
        if not self.ignition_known and not all(reported):
            raise ValueError(
                "ignition_known = false needs reported_lat_deg and reported_lon_deg, "
                "a point inside the fire"
            )
        return self


class MissionSection(Section):
    """How decisions become missions."""

    horizon_m: Positive = 2500.0
    lead_m: Positive = 150.0
    path_tolerance_m: Positive = 45.0
    least_upload_interval_s: NotNegative = 4.0


class LinkSection(Section):
    """The simulated link of ``sim``: each way, per datagram."""

    loss: Share = 0.0
    delay_ms: NotNegative = 20.0
    jitter_ms: NotNegative = 0.0
    duplication: Share = 0.0


class VehicleSection(Section):
    """One vehicle: what it is, what it can do, where its camera looks, how it is reached."""

    name: Annotated[str, Field(min_length=1, max_length=40, pattern=r"^[\w-]+$")]
    stack: Literal["px4", "ardupilot"] = "px4"
    kind: Literal["plane", "copter"] = "plane"
    link: str = "udpin:127.0.0.1:14550"
    system_id: Annotated[int, Field(ge=1, le=250)] = 1
    backend: Literal["native", "mavsdk"] = "native"
    signing_key: str | None = None  # where the key is; the journal holds the scenario
    signing_link_id: Annotated[int, Field(ge=0, le=255)] | None = None  # its place, counted from 0
    home_lat_deg: Latitude
    home_lon_deg: Longitude
    airspeed_m_s: Positive = 18.0
    altitude_agl_m: Positive = 150.0
    turn_radius_m: Positive = 60.0
    least_leg_m: Positive = 90.0
    loiter_radius_m: Positive = 90.0
    camera_fov_deg: Annotated[float, Field(gt=0, lt=170)] = 100.0
    camera_rate_hz: Annotated[float, Field(gt=0, le=4)] = 1.0
    autostart: bool = False
    landing: bool = True  # a PX4 plane's missions end with a landing at home
    landing_course_deg: Annotated[float, Field(ge=0, le=360)] | None = None

    @field_validator("signing_key")
    @classmethod
    def _key_not_here(cls, source: str | None) -> str | None:
        if source is not None and re.fullmatch(KEY_SOURCE, source) is None:
            raise ValueError(
                'name where the key is, as "file:PATH" or "env:NAME"; '
                "the key itself does not belong into a scenario, which is recorded"
            )
        return source


class Scenario(Section):
    """A whole scenario. Mission time 0 is when the clock of the fire starts.

    ``time_zero`` is that moment by the calendar, with its UTC offset, for files that are written.
    """

    name: str
    time_zero: AwareDatetime | None = None
    seed: Annotated[int, Field(ge=0)] = 0
    start_s: NotNegative = 0.0
    duration_s: Positive
    deploy_at_s: NotNegative = 0.0
    clock: Literal["autopilot", "wall"] = "autopilot"
    landscape: LandscapeSection = LandscapeSection()
    fire: FireSection = FireSection()
    weather: tuple[WeatherEntry, ...] = ()
    weather_file: WeatherFile | None = None
    ignition: tuple[Ignition, ...] = ()
    vehicles: tuple[VehicleSection, ...] = ()
    planner: PlannerSection = PlannerSection()
    mission: MissionSection = MissionSection()
    link: LinkSection = LinkSection()

    @model_validator(mode="after")
    def _consistent(self) -> "Scenario":
        names = [vehicle.name for vehicle in self.vehicles]
        if len(set(names)) != len(names):
            raise ValueError(f"vehicles must have different names, got {', '.join(names)}")
        if (self.weather_file is None) == (not self.weather):
            raise ValueError("it needs either weather entries or a weather_file")
        if not (self.ignition or self.fire.perimeter or self.fire.arrival):
            raise ValueError("nothing burns: give an ignition, fire.perimeter or fire.arrival")
        _refuse_shared_ports(self.vehicles)
        times = [entry.at_s for entry in self.weather]
        if times and (times != sorted(set(times)) or times[0] != 0):
            raise ValueError("weather entries must start at at_s = 0 and be later one by one")
        if self.duration_s <= self.start_s:
            raise ValueError("duration_s must be later than start_s")
        return self


def _refuse_shared_ports(vehicles: tuple[VehicleSection, ...]) -> None:
    """Raise ValueError unless each vehicle flown through MAVSDK has a port of its own."""
    for vehicle in vehicles:
        if vehicle.backend != "mavsdk":
            continue
        if "link" not in vehicle.model_fields_set:
            raise ValueError(
                f'{vehicle.name}: backend = "mavsdk" needs a link with a port of its own, '
                'as in link = "udpin:127.0.0.1:14551"'
            )
        try:
            parse_link(vehicle.link)
        except BridgeError as error:
            raise ValueError(f"{vehicle.name}: {error}") from None
        for other in vehicles:
            if other is not vehicle and _port(other.link) == _port(vehicle.link):
                raise ValueError(
                    f"{vehicle.name} and {other.name} have the same port ({vehicle.link}); with "
                    'backend = "mavsdk" each vehicle needs one of its own'
                )


def _port(link: str) -> str:
    """The port or serial device of a link, whatever the host."""
    kind, _, rest = link.partition(":")
    return rest.rpartition(":")[0] if kind == "serial" else rest.rpartition(":")[2]


def scenario_path(name: str) -> Path:
    """The file of a scenario: a path, or the name of one that ships with the package."""
    path = Path(name)
    shipped = SHIPPED / f"{name}.toml"
    if path.exists() or not shipped.exists():
        return path
    return shipped


def load_scenario(name: str, overrides: tuple[str, ...] = ()) -> Scenario:
    """Read a scenario file (or a shipped one by name), apply ``key=value`` overrides, check it.

    Raises ScenarioError in one line: file, key, value, reason.
    """
    path = scenario_path(name)
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        shipped = ", ".join(sorted(entry.stem for entry in SHIPPED.glob("*.toml")))
        raise ScenarioError(f"{path}: no such file (shipped scenarios: {shipped})") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: cannot be read: {error}") from None
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{path}: not valid TOML: {error}") from None
    for override in overrides:
        _apply(data, override)
    return parse_scenario(data, path)


def parse_scenario(data: dict[str, Any], path: Path) -> Scenario:
    """Check a scenario given as a dictionary; relative paths count from the file."""
    try:
        scenario = Scenario.model_validate(data)
    except ValidationError as error:
        raise ScenarioError(f"{path}: {_in_words(error)}") from None
    found: Scenario = _with_paths(scenario, path, ())
    return found


def _with_paths(section: Any, scenario_path: Path, keys: tuple[str, ...]) -> Any:
    """A section with all its paths counted from the scenario's folder; they must be there."""
    if isinstance(section, Path):
        found = (scenario_path.parent / section).resolve()
        if not found.is_file():
            what = "is a folder, not a file" if found.is_dir() else "no such file"
            raise ScenarioError(f"{scenario_path}: {'.'.join(keys)}: {what}: {found}")
        return found
    if keys[-1:] == ("signing_key",) and section and section.startswith("file:"):
        path = Path(section.removeprefix("file:")).expanduser()
        return f"file:{(scenario_path.parent / path).resolve()}"
    if isinstance(section, tuple):
        return tuple(
            _with_paths(part, scenario_path, (*keys, str(place)))
            for place, part in enumerate(section)
        )
    if isinstance(section, Section):
        names = type(section).model_fields
        values = {
            name: _with_paths(getattr(section, name), scenario_path, (*keys, name))
            for name in names
        }
        return section.model_copy(update=values)
    return section


def with_signing_key(scenario: Scenario, source: str) -> Scenario:
    """The scenario with the same key for all its vehicles. Raises ScenarioError for no source."""
    if re.fullmatch(KEY_SOURCE, source) is None:
        raise ScenarioError("signing key: name where it is, as file:PATH or env:NAME")
    vehicles = tuple(
        vehicle.model_copy(update={"signing_key": source}) for vehicle in scenario.vehicles
    )
    return scenario.model_copy(update={"vehicles": vehicles})


def flying(scenario: Scenario) -> Scenario:
    """The scenario itself if vehicles can fly in it; raises ScenarioError saying what it lacks."""
    if not scenario.vehicles:
        raise ScenarioError(f"{scenario.name} has no vehicles: add one as [[vehicles]]")
    known = scenario.planner.ignition_known
    if known and not (scenario.ignition and scenario.ignition[0].lat_deg is not None):
        raise ScenarioError(
            f"{scenario.name}: the planner has to know where the fire is: make the first ignition "
            "a point, or set planner.ignition_known = false and reported_lat_deg, reported_lon_deg"
        )
    return scenario


def _in_words(error: ValidationError) -> str:
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"]) or "scenario"
    value = first.get("input")
    # What stands where a key is named, perhaps misspelt, may be the key itself.
    hidden = isinstance(value, dict | list | tuple | BaseModel) or re.search("key|sign", key)
    shown = "" if hidden else f" (got {value!r})"
    others = len(error.errors()) - 1
    more = f"; and {others} more" if others else ""
    if first["type"] == "extra_forbidden":
        return f"{key}: unknown key{shown}{more}"
    text = first["msg"].removeprefix("Value error, ")
    text = text.replace("a valid tuple", "a list, as in [ ... ]")
    text = re.sub(r"a valid dictionary.*", "a table", text)
    return f"{key}: {text}{shown}{more}"


def _apply(data: dict[str, Any], override: str) -> None:
    """Set ``a.b.0.c=value`` (a TOML value) in the dictionary of a scenario."""
    key, equals, text = override.partition("=")
    if not equals:
        raise ScenarioError(f"--set {override}: write it as key=value, e.g. planner.alpha=1.5")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text
    *parents, last = key.split(".")
    place: Any = data
    try:
        for part in parents:
            place = place[int(part)] if isinstance(place, list) else place.setdefault(part, {})
        place[int(last) if isinstance(place, list) else last] = value
    except (ValueError, IndexError, TypeError, AttributeError):
        raise ScenarioError(f"--set {override}: there is no such key in the scenario") from None
