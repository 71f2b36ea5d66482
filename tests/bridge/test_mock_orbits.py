"""Orbits of the mock, compared with those of PX4 1.17 and ArduPlane 4.6.2."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.stacks.return_flight import true_airspeed_factor
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle.client_events import ModeChanged, Position
from tests.bridge.helpers import Pair
from tests.bridge.mock_exchange import PLANE, PX4
from tests.bridge.test_orders import PLACE, accepted, airborne, distances_m, turned_deg

NAN = math.nan
planes = pytest.mark.parametrize("stack", [PX4, PLANE], ids=lambda stack: stack.name)


def speed_m_s(pair: Pair) -> float:
    position = pair.of(Position)[-1]
    return math.hypot(position.velocity_north_m_s, position.velocity_east_m_s)


def test_arduplane_circles_wider_than_asked() -> None:
    pair = airborne(PLANE)
    accepted(pair, pair.client.command("orbit", pair.now_us, *PLACE, 390.0, -150.0, 22.0))
    pair.run_for(120.0)
    assert distances_m(pair, PLACE)[-1] == pytest.approx(162.0, abs=1.5)
    assert turned_deg(pair, PLACE) < 0.0


def test_a_px4_plane_orbits_its_own_position_by_its_own_radius_by_default() -> None:
    pair = airborne(PX4)
    position = pair.of(Position)[-1]
    orbit = mavlink.MAVLink_command_int_message(
        1, 1, 0, mavlink.MAV_CMD_DO_ORBIT, 0, 0, NAN, NAN, NAN, NAN, 2**31 - 1, 2**31 - 1, NAN
    )
    pair.client._send(orbit)
    pair.run_for(120.0)
    there = (position.lat_deg, position.lon_deg)
    assert distances_m(pair, there)[-1] == pytest.approx(80.0, abs=8.0)  # it moved in the meantime
    assert turned_deg(pair, there) > 0.0
    assert pair.of(Position)[-1].altitude_amsl_m == pytest.approx(position.altitude_amsl_m, abs=5.0)


@planes
def test_a_speed_survives_a_new_orbit_and_goes_with_a_change_of_mode(stack: Stack) -> None:
    pair = airborne(stack)
    cruise_m_s = speed_m_s(pair)
    accepted(pair, pair.client.command("orbit", pair.now_us, *PLACE, 390.0, -120.0))
    accepted(pair, pair.client.command("change speed", pair.now_us, 13.0))
    pair.run_for(20.0)
    accepted(
        pair, pair.client.command("orbit", pair.now_us, PLACE[0] + 0.001, PLACE[1], 390.0, -120.0)
    )
    pair.run_for(20.0)
    assert speed_m_s(pair) == pytest.approx(13.0, abs=0.1)
    accepted(pair, pair.client.command("return", pair.now_us))
    pair.run_for(20.0)
    assert pair.of(ModeChanged)[-1].name == "return"
    # Planes return with the airspeed of their parameters, which is a calibrated one.
    factor = true_airspeed_factor(pair.of(Position)[-1].altitude_amsl_m)
    assert speed_m_s(pair) == pytest.approx(cruise_m_s * factor, abs=0.1)
    assert cruise_m_s > 15.0
