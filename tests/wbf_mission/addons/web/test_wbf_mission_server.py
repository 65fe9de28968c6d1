"""The server of the page, asked over real sockets: what it sends, and whom it refuses."""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import itertools
import json
import socket
import sqlite3
import threading
import time
from collections.abc import Coroutine, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route
from viewer import Clock, Taking, Viewer, watching
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection

from geo.farms import get_farm
from mission.errors import LinkError
from sensors.fields import PAPER_FIELDS
from sensors.scoring.information import InformationModel
from wbf_mission import events
from wbf_mission.addons.web import guard, schema
from wbf_mission.addons.web import server as served
from wbf_mission.addons.web.guard import HEADERS
from wbf_mission.addons.web.schema import Update
from wbf_mission.addons.web.server import LiveServer
from wbf_mission.addons.web.view import View
from wbf_mission.run.orders import LIFE_S, Orders

NO_SOCKET: Any = None
LONG_S = 120.0  # a limit against hanging, not a measure
PNG = b"\x89PNG\r\n\x1a\n" + b"0" * 20


def run(what: Coroutine[Any, Any, Any]) -> Any:
    """Run a coroutine in a thread: the tests' thread may have a loop, that of the browser of other tests."""
    with ThreadPoolExecutor(1) as threads:
        return threads.submit(asyncio.run, what).result()


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


GIVEN = {"number": 1, "beat_s": 0.0, "after_s": 0.0}
HOLD = {"order": "hold", "system_ids": [1], "given": GIVEN}


def news(client: ClientConnection, timeout_s: float = 10.0) -> dict[str, Any]:
    """Return the next update that is no beat."""
    end_s = time.monotonic() + timeout_s
    while True:
        update: dict[str, Any] = json.loads(client.recv(timeout=end_s - time.monotonic()))
        if "beat" not in update:
            return update


def beat(client: ClientConnection) -> dict[str, Any]:
    """Return the next beat."""
    while True:
        update: dict[str, Any] = json.loads(client.recv(timeout=10))
        if "beat" in update:
            found: dict[str, Any] = update["beat"]
            return found


def asked(client: ClientConnection, request: dict[str, Any]) -> dict[str, Any]:
    """Ask, and return the reply."""
    client.send(json.dumps(request))
    return the_reply(client)


def the_reply(client: ClientConnection) -> dict[str, Any]:
    while "reply" not in (update := news(client)):
        pass
    reply: dict[str, Any] = update["reply"]
    return reply


def moved(k: int, vehicle: int = 1) -> events.VehicleMoved:
    return events.VehicleMoved(k / 10, 1, 1, vehicle, float(k), 2.0, 3.0, 4.0)


def test_a_page_is_told_everything_and_then_what_is_new() -> None:
    stream, view = events.EventStream(), View()
    stream.listen(view.take)
    stream.tell(events.Noted("before"))
    with LiveServer(view) as server, watching(server) as client:
        viewer = Viewer()
        first = viewer.take(client.recv(timeout=10))
        assert [one["text"] for one in first["said"]] == ["before"] and first["status"]["orders"] == []
        stream.tell(moved(1))
        second = viewer.take(json.dumps(news(client)))
        assert set(second) == {"time_s", "states"} and second["states"]["1"]["x"] == [1.0]
        with pytest.raises(TimeoutError):  # Nothing new, nothing sent
            news(client, 0.5)


def test_a_page_is_told_the_end_before_the_server_is_gone() -> None:
    view, viewer = View(), Viewer()
    with LiveServer(view) as server, watching(server) as client:
        viewer.take(client.recv(timeout=10))
        view.take(events.RunEnded(7.0, "completed", "all flown"))
        server.__exit__()
        with pytest.raises(ConnectionClosed):
            while True:
                viewer.take(client.recv(timeout=10))
    assert viewer.status["outcome"] == "completed" and viewer.time_s == 7.0


