"""Queues transfers, and runs the active transfer through its phases.

``transfer_states.py`` contains the phases of a transfer and their allowed order.

During an upload the vehicle holds if its autopilot would otherwise fly a partly overwritten list.
The list is read back if a check is requested, or if the result of the upload does not show which
mission is on board. After a failsafe, or if a pilot changed the mode, a transfer does not change
the mode and does not start a mission that needs a start command.
"""

from collections.abc import Callable
from dataclasses import replace

from pymavlink.dialects.v20.ardupilotmega import MAV_MISSION_ERROR

from autopilot_bridge.items import LANDINGS, MissionItem, jumps_moved
from autopilot_bridge.links.codec import Message
from autopilot_bridge.missions.download import MissionClear, MissionDownload
from autopilot_bridge.missions.ftp import FtpDownload, FtpUpload, leaves_old_tail, next_session
from autopilot_bridge.missions.plan_id import mission_id_of
from autopilot_bridge.missions.read_back import same_mission
from autopilot_bridge.missions.transfer import (
    MISSION_TYPES,
    Address,
    Holds,
    TransferResult,
    TransferTiming,
)
from autopilot_bridge.missions.truncate import Truncate
from autopilot_bridge.missions.upload import MissionUpload
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle.commanded_modes import CommandedModes
from autopilot_bridge.vehicle.mission_activation import MissionActivation, Onboard
from autopilot_bridge.vehicle.mode_change import ModeChange
from autopilot_bridge.vehicle.transfer_states import Action, Job, Phase, Transfer, VehicleState

LAST_NAV = 95  # MAV_CMD_NAV_LAST; commands with higher numbers are not legs of the flight
# A vehicle never continues to the item after one of these items: unlimited loiter, return, land.
LAST_FOR_GOOD = (17, 20, 21)
Step = tuple[Phase, Transfer]
Following = Step | TransferResult


