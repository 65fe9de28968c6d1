"""The server's ports: a TCP host that goes and comes back, a serial line, faults at real sockets."""

import os
import pty
import socket
import time
import tty

import pytest
from processes import wait_until

from mission.errors import LinkError
from mission.link.codec.dialect import mavlink
from mission.model import GeoPoint
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.host.ports import open_port
from sim_vehicle.host.server import Server
from sim_vehicle.mavlink import SimVehicle
from tests.support.peer import running

HOME = GeoPoint(28.05, -82.15, 20.0)


def serving(url, **options):
    """A vehicle served in its own thread."""
    return running(Server([SimVehicle(get_vehicle("quad"), HOME)], [url], **options))


def heard(connection, *wanted, seconds=30.0):
    """The message names that come out of a socket until those wanted are among them, or time is up."""
    codec, names, end = mavlink.MAVLink(None), [], time.monotonic() + seconds
    codec.robust_parsing = True
    connection.settimeout(0.1)
    while time.monotonic() < end and not (wanted and set(wanted) <= set(names)):
        try:
            data = connection.recv(65536)
        except TimeoutError:
            continue
        names += [message.get_type() for message in codec.parse_buffer(data) or []]
    return names


def ping(connection):
    connection.send(mavlink.MAVLink_ping_message(1, 9, 0, 0).pack(mavlink.MAVLink(None, 255, 190)))


def test_a_tcp_host_that_goes_away_is_called_again():
    listener = socket.create_server(("127.0.0.1", 0))
    port = listener.getsockname()[1]
    with serving(f"tcp:127.0.0.1:{port}") as server:
        first, _ = listener.accept()
        assert "ATTITUDE" in heard(first, "ATTITUDE")
        listener.close(), first.close()
        time.sleep(0.3)
        assert len(server.clients) == 1
        again = socket.create_server(("127.0.0.1", port))
        again.settimeout(30.0)
        second, _ = again.accept()
        assert "ATTITUDE" in heard(second, "ATTITUDE")
        ping(second)
        assert "PING" in heard(second, "PING")
        second.close(), again.close()


def test_a_serial_line_has_a_vehicle_at_its_end():
    near, far = pty.openpty()
    tty.setraw(near), tty.setraw(far)
    codec = mavlink.MAVLink(None, 255, 190)
    codec.robust_parsing = True
    with serving(f"serial:{os.ttyname(far)}:115200"):
        os.write(near, mavlink.MAVLink_ping_message(1, 9, 0, 0).pack(codec))
        names, end = [], time.monotonic() + 30.0
        while "PING" not in names and time.monotonic() < end:
            names += [message.get_type() for message in codec.parse_buffer(os.read(near, 4096)) or []]
    os.close(near), os.close(far)
    assert {"HEARTBEAT", "PING"} <= set(names)


def test_faults_at_a_socket():
    faults = ["link-loss,direction=down,from=20", "delay=0.5", "corrupt=0.2", "drop=ATTITUDE"]
    with serving("tcpin:127.0.0.1:0", faults=faults, speed=20.0) as server:
        connection = socket.create_connection(("127.0.0.1", int(server.urls[0].rsplit(":", 1)[1])))
        names = heard(connection, "GLOBAL_POSITION_INT", "BAD_DATA")
        assert "GLOBAL_POSITION_INT" in names and "BAD_DATA" in names
        wait_until(lambda: server.now_s > 22.0, "the fault")
        names += heard(connection, seconds=0.5)
        assert "ATTITUDE" not in names
        assert heard(connection, seconds=0.3) == []
        connection.close()


@pytest.mark.parametrize("url", ["udpout:no.such.host.invalid:14550", "serial:/dev/none", "tcp:127.0.0.1:1"])
def test_doors_that_do_not_open_say_why(url):
    with pytest.raises(LinkError) as caught:
        open_port(url)
    assert "\n" not in str(caught.value)
