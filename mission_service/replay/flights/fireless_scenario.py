"""A scenario for a flight that comes without one: level ground, on which nothing burns.

A scenario has to burn somewhere, so a corner far away is lit a month after the flight. Vehicles
are sent to a fire when they are deployed, and here that is after the flight too: nothing is
decided, and what is seen is what flew.
"""

import math
from datetime import timedelta

from mission_service.config.scenario import Scenario
from mission_service.config.sections import (
    Ignition,
    LandscapeSection,
    PlannerSection,
    VehicleSection,
    WeatherEntry,
)
from mission_service.errors import FlightError
from mission_service.ground_distance import M_PER_DEG
from mission_service.replay.flights.flight_logs import Survey
from mission_service.replay.flights.utc_time import EPOCH

AROUND_M = 2000.0
CELL_M, MOST_CELLS = 30.0, 600
CORNER = 0.45  # of height and width from the middle
LONG_AFTER_S = 30 * 86_400.0


def fireless_scenario(survey: Survey, name: str) -> Scenario:
    """Level ground around all that flew. Mission time 0 is the flight's begin.

    Raises FlightError if the logs have no positions, or are where no map is.
    """
    places = [place for flown in survey.flown.values() for place in flown.track]
    if not places:
        raise FlightError("the logs have no position; give a --scenario")
    south, north = min(place[1] for place in places), max(place[1] for place in places)
    west, east = min(place[2] for place in places), max(place[2] for place in places)
    lat_deg, lon_deg = (south + north) / 2.0, (west + east) / 2.0
    if not -80.0 <= lat_deg <= 84.0:
        raise FlightError(f"no map is made around lat {lat_deg:.3f}; give a --scenario")
    lon_m = M_PER_DEG * math.cos(math.radians(lat_deg))
    high_m = M_PER_DEG * (north - south) + 2.0 * AROUND_M
    wide_m = lon_m * (east - west) + 2.0 * AROUND_M
    cell_m = max(CELL_M, max(high_m, wide_m) / MOST_CELLS)
    rows, cols = math.ceil(high_m / cell_m), math.ceil(wide_m / cell_m)
    homes = [flown.home[2] for flown in survey.flown.values() if flown.home is not None]
    length_s = (survey.end_us - survey.zero_us) / 1e6
    # Half a cell inside; the grid may be turned against north by a few degrees.
    inside = 0.45
    corner = (
        lat_deg + inside * rows * cell_m / M_PER_DEG,
        lon_deg - inside * cols * cell_m / lon_m,
    )
    zero = None
    if survey.offset_us is not None:
        zero = EPOCH + timedelta(microseconds=survey.zero_us + survey.offset_us)
    return Scenario(
        name=name,
        time_zero=zero,
        duration_s=length_s + 1.0,
        deploy_at_s=length_s + LONG_AFTER_S,
        landscape=LandscapeSection(
            source="flat",
            rows=rows,
            cols=cols,
            cell_size_m=cell_m,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            elevation_m=min(max(min(homes), -500.0), 9000.0),
        ),
        ignition=(Ignition(lat_deg=corner[0], lon_deg=corner[1], at_s=length_s + LONG_AFTER_S),),
        weather=(WeatherEntry(at_s=0.0, wind_speed_m_s=0.0, wind_from_deg=0.0),),
        planner=PlannerSection(),
        vehicles=(VehicleSection(name="any", home_lat_deg=lat_deg, home_lon_deg=lon_deg),),
    )