class TransferQueue:
    """The transfers of one vehicle, which run one at a time."""

    def __init__(
        self,
        own: tuple[int, int],
        timing: TransferTiming,
        report: Callable[[Job, TransferResult, int], None],
        commanded_modes: CommandedModes,
    ) -> None:
        """Create an empty queue; ``report`` is called with each job's result and its time."""
        self._own = own
        self._commanded_modes = commanded_modes
        self._timing = timing
        self._report = report
        self._next_id = 1
        self._session = 0
        self._job: Job | None = None
        self._queue: list[Job] = []

    @property
    def idle(self) -> bool:
        """Whether no job is queued or active."""
        return self._job is None and not self._queue

    def enqueue(self, job: Job, now_us: int) -> int:
        """Queue a job and return its id; an upload replaces a queued upload of the same kind."""
        job.transfer_id = self._next_id
        self._next_id += 1
        for waiting in list(self._queue):
            if job.action == "upload" and (waiting.action, waiting.kind) == ("upload", job.kind):
                self._queue.remove(waiting)
                ended = TransferResult(
                    "superseded", "a newer upload replaced it", holds="the old one"
                )
                self._report(waiting, ended, now_us)
        self._queue.append(job)
        return job.transfer_id

    def cancel(self, transfer_id: int, stack: Stack, now_us: int) -> list[Message]:
        """Cancel a job; its result is reported when the autopilot has ended the transfer."""
        for waiting in list(self._queue):
            if waiting.transfer_id == transfer_id:
                self._queue.remove(waiting)
                ended = TransferResult(
                    "cancelled", "the transfer had not begun", holds="the old one"
                )
                self._report(waiting, ended, now_us)
        job = self._job
        if job is None or job.transfer_id != transfer_id or job.exchange is None:
            return []
        job.cancelled = True
        return job.exchange.cancel(stack.cancels_after_us, now_us)

    def cancel_missions(self, stack: Stack, why: str, now_us: int) -> list[Message]:
        """Cancel all mission uploads because the vehicle returns, with ``why`` as the reason.

        PX4 returns along its mission to the landing at the end. A mission that arrives during the
        return, or a change of the current item, makes PX4 1.17 fly the mission from that item on.
        """
        jobs = [*self._queue, *([] if self._job is None else [self._job])]
        uploads = [job for job in jobs if (job.action, job.kind) == ("upload", "mission")]
        messages = []
        for job in uploads:
            job.override = why
            if isinstance(job.exchange, MissionActivation):
                job.exchange.stop_commands(why)
            elif isinstance(job.exchange, MissionUpload) or job.exchange is None:
                messages += self.cancel(job.transfer_id, stack, now_us)
            if job.cancelled and job.exchange is not None and job.exchange.result is not None:
                job.exchange.result = replace(job.exchange.result, reason=why)
        return messages

    def release_mode(self) -> None:
        """Prevent uploads from changing the mode from now on, because a command controls the mode.

        A mode change in progress is ended.
        """
        job = self._job
        for queued in (*self._queue, *(() if job is None else (job,))):
            queued.holds_first = queued.paused = False
        if job is None:
            return
        if isinstance(job.exchange, ModeChange) and job.exchange.result is None:
            job.exchange.result = TransferResult("cancelled", "an urgent order replaced it")

    def mode_overridden(self, why: str, armed: bool = True) -> None:
        """Prevent the current upload from changing the mode.

        The autopilot or a pilot has changed the mode. Queued uploads check the mode when they
        begin. A disarmed ArduPlane leaves AUTO by itself when its old mission is cleared; the first
        item of its new mission is still made current.
        """
        job = self._job
        if job is None or job.action != "upload":
            return
        job.override = job.override or why
        stopped = ModeChange | MissionActivation if armed else ModeChange
        if isinstance(job.exchange, stopped):
            job.exchange.stop_commands(why)

    def start_next(self, state: VehicleState, now_us: int) -> list[Message]:
        """Start the next job if none is active."""
        if self._job is not None or not self._queue:
            return []
        job = self._job = self._queue.pop(0)
        is_mission = job.kind == "mission"
        job.hidden = 1 if state.stack.item_0_is_home and is_mission else 0
        if job.begin == "keep":
            job.begin = max((state.current or 0) - job.hidden, 0)
        job.before = Onboard(state.current, state.plan_id, state.unfit)
        job.begin = 0 if job.begin == "restart" else min(job.begin, max(len(job.items) - 1, 0))
        job.wire_items = (*job.items[: job.hidden], *jumps_moved(job.items, job.hidden))
        return self._begin(job, *self._first(job, state), now_us)

    def _first(self, job: Job, state: VehicleState) -> Step:
        address = self._address(job, state)
        if job.action == "clear":
            return Phase.CLEARING, MissionClear(address, self._timing)
        by_file = job.by_file and state.stack.mission_files
        if job.action == "download":
            return self._read_file(address) if by_file else self._read_items(address)
        flying = job.kind == "mission" and state.in_mission
        held = state.stack.max_items if state.total is None else state.total
        job.shorter = leaves_old_tail(flying, held, len(job.wire_items))
        if by_file and job.items and (not job.shorter or job.items[-1].command in LAST_FOR_GOOD):
            max_items, self._session = state.stack.max_items, next_session(self._session)
            upload = FtpUpload(address, job.wire_items, max_items, self._session, self._timing)
            return Phase.WRITING_FILE, upload
        return self._by_items(job, state)

    def _by_items(self, job: Job, state: VehicleState) -> Step:
        stack = state.stack
        job.paused = job.holds_first and job.kind == "mission" and state.in_mission
        job.paused = job.paused and not stack.atomic_upload
        if job.paused:
            return Phase.HOLDING, self._mode_change(job, state, stack.mission_mode, stack.hold_mode)
        return self._send_items(job, state)

    def _mode_change(self, job: Job, state: VehicleState, before: int, new_mode: int) -> ModeChange:
        return ModeChange(self._address(job, state), state.stack, before, new_mode, self._timing)

    def _send_items(self, job: Job, state: VehicleState) -> Step:
        stack = state.stack
        plan_id = mission_id_of(job.wire_items, stack)
        upload = MissionUpload(
            *(self._address(job, state), job.wire_items, self._seq(job), self._timing),
            *(stack.items_ahead, plan_id),
        )
        return Phase.SENDING_ITEMS, upload

    def _read_file(self, address: Address) -> Step:
        self._session = next_session(self._session)
        return Phase.READING_FILE, FtpDownload(address, self._session, self._timing)

    def _read_items(self, address: Address) -> Step:
        return Phase.READING_ITEMS, MissionDownload(address, self._timing)

    def _address(self, job: Job, state: VehicleState) -> Address:
        return Address(self._own, state.target, MISSION_TYPES[job.kind])

    def _seq(self, job: Job) -> int:
        assert isinstance(job.begin, int)
        return job.hidden + job.begin

    def _begin(self, job: Job, phase: Phase, transfer: Transfer, now_us: int) -> list[Message]:
        job.enter(phase, transfer)
        return transfer.start(now_us)

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Pass a message to the active job."""
        if self._job is None or self._job.exchange is None:
            return []
        messages = self._job.exchange.receive(message, now_us)
        if messages and isinstance(self._job.exchange, ModeChange):
            self._commanded_modes.expect((self._job.exchange.new_mode,), now_us)
        return messages

    def link_switched(self, now_us: int) -> list[Message]:
        """Continue the active transfer over another link of the vehicle.

        Each link of PX4 has its own transfer state machine, and ArduPilot sends its requests over
        the link on which an upload began. Item-by-item transfers therefore begin again. Other
        requests are repeated over the new link when their replies are overdue.
        """
        exchange = None if self._job is None else self._job.exchange
        if isinstance(exchange, MissionUpload | MissionDownload) and exchange.result is None:
            return exchange.begin_again(now_us)
        return []

    def next_timer(self) -> int | None:
        """Return the time of the next ``handle_timer`` call; None if no job is active."""
        if self._job is None or self._job.exchange is None:
            return None
        return self._job.exchange.next_timer()

    def handle_timer(self, now_us: int) -> list[Message]:
        """Run all actions due at ``now_us``."""
        if self._job is None or self._job.exchange is None:
            return []
        return self._job.exchange.handle_timer(now_us)

    def continue_jobs(self, state: VehicleState, now_us: int) -> list[Message]:
        """Start the next phase, or report the result, if the active exchange has ended."""
        job = self._job
        if job is None or job.exchange is None or job.exchange.result is None:
            return []
        if isinstance(job.exchange, FtpUpload | FtpDownload):
            self._session = job.exchange.session  # the exchange may have changed the session id
        following = _AFTER[job.action, job.phase](self, job, job.exchange.result, state)
        if not isinstance(following, TransferResult):
            return self._begin(job, *following, now_us)
        self._job = None
        job.enter(Phase.ENDED)
        if job.cancelled and following.outcome in ("failed", "unknown", "rejected"):
            following = replace(following, outcome="cancelled")
        self._report(job, following, now_us)
        return []

    def validate_state(self) -> None:
        """Raise AssertionError if an invariant does not hold between two events; for tests."""
        assert all(job.phase is Phase.QUEUED for job in self._queue)
        if self._job is not None:
            assert self._job.phase not in (Phase.QUEUED, Phase.ENDED), self._job
        jobs = [*self._queue, *([] if self._job is None else [self._job])]
        assert len({job.transfer_id for job in jobs}) == len(jobs)
        for job in jobs:
            job.validate_state()

    # Each of these functions returns the phase that follows one phase, or the transfer's result.
    # ----------

    def _after_clearing(self, job: Job, result: TransferResult, state: VehicleState) -> Following:
        return result

    def _after_download(self, job: Job, result: TransferResult, state: VehicleState) -> Following:
        if result.items is not None:
            return replace(result, items=users_items(job, result.items))
        if job.phase is Phase.READING_FILE and not job.cancelled:
            return self._read_items(self._address(job, state))
        return result

    def _after_writing(self, job: Job, result: TransferResult, state: VehicleState) -> Following:
        if result.outcome == "rejected" and not job.cancelled:
            return self._by_items(job, state)
        job.uploaded = result
        return self._read_file(self._address(job, state))

    def _after_cutting(self, job: Job, result: TransferResult, state: VehicleState) -> Following:
        return self._read_file(self._address(job, state))

    def _after_sending(self, job: Job, result: TransferResult, state: VehicleState) -> Following:
        assert isinstance(job.exchange, MissionUpload)
        job.uploaded = result
        holds = held_after(job.exchange, result, state.stack)
        if result.outcome == "accepted" and not job.check:
            return self._start_mission(job, state)
        if result.outcome == "accepted" or holds in ("one of both", "not known"):
            return self._read_items(self._address(job, state))
        return replace(result, holds=holds)

    def _after_reading(self, job: Job, result: TransferResult, state: VehicleState) -> Following:
        stack = state.stack
        assert job.uploaded is not None
        if result.items is None:  # the read-back failed too
            return _unread(
                job.uploaded, result, "one of both" if stack.atomic_upload else "not known"
            )
        if same_mission(job.wire_items, result.items, stack, MISSION_TYPES[job.kind]):
            if job.uploaded.outcome == "cancelled":
                return replace(job.uploaded, items=job.items, holds="the new one")
            return self._start_mission(job, state)
        read = users_items(job, result.items)
        read_holds: Holds = "the old one" if stack.atomic_upload else "a mixture"
        if job.uploaded.outcome in ("accepted", "unknown"):
            words = "another mission is on board"
            return TransferResult("failed", words, items=read, holds=read_holds)
        return replace(job.uploaded, items=read, holds=read_holds)

    def _after_file(self, job: Job, read: TransferResult, state: VehicleState) -> Following:
        """Return the next phase, or the result, after a file has been written and read back."""
        assert job.uploaded is not None
        untouched = job.uploaded.outcome == "failed"
        if read.items is None:
            # The items of a shorter file may be followed by old items: a mixture of two missions.
            uncertain: Holds = "not known" if job.shorter else "one of both"
            return _unread(job.uploaded, read, "the old one" if untouched else uncertain)
        mission_type = MISSION_TYPES[job.kind]
        if same_mission(job.wire_items, read.items, state.stack, mission_type):
            if job.old_tail:  # the old tail is removed now, and the new mission has begun
                return accepted(job)
            return self._start_mission(job, state)
        continues = not untouched and not job.cancelled
        beginning = read.items[: len(job.wire_items)]
        longer = job.kind == "mission" and same_mission(job.wire_items, beginning, state.stack)
        if continues and longer and not job.old_tail:
            job.old_tail = True
            return self._start_mission(job, state)
        if continues:  # the file was not applied, or only in part: a command is not supported
            job.uploaded, job.old_tail = None, False
            return self._by_items(job, state)
        holds: Holds = "the old one" if untouched else "a mixture"
        read_items = users_items(job, read.items)
        return TransferResult("failed", job.uploaded.reason, items=read_items, holds=holds)

    def _after_hold(self, job: Job, result: TransferResult, state: VehicleState) -> Following:
        if result.outcome == "accepted":
            return self._send_items(job, state)
        words = f"the vehicle did not hold for the upload: {result.reason}"
        return replace(result, reason=words, holds="the old one")

    def _after_resume(self, job: Job, result: TransferResult, state: VehicleState) -> Following:
        if result.outcome == "accepted" or job.override:
            return accepted(job)
        words = f"the mission is on board, but the vehicle did not resume it: {result.reason}"
        return TransferResult("failed", words, items=job.items, holds="the new one")

    def _start_mission(self, job: Job, state: VehicleState) -> Following:
        """Return the phase that starts the mission on board, or the result if it cannot start."""
        if job.kind != "mission" or not job.items or job.reread:
            return accepted(job)
        plan_id, seq = mission_id_of(job.wire_items, state.stack), self._seq(job)
        later = range(seq, len(job.wire_items))
        shown = next((at for at in later if job.wire_items[at].command <= LAST_NAV), seq)
        before = job.before._replace(seq=state.current)
        address, count = self._address(job, state), len(job.wire_items)
        start = MissionActivation(address, seq, shown, count, plan_id, before, self._timing)
        if job.override and state.armed and start.needs_command:
            return self._not_started(job, TransferResult("failed", job.override))
        return Phase.STARTING, start

    def _after_start(self, job: Job, result: TransferResult, state: VehicleState) -> Following:
        assert isinstance(job.exchange, MissionActivation)
        stack, address = state.stack, self._address(job, state)
        if job.exchange.other_list and not job.cancelled:
            job.reread = True
            return self._read_items(address)
        if result.outcome != "accepted":
            return self._not_started(job, result)
        if job.old_tail:
            return Phase.CUTTING_TAIL, Truncate(address, len(job.wire_items), self._timing)
        if job.paused and not job.override:
            change = self._mode_change(job, state, stack.hold_mode, stack.mission_mode)
            return Phase.RESUMING, change
        return accepted(job)

    def _not_started(self, job: Job, result: TransferResult) -> TransferResult:
        if job.old_tail:
            words = "the mission is on board, followed by old items, and was not started"
            return TransferResult("failed", f"{words}: {result.reason}", holds="a mixture")
        if result.outcome == "rejected":
            words = f"{result.reason}{likely_reason(job)}"
            return replace(result, reason=words, items=job.items, holds="the new one")
        words = f"the mission is on board, but the vehicle did not start it: {result.reason}"
        return TransferResult(result.outcome, words, items=job.items, holds="the new one")


_AFTER: dict[
    tuple[Action, Phase], Callable[[TransferQueue, Job, TransferResult, VehicleState], Following]
] = {
    ("clear", Phase.CLEARING): TransferQueue._after_clearing,
    ("download", Phase.READING_FILE): TransferQueue._after_download,
    ("download", Phase.READING_ITEMS): TransferQueue._after_download,
    ("upload", Phase.WRITING_FILE): TransferQueue._after_writing,
    ("upload", Phase.READING_FILE): TransferQueue._after_file,
    ("upload", Phase.CUTTING_TAIL): TransferQueue._after_cutting,
    ("upload", Phase.HOLDING): TransferQueue._after_hold,
    ("upload", Phase.SENDING_ITEMS): TransferQueue._after_sending,
    ("upload", Phase.READING_ITEMS): TransferQueue._after_reading,
    ("upload", Phase.STARTING): TransferQueue._after_start,
    ("upload", Phase.RESUMING): TransferQueue._after_resume,
}


def _unread(uploaded: TransferResult, read: TransferResult, holds: Holds) -> TransferResult:
    """Return the result of an upload that could not be read back."""
    words = f"{uploaded.reason}; the read-back failed: {read.reason}"
    outcome = "unknown" if uploaded.outcome == "accepted" else uploaded.outcome
    return replace(uploaded, outcome=outcome, reason=words, items=None, holds=holds)


def likely_reason(job: Job) -> str:
    """Return the likely reason why PX4 rejects a mission; PX4 1.17 reports no reason."""
    if any(item.command in LANDINGS for item in job.items):
        return ""
    return (
        "; the mission has no landing, which PX4 requires for planes unless MIS_TKO_LAND_REQ is 0"
    )


def accepted(job: Job) -> TransferResult:
    """Return the result of an accepted upload, with the reason if the mode was not changed."""
    words = f"accepted; {job.override}, so the upload left the mode unchanged"
    reason = words if job.override else "accepted"
    return TransferResult("accepted", reason, 0, None, job.items, "the new one")


def users_items(job: Job, wire_items: tuple[MissionItem, ...]) -> tuple[MissionItem, ...]:
    """Return the user's items: the transmitted items without home, with jump targets from 0."""
    return jumps_moved(wire_items[job.hidden :], -job.hidden)


def held_after(ended: MissionUpload, result: TransferResult, stack: Stack) -> Holds:
    """Return which mission is on board after an upload, as far as ``result`` shows it."""
    if result.outcome == "accepted":
        return "the new one"
    if not ended.touched:
        return "the old one"
    if not stack.atomic_upload:
        return "not known"
    uncertain = result.outcome in ("unknown", "cancelled") or result.code == MAV_MISSION_ERROR
    return "one of both" if uncertain else "the old one"
