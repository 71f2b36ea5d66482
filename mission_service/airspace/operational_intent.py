"""Writes the space of a vehicle's flight as volumes of an operational intent. Pure.

The fields are those of ``OperationalIntentDetails`` in ASTM F3548-21 (its OpenAPI description):
horizontal outlines in WGS84, altitudes above the WGS84 ellipsoid, times in UTC. The service
publishes the volumes for a UTM client. The service is not a USS (UAS service supplier): it does not
negotiate operational intents.

The service computes with altitudes above mean sea level. A height above the ellipsoid is that
altitude plus the geoid height, which the caller supplies: no geoid model is installed, and without
its grids pyproj converts between the two with neither a correction nor an error.
"""

import math
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from typing import Literal, NamedTuple

import msgspec
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from firemodel.landscape.landscape import Landscape
from mission_service.airspace.occupied_space import Part

QUARTER_SEGMENTS = 8  # segments of a quarter circle in an outline
# Distances on the map differ from those on the ellipsoid by less than this factor.
SCALE_FACTOR = 1.002
COORDINATE_DIGITS = 7
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)

Purpose = Literal["climb", "leg", "loiter", "hold", "return and landing"]


class LatLng(msgspec.Struct):
    """A position in degrees (WGS84)."""

    lat: float
    lng: float


class LengthM(msgspec.Struct):
    """A length in metres."""

    value: float
    units: str = "M"


class EllipsoidHeight(msgspec.Struct):
    """A height above the WGS84 ellipsoid in metres."""

    value: float
    reference: str = "W84"
    units: str = "M"


class UtcTime(msgspec.Struct):
    """A time in UTC, such as 2026-11-28T12:00:00.000Z."""

    value: str
    format: str = "RFC3339"


class OutlineCircle(msgspec.Struct):
    """A circle on the ground."""

    center: LatLng
    radius: LengthM


class OutlinePolygon(msgspec.Struct):
    """A polygon without holes; the last vertex is connected to the first."""

    vertices: list[LatLng]


class IntentExtent(msgspec.Struct, omit_defaults=True):
    """A horizontal outline, either a circle or a polygon, between two heights."""

    altitude_lower: EllipsoidHeight
    altitude_upper: EllipsoidHeight
    outline_circle: OutlineCircle | None = None
    outline_polygon: OutlinePolygon | None = None


class IntentVolume(msgspec.Struct):
    """An extent that a vehicle may occupy in a period."""

    volume: IntentExtent
    time_start: UtcTime
    time_end: UtcTime


class IntentDetails(msgspec.Struct):
    """The details of an operational intent; ``off_nominal_volumes`` are always empty."""

    volumes: list[IntentVolume]
    off_nominal_volumes: list[IntentVolume] = []
    priority: int = 0


class VehicleIntent(msgspec.Struct):
    """The operational intent of one vehicle; ``purposes`` are those of its volumes, in order."""

    vehicle: str
    purposes: list[Purpose]
    details: IntentDetails


class OperationalIntents(msgspec.Struct, tag="operational_intents/1", tag_field="schema"):
    """The operational intents of all vehicles that fly, or have a mission with a takeoff.

    Heights are altitudes above mean sea level plus ``geoid_height_m``. All volumes contain the
    margins; the period ends ``time_margin_s`` after the last landing.
    """

    at_us: int
    geoid_height_m: float
    margin_m: float
    vertical_margin_m: float
    time_margin_s: float
    intents: list[VehicleIntent]


class IntentFrame(NamedTuple):
    """The data common to all volumes of one vehicle.

    Args:
        margin_m: Horizontal margin around the flight.
        vertical_margin_m: Margin above and below the flight.
        geoid_height_m: Height of the geoid (mean sea level) above the WGS84 ellipsoid.
        begin_unix_us: Start of the period, in microseconds since 1970.
        end_unix_us: End of the period, with its margin.
    """

    margin_m: float
    vertical_margin_m: float
    geoid_height_m: float
    begin_unix_us: int
    end_unix_us: int


class IntendedPart(NamedTuple):
    """A part of a flight, and how far the vehicle may stray from it, for instance in a hold.

    A point or a disc becomes a circle; a line becomes a polygon. A "return and landing" is an area
    of any shape, which becomes the polygon around it.
    """

    purpose: Purpose
    part: Part
    reach_m: float = 0.0


def intent_of(
    vehicle: str, flight: Iterable[IntendedPart], frame: IntentFrame, landscape: Landscape
) -> VehicleIntent:
    """Return the operational intent for a flight.

    Args:
        vehicle: Name of the vehicle.
        flight: The parts, in landscape coordinates and metres above mean sea level.
        frame: Margins, geoid and period.
        landscape: The landscape that defines the parts' coordinates.
    """
    parts = list(flight)
    volumes = [_volume(each, frame, landscape) for each in parts]
    return VehicleIntent(vehicle, [each.purpose for each in parts], IntentDetails(volumes))


def _volume(intended: IntendedPart, frame: IntentFrame, landscape: Landscape) -> IntentVolume:
    part, above_m = intended.part, frame.geoid_height_m
    distance_m = SCALE_FACTOR * (intended.reach_m + frame.margin_m)
    # Rounded outwards to decimetres.
    lowest_m = math.floor(10.0 * (part.lowest_m - frame.vertical_margin_m + above_m)) / 10.0
    highest_m = math.ceil(10.0 * (part.highest_m + frame.vertical_margin_m + above_m)) / 10.0
    extent = IntentExtent(EllipsoidHeight(lowest_m), EllipsoidHeight(highest_m))
    round_shape = part.shape.geom_type in ("Point", "Polygon")
    if round_shape and intended.purpose != "return and landing":
        extent.outline_circle = _circle(part.shape, distance_m, landscape)
    else:
        extent.outline_polygon = _polygon(part.shape, distance_m, landscape)
    return IntentVolume(extent, _time(frame.begin_unix_us), _time(frame.end_unix_us))


def _circle(shape: BaseGeometry, distance_m: float, landscape: Landscape) -> OutlineCircle:
    """Return the circle around a point or a disc."""
    centre = np.array([[shape.centroid.x, shape.centroid.y]])
    (center,) = _lat_lng(centre, landscape)
    radius_m = SCALE_FACTOR * float(shapely.minimum_bounding_radius(shape)) + distance_m
    return OutlineCircle(center, LengthM(math.ceil(10.0 * radius_m) / 10.0))


def _polygon(shape: BaseGeometry, distance_m: float, landscape: Landscape) -> OutlinePolygon:
    """Return a polygon that contains all positions within a given distance of a shape."""
    # The corners lie on circles around the shape; the polygon's sides must lie outside these
    # circles.
    outside_m = distance_m / math.cos(math.pi / (4 * QUARTER_SEGMENTS))
    area = shape.buffer(outside_m, quad_segs=QUARTER_SEGMENTS)
    ring = np.asarray(area.exterior.coords[:-1])
    return OutlinePolygon(_lat_lng(ring, landscape))


def _lat_lng(places_m: NDArray[np.float64], landscape: Landscape) -> list[LatLng]:
    lat_deg, lon_deg = landscape.lat_lon_of(places_m[:, 0], places_m[:, 1])
    digits = COORDINATE_DIGITS
    pairs = zip(np.round(lat_deg, digits), np.round(lon_deg, digits), strict=True)
    return [LatLng(float(lat), float(lon)) for lat, lon in pairs]


def _time(unix_us: int) -> UtcTime:
    at = EPOCH + timedelta(microseconds=unix_us)
    return UtcTime(at.isoformat(timespec="milliseconds").replace("+00:00", "Z"))
