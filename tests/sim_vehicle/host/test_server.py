"""The wall-clock host: real sockets, several clients, bad clients."""

import socket
import threading
import time
from pathlib import Path

import pytest
from processes import wait_until

from mission.errors import LinkError
from mission.link.codec.dialect import mavlink
from sim_vehicle.component import NEVER
from sim_vehicle.errors import VehicleError
from sim_vehicle.host.server import Server
from sim_vehicle.host.simulation import StopReason
from tests.support.peer import running


class Echo:
    """Sends a heartbeat each period, answers PING."""

    def __init__(self, system=1, component=1, period_s=0.1):
        self.system_id, self.component_id, self.wanted = system, component, frozenset({4, 0})
        self.period_s, self.due_s = period_s, 0.0 if period_s else NEVER
        self.polls, self.heard = [], []

    def receive(self, message, now_s):
        self.heard.append((message.get_type(), message.get_srcSystem()))
        if message.get_type() != "PING":
            return []
        return [
            mavlink.MAVLink_ping_message(
                message.time_usec, message.seq, message.get_srcSystem(), message.get_srcComponent()
            )
        ]

    def poll(self, now_s):
        self.polls.append(now_s)
        self.due_s += self.period_s
        return [mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3)]

    def next_deadline(self):
        return self.due_s


def port_of(url):
    return int(url.rsplit(":", 1)[1])


def client(url, system=255, kind=socket.SOCK_STREAM):
    """A socket to the server and the codec of its owner."""
    connection = socket.socket(socket.AF_INET, kind)
    connection.settimeout(3.0)
    connection.connect(("127.0.0.1", port_of(url)))
    return connection, mavlink.MAVLink(None, system, 190)


def ping(codec, seq=7):
    frame = mavlink.MAVLink_ping_message(123, seq, 0, 0).pack(codec)
    codec.seq = (codec.seq + 1) % 256
    return frame


def wait_for(connection, codec, kind, condition=lambda message: True, limit_s=30.0):
    end_s = time.monotonic() + limit_s
    while time.monotonic() < end_s:
        for message in codec.parse_buffer(connection.recv(4096)) or []:
            if message.get_type() == kind and condition(message):
                return message
    pytest.fail(f"no {kind} came")


def test_tcp_and_udp_clients_are_served_at_once():
    with running(Server([Echo()], ["tcpin:127.0.0.1:0", "udpin:127.0.0.1:0"])) as server:
        sockets = [client(server.urls[0], 255), client(server.urls[0], 254)]
        sockets += [
            client(server.urls[1], 253, socket.SOCK_DGRAM),
            client(server.urls[1], 252, socket.SOCK_DGRAM),
        ]
        for connection, codec in sockets:
            connection.send(ping(codec))
        for connection, codec in sockets:
            answer = wait_for(connection, codec, "PING", lambda p: p.target_system)
            assert (answer.target_system, answer.seq) == (codec.srcSystem, 7)
            wait_for(connection, codec, "HEARTBEAT", lambda h: h.get_srcSystem() == 1)
        assert len(server.clients) == 4
        for connection, _ in sockets:
            connection.close()


def test_garbage_and_vanishing_clients_do_no_harm():
    with running(Server([Echo()], ["tcpin:127.0.0.1:0", "udpin:127.0.0.1:0"])) as server:
        noise = bytes(range(256)) * 40
        good, codec = client(server.urls[0])
        for _ in range(5):
            bad, _ = client(server.urls[0])
            bad.send(noise)
            bad.close()
            loud, _ = client(server.urls[1], kind=socket.SOCK_DGRAM)
            loud.send(noise[:1000])
            loud.close()
        good.send(noise + ping(codec)[:5])
        good.send(b"\xfd" * 50)
        for seq in range(40):
            good.send(ping(codec, seq))
        wait_for(good, codec, "PING", lambda p: p.seq > 30)
        assert all("from" in name for name in server.clients), "noise alone makes no UDP client"
        good.close()
        wait_until(lambda: not server.clients)


