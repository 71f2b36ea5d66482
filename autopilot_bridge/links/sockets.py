"""Creates and binds the sockets of links, and describes their errors."""

import asyncio
import os
import socket
from typing import cast

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.link_address import LinkAddress

RECEIVE_BUFFER_BYTES = 4 * 1024 * 1024
# A TCP connection counts as lost after this time without acknowledgements.
ACK_TIMEOUT_MS = 10_000


def socket_of(kind: socket.SocketKind) -> socket.socket:
    """Return a new non-blocking socket with a buffer for bursts from many vehicles."""
    sock = socket.socket(socket.AF_INET, kind)
    sock.setblocking(False)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
    if kind == socket.SOCK_STREAM and hasattr(socket, "TCP_USER_TIMEOUT"):
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, ACK_TIMEOUT_MS)
    return sock


def bind(sock: socket.socket, address: LinkAddress, where: tuple[str, int]) -> None:
    """Bind a socket; if that fails, close the socket and raise BridgeError."""
    try:
        sock.bind(where)
    except (OSError, UnicodeError) as error:
        sock.close()
        raise BridgeError(
            f"link {address}: cannot listen on this address ({reason_of(error)}); is another "
            "program using the port?"
        ) from None


async def look_up(address: LinkAddress) -> tuple[str, int]:
    """Return the IP address and port of a host name. Raises BridgeError if that fails."""
    loop = asyncio.get_running_loop()
    try:
        addresses = await loop.getaddrinfo(address.host, address.port, family=socket.AF_INET)
    except (OSError, UnicodeError) as error:
        raise BridgeError(
            f"link {address}: host {address.host} cannot be resolved ({reason_of(error)})"
        ) from None
    return cast(tuple[str, int], addresses[0][4])


def reason_of(error: OSError | UnicodeError) -> str:
    """Return the operating system's text for an error."""
    if isinstance(error, socket.gaierror):
        return str(error.strerror)
    if isinstance(error, OSError) and error.errno:
        return os.strerror(error.errno)  # pyserial's text repeats the path and the number
    return str(error).partition("\n")[0]
