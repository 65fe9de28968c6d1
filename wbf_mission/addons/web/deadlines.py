"""HTTP connections with deadlines; without deadlines, incomplete requests would block other clients."""

from __future__ import annotations

import asyncio
import time

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

HEAD_S = 10.0
"""Time until the headers of a request must be complete (s)."""
BODY_S = 60.0
"""Time from the headers until the body must be complete (s)."""
MAX_WAITING = 50
"""Maximum number of connections that wait for headers; above it, the oldest is closed at once."""


class HurriedProtocol(H11Protocol):
    """uvicorn's HTTP protocol with deadlines: without them, uvicorn waits for the rest of a request for ever.

    uvicorn itself closes connections that are idle after an answer.
    """

    missing: type | None = None  # State of h11, if the client has to send more
    since_s = 0.0
    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Start the deadline of the first request."""
        super().connection_made(transport)
        self._hurry()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the deadline."""
        super().connection_lost(exc)
        self._hurry()

    def handle_events(self) -> None:
        """Handle received data and restart the deadline."""
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
        waiting = [peer for peer in self.connections if isinstance(peer, HurriedProtocol) and peer.waits]
        if len(waiting) > MAX_WAITING:
            min(waiting, key=lambda peer: peer.since_s).transport.abort()

    @property
    def waits(self) -> bool:
        """Whether the connection waits for the headers of a request."""
        return self.missing is h11.IDLE and not self.transport.is_closing()
