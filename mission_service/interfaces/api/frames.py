"""Changed states as server-sent events; each state is encoded once for all clients."""

from collections.abc import Callable
from typing import Any

from mission_service.interfaces.api.answers import encode
from mission_service.interfaces.api.states import status_of
from mission_service.runtime.hub import Hub


class Frames:
    """The newest event of each key for the live stream; memory: one event for each key."""

    def __init__(self, hub: Hub, wall_us: Callable[[], int]) -> None:
        self._hub = hub
        self._wall_us = wall_us
        self._kept: dict[str, tuple[int, bytes]] = {}

    @property
    def version(self) -> int:
        """The version of the picture."""
        return self._hub.picture.version

    async def changed(self, since: int) -> None:
        """Wait until the picture is newer than ``since``."""
        await self._hub.changed(since)

    def frames(self, since: int) -> bytes:
        """Events of all states that changed since a version, in the order of their versions.

        A client that was disconnected continues after its last ``id`` and misses nothing.
        """
        changed = self._hub.picture.changed
        new = sorted((version, key) for key, version in changed.items() if version > since)
        return b"".join(self._frame(key, version, since) for version, key in new)

    def _frame(self, key: str, version: int, since: int) -> bytes:
        if key == "news":  # only lines after ``since``: not the same for all
            lines = [line for line in self._hub.picture.news if line.id > since]
            return _event("news", version, lines)
        kept = self._kept.get(key)
        if kept is None or kept[0] != version:
            kind, _, name = key.partition("/")
            kept = version, _event(kind, version, self._state(kind, name))
            self._kept[key] = kept
        return kept[1]

    def _state(self, kind: str, name: str) -> Any:
        hub = self._hub
        match kind:
            case "vehicle":
                return hub.picture.vehicles[name]
            case "telemetry":
                return hub.picture.telemetry[name]
            case "mission":
                return hub.picture.missions[name]
            case "fire":
                return hub.fire()
            case "burn":
                return hub.burn()
            case "replay":
                return None if hub.replay is None else hub.replay()
            case "alarms":
                return list(hub.picture.alarms.values())
            case _:
                return status_of(hub, self._wall_us())


def _event(kind: str, version: int, state: Any) -> bytes:
    return b"event: %b\nid: %d\ndata: %b\n\n" % (kind.encode(), version, encode(state))
