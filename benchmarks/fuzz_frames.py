"""Damaged and implausible frames: ``python -m benchmarks.fuzz_frames [--frames N] [--seed N]``.

Bad frames are inserted between numbered good frames: flipped bits, truncated and extended frames,
wrong checksums, lengths, signatures and ids, MAVLink 1, false frame starts, noise, and valid frames
with implausible values. No frame may raise an exception, memory must remain constant, transfers
must end, and the receiver must decode the good frames:

- on datagram links it decodes each good datagram at once;
- on streams it decodes each good frame, unless the bytes before the frame form a frame with a valid
  checksum together with bytes of the good frame. The probability is 1 in 65536 for each false start
  of a known message, and 1 in 256 for a frame without its last byte. The benchmark counts such
  accidental frames. Each such frame may destroy the good frames within its 280 bytes.
"""

import argparse
import math
import random
import resource
import struct
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import click
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.items import MissionItem, loiter_unlimited, waypoint
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.framing import V2, Framer, checksum, field_at, message_id_of
from autopilot_bridge.links.signing import Key, Signing, Timestamps
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.local_frame import LocalFrame
from autopilot_bridge.stacks.stacks import Stack, stack_named
from autopilot_bridge.vehicle.client_events import Connected, TransferFinished

RADIO = mavlink.MAVLINK_MSG_ID_RADIO_STATUS
NOW_US = 1_790_000_000_000_000
BATCH = 500
BAD_IN_TRANSFER = 250
MAX_VIRTUAL_S = 240.0
SMALLEST_GOOD_BYTES = 12
GROWTH_ALLOWED_MB = 16.0
MISSION_IDS = (39, 40, 41, 42, 43, 44, 45, 46, 47, 51, 73, 76, 77, 110)
EDGES = (b"\x00", b"\xff", b"\x7f", b"\x80", struct.pack("<f", math.nan), struct.pack("<f", 1e38))
STATION, VEHICLE = (255, 190), (1, 1)


@dataclass
class Report:
    """Counts of frames and of transfers by outcome."""

    bad: int = 0
    good: int = 0
    lost: int = 0
    by_chance: int = 0  # valid checksums over bytes of a bad frame and the next good frame
    transfers: Counter[str] = field(default_factory=Counter)

    def failures(self) -> list[str]:
        """Return one line for each failed check."""
        found = []
        if self.lost > self.by_chance * (280 // SMALLEST_GOOD_BYTES):
            found.append(f"{self.lost} good frames were lost")
        if self.by_chance > 3 + self.bad / 8000:
            found.append(f"too many bad frames had a correct checksum by chance: {self.by_chance}")
        return found


# Bad frames -----------------------------------------------------------------------------------


def frame_of(message_id: int, payload: bytes, source: tuple[int, int], seq: int) -> bytes:
    """Return a MAVLink 2 frame with any payload; its checksum is valid for a known message."""
    known = message_id in mavlink.mavlink_map
    payload = payload.rstrip(b"\0") or payload[:1]
    head = bytes((len(payload), 0, 0, seq % 256, *source)) + message_id.to_bytes(3, "little")
    crc = checksum(head + payload, message_id) if known else 0xABCD
    return bytes((V2,)) + head + payload + crc.to_bytes(2, "little")


def absurd(chance: random.Random, source: tuple[int, int], target: tuple[int, int]) -> bytes:
    """Return a valid frame with implausible values, such as NaN, 65535 or invalid coordinates."""
    message_id = chance.choice(MISSION_IDS if chance.random() < 0.8 else (*mavlink.mavlink_map,))
    size = mavlink.mavlink_map[message_id].unpacker.size
    payload = bytearray(chance.choice(EDGES) * size)[:size]
    for _ in range(chance.randrange(4)):
        payload[chance.randrange(size)] = chance.randrange(256)
    for name, value in zip(("target_system", "target_component"), target, strict=True):
        at = field_at(message_id, name)
        if at is not None:
            payload[at] = value
    return frame_of(message_id, bytes(payload), source, chance.randrange(256))


def old_version(chance: random.Random) -> bytes:
    message = mavlink.MAVLink_statustext_message(chance.randrange(8), b"MAVLink 1")
    return bytes(message.pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=True))


def bits(chance: random.Random, frame: bytes) -> bytes:
    """Flip one to eight bits."""
    changed = bytearray(frame)
    for _ in range(chance.randint(1, 8)):
        changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
    return bytes(changed)


