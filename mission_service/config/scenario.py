"""Reads a scenario from a TOML file into frozen models that refuse unknown keys."""

import re
import tomllib
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    AfterValidator,
    AwareDatetime,
    BaseModel,
    Field,
    ValidationError,
    create_model,
    model_validator,
)
from pydantic_core import ErrorDetails

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.link_address import parse_link
from mission_service.config.airspace_section import AirspaceSection
from mission_service.config.fire_sections import (
    EnsembleSection,
    EstimateSection,
    FireSection,
    Ignition,
    LandscapeSection,
    SimulationSection,
    SuppressionLine,
    WeatherEntry,
    WeatherFile,
)
from mission_service.config.relief_section import ReliefSection, refuse_relief
from mission_service.config.renamed_keys import renamed_keys
from mission_service.config.rule_lookup import Way, own_ways, rules, way_named
from mission_service.config.section_base import Line, NotNegative, Section
from mission_service.config.sections import (
    KEY_SOURCE,
    BurnSection,
    FormationSection,
    LinkSection,
    MissionSection,
    PlannerSection,
    PreflightSection,
    VehicleSection,
)
from mission_service.config.service_section import ServiceSection
from mission_service.config.surveillance_section import SurveillanceSection
from mission_service.config.wind_section import TerrainWindSection, WindGridsSection
from mission_service.errors import OptionError, ScenarioError, did_you_mean
from mission_service.value_errors import got, keys_at, missing_key, remedy, schema_at

SHIPPED = Path(__file__).parents[1] / "scenarios"
MAX_DURATION_S = 3.2e8  # ten years
S = TypeVar("S", bound=Section)
SECRETS = (("signing_key",), ("password",), ("data_package_password",))  # "file:PATH" or "env:NAME"
# The error types that pydantic reports for exceptions from this package's validators.
OWN_ERRORS = ("value_error", "assertion_error")
MAX_ERRORS = 6  # in one message


def _in_use(time: datetime) -> datetime:
    if not 1900 <= time.year <= 2200:
        raise ValueError("use a year from 1900 to 2200")
    return time


