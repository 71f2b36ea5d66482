"""Binds a vehicle to one remote endpoint of a link; the time is an argument.

A *remote* is an address and port, or a connection. A vehicle is bound to the remote that first sent
a HEARTBEAT of its autopilot. While this remote sends, messages with the same system id from another
remote are not used and raise an alarm. After ``timeout_us`` without messages, a HEARTBEAT from
another remote binds the vehicle to that remote, because the port of an autopilot may differ after a
restart or a change of its network. The new binding also raises an alarm, unless the link is signed,
because a verified signature proves the sender. When a remote that was bound earlier sends again, it
takes precedence, and the messages from remotes bound later are no longer used.

The binding cannot detect whether the first remote is the vehicle. If an impostor transmits before
the vehicle, the alarm remains until the impostor stops. Only a signed link prevents this.

On a link that connects to one address (``udpout``), that address takes precedence over all others.
"""

from autopilot_bridge.vehicle.client_events import AlarmEnded, RemoteChanged, SameSystemId

ENDED_AFTER_US = 10_000_000  # an alarm ends this long after the last message of the other remote
MOVED_FOR_US = 60_000_000  # duration of the alarm that a change of remote raises
MAX_RANKED = 8  # maximum number of stored remotes
SourceAlarm = SameSystemId | RemoteChanged | AlarmEnded


class RemoteBinding:
    """The remote of one vehicle; the caller removes new alarms from ``alarms`` and reports them."""

    def __init__(self, timeout_us: int, called: str = "", signed: bool = False) -> None:
        """Create the binding; ``called`` is the remote to which the link connects, or ""."""
        self.remote: str | None = None  # None until bound
        self.alarms: list[SourceAlarm] = []
        self._timeout_us = timeout_us
        self._called = called
        self._signed = signed
        self._received_us = 0
        self._ranked: list[str] = []  # remotes that were bound, in the order of their first binding
        self._other: tuple[str, int] | None = None  # another remote, and the time of its message
        self._raised: type[SourceAlarm] | None = None
        self._alarm_until_us: int | None = None

    def accepts(self, remote: str, is_heartbeat: bool, now_us: int) -> bool:
        """Return whether a message with the vehicle's system id is accepted from ``remote``.

        ``is_heartbeat`` is True for a HEARTBEAT of a supported autopilot.
        """
        if remote != self.remote:
            if not self._may_take_over(remote, now_us):
                self._other = (remote, now_us)
                return False
            if not is_heartbeat:
                return False
            self._bind(remote, now_us)
        self._received_us = now_us
        if self._other is not None and now_us - self._other[1] < self._timeout_us:  # both send
            self._raise(SameSystemId(now_us, remote, self._other[0]))
            self._alarm_until_us = self._other[1] + ENDED_AFTER_US
        return True

    def _may_take_over(self, remote: str, now_us: int) -> bool:
        if self.remote is None or now_us - self._received_us >= self._timeout_us:
            return True
        if self._called in (remote, self.remote):
            return remote == self._called
        ranked = self._ranked
        return remote in ranked and ranked.index(remote) < ranked.index(self.remote)

    def _bind(self, remote: str, now_us: int) -> None:
        before, self.remote, self._other = self.remote, remote, None
        if remote not in self._ranked:
            del self._ranked[MAX_RANKED - 1 :]
            self._ranked.append(remote)
        if before is not None and now_us - self._received_us < self._timeout_us:
            self._other = (before, self._received_us)
        elif before is not None and not self._signed:
            self._raise(RemoteChanged(now_us, before, remote))
            self._alarm_until_us = now_us + MOVED_FOR_US

    def _raise(self, alarm: SameSystemId | RemoteChanged) -> None:
        if self._raised is not type(alarm) or isinstance(alarm, RemoteChanged):
            self.alarms.append(alarm)
        self._raised = type(alarm)

    def alarm_timer(self) -> int | None:
        """Return the time of the next ``handle_timer`` call; None if there is no alarm."""
        return self._alarm_until_us

    def handle_timer(self, now_us: int) -> None:
        """End the alarms whose cause has ended."""
        if self._alarm_until_us is not None and now_us >= self._alarm_until_us:
            self._raised = self._alarm_until_us = None
            self.alarms.append(AlarmEnded(now_us, "source"))