def test_ten_viewers_follow_and_one_that_never_reads_holds_up_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(served, "SEND_TIMEOUT_S", 1.0)
    monkeypatch.setattr(served, "STALLED_S", 2.0)
    goes_on = threading.Event()
    goes_on.set()
    encoded = served._encoded

    def waiting(view: View, cursor: Any) -> Any:
        assert goes_on.wait(LONG_S), "telling waits for the server"
        return encoded(view, cursor)

    monkeypatch.setattr(served, "_encoded", waiting)
    stream, view = events.EventStream(), View()
    stream.listen(view.take)
    viewers, threads = [Viewer() for _ in range(10)], []

    def follow(server: LiveServer, number: int) -> None:
        viewer = viewers[number]
        with watching(server) as client:
            while not (viewer.said and viewer.said[-1]["text"] == "the end"):
                viewer.take(client.recv(timeout=LONG_S))

    farm, random = get_farm("miniberry-10"), np.random.default_rng(0)
    told = itertools.count()

    def tell_much() -> None:
        value = random.random((3, farm.width_cells, farm.height_cells), np.float32)
        for k in itertools.islice(told, 200):
            stream.tell(moved(k, 1 + k % 10))
        stream.tell(events.VehicleSaid(k / 10, 1, 6, "x" * 400))
        stream.tell(events.Estimated(k / 10, 1, k, InformationModel(value, value), None))

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
        stream.tell(events.RunBegun("", farm, PAPER_FIELDS))
        stream.tell(events.Noted("all are there"))
        end_s = time.monotonic() + LONG_S
        while not all(viewer.said for viewer in viewers):
            assert time.monotonic() < end_s
            time.sleep(0.01)
        # Whatever the viewers and the server do, telling goes on.
        goes_on.clear()
        for _ in range(50):
            tell_much()
        goes_on.set()
        began = time.monotonic()
        while time.monotonic() - began < 3.0:
            tell_much()
            time.sleep(0.005)
        stream.tell(events.Noted("the end"))
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


def test_another_view_is_shown_to_pages_that_come_again() -> None:
    first, second = View(), View()
    first.take(events.Noted("first"))
    second.take(events.Noted("second"))
    with LiveServer(first) as server:
        with watching(server) as client:
            client.recv(timeout=10)
            server.show(second)
            with pytest.raises(ConnectionClosed):
                news(client)
        with watching(server) as client:
            assert json.loads(client.recv(timeout=10))["said"][0]["text"] == "second"


def test_orders_are_off_by_default() -> None:
    with LiveServer(View()) as server, watching(server) as client:
        client.recv(timeout=10)
        assert asked(client, HOLD)["error"].startswith("this page only shows")


def test_orders_are_handed_on_and_their_page_alone_hears_what_became_of_them() -> None:
    orders, view = Taking({"set-item": "set-item cannot be ordered now"}), View()
    view.take(events.Orderable(("hold", "land")))
    with LiveServer(view, orders=orders) as server, watching(server) as client, watching(server) as other:
        assert json.loads(client.recv(timeout=10))["status"]["orders"] == ["hold", "land"]
        other.recv(timeout=10)
        beat(client)
        replies = [
            asked(client, request | {"given": GIVEN | {"number": number}})
            for number, request in (
                (1, HOLD),
                (2, {"order": "set-item", "system_ids": [2, 1], "value": "3", "confirmed": True}),
                (9, {"answer": "yes", "question": 4}),
            )
        ]
        assert replies == [
            {"order": "hold", "error": "", "number": 1},
            {"order": "set-item", "error": "set-item cannot be ordered now", "number": 2},
            {"order": "answer", "error": "", "number": 9},
        ]
        assert orders.taken == [([1], "hold", "", False), ([2, 1], "set-item", "3", True), ("yes", 4)]
        with pytest.raises(TimeoutError):
            news(other, 0.3)


def test_a_beat_comes_once_a_second_after_what_is_new_and_says_how_old_the_vehicles_states_are() -> None:
    clock = Clock()
    view = View(clock=clock)
    view.take(events.RunBegun("", None, None, simulated=False))
    view.take(replace(moved(1), silent_s=0.5))
    with LiveServer(view, clock=clock) as server, watching(server) as client:
        assert "states" in json.loads(client.recv(timeout=10))
        assert json.loads(client.recv(timeout=10)) == {
            "time_s": 0.1,
            "beat": {"time_s": 0.0, "silent_s": {"1": 0.5}},
        }
        clock.now_s += 0.9
        with pytest.raises(TimeoutError):
            client.recv(timeout=0.5)
        clock.now_s += 0.2
        assert beat(client) == {"time_s": pytest.approx(1.1), "silent_s": {"1": pytest.approx(1.6)}}
        view.take(moved(20, 2))
        clock.now_s += 1.0
        assert "states" in json.loads(client.recv(timeout=10)), "what is new comes first"
        assert set(beat(client)["silent_s"]) == {"1", "2"}
        view.take(events.RunEnded(7.0, "completed", ""))
        clock.now_s += 1.0
        news(client)
        assert beat(client)["silent_s"] == {}, "nothing gets older after the end"


