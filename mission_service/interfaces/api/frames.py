"""Encodes changed states as server-sent events, once for all clients."""

from collections.abc import Callable
from typing import Any

from mission_service.interfaces.api.models import status_of
from mission_service.interfaces.api.responses import encode
from mission_service.runtime.run_context import RunContext


class Frames:
    """The events of the live stream; a cache stores the newest event for each key."""

    def __init__(self, context: RunContext, wall_us: Callable[[], int]) -> None:
        self._context = context
        self._wall_us = wall_us
        self._cached: dict[str, tuple[int, bytes]] = {}

    @property
    def version(self) -> int:
        """Return the version of the state view."""
        return self._context.state_view.version

    async def changed(self, since: int) -> None:
        """Wait until the state view is newer than ``since``."""
        await self._context.changed(since)

    def frames(self, since: int) -> bytes:
        """Return the events for all states that changed since a version, in order of version.

        A client that reconnects to the same process continues from the last received ``id`` and
        misses no state; the versions of another process are independent.
        """
        changed = self._context.state_view.changed
        new = sorted((version, key) for key, version in changed.items() if version > since)
        return b"".join(self._frame(key, version, since) for version, key in new)

    def _frame(self, key: str, version: int, since: int) -> bytes:
        # Log lines differ between clients: each client receives only those after ``since``.
        if key in ("announcements", "records"):
            lines = getattr(self._context.state_view, key)
            return _event(key, version, [line for line in lines if line.id > since])
        cached = self._cached.get(key)
        if cached is None or cached[0] != version:
            kind, _, name = key.partition("/")
            cached = version, _event(kind, version, self._state(kind, name))
            self._cached[key] = cached
        return cached[1]

    def _state(self, kind: str, name: str) -> Any:
        context = self._context
        match kind:
            case "vehicle":
                return context.state_view.vehicles[name]
            case "telemetry":
                return context.state_view.telemetry[name]
            case "mission":
                return context.state_view.missions[name]
            case "fire":
                return context.fire()
            case "sources":
                return context.state_view.sources()
            case "aircraft":
                return context.state_view.aircraft()
            case "fire_arrivals":
                return context.arrivals
            case "burn":
                return context.burn()
            case "airspace":
                return context.airspace()
            case "replay":
                return None if context.replay is None else context.replay()
            case "alarms":
                return list(context.state_view.alarms.values())
            case _:
                return status_of(context, self._wall_us())


def _event(kind: str, version: int, state: Any) -> bytes:
    return b"event: %b\nid: %d\ndata: %b\n\n" % (kind.encode(), version, encode(state))
