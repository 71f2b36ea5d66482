"""The closed volumes of a run, which operators close and open in flight. Pure."""

import math
from collections.abc import Iterable

from firemodel.landscape.landscape import Landscape
from mission_service import events
from mission_service.airspace.clearance import Airspace, Margins, blocked_area
from mission_service.airspace.routes import Detours
from mission_service.airspace.volumes import Volume, polygon_of, volumes_of
from mission_service.commands import REJECTED
from mission_service.config.airspace_section import AirspaceSection
from mission_service.config.sections import VehicleSection
from mission_service.errors import ScenarioError


class ClosedAirspace:
    """The volumes of a run; ``version`` increases whenever a volume closes or opens."""

    def __init__(self, section: AirspaceSection, landscape: Landscape) -> None:
        """Read the scenario's volumes. Raises ScenarioError for a file that cannot be read."""
        self.volumes: tuple[Volume, ...] = volumes_of(section, landscape)
        self.version = 0
        self._lead_s = section.lead_s
        self._margins = Margins(section.margin_m, section.vertical_margin_m)
        self._max_agl_m = section.max_altitude_agl_m
        self._landscape = landscape
        self._airspace = Airspace((), self._margins, self._max_agl_m)
        self._detours: dict[tuple[str, ...], Detours] = {}

    def close(self, event: events.AirspaceClosed) -> str:
        """Close a volume; return the announcement of this, or of the request's refusal."""
        at_s = event.at_us / 1e6
        left = tuple(volume for volume in self.volumes if at_s < volume.until_s)
        if any(volume.name == event.name for volume in left):
            exists = f"a closed volume {event.name!r} already exists"
            return f"{REJECTED} {exists}: open it first, or choose another name"
        try:
            area_m = polygon_of(event.name, event.corners, self._landscape)
        except ScenarioError as error:
            return f"{REJECTED} {error}"
        floor_m = -math.inf if event.floor_amsl_m is None else event.floor_amsl_m
        ceiling_m = math.inf if event.ceiling_amsl_m is None else event.ceiling_amsl_m
        until_s = math.inf if event.for_s is None else at_s + event.for_s
        volume = Volume(event.name, area_m, floor_m, ceiling_m, at_s, until_s)
        self.volumes = (*left, volume)  # without volumes whose closure has expired
        return f"airspace {event.name!r} closed by {event.by}"

    def open(self, event: events.AirspaceOpened) -> str:
        """Open a volume; return the announcement of this, or of the request's refusal."""
        left = tuple(volume for volume in self.volumes if volume.name != event.name)
        if len(left) == len(self.volumes):
            names = ", ".join(repr(volume.name) for volume in self.volumes) or "none"
            return f"{REJECTED} no closed volume {event.name!r}; closed volumes: {names}"
        self.volumes = left
        return f"airspace {event.name!r} opened by {event.by}"

    def at(self, at_s: float) -> Airspace:
        """Return the airspace at a mission time; volumes count as closed ``lead_s`` in advance."""
        closed = tuple([each for each in self.volumes if each.is_closed(at_s, self._lead_s)])
        if closed != self._airspace.volumes:
            self._airspace = Airspace(closed, self._margins, self._max_agl_m)
            self._detours = {}
            self.version += 1
        return self._airspace

    def detours(self, volumes: Iterable[Volume], section: VehicleSection, factor: float) -> Detours:
        """Return a vehicle's ways around closed volumes; they are computed once per selection.

        ``factor`` multiplies the distance that the ways keep in addition to the margins.
        """
        volumes = tuple(volumes)
        extra_m = factor * (section.turn_radius_m / 2.0 if section.winged else 10.0)
        key = (*(volume.name for volume in volumes), f"{extra_m:g}")
        if key not in self._detours:
            area = blocked_area(volumes, self._margins.horizontal_m + extra_m)
            self._detours[key] = Detours(area)
        return self._detours[key]
