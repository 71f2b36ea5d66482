"""Transfers one after another, sans-IO: what is under way, what comes after it, how it ended.

upload: file -> read the file back -> [begin -> [cut off the old tail -> read it back]],
        where the autopilot takes whole files, or else
        [hold] -> items -> [read back] -> begin -> [fly on]
download: file, or else items
clear: itself

It holds where the autopilot would otherwise fly a list that is half overwritten. It reads back if a
check is requested, and to report what the vehicle holds where the upload's end does not show it. If
a failsafe or a pilot by radio takes over meanwhile, the mode is not changed, and a mission that
would need a command is not begun.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from pymavlink.dialects.v20.ardupilotmega import MAV_MISSION_ERROR

from autopilot_bridge.items import MissionItem, jumps_moved
from autopilot_bridge.links.codec import Message
from autopilot_bridge.missions.download import MissionClear, MissionDownload
from autopilot_bridge.missions.ftp import FtpDownload, FtpUpload, leaves_old_tail, next_session
from autopilot_bridge.missions.plan_id import mission_id_of
from autopilot_bridge.missions.read_back import same_mission
from autopilot_bridge.missions.transfer import (
    MISSION_TYPES,
    Address,
    Holds,
    Kind,
    TransferResult,
    TransferTiming,
)
from autopilot_bridge.missions.truncate import Truncate
from autopilot_bridge.missions.upload import MissionUpload
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle.asked_modes import AskedModes
from autopilot_bridge.vehicle.begin import Begin as MissionBegin
from autopilot_bridge.vehicle.begin import Onboard
from autopilot_bridge.vehicle.mode import SetMode

NOTHING = Onboard(None, None, False)
LANDINGS = (21, 85)  # MAV_CMD_NAV_LAND, MAV_CMD_NAV_VTOL_LAND
LAST_NAV = 95  # MAV_CMD_NAV_LAST; what comes behind is done on the way
# Behind these a vehicle never gets by itself: loiter without end, return, land.
LAST_FOR_GOOD = (17, 20, 21)
Begin = Literal["restart", "keep"] | int
Transfer = (
    MissionUpload
    | MissionDownload
    | MissionClear
    | MissionBegin
    | SetMode
    | Truncate
    | FtpUpload
    | FtpDownload
)


class Seen(NamedTuple):
    """What is known of the vehicle."""

    stack: Stack
    target: tuple[int, int]
    current: int | None  # MISSION_CURRENT.seq
    total: int | None  # MISSION_CURRENT.total, home included
    armed: bool
    custom_mode: int
    plan_id: int | None = None  # MISSION_CURRENT.mission_id
    unfit: bool = False  # the mission on board is none to fly

    @property
    def in_mission(self) -> bool:
        """Whether it flies its mission."""
        return self.armed and self.custom_mode == self.stack.mission_mode


@dataclass
class Job:
    """A transfer asked for: what is under way for it, and what it needs to end well."""

    transfer_id: int
    action: Literal["upload", "download", "clear"]
    kind: Kind
    items: tuple[MissionItem, ...] = ()
    begin: Begin = "restart"  # which item of a new mission is flown next
    check: bool = False
    holds_first: bool = False  # rather than fly a list that is being overwritten
    by_file: bool = True  # where the autopilot takes files
    under_way: Transfer | None = None
    wire_items: tuple[MissionItem, ...] = ()
    hidden: int = 0  # items the user does not know of: ArduPilot's home
    shorter: bool = False  # than a mission being flown: a file leaves that one's tail
    old_tail: bool = False  # old items still stand behind the new ones of a file
    paused: bool = False  # it holds because of this job
    uploaded: TransferResult | None = None  # how the upload itself ended
    before: Onboard = NOTHING
    looked: bool = False  # it was read back after it should have begun
    taken: str = ""  # why the mode is not changed any more; "" if it may be
    cancelled: bool = False


class Jobs:
    """The transfers of one vehicle: one at a time."""

    def __init__(
        self,
        own: tuple[int, int],
        timing: TransferTiming,
        report: Callable[[Job, TransferResult, int], None],
        asked_modes: AskedModes,
    ) -> None:
        """``report`` is told how each job ended, and when."""
        self._own = own
        self._asked_modes = asked_modes
        self._timing = timing
        self._report = report
        self._next_id = 1
        self._session = 0
        self._job: Job | None = None
        self._queue: list[Job] = []

    @property
    def idle(self) -> bool:
        """Whether no job waits and none is under way."""
        return self._job is None and not self._queue

    def add(self, job: Job, now_us: int) -> int:
        """Queue a job; an upload takes the place of one of its kind that has not begun."""
        job.transfer_id = self._next_id
        self._next_id += 1
        for waiting in list(self._queue):
            if job.action == "upload" and (waiting.action, waiting.kind) == ("upload", job.kind):
                self._queue.remove(waiting)
                ended = TransferResult("superseded", "a newer one came", holds="the old one")
                self._report(waiting, ended, now_us)
        self._queue.append(job)
        return job.transfer_id

    def cancel(self, transfer_id: int, stack: Stack, now_us: int) -> list[Message]:
        """End a job; its outcome is reported when it has really ended."""
        for waiting in list(self._queue):
            if waiting.transfer_id == transfer_id:
                self._queue.remove(waiting)
                ended = TransferResult("cancelled", "it had not begun", holds="the old one")
                self._report(waiting, ended, now_us)
        job = self._job
        if job is None or job.transfer_id != transfer_id or job.under_way is None:
            return []
        job.cancelled = True
        return job.under_way.cancel(stack.cancels_after_us, now_us)

    def leave_mode(self) -> None:
        """The mode is somebody else's from now on: no upload holds or flies on.

        One that changes the mode right now is given up.
        """
        job = self._job
        for asked in (*self._queue, *(() if job is None else (job,))):
            asked.holds_first = asked.paused = False
        if job is None:
            return
        if isinstance(job.under_way, SetMode) and job.under_way.result is None:
            job.under_way.result = TransferResult("cancelled", "an urgent order took its place")

    def taken(self, why: str) -> None:
        """The autopilot or a pilot has taken over: the current upload no longer changes the mode.

        Uploads that have not begun yet check the mode when they begin.
        """
        job = self._job
        if job is None or job.action != "upload":
            return
        job.taken = job.taken or why
        if isinstance(job.under_way, SetMode | MissionBegin):
            job.under_way.leave(why)

    def begin_next(self, seen: Seen, now_us: int) -> list[Message]:
        """Begin what waits if nothing is under way."""
        if self._job is not None or not self._queue:
            return []
        job = self._job = self._queue.pop(0)
        is_mission = job.kind == "mission"
        job.hidden = 1 if seen.stack.item_0_is_home and is_mission else 0
        if job.begin == "keep":
            job.begin = max((seen.current or 0) - job.hidden, 0)
        job.before = Onboard(seen.current, seen.plan_id, seen.unfit)
        job.begin = 0 if job.begin == "restart" else min(job.begin, max(len(job.items) - 1, 0))
        job.wire_items = (*job.items[: job.hidden], *jumps_moved(job.items, job.hidden))
        return self._begin(job, self._first(job, seen), now_us)

    def _first(self, job: Job, seen: Seen) -> Transfer:
        address = self._address(job, seen)
        if job.action == "clear":
            return MissionClear(address, self._timing)
        by_file = job.by_file and seen.stack.mission_files
        if job.action == "download":
            return self._read_file(address) if by_file else MissionDownload(address, self._timing)
        flying = job.kind == "mission" and seen.in_mission
        held = seen.stack.most_items if seen.total is None else seen.total
        job.shorter = leaves_old_tail(flying, held, len(job.wire_items))
        if by_file and job.items and (not job.shorter or job.items[-1].command in LAST_FOR_GOOD):
            most, self._session = seen.stack.most_items, next_session(self._session)
            return FtpUpload(address, job.wire_items, most, self._session, self._timing)
        return self._by_items(job, seen)

    def _by_items(self, job: Job, seen: Seen) -> Transfer:
        address = self._address(job, seen)
        job.paused = job.holds_first and job.kind == "mission" and seen.in_mission
        if job.paused and not seen.stack.atomic_upload:
            stack = seen.stack
            return SetMode(address, stack, stack.mission_mode, stack.hold_mode, self._timing)
        job.paused = False
        return self._upload(job, address, seen.stack)

    def _upload(self, job: Job, address: Address, stack: Stack) -> MissionUpload:
        first, ahead = self._seq(job), stack.items_ahead
        plan_id = mission_id_of(job.wire_items, stack)
        return MissionUpload(address, job.wire_items, first, self._timing, ahead, plan_id)

    def _read_file(self, address: Address) -> Transfer:
        self._session = next_session(self._session)
        return FtpDownload(address, self._session, self._timing)

    def _address(self, job: Job, seen: Seen) -> Address:
        return Address(self._own, seen.target, MISSION_TYPES[job.kind])

    def _seq(self, job: Job) -> int:
        assert isinstance(job.begin, int)
        return job.hidden + job.begin

    def _begin(self, job: Job, transfer: Transfer, now_us: int) -> list[Message]:
        job.under_way = transfer
        return transfer.start(now_us)

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Hand a message to what is under way."""
        if self._job is None or self._job.under_way is None:
            return []
        messages = self._job.under_way.receive(message, now_us)
        if messages and isinstance(self._job.under_way, SetMode):
            self._asked_modes.ask((self._job.under_way.wanted,), now_us)
        return messages

    def next_timer(self) -> int | None:
        """When to call ``handle_timer``."""
        if self._job is None or self._job.under_way is None:
            return None
        return self._job.under_way.next_timer()

    def handle_timer(self, now_us: int) -> list[Message]:
        """Do what is due."""
        if self._job is None or self._job.under_way is None:
            return []
        return self._job.under_way.handle_timer(now_us)

    def step(self, seen: Seen, now_us: int) -> list[Message]:
        """See whether what is under way has ended, and begin what comes after it."""
        job = self._job
        if job is None or job.under_way is None or job.under_way.result is None:
            return []
        if isinstance(job.under_way, FtpUpload | FtpDownload):
            self._session = job.under_way.session  # it may have taken others
        following = self._after(job, job.under_way, job.under_way.result, seen)
        if not isinstance(following, TransferResult):
            return self._begin(job, following, now_us)
        self._job = None
        if job.cancelled and following.outcome in ("failed", "unknown", "rejected"):
            following = replace(following, outcome="cancelled")
        self._report(job, following, now_us)
        return []

    def _after(
        self, job: Job, ended: Transfer, result: TransferResult, seen: Seen
    ) -> Transfer | TransferResult:
        """The next part of a job, or its result."""
        stack = seen.stack
        if job.action == "download" and result.items is not None:
            return replace(result, items=users_items(job, result.items))
        if job.action == "download" and isinstance(ended, FtpDownload) and not job.cancelled:
            return MissionDownload(self._address(job, seen), self._timing)
        if job.action != "upload":
            return result
        address = self._address(job, seen)
        if isinstance(ended, SetMode):
            return self._after_mode(job, result, address, stack)
        if isinstance(ended, MissionBegin):
            return self._after_begin(job, ended, result, address, stack)
        if isinstance(ended, Truncate):
            return self._read_file(address)
        if isinstance(ended, FtpUpload):
            if result.outcome == "rejected" and not job.cancelled:
                return self._by_items(job, seen)
            job.uploaded = result
            return self._read_file(address)
        if isinstance(ended, FtpDownload):
            return self._after_file(job, result, seen)
        if isinstance(ended, MissionUpload):
            job.uploaded = result
            holds = held_after(ended, result, stack)
            if result.outcome == "accepted" and not job.check:
                return self._begun(job, address, seen)
            if result.outcome == "accepted" or holds in ("one of both", "not known"):
                return MissionDownload(address, self._timing)  # never guess: read it back
            return replace(result, holds=holds)
        assert job.uploaded is not None
        if result.items is None:  # nothing can be read either
            words = f"{job.uploaded.reason}; and reading it back: {result.reason}"
            outcome = "unknown" if job.uploaded.outcome == "accepted" else job.uploaded.outcome
            holds = "one of both" if stack.atomic_upload else "not known"
            return replace(job.uploaded, outcome=outcome, reason=words, items=None, holds=holds)
        if same_mission(job.wire_items, result.items, stack, MISSION_TYPES[job.kind]):
            if job.uploaded.outcome == "cancelled":
                return replace(job.uploaded, items=job.items, holds="the new one")
            return self._begun(job, address, seen)
        read = users_items(job, result.items)
        read_holds: Holds = "the old one" if stack.atomic_upload else "a mixture"
        if job.uploaded.outcome in ("accepted", "unknown"):
            words = "the vehicle holds another mission"
            return TransferResult("failed", words, items=read, holds=read_holds)
        return replace(job.uploaded, items=read, holds=read_holds)

    def _after_file(self, job: Job, read: TransferResult, seen: Seen) -> Transfer | TransferResult:
        """After a file was written and read back."""
        assert job.uploaded is not None
        untouched = job.uploaded.outcome == "failed"
        if read.items is None:
            words = f"{job.uploaded.reason}; and reading it back: {read.reason}"
            outcome = "unknown" if job.uploaded.outcome == "accepted" else job.uploaded.outcome
            # A shorter file may stand before the old tail, which is neither of both.
            doubtful: Holds = "not known" if job.shorter else "one of both"
            holds: Holds = "the old one" if untouched else doubtful
            return replace(job.uploaded, outcome=outcome, reason=words, items=None, holds=holds)
        mission_type = MISSION_TYPES[job.kind]
        if same_mission(job.wire_items, read.items, seen.stack, mission_type):
            if job.old_tail:  # cut off by now, and the new mission has begun
                return accepted(job)
            return self._begun(job, self._address(job, seen), seen)
        to_go_on = not untouched and not job.cancelled
        begun = read.items[: len(job.wire_items)]
        longer = job.kind == "mission" and same_mission(job.wire_items, begun, seen.stack)
        if to_go_on and longer and not job.old_tail:
            job.old_tail = True
            return self._begun(job, self._address(job, seen), seen)
        if to_go_on:  # not applied, or in part: a command it does not know
            job.uploaded, job.old_tail = None, False
            return self._by_items(job, seen)
        holds = "the old one" if untouched else "a mixture"
        read_items = users_items(job, read.items)
        return TransferResult("failed", job.uploaded.reason, items=read_items, holds=holds)

    def _after_mode(
        self, job: Job, result: TransferResult, address: Address, stack: Stack
    ) -> Transfer | TransferResult:
        """After the hold before an upload, or after flying on."""
        if job.uploaded is None:
            if result.outcome == "accepted":
                return self._upload(job, address, stack)
            words = f"it would not hold for the upload: {result.reason}"
            return replace(result, reason=words, holds="the old one")
        if result.outcome == "accepted" or job.taken:
            return accepted(job)
        words = f"the vehicle holds the mission but did not fly on: {result.reason}"
        return TransferResult("failed", words, items=job.items, holds="the new one")

    def _begun(self, job: Job, address: Address, seen: Seen) -> Transfer | TransferResult:
        """The step that begins the mission on board."""
        if job.kind != "mission" or not job.items or job.looked:
            return accepted(job)
        if job.taken and not seen.stack.atomic_upload:
            return self._not_begun(job, TransferResult("failed", job.taken))
        plan_id, seq = mission_id_of(job.wire_items, seen.stack), self._seq(job)
        later = range(seq, len(job.wire_items))
        shown = next((at for at in later if job.wire_items[at].command <= LAST_NAV), seq)
        before = job.before._replace(seq=seen.current)
        count = len(job.wire_items)
        return MissionBegin(address, seq, shown, count, plan_id, before, self._timing)

    def _after_begin(
        self,
        job: Job,
        ended: MissionBegin,
        result: TransferResult,
        address: Address,
        stack: Stack,
    ) -> Transfer | TransferResult:
        if ended.other_list and not job.cancelled:  # never guess: read it back
            job.looked = True
            return MissionDownload(address, self._timing)
        if result.outcome != "accepted":
            return self._not_begun(job, result)
        if job.old_tail:
            return Truncate(address, len(job.wire_items), self._timing)
        if job.paused and not job.taken:
            return SetMode(address, stack, stack.hold_mode, stack.mission_mode, self._timing)
        return accepted(job)

    def _not_begun(self, job: Job, result: TransferResult) -> TransferResult:
        if job.old_tail:
            words = "the vehicle holds the mission followed by the end of the old one, and"
            words = f"{words} did not begin it: {result.reason}"
            return TransferResult("failed", words, holds="a mixture")
        if result.outcome == "rejected":
            words = f"{result.reason}{lacks(job)}"
            return replace(result, reason=words, items=job.items, holds="the new one")
        words = f"the vehicle holds the mission but did not begin it: {result.reason}"
        return TransferResult(result.outcome, words, items=job.items, holds="the new one")


