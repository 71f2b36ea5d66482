"""Forged frames on a vehicle's link: ``python -m benchmarks.forged_frames [--frames N]``.

The mock flies a scenario in virtual time, once without and once with forged frames between its own
frames. From other addresses, systems and components the forger sends each message that the bridge
reads, with NaN, infinities, extreme values, and times since boot far ahead or far back. From the
vehicle's own address it sends implausible content: values out of bounds, jumps of time, positions
that the vehicle cannot reach, and heartbeats of other autopilots. No frame may raise an exception,
the service may send no frame to the forger, and the journals of both flights (events of the core,
decisions, camera observations, mission time) must be equal byte by byte, except for the reports of
the quality of the links, which forged sequence numbers change. Alarms are not part of the journal;
the benchmark counts them.
"""

import argparse
import math
import random
import struct
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import click
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.shared_link import SharedLink
from autopilot_bridge.links.field_limits import BOUNDS
from autopilot_bridge.links.framing import frames_of
from autopilot_bridge.mock.autopilot import MockAutopilot
from benchmarks.fuzz_frames import frame_of
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.fire.scenario_fire import landscape_of
from mission_service.journal.journal_file import Journal, header_of
from mission_service.runtime.engine import Engine
from mission_service.runtime.gateway import rates_hz
from mission_service.runtime.vehicle_links import max_speed_m_s
from mission_service.simulation.sim import SimulatedVehicle, Simulation

OWN = "192.0.2.1:14550"
MAX_REMOTES = 5000
IDS = {known.msgname: known.id for known in mavlink.mavlink_map.values()}
READ = (
    *(kind for kind in BOUNDS if kind != "MISSION_ITEM"),
    *("HEARTBEAT", "SYSTEM_TIME", "GPS_RAW_INT", "EXTENDED_SYS_STATE", "FENCE_STATUS"),
    *("EKF_STATUS_REPORT", "ESTIMATOR_STATUS", "MISSION_ACK", "MISSION_REQUEST"),
    *("MISSION_REQUEST_INT", "MISSION_ITEM_INT", "COMMAND_ACK", "PARAM_VALUE", "HOME_POSITION"),
    *("FILE_TRANSFER_PROTOCOL", "AUTOPILOT_VERSION", "GLOBAL_POSITION_INT", "HEARTBEAT"),
)
FLOATS = (math.nan, math.inf, -math.inf, 1e38, -1e38, 3.4e38, 0.0, 1.0, -1.0, 1e-40)
DAY_MS = 24 * 3600 * 1000
AHEAD_MS = (5_000, 60_000, 3_600_000, DAY_MS, 30 * DAY_MS, 40 * DAY_MS)
SURE_AFTER_US = 20_000_000  # link time after which the rate of the autopilot's clock is estimated


@dataclass
class Forged:
    """Counts of forged frames and of their effects."""

    frames: int = 0
    alarms: Counter[str] = field(default_factory=Counter)
    to_others: int = 0  # frames addressed to a remote that is not the vehicle's
    ended_s: float = 0.0  # mission time