def test_an_order_that_the_network_or_a_stopped_program_kept_is_refused() -> None:
    orders, clock = Taking(), Clock()
    with LiveServer(View(), orders=orders, clock=clock) as server, watching(server) as client:
        beat(client)
        clock.now_s += 1.5
        beat_s = beat(client)["time_s"]
        # Given 0.5 s after the beat, and kept until the program goes on: the page has closed nothing.
        clock.now_s += 30.0
        reply = asked(client, HOLD | {"given": {"number": 1, "beat_s": beat_s, "after_s": 0.5}})
        assert reply["error"] == "too late: it was given 30 s ago; look at the page, and give it again"
        answer = {"answer": "yes", "question": 1, "given": {"number": 2, "beat_s": beat_s, "after_s": 0.5}}
        assert asked(client, answer)["error"].startswith("too late: it was given 30 s ago")
        assert orders.taken == []
        beat_s = beat(client)["time_s"]
        fresh = HOLD | {"given": {"number": 3, "beat_s": beat_s, "after_s": 0.0}}
        assert asked(client, fresh)["error"] == ""
        assert asked(client, fresh)["error"] == "it was given before: each order is carried out once"
        assert len(orders.taken) == 1


@given(
    beats=st.lists(st.floats(1.0, 100.0), min_size=1, max_size=5),
    came_s=st.floats(0.0, 30.0),
    looked_s=st.floats(0.0, 30.0),
    kept_s=st.floats(0.0, 30.0),
)
@example(beats=[1.0], came_s=0.0, looked_s=0.0, kept_s=LIFE_S + 0.01)
@example(beats=[1.0], came_s=LIFE_S + 0.01, looked_s=0.0, kept_s=0.0)
@example(beats=[1.0], came_s=0.0, looked_s=served.OLD_S + 0.01, kept_s=0.0)
@example(beats=[1.0], came_s=0.0, looked_s=served.OLD_S - 0.01, kept_s=LIFE_S - 0.01)
def test_whatever_the_network_does_nothing_older_than_two_seconds_is_taken(
    beats: list[float], came_s: float, looked_s: float, kept_s: float
) -> None:
    clock = Clock()
    visit = served._Visit(NO_SOCKET, clock)
    for apart_s in beats:
        clock.now_s += apart_s
        beat_s = visit.next_beat()
    clock.now_s += came_s  # The beat was on its way
    clock.now_s += looked_s  # Somebody looked at the page
    clock.now_s += kept_s / 2  # The order was on its way, and so was the next beat
    visit.next_beat()
    clock.now_s += kept_s / 2
    age_s, refused = visit.age_of(schema.Given(1, beat_s, looked_s))
    assert age_s >= kept_s - 1e-6
    if kept_s > LIFE_S or looked_s > served.OLD_S:
        assert refused
    elif came_s + kept_s < LIFE_S - 1e-6:
        assert not refused
    assert visit.age_of(schema.Given(1, beat_s, looked_s))[1].startswith("it was given before")


@pytest.mark.parametrize(
    ("given_", "why"),
    [
        ({"beat_s": 5.0}, "its time is not valid"),
        ({"beat_s": 0.2}, "its time is not valid"),
        ({"after_s": 2.9}, "its time is not valid"),
        ({"after_s": 1e9}, "its time is not valid"),
        ({"after_s": 1e10}, "invalid request: given, after_s: it is out of range"),
        ({"beat_s": -1.0}, "invalid request: given, beat_s: it is out of range"),
        ({"number": 0}, "invalid request: given, number: it is out of range"),
        ({"number": 10**30}, "invalid request: "),
        ({"number": 1.5}, "invalid request: "),
        ({"beat_s": None}, "invalid request: "),
        ({"beat_s": "1"}, "invalid request: "),
        ({"more": 1}, "invalid request: "),
    ],
)
def test_an_order_with_a_time_that_is_none_is_refused(given_: dict[str, Any], why: str) -> None:
    visit = served._Visit(NO_SOCKET, Clock())
    visit.next_beat()
    orders = Taking()
    server = LiveServer(View(), orders=orders)
    assert server._ask(json.dumps(HOLD | {"given": GIVEN | given_}), visit).error.startswith(why)
    assert orders.taken == []


