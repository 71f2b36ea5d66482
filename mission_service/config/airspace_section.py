"""Defines the table ``[airspace]``: closed volumes, altitude limit and margins of a run."""

from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from mission_service.config.section_base import (
    Finite,
    Latitude,
    Line,
    Longitude,
    NotNegative,
    Positive,
    Section,
)


class AreaSection(Section):
    """An area: a polygon with ``corners`` (lat, lon), or a circle."""

    name: Annotated[Line, Field(min_length=1, max_length=80)]
    corners: Annotated[tuple[tuple[Latitude, Longitude], ...], Field(min_length=3)] | None = None
    lat_deg: Latitude | None = None
    lon_deg: Longitude | None = None
    radius_m: Annotated[float, Field(gt=0, le=1_000_000)] | None = None

    @model_validator(mode="after")
    def _one_outline(self) -> "AreaSection":
        circle = (self.lat_deg, self.lon_deg, self.radius_m)
        given = [value is not None for value in circle]
        if any(given) != all(given) or any(given) == (self.corners is not None):
            raise ValueError("specify either `corners`, or lat_deg, lon_deg and radius_m")
        return self


class ClosedVolume(AreaSection):
    """A volume that no vehicle may enter from ``from_s`` to ``until_s`` (mission time).

    Without a floor the volume begins at the ground, and without a ceiling it has no upper limit.
    """

    floor_amsl_m: Finite | None = None
    floor_agl_m: Finite | None = None
    ceiling_amsl_m: Finite | None = None
    ceiling_agl_m: Finite | None = None
    from_s: NotNegative = 0.0
    until_s: Positive | None = None

    @model_validator(mode="after")
    def _consistent(self) -> "ClosedVolume":
        for low, high in (("floor_amsl_m", "floor_agl_m"), ("ceiling_amsl_m", "ceiling_agl_m")):
            if getattr(self, low) is not None and getattr(self, high) is not None:
                raise ValueError(f"specify only one of {low} and {high}")
        for reference in ("amsl", "agl"):
            floor_m = getattr(self, f"floor_{reference}_m")
            ceiling_m = getattr(self, f"ceiling_{reference}_m")
            if floor_m is not None and ceiling_m is not None and floor_m >= ceiling_m:
                raise ValueError(f"ceiling_{reference}_m must be above floor_{reference}_m")
        if self.until_s is not None and self.until_s <= self.from_s:
            raise ValueError("until_s must be later than from_s")
        return self


class AirspaceSection(Section):
    """The airspace in which the vehicles may fly.

    ``closed`` are volumes that no vehicle may enter, as are the volumes in ``files`` (GeoJSON, KML,
    OpenAir). Vehicles stay inside the union of the ``allowed`` areas, if there are any, and below
    ``max_altitude_agl_m``. Missions keep the horizontal distance ``margin_m`` or the vertical
    distance ``vertical_margin_m`` from closed volumes. A volume counts as closed ``lead_s`` before
    ``from_s``.
    """

    files: tuple[Path, ...] = ()
    closed: tuple[ClosedVolume, ...] = ()
    allowed: tuple[AreaSection, ...] = ()
    max_altitude_agl_m: Positive | None = None
    margin_m: Annotated[float, Field(ge=0, le=10_000)] = 60.0
    vertical_margin_m: Annotated[float, Field(ge=0, le=10_000)] = 15.0
    lead_s: NotNegative = 60.0

    @model_validator(mode="after")
    def _different_names(self) -> "AirspaceSection":
        names = [volume.name for volume in self.closed]
        if len(set(names)) != len(names):
            raise ValueError("closed volumes must have different names")
        return self
