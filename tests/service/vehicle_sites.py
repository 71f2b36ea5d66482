"""Scenarios for the state machine of vehicles: smaller versions of the shipped ones."""

from dataclasses import dataclass
from functools import cache

from benchmarks.burn_frames import small_burn
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario, flying, load_scenario
from mission_service.fire.scenario_fire import fire_position, landscape_of
from mission_service.journal.snapshot import Known

LEVEL = ("landscape.source=flat", "landscape.elevation_m=100", "deploy_at_s=0")
BY_THE_FRONT = (
    *LEVEL,
    "landscape.lat_deg=36.364232",
    "landscape.lon_deg=-84.140907",
    "landscape.rows=80",
    "landscape.cols=80",
)
AROUND = (
    *LEVEL,
    "landscape.lat_deg=36.35",
    "landscape.lon_deg=-84.16",
    "landscape.rows=200",
    "landscape.cols=200",
    "landscape.cell_size_m=20",
    "fire.initial_cells=200",
)


@dataclass(frozen=True)
class Site:
    """A scenario that is ready to fly."""

    scenario: Scenario
    landscape: Landscape
    shared: Known
    fire_m: tuple[float, float]

    def ground_amsl_m(self, x_m: float, y_m: float) -> float:
        """Return the height of the ground at the place of the grid nearest to a position."""
        elevation_m = self.landscape.elevation_m
        assert elevation_m is not None
        row, col = (float(each) for each in self.landscape.row_col_of(x_m, y_m))
        rows, cols = elevation_m.shape
        row, col = min(max(round(row), 0), rows - 1), min(max(round(col), 0), cols - 1)
        return float(elevation_m[row, col])


@dataclass(frozen=True)
class Setting:
    """A shipped scenario, made smaller."""

    name: str
    overrides: tuple[str, ...] = ()
    vehicles: int = 1
    smaller: tuple[str, ...] = BY_THE_FRONT


SETTINGS = {
    "plane": Setting("default"),
    "ardupilot": Setting("default", ("vehicles.0.stack=ardupilot",)),
    "started by hand": Setting("default", ("vehicles.0.autostart=false",)),
    "approval": Setting("default", ("mission.approval=each",)),
    "short flights": Setting(
        "default", ("vehicles.0.endurance_s=600", "vehicles.0.stack=ardupilot")
    ),
    "team": Setting("team", ("start_s=0", "vehicles.1.stack=ardupilot"), 2),
    "team with approval": Setting("team", ("start_s=0", "mission.approval=each"), 2),
    "formation": Setting("virtual-agents", ("vehicles.1.stack=ardupilot",), 2, AROUND),
}
BURNS = {"burn": "ardupilot", "burn with px4": "px4"}  # stacks of the copter


@cache
def site_of(name: str) -> Site:
    """Return the site of a setting; it is created only once."""
    if name in BURNS:
        table = small_burn(BURNS[name]) | {"deploy_at_s": 0.0}
        scenario = Scenario.model_validate(table)
    else:
        setting = SETTINGS[name]
        scenario = flying(load_scenario(setting.name, (*setting.smaller, *setting.overrides)))
        scenario = scenario.model_copy(update={"vehicles": scenario.vehicles[: setting.vehicles]})
    landscape = landscape_of(scenario)
    if scenario.burn is None:
        fire_m = fire_position(scenario, landscape)
    else:
        assert scenario.burn.unit is not None
        fire_m = landscape.xy_of_lat_lon(*scenario.burn.unit[0])
    shared = Known(scenario, landscape)
    return Site(scenario, landscape, shared, (float(fire_m[0]), float(fire_m[1])))
