"""Opening a link by its address."""

from __future__ import annotations

from mission.link.address import SERIAL, Link, parse_link_url
from mission.link.reconnect import SerialClientLink, TcpClientLink
from mission.link.serial import SerialLink
from mission.link.sockets import TcpLink, TcpServerLink, UdpInLink, UdpOutLink


def open_link(url: str, *, timeout_s: float = 5.0, reconnect: bool = False) -> Link:
    """Open a link by its address.

    Parameters
    ----------
    url : str
        See `mission.link.address.parse_link_url`.
    timeout_s : float
        How long a TCP connection may take to be made.
    reconnect : bool
        A ``tcp`` link or serial line that is lost is made again as soon as the other side is there, and drops
        what is sent in between; without, it raises LinkError.

    Raises
    ------
    LinkError
        If the address is wrong, the host unknown, the port in use, the connection refused or the device
        absent.
    """
    address = parse_link_url(url)
    if address.scheme == SERIAL:
        return SerialClientLink(address) if reconnect else SerialLink(address)
    if address.scheme == "udpin":
        return UdpInLink(address)
    if address.scheme == "udpout":
        return UdpOutLink(address)
    if address.scheme == "tcpin":
        return TcpServerLink(address)
    if reconnect:
        return TcpClientLink(address, timeout_s=timeout_s)
    return TcpLink.connect(address, timeout_s=timeout_s)