class Forger:
    """Generator of random forged frames for one vehicle's link."""

    def __init__(self, seed: int, mock: MockAutopilot) -> None:
        self._chance = random.Random(seed)
        self._mock = mock
        self._next_remote = 0

    def frames(self, count: int, link_us: int, boot_ms: int) -> Iterator[tuple[str, bytes]]:
        """Yield remotes and frames; ``boot_ms`` is the vehicle's time since boot."""
        for _ in range(count):
            if self._chance.random() < 0.3 and link_us > SURE_AFTER_US:
                yield OWN, self._impossible(boot_ms)
            else:
                yield self._of_others(boot_ms)

    def _of_others(self, boot_ms: int) -> tuple[str, bytes]:
        """Return the remote and the frame of a random message from another source.

        The source differs from the vehicle in its remote, its system or its component.
        """
        chance = self._chance
        system, component = self._mock.system_id, 1
        if chance.random() < 0.25:
            remote = OWN
            if chance.random() < 0.5:
                system = chance.choice([n for n in range(256) if n != system])
            else:
                component = chance.choice((0, *range(2, 256)))
        else:
            self._next_remote = (self._next_remote + chance.randrange(2)) % MAX_REMOTES
            remote = f"198.51.100.7:{10_000 + self._next_remote}"
        kind = chance.choice(READ if chance.random() < 0.9 else tuple(IDS))
        return remote, self._frame(kind, self._values(kind, boot_ms), (system, component))

    def _impossible(self, boot_ms: int) -> bytes:
        """Return a frame with the vehicle's own ids and content that it cannot have sent."""
        chance, own = self._chance, (self._mock.system_id, 1)
        match chance.randrange(4):
            case 0:
                kind = chance.choice(("WIND", "WIND_COV", "ATTITUDE", "VFR_HUD"))
                values = self._values(kind, boot_ms)
                bound = chance.choice(BOUNDS[kind])
                is_float = _fields(kind)[bound.field] in "fd"
                absurd = (math.inf, -math.inf, 1e38, -3e38) if is_float else (60_000, 30_000)
                values[bound.field] = chance.choice(absurd)
            case 1:
                kind = chance.choice(("GLOBAL_POSITION_INT", "ATTITUDE", "SYSTEM_TIME"))
                values = self._true_values(kind)
                values["time_boot_ms"] = self._far(boot_ms)
            case 2:
                kind = "GLOBAL_POSITION_INT"
                values = self._true_values(kind)
                values["time_boot_ms"] = boot_ms + chance.choice((0, 1, 50, 2_000))
                if chance.random() < 0.5:
                    values["lat"] += chance.choice((-1, 1)) * chance.randrange(200_000, 9_000_000)
                else:
                    values["alt"] += chance.choice((-1, 1)) * chance.randrange(900_000, 9_000_000)
            case _:
                kind = "HEARTBEAT"
                values = self._values(kind, boot_ms)
                values["autopilot"] = chance.choice((0, 4, 8, 13, 200))
        return self._frame(kind, values, own)

    def _far(self, boot_ms: int) -> int:
        """Return an implausible time since boot: too far ahead, or back but not near zero."""
        chance = self._chance
        ahead_ms = chance.choice(AHEAD_MS)
        back_ms = chance.randrange(6_000, 20_000)
        return boot_ms + ahead_ms if chance.random() < 0.7 else max(boot_ms - back_ms, 0)

    def _true_values(self, kind: str) -> dict[str, float]:
        """Return the field values of a message that the mock would send now."""
        values: dict[str, float] = dict.fromkeys(_fields(kind), 0)
        if kind == "GLOBAL_POSITION_INT":
            flight = self._mock.flight
            lat_deg, lon_deg = flight.frame.global_position(flight.motion)
            altitude_m = flight.motion.altitude_m
            values |= {
                "lat": round(lat_deg * 1e7),
                "lon": round(lon_deg * 1e7),
                "alt": round(altitude_m * 1e3),
                "relative_alt": round((altitude_m - flight.frame.altitude_m) * 1e3),
            }
        return values

    def _values(self, kind: str, boot_ms: int) -> dict[str, float]:
        """Return random values of the scalar fields: extremes, noise and some usual values."""
        chance = self._chance
        if chance.random() < 0.3:
            values = self._true_values(kind)
        else:
            values = {name: self._number(code) for name, code in _fields(kind).items()}
        if "time_boot_ms" in values:
            near_ms = boot_ms + chance.randrange(-500, 500)
            values["time_boot_ms"] = max(chance.choice((near_ms, self._far(boot_ms), 0)), 0)
        if kind == "HEARTBEAT" and chance.random() < 0.7:
            stack = self._mock.stack
            values |= {"type": stack.mav_type, "autopilot": stack.autopilot}
        for name, value in (("target_system", 255), ("target_component", 190)):
            if name in values and chance.random() < 0.8:
                values[name] = value
        return values

    def _number(self, code: str) -> float:
        chance = self._chance
        if code in "fd":
            return chance.choice((*FLOATS, chance.uniform(-200.0, 200.0)))
        bits = 8 * struct.calcsize(code)
        least = 0 if code.isupper() else -(1 << (bits - 1))
        most = least + (1 << bits) - 1
        return chance.choice((0, 1, least, most, most - 1, chance.randint(least, most)))

    def _frame(self, kind: str, values: dict[str, float], source: tuple[int, int]) -> bytes:
        message = mavlink.mavlink_map[IDS[kind]]
        payload = bytearray(self._chance.randbytes(message.unpacker.size))
        for name, code in _fields(kind).items():
            value = values[name]
            if code not in "fd":
                value = int(value) & ((1 << 8 * struct.calcsize(code)) - 1)
                code = code.upper()
            struct.pack_into(f"<{code}", payload, _offset(kind, name), value)
        return frame_of(message.id, bytes(payload), source, self._chance.randrange(256))