def lacks(job: Job) -> str:
    """A likely reason why PX4 rejects a mission, which PX4 1.17 does not report."""
    if any(item.command in LANDINGS for item in job.items):
        return ""
    return "; it has no landing, which PX4 requires of planes unless MIS_TKO_LAND_REQ is 0"


def accepted(job: Job) -> TransferResult:
    """The result of an upload that is held, and flown unless autopilot or pilot took over."""
    words = f"accepted; {job.taken}, and its mode was not changed" if job.taken else "accepted"
    return TransferResult("accepted", words, 0, None, job.items, "the new one")


def users_items(job: Job, wire_items: tuple[MissionItem, ...]) -> tuple[MissionItem, ...]:
    """Items as the user knows them: without home, jumps counted from the first."""
    return jumps_moved(wire_items[job.hidden :], -job.hidden)


def held_after(ended: MissionUpload, result: TransferResult, stack: Stack) -> Holds:
    """What the vehicle holds after an upload, as far as its end alone tells."""
    if result.outcome == "accepted":
        return "the new one"
    if not ended.touched:
        return "the old one"
    if not stack.atomic_upload:
        return "not known"
    doubtful = result.outcome in ("unknown", "cancelled") or result.code == MAV_MISSION_ERROR
    return "one of both" if doubtful else "the old one"