def head(chance: random.Random, frame: bytes) -> bytes:
    """Change one byte of the header: length, flags, sequence, source or id."""
    changed = bytearray(frame)
    changed[chance.randrange(1, 10)] = chance.choice((0, 1, 2, 255, chance.randrange(256)))
    return bytes(changed)


def noise(chance: random.Random, frame: bytes) -> bytes:
    """Return random bytes, often with the first bytes of a frame."""
    del frame
    return b"".join(
        chance.choice((b"\xfd\xff\x00", b"\xfd", b"\xfe\xff", chance.randbytes(8)))
        for _ in range(chance.randint(1, 6))
    )


WRONG_KEY: Signing = Signing(Key(b"w" * 32), Timestamps(lambda: NOW_US))
MUTATIONS: tuple[Callable[[random.Random, bytes], bytes], ...] = (
    bits,
    head,
    noise,
    lambda chance, frame: frame[: chance.randrange(1, len(frame))],
    lambda chance, frame: frame + chance.randbytes(chance.randint(1, 300)),
    lambda chance, frame: frame[:9] + chance.randbytes(chance.randint(0, 40)) + frame[9:],
    lambda chance, frame: frame[:-2] + chance.randbytes(2),
    lambda chance, frame: bytes((V2, 255, chance.randrange(2))) + frame[3:],
    lambda chance, frame: frame_of(60_000 + chance.randrange(999), frame[10:-2], VEHICLE, 0),
    lambda chance, frame: old_version(chance),
    lambda chance, frame: WRONG_KEY.sign(frame, 1) if frame[2] == 0 else frame[1:],
)


def bad_frame(chance: random.Random, frame: bytes) -> bytes:
    """Return the frame after a random mutation, or two mutations of it in sequence."""
    joined = chance.choices((1, 2), (9, 1))[0]
    return b"".join(chance.choice(MUTATIONS)(chance, frame) for _ in range(joined))


# Framing and codec ----------------------------------------------------------------------------


def counted(codec: Codec, number: int) -> bytes:
    """Return a good frame that contains a unique number."""
    return codec.encode(mavlink.MAVLink_named_value_int_message(number, b"counted", number))


def stream_part(chance: random.Random, count: int, report: Report) -> None:
    """Send bad and good frames through one stream in parts of random length."""
    framer, sender, receiver = Framer(), Codec(*VEHICLE), Codec(*STATION)
    for begin in range(0, count, BATCH):
        good: list[bytes] = []
        parts: list[bytes] = []
        for number in range(min(BATCH, count - begin)):
            parts.append(bad_frame(chance, counted(sender, 2 * (begin + number))))
            good.append(counted(sender, 2 * (begin + number) + 1))
            parts.append(good[-1])
        stream = b"".join(parts) + bytes(600)
        found: list[bytes] = []
        at = 0
        while at < len(stream):
            cut = chance.choice((1, 10, 100, 1000))
            found += framer.feed(stream[at : at + cut])
            at += cut
        receiver.decode(b"".join(found))
        _compare(good, parts, found, report)


def datagram_part(chance: random.Random, count: int, report: Report) -> None:
    """Send bad and good frames as datagrams; decode them and check their signatures."""
    framer, sender, receiver = Framer(), Codec(*VEHICLE), Codec(*STATION)
    signing = Signing(Key(b"k" * 32), Timestamps(lambda: NOW_US))
    for number in range(count):
        found = framer.feed_datagram(bad_frame(chance, counted(sender, 0)))
        good = counted(sender, number + 1)
        received = framer.feed_datagram(good)
        if received[-1:] != [good]:
            raise AssertionError("a good datagram was lost or delayed")
        found += received
        receiver.decode(b"".join(found))
        if any(signing.accepts(frame) for frame in found if message_id_of(frame) != RADIO):
            raise AssertionError("a frame without a valid signature was accepted")
    report.good += count
    report.bad += count


def _compare(good: list[bytes], parts: list[bytes], found: list[bytes], report: Report) -> None:
    received = {*found}
    report.good += len(good)
    report.bad += len(parts) - len(good)
    report.lost += sum(frame not in received for frame in good)
    sent = b"(separator of frames)".join(parts)
    defined = (frame for frame in received if message_id_of(frame) in mavlink.mavlink_map)
    report.by_chance += sum(frame not in sent for frame in defined)


# Transfers ------------------------------------------------------------------------------------


