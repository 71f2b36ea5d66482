"""The mock's camera and gimbal: missions, commands, and the messages that a client receives."""

import math
from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.items import camera_trigger, gimbal_pitch, takeoff, waypoint
from autopilot_bridge.missions.check import check
from autopilot_bridge.missions.read_back import as_read_back, same_as_sent
from autopilot_bridge.mock.kinematics import STEP_US
from autopilot_bridge.mock.mock_camera import CapturedImage
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle.camera_telemetry import GimbalAttitude, ImageCaptured
from tests.bridge.helpers import HOME
from tests.bridge.mock_exchange import PLANE, PX4, command, each_stack, player_of
from tests.bridge.test_mock_physics import M, flown

UNSUPPORTED, ACCEPTED = mavlink.MAV_RESULT_UNSUPPORTED, mavlink.MAV_RESULT_ACCEPTED
TRIGGER, DIGICAM, PITCH_YAW, CONFIGURE, START = 206, 203, 1000, 1001, 2000
SPACING_M = 40.0


@each_stack
def test_stacks_store_the_items_of_camera_and_gimbal_as_sent(stack: Stack) -> None:
    end = waypoint(36.31, -84.2, 340.0)
    items = (gimbal_pitch(-80.0), camera_trigger(SPACING_M), end, camera_trigger(0.0), end)
    assert check(items, stack) == []
    for item in items:
        read = as_read_back(item, stack)
        assert same_as_sent(item, read, stack)
        assert read.param1 == item.param1
    assert as_read_back(items[0], stack).z == mavlink.MAV_MOUNT_MODE_MAVLINK_TARGETING


@each_stack
def test_a_mission_takes_images_along_its_path_and_a_client_receives_them(stack: Stack) -> None:
    north = [waypoint(36.3 + metres * M, -84.2, 340.0) for metres in (100.0, 500.0, 2500.0)]
    items = (
        *(takeoff(*HOME[:2], 340.0), gimbal_pitch(-70.0), camera_trigger(SPACING_M)),
        *(*north[:2], camera_trigger(0.0), north[2]),
    )
    mock = flown(stack, items).mock
    captures: list[CapturedImage] = []
    mock.fit_camera(captures.append)
    mock.flight.set_mode("idle", 0.0)
    mock.flight.set_mode("mission", 0.0)
    client = NativeClient(rates_hz={mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: 4.0})
    found: list[object] = []
    for step in range(round(90e6 / STEP_US)):
        now_us = step * STEP_US
        for datagram in client.data_to_send():
            mock.receive_data(datagram, now_us)
        mock.handle_timer(now_us)
        for datagram in mock.data_to_send():
            client.receive_data(datagram, now_us)
        client.handle_timer(now_us)
        while (event := client.next_event()) is not None:
            found.append(event)
    assert len(captures) > 8
    places = [mock.flight.frame.local_of(capture.lat_deg, capture.lon_deg) for capture in captures]
    gaps = [math.dist(one, other) for one, other in pairwise(places)]
    assert all(SPACING_M - 0.1 <= gap < SPACING_M + 5.0 for gap in gaps)
    assert mock.flight.motion.north_m > 600.0
    assert max(place[0] for place in places) < 510.0, "no image after the end of the path"
    assert {capture.pitch_deg for capture in captures} == {-70.0}
    images = [each for each in found if isinstance(each, ImageCaptured)]
    assert len(images) == len(captures)
    for image, capture in zip(images, captures, strict=True):
        assert (image.lat_deg, image.lon_deg) == pytest.approx((capture.lat_deg, capture.lon_deg))
        assert image.boot_us == pytest.approx(capture.boot_us, abs=1000)
        assert image.angles is not None
        if stack.name == "px4":  # ArduPilot reports the attitude of the airframe
            assert image.angles[1] == pytest.approx(-70.0, abs=0.01)
    gimbals = [each for each in found if isinstance(each, GimbalAttitude)]
    assert len(gimbals) > 100
    assert gimbals[-1].angles == pytest.approx((0.0, -70.0, 0.0), abs=0.01)
    assert not gimbals[-1].from_north


@pytest.mark.parametrize("stack", [PX4, PLANE], ids=lambda stack: stack.name)
def test_commands_take_images_and_tilt_the_gimbal_as_on_the_stack(stack: Stack) -> None:
    player = player_of(stack)

    def result(number: int, *params: float) -> int:
        replies = player.send(command(number, *params))
        (ack,) = [line for line in replies if line.name == "COMMAND_ACK"]
        return int(ack.fields["result"])

    assert result(DIGICAM, 0, 0, 0, 0, 1) == UNSUPPORTED, "without a camera"
    captures: list[CapturedImage] = []
    player.mock.fit_camera(captures.append)
    camera = player.mock.flight.payload.camera
    assert camera is not None
    assert result(DIGICAM, 0, 0, 0, 0, 1) == ACCEPTED
    player.listen(1.0)
    assert len(captures) == 1
    assert result(TRIGGER, 50.0, 0, 1) == ACCEPTED, "and one image at once"
    player.listen(1.0)
    assert [capture.number for capture in captures] == [0, 1]
    px4 = stack.name == "px4"
    assert (result(PITCH_YAW, -45.0, 0.0) == ACCEPTED) != px4, "PX4 missions are not in control"
    assert (result(START, 0, 1.0, 3) == ACCEPTED) != px4
    if px4:
        assert result(CONFIGURE, -2.0, -2.0) == ACCEPTED
        assert result(PITCH_YAW, -45.0, 0.0) == ACCEPTED
    assert camera.pitch_deg == -45.0
    player.listen(10.0)
    assert len(captures) == (2 if px4 else 5)


def test_a_restarted_autopilot_keeps_its_camera_and_stops_triggering() -> None:
    mock = player_of(PX4).mock
    mock.fit_camera(lambda capture: None)
    camera = mock.flight.payload.camera
    assert camera is not None
    camera.run_command(TRIGGER, (40.0, 0, 0, 0, 0, 0, 0), 0)
    mock.reboot(2_000_000)
    again = mock.flight.payload.camera
    assert again is not None
    assert again.on_image is camera.on_image
    moved = mock.flight.motion
    assert not again.wants_image(moved, 0)
    moved.north_m += 100.0
    assert not again.wants_image(moved, 1)
