"""Links over real loopback sockets, their addresses, their errors."""

from __future__ import annotations

import contextlib
import select
import socket
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from processes import wait_until

from mission.errors import LinkError
from mission.link import LinkAddress, MavlinkEndpoint, memory_pair, open_link, parse_link_url
from mission.link.codec.dialect import mavlink
from mission.link.sockets import Stream, TcpListener


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("udp:127.0.0.1:14550", ("udpin", "127.0.0.1", 14550)),
        ("udpin://:14540", ("udpin", "127.0.0.1", 14540)),
        ("UDPOUT:host.example:1/", ("udpout", "host.example", 1)),
        ("tcp://localhost:5760", ("tcp", "localhost", 5760)),
        ("tcpout:localhost:5760", ("tcp", "localhost", 5760)),
        ("tcpin:[::1]:0", ("tcpin", "::1", 0)),
    ],
)
def test_addresses(url, address):
    assert parse_link_url(url) == LinkAddress(*address)
    assert parse_link_url(str(parse_link_url(url))) == parse_link_url(url)


@pytest.mark.parametrize(
    "url",
    [
        "",
        "udpin:14550",
        "udpin:host:port",
        "tcp:host:0",
        "udpin:host:65536",
        "udpin:::1:5",
        "udpin:a b:5",
        "serial:/dev/ttyUSB0:slow",
    ],
)
def test_bad_addresses_are_one_clear_line(url):
    with pytest.raises(LinkError) as caught:
        parse_link_url(url)
    assert "\n" not in str(caught.value)


@given(st.text(max_size=40))
def test_any_text_parses_or_is_a_link_error(url):
    try:
        address = parse_link_url(url)
    except LinkError:
        return
    assert 0 <= address.port <= 65535


def test_errors_say_what_to_do():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(LinkError, match=r"in use.*another port"):
            open_link(f"tcpin:127.0.0.1:{port}")
    with pytest.raises(LinkError, match="refused; start the vehicle"):
        open_link(f"tcp:127.0.0.1:{port}")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        with pytest.raises(LinkError, match="in use"):
            open_link(f"udpin:127.0.0.1:{taken.getsockname()[1]}")
    with pytest.raises(LinkError, match="cannot be resolved"):
        open_link("udpout:no-such-host.invalid:14550")
    with pytest.raises(LinkError, match="not an address of this machine"):
        open_link("udpin:203.0.113.7:14550")


def exchange(server, client):
    ground, vehicle = MavlinkEndpoint(client, 255, 190), MavlinkEndpoint(server, 1, 1)
    vehicle.send(mavlink.MAVLink_mission_current_message(0))  # nobody has called yet: dropped, no error
    for number in range(1, 301):
        ground.send(mavlink.MAVLink_mission_current_message(number))
    got = []
    wait_until(lambda: got.extend(vehicle.receive()) or len(got) >= 300)
    assert [message.seq for message in got] == list(range(1, 301))
    vehicle.send(mavlink.MAVLink_mission_current_message(7))
    assert wait_until(ground.receive)[-1].seq == 7
    assert [source.lost for source in vehicle.reader.sources.values()] == [0]
    for end in (ground, vehicle, ground):
        end.close()
    assert server.fileno() is None
    assert client.fileno() is None


def test_tcp_both_ways():
    server = open_link("tcpin:127.0.0.1:0")
    exchange(server, open_link(server.name.replace("tcpin", "tcp")))


def test_udp_to_nobody_is_no_error():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    link = open_link(f"udpout:127.0.0.1:{port}")
    for _ in range(5):
        link.send(b"hello")
        time.sleep(0.002)
        assert link.receive() == []
    link.close()


def test_tcp_keeps_what_the_network_does_not_take():
    listener = TcpListener(LinkAddress("tcpin", "127.0.0.1", 0))
    client = open_link(listener.name.replace("tcpin", "tcp"))
    (peer,) = wait_until(listener.accept)
    block = bytes(range(256)) * 16
    for _ in range(3000):
        client.send(block)
    assert client.dropped > 0
    got = bytearray()

    def drain():
        client.receive()
        for piece in peer.receive():
            got.extend(piece)
        return len(got) >= (3000 - client.dropped) * len(block)

    wait_until(drain)
    assert bytes(got) == block * (3000 - client.dropped)
    for link in (client, peer, listener):
        link.close()


def test_a_frame_that_has_waited_for_seconds_is_not_sent_any_more(monkeypatch):
    now, room, written = [0.0], [3], bytearray()

    class Line(Stream):
        def _write(self, data):
            if not room[0]:
                raise BlockingIOError
            taken, room[0] = min(room[0], len(data)), 0
            written.extend(data[:taken])
            return taken

        def _gone(self):
            raise AssertionError

    monkeypatch.setattr("mission.link.sockets.steady_s", lambda: now[0])
    line = Line("line", 16)
    for frame in (b"begun", b"old", b"old, too"):
        line.send(frame)
    now[0] = 2.0
    line.send(b"young")
    assert (bytes(written), line.dropped) == (b"beg", 1), "there is no room for it"
    now[0] = 4.0
    for _ in range(3):
        room[0] = 4
        line.send(b"new")
    assert (bytes(written), line.dropped) == (b"begunnewnew", 3)
    room[0] = 4
    line.send(b"n")
    line.send(bytes(15))
    assert (bytes(written), line.dropped) == (b"begunnewnewnew", 3), "dropped bytes leave room"


def test_a_closed_memory_link_refuses_to_send():
    one, other = memory_pair()
    one.send(b"x")
    one.close()
    with pytest.raises(LinkError, match="closed"):
        one.send(b"y")
    assert other.receive() == [b"x"]
    assert one.fileno() is None


@pytest.mark.parametrize("scheme", ["udpin", "udpout"])
def test_a_loop_that_stands_still_loses_no_datagram(scheme, monkeypatch):
    """Far more than the system keeps come while nobody receives."""
    monkeypatch.setattr("mission.link.sockets._BUFFER_BYTES", 106_496)  # As where Linux allows no more
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.bind(("127.0.0.1", 0))
    near = ("127.0.0.1", 0) if scheme == "udpin" else sender.getsockname()
    link = open_link(f"{scheme}:{near[0]}:{near[1]}")
    with contextlib.closing(link), sender:
        there = link._socket.getsockname()
        for number in range(1000):
            sender.sendto(number.to_bytes(4, "big") * 10, there)
            if number % 50 == 0:  # As fast as a thread can read, not as fast as the loopback device
                wait_until(lambda: not select.select([link._socket], [], [], 0.0)[0])
        came = []
        while select.select([link.fileno()], [], [], 0.3)[0]:
            came += [int.from_bytes(data[:4], "big") for data in link.receive()]
        assert came == list(range(1000)), "all, in their order; the descriptor shows what is kept"
        assert not link.dropped


def test_what_a_link_keeps_is_bounded_and_what_it_drops_is_counted(monkeypatch):
    monkeypatch.setattr("mission.link.sockets._MOST_BYTES", 10_000)
    with contextlib.closing(open_link("udpin:127.0.0.1:0")) as link:
        sender = open_link(link.name.replace("udpin", "udpout"))
        for number in range(100):
            sender.send(bytes([number]) * 744)
        name = "{}:{}".format(*sender._socket.getsockname())
        wait_until(lambda: link.dropped == {name: 90})
        assert [data[0] for data in link.receive()] == list(range(10))
        assert not select.select([link.fileno()], [], [], 0.0)[0], "nothing is kept any more"
        sender.send(b"again")
        assert select.select([link.fileno()], [], [], 30.0)[0]
        assert link.receive() == [b"again"]
        sender.close()
