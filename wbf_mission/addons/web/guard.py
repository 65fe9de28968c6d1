"""Guard of the web server: refuses slow requests and requests of other web sites, sets security headers.

Any web page can make a browser send requests to this server. A request must therefore name this machine as
its host, not a foreign domain that resolves to this machine. Requests that change or stream data must come
from a page of this server. If the server listens beyond this machine, a browser must have the token.
Connections have deadlines, because incomplete requests would block other clients.
"""

from __future__ import annotations

import asyncio
import ipaddress
import secrets
import socket
import time
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

import h11
from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}
_COOKIE = "wbf-mission"
_READS = ("GET", "HEAD")


class Guard:
    """Middleware that refuses requests to other machines' names, and requires the token if one is set."""

    def __init__(self, app: ASGIApp, names: tuple[str, ...] = (), token: str | None = None) -> None:
        self._app, self._token = app, token
        self._names = frozenset(name.lower() for name in ("localhost", *names))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request to the application, or send the refusal."""
        refused = self._refused(scope)
        if refused is None:
            await self._app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})  # Not yet accepted: the client gets a 403
        else:
            await refused(scope, receive, _with_headers(send))

    def _refused(self, scope: Scope) -> Response | None:
        headers = Headers(scope=scope)
        asked, reads = headers.get("host", ""), scope["type"] == "http" and scope["method"] in _READS
        if len(headers.getlist("host")) != 1 or not self._is_here(asked):
            return PlainTextResponse("the host of this request is not this machine", 421)
        origin = headers.get("origin")
        if origin is None and not reads:
            return PlainTextResponse("only a page of this server may send this request", 403)
        if origin is not None and origin.lower().partition("://")[2] != asked.lower():
            return PlainTextResponse("another web site must not send this request", 403)
        return self._without_token(scope, headers, asked)

    def _is_here(self, asked: str) -> bool:
        """Return whether a host means this machine; an IP address passes, since no domain is behind it."""
        try:
            split = urlsplit(f"//{asked}")
            name, _ = split.hostname or "", split.port  # Reading an invalid port raises ValueError
        except ValueError:
            return False
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return name in self._names
        return True

    def _without_token(self, scope: Scope, headers: Headers, asked: str) -> Response | None:
        """Return the refusal of a request without the token; a token in the address is moved to a cookie."""
        if self._token is None:
            return None
        # Cookies are shared by all ports of a host, so each server needs its own name.
        cookie = f"{_COOKIE}-{urlsplit(f'//{asked}').port or 80}"
        if self._is_token(_cookie(headers, cookie)):
            return None
        scheme, _, bearer = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer" and self._is_token(bearer):
            return None
        _, _, given = scope.get("query_string", b"").decode("latin-1").partition("token=")
        if scope["type"] == "http" and scope["method"] == "GET" and self._is_token(given):
            response = RedirectResponse("/" + scope["path"].lstrip("/"), 303)
            response.set_cookie(cookie, self._token, httponly=True, samesite="lax", path="/")
            return response
        return PlainTextResponse("open the address that wbf-mission printed: it contains a token", 401)

    def _is_token(self, given: str) -> bool:
        return self._token is not None and secrets.compare_digest(given.encode(), self._token.encode())


def _with_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers[name] = value
            headers.setdefault("Cache-Control", "no-store")
        await send(message)

    return sending


def _cookie(headers: Headers, name: str) -> str:
    try:
        found = SimpleCookie(headers.get("cookie", "")).get(name)
    except CookieError:
        return ""
    return "" if found is None else found.value


def is_loopback(host: str) -> bool:
    """Return whether a host is reachable from this machine only.

    >>> is_loopback("127.0.0.1"), is_loopback("::1"), is_loopback("0.0.0.0"), is_loopback("localhost")
    (True, True, False, True)
    """
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def own_names(host: str) -> tuple[str, ...]:
    """Return this machine's names for a server that listens on `host`."""
    return () if is_loopback(host) else (host, name := socket.gethostname(), f"{name}.local")


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
        """Stop the deadline of a lost connection."""
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
