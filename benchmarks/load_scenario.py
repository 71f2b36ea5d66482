"""The scenario of ``load.py``, ``soak.py`` and ``weeks.py``: many planes around one large fire."""

import math
import os
from dataclasses import dataclass

FIRE = (36.372, -84.125)
LAYERS = 8  # layers of 40 m; from higher layers the camera would not see the edge of the fire
M_PER_DEG = 111_195.0
# Below the range of ephemeral ports, which the mocks' own sockets use.
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

BROKER = """
[service.mqtt]
broker = "{address}"
commands = true

[service.journal]
rotate_mb = {rotate_mb}
keep_mb = {keep_mb}
state_every_s = {state_every_s}
"""


@dataclass(frozen=True, slots=True)
class Load:
    """Size and conditions of the load."""

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
    """Return the text of the scenario file.

    The homes lie on a ring near the edge of the fire; PX4 and ArduPilot alternate. If there are
    more vehicles than altitude layers, vehicles on different parts of the front share a layer.
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
    """Return the north and east offset of a home from the ignition.

    The homes lie on a ring downwind of the ignition, far enough apart for simultaneous take-offs.
    """
    turn = math.tau * place / count
    radius_m = max(1200.0, 350.0 * count / math.tau)
    radius_m = min(radius_m, 2500.0 + 300.0 * (place % 3))
    return radius_m * math.cos(turn) - 800.0, radius_m * math.sin(turn) - 800.0