def test_a_client_that_does_not_read_does_not_stop_the_others():
    with running(Server([Echo(period_s=0.001)], ["tcpin:127.0.0.1:0"], speed=5.0)) as server:
        lazy, _ = client(server.urls[0])
        keen, codec = client(server.urls[0])
        keen.send(ping(codec))
        wait_for(keen, codec, "PING")
        time.sleep(0.3)
        keen.send(ping(codec, 9))
        wait_for(keen, codec, "PING", lambda p: p.seq == 9)
        lazy.close(), keen.close()


def test_time_runs_at_the_given_speed_without_gaps():
    echo, speed = Echo(), 20.0
    started = time.monotonic()
    with Server([echo], [], speed=speed) as server:
        assert server.run(limit_s=0.3 * speed) is StopReason.TIME_LIMIT
        assert server.now_s == pytest.approx(0.3 * speed)
    assert time.monotonic() - started > 0.25, "never ahead of the wall clock"
    steps = [b - a for a, b in zip(echo.polls, echo.polls[1:], strict=False)]
    assert all(step == pytest.approx(0.1) for step in steps)


def test_time_is_stretched_when_the_machine_is_too_slow():
    class Slow(Echo):
        def poll(self, now_s):
            time.sleep(0.01)
            return super().poll(now_s)

    slow = Slow()
    with Server([slow], [], speed=1000.0) as server:
        assert server.run(lambda now_s: len(slow.polls) >= 10, limit_s=100.0) is StopReason.FINISHED
    assert slow.polls == pytest.approx([0.1 * i for i in range(len(slow.polls))])


@pytest.mark.parametrize("url", ["nonsense", "udpin:127.0.0.1:99999", "tcp:127.0.0.1:1"])
def test_bad_addresses_are_refused_in_one_line(url):
    with pytest.raises(LinkError) as error:
        Server([Echo()], ["udpin:127.0.0.1:0", url])
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "url", ["udpin:127.0.0.1:0,5", "udpout:127.0.0.1:14550,x", "udpout:127.0.0.1:14550,70000"]
)
def test_bad_local_ports_are_refused(url):
    with pytest.raises(VehicleError, match="local port"):
        Server([], [url])


def test_a_port_in_use_is_refused_and_everything_closed():
    with Server([], ["tcpin:127.0.0.1:0"]) as server, pytest.raises(LinkError, match="in use"):
        Server([], ["udpin:127.0.0.1:0", server.urls[0]])


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan")])
def test_impossible_speeds_are_refused(speed):
    with pytest.raises(VehicleError, match="speed"):
        Server([], [], speed=speed)


def test_two_components_with_one_address_are_refused():
    with pytest.raises(VehicleError, match="share an address"):
        Server([Echo(), Echo()], [])


def test_a_port_serves_64_peers_at_most_and_again_when_one_has_gone():
    with running(Server([Echo(period_s=0.02)], ["tcpin:127.0.0.1:0"])) as server:
        peers = [client(server.urls[0])[0] for _ in range(64)]
        for peer in peers:
            assert peer.recv(100)
        refused = client(server.urls[0])[0]
        assert refused.recv(100) == b"", "closed"
        assert len(server.clients) == 64
        peers.pop().close()
        wait_until(lambda: len(server.clients) <= 63)
        peers.append(client(server.urls[0])[0])
        assert peers[-1].recv(100)
        for peer in (*peers, refused):
            peer.close()


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="counts descriptors as Linux shows them")
def test_a_port_takes_one_descriptor_and_no_thread():
    def open_ones():
        return len(list(Path("/proc/self/fd").iterdir())), threading.active_count()

    files, threads = open_ones()
    with Server([], ["udpin:127.0.0.1:0"] * 50):
        more_files, more_threads = open_ones()
    assert (more_files - files <= 60, more_threads) == (True, threads)


def test_datagrams_that_it_could_not_keep_are_counted(monkeypatch):
    monkeypatch.setattr("mission.link.sockets._MOST_BYTES", 1000)
    with Server([], ["udpin:127.0.0.1:0"], at_once=True) as server:
        host, port = server.urls[0].split(":")[1:]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for _ in range(10):
                sender.sendto(bytes(244), (host, int(port)))
            name = f"127.0.0.1:{sender.getsockname()[1]}"
        wait_until(lambda: server.dropped.total() >= 8)
        assert server.dropped == {name: 8}
