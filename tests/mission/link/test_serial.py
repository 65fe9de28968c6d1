"""Serial lines over a pseudo terminal, and TCP connections that come back."""

import contextlib
import os
import pty
import socket
import sys
import time
import tty

import pytest
from processes import wait_until

from mission.errors import LinkError
from mission.link import MavlinkEndpoint, open_link, parse_link_url
from mission.link.codec.dialect import mavlink
from mission.link.opening import SerialClientLink


@pytest.fixture
def line():
    """A pseudo terminal: our side's descriptor, the other side's device."""
    near, far = pty.openpty()
    tty.setraw(near), tty.setraw(far)
    yield near, os.ttyname(far)
    os.close(near), os.close(far)


def test_messages_cross_a_serial_line_both_ways(line):
    near, device = line
    endpoint = MavlinkEndpoint(open_link(f"serial:{device}:115200"), 255, 190)
    other = mavlink.MAVLink(None, 1, 1)
    endpoint.send(mavlink.MAVLink_mission_request_list_message(1, 1))
    data = wait_until(lambda: os.read(near, 4096))
    assert other.parse_buffer(data)[0].get_type() == "MISSION_REQUEST_LIST"
    frame = mavlink.MAVLink_mission_count_message(255, 190, 7).pack(other)
    os.write(near, b"noise" + frame[:5])
    os.write(near, frame[5:])
    assert wait_until(endpoint.receive)[0].count == 7
    assert endpoint.link.fileno() is not None
    endpoint.close()
    assert endpoint.link.fileno() is None


def test_a_device_that_comes_back_is_opened_again(tmp_path):
    """Behind the same name is another device then."""
    device, now_s = tmp_path / "radio", [0.0]
    near, far = pty.openpty()
    tty.setraw(near), tty.setraw(far)
    device.symlink_to(os.ttyname(far))
    link = SerialClientLink(parse_link_url(f"serial:{device}:57600"), clock=lambda: now_s[0])
    os.write(near, b"one")
    assert wait_until(link.receive) == [b"one"]
    os.close(near), os.close(far)
    device.unlink()
    wait_until(lambda: link.receive() == [] and link.fileno() is None)
    link.send(b"lost")
    near, far = pty.openpty()
    tty.setraw(near), tty.setraw(far)
    device.symlink_to(os.ttyname(far))
    assert link.receive() == []
    assert link.connections == 1, "it is tried once a second"
    now_s[0] = 2.0
    link.send(b"two")
    assert link.connections == 2
    assert wait_until(lambda: os.read(near, 100)) == b"two"
    link.close()
    assert link.receive() == []
    assert link.fileno() is None
    os.close(near), os.close(far)


def test_a_line_that_takes_nothing_drops_frames_and_does_not_block(line):
    _, device = line
    link = open_link(f"serial:{device}:57600")
    for _ in range(3000):
        link.send(bytes(100))
    assert link.dropped > 0
    link.close()


def test_serial_addresses_are_read():
    assert str(parse_link_url("serial:///dev/ttyUSB0:9600")) == "serial:/dev/ttyUSB0:9600"
    by_id = "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0"
    assert parse_link_url(f"serial:{by_id}:115200").host == by_id


@pytest.mark.parametrize(
    ("device", "why"),
    [
        ("/dev/Does-Not-Exist", "no device has that name; check the name, and that the device is plugged in"),
        ("/dev/null", "this is not a serial device; check the name"),
        ("/", "is a directory; check its name"),
    ],
)
def test_why_a_device_cannot_be_opened(device, why):
    with pytest.raises(LinkError) as error:
        open_link(f"serial:{device}:57600")
    assert str(error.value) == f"serial:{device}:57600: the device cannot be opened: {why}"


def test_a_device_that_another_program_uses(line):
    url = f"serial:{line[1]}:57600"
    with contextlib.closing(open_link(url)), pytest.raises(LinkError, match="another program uses"):
        open_link(url)


def test_without_pyserial_the_error_says_what_to_install(monkeypatch, line):
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(LinkError, match=r'need serial; install it with: pip install "wbf-mission\[serial\]"'):
        open_link(f"serial:{line[1]}:57600")


def test_a_lost_tcp_connection_is_made_again(monkeypatch):
    listener = socket.create_server(("127.0.0.1", 0))
    port = listener.getsockname()[1]
    now = [0.0]
    from mission.link.opening import TcpClientLink

    link = TcpClientLink(parse_link_url(f"tcp:127.0.0.1:{port}"), clock=lambda: now[0])
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: pytest.fail("asking may take seconds"))
    first, _ = listener.accept()
    first.close()
    listener.close()
    wait_until(lambda: (link.receive(), not link.connected)[1])
    link.send(b"lost")
    assert link.fileno() is None
    for _ in range(5):  # nobody listens: tried each second, never raised
        now[0] += 1.1
        assert link.receive() == []
        time.sleep(0.01)
    listener = socket.create_server(("127.0.0.1", port))
    now[0] += 10.0

    def back():
        now[0] += 0.6
        link.receive()
        return link.connected

    wait_until(back)
    second, _ = listener.accept()
    link.send(b"again")
    second.settimeout(3.0)
    assert second.recv(100) == b"again"
    second.send(b"hello")
    assert wait_until(link.receive) == [b"hello"]
    assert link.connections == 2
    link.close()
    assert link.receive() == []
    second.close(), listener.close()