def ordering(**more: Any) -> str:
    return json.dumps(HOLD | more)


NO_REQUESTS = [
    "",
    "no json",
    "[]",
    "{}",
    "null",
    "1e999",
    "NaN",
    '{"order":"hold"}',
    '{"order":"hold","system_ids":[1]}',
    '{"order":"hold","system_ids":[1],}',
    '{"order":"x"*3}',
    '{"answer":"yes",',
    '{"answer":"yes"',
    '{"answer":1}',
    '{"answer":"yes","question":1}',
    '{"order":NaN,"system_ids":[1]}',
    ordering(system_ids="1"),
    ordering(system_ids=["1"]),
    ordering(system_ids=[]),
    ordering(system_ids=[-1]),
    ordering(system_ids=[256]),
    ordering(system_ids=[1e300]),
    ordering(system_ids=[10**400]),
    ordering(system_ids=[float("nan")]),
    ordering(system_ids=[True]),
    ordering(system_ids=1),
    ordering(system_ids=None),
    ordering(confirmed=1),
    ordering(more=1),
    ordering(answer="y"),
    ordering(order="h" * 41),
    ordering(order=""),
    ordering(order=["hold"]),
    ordering(value="v" * 201),
    ordering(value={"a": 1}),
    ordering(given=None),
    ordering(given=[]),
    ordering(given="now"),
    *(ordering(given={name: GIVEN[name] for name in GIVEN if name != one}) for one in GIVEN),
    "[" * 4000,
    '{"a":' * 700,
    '{"order":' + "[" * 4000,
    '{"answer":' * 400,
    '{"order":"\\ud8"}',
    '{"order":"\\ud800","system_ids":[1]}',
    '{"order":"\x00"}',
]


def test_what_is_no_request_is_refused_in_one_line_and_leaves_nothing_on_the_terminal(
    capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    orders = Taking()
    with LiveServer(View(), orders=orders) as server, watching(server) as client:
        for text in NO_REQUESTS:
            for given_ in (text, text.encode()):
                client.send(given_)
                error = the_reply(client)["error"]
                assert error.startswith("invalid request: ") and "\n" not in error, text
        client.send(ordering().encode())
        assert the_reply(client)["error"].startswith("invalid request: "), "bytes are no text"
    assert orders.taken == []
    assert capfd.readouterr() == ("", "") and caplog.records == []


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: (
        st.lists(inner) | st.dictionaries(st.sampled_from([*HOLD, *GIVEN, "answer", "x"]) | st.text(), inner)
    ),
    max_leaves=12,
)


@given(st.text() | st.binary().map(lambda some: some.decode("latin-1")) | JSON.map(json.dumps))
def test_whatever_a_page_sends_is_answered(text: str) -> None:
    orders = Taking()
    server = LiveServer(View(), orders=orders)
    reply = server._ask(text, served._Visit(NO_SOCKET, Clock()))
    Update(0.0, reply=reply).json()
    assert reply.error and "\n" not in reply.error and orders.taken == []


@given(st.fixed_dictionaries({"order": st.text(), "system_ids": st.lists(st.integers())}), st.text())
def test_words_that_are_no_text_do_not_reach_the_terminal(order: dict[str, Any], value: str) -> None:
    orders = Orders(events.EventStream())
    orders.allow(("hold", "set item"), range(256))
    server = LiveServer(View(), orders=orders)
    visit = served._Visit(NO_SOCKET, Clock())
    visit.next_beat()
    for name in (order["order"], "hold", "set item"):
        given_ = GIVEN | {"number": visit._number + 1}
        text = json.dumps(order | {"order": name, "value": value, "given": given_})
        Update(0.0, reply=server._ask(text, visit)).json()
    for one in orders.taken():
        str(one).encode()