class Scenario(Section):
    """A complete scenario. Mission time 0 is the start of the fire.

    ``time_zero`` is the calendar time of mission time 0, with its UTC offset, for output files.
    ``only`` names the single vehicle that this process controls, if other processes control the
    other vehicles.
    """

    name: Annotated[Line, Field(min_length=1, max_length=100)]
    time_zero: Annotated[AwareDatetime, AfterValidator(_in_use)] | None = None
    seed: Annotated[int, Field(ge=0)] = 0
    start_s: NotNegative = 0.0
    duration_s: Annotated[float, Field(gt=0, le=MAX_DURATION_S)]
    deploy_at_s: NotNegative = 0.0
    clock: Literal["autopilot", "wall"] = "autopilot"
    fly_in_wind: bool = True  # simulated vehicles fly in the wind of the fire's weather
    landscape: LandscapeSection = LandscapeSection()
    fire: FireSection = FireSection()
    ensemble: EnsembleSection = EnsembleSection()
    estimate: EstimateSection = EstimateSection()
    simulation: SimulationSection = SimulationSection()
    weather: tuple[WeatherEntry, ...] = ()
    weather_file: WeatherFile | None = None
    wind_grids: WindGridsSection | None = None
    terrain_wind: TerrainWindSection | None = None
    ignition: tuple[Ignition, ...] = ()
    suppression: tuple[SuppressionLine, ...] = ()
    vehicles: tuple[VehicleSection, ...] = ()
    only: str | None = None
    planner: PlannerSection = PlannerSection()
    formation: FormationSection = FormationSection()
    burn: BurnSection | None = None
    mission: MissionSection = MissionSection()
    preflight: PreflightSection = PreflightSection()
    airspace: AirspaceSection = AirspaceSection()
    link: LinkSection = LinkSection()
    surveillance: SurveillanceSection | None = None
    relief: ReliefSection | None = None

    @model_validator(mode="after")
    def _consistent(self) -> "Scenario":
        names = [vehicle.name for vehicle in self.vehicles]
        if len(set(names)) != len(names):
            raise ValueError(f"vehicles must have different names, got {', '.join(names)}")
        if (self.weather_file is None) == (not self.weather):
            raise ValueError("specify either weather entries or a weather_file")
        if self.wind_grids is not None and self.terrain_wind is not None:
            raise ValueError("specify either wind_grids or terrain_wind, not both")
        if self.only is not None and self.only not in names:
            meant = did_you_mean(self.only, names)
            raise ValueError(
                f"`only`: there is no vehicle {self.only}; the scenario has "
                f"{', '.join(names)}{meant}"
            )
        _refuse_shared_ports(self.vehicles)
        if self.fire.initial_cells is not None and not self.ignition:
            raise ValueError("fire.initial_cells needs an ignition, from which the fire grows")
        if self.fire.acceleration and self.burn is not None:
            raise ValueError(
                "fire.acceleration cannot be combined with [burn], which lights many fires"
            )
        self.way.check(self)
        if self.surveillance is not None:
            _refuse_resolution(self, self.surveillance.resolution)
        if self.relief is not None:
            refuse_relief(self, self.relief)
        times = [entry.at_s for entry in self.weather]
        if times and (times != sorted(set(times)) or times[0] != 0):
            raise ValueError("weather entries must start at at_s = 0 and have increasing times")
        _refuse_high_vehicles(self.vehicles, self.airspace.max_altitude_agl_m)
        if self.duration_s <= self.start_s:
            raise ValueError("duration_s must be later than start_s")
        return self

    @property
    def way(self) -> Way:
        """The way of flying that the scenario's rule selects."""
        return way_named(self.planner.rule)

    @property
    def burn_flown(self) -> BurnSection | None:
        """The burn, or None if the scenario's rule is not for burns."""
        return self.burn if self.way.prescribed else None

    @property
    def passes_image_files(self) -> bool:
        """Whether images of the simulated fire are passed only as files to ``thermal_frames``."""
        return self.simulation.fire is not None and "thermal_frames" in self.estimate.sensors

    @property
    def first_flight_s(self) -> float:
        """The earliest mission time of a takeoff."""
        return max(self.start_s, self.deploy_at_s)

    @property
    def flown(self) -> tuple[VehicleSection, ...]:
        """The vehicles that this process controls."""
        if self.only is None:
            return self.vehicles
        return tuple(vehicle for vehicle in self.vehicles if vehicle.name == self.only)


def _refuse_resolution(scenario: Scenario, resolution: str) -> None:
    """Raise ValueError for a conflict resolution that the vehicles cannot fly."""
    if resolution != "none" and scenario.burn_flown is not None:
        raise ValueError(
            'surveillance.resolution must be "none" in a burn, because operators abort'
        )
    for vehicle in scenario.vehicles:
        if resolution == "descend" and vehicle.backend == "mavsdk":
            raise ValueError(
                f'{vehicle.name}: backend = "mavsdk" cannot hold at another altitude; set '
                'surveillance.resolution to "hold", "return" or "none"'
            )


def _refuse_high_vehicles(vehicles: tuple[VehicleSection, ...], max_agl_m: float | None) -> None:
    """Raise ValueError for a vehicle whose missions are above the airspace's altitude limit."""
    for vehicle in vehicles if max_agl_m is not None else ():
        if max_agl_m is not None and vehicle.altitude_agl_m > max_agl_m:
            raise ValueError(
                f"{vehicle.name}: altitude_agl_m = {vehicle.altitude_agl_m:g} is above "
                f"airspace.max_altitude_agl_m = {max_agl_m:g}"
            )


def _refuse_shared_ports(vehicles: tuple[VehicleSection, ...]) -> None:
    """Raise ValueError unless each vehicle with backend MAVSDK has a separate port."""
    for vehicle in vehicles:
        if vehicle.backend != "mavsdk":
            continue
        if "link" not in vehicle.model_fields_set:
            raise ValueError(
                f'{vehicle.name}: backend = "mavsdk" needs a link with a separate port, '
                'as in link = "udpin:127.0.0.1:14551"'
            )
        try:
            parse_link(vehicle.link)
        except BridgeError as error:
            raise ValueError(f"{vehicle.name}: {error}") from None
        for other in vehicles:
            ports = [_port(link) for link in other.links]
            if other is not vehicle and _port(vehicle.link) in ports:
                raise ValueError(
                    f"{vehicle.name} and {other.name} have the same port ({vehicle.link}); with "
                    'backend = "mavsdk" each vehicle needs a separate port'
                )


