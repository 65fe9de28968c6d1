"""Web server of the page: shows a view in any number of browsers, in its own thread.

The run passes events to its view and never waits for this server. Ten times per second, the server sends each
browser the data that this browser lacks. Browsers that need the same data are sent the same bytes. A browser
that does not read gets no data until it reads again, and is disconnected after some seconds.

Once per second each browser is also sent a beat, which shows the age of the browser's data. Requests carry
the newest beat that the page has received, and the time since then by the page's clock. The server can
therefore refuse old requests without comparing the clocks of two machines.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import hashlib
import logging
import secrets
import socket
import threading
import time
from collections.abc import Callable, Coroutine, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any, Self, TypeAlias

import msgspec
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from geo.reading import misfit
from geo.system import steady_s
from mission.errors import LinkError
from wbf_mission.addons.web.guard import Guard, HurriedProtocol, is_loopback, own_names
from wbf_mission.addons.web.schema import Answer, Background, Beat, Given, Order, Reply, Update
from wbf_mission.addons.web.tiles import MapTiles
from wbf_mission.addons.web.view import Cursor, View
from wbf_mission.events import Event
from wbf_mission.run.orders import Orders, too_late

INTERVAL_S = 0.1
BEAT_S = 1.0
OLD_S = 3.0
"""A page whose newest beat is older than this (s) marks its data as old and gives no orders."""
STALLED_S = 10.0
"""Maximum time (s) for which a browser may accept no data; TCP can measure this only on Linux."""
SEND_TIMEOUT_S = 20.0
"""Maximum time for which sending an update to a browser may take (s)."""
MAX_REQUEST_BYTES = 4096
MAX_CONNECTIONS = 200
_ENDING_S = 2.0
_ROUNDED_S = 0.25
"""Tolerance for rounding and drift of browsers' clocks (s)."""
_TYPES = {"html": "text/html", "js": "text/javascript", "css": "text/css", "txt": "text/plain"}