FRAMES = {
    "text that is no UTF-8": b"\x81\x82\0\0\0\0\xff\xfe",
    "a half of a character": b"\x81\x81\0\0\0\0\xc3",
    "no UTF-8 in parts": b"\x01\x81\0\0\0\0\xff" + b"\x80\x81\0\0\0\0\xff",
    "not masked": b"\x81\x01x",
    "an unknown opcode": b"\x83\x80\0\0\0\0",
    "reserved bits": b"\xf1\x80\0\0\0\0",
    "a part without a beginning": b"\x80\x80\0\0\0\0",
    "a long ping": b"\x89\xfe\x01\x00\0\0\0\0" + b"x" * 256,
    "a ping in parts": b"\x09\x80\0\0\0\0",
    "a length of 2**63": b"\x81\xff" + b"\xff" * 8 + b"\0\0\0\0",
    "an end with half a code": b"\x88\x81\0\0\0\0\x03",
    "an end with a wrong code": b"\x88\x82\0\0\0\0\x00\x01",
    "an end with a reason that is no text": b"\x88\x84\0\0\0\0\x03\xe8\xff\xff",
    "HTTP": b"GET / HTTP/1.1\r\n\r\n",
}


def handshake(server: LiveServer, more: str = "") -> bytes:
    here = f"127.0.0.1:{server.port}"
    return (
        f"GET /live HTTP/1.1\r\nHost: {here}\r\nOrigin: http://{here}\r\nConnection: Upgrade\r\n"
        f"Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\n{more}"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
    ).encode()


def until_closed(connection: socket.socket) -> bytes:
    """Read until the other side closes; a limit against hanging, not a measure."""
    connection.settimeout(LONG_S)
    found = b""
    with contextlib.suppress(ConnectionResetError):
        while part := connection.recv(65536):
            found += part
    return found


