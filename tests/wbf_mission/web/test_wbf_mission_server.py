"""The server of the page, asked over real sockets: what it sends, and whom it refuses."""

from __future__ import annotations

import asyncio
import http.client
import itertools
import json
import socket
import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route
from viewer import Viewer
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from geo.farms import get_farm
from mission.errors import LinkError
from sensors.fields import PAPER_FIELDS
from sensors.scoring.information import InformationModel
from wbf_mission.events import (
    Estimated,
    EventStream,
    Noted,
    Orderable,
    RunBegun,
    RunEnded,
    VehicleMoved,
    VehicleSaid,
)
from wbf_mission.web import server as served
from wbf_mission.web.guard import HEADERS
from wbf_mission.web.server import LiveServer
from wbf_mission.web.view import View

LONG_S = 120.0  # a limit against hanging, not a measure
PNG = b"\x89PNG\r\n\x1a\n" + b"0" * 20


@contextmanager
def watching(server: LiveServer, **more: Any) -> Iterator[ClientConnection]:
    address = f"127.0.0.1:{server.port}"
    options: dict[str, Any] = {"origin": f"http://{address}", "max_size": None, "compression": None}
    with connect(f"ws://{address}/live", **(options | more)) as client:
        yield client


def ask(
    server: LiveServer, path: str, method: str = "GET", body: bytes | None = None, **headers: str
) -> tuple[http.client.HTTPResponse, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    try:
        connection.putrequest(method, path, skip_host="host" in headers)
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        if body is not None:
            connection.putheader("Content-Length", str(len(body)))
        connection.endheaders(body)
        response = connection.getresponse()
        return response, response.read()
    finally:
        connection.close()


def sent(response: http.client.HTTPResponse) -> dict[str, str]:
    """Return those headers of an answer that every one must have."""
    return {name: response.getheader(name, "") for name in HEADERS}


class Taking:
    """Orders as whoever flies takes them."""

    def __init__(self) -> None:
        self.taken: list[tuple[Any, ...]] = []

    def take(self, *order: Any) -> str:
        self.taken.append(order)
        return "" if order[1] == "hold" else f"{order[1]} cannot be ordered now"

    def answer(self, text: str) -> str:
        self.taken.append((text,))
        return ""


def moved(k: int, vehicle: int = 1) -> VehicleMoved:
    return VehicleMoved(k / 10, 1, 1, vehicle, float(k), 2.0, 3.0, 4.0)


def test_a_page_is_told_everything_and_then_what_is_new() -> None:
    stream, view = EventStream(), View()
    stream.listen(view.take)
    stream.tell(Noted("before"))
    with LiveServer(view) as server, watching(server) as client:
        viewer = Viewer()
        first = viewer.take(client.recv(timeout=10))
        assert [one["text"] for one in first["said"]] == ["before"] and first["status"]["orders"] == []
        stream.tell(moved(1))
        second = viewer.take(client.recv(timeout=10))
        assert set(second) == {"time_s", "states"} and second["states"]["1"]["x"] == [1.0]
        with pytest.raises(TimeoutError):  # Nothing new, nothing sent
            client.recv(timeout=0.5)


def test_a_page_is_told_the_end_before_the_server_is_gone() -> None:
    view, viewer = View(), Viewer()
    with LiveServer(view) as server, watching(server) as client:
        viewer.take(client.recv(timeout=10))
        view.take(RunEnded(7.0, "completed", "all flown"))
        server.__exit__()
        with pytest.raises(ConnectionClosed):
            while True:
                viewer.take(client.recv(timeout=10))
    assert viewer.status["outcome"] == "completed" and viewer.time_s == 7.0


def test_ten_viewers_follow_and_one_that_never_reads_holds_up_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(served, "SEND_TIMEOUT_S", 1.0)
    monkeypatch.setattr(served, "STALLED_S", 2.0)
    made, goes_on = [0], threading.Event()
    goes_on.set()
    encoded = served._encoded

    def counting(view: View, cursor: Any) -> Any:
        made[0] += 1
        assert goes_on.wait(LONG_S), "telling waits for the server"
        return encoded(view, cursor)

    monkeypatch.setattr(served, "_encoded", counting)
    stream, view = EventStream(), View()
    stream.listen(view.take)
    viewers, threads = [Viewer() for _ in range(10)], []
    received = [0] * len(viewers)

    def follow(server: LiveServer, number: int) -> None:
        viewer = viewers[number]
        with watching(server) as client:
            while not (viewer.said and viewer.said[-1]["text"] == "the end"):
                viewer.take(client.recv(timeout=LONG_S))
                received[number] += 1

    farm, random = get_farm("miniberry-10"), np.random.default_rng(0)
    told = itertools.count()

    def tell_much() -> None:
        value = random.random((3, farm.width_cells, farm.height_cells), np.float32)
        for k in itertools.islice(told, 200):
            stream.tell(moved(k, 1 + k % 10))
        stream.tell(VehicleSaid(k / 10, 1, 6, "x" * 400))
        stream.tell(Estimated(k / 10, 1, k, InformationModel(value, value), None))

    def tell_all(text: str) -> None:
        """Note something, and wait until all viewers know it."""
        stream.tell(Noted(text))
        end_s = time.monotonic() + LONG_S
        while not all(viewer.said and viewer.said[-1]["text"] == text for viewer in viewers):
            assert time.monotonic() < end_s, text
            time.sleep(0.01)

    with LiveServer(view) as server:
        sleeper = socket.create_connection(("127.0.0.1", server.port))
        sleeper.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        sleeper.sendall(
            f"GET /live HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nOrigin: http://127.0.0.1:{server.port}\r\n"
            "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
        )
        for number in range(len(viewers)):
            threads.append(threading.Thread(target=follow, args=(server, number), daemon=True))
            threads[-1].start()
        stream.tell(RunBegun("", farm, PAPER_FIELDS))
        tell_all("all are there")
        # Those who know the same share: far fewer updates are made than are received. On a busy machine some
        # may miss a short interval, and from then on know something else than the others.
        before = made[0], sum(received)
        with monkeypatch.context() as patched:
            patched.setattr(served, "INTERVAL_S", 0.5)
            for k in range(6):
                tell_much()
                tell_all(f"{k}")
        assert made[0] - before[0] < (sum(received) - before[1]) / 2
        # Whatever the viewers and the server do, telling goes on.
        goes_on.clear()
        for _ in range(50):
            tell_much()
        goes_on.set()
        began = time.monotonic()
        while time.monotonic() - began < 3.0:
            tell_much()
            time.sleep(0.005)
        stream.tell(Noted("the end"))
        for thread in threads:
            thread.join(LONG_S)
        assert not any(thread.is_alive() for thread in threads)
        # The one that never read was let go.
        deadline = time.monotonic() + 30
        connections = server._server.server_state.connections
        while (server._viewers or connections) and time.monotonic() < deadline:
            time.sleep(0.1)
        assert server._viewers == 0 and not connections
        sleeper.close()
    everything = Viewer()
    everything.take(view.update(None)[0].json())
    for viewer in viewers:
        assert vars(viewer) == vars(everything)


def test_viewers_share_an_update_although_the_run_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(served, "INTERVAL_S", LONG_S)
    stream, view, made = EventStream(), View(), itertools.count()
    stream.listen(view.take)
    stream.tell(moved(next(made)))
    encoded = served._encoded

    def going_on(view: View, cursor: Any) -> Any:
        update = encoded(view, cursor)
        stream.tell(moved(next(made)))
        return update

    monkeypatch.setattr(served, "_encoded", going_on)
    server = LiveServer(view)

    async def ten(cursor: Any) -> tuple[str, Any]:
        (update,) = set(await asyncio.gather(*(server._update(view, cursor) for _ in range(10))))
        return update

    async def twice() -> tuple[str, str]:
        first, cursor = await ten(None)
        return first, (await ten(cursor))[0]

    first, second = asyncio.run(twice())
    viewer = Viewer()
    assert viewer.take(first)["states"]["1"]["x"] == [0.0]
    assert viewer.take(second)["states"]["1"]["x"] == [1.0]
    assert next(made) == 3


def test_a_tab_that_is_closed_changes_nothing() -> None:
    view = View()
    with LiveServer(view) as server:
        for _ in range(20):
            with watching(server) as client:
                client.recv(timeout=10)
        with watching(server) as client:
            assert json.loads(client.recv(timeout=10))["status"]["outcome"] == "running"


def test_another_view_is_shown_to_pages_that_come_again() -> None:
    first, second = View(), View()
    first.take(Noted("first"))
    second.take(Noted("second"))
    with LiveServer(first) as server:
        with watching(server) as client:
            client.recv(timeout=10)
            server.show(second)
            with pytest.raises(ConnectionClosed):
                client.recv(timeout=10)
        with watching(server) as client:
            assert json.loads(client.recv(timeout=10))["said"][0]["text"] == "second"


def test_orders_are_off_by_default() -> None:
    with LiveServer(View()) as server, watching(server) as client:
        client.recv(timeout=10)
        client.send('{"order":"hold","system_id":1}')
        assert json.loads(client.recv(timeout=10))["reply"]["error"].startswith("this page only shows")


def test_orders_are_handed_on_and_their_page_alone_hears_what_became_of_them() -> None:
    orders, view = Taking(), View()
    view.take(Orderable(("hold", "land")))
    with LiveServer(view, orders=orders) as server, watching(server) as client, watching(server) as other:
        assert json.loads(client.recv(timeout=10))["status"]["orders"] == ["hold", "land"]
        other.recv(timeout=10)
        replies = []
        for request in (
            {"order": "hold", "system_id": 1},
            {"order": "set-item", "system_id": None, "value": "3", "confirmed": True},
            {"answer": "yes"},
        ):
            client.send(json.dumps(request))
            replies.append(json.loads(client.recv(timeout=10))["reply"])
        assert replies == [
            {"order": "hold", "error": ""},
            {"order": "set-item", "error": "set-item cannot be ordered now"},
            {"order": "answer", "error": ""},
        ]
        assert orders.taken == [(1, "hold", "", False), (None, "set-item", "3", True), ("yes",)]
        with pytest.raises(TimeoutError):
            other.recv(timeout=0.3)


@pytest.mark.parametrize(
    "request_text",
    [
        "",
        "no json",
        "[]",
        "{}",
        '{"order":"hold"}',
        '{"order":"hold","system_id":"1"}',
        '{"order":"hold","system_id":1,"confirmed":1}',
        '{"order":"hold","system_id":1,"more":1}',
        '{"order":"hold","system_id":1,"answer":"y"}',
        '{"answer":1}',
        '{"order":"' + "h" * 41 + '","system_id":1}',
        '{"order":"hold","system_id":1,"value":"' + "v" * 201 + '"}',
        "[" * 2000,
    ],
)
def test_what_is_no_request_is_refused(request_text: str) -> None:
    orders = Taking()
    with LiveServer(View(), orders=orders) as server, watching(server) as client:
        client.recv(timeout=10)
        client.send(request_text)
        reply = json.loads(client.recv(timeout=10))["reply"]
        assert reply["error"].startswith("no request: ") and "\n" not in reply["error"]
        client.send(b'{"order":"hold","system_id":1}')  # Bytes are no text
        assert json.loads(client.recv(timeout=10))["reply"]["error"].startswith("no request: ")
    assert orders.taken == []


def test_what_is_no_text_ends_the_connection_quietly(caplog: pytest.LogCaptureFixture) -> None:
    with LiveServer(View()) as server, watching(server) as client:
        client.recv(timeout=10)
        client.send(b"\xff\xfe", text=True)
        with pytest.raises(ConnectionClosed):
            client.recv(timeout=10)
        garbage = socket.create_connection(("127.0.0.1", server.port))
        garbage.sendall(b"\x16\x03\x01 no HTTP\r\n\r\n")
        assert b"400" in garbage.recv(1000)
        garbage.close()
    assert not [record for record in caplog.records if record.name.startswith("uvicorn")]


def test_a_request_that_is_too_large_ends_the_connection() -> None:
    orders = Taking()
    with LiveServer(View(), orders=orders) as server, watching(server) as client:
        client.recv(timeout=10)
        client.send('{"answer":"' + "y" * 10_000 + '"}')
        with pytest.raises(ConnectionClosed) as closed:
            client.recv(timeout=10)
        assert closed.value.rcvd is not None and closed.value.rcvd.code == 1009
    assert orders.taken == []


@pytest.mark.parametrize(
    "origin", [None, "null", "http://evil.example", "http://127.0.0.1", "https://127.0.0.1.evil"]
)
def test_other_sites_cannot_open_the_stream(origin: str | None) -> None:
    with LiveServer(View()) as server:
        with pytest.raises(InvalidStatus) as refused, watching(server, origin=origin):
            pass
        assert refused.value.response.status_code == 403
        if origin is not None:
            assert ask(server, "/", origin=origin)[0].status == 403


@pytest.mark.parametrize(
    "name",
    ["evil.example", "evil.example:80", "localhost.evil.example", "", "[::1", "a b", "127.0.0.1:99999"],
)
def test_other_names_do_not_lead_here(name: str) -> None:
    with LiveServer(View()) as server:
        response, _ = ask(server, "/", host=name)
        assert response.status in (400, 421)
        with pytest.raises(InvalidStatus), watching(server, additional_headers={"Host": name or "x"}):
            pass


def test_addresses_and_localhost_lead_here() -> None:
    with LiveServer(View()) as server:
        for name in ("localhost", "127.0.0.1", "[::1]"):
            assert ask(server, "/", host=f"{name}:{server.port}")[0].status == 200


def test_every_answer_has_the_policy_and_nothing_allows_other_origins() -> None:
    with LiveServer(View()) as server:
        for path, status in (("/", 200), ("/live.js", 200), ("/nothing", 404), ("/tiles/1/0/0", 204)):
            response, _ = ask(server, path)
            assert response.status == status
            assert HEADERS.items() <= sent(response).items()
            assert not any("access-control" in name.lower() for name, _ in response.getheaders())
            if status == 404:
                assert response.getheader("Cache-Control") == "no-store"
        response, _ = ask(server, "/", host="evil.example")
        assert HEADERS.items() <= sent(response).items()


@pytest.mark.parametrize(
    "path",
    [
        "/../server.py",
        "/..%2fserver.py",
        "/static/../view.py",
        "//etc/passwd",
        "/%2e%2e/view.py",
        "/live.js/../view.py",
        "/sources.sha256",
        "/page/src/schema.ts",
        "/tiles/../../view.py",
        "/tiles/-1/0/0",
        "/tiles/1/2/x",
        "/\\..\\view.py",
    ],
)
def test_only_files_of_the_page_are_served(path: str) -> None:
    with LiveServer(View()) as server:
        assert ask(server, path)[0].status == 404


def test_files_are_asked_for_again_only_when_they_changed() -> None:
    with LiveServer(View()) as server:
        response, body = ask(server, "/live.js")
        assert response.getheader("Content-Type", "").startswith("text/javascript") and len(body) > 1000
        response, body = ask(server, "/live.js", if_none_match=response.getheader("ETag", ""))
        assert response.status == 304 and body == b""


def test_elsewhere_than_on_this_machine_a_token_is_needed() -> None:
    view = View()
    view.take(Noted("secret"))
    with LiveServer(view, host="0.0.0.0") as server:
        token = server.url.partition("?token=")[2]
        assert len(token) > 30
        for path in (
            "/",
            "/live.js",
            "/tiles/0/0/0",
            "/nothing",
            "/?token=wrong",
            f"/?token={token}x",
            "/?token=",
        ):
            response, body = ask(server, path)
            assert response.status == 401 and token.encode() not in body
        with pytest.raises(InvalidStatus), watching(server):
            pass
        response, _ = ask(server, f"/?token={token}")
        assert response.status == 303 and response.getheader("Location") == "/"
        cookie = response.getheader("Set-Cookie", "")
        assert "httponly" in cookie.lower() and "samesite=lax" in cookie.lower()
        given = cookie.partition(";")[0]
        assert ask(server, "/", cookie=given)[0].status == 200
        assert ask(server, "/", authorization=f"Bearer {token}")[0].status == 200
        with watching(server, additional_headers={"Cookie": given}) as client:
            assert json.loads(client.recv(timeout=10))["said"][0]["text"] == "secret"
        # The name under which it is kept tells the port: another server's cookie is another one.
        name, _, value = given.partition("=")
        assert ask(server, "/", cookie=f"{name}0={value}")[0].status == 401
        # Who has the token still cannot be led to another site by it.
        response, _ = ask(server, f"//evil.example/?token={token}")
        assert response.getheader("Location") == "/evil.example/"


def test_a_token_can_be_given_and_is_needed_then() -> None:
    with LiveServer(View(), token="a-token") as server:
        assert server.url.endswith("/?token=a-token")
        assert ask(server, "/")[0].status == 401
        assert ask(server, "/", authorization="Bearer a-token")[0].status == 200


def test_further_routes_lie_behind_the_same_guard() -> None:
    asked: list[str] = []

    async def post(request: Request) -> Response:
        asked.append((await request.body()).decode())
        return Response("done")

    with LiveServer(View(), routes=[Route("/api/do", post, methods=["POST"])]) as server:
        here = f"http://127.0.0.1:{server.port}"
        assert ask(server, "/api/do", "POST", b"{}", origin=here)[0].status == 200
        for headers in ({}, {"origin": "http://evil.example"}, {"origin": here, "host": "evil.example"}):
            assert ask(server, "/api/do", "POST", b"{}", **headers)[0].status in (403, 421)
        assert ask(server, "/api/do", "OPTIONS", origin="http://evil.example")[0].status == 403
    assert asked == ["{}"]


def test_a_port_that_is_taken_is_told_in_one_line() -> None:
    with (
        LiveServer(View()) as server,
        pytest.raises(LinkError) as error,
        LiveServer(View(), port=server.port),
    ):
        pass
    assert "choose another port" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("host", ["no.such.host.invalid", "192.0.2.200"])
def test_an_address_of_another_machine_is_told_in_one_line(host: str) -> None:
    with (
        pytest.raises(LinkError, match=f"{host}.*give an address of this machine"),
        LiveServer(View(), host=host),
    ):
        pass


def test_nothing_is_left_when_it_ends() -> None:
    with LiveServer(View()) as server:
        assert ask(server, "/")[0].status == 200
    assert not any(thread.name == "live page" for thread in threading.enumerate())
    with pytest.raises(ConnectionRefusedError):
        ask(server, "/")


def test_the_users_tiles_lie_behind_the_map(tmp_path: Path) -> None:
    path = tmp_path / "land.mbtiles"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE metadata (name, value)")
        database.execute("CREATE TABLE tiles (zoom_level, tile_column, tile_row, tile_data)")
        database.execute("INSERT INTO metadata VALUES ('attribution', '<b>the land office</b>')")
        database.execute("INSERT INTO tiles VALUES (2, 1, 3, ?)", (PNG,))
    database.close()
    with LiveServer(View(), tiles=path) as server, watching(server) as client:
        told = json.loads(client.recv(timeout=10))["background"]
        assert told == {"attribution": "the land office", "min_zoom": 2, "max_zoom": 2}
        response, body = ask(server, "/tiles/2/1/0")
        assert response.status == 200 and body == PNG and response.getheader("Content-Type") == "image/png"
        assert ask(server, "/tiles/2/1/1")[0].status == 204
