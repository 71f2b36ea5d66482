"""The core beside a logged flight: what vehicles would have seen, what would have been decided.

The log's vehicles stand where those of a live run are on their links (``logged_vehicle.py``). All
else is the live run: camera, core, journal, picture. So the shadow of a flight leaves a journal
that can be verified, and interfaces show it as they show a run.
"""

import heapq
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from autopilot_bridge import client_events as bridge
from firemodel.landscape import Landscape
from mission_service.config import Scenario
from mission_service.config_sections import VehicleSection
from mission_service.core import Core
from mission_service.errors import FlightError
from mission_service.events import CrewEvent, Lit
from mission_service.flights.flown import Flown
from mission_service.flights.instants import unix_us
from mission_service.flights.journal_log import JournalLog
from mission_service.flights.logged_vehicle import LoggedVehicle
from mission_service.flights.played import Flight, Played, Survey
from mission_service.gateway import Gateway, MissionClock
from mission_service.journal import Journal
from mission_service.picture import Picture
from mission_service.record import Record
from mission_service.service import OF_FIRE, Service
from mission_service.watchman import Watchman
from mission_service.world import world_of

Told = Played | CrewEvent
Listener = Callable[[Told], None]


class Mission(NamedTuple):
    """Which mission time a moment of the log is."""

    begin_us: int  # of the log's clock
    start_us: int  # the mission time of it

    def of(self, log_us: int) -> int:
        """Mission time of a time of the log's."""
        return self.start_us + log_us - self.begin_us

    def log_us(self, mission_us: int) -> int:
        """The time of the log's of a mission time."""
        return self.begin_us + mission_us - self.start_us


def mission_time(
    flight: Flight, survey: Survey, scenario: Scenario, at_s: float | None = None
) -> Mission:
    """When on the fire's clock a flight begins: ``at_s``, if that is given; else by the calendar,
    if log and scenario both know it; else when the scenario's vehicles would take off.

    Journals are on mission time. Raises FlightError for a flight before the fire's clock starts.
    """
    begin_us, zero = survey.begin_us, scenario.time_zero
    if at_s is not None:
        return Mission(begin_us, round(at_s * 1e6))
    if isinstance(flight.logs[0], JournalLog):
        return Mission(begin_us, begin_us)
    if zero is None or flight.offset_us is None:
        return Mission(begin_us, round(max(scenario.start_s, scenario.deploy_at_s) * 1e6))
    start_us = begin_us + flight.offset_us - unix_us(zero)
    if not 0 <= start_us < round(scenario.duration_s * 1e6):
        raise FlightError(
            f"the flight begins {start_us / 3.6e9:+.1f} h after time_zero of {scenario.name}, and "
            f"the fire burns for {scenario.duration_s / 3600:.1f} h; say with --at when it begins, "
            "in seconds of mission time"
        )
    return Mission(begin_us, start_us)


def scenario_for(scenario: Scenario, survey: Survey, mission: Mission) -> Scenario:
    """The scenario with the vehicles that flew: stacks and homes are theirs, all else its own.

    A vehicle is the one of the same name, else of the same system id, else the next one that is
    left; beyond those it is as the last. Nobody has to accept missions, and nobody is sent home.
    """
    left = list(scenario.vehicles)
    taken: dict[str, VehicleSection] = {}
    for name, flown in survey.flown.items():
        same = [each for each in left if each.name == name]
        same += [each for each in left if each.system_id == flown.system_id]
        like = (same or left or list(scenario.vehicles))[:1]
        if not like:
            raise FlightError(f"{scenario.name} has no vehicles: add one as [[vehicles]]")
        if like[0] in left:
            left.remove(like[0])
        taken[name] = like[0]
    end_s = mission.of(survey.end_us) / 1e6 + 1.0
    return scenario.model_copy(
        update={
            "vehicles": tuple(_as_flown(taken[name], survey.flown[name]) for name in taken),
            "only": None,
            "duration_s": max(scenario.duration_s, end_s),
            "start_s": mission.start_us / 1e6,
            "deploy_at_s": 0.0,
            "mission": scenario.mission.model_copy(update={"approval": "none"}),
        }
    )


def _as_flown(section: VehicleSection, flown: Flown) -> VehicleSection:
    told: dict[str, object] = {"name": flown.name, "endurance_s": None}
    if flown.stack is not None:
        told |= {"stack": flown.stack.name, "kind": flown.stack.vehicle}
    if flown.home is not None:
        told |= {"home_lat_deg": flown.home[0], "home_lon_deg": flown.home[1]}
    return section.model_copy(update=told)