@cache
def _layout(kind: str) -> dict[str, tuple[str, int]]:
    """Return the format code and the offset of each scalar field of a message."""
    message, at, found = mavlink.mavlink_map[IDS[kind]], 0, {}
    sizes = zip(message.ordered_fieldnames, message.lengths, strict=True)
    codes = _codes(message.unpacker.format)
    for (name, length), (code, size) in zip(sizes, codes, strict=True):
        if length == 1 and code != "s":
            found[name] = (code, at)
        at += size
    return found


def _codes(form: str | bytes) -> Iterator[tuple[str, int]]:
    """Yield the letter and the size in bytes of each part of a struct format."""
    number = ""
    for letter in form.decode() if isinstance(form, bytes) else form:
        if letter.isdigit():
            number += letter
        elif letter not in "<>":
            yield letter, struct.calcsize(f"<{number}{letter}")
            number = ""


def _fields(kind: str) -> dict[str, str]:
    return {name: code for name, (code, _) in _layout(kind).items()}


def _offset(kind: str, name: str) -> int:
    return _layout(kind)[name][1]


class ForgedRig(SimulatedVehicle):
    """A simulated vehicle whose client has a separate link, as in the daemon."""

    def __init__(
        self, simulation: Simulation, place: int, scenario: Scenario, each: int, seed: int
    ) -> None:
        """Replace a vehicle of a simulation; ``each`` is the number of forged frames per step."""
        self.__dict__.update(simulation.rigs[place].__dict__)
        section = scenario.flown[place]
        self.link = SharedLink("link", rates_hz=rates_hz(scenario), expects=True)
        self.client = self.link.expect(section.system_id, max_speed_m_s(section, scenario))
        self.gateway.client = self.client
        self.forged = Forged()
        self._each = each
        self._forger = Forger(seed, self.mock)

    def next_timer(self) -> int:
        """Return the time of the next timer of link, mock and network."""
        timers = (self.link.next_timer(), self._up.next_timer(), self._down.next_timer())
        return min(self.mock.next_timer(), *(timer for timer in timers if timer is not None))

    def handle_due(self, now_us: int, service: Engine) -> None:
        """Process all due work, with forged frames before and after the vehicle's frames."""
        self._advance_mock(self._up.receive(now_us), now_us)
        boot_ms = self.mock._now_us() // 1000
        received = self._down.receive(now_us)
        self._forge(self._each // 2, now_us, boot_ms)
        for datagram in received:
            self.link.receive_frames(OWN, frames_of(datagram), now_us)
        self._forge(self._each - self._each // 2, now_us, boot_ms)
        self.link.handle_timer(now_us)
        service.handle_events(self.gateway.events(now_us), now_us)
        for _, remote, datagram in self.link.addressed_to_send():
            self.forged.to_others += remote not in ("", OWN)
            self._up.send(datagram, now_us)
        while self.gateway.link_alarms:
            kind, text = self.gateway.link_alarms.popleft()
            self.forged.alarms[kind] += bool(text)

    def _forge(self, count: int, now_us: int, boot_ms: int) -> None:
        if self.client.stack is None:  # the client binds to the first source: vehicle/sources.py
            return
        for remote, frame in self._forger.frames(count, now_us, boot_ms):
            self.link.receive_frames(remote, [frame], now_us)
            self.forged.frames += 1


def flown(
    scenario: Scenario, journal_path: Path, each: int, most: int, until_s: float, seed: int
) -> Forged:
    """Fly a scenario until a mission time, or until at least ``most`` frames were forged."""
    landscape = landscape_of(scenario)
    journal = Journal(journal_path, header_of(scenario, landscape.digest(), ""), durable=False)
    try:
        simulation = Simulation(scenario, journal, landscape)
        rigs = [
            ForgedRig(simulation, place, scenario, each, seed + place)
            for place in range(len(simulation.rigs))
        ]
        simulation.rigs[:] = rigs
        end_us = round(until_s * 1e6)
        while simulation.clock.now_us < end_us:
            if each and sum(rig.forged.frames for rig in rigs) >= most:
                break
            simulation.step()
    finally:
        journal.close()
    total = Forged(ended_s=simulation.clock.now_us / 1e6)
    for rig in rigs:
        total.frames += rig.forged.frames
        total.alarms += rig.forged.alarms
        total.to_others += rig.forged.to_others
    return total


def difference(alone: Path, disturbed: Path) -> str:
    """Return the first line in which the journals differ; empty if they are equal.

    ``disturbed`` may be shorter. Reports of the quality of the links are left out.
    """
    with alone.open("rb") as one, disturbed.open("rb") as other:
        dues = _without_link_quality(one)
        for number, line in _without_link_quality(other):
            _, due = next(dues, (0, b""))
            if line != due:
                return f"line {number}: {line[:300]!r} instead of {due[:300]!r}"
    return ""


def _without_link_quality(lines: Iterable[bytes]) -> Iterator[tuple[int, bytes]]:
    """Yield number and content of each line, without its checksum, which covers earlier lines."""
    for number, line in enumerate(lines, start=1):
        if b'"type":"LinksReported"' not in line:
            yield number, line.rpartition(b',"crc":')[0]


def compared(
    scenario: Scenario, folder: Path, frames: int, each: int, until_s: float, seed: int
) -> tuple[Forged, str]:
    """Return counts of the forged frames, and the first difference between the journals."""
    forged = flown(scenario, folder / "disturbed.jsonl", each, frames, until_s, seed)
    # A forged time may have put the clock of the first flight far ahead.
    alone_until_s = min(forged.ended_s, until_s) + 1.0
    flown(scenario, folder / "alone.jsonl", 0, 0, alone_until_s, seed)
    return forged, difference(folder / "alone.jsonl", folder / "disturbed.jsonl")


def main() -> None:
    """Print counts and seconds; exit with 1 if the journals differ or a check fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--scenario", default="default")
    parser.add_argument("--each", type=int, default=40, help="forged frames for each step")
    arguments = parser.parse_args()
    scenario = load_scenario(arguments.scenario)
    began_s = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        forged, different = compared(
            scenario,
            Path(folder),
            arguments.frames,
            arguments.each,
            scenario.duration_s,
            arguments.seed,
        )
    click.echo(
        f"{forged.frames} forged frames, seed {arguments.seed}: "
        f"{time.perf_counter() - began_s:.0f} s; alarms {dict(sorted(forged.alarms.items()))}; "
        f"frames sent to others: {forged.to_others}; journals differ: {different or 'nowhere'}"
    )
    enough = forged.frames >= arguments.frames
    sys.exit(bool(different) or bool(forged.to_others) or not enough)


if __name__ == "__main__":
    main()
