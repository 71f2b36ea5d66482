"""Computes a vehicle's statistics: missions, time in the air, commands, modes, link losses."""

import math
from collections import Counter, deque
from dataclasses import dataclass, field
from typing import Any

from mission_service.commands import (
    Announce,
    AnyCommand,
    ClimbAndHold,
    GoAround,
    Hold,
    Land,
    Return,
    StartMission,
    UploadMission,
)
from mission_service.events import (
    CommandFinished,
    LinkLost,
    LinksReported,
    MissionProgress,
    ModeChanged,
    Telemetry,
    UploadFinished,
    VehicleEvent,
    VehicleRebooted,
)
from mission_service.ground_distance import distance_m
from mission_service.vehicles.availability import AIRBORNE_M

MAX_CHANGES = 1000
GAP_US = 5_000_000  # a longer gap between positions counts as no flight


@dataclass
class LinkUse:
    """The use and quality of one vehicle's links over mission time."""

    switches: Counter[str] = field(default_factory=Counter)  # by cause
    # The last changes of the link in use: time, link, cause.
    changes: deque[tuple[int, str, str]] = field(default_factory=lambda: deque(maxlen=MAX_CHANGES))
    _us: dict[str, Counter[str]] = field(default_factory=dict)  # by link: durations in us
    _last: LinksReported | None = None
    _counted_us: int = 0

    def on_event(self, event: VehicleEvent) -> None:
        """Count the time since the last event, and the changes in a report."""
        if self._last is not None and event.at_us > self._counted_us:
            self._count(self._last, event.at_us - self._counted_us)
        self._counted_us = max(self._counted_us, event.at_us)
        if isinstance(event, LinksReported):
            self._last = event
            if event.cause:
                self.switches[event.cause] += 1
                self.changes.append((event.at_us, event.in_use, event.cause))

    def _count(self, report: LinksReported, during_us: int) -> None:
        for each in report.links:
            spent_us = self._us.setdefault(each.link, Counter())
            spent_us["observed"] += during_us
            spent_us[each.state] += during_us
            spent_us["in use"] += during_us * (each.link == report.in_use)
            if each.loss_share is not None and each.state != "silent":
                spent_us["loss known"] += during_us
                spent_us["lost"] += round(during_us * each.loss_share)

    def of_links(self) -> list[dict[str, Any]]:
        """Return the figures of each link; the mean loss is over the time for which it is known."""
        found = []
        for link, spent_us in sorted(self._us.items()):
            known_us = spent_us["loss known"]
            row: dict[str, Any] = {"link": link}
            for key in ("observed", "in use", "degraded", "silent"):
                row[f"{key.replace(' ', '_')}_s"] = round(spent_us[key] / 1e6, 1)
            row["mean_loss_pct"] = round(100 * spent_us["lost"] / known_us, 1) if known_us else None
            found.append(row)
        return found


@dataclass
class Sortie:
    """The statistics of one vehicle, computed from its events and commands in order."""

    sent: int = 0
    accepted: int = 0
    flown: int = 0  # missions with at least one item reached
    takeoffs: int = 0
    landings: int = 0
    in_air_us: int = 0
    flown_m: float = 0.0
    commands: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    modes: Counter[str] = field(default_factory=Counter)
    link_losses: int = 0
    links: LinkUse = field(default_factory=LinkUse)
    autopilot_restarts: int = 0
    announcements: Counter[str] = field(default_factory=Counter)
    _mode: str = ""
    _in_air: bool = False
    _unflown: bool = False  # no item of the accepted mission has been reached yet
    _fix: Telemetry | None = None

    def on_event(self, event: VehicleEvent) -> None:
        """Process an event."""
        self.links.on_event(event)
        match event:
            case Telemetry():
                self._moved(event)
            case UploadFinished(outcome="accepted"):
                self.accepted += 1
                self._unflown = True
            case MissionProgress(current_seq=seq) if seq > 0 and self._unflown and self._in_air:
                self.flown += 1
                self._unflown = False
            case ModeChanged():
                self._mode_changed(event)
            case CommandFinished(accepted=False, replaced=False):
                self.refused[event.command] += 1
            case LinkLost():
                self.link_losses += 1
            case VehicleRebooted():
                self.autopilot_restarts += 1
            case _:
                pass

    def on_commands(self, command: AnyCommand) -> None:
        """Process a command."""
        match command:
            case UploadMission():
                self.sent += 1
            case StartMission() | Hold() | Return() | Land() | GoAround() | ClimbAndHold():
                self.commands[type(command).__name__] += 1
            case Announce():
                self.announcements[command.level] += 1
            case _:
                pass

    def figures(self) -> dict[str, Any]:
        """Return the statistics as plain data for the JSON summary."""
        return {
            "missions": {"sent": self.sent, "accepted": self.accepted, "flown": self.flown},
            "takeoffs": self.takeoffs,
            "landings": self.landings,
            "in_air_s": round(self.in_air_us / 1e6, 1),
            "flown_km": round(self.flown_m / 1e3, 3),
            "commands": dict(sorted(self.commands.items())),
            "refused": dict(sorted(self.refused.items())),
            "modes": dict(sorted(self.modes.items())),
            "link_losses": self.link_losses,
            "links": self.links.of_links(),
            "link_switches": dict(sorted(self.links.switches.items())),
            "autopilot_restarts": self.autopilot_restarts,
            "announcements": dict(sorted(self.announcements.items())),
        }

    def _moved(self, fix: Telemetry) -> None:
        before, self._fix = self._fix, fix
        if not self._in_air and fix.altitude_relative_m >= AIRBORNE_M:
            self._in_air = True
            self.takeoffs += 1
        elif self._in_air and before is not None and fix.at_us - before.at_us <= GAP_US:
            self.in_air_us += max(fix.at_us - before.at_us, 0)
            places = [(each.lat_deg, each.lon_deg) for each in (before, fix)]
            climbed_m = fix.altitude_amsl_m - before.altitude_amsl_m
            self.flown_m += math.hypot(distance_m(*places), climbed_m)

    def _mode_changed(self, event: ModeChanged) -> None:
        if event.mode != self._mode:
            self._mode = event.mode
            self.modes[event.mode or str(event.custom_mode)] += 1
        if self._in_air and not event.armed:
            self._in_air = False
            self.landings += 1
