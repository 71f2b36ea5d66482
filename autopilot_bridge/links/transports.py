"""Selects the transport of a link by its address."""

from autopilot_bridge.links.link_address import LinkAddress, SerialAddress
from autopilot_bridge.links.reconnection import ReconnectingStream
from autopilot_bridge.links.streams import TcpServer, connect_tcp, open_serial
from autopilot_bridge.links.transport import Listener, Transport
from autopilot_bridge.links.udp import Udp


def transport_of(address: LinkAddress | SerialAddress, listener: Listener) -> Transport:
    """Return the transport for a link's address."""
    if isinstance(address, SerialAddress):
        return ReconnectingStream(lambda: open_serial(address, listener), listener, address)
    match address.kind:
        case "tcp":
            return ReconnectingStream(lambda: connect_tcp(address, listener), listener, address)
        case "tcpin":
            return TcpServer(address, listener)
        case _:
            return Udp(address, listener)
