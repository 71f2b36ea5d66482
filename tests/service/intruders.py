"""Another aircraft near a simulated flight, received by the vehicle as MAVLink ADSB_VEHICLE."""

import math
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Codec
from mission_service.ground_distance import M_PER_DEG, offset_m
from mission_service.simulation.sim import Simulation

ADSB_COMPONENT = mavlink.MAV_COMP_ID_ADSB
FLAGS = (
    mavlink.ADSB_FLAGS_VALID_COORDS
    | mavlink.ADSB_FLAGS_VALID_ALTITUDE
    | mavlink.ADSB_FLAGS_VALID_HEADING
    | mavlink.ADSB_FLAGS_VALID_VELOCITY
    | mavlink.ADSB_FLAGS_VALID_CALLSIGN
    | mavlink.ADSB_FLAGS_VERTICAL_VELOCITY_VALID
)


@dataclass
class Intruder:
    """An aircraft that flies straight on, at a position at mission time ``at_s``."""

    at_s: float
    lat_deg: float
    lon_deg: float
    altitude_m: float
    track_deg: float
    speed_m_s: float
    address: int = 0xA4C2F1
    climb_m_s: float = 0.0

    def place(self, at_s: float) -> tuple[float, float, float]:
        """Return latitude, longitude and altitude at a mission time."""
        moved_m = self.speed_m_s * (at_s - self.at_s)
        course = math.radians(self.track_deg)
        lat_deg = self.lat_deg + moved_m * math.cos(course) / M_PER_DEG
        east_deg = moved_m * math.sin(course) / M_PER_DEG / math.cos(math.radians(self.lat_deg))
        return (
            lat_deg,
            self.lon_deg + east_deg,
            self.altitude_m + self.climb_m_s * (at_s - self.at_s),
        )

    def report(self, at_s: float, codec: Codec) -> bytes:
        """Return the frame of an ADSB_VEHICLE at a mission time, with a geometric altitude."""
        lat_deg, lon_deg, altitude_m = self.place(at_s)
        message = mavlink.MAVLink_adsb_vehicle_message(
            self.address,
            round(lat_deg * 1e7),
            round(lon_deg * 1e7),
            mavlink.ADSB_ALTITUDE_TYPE_GEOMETRIC,
            round(altitude_m * 1e3),
            round(self.track_deg * 100.0) % 36_000,
            round(self.speed_m_s * 100.0),
            round(self.climb_m_s * 100.0),
            b"N417EA",
            1,
            0,
            FLAGS,
            1200,
        )
        return codec.encode(message)


def meeting(
    sim: Simulation,
    in_s: float,
    *,
    track_deg: float,
    speed_m_s: float = 50.0,
    up_m: float = 0.0,
    aside_m: float = 0.0,
) -> Intruder:
    """Return an aircraft that meets the vehicle's present straight course after ``in_s``.

    It passes ``up_m`` above that place and ``aside_m`` to the right of it.
    """
    at_s, name = sim.clock.now_us / 1e6, sim.rigs[0].gateway.name
    fix = sim.core.decision_engine.availability[name].fix
    state = sim.service.state_view.telemetry[name]
    assert fix is not None
    course, cos = math.radians(track_deg), math.cos(math.radians(state.lat_deg))
    north_m = in_s * fix.north_m_s - aside_m * math.sin(course)
    east_m = in_s * fix.east_m_s + aside_m * math.cos(course)
    north_m -= in_s * speed_m_s * math.cos(course)
    east_m -= in_s * speed_m_s * math.sin(course)
    return Intruder(
        at_s,
        state.lat_deg + north_m / M_PER_DEG,
        state.lon_deg + east_m / M_PER_DEG / cos,
        fix.altitude_m + up_m,
        track_deg,
        speed_m_s,
    )


@dataclass
class Passed:
    """The smallest distance to an aircraft, and the time without well clear (2000 ft, 250 ft)."""

    distance_m: float = math.inf
    horizontal_m: float = math.inf  # while the height difference is less than 250 ft
    violated_s: float = 0.0


def fly_past(sim: Simulation, intruder: Intruder, seconds: int, reported: bool = True) -> Passed:
    """Run a simulation with an aircraft that the vehicle receives once a second."""
    codec, passed = Codec(sim.rigs[0].mock.system_id, ADSB_COMPONENT), Passed()
    rig = sim.rigs[0]
    for _ in range(seconds):
        at_s = sim.clock.now_us / 1e6
        if reported:
            rig.client.receive_data(intruder.report(at_s, codec), sim.link_us)
        sim.run_until(at_s + 1.0)
        add_distance(passed, sim, intruder)
    return passed


def add_distance(passed: Passed, sim: Simulation, intruder: Intruder) -> None:
    """Compare the present positions of the vehicle and the aircraft."""
    fix = sim.service.state_view.telemetry[sim.rigs[0].gateway.name]
    lat_deg, lon_deg, altitude_m = intruder.place(fix.at_us / 1e6)
    apart_m = math.hypot(*offset_m((fix.lat_deg, fix.lon_deg), (lat_deg, lon_deg)))
    up_m = abs(altitude_m - fix.altitude_amsl_m)
    passed.distance_m = min(passed.distance_m, math.hypot(apart_m, up_m))
    if up_m < 250.0 * 0.3048:
        passed.horizontal_m = min(passed.horizontal_m, apart_m)
        passed.violated_s += apart_m < 2000.0 * 0.3048