def test_frames_that_are_none_end_their_connection_and_leave_nothing_on_the_terminal(
    capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    with LiveServer(View(), orders=Taking()) as server:
        for name, frame in FRAMES.items():
            with socket.create_connection(("127.0.0.1", server.port)) as connection:
                connection.sendall(handshake(server))
                assert b" 101 " in connection.recv(4096), name
                connection.sendall(frame)
                connection.shutdown(socket.SHUT_WR)
                until_closed(connection)
        for more in ("Sec-WebSocket-Protocol: \xff\r\n", "Sec-WebSocket-Extensions: ;;;\r\n", "X: \xff\r\n"):
            with socket.create_connection(("127.0.0.1", server.port)) as connection:
                connection.sendall(handshake(server, more))
                assert connection.recv(4096).startswith(b"HTTP/1.1 ")
        with watching(server) as client:
            beat(client)
    assert capfd.readouterr() == ("", "") and caplog.records == []


class Closed:
    """A connection that uvicorn closed by itself, as after a frame that is none."""

    async def accept(self) -> None:
        pass

    async def send_text(self, text: str) -> None:
        raise RuntimeError("Unexpected ASGI message 'websocket.send', after sending 'websocket.close'.")

    close = send_text

    async def receive(self) -> None:
        await asyncio.sleep(60.0)


@pytest.mark.parametrize("telling", ["_tell", "_tell_beats"])
def test_a_connection_that_is_closed_while_it_is_told_ends_quietly(telling: str) -> None:
    server = LiveServer(View(), orders=Taking())
    run(asyncio.wait_for(server._serve_page(getattr(server, telling), Closed()), 10.0))


UNFINISHED = {
    "nothing": b"",
    "a line": b"GET / HTTP/1.1\r\n",
    "headers": b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: y",
    "a second request": b"GET /nothing HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\nGET / HTTP/1.1\r\n",
    "a body": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 10\r\n\r\n12",
    "a body in parts": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\n5\r\n12",
    "half a handshake": b"GET /live HTTP/1.1\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n",
}


async def read_body(request: Request) -> Response:
    try:
        return Response(await request.body())
    except ClientDisconnect:
        return Response(status_code=400)


def posting(server: LiveServer, more: str) -> bytes:
    here = f"127.0.0.1:{server.port}"
    return f"POST /read HTTP/1.1\r\nHost: {here}\r\nOrigin: http://{here}\r\n{more}".encode()


@contextmanager
def hurried(monkeypatch: pytest.MonkeyPatch) -> Iterator[LiveServer]:
    """A server that waits shortly, and reads bodies."""
    monkeypatch.setattr(guard, "HEAD_S", 1.0)
    monkeypatch.setattr(guard, "BODY_S", 1.0)
    with LiveServer(View(), routes=[Route("/read", read_body, methods=["POST"])]) as server:
        yield server


def test_requests_that_never_end_are_let_go(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    with hurried(monkeypatch) as server, watching(server) as client, contextlib.ExitStack() as stack:
        parts = (
            *UNFINISHED.values(),
            posting(server, "Content-Length: 10\r\n\r\n12"),
            posting(server, "Transfer-Encoding: chunked\r\n\r\n5\r\n12"),
        )
        open_ = [stack.enter_context(socket.create_connection(("127.0.0.1", server.port))) for _ in parts]
        for connection, part in zip(open_, parts, strict=True):
            connection.sendall(part)
        for connection in open_:
            until_closed(connection)
        beat(client)
        beat(client)  # Who is let in stays
        assert ask(server, "/")[0].status == 200
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("begin", ["X: ", "Content-Length: 999999\r\n\r\n"], ids=["headers", "a body"])
def test_a_request_that_comes_a_byte_at_a_time_gets_no_more_time(
    begin: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with hurried(monkeypatch) as server, socket.create_connection(("127.0.0.1", server.port)) as connection:
        connection.sendall(posting(server, begin))
        end_s = time.monotonic() + LONG_S
        with pytest.raises(OSError):
            while time.monotonic() < end_s:
                connection.sendall(b"x")
                time.sleep(0.02)


def test_requests_one_after_the_other_each_have_their_time(monkeypatch: pytest.MonkeyPatch) -> None:
    with hurried(monkeypatch) as server:
        here = f"127.0.0.1:{server.port}"
        connection = http.client.HTTPConnection(here, timeout=LONG_S)
        connection.connect()
        same = connection.sock
        began_s = time.monotonic()
        while time.monotonic() < began_s + 2.5:
            connection.request("POST", "/read", b"ok", {"Origin": f"http://{here}"})
            assert connection.getresponse().read() == b"ok" and connection.sock is same
            time.sleep(0.05)
        connection.close()


@pytest.mark.parametrize("kind", ["nothing", "headers", "half a handshake"])
def test_half_open_connections_do_not_keep_others_out(kind: str) -> None:
    with LiveServer(View()) as server, contextlib.ExitStack() as stack:
        for _ in range(270):
            one = stack.enter_context(socket.create_connection(("127.0.0.1", server.port)))
            with contextlib.suppress(OSError):  # Let go already
                one.sendall(UNFINISHED[kind])
        assert ask(server, "/")[0].status == 200
        with watching(server) as client:
            client.recv(timeout=10)


def test_a_request_that_is_too_large_ends_the_connection() -> None:
    orders = Taking()
    with LiveServer(View(), orders=orders) as server, watching(server) as client:
        client.recv(timeout=10)
        client.send('{"answer":"' + "y" * 10_000 + '"}')
        with pytest.raises(ConnectionClosed) as closed:
            news(client)
        assert closed.value.rcvd is not None and closed.value.rcvd.code == 1009
    assert orders.taken == []


def test_other_sites_cannot_open_the_stream() -> None:
    with LiveServer(View()) as server:
        for origin in (None, "null", "http://evil.example", "http://127.0.0.1", "https://127.0.0.1.evil"):
            with pytest.raises(InvalidStatus) as refused, watching(server, origin=origin):
                pass
            assert refused.value.response.status_code == 403, origin
            if origin is not None:
                assert ask(server, "/", origin=origin)[0].status == 403


def test_other_names_do_not_lead_here() -> None:
    names = "evil.example", "evil.example:80", "localhost.evil.example", "", "[::1", "a b", "127.0.0.1:99999"
    with LiveServer(View()) as server:
        for name in names:
            assert ask(server, "/", host=name)[0].status in (400, 421), name
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


NO_FILES = (
    "/../server.py /..%2fserver.py /static/../view.py //etc/passwd /%2e%2e/view.py /live.js/../view.py"
    " /sources.sha256 /page/src/schema.ts /tiles/../../view.py /tiles/-1/0/0 /tiles/1/2/x /\\..\\view.py"
)


def test_only_files_of_the_page_are_served() -> None:
    with LiveServer(View()) as server:
        for path in NO_FILES.split():
            assert ask(server, path)[0].status == 404, path


def test_files_are_asked_for_again_only_when_they_changed() -> None:
    with LiveServer(View()) as server:
        response, body = ask(server, "/live.js")
        assert response.getheader("Content-Type", "").startswith("text/javascript") and len(body) > 1000
        response, body = ask(server, "/live.js", if_none_match=response.getheader("ETag", ""))
        assert response.status == 304 and body == b""


def test_elsewhere_than_on_this_machine_a_token_is_needed() -> None:
    view = View()
    view.take(events.Noted("secret"))
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
