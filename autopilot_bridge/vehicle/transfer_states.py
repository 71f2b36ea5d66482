"""Lists the phases of a transfer and the allowed transitions between them.

upload: file -> read the file back -> [start -> [remove the old tail -> read it back]],
        if the autopilot accepts whole files, otherwise
        [hold] -> items -> [read back] -> start -> [resume]
download: file, otherwise items
clear: one phase

The *old tail* consists of the last items of the old mission, which a shorter file does not remove.
"""

from dataclasses import dataclass, field
from enum import Enum
from typing import Literal, NamedTuple

from autopilot_bridge.items import MissionItem
from autopilot_bridge.missions.download import MissionClear, MissionDownload
from autopilot_bridge.missions.ftp import FtpDownload, FtpUpload
from autopilot_bridge.missions.transfer import Kind, TransferResult
from autopilot_bridge.missions.truncate import Truncate
from autopilot_bridge.missions.upload import MissionUpload
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.transitions import enter
from autopilot_bridge.vehicle.mission_activation import MissionActivation, Onboard
from autopilot_bridge.vehicle.mode_change import ModeChange

NOTHING = Onboard(None, None, False)
StartItem = Literal["restart", "keep"] | int
Action = Literal["upload", "download", "clear"]
Transfer = (
    MissionUpload
    | MissionDownload
    | MissionClear
    | MissionActivation
    | ModeChange
    | Truncate
    | FtpUpload
    | FtpDownload
)


class Phase(Enum):
    """A phase of a transfer."""

    QUEUED = "queued"
    WRITING_FILE = "writing the file"
    READING_FILE = "reading the file"
    CUTTING_TAIL = "removing the last items of the old mission"
    HOLDING = "holding"
    SENDING_ITEMS = "sending items"
    READING_ITEMS = "reading items"
    STARTING = "starting the mission"
    RESUMING = "resuming the mission"
    CLEARING = "clearing"
    ENDED = "ended"


PROTOCOLS: dict[Phase, type[Transfer]] = {
    Phase.WRITING_FILE: FtpUpload,
    Phase.READING_FILE: FtpDownload,
    Phase.CUTTING_TAIL: Truncate,
    Phase.HOLDING: ModeChange,
    Phase.SENDING_ITEMS: MissionUpload,
    Phase.READING_ITEMS: MissionDownload,
    Phase.STARTING: MissionActivation,
    Phase.RESUMING: ModeChange,
    Phase.CLEARING: MissionClear,
}
_BY_ITEMS = (Phase.HOLDING, Phase.SENDING_ITEMS)
TRANSITIONS: dict[Action, dict[Phase, tuple[Phase, ...]]] = {
    "upload": {
        Phase.QUEUED: (Phase.WRITING_FILE, *_BY_ITEMS),
        Phase.WRITING_FILE: (Phase.READING_FILE, *_BY_ITEMS),
        Phase.READING_FILE: (Phase.STARTING, *_BY_ITEMS, Phase.ENDED),
        Phase.HOLDING: (Phase.SENDING_ITEMS, Phase.ENDED),
        Phase.SENDING_ITEMS: (Phase.READING_ITEMS, Phase.STARTING, Phase.ENDED),
        Phase.READING_ITEMS: (Phase.STARTING, Phase.ENDED),
        Phase.STARTING: (Phase.CUTTING_TAIL, Phase.READING_ITEMS, Phase.RESUMING, Phase.ENDED),
        Phase.CUTTING_TAIL: (Phase.READING_FILE,),
        Phase.RESUMING: (Phase.ENDED,),
    },
    "download": {
        Phase.QUEUED: (Phase.READING_FILE, Phase.READING_ITEMS),
        Phase.READING_FILE: (Phase.READING_ITEMS, Phase.ENDED),
        Phase.READING_ITEMS: (Phase.ENDED,),
    },
    "clear": {Phase.QUEUED: (Phase.CLEARING,), Phase.CLEARING: (Phase.ENDED,)},
}
# The phases of an upload before the items are sent.
UNSENT = (Phase.QUEUED, Phase.WRITING_FILE, *_BY_ITEMS)
# The phases in which each flag of a transfer may be set.
FLAG_PHASES: dict[str, tuple[Phase, ...]] = {
    "old_tail": (Phase.STARTING, Phase.CUTTING_TAIL, Phase.READING_FILE, Phase.ENDED),
    "paused": (*_BY_ITEMS, Phase.READING_ITEMS, Phase.STARTING, Phase.RESUMING, Phase.ENDED),
    "reread": (Phase.READING_ITEMS, Phase.ENDED),
}


class VehicleState(NamedTuple):
    """The part of the vehicle's state on which transfers depend."""

    stack: Stack
    target: tuple[int, int]
    current: int | None  # MISSION_CURRENT.seq
    total: int | None  # MISSION_CURRENT.total, home included
    armed: bool
    custom_mode: int
    plan_id: int | None = None  # MISSION_CURRENT.mission_id
    unfit: bool = False  # whether the mission on board cannot be flown

    @property
    def in_mission(self) -> bool:
        """Whether the vehicle is flying its mission."""
        return self.armed and self.custom_mode == self.stack.mission_mode


@dataclass
class Job:
    """One transfer, with its active exchange and the state that its later phases need."""

    transfer_id: int
    action: Action
    kind: Kind
    items: tuple[MissionItem, ...] = ()
    begin: StartItem = "restart"  # the item of the new mission to fly next
    check: bool = False
    holds_first: bool = False  # True if the vehicle holds while its list is overwritten
    by_file: bool = True  # True to send a file if the autopilot accepts files
    exchange: Transfer | None = None
    wire_items: tuple[MissionItem, ...] = ()
    hidden: int = 0  # number of items that are not the user's: ArduPilot's home
    shorter: bool = False  # the mission in flight is longer; a file does not remove its last items
    old_tail: bool = False  # True if old items follow the items of a new file on board
    paused: bool = False  # True if the vehicle holds because of this job
    uploaded: TransferResult | None = None  # result of the upload itself
    before: Onboard = NOTHING
    reread: bool = False  # whether the list was read back after the start failed
    override: str = ""  # the reason not to change the mode; "" if there is none
    cancelled: bool = False
    history: list[Phase] = field(default_factory=lambda: [Phase.QUEUED])

    @property
    def phase(self) -> Phase:
        """The current phase."""
        return self.history[-1]

    def enter(self, phase: Phase, exchange: Transfer | None = None) -> None:
        """Enter a phase. Raises InvalidTransitionError if this phase may not follow now."""
        enter(self.history, phase, TRANSITIONS[self.action], self._of)
        self.exchange = exchange

    def validate_state(self) -> None:
        """Raise AssertionError if an invariant does not hold between two events; for tests."""
        expected = PROTOCOLS.get(self.phase)
        assert (self.exchange is None) == (expected is None), self
        assert expected is None or isinstance(self.exchange, expected), self
        unsent = self.action != "upload" or self.phase in UNSENT
        assert self.phase is Phase.ENDED or (self.uploaded is None) == unsent, self
        for flag, phases in FLAG_PHASES.items():
            assert not getattr(self, flag) or self.phase in phases, f"{self}: {flag}"

    def __str__(self) -> str:
        phases = ", ".join(phase.value for phase in self.history)
        return f"{self._of} ({phases})"

    @property
    def _of(self) -> str:
        return f"{self.action} {self.transfer_id} of a {self.kind}"
