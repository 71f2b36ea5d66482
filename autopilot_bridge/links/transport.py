"""Defines the interface of transports, which send and receive the frames of a link."""

from typing import Protocol

Batch = list[tuple[str, list[bytes]]]  # each remote with its frames, in order


class Listener(Protocol):
    """The receiver of a transport's frames and errors."""

    def frames_received(self, batch: Batch) -> None:
        """Process received frames."""

    def datagram_lost(self, error: OSError) -> None:
        """Record an error with which a datagram was lost; the transport continues."""

    def failed(self, error: Exception) -> None:
        """Report an error after which the transport cannot continue."""


class Transport(Protocol):
    """An open link; ``called`` is the remote to which the link connects, "" if it listens."""

    called: str

    async def open(self) -> None:
        """Open the socket or device. Raises BridgeError if the link's address cannot be used."""

    def send(self, frames: list[bytes], remote: str = "") -> bool:
        """Send frames to a remote, or to all remotes (""); return whether there was a recipient."""

    async def close(self) -> None:
        """Close the socket or device."""
