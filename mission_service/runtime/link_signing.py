"""Manages signed links: their keys, the stored timestamps, and reports on refused frames."""

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from autopilot_bridge.links.signing import Counts, Key, Signing, Timestamps, key_warning, read_key
from mission_service.errors import MissionServiceError
from mission_service.runtime.redaction import hide

COMMAND_LINK_ID = 255  # link id of CLI commands; a service running meanwhile uses other ids
# Fewer refused frames may be transmission errors or frames from another station.
REPORT_FROM_FRAMES = 10
LEAD_REPORTED_S = 60.0
CHECK_CLOCKS = "check the clocks of this machine and the vehicle"
WORDS = {  # description and remedy for each reason for refusing a frame
    "unsigned": ("without a signature", "set the vehicle's key (mission-service signing set-up)"),
    "wrong": ("with a wrong signature", "check that the vehicle has this key"),
    "repeated": ("with repeated timestamps", "check whether frames arrive twice"),
    "old": ("signed more than a minute ago", CHECK_CLOCKS),
    "ahead": ("signed minutes in the future", CHECK_CLOCKS),
}


def timestamps_file() -> Path:
    """Return the path of the file with the last timestamp used; creates the file's folder."""
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    folder = Path(state) / "mission-service"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MissionServiceError(f"signing: {folder}: {error.strerror}") from None
    return folder / "signing-timestamp"


@contextmanager
def signings(
    sources: Iterable[str | None], wall_us: Callable[[], int], warn: Callable[[str], None]
) -> Iterator[dict[str | None, Signing]]:
    """Provide a ``Signing`` for each key source; all of them use the same timestamp file.

    Raises BridgeError for a key that cannot be read.
    """
    keys = {source: read_key(source) for source in dict.fromkeys(sources) if source is not None}
    for key in keys.values():
        hide(key.secret)
    if not keys:
        yield {}
        return
    for warning in filter(None, map(key_warning, keys)):
        warn(warning)
    timestamps = Timestamps(wall_us, timestamps_file())
    of_key: dict[Key, Signing] = {key: Signing(key, timestamps) for key in keys.values()}
    try:
        yield {source: of_key[key] for source, key in keys.items()}
    finally:
        timestamps.close()


def refusal(counts: Counts, link: str, from_frames: int = 1) -> str | None:
    """Return a line about the most frequent cause of refusal; None below ``from_frames``."""
    verdict = max(WORDS, key=lambda verdict: getattr(counts, verdict))
    frames = getattr(counts, verdict)
    if frames < from_frames:
        return None
    description, remedy = WORDS[verdict]
    plural = "s" if frames > 1 else ""
    return f"refused {frames} frame{plural} {description} on {link}; {remedy}"


def key_missing(link: str) -> str:
    """Return one line about a link whose vehicle signs frames while this program has no key."""
    return (
        f"frames on {link} are signed, but no signing key is configured; the vehicle may not answer"
    )


class SigningRefusals:
    """The signing reports for one vehicle's link; each report is returned only once."""

    def __init__(self, link: str, system_id: int, signing: Signing | None) -> None:
        self._link = link
        self._system_id = system_id
        self._signing = signing
        self._reported: set[str] = set()

    def new_reports(self, counts: Counts, receives_signed: bool) -> list[str]:
        """Return the new reports, one line each."""
        lines: dict[str, str | None] = {}
        if self._signing is None:
            lines["key"] = key_missing(self._link) if receives_signed else None
        else:
            lines["refused"] = refusal(counts, self._link, REPORT_FROM_FRAMES)
            lead_s = self._signing.lead_s(self._system_id)
            if lead_s > LEAD_REPORTED_S:
                lines["lead"] = (
                    f"its frames on {self._link} are signed {lead_s:.0f} s ahead of this machine's "
                    "clock; the vehicle may refuse the service's frames: set the clock"
                )
        new = {key: line for key, line in lines.items() if line and key not in self._reported}
        self._reported |= new.keys()
        return list(new.values())
