"""The requests of operators for a prescribed burn. Pure."""

from typing import Annotated, ClassVar

from msgspec import Meta

from mission_service import events
from mission_service.requests import (
    HASH,
    LINE,
    PLACE,
    Hash,
    Item,
    Latitude,
    Longitude,
    Name,
    Places,
    Radius,
    Request,
    Role,
    refuse_no_polygon,
)

Spacing = Annotated[
    Annotated[float, Meta(ge=1, le=1000)] | None, Meta(description="Spacing from now on.")
]


class BurnRequest(Request, frozen=True):
    """A request about a burn; the default role is ``approve``."""

    role: ClassVar[Role] = "approve"
    path = "/burn/{do}"
    operation = "burn_{do}"


class Plan(BurnRequest, frozen=True):
    """Plan the next ignition line."""

    makes = events.PlanRequested
    role = "fly"
    example: ClassVar = {"line_spacing_m": 20.0, "drop_spacing_m": 15.0}

    line_spacing_m: Spacing = None
    drop_spacing_m: Spacing = None


class HashRequest(BurnRequest, frozen=True):
    """A request about the proposed plan that has a given hash."""

    example: ClassVar = {"hash": HASH}

    hash: Hash


class Approve(HashRequest, frozen=True):
    """Approve exactly the plan with this hash."""

    makes = events.Approved
    over_mqtt = False


class Reject(HashRequest, frozen=True):
    """Reject the plan with this hash: the plan is not flown."""

    makes = events.Rejected


class Go(BurnRequest, frozen=True):
    """Set an item of the GO/NO-GO checklist to GO."""

    over_mqtt = False
    example: ClassVar = {"item": "weather is within the prescription"}
    go: ClassVar = True

    item: Item

    def event(self, at_us: int) -> events.AnyOperatorEvent:
        """Return a ``ChecklistAnswered`` event."""
        return events.ChecklistAnswered(*self.user(at_us), self.item, self.go)


class NoGo(Go, frozen=True, tag="no-go"):
    """Set an item to NO-GO: no drop until the item is GO and a plan is approved again."""

    over_mqtt = True
    go: ClassVar = False


class Person(BurnRequest, frozen=True):
    """Report a person: no drop or low flight within the radius. Radius 0: the person has left."""

    role = "correct"
    example: ClassVar = {"name": "crew 2", **PLACE, "radius_m": 100.0}

    name: Name
    lat_deg: Latitude
    lon_deg: Longitude
    radius_m: Annotated[Radius, Meta(description="Radius to keep clear; 0: the person has left.")]

    def event(self, at_us: int) -> events.AnyOperatorEvent:
        """Return a ``PersonReported`` event."""
        place = (self.lat_deg, self.lon_deg)
        return events.PersonReported(*self.user(at_us), self.name.strip(), *place, self.radius_m)


class Unit(BurnRequest, frozen=True):
    """Change the burn unit to the polygon of these corners."""

    makes = events.BurnUnitSet
    example: ClassVar = {"points": [*LINE, [36.3661, -84.1409]]}

    points: Places

    def event(self, at_us: int) -> events.AnyOperatorEvent:
        """Return a ``BurnUnitSet`` event. Raises RequestError if the corners form no polygon."""
        refuse_no_polygon("unit", self.points)
        return super().event(at_us)


REQUESTS = (Plan, Approve, Reject, Go, NoGo, Person, Unit)
