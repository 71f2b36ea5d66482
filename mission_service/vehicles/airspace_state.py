"""Defines the per-vehicle state of the checks against closed airspace. Pure."""

from dataclasses import dataclass, field
from enum import Enum

from mission_service.airspace.occupied_space import MissionPlace, Part, Position
from mission_service.commands import AnyCommand, RaiseAlarm, Severity
from mission_service.vehicles.vehicle_state import Vehicle

Places = tuple[MissionPlace, ...]
AIRSPACE = "airspace"  # name of the alarm


class Evasion(Enum):
    """The order given because of closed airspace or terrain, until another mission is flown."""

    NONE = "none"
    HOLD = "hold"  # hold short of the obstacle
    EXIT = "exit"  # fly out of the volume and hold there
    AROUND = "around"  # fly home around volumes, or above the ground


@dataclass
class AirspaceState:
    """The reported flight of one vehicle, and its conflict with closed airspace."""

    # The positions of the missions that were sent, and of their landings, by mission id.
    sent: dict[int, tuple[Places, Places]] = field(default_factory=dict)
    on_board_id: int = 0
    on_board: Places = ()
    landing: Places = ()  # after DO_LAND_START in the mission on board
    orbit: Part | None = None  # space of the last ordered orbit
    began_at: Position | None = None  # position where the current mode began
    checked: tuple[object, ...] = ()  # the inputs of the last check
    conflict: str = ""  # the limit that the flight violates; empty without a conflict
    evasion: Evasion = Evasion.NONE
    evasion_id: int = 0  # mission id of the evasion
    failed_ways_home: int = 0  # consecutive missions home that were not accepted
    home_clear_version: int = -1  # airspace version in which the straight way home was clear
    acts_again_at_s: float = -1e9
    return_sent_s: float = -1e9  # time of the last order to return
    alarm: str = ""  # text of the alarm; empty without an alarm
    withheld: bool = False  # whether the last mission or start was not sent


def raised(
    vehicle: Vehicle, state: AirspaceState, words: str, severity: Severity = "warning"
) -> list[AnyCommand]:
    """Raise the alarm of a vehicle; return no command if it already has this text."""
    if words == state.alarm:
        return []
    state.alarm = words
    return [RaiseAlarm(vehicle.name, AIRSPACE, words, severity)]
