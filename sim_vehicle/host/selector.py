"""Waits for all ports of the server and their clients at once."""

from __future__ import annotations

import contextlib
import selectors
import socket
import time
from collections.abc import Sequence

from mission.link.address import Link
from sim_vehicle.faults.session import FaultSession
from sim_vehicle.host.ports import Client, ReadyCallback, ServerPort, ServerUrl, link_port, open_port

__all__ = ["PortSelector"]

_REFRESH_S = 0.5


class PortSelector:
    """All ports of a server and the clients behind them.

    Parameters
    ----------
    urls : sequence of ServerUrl
        Each becomes a port.
    session : FaultSession
        Spoils the links that it names.
    links : sequence of Link
        Links that are open already; each becomes a port, after those of the URLs.

    Attributes
    ----------
    clients : list of Client
        Who is there; a new list whenever somebody comes or goes.
    urls : tuple of str
        The addresses with the ports that were really taken.

    Raises
    ------
    LinkError
        If an address is wrong or in use; nothing stays open then.
    """

    def __init__(self, urls: Sequence[ServerUrl], session: FaultSession, links: Sequence[Link] = ()) -> None:
        self.clients: list[Client] = []
        self._session = session
        self._ports: list[tuple[ServerPort, ServerUrl]] = []
        self._seen: dict[int, int] = {}
        self._selector = selectors.DefaultSelector()
        self._watched: dict[int, ReadyCallback] = {}
        self._refreshed_s = 0.0
        self._wake, self._woken = socket.socketpair()
        self._woken.setblocking(False)
        self._selector.register(self._woken, selectors.EVENT_READ)
        try:
            for url in urls:
                self._ports.append((open_port(url.url), url))
        except BaseException:
            self.close()
            raise
        self._ports += [(link_port(link), ServerUrl(link.name)) for link in links]
        self.urls = tuple(port.name for port, _ in self._ports)
        self.refresh()

    def wake(self) -> None:
        """End a `wait`; may be called from another thread."""
        with contextlib.suppress(OSError):
            self._wake.send(b"\0")

    def wait(self, seconds: float) -> list[tuple[Client, bytes]]:
        """Wait until something comes, at most so long; returns frames and who sent them."""
        ready = self._selector.select(max(0.0, seconds))
        found: list[tuple[Client, bytes]] = []
        for key, _ in ready:
            handle = self._watched.get(key.fd)
            if handle is not None:
                found += handle.receive()
            else:
                with contextlib.suppress(OSError):
                    self._woken.recv(4096)
        if ready or time.monotonic() - self._refreshed_s > _REFRESH_S:
            self.refresh()
        return found

    def flush(self) -> None:
        """Send what was collected for the clients."""
        for client in self.clients:
            client.flush()
        if not all(client.alive for client in self.clients):
            self.refresh()

    def refresh(self) -> None:
        """Register new clients and sockets, and forget those that are gone."""
        self._refreshed_s = time.monotonic()
        found: list[Client] = []
        for number, (port, url) in enumerate(self._ports, 1):
            for client in port.clients():
                found.append(client)
                if client not in self.clients:
                    count = self._seen[number] = self._seen.get(number, -1) + 1
                    client.systems = url.systems
                    client.radio = self._session.link(port.name, number, count)
        if found != self.clients:
            self.clients = found
        handles = {fd: handle for port, _ in self._ports for fd, handle in port.ready_callbacks().items()}
        for fd, old in self._watched.items():
            if fd not in handles or handles[fd].owner is not old.owner:
                with contextlib.suppress(KeyError, ValueError, OSError):
                    self._selector.unregister(fd)
        for fd, new in handles.items():
            if fd not in self._watched or self._watched[fd].owner is not new.owner:
                self._selector.register(fd, selectors.EVENT_READ)
        self._watched = handles

    def close(self) -> None:
        """Close all sockets."""
        for port, _ in self._ports:
            port.close()
        self._selector.close()
        self._wake.close()
        self._woken.close()
