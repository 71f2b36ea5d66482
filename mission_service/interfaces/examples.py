"""Provides examples for the HTTP and MQTT descriptions; tests validate each with its schema."""

from typing import Any

import msgspec

from mission_service.airspace.operational_intent import (
    EllipsoidHeight,
    IntentDetails,
    IntentExtent,
    IntentVolume,
    LatLng,
    LengthM,
    OperationalIntents,
    OutlineCircle,
    UtcTime,
    VehicleIntent,
)
from mission_service.commands import ClearedVehicle
from mission_service.fire_arrival.arrival_times import FireArrival
from mission_service.interfaces.api.models import (
    FullState,
    Importance,
    LandscapeExtent,
    MissionDifference,
    Preview,
    StatusState,
)
from mission_service.interfaces.maps.basemaps.tile_files import Basemap
from mission_service.interfaces.maps.draped_images import MapImage
from mission_service.interfaces.mqtt.payloads import (
    Aircraft,
    Alarms,
    FireArrivals,
    Reply,
    ServiceStatus,
)
from mission_service.missions.mission_figures import Figures
from mission_service.requests import HASH
from mission_service.runtime.play_head import ReplayState
from mission_service.runtime.published_states import (
    AirspaceStatus,
    Alarm,
    Announcement,
    ClearingStatus,
    ItemState,
    Mission,
    MissionState,
    NearbyAircraft,
    OrbitState,
    Record,
    SourceState,
    TelemetryState,
    VehicleState,
    VolumeState,
)

