"""Sets or removes a vehicle's signing key, and checks the effect."""

from typing import Any, TypeVar

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.links.asyncio_connection import Connection
from autopilot_bridge.links.signing import Key, Signing, read_key
from autopilot_bridge.missions.transfer import TransferTiming
from autopilot_bridge.vehicle.client_events import Connected, TransferFinished
from autopilot_bridge.vehicle.monitor import AUTOPILOT
from mission_service.cli.mission_transfers import Line, connected, within
from mission_service.errors import MissionServiceError
from mission_service.runtime.clocks import clock_us, wall_us
from mission_service.runtime.link_signing import refusal

OWN = (255, 190)
TIMING = TransferTiming(retries=3)  # a vehicle with a different key never answers
Event = TypeVar("Event", Connected, TransferFinished)


def set_up(line: Line, old_key: str | None, system_id: int | None) -> dict[str, Any]:
    """Set the vehicle's key to the key of ``line``, then read the mission with signed frames.

    ``old_key`` is the source of the vehicle's current key. Raises MissionServiceError if the
    vehicle does not answer with signed frames.
    """
    assert line.signing_key is not None
    return _change(line, old_key, line.signing_key, system_id)


def turn_off(line: Line, system_id: int | None) -> dict[str, Any]:
    """Remove the vehicle's key (the key of ``line``), and read the mission with unsigned frames."""
    return _change(line, line.signing_key, None, system_id)


def _change(line: Line, old: str | None, new: str | None, system_id: int | None) -> dict[str, Any]:
    client = NativeClient(*OWN, target_system=system_id, timing=TIMING)
    key = None if new is None else read_key(new)
    with connected(client, line, old, new) as (connection, signing_of):
        signing = signing_of.get(new)
        work = _change_and_check(line, client, connection, key, signing)
        system = within(line, client, connection, work)
    return {"result": "accepted", "system_id": system, "signing": "off" if new is None else "on"}


async def _change_and_check(
    line: Line,
    client: NativeClient,
    connection: Connection,
    key: Key | None,
    signing: Signing | None,
) -> int:
    """Change the key, check the vehicle's answer, and return the vehicle's system id."""
    async with connection:
        await _until(client, connection, Connected)
        system = client.target_system
        assert system is not None
        connection.set_up_signing(OWN, (system, AUTOPILOT), key, wall_us(), signing)
        client.download(clock_us(), by_file=False)  # the signatures of the reply are checked
        connection.flush()
        answer = await _until(client, connection, TransferFinished)
        if answer.result.outcome != "accepted" or connection.ports[0].receives_signed:
            raise MissionServiceError(_failure(line.link, system, connection, signing))
    return system


def _failure(link: str, system: int, connection: Connection, signing: Signing | None) -> str:
    """Return the error message for a vehicle whose answer does not confirm the key change."""
    vehicle, counts = f"{link}: vehicle {system}", connection.ports[0].counts
    if signing is None:
        return f"{vehicle} still signs, or does not answer; check its key, and that it is disarmed"
    if counts.wrong:
        return f"{vehicle} signs with another key; specify that key with --old-key"
    if counts.unsigned:
        return (
            f"{vehicle} received the key but does not sign; check that it is disarmed and that "
            "its firmware can sign (PX4 since 1.18)"
        )
    refused = refusal(counts, link)
    return f"{vehicle} does not answer with signed frames" + (f": {refused}" if refused else "")


async def _until(client: NativeClient, connection: Connection, kind: type[Event]) -> Event:
    """Wait for the next event of type ``kind`` and return it."""
    while True:
        await connection.wait()
        while (event := client.next_event()) is not None:
            if isinstance(event, kind):
                return event
