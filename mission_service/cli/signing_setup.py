"""Give a vehicle its key or take it away, and see whether it then does as told."""

from typing import Any, TypeVar

from autopilot_bridge.links.connection import Connection
from autopilot_bridge.links.signing import Key, Signing, read_key
from autopilot_bridge.missions.transfer import TransferTiming
from autopilot_bridge.vehicle.client import VehicleClient
from autopilot_bridge.vehicle.client_events import Connected, TransferFinished
from autopilot_bridge.vehicle.watch import AUTOPILOT
from mission_service.cli.transfers import Line, connected, within
from mission_service.errors import MissionServiceError
from mission_service.runtime.clocks import clock_us, wall_us
from mission_service.runtime.link_signing import refusal

OWN = (255, 190)
TIMING = TransferTiming(retries=3)  # who signs with another key never answers
Event = TypeVar("Event", Connected, TransferFinished)


def set_up(line: Line, old_key: str | None, system_id: int | None) -> dict[str, Any]:
    """Tell the vehicle the key of the line, then read its mission over signed frames.

    ``old_key`` is where the key is that it has now. Raises MissionServiceError if the vehicle does
    not answer signed.
    """
    assert line.signing_key is not None
    return _change(line, old_key, line.signing_key, system_id)


def turn_off(line: Line, system_id: int | None) -> dict[str, Any]:
    """Take away the key of the line, then read the vehicle's mission over unsigned frames."""
    return _change(line, line.signing_key, None, system_id)


def _change(line: Line, old: str | None, new: str | None, system_id: int | None) -> dict[str, Any]:
    client = VehicleClient(*OWN, target_system=system_id, timing=TIMING)
    key = None if new is None else read_key(new)
    with connected(client, line, old, new) as (connection, signing_of):
        signing = signing_of.get(new)
        work = _told_and_tried(line, client, connection, key, signing)
        system = within(line, client, connection, work)
    return {"result": "accepted", "system_id": system, "signing": "off" if new is None else "on"}


async def _told_and_tried(
    line: Line,
    client: VehicleClient,
    connection: Connection,
    key: Key | None,
    signing: Signing | None,
) -> int:
    """The system id of the vehicle, which has answered as it should."""
    async with connection:
        await _until(client, connection, Connected)
        system = client.target_system
        assert system is not None
        connection.set_up_signing(OWN, (system, AUTOPILOT), key, wall_us(), signing)
        client.download(clock_us(), by_file=False)  # a question whose answer comes signed, or not
        connection.flush()
        answer = await _until(client, connection, TransferFinished)
        answered = answer.result.outcome == "accepted" and not connection.hears_signed
        if not answered:
            raise MissionServiceError(_why_not(line.link, system, connection, signing))
    return system


def _why_not(link: str, system: int, connection: Connection, signing: Signing | None) -> str:
    """What to say of a vehicle that does not do as told."""
    vehicle, counts = f"{link}: vehicle {system}", connection.counts
    if signing is None:
        return f"{vehicle} still signs, or answers nothing; is this its key, and is it disarmed?"
    if counts.wrong:
        return f"{vehicle} signs with another key; give that one as --old-key"
    if counts.unsigned:
        return (
            f"{vehicle} does not sign though it was sent the key; is it armed, or does its "
            "firmware not sign (PX4 before 1.18)?"
        )
    refused = refusal(counts, link)
    return f"{vehicle} answers nothing that is signed" + (f": {refused}" if refused else "")


async def _until(client: VehicleClient, connection: Connection, kind: type[Event]) -> Event:
    """The next event of a kind."""
    while True:
        await connection.wait()
        while (event := client.next_event()) is not None:
            if isinstance(event, kind):
                return event
