"""Finds the time zone of a landscape."""

from zoneinfo import ZoneInfo

from firemodel.landscape.landscape import Landscape


def time_zone_of(landscape: Landscape) -> ZoneInfo | None:
    """Return the time zone at the centre of a landscape, or None if no zone is defined there."""
    from tzfpy import get_tz

    lat, lon = landscape.centre_lat_lon
    name = get_tz(lon, lat)
    return ZoneInfo(name) if name else None