class LiveServer:
    """Server of the pages of a view, as a context manager.

    The caller connects `view` to the run's events. If `host` is reachable from other machines, browsers need
    `token`, by default a random text that `url` contains. Without `orders`, pages only show the run. `tiles`
    is the file of a background map. `routes` are protected by the guard (`wbf_mission.addons.web.guard`), at
    any path except "/live", "/beats" and "/tiles/..."; their handlers must limit the size of request bodies.
    `home` is the page in ``static/`` that is served at "/". Raises MapTilesError if the tiles are unusable;
    entering the context raises LinkError if the port is taken.

    >>> with LiveServer(View()) as server:
    ...     server.url.startswith("http://127.0.0.1:")
    True
    """

    def __init__(
        self,
        view: View,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        token: str | None = None,
        orders: Orders | None = None,
        tiles: Path | None = None,
        routes: Sequence[BaseRoute] = (),
        home: str = "live",
        clock: Callable[[], float] = steady_s,
    ) -> None:
        self._clock = clock
        self._host, self.port, self._orders = host, port, orders
        self._token = secrets.token_urlsafe() if token is None and not is_loopback(host) else token
        self._tiles = None if tiles is None else MapTiles(tiles)
        self.background: Background | None = None if self._tiles is None else self._tiles.background
        self._viewers, self._ending = 0, False
        self._shared: dict[Cursor | None, _Shared] = {}
        self._making = asyncio.Lock()
        self.show(view)
        app = Starlette(
            routes=[
                *routes,
                WebSocketRoute("/live", partial(self._serve_page, self._tell)),
                WebSocketRoute("/beats", partial(self._serve_page, self._tell_beats)),
                Route("/tiles/{z:int}/{x:int}/{y:int}", self._tile),
                *_static_routes(home),
            ]
        )
        config = uvicorn.Config(
            Guard(app, own_names(host), self._token),
            loop="asyncio",
            http=HurriedProtocol,
            ws="websockets-sansio",
            ws_max_size=MAX_REQUEST_BYTES,
            ws_per_message_deflate=False,  # Compression would take time for each viewer
            lifespan="off",
            log_config=None,
            log_level="error",
            access_log=False,
            proxy_headers=False,
            server_header=False,
            limit_concurrency=MAX_CONNECTIONS,
            timeout_graceful_shutdown=1,
        )
        logging.getLogger("uvicorn.error").addFilter(_is_ours)
        self._server = uvicorn.Server(config)

    def __enter__(self) -> Self:
        """Listen on the port and start the server thread."""
        try:
            family = socket.getaddrinfo(self._host, self.port, type=socket.SOCK_STREAM)[0][0]
            self._socket = socket.create_server((self._host, self.port), family=family)
        except OSError as error:
            why = (error.strerror or str(error)).partition(" (while")[0]
            mend = "give an address of this machine"
            if error.errno in (errno.EADDRINUSE, errno.EACCES):
                mend = "choose another port, or 0 for any free port"
            raise LinkError(
                f"live page: cannot listen at {self._host}, port {self.port} ({why}); {mend}"
            ) from None
        if hasattr(socket, "TCP_USER_TIMEOUT"):
            # Drop a browser that accepts no data; asyncio would wait without limit.
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(1e3 * STALLED_S))
        self.port = self._socket.getsockname()[1]
        serve = partial(self._server.run, [self._socket])
        self._thread = threading.Thread(target=serve, name="live page", daemon=True)
        self._thread.start()
        while not self._server.started and self._thread.is_alive():
            self._thread.join(0.005)
        if not self._server.started:
            raise LinkError(f"live page: the server at port {self.port} did not start")
        return self

    def __exit__(self, *_: object) -> None:
        """Send the remaining data to viewers, and stop."""
        self._ending = True
        deadline_s = time.monotonic() + _ENDING_S
        while self._viewers and time.monotonic() < deadline_s:
            time.sleep(INTERVAL_S / 4)
        self._server.should_exit = True
        self._thread.join()
        if self._tiles is not None:
            self._tiles.close()

    @property
    def url(self) -> str:
        """Address to open, with the token if there is a token."""
        host = _outward() if self._host in ("0.0.0.0", "::", "") else self._host  # noqa: S104
        host = f"[{host}]" if ":" in host else host
        return f"http://{host}:{self.port}/" + (f"?token={self._token}" if self._token else "")

    def show(self, view: View) -> None:
        """Show another view; open pages start anew."""
        view.offer(self.background)
        self._view = view

    # Viewers

    async def _serve_page(self, tell: _Telling, websocket: WebSocket) -> None:
        """Serve one page: send new data and answer requests, until one of these ends."""
        await websocket.accept()
        self._viewers += 1
        visit = _Visit(websocket, self._clock)
        tasks = {asyncio.create_task(part(visit)) for part in (tell, self._hear)}
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        except (TimeoutError, WebSocketDisconnect):
            pass
        finally:
            self._viewers -= 1
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        with contextlib.suppress(TimeoutError, WebSocketDisconnect, RuntimeError):
            async with asyncio.timeout(1.0):
                await websocket.close(1001)

    async def _tell(self, visit: _Visit) -> None:
        view, cursor, now_s = self._view, None, asyncio.get_running_loop().time
        while True:
            if cursor is None or view.cursor > cursor:
                text, cursor = await self._update(view, cursor)
                await visit.send(text)
            elif self._ending or view is not self._view:
                return
            await visit.beat(view)
            await asyncio.sleep(INTERVAL_S - now_s() % INTERVAL_S)  # All viewers wake at once

    async def _tell_beats(self, visit: _Visit) -> None:
        """Send only beats: this page shows no view."""
        while not self._ending:
            await visit.beat(self._view)
            await asyncio.sleep(INTERVAL_S)

    async def _update(self, view: View, cursor: Cursor | None) -> tuple[str, Cursor]:
        """Return the data newer than a cursor; it is computed once per interval for all viewers."""
        async with self._making:
            now_s = asyncio.get_running_loop().time()
            self._shared = {
                key: shared for key, shared in self._shared.items() if shared.good_for(view, now_s)
            }
            shared = self._shared.get(cursor)
            if shared is None:
                text, after = await asyncio.to_thread(_encoded, view, cursor)
                # A new viewer gets newer data with its next update, so the full state may be cached longer.
                until_s = now_s + INTERVAL_S * (0.9 if cursor else 20.0)
                shared = self._shared[cursor] = _Shared(view, until_s, text, after)
            return shared.text, shared.cursor

    async def _hear(self, visit: _Visit) -> None:
        while (message := await visit.websocket.receive())["type"] != "websocket.disconnect":
            reply = Update(self._view.time_s, reply=self._ask(message.get("text"), visit))
            await visit.send(reply.json().decode())

    def _ask(self, text: str | None, visit: _Visit) -> Reply:
        """Pass on a page's request unless it is too old or was already made; return the reply."""
        if self._orders is None:
            return Reply("", "this page only shows the run: orders are not allowed", 0)
        try:
            # The field names show the kind of request, so that an error message can name this kind.
            fields = msgspec.json.decode(text or "", type=dict[str, msgspec.Raw])
            kind: type[Answer | Order] = Answer if "answer" in fields else Order
            given = msgspec.json.decode(text or "", type=kind)
        except msgspec.ValidationError as error:
            return Reply("", f"invalid request: {misfit(error)}", 0)
        except (msgspec.DecodeError, RecursionError):
            return Reply("", "invalid request: it is not JSON", 0)
        name, number = given.order if isinstance(given, Order) else "answer", given.given.number
        age_s, refused = visit.age_of(given.given)
        if refused:
            return Reply(name, refused, number)
        if isinstance(given, Answer):
            return Reply(name, self._orders.answer(given.answer, given.question, age_s=age_s), number)
        refused = self._orders.take(given.system_ids, name, given.value, given.confirmed, age_s=age_s)
        return Reply(name, refused, number)

    # Files

    async def _tile(self, request: Request) -> Response:
        place = (request.path_params[name] for name in "zxy")
        found = None if self._tiles is None else await asyncio.to_thread(self._tiles.read, *place)
        if found is None:
            return Response(status_code=204)  # Browsers log a 404 in the console
        headers = {"Cache-Control": "private, max-age=3600"}
        return Response(found[0], headers=headers, media_type=found[1])