AT_US, UNIX_US = 4_215_300_000, 1_795_304_000_000_000
ACCEPTED = {"ok": True, "at_s": 4215.3, "event": "OrderGiven", "messages": ["hawk: hold, by anna"]}
PLANNER = {"rule": "islam_hu_damped", "alpha": 1.0}
TELEMETRY = TelemetryState(
    AT_US, "hawk", 36.364232, -84.140907, 561.2, 250.1, 149.8, 41.5, 17.9, 43.2
)
VEHICLE = VehicleState(
    AT_US,
    "hawk",
    "plane",
    "px4",
    1,
    36.370784,
    -84.132309,
    link="online",
    detected_stack="px4 plane",
    mode="mission",
    armed=True,
    current_seq=3,
    battery_pct=71.0,
    remote_id="ready",
    time_on_task_s=1240,
    time_home_s=185,
    time_landing_s=97,
    must_land_at_us=AT_US + 1522 * 1_000_000,
    energy_source="battery",
    relief="on task",
    direction="clockwise",
    decisions=312,
    reversals=2,
    importance_back=11.25,
    importance_front=14.5,
    front_cells=188,
    orbit=OrbitState(36.364232, -84.140907, 560.0, -90.0, 173.2),
    wind_speed_m_s=4.2,
    wind_from_deg=47.0,
    uploads_accepted=41,
)
ITEM = ItemState(16, "WAYPOINT", 5, 36.3651, -84.1402, 560.0, (0.0, 0.0, 0.0, 0.0))
MISSION = MissionState(
    AT_US,
    "hawk",
    on_board=Mission(41, 4_212_000_000, "follow the front", "accepted", "", HASH, (ITEM,)),
)
ALARM = Alarm("link/hawk", AT_US, "hawk", "severe", "hawk: link lost")
BASEMAP = Basemap(
    "county", "vector", "pmtiles", 0, 15, (-84.4, 36.2, -83.9, 36.6), "© OpenStreetMap", ("roads",)
)
RECORD = Record(18, AT_US, "", "info", "ann draws a burned area", "fire")
ANNOUNCEMENT = Announcement(17, AT_US, "hawk", "info", "turns back: importance is higher behind")
REPLAY = ReplayState(
    AT_US,
    ("flight.tlog",),
    UNIX_US,
    UNIX_US + 900_000_000,
    UNIX_US + 120_000_000,
    AT_US - 120_000_000,
    10.0,
    False,
    False,
    False,
    0,
)
SOURCE = SourceState(
    AT_US,
    "thermal_frames",
    "sensor",
    "late",
    "no observation for more than 60 s; usually one every 2 s",
    412,
    0,
    5310,
    80_112,
    AT_US - 84_000_000,
    84.0,
    2.0,
    6.5,
)
AIRCRAFT = NearbyAircraft(
    *(AT_US, "a4c2f1", "N417EA", 36.402118, -84.118402, 812.4),
    *(61.7, 214.5, -1.95, 0.62, "sbs 127.0.0.1:30003"),
    *("corrective", "hawk", 4684.0, 251.2),
)
FIRE_ARRIVAL = FireArrival(
    AT_US,
    UNIX_US,
    "person/ANDROID-0123456789abcdef",
    "Engine 3",
    "person",
    36.364201,
    -84.140913,
    position_unix_us=UNIX_US - 12_000_000,
    early_at_us=AT_US + 720_000_000,
    median_at_us=AT_US + 1_500_000_000,
    late_at_us=None,
    until_us=AT_US + 21_600_000_000,
)
STATUS = StatusState(AT_US, UNIX_US, "default", "islam_hu_damped", 7200.0, [], False)
FIRE = {
    "schema": "fire/1",
    "at_us": AT_US,
    "version": 2,
    "area_ha": 41.3,
    "wind_speed_m_s": 4.0,
    "wind_from_deg": 225.0,
    "wind_set_by": "anna",
    "corrections": [],
}
LAND = LandscapeExtent(
    (-84.26, 36.29, -84.06, 36.41),
    ((-84.26, 36.41), (-84.06, 36.41), (-84.06, 36.29), (-84.26, 36.29)),
    30.0,
    500,
    500,
)
AIRSPACE = AirspaceStatus(
    AT_US,
    [
        VolumeState(
            "helicopter",
            {
                "type": "Polygon",
                "coordinates": [
                    [[-84.141, 36.364], [-84.139, 36.366], [-84.137, 36.362], [-84.141, 36.364]]
                ],
            },
            None,
            900.0,
            3_600_000_000,
            7_200_000_000,
        )
    ],
    120.0,
    ClearingStatus(
        "",
        "ann",
        AT_US - 60_000_000,
        "in force",
        None,
        0,
        AT_US + 300_000_000,
        (
            ClearedVehicle("hawk", "on its way", "", AT_US + 380_000_000, AT_US + 300_000_000),
            ClearedVehicle("kite", "not reached", "its link is lost", None, None),
        ),
    ),
)
_CIRCLE = OutlineCircle(LatLng(36.364232, -84.140907), LengthM(411.4))
_HEIGHTS = (EllipsoidHeight(512.1), EllipsoidHeight(542.1))
_PERIOD = (UtcTime("2026-11-21T12:00:00.000Z"), UtcTime("2026-11-21T12:26:22.000Z"))
_VOLUME = IntentVolume(IntentExtent(*_HEIGHTS, outline_circle=_CIRCLE), *_PERIOD)
INTENTS = OperationalIntents(
    *(AT_US, -32.9, 60.0, 15.0, 60.0),
    [VehicleIntent("hawk", ["loiter"], IntentDetails([_VOLUME]))],
)
STATE = FullState(
    4711,
    STATUS,
    ("look", "observe", "correct", "fly", "approve"),
    "anna",
    [VEHICLE],
    [TELEMETRY],
    [MISSION],
    FIRE,
    None,
    [ALARM],
    [ANNOUNCEMENT],
    LAND,
    "islam_hu_damped",
    PLANNER,
    sources=[SOURCE],
    airspace=AIRSPACE,
    aircraft=[AIRCRAFT],
    fire_arrivals=[FIRE_ARRIVAL],
)
FIGURES = Figures(6, 2980.0, 248.0, 118.0, 36.3524, -84.1588, 842.0, 3310.0, False, [])
PREVIEW = Preview(AT_US, "hawk", HASH, (ITEM,), FIGURES, MissionDifference(2, 4, 3, 84.0))
IMPORTANCE = Importance(AT_US, "hawk", "islam_hu_damped", 81.2, 77.9, [(36.3512, -84.1603, 0.41)])
AREA = {"type": "Polygon", "coordinates": [[[-84.16, 36.35], [-84.15, 36.35], [-84.15, 36.36]]]}
FRONT = {"type": "Feature", "geometry": AREA, "properties": {"at_s": 3600.0, "in_s": 1770.0}}
FRONTS = {"type": "FeatureCollection", "features": [FRONT]}
FIRE_PREVIEW = {"burned_ha_before": 329.4, "burned_ha_after": 64.2, "front": FRONT}
FOOTPRINTS = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "geometry": AREA,
            "properties": {
                "number": 412,
                "source": "thermal_frames",
                "at_us": AT_US - 84_000_000,
                "position_sd_m": 6.5,
                "distrusted": False,
                "state": None,
                "part": "seen",
            },
        }
    ],
}
IMAGE = MapImage(
    *("thermal_frames", 37, AT_US, "hawk", "DJI_0037.tif"),
    *(36.364232, -84.140907, 2.6, 3.1, 2.0, 76.0),
    ((-84.1425, 36.3651), (-84.1392, 36.3651), (-84.1392, 36.3630), (-84.1425, 36.3630)),
    *(512, 405, ((0.0, "#000010"), (200.0, "#e0452f"), (600.0, "#fff2a8")), "°C"),
)
TRACK = {
    "type": "Feature",
    "geometry": {"type": "LineString", "coordinates": [[-84.16, 36.35, 812.4]]},
    "properties": {"vehicle": "hawk", "at_us": [1830000000]},
}
OF: dict[type, msgspec.Struct] = {
    type(each): each
    for each in (
        *(
            TELEMETRY,
            VEHICLE,
            MISSION,
            ALARM,
            ANNOUNCEMENT,
            RECORD,
            REPLAY,
            STATE,
            PREVIEW,
            IMPORTANCE,
        ),
        *(SOURCE, IMAGE, AIRSPACE, AIRCRAFT, INTENTS, FIRE_ARRIVAL, BASEMAP),
        ServiceStatus(AT_US, UNIX_US, True, "default", "islam_hu_damped", ("hawk",)),
        Alarms(AT_US, (ALARM,)),
        Aircraft(AT_US, (AIRCRAFT,)),
        FireArrivals(AT_US, (FIRE_ARRIVAL,)),
        Reply("7f3a", "hold", AT_US, True, event="OrderGiven", messages=("hawk: holds",)),
    )
}


def example_of(kind: type) -> Any:
    """Return an example of a message or a response as JSON types."""
    return msgspec.to_builtins(OF[kind])