def check_place(survey: Survey, landscape: Landscape, name: str) -> None:
    """Raise FlightError if the flight was nowhere on the landscape."""
    for flown in survey.flown.values():
        for _, lat_deg, lon_deg, _ in flown.track:
            if landscape.contains(*landscape.xy_of_lat_lon(lat_deg, lon_deg)):
                return
    places = [flown.home for flown in survey.flown.values() if flown.home is not None]
    here = "the logs have no position"
    if places:
        here = f"the flight began at lat {places[0][0]:.5f}, lon {places[0][1]:.5f}"
    rows, cols = landscape.shape
    lat, lon = landscape.lat_lon_of(*landscape.xy_of(rows / 2, cols / 2))
    raise FlightError(
        f"no position is on the landscape of {name}, which is around lat {float(lat):.5f}, lon "
        f"{float(lon):.5f}: {here}"
    )


def told_in(flight: Flight, mission: Mission, from_us: int, to_us: int) -> Iterator[Told]:
    """What a flight tells between two times of its clock, with what people said of the fire.

    Of before it tells what holds then: who was heard, in which mode, what people had said.
    """
    log = flight.logs[0]
    people: list[CrewEvent] = []
    if isinstance(log, JournalLog):
        people = [each for each in log.crew() if isinstance(each, (*OF_FIRE, Lit))]
    on_clock = ((mission.log_us(each.at_us), each) for each in people)
    vehicles = ((each.at_us, each) for each in flight.played())
    streams: list[Iterable[tuple[int, Told]]] = [on_clock, vehicles]
    for at_us, told in heapq.merge(*streams, key=lambda each: each[0]):
        if at_us > to_us:
            return
        moves = isinstance(told, Played) and isinstance(told.event, bridge.Position)
        if at_us >= from_us or not moves:
            yield told


NEVER_LATE_US = 1 << 62  # nobody waits for a log


class Shadow:
    """The service of a scenario whose vehicles are those of a flight."""

    def __init__(
        self,
        scenario: Scenario,
        landscape: Landscape,
        journal: Journal,
        mission: Mission,
        picture: Picture | None = None,
        kept: dict[str, Any] | None = None,
    ) -> None:
        """``scenario`` has the vehicles of the flight (``scenario_for``).

        With what another has ``kept`` it goes on from there; these objects are its own then.
        """
        self.mission = mission
        begun = kept or _begun(scenario, landscape, mission, picture)
        self.clock: MissionClock = begun["clock"]
        self.vehicles: dict[str, LoggedVehicle] = begun["vehicles"]
        self.gateways: dict[str, Gateway] = begun["gateways"]
        self._watchman: Watchman | None = begun["watchman"]
        self.service = Service(
            scenario,
            begun["core"],
            begun["world"],
            journal,
            begun["record"],
            self.gateways,
            picture=begun["picture"],
        )
        if kept is not None:
            self.service.restore(kept)

    def kept(self) -> dict[str, Any]:
        """All that there is to know beside the scenario, to be copied."""
        return {
            "clock": self.clock,
            "vehicles": self.vehicles,
            "gateways": self.gateways,
            "watchman": self._watchman,
            **self.service.kept(),
        }

    def take(self, told: Told) -> None:
        """Take in what the flight tells next."""
        if not isinstance(told, Played):
            self.service.tell(told, told.at_us)
            return
        self.vehicles[told.vehicle].take(told.event)
        self.service.take(self.gateways[told.vehicle].events(told.at_us), told.at_us)
        if self._watchman is not None:
            self._watchman.look(told.at_us)


def _begun(
    scenario: Scenario, landscape: Landscape, mission: Mission, picture: Picture | None
) -> dict[str, Any]:
    clock = MissionClock(mission.start_us, wall=True)
    clock.go_on(mission.start_us, mission.begin_us)
    vehicles = {section.name: LoggedVehicle() for section in scenario.vehicles}
    world = world_of(scenario, landscape)
    world.advance(mission.start_us)
    watchman = None
    if picture is not None:
        watchman = Watchman(picture, scenario.mission.separation_m, NEVER_LATE_US)
    return {
        "clock": clock,
        "vehicles": vehicles,
        "gateways": {name: Gateway(name, vehicle, clock) for name, vehicle in vehicles.items()},
        "watchman": watchman,
        "core": Core(scenario, landscape),
        "world": world,
        "record": Record(tuple(vehicles), mission.start_us),
        "picture": picture,
    }


def journal_path(out: Path) -> Path:
    """Where the shadow of a flight leaves its journal."""
    return out / "journal.jsonl"