def _is_ours(record: logging.LogRecord) -> bool:
    """Return whether a log line is shown to the user; lines about malformed input from clients are not."""
    return not record.getMessage().startswith("Invalid UTF-8")


class _Visit:
    """Connection of one page: its beats, and the age of its requests."""

    def __init__(self, websocket: WebSocket, clock: Callable[[], float]) -> None:
        self.websocket = websocket
        self._clock, self._begun_s = clock, clock()
        self._beat_s = -BEAT_S
        self._number = 0

    async def send(self, text: str) -> None:
        """Send a message; raise TimeoutError if sending is slow, WebSocketDisconnect if the page is gone."""
        try:
            async with asyncio.timeout(SEND_TIMEOUT_S):
                await self.websocket.send_text(text)
        except RuntimeError:  # uvicorn has closed the connection after an invalid frame
            raise WebSocketDisconnect from None

    async def beat(self, view: View) -> None:
        """Send a heartbeat to the page if one is due."""
        if self._now_s >= self._beat_s + BEAT_S:
            update = Update(view.time_s, beat=Beat(self.next_beat(), view.silent_s()))
            await self.send(update.json().decode())

    def next_beat(self) -> float:
        self._beat_s = self._now_s
        return self._beat_s

    @property
    def _now_s(self) -> float:
        return self._clock() - self._begun_s

    def age_of(self, given: Given) -> tuple[float, str]:
        """Return the maximum age of a request, and the reason to refuse it (empty if there is none)."""
        beat_s, number = given.beat_s, given.number
        # The beat was sent before it arrived, so this is an upper limit.
        age_s = self._now_s - beat_s - given.after_s
        if number <= self._number:
            return age_s, "it was given before: each order is carried out once"
        self._number = number
        if beat_s > self._beat_s or age_s < -_ROUNDED_S:
            return age_s, "its time is not valid: load the page again"
        if given.after_s > OLD_S:
            return age_s, f"it was given with page data that was {given.after_s:.0f} s old: look again"
        return max(age_s, 0.0), too_late(age_s)


_Telling: TypeAlias = Callable[[_Visit], Coroutine[Any, Any, None]]


@contextlib.contextmanager
def live_page(
    *, host: str, port: int, orders: Orders | None, tiles: Path | None
) -> Iterator[tuple[str, Callable[[Event], None]]]:
    """Serve the page of a run: a `wbf_mission.cli.command.LivePage`."""
    view = View()
    with LiveServer(view, host=host, port=port, orders=orders, tiles=tiles) as server:
        yield server.url, view.take


@dataclass(frozen=True, slots=True)
class _Shared:
    """An update that all viewers with the same cursor share."""

    view: View
    until_s: float
    text: str
    cursor: Cursor

    def good_for(self, view: View, now_s: float) -> bool:
        return self.view is view and now_s < self.until_s


def _encoded(view: View, cursor: Cursor | None) -> tuple[str, Cursor]:
    update, after = view.update(cursor)
    return update.json().decode(), after


def _static_routes(home: str) -> list[Route]:
    """Return a route for each static file, and a second route without ".html" for each page."""
    routes = []
    for file in (resources.files("wbf_mission.addons.web") / "static").iterdir():
        stem, _, kind = file.name.rpartition(".")
        if kind in _TYPES:
            data = file.read_bytes()
            handler = partial(_send_file, data, _TYPES[kind], f'"{hashlib.sha256(data).hexdigest()[:16]}"')
            paths = [f"/{file.name}"] + ["/" if stem == home else f"/{stem}"] * (kind == "html")
            routes += [Route(path, handler) for path in paths]
    return routes


async def _send_file(data: bytes, media_type: str, etag: str, request: Request) -> Response:
    # Browsers cache the file, and ask each time whether it has changed.
    headers = {"ETag": etag, "Cache-Control": "no-cache"}
    if request.headers.get("if-none-match") == etag:
        return Response(status_code=304, headers=headers)
    return Response(data, headers=headers, media_type=media_type)


def _outward() -> str:
    """Return this machine's address on its network, if known; no data is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # An address reserved for documentation
        except OSError:
            return socket.gethostname()
        return str(probe.getsockname()[0])
