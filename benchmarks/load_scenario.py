"""The scenario of ``load.py``, ``soak.py`` and ``weeks.py``: many planes around one large fire."""

import math
import os
from dataclasses import dataclass

FIRE = (36.372, -84.125)
LAYERS = 8  # of 40 m: with more, the highest would see nothing of the fire's edge
M_PER_DEG = 111_195.0
# Below what systems give to sockets that ask for any: the mocks' own would be in the way.
FIRST_PORT = 20_000 + os.getpid() % 90 * 100

HEAD = """\
name = "load"
seed = 1
duration_s = {end_s}
start_s = {start_s}
deploy_at_s = {start_s}

[landscape]
source = "jacksboro"
rows = {cells}
cols = {cells}
cell_size_m = {cell_m}

[fire]
scheme = "anyangle"

[[ignition]]
lat_deg = {lat}
lon_deg = {lon}

[[weather]]
at_s = 0
wind_speed_m_s = {wind_speed_m_s}
wind_from_deg = 45
dead_1h_pct = {dead_1h_pct}
dead_10h_pct = {dead_10h_pct}
dead_100h_pct = {dead_100h_pct}
live_herb_pct = 60
live_woody_pct = 80

[planner]
rule = "{rule}"
"""

VEHICLE = """
[[vehicles]]
name = "uas{number}"
stack = "{stack}"
kind = "plane"
link = "udpin:127.0.0.1:{port}"
system_id = {number}
airspeed_m_s = 15
altitude_agl_m = {altitude_m}
home_lat_deg = {lat:.6f}
home_lon_deg = {lon:.6f}
autostart = true
landing = false
"""

SERVICE = """
[service.http]
listen = "127.0.0.1:{port}"
"""


@dataclass(frozen=True, slots=True)
class Load:
    """How much is asked of the daemon."""

    vehicles: int = 8
    rule: str = "team.balanced"
    cells: int = 500
    start_s: float = 7200.0
    end_s: float = 36_000.0
    wind_speed_m_s: float = 6.0
    dead_1h_pct: float = 4.0
    http_port: int | None = None
    extra: str = ""


def scenario_text(load: Load) -> str:
    """The scenario file: homes on a ring where the fire's edge is, every second one ArduPilot's.

    More vehicles than layers share these, each with a part of the front of its own.
    """
    lat, lon = FIRE
    cell_m = 13_500 // load.cells
    head = HEAD.format(
        end_s=load.end_s,
        start_s=load.start_s,
        cells=load.cells,
        cell_m=cell_m,
        lat=lat,
        lon=lon,
        rule=load.rule,
        wind_speed_m_s=load.wind_speed_m_s,
        dead_1h_pct=load.dead_1h_pct,
        dead_10h_pct=load.dead_1h_pct + 1.0,
        dead_100h_pct=load.dead_1h_pct + 2.0,
    )
    parts = [head]
    for place in range(load.vehicles):
        north_m, east_m = _home_m(place, load.vehicles)
        parts.append(
            VEHICLE.format(
                number=place + 1,
                stack="px4" if place % 2 == 0 else "ardupilot",
                port=FIRST_PORT + place,
                altitude_m=150 + 40 * (place % LAYERS),
                lat=lat + north_m / M_PER_DEG,
                lon=lon + east_m / M_PER_DEG / math.cos(math.radians(lat)),
            )
        )
    if load.http_port is not None:
        parts.append(SERVICE.format(port=load.http_port))
    return "".join([*parts, load.extra])


def _home_m(place: int, count: int) -> tuple[float, float]:
    """North and east of the ignition, downwind of it, on a ring with room to take off at once."""
    turn = math.tau * place / count
    radius_m = max(1200.0, 350.0 * count / math.tau)
    radius_m = min(radius_m, 2500.0 + 300.0 * (place % 3))
    return radius_m * math.cos(turn) - 800.0, radius_m * math.sin(turn) - 800.0
