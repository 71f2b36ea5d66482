"""Read the bytes of a video: datagrams from one sender, or a file that may grow.

Both sources have ``next_bytes``, which waits at most ``WAIT_S`` and returns b"" if nothing has
arrived, and ``notice``, a text about the input that is shown if the video cannot be used.
"""

import ipaddress
import socket
import stat
import time
from contextlib import suppress
from pathlib import Path

from autopilot_bridge.links.link_address import LinkAddress

WAIT_S = 0.25
RETRY_S = 1.0
READ_BYTES = 262_144
RECEIVE_BUFFER_BYTES = 4_000_000
TS_BYTES, TS_SYNC = 188, 0x47


class DatagramSource:
    """The transport stream from one sender to a UDP address, which may be a multicast group.

    Datagrams from other senders, and those that do not consist of transport packets, are dropped.
    After ``release``, the sender of the next datagram is used.
    """

    def __init__(self, address: LinkAddress) -> None:
        """Set the address; the first ``next_bytes`` opens the socket."""
        self._address = address
        self._socket: socket.socket | None = None
        self._sender: object = None
        self.notice = ""

    def next_bytes(self) -> bytes:
        """Return a datagram from the sender, or b""."""
        if self._socket is None and not self._opened():
            time.sleep(RETRY_S)
            return b""
        assert self._socket is not None
        try:
            data, sender = self._socket.recvfrom(65_536)
        except TimeoutError:
            return b""
        except OSError as error:
            self.notice = f"{self._address}: {error.strerror}"
            self.close()
            return b""
        if len(data) % TS_BYTES or set(data[::TS_BYTES]) != {TS_SYNC}:
            self.notice = (
                f"datagrams from {sender[0]} are not plain MPEG transport packets (without RTP)"
            )
            return b""
        if self._sender is None:
            self._sender = sender
        if sender != self._sender:
            self.notice = f"{sender[0]}:{sender[1]} sends to the same port and is ignored"
            return b""
        return data

    def release(self) -> None:
        """Use the sender of the next datagram."""
        self._sender = None

    def close(self) -> None:
        """Close the socket; the next ``next_bytes`` opens it again."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _opened(self) -> bool:
        host, port = self._address.host, self._address.port
        try:
            resolved = socket.getaddrinfo(host, port, socket.AF_INET, socket.SOCK_DGRAM)[0][4][0]
            opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        except OSError as error:
            self.notice = f"{self._address}: {error.strerror}"
            return False
        try:
            with suppress(OSError):  # the system may limit the size
                opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
            if ipaddress.ip_address(resolved).is_multicast:
                opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                group = socket.inet_aton(str(resolved)) + socket.inet_aton("0.0.0.0")
                opened.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
            opened.bind((resolved, port))
            opened.settimeout(WAIT_S)
        except OSError as error:
            opened.close()
            self.notice = f"{self._address}: {error.strerror}; another program may use the port"
            return False
        self._socket, self.notice = opened, ""
        return True


class FileSource:
    """A transport stream file, which may be created later, grow, or be replaced."""

    def __init__(self, path: Path) -> None:
        """Set the path; the file need not exist."""
        self._path = path
        self._at = 0
        self._inode = 0
        self.notice = ""

    def next_bytes(self) -> bytes:
        """Return the next bytes of the file, or b"" at its current end."""
        try:
            data = self._next()
        except OSError as error:
            self.notice = f"{self._path}: {error.strerror}"
            data = b""
        if not data:
            time.sleep(WAIT_S)
        return data

    def _next(self) -> bytes:
        state = self._path.stat()
        if not stat.S_ISREG(state.st_mode):
            self.notice = f"{self._path}: is not a file"
            return b""
        if state.st_ino != self._inode or state.st_size < self._at:
            self._at, self._inode = 0, state.st_ino
        self.notice = ""
        with self._path.open("rb") as file:
            file.seek(self._at)
            data = file.read(READ_BYTES)
        self._at += len(data)
        return data

    def release(self) -> None:
        """Do nothing; a file has one writer."""

    def close(self) -> None:
        """Do nothing; the file is open only during ``next_bytes``."""
