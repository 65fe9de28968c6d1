"""A TCP relay whose connections can be dropped, as a companion computer's or a modem's are."""

import contextlib
import select
import socket

from in_a_thread import InAThread


class TcpRelay(InAThread):
    """Relays connections to a host; `drop` ends those that there are, new ones are taken.

    Attributes
    ----------
    url : str
        Where it listens.
    accepted : int
        How many connections were made.
    """

    def __init__(self, url):
        _, host, port = url.split(":")
        self._there = (host, int(port))
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"tcp:127.0.0.1:{self._listener.getsockname()[1]}"
        self.accepted = 0
        self._pairs = {}
        super().__init__()

    def drop(self):
        """End all connections."""
        with self._lock:
            for one in self._pairs:
                one.close()
            self._pairs.clear()

    def _run(self):
        while not self._stopping.is_set():
            with self._lock:
                watched = [self._listener, *self._pairs]
                ready = select.select(watched, [], [], 0)[0]
                for one in ready:
                    self._serve(one)
            if not ready:
                self._stopping.wait(0.005)

    def _serve(self, one):
        if one is self._listener:
            near, _ = self._listener.accept()
            far = socket.create_connection(self._there)
            self._pairs[near], self._pairs[far] = far, near
            self.accepted += 1
            return
        other = self._pairs.get(one)
        if other is None:
            return
        data = b""
        with contextlib.suppress(OSError):
            data = one.recv(65536)
            other.sendall(data)
        if not data:
            for end in (one, other):
                end.close()
                del self._pairs[end]

    def _close(self):
        self.drop()
        self._listener.close()
