"""Defines the state of one vehicle that the checks against closed airspace keep. Pure."""

from dataclasses import dataclass, field
from enum import Enum

from mission_service.airspace.occupied_space import MissionPlace, Part, Position


class Evasion(Enum):
    """What the service has ordered because of closed airspace, until another mission is flown."""

    NONE = "none"
    HOLD = "hold"  # hold before the volume
    EXIT = "exit"  # fly out of the volume and hold there
    AROUND = "around"  # fly home around the volumes


@dataclass
class AirspaceState:
    """What one vehicle flies, as far as it is reported, and its conflict with closed airspace."""

    sent: dict[int, tuple[MissionPlace, ...]] = field(default_factory=dict)  # by mission id
    on_board_id: int = 0
    on_board: tuple[MissionPlace, ...] = ()
    orbit: Part | None = None  # space of the last orbit ordered
    began_at: Position | None = None  # position at which the present mode began
    checked: tuple[object, ...] = ()  # what the last check considered
    conflict: str = ""  # the limit that the flight violates; empty without a conflict
    evasion: Evasion = Evasion.NONE
    evasion_id: int = 0  # mission of the evasion
    home_clear_version: int = -1  # version of the airspace in which the straight way home was clear
    acts_again_at_s: float = -1e9
    alarm: str = ""  # text of the alarm; empty without an alarm
    withheld: bool = False  # whether the last mission or start was not sent
