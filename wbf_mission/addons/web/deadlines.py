"""HTTP connections on which a request never gets whole are let go: they would keep others out."""

from __future__ import annotations

import asyncio
import time

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

HEAD_S = 10.0
"""How long a connection may wait for the headers of a request to be whole."""
BODY_S = 60.0
"""How long the body may take after them."""
MAX_WAITING = 50
"""How many connections may wait for headers: of more the one that waits longest is let go at once."""


class HurriedProtocol(H11Protocol):
    """uvicorn's HTTP with deadlines: by itself it waits for the rest of a request for good.

    A connection on which nothing follows an answer it lets go itself.
    """

    missing: type | None = None  # h11's state of a client that has to send more
    since_s = 0.0
    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for the first request."""
        super().connection_made(transport)
        self._hurry()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no more."""
        super().connection_lost(exc)
        self._hurry()

    def handle_events(self) -> None:
        """Take what came, and wait for what is missing."""
        super().handle_events()
        self._hurry()

    def _hurry(self) -> None:
        state = self.conn.their_state
        over = self.transport.is_closing() or self.transport.get_protocol() is not self
        missing = state if state in (h11.IDLE, h11.SEND_BODY) and not over else None
        if missing is self.missing:
            return
        self.missing, self.since_s = missing, time.monotonic()
        if self._deadline is not None:
            self._deadline.cancel()
        if missing is None:
            return
        limit_s = HEAD_S if missing is h11.IDLE else BODY_S
        self._deadline = self.loop.call_later(limit_s, self.transport.abort)
        waiting = [one for one in self.connections if isinstance(one, HurriedProtocol) and one.waits]
        if len(waiting) > MAX_WAITING:
            min(waiting, key=lambda one: one.since_s).transport.abort()

    @property
    def waits(self) -> bool:
        """Whether it waits for the headers of a request."""
        return self.missing is h11.IDLE and not self.transport.is_closing()
