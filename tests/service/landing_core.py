"""Vehicles of a core without links for tests of landings: their reports and their answers."""

from typing import TypeVar

from firemodel.landscape.landscape import Landscape
from mission_service.commands import Announce, AnyCommand, RaiseAlarm, ShowLanding, UploadMission
from mission_service.config.scenario import load_scenario
from mission_service.core.core import Core
from mission_service.events import (
    AnyEvent,
    CommandFinished,
    MissionProgress,
    ModeChanged,
    Order,
    OrderGiven,
    Telemetry,
    UploadFinished,
    VehicleConnected,
)

Command = TypeVar("Command", bound=AnyCommand)
CRUISE_M, AWAY_DEG = 150.0, 0.0134  # 1,200 m west of home


class Vehicles:
    """The vehicles of the scenario ``demo`` in the air, in their missions."""

    def __init__(self, land: Landscape, *overrides: str, count: int = 1) -> None:
        loaded = load_scenario("demo", overrides)
        flown = loaded.vehicles[:count]
        self.scenario = loaded.model_copy(update={"vehicles": flown})
        self.core = Core(self.scenario, land)
        self.land = land
        self.at_s = self.scenario.deploy_at_s
        self.sent: list[AnyCommand] = []
        for each in flown:
            self.handle(VehicleConnected(self.at_us, each.name, "a stack", each.stack == "px4"))
            self.mode("hold", each.name, armed=False)
            self.at(0.0, each.name)
            self.mode("mission", each.name)
            self.at(CRUISE_M, each.name)
            self.answer_uploads()

    @property
    def at_us(self) -> int:
        return round(self.at_s * 1e6)

    def handle(self, event: AnyEvent) -> list[AnyCommand]:
        commands = self.core.handle(event)
        self.core.validate_state()
        self.sent += commands
        return commands

    def answer_uploads(self, outcome: str = "accepted") -> list[AnyCommand]:
        """Finish the newest upload of each vehicle; return the commands that follow."""
        commands: list[AnyCommand] = []
        for name, vehicle in self.core.vehicles.items():
            if vehicle.pending is not None:
                mission_id = vehicle.pending.mission_id
                done = UploadFinished(self.at_us, name, mission_id, outcome, "because")
                commands += self.handle(done)
        return commands

    def at(
        self,
        height_m: float,
        name: str = "hawk",
        later_s: float = 1.0,
        away_deg: float | None = None,
    ) -> list[AnyCommand]:
        """Report a position: on the ground at home, in the air west of home."""
        self.at_s += later_s
        if away_deg is None:
            away_deg = AWAY_DEG if height_m > 0.0 else 0.0
        home = self.core.vehicles[name].section
        place = (home.home_lat_deg, home.home_lon_deg - away_deg)
        height = (self.home_amsl_m(name) + height_m, height_m)
        return self.handle(Telemetry(self.at_us, name, *place, *height, 0.0, 12.0, 0.0))

    def home_amsl_m(self, name: str = "hawk") -> float:
        return float(self.land.elevation_at(*self.core.vehicles[name].home_m))

    def mode(self, mode: str, name: str = "hawk", armed: bool = True) -> list[AnyCommand]:
        return self.handle(ModeChanged(self.at_us, name, 0, armed, mode))

    def order(self, order: Order, name: str = "hawk", confirmed: bool = False) -> list[AnyCommand]:
        return self.handle(OrderGiven(self.at_us, "ann", "", name, order, confirmed))

    def answer(self, command: str, accepted: bool = True, name: str = "hawk") -> list[AnyCommand]:
        return self.handle(CommandFinished(self.at_us, name, command, accepted, "not now"))

    def progress(self, seq: int, name: str = "hawk") -> list[AnyCommand]:
        return self.handle(MissionProgress(self.at_us, name, seq))

    def phase(self, name: str = "hawk") -> str:
        return self.core.vehicles[name].landing_state.shown

    def approaches(self, name: str = "hawk") -> None:
        """Let a vehicle be ordered to land, accept the mission and fly to the approach."""
        self.order("land", name)
        self.answer_uploads()
        self.mode("mission", name)
        self.at(CRUISE_M, name)
        assert self.phase(name) == "approach"

    def is_on_last_leg(self, name: str = "hawk") -> None:
        """Let a vehicle fly a landing until it is 20 m high, 300 m from home."""
        self.approaches(name)
        mission = self.core.vehicles[name].landing_state.mission
        assert mission is not None
        self.progress(mission.final_seq, name)
        self.at(20.0, name, away_deg=0.003)
        assert self.phase(name) == "final"


def every(commands: list[AnyCommand], kind: type[Command]) -> list[Command]:
    """Return the commands of one type."""
    return [each for each in commands if isinstance(each, kind)]


def landing_uploads(commands: list[AnyCommand]) -> list[UploadMission]:
    """Return the uploads of missions that land."""
    return [each for each in every(commands, UploadMission) if each.lands]


def shown(commands: list[AnyCommand]) -> list[str]:
    """Return the phases of landings that commands show."""
    return [each.phase for each in every(commands, ShowLanding)]


def texts(commands: list[AnyCommand]) -> str:
    """Return the announcements as one text."""
    return "\n".join(each.text for each in every(commands, Announce))


def alarms(commands: list[AnyCommand]) -> list[str]:
    """Return the kinds of the alarms that commands raise."""
    return [each.alarm for each in every(commands, RaiseAlarm)]