def items_of(count: int) -> tuple[MissionItem, ...]:
    """Return a mission of ``count`` items."""
    points = [waypoint(36.302 + 1e-3 * n, -84.2, 400.0) for n in range(count - 1)]
    return (*points, loiter_unlimited(36.31, -84.19, 420.0, -90.0))


def transfer_part(chance: random.Random, count: int, report: Report) -> None:
    """Send bad frames to client and autopilot during mission transfers."""
    stacks = [stack_named(name, "plane") for name in ("px4", "ardupilot")]
    while count > 0:
        bad = min(count, BAD_IN_TRANSFER)
        outcome = _transfer(chance, chance.choice(stacks), bad, by_file=chance.random() < 0.5)
        report.transfers[outcome] += 1
        report.bad += bad
        count -= bad


def _transfer(chance: random.Random, stack: Stack, bad: int, by_file: bool) -> str:
    """Upload a mission amid bad frames; return its outcome.

    Raises AssertionError if the transfer does not end.
    """
    mock = MockAutopilot(stack, LocalFrame(36.3, -84.2, 300.0))
    client, now_us, transfer_id = NativeClient(), 0, None
    last = {"up": counted(Codec(*STATION), 1), "down": counted(Codec(*VEHICLE), 1)}
    while now_us < MAX_VIRTUAL_S * 1e6:
        now_us = max(now_us, min(client.next_timer(), mock.next_timer()))
        mock.handle_timer(now_us)
        client.handle_timer(now_us)
        for _ in range(20):  # limited, because the two sides may reply to each other endlessly
            up, down = client.data_to_send(), mock.data_to_send()
            if not up and not down:
                break
            last.update({k: v[-1] for k, v in (("up", up), ("down", down)) if v})
            for datagram in up:
                mock.receive_data(datagram, now_us)
            for datagram in down:
                client.receive_data(datagram, now_us)
            for _ in range(min(bad if transfer_id else 0, chance.randint(1, 5))):
                bad -= 1
                _disturb(chance, client, mock, last, now_us)
            now_us += 500
            for event in iter(client.next_event, None):
                if isinstance(event, Connected) and transfer_id is None:
                    transfer_id = client.upload(items_of(12), now_us, by_file=by_file)
                if isinstance(event, TransferFinished) and event.transfer_id == transfer_id:
                    for _ in range(bad):
                        _disturb(chance, client, mock, last, now_us)
                    return event.result.outcome
    raise AssertionError("a transfer did not end")


def _disturb(
    chance: random.Random,
    client: NativeClient,
    mock: MockAutopilot,
    last: dict[str, bytes],
    now_us: int,
) -> None:
    upwards = chance.random() < 0.5
    ends = (STATION, VEHICLE) if upwards else (VEHICLE, STATION)
    real = last["up" if upwards else "down"]
    bad = absurd(chance, *ends) if chance.random() < 0.5 else bad_frame(chance, real)
    (mock if upwards else client).receive_data(bad, now_us)


# ----------------------------------------------------------------------------------------------


def fuzz(bad_frames: int, seed: int) -> Report:
    """Send half of the bad frames through streams, the others as datagrams and in transfers."""
    chance, report = random.Random(seed), Report()
    stream_part(chance, bad_frames // 2, report)
    datagram_part(chance, bad_frames // 4, report)
    transfer_part(chance, bad_frames - bad_frames // 2 - bad_frames // 4, report)
    return report


def peak_mb() -> float:
    """Return the peak resident memory of this process in MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Print counts, seconds and memory; exit with 1 if a check fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    fuzz(arguments.frames // 20, arguments.seed + 1)  # a first run fills caches and allocators
    before_mb, began_s = peak_mb(), time.perf_counter()
    report = fuzz(arguments.frames, arguments.seed)
    taken_s, grown_mb = time.perf_counter() - began_s, peak_mb() - before_mb
    failures = report.failures()
    if grown_mb > GROWTH_ALLOWED_MB:
        failures.append(f"memory grew by {grown_mb:.1f} MB")
    click.echo(
        f"{report.bad} bad frames, seed {arguments.seed}: {taken_s:.1f} s, "
        f"{report.bad / taken_s:.0f} a second\n"
        f"good frames between them: {report.good}, lost {report.lost}; "
        f"correct checksums by chance {report.by_chance}\n"
        f"transfers amid bad frames: {dict(sorted(report.transfers.items()))}\n"
        f"peak memory: {before_mb:.1f} MB before, {grown_mb:+.1f} MB"
    )
    sys.exit("; ".join(failures) or 0)


if __name__ == "__main__":
    main()
