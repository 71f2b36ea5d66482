"""Find the time of an observation in the name of its file. Pure."""

import re
from datetime import UTC, datetime, tzinfo

# The form of file names in the NWCG standard for incidents (20200819_2130_Fire_HeatPerimeter.kmz),
# optionally with seconds, and with Z for UTC.
TIME_IN_NAME = re.compile(r"(?<!\d)(\d{8})[-_T ]?(\d{4})(\d\d)?(Z)?(?!\d)", re.ASCII)


def time_in_name(name: str, zone: tzinfo) -> datetime | None:
    """Return the time in a file's name, in UTC; None if the name has no date and time of day.

    ``zone`` is the time zone of times without Z.
    """
    for day, minutes, seconds, utc in TIME_IN_NAME.findall(name):
        try:
            found = datetime.fromisoformat(f"{day}T{minutes}{seconds or '00'}")
        except ValueError:
            continue
        return found.replace(tzinfo=UTC if utc else zone).astimezone(UTC)
    return None
