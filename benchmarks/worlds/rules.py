"""The data of the checker of random worlds: the rules of a scenario, and the flights so far."""

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from benchmarks.worlds.ground import Place, Terrain, plane_m
from benchmarks.worlds.outlines import Closed

Line = dict[str, Any]

ROUNDING_M = 2.0  # of positions, and of the service's projection

GOING_HOME = ("return", "land")  # modes

Position = tuple[float, float, float]  # east, north, altitude above mean sea level, in metres


class Kind(NamedTuple):
    """The properties of a vehicle of the scenario that the checker uses."""

    plane: bool
    airspeed_m_s: float
    turn_radius_m: float
    loiter_radius_m: float
    height_m: float  # planned height above the ground
    home: Position


@dataclass
class Rules:
    """The rules with which the flights of a world must comply."""

    closed: list[Closed]
    margin_m: float
    vertical_margin_m: float
    max_height_m: float | None
    descends_to_m: float
    kinds: dict[str, Kind]
    wind_m_s: Place  # velocity of the air, east and north
    terrain: Terrain


@dataclass
class Visit:
    """The record of the checker about one vehicle and one volume."""

    free: bool = False  # whether the vehicle has had the time to stay outside
    since_s: float = -math.inf  # time at which the vehicle was first inside, or led again
    may_stay_s: float = math.inf
    answered: bool = False  # whether a command that follows was found, or its lack was reported
    inside: bool = False


@dataclass
class Flown:
    """What the checker keeps of one vehicle."""

    position: Position | None = None
    velocity_m_s: Place = (0.0, 0.0)
    airborne: bool = False  # whether the vehicle is too high to take off or land
    in_air: bool = False  # whether the vehicle has taken off, and has not touched the ground since
    led: bool = True
    mode: str = ""
    lands: bool = False  # whether the mission on board only lands
    landing: str = "none"
    sent: dict[int, Line] = field(default_factory=dict)
    on_board: Line | None = None
    low_until_s: float = math.inf  # a start from the ground or a low hold ends
    commanded_s: float = -math.inf  # time of the last command that changes the flight
    leaves: bool = False  # whether that command was a mission out of, or around, closed airspace
    visits: dict[str, Visit] = field(default_factory=dict)

    @property
    def comes_down(self) -> bool:
        """Whether the vehicle returns or lands."""
        return self.mode in GOING_HOME or self.landing != "none"

    @property
    def start(self) -> Position | None:
        """The position where a mission would begin in the air; None if it would be a takeoff.

        A vehicle that is low in a return or a landing counts as on the ground.
        """
        flies = self.airborne or (self.in_air and not self.comes_down)
        return self.position if flies else None


def rules_of(scenario: Line, terrain: Terrain) -> Rules:
    """Return the rules for a scenario, as a dictionary, on a terrain."""
    airspace = scenario["airspace"]
    weather = scenario["weather"][0]
    towards = math.radians(weather["wind_from_deg"] + 180.0)
    wind_m_s = weather["wind_speed_m_s"]
    surveillance = scenario.get("surveillance") or {}
    return Rules(
        _volumes(airspace),
        airspace["margin_m"],
        airspace["vertical_margin_m"],
        airspace["max_altitude_agl_m"],
        surveillance.get("descend_to_agl_m", 0.0),
        {vehicle["name"]: _kind(vehicle, terrain) for vehicle in scenario["vehicles"]},
        (wind_m_s * math.sin(towards), wind_m_s * math.cos(towards)),
        terrain,
    )


def _kind(vehicle: Line, terrain: Terrain) -> Kind:
    east_m, north_m = plane_m(vehicle["home_lat_deg"], vehicle["home_lon_deg"])
    return Kind(
        vehicle["kind"] != "copter",
        vehicle["airspeed_m_s"],
        vehicle["turn_radius_m"],
        vehicle["loiter_radius_m"],
        vehicle["altitude_agl_m"],
        (east_m, north_m, float(terrain.ground_m(east_m, north_m))),
    )


def _volumes(airspace: Line) -> list[Closed]:
    found = []
    for entry in airspace["closed"]:
        volume = limited(Closed(entry["name"], corners_of(entry)), entry)
        volume.from_s = entry["from_s"]
        volume.known_s = entry["from_s"] - airspace["lead_s"]
        volume.until_s = math.inf if entry["until_s"] is None else entry["until_s"]
        found.append(volume)
    for entry in airspace["allowed"]:
        found.append(Closed("outside " + entry["name"], corners_of(entry), inverted=True))
    return found


def corners_of(entry: Line) -> list[Place]:
    """Return the corners of an entry, in metres."""
    return [plane_m(*corner) for corner in entry["corners"]]


def limited(volume: Closed, entry: Line) -> Closed:
    """Return the volume with the limits of an entry."""
    for reference in ("amsl", "agl"):
        floor_m, ceiling_m = entry.get(f"floor_{reference}_m"), entry.get(f"ceiling_{reference}_m")
        if floor_m is not None:
            volume.floor_m, volume.floor_agl = floor_m, reference == "agl"
        if ceiling_m is not None:
            volume.ceiling_m, volume.ceiling_agl = ceiling_m, reference == "agl"
    return volume
