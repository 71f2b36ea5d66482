"""What a vehicle's client does, whichever way it speaks with the autopilot."""

from typing import Protocol

from autopilot_bridge.items import Items
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle.client_events import ClientEvent
from autopilot_bridge.vehicle.orders import Dropper
from autopilot_bridge.vehicle.transfer_queue import StartItem


class VehicleClient(Protocol):
    """One vehicle: ``NativeClient``, or ``MavsdkClient``. What comes of it are its events."""

    @property
    def stack(self) -> Stack | None:
        """The autopilot, once it was heard."""

    def upload(
        self, items: Items, now_us: int, *, begin: StartItem = "restart", holds_first: bool = False
    ) -> int:
        """Replace the mission; TransferFinished with the id tells how it went."""

    def download(self, now_us: int) -> int:
        """Read the mission."""

    def clear(self, now_us: int) -> int:
        """Remove the mission."""

    def start_mission(self, now_us: int) -> object:
        """Arm where needed and fly the mission."""

    def hold(self, now_us: int) -> object:
        """Loiter here."""

    def return_home(self, now_us: int) -> object:
        """Fly to where it took off."""

    def orbit(
        self,
        lat_deg: float,
        lon_deg: float,
        altitude_amsl_m: float,
        radius_m: float,
        now_us: int,
    ) -> object:
        """Circle a place, clockwise with a positive radius."""

    def change_speed(self, speed_m_s: float, now_us: int) -> object:
        """Airspeed of planes, ground speed of multirotors."""

    def set_return_height(self, height_m: float, now_us: int) -> object:
        """How high above home returns of a multirotor lead at least."""

    def climb_and_hold(
        self, lat_deg: float, lon_deg: float, altitude_amsl_m: float, now_us: int
    ) -> object:
        """Leave what is flown, climb at a place and hold there."""

    def drop(self, dropper: Dropper, now_us: int) -> int:
        """Let go of one thing now; DropFinished with the id tells how it went."""

    def next_event(self) -> ClientEvent | None:
        """The oldest event not handed out yet."""