def _port(link: str) -> str:
    """Return the port or serial device of a link, without the host."""
    kind, _, rest = link.partition(":")
    return rest.rpartition(":")[0] if kind == "serial" else rest.rpartition(":")[2]


def scenario_path(name: str) -> Path:
    """Return the path of a scenario file, given as a path or the name of a shipped scenario."""
    path = Path(name)
    shipped = SHIPPED / f"{name}.toml"
    if path.exists() or not shipped.exists():
        return path
    return shipped


def load_scenario(name: str, overrides: tuple[str, ...] = ()) -> Scenario:
    """Read a scenario, apply ``key=value`` overrides and check the result.

    ``name`` is a file or the name of a shipped scenario. Raises ScenarioError with a one-line text
    that contains the file, the key, the value and the reason.
    """
    return load_run(name, overrides)[0]


def load_run(name: str, overrides: tuple[str, ...] = ()) -> tuple[Scenario, ServiceSection]:
    """Read a scenario as ``load_scenario`` does, and the daemon's settings from [service]."""
    path = scenario_path(name)
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        shipped = sorted(entry.stem for entry in SHIPPED.glob("*.toml"))
        meant = did_you_mean(name, shipped)
        raise ScenarioError(
            f"{path}: no such file (shipped scenarios: {', '.join(shipped)}){meant}"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: cannot be read: {error}") from None
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{path}: not valid TOML: {error}") from None
    return run_of(data, path, overrides)


def run_of(
    data: dict[str, Any], path: Path, overrides: tuple[str, ...] = ()
) -> tuple[Scenario, ServiceSection]:
    """Return what ``load_run`` returns, for the content of a file or a journal's header."""
    for override in overrides:
        apply_override(data, override)
    if renamed := list(renamed_keys(data)):
        raise ScenarioError(f"{path}: {'; '.join(renamed)}")
    service = data.pop("service", {})
    at = ("service",)
    try:
        settings = _with_paths(_checked(ServiceSection, service, path, at), path, at)
        return parse_scenario(data, path), settings
    except ScenarioError as error:
        raise _of_override(error, path, overrides) from None


def _of_override(error: ScenarioError, path: Path, overrides: tuple[str, ...]) -> ScenarioError:
    """Convert an error about a value from an override to OptionError."""
    problem = str(error).removeprefix(f"{path}: ")
    keys = [override.partition("=")[0] for override in overrides]
    if problem.startswith(tuple(f"{key}{end}" for key in keys for end in (": ", "."))):
        return OptionError(f"--set: {problem}")
    return error


def parse_scenario(data: dict[str, Any], path: Path) -> Scenario:
    """Check a scenario given as a dictionary; relative paths begin in the folder of ``path``."""
    kind = _with_table_of(rule_in(data))
    found: Scenario = _with_paths(_in_layers(_checked(kind, data, path)), path, ())
    return found


def rule_in(data: dict[str, Any]) -> str | None:
    """Return the rule in the unchecked content of a scenario, or None without a rule."""
    planner = data.get("planner")
    rule = planner.get("rule") if isinstance(planner, dict) else None
    return rule if isinstance(rule, str) else None


def recorded_scenario(data: dict[str, Any], path: Path, rule: str | None = None) -> Scenario:
    """Return the checked scenario that a journal's header contains.

    ``rule`` replaces the journal's rule. Raises ScenarioError for a rule whose package is not
    installed.
    """
    data = {"simulation": {"fire": {}}, **data}  # journals of older versions lack this table
    own = rule_in(data)
    if rule is None and (own is None or own in rules()):
        return parse_scenario(data, path)
    if rule is None:
        raise ScenarioError(
            f"{path}: the rule {own} of this journal is from a package that is not installed; "
            "install the package, or choose another rule (replay and decide: --planner RULE)"
        )
    others = {key: value for key, value in data.items() if key != own or own in own_ways()}
    return parse_scenario({**others, "planner": {**data.get("planner", {}), "rule": rule}}, path)


def _with_table_of(rule: str | None) -> type[Scenario]:
    """Return the scenario model, including the table of the planner's rule if there is one."""
    try:
        section = None if rule is None else way_named(rule).section
    except ValueError:  # the model's own check reports the invalid rule
        return Scenario
    return Scenario if rule is None or section is None else _with_table(rule, section)


@cache
def _with_table(name: str, section: type[BaseModel]) -> type[Scenario]:
    """Return the scenario model with an additional table ``name``.

    Raises ScenarioError if the scenario model already has a table of this name.
    """
    if name in Scenario.model_fields:
        raise ScenarioError(f"rule {name}: [{name}] is a table of all scenarios; rename the rule")
    needed = any(field.is_required() for field in section.model_fields.values())
    added: dict[str, Any] = {name: (section, ... if needed else Field(default_factory=section))}
    return create_model("Scenario", __base__=Scenario, **added)


def own_table(scenario: Scenario, section: type[S]) -> S:
    """Return the table with the name of the scenario's rule, or its defaults if it is missing.

    Raises ScenarioError for a missing table with keys that have no defaults.
    """
    found = getattr(scenario, scenario.planner.rule, None)
    try:
        return found if isinstance(found, section) else section()
    except ValidationError:
        rule = scenario.planner.rule
        raise ScenarioError(f"{scenario.name}: rule {rule} requires the table [{rule}]") from None


def _checked(kind: type[BaseModel], data: Any, path: Path, keys: tuple[str, ...] = ()) -> Any:
    """Return ``data``, the value at these keys, as a checked model. Raises ScenarioError."""
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        raise ScenarioError(f"{path}: {_in_words(error, kind, keys)}") from None


def _in_layers(scenario: Scenario) -> Scenario:
    """Return the scenario with an altitude layer for each vehicle without ``altitude_agl_m``."""
    vehicles = tuple(
        vehicle
        if "altitude_agl_m" in vehicle.model_fields_set
        else vehicle.model_copy(
            update={"altitude_agl_m": vehicle.altitude_agl_m + place * scenario.mission.layer_m}
        )
        for place, vehicle in enumerate(scenario.vehicles)
    )
    return scenario.model_copy(update={"vehicles": vehicles})


def _with_paths(section: Any, scenario_path: Path, keys: tuple[str, ...]) -> Any:
    """Return a section with paths resolved relative to the scenario; the files must exist."""
    if isinstance(section, Path):
        found = (scenario_path.parent / section).resolve()
        if not found.is_file():
            fault = "is a folder, not a file" if found.is_dir() else "no such file"
            raise ScenarioError(f"{scenario_path}: {'.'.join(keys)}: {fault}: {found}")
        return found
    if keys[-1:] in SECRETS and section and section.startswith("file:"):
        path = Path(section.removeprefix("file:")).expanduser()
        return f"file:{(scenario_path.parent / path).resolve()}"
    if keys[-1:] == ("basemaps",) and section is not None:
        folder = (scenario_path.parent / section).resolve()
        if not folder.is_dir():
            raise ScenarioError(f"{scenario_path}: {'.'.join(keys)}: no such folder: {folder}")
        return str(folder)
    if isinstance(section, tuple):
        return tuple(
            _with_paths(part, scenario_path, (*keys, str(place)))
            for place, part in enumerate(section)
        )
    if isinstance(section, Section):
        values = (
            (name, _with_paths(getattr(section, name), scenario_path, (*keys, name)))
            for name in type(section).model_fields
        )
        return section.model_copy(update=dict(values))
    return section


def with_signing_key(scenario: Scenario, source: str) -> Scenario:
    """Return the scenario with one signing key for all vehicles.

    Raises ScenarioError for an invalid key source.
    """
    if re.fullmatch(KEY_SOURCE, source) is None:
        raise ScenarioError("signing key: specify its source as file:PATH or env:NAME")
    keyed = (vehicle.model_copy(update={"signing_key": source}) for vehicle in scenario.vehicles)
    return scenario.model_copy(update={"vehicles": tuple(keyed)})


def one_of_many(scenario: Scenario, vehicle: str | None, peer_messaging: bool) -> Scenario:
    """Return the scenario of a process for one ``vehicle``, or for all vehicles if it is None.

    With ``peer_messaging``, the process exchanges messages with other processes.

    Raises ScenarioError for an unknown vehicle, and for a rule that sends no peer messages.
    """
    names = [section.name for section in scenario.vehicles]
    if vehicle is not None and vehicle not in names:
        listed = f"{', '.join(names)}{did_you_mean(vehicle, names)}"
        raise ScenarioError(f"--vehicle {vehicle}: no such vehicle; {scenario.name} has {listed}")
    if peer_messaging and not scenario.way.messages_peers:
        able = " or ".join(f'"{rule}"' for rule, way in own_ways().items() if way.messages_peers)
        raise ScenarioError(
            f"--broker requires rule = {able}; {scenario.name} has rule {scenario.planner.rule}"
        )
    formation = scenario.formation.model_copy(update={"peer_messaging": peer_messaging})
    return scenario.model_copy(update={"only": vehicle, "formation": formation})


def flying(scenario: Scenario) -> Scenario:
    """Return the scenario if vehicles can fly it; raise ScenarioError otherwise."""
    if not scenario.vehicles:
        raise ScenarioError(f"{scenario.name} has no vehicles: add one as [[vehicles]]")
    needs_ignition = scenario.planner.ignition_known and scenario.burn_flown is None
    if needs_ignition and not (scenario.ignition and scenario.ignition[0].lat_deg is not None):
        raise ScenarioError(
            f"{scenario.name}: the planner needs the fire's position: specify lat_deg and lon_deg "
            "of the first ignition, or set planner.ignition_known = false, reported_lat_deg and "
            "reported_lon_deg"
        )
    return scenario


def _in_words(error: ValidationError, kind: type[BaseModel], keys: tuple[str, ...]) -> str:
    """Return the first errors in words; ``keys`` lead to the checked table."""
    # A misspelt key comes before the missing key that it stands for.
    errors = sorted(error.errors(), key=lambda each: each["type"] != "extra_forbidden")
    schema = kind.model_json_schema()
    words = [".".join((*keys, _error_in_words(each, schema))) for each in errors[:MAX_ERRORS]]
    others = len(errors) - MAX_ERRORS
    more = [f"and {others} more"] if others > 0 else []
    return "; ".join([*dict.fromkeys(words), *more])


def _error_in_words(error: ErrorDetails, schema: dict[str, Any]) -> str:
    key = ".".join(str(part) for part in error["loc"]) or "scenario"
    value = error.get("input")
    # The value of a key with one of these names, even if misspelt, may be a secret.
    secret = re.search("key|sign|pass|pwd|secret|token|auth|cred", key, re.IGNORECASE)
    secret = secret or re.search("://[^/]*@", str(value))
    shown = "" if secret or isinstance(value, BaseModel) else got(value)
    if error["type"] == "extra_forbidden":
        *table, name = error["loc"]
        return f"{key}: unknown key{shown}{did_you_mean(str(name), keys_at(schema, table))}"
    if error["type"] in OWN_ERRORS:
        return f"{key}: {error['msg'].removeprefix('Value error, ')}{shown}"
    if error["type"] == "timezone_aware":
        return f"{key}: has no UTC offset; add it, as in 2026-08-01T12:00:00-07:00{shown}"
    if error["type"] == "missing":
        return missing_key(error["loc"], schema)
    found = schema_at(schema, error["loc"])
    return f"{key}: {error['msg'] if found is None else remedy(found, schema)}{shown}"


def apply_override(data: dict[str, Any], override: str) -> None:
    """Apply an override ``a.b.0.c=value`` (a TOML value) to a scenario dictionary."""
    key, equals, text = override.partition("=")
    if not equals:
        raise OptionError(f"--set {override}: write it as key=value, e.g. planner.alpha=1.5")
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
        raise OptionError(f"--set {override}: the scenario has no such key") from None
