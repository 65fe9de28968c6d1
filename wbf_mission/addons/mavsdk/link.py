"""A link opened by MAVSDK, which forwards messages between the vehicle and this program."""

from __future__ import annotations

import contextlib
import socket
import time
from collections import deque
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any

from mavsdk import Configuration, ConnectionResult, ForwardingOption, Mavsdk, System
from mavsdk.logging import LogLevel, log_subscribe, log_unsubscribe

from mission.errors import LinkError
from mission.link.address import SERIAL, LinkAddress, parse_link_url
from mission.transfer.events import NoVehicleError
from mission.transfer.wire import GROUND_STATION

__all__ = ["Call", "MavsdkLink", "mavsdk_url"]

_SCHEMES = {"udpin": "udpin", "udpout": "udpout", "tcp": "tcpout", "tcpin": "tcpin", SERIAL: "serial"}
_WIRELESS = "raw://"
_MOST_PIECES = 100_000
_KNOWN_S = 2.0
_LOOK_S = 0.01


def mavsdk_url(address: LinkAddress) -> str:
    """Return a link address in MAVSDK's syntax.

    Examples
    --------
    >>> mavsdk_url(parse_link_url("tcp:127.0.0.1:5760")), mavsdk_url(parse_link_url("serial:/dev/ttyACM0"))
    ('tcpout://127.0.0.1:5760', 'serial:///dev/ttyACM0:57600')
    """
    return f"{_SCHEMES[address.scheme]}://{address.host}:{address.port}"


class MavsdkLink:
    """MAVSDK as a `mission.link.address.Link`.

    MAVSDK has two connections, one to the vehicle and one to this program, and forwards between them. Bytes
    from the vehicle are returned by `receive`, and bytes given to `send` go to the vehicle. MAVSDK is the
    ground station on the link: it sends the heartbeat, and does not forward answers to its commands and
    transfers.

    Raises LinkError if the address is wrong or MAVSDK cannot open it.
    """

    def __init__(self, url: str) -> None:
        address = parse_link_url(url)
        self.name = str(address)
        self._arrived: deque[bytes] = deque(maxlen=_MOST_PIECES)
        self._complaint = ""
        self._plugins: dict[tuple[type, int], Any] = {}
        self._systems: dict[int, System] = {}
        self._wake, self._woken = socket.socketpair()
        self._wake.setblocking(False)
        self._woken.setblocking(False)
        self._closed = False
        log_subscribe(self._on_log)
        self._mavsdk = Mavsdk(Configuration.create_manual(*GROUND_STATION, True))
        try:
            self._mavsdk.subscribe_raw_bytes_to_be_sent(self._on_bytes)
            for connection in (_WIRELESS, mavsdk_url(address)):
                self._connect(connection)
        except BaseException:
            self.close()
            raise

    def _connect(self, url: str) -> None:
        result = self._mavsdk.add_any_connection_with_forwarding(url, ForwardingOption.ON)
        if result != ConnectionResult.SUCCESS:
            why = self._complaint or ConnectionResult(result).name.lower().replace("_", " ")
            msg = f"{self.name}: MAVSDK cannot open it: {why}; check the address"
            raise LinkError(msg)

    def _on_log(self, level: LogLevel, text: str, _file: str | None, _line: int) -> bool:
        """Keep MAVSDK's log off the terminal; the log's last error says why a connection cannot be opened."""
        if level is LogLevel.ERROR:
            self._complaint = text
        return True

    def _on_bytes(self, data: bytes) -> None:
        """Queue a frame; MAVSDK calls this in its own thread."""
        self._arrived.append(data)
        with contextlib.suppress(OSError):
            self._wake.send(b"\0")

    def send(self, data: bytes) -> None:
        """Send frames to the vehicle."""
        if not self._closed:
            self._mavsdk.pass_received_raw_bytes(data)

    def receive(self) -> list[bytes]:
        """Return the frames received since the last call."""
        with contextlib.suppress(OSError):
            self._woken.recv(65536)
        found: list[bytes] = []
        with contextlib.suppress(IndexError):
            while True:
                found.append(self._arrived.popleft())
        return found

    def fileno(self) -> int | None:
        """Return a file descriptor that is readable when frames have arrived."""
        return None if self._closed else self._woken.fileno()

    def plugin(self, kind: type, system_id: int) -> Any:
        """Return MAVSDK's plugin for a vehicle; raise NoVehicleError if MAVSDK does not know the vehicle."""
        key = (kind, system_id)
        if key not in self._plugins:
            self._plugins[key] = kind(self._system(system_id))
        return self._plugins[key]

    def _system(self, system_id: int) -> System:
        """Return a vehicle, waiting until MAVSDK has connected to it.

        Before it is connected, MAVSDK does not know the autopilot, and would not answer an ArduPilot.
        """
        if system_id in self._systems:
            return self._systems[system_id]
        end_s = time.monotonic() + _KNOWN_S
        while time.monotonic() < end_s:
            for system in self._mavsdk.get_systems():
                if system.get_system_id() == system_id and system.has_autopilot() and system.is_connected():
                    self._systems[system_id] = system
                    return system
            time.sleep(_LOOK_S)
        msg = f"{self.name}: MAVSDK knows of no vehicle with system id {system_id}"
        raise NoVehicleError(msg)

    def close(self) -> None:
        """Stop MAVSDK and its threads; a second call does nothing."""
        if self._closed:
            return
        self._closed = True
        self._mavsdk.destroy()
        log_unsubscribe()
        self._plugins.clear()
        self._systems.clear()
        self._wake.close()
        self._woken.close()


class Call:
    """A call of one of MAVSDK's ``..._async`` functions, answered in another thread."""

    def __init__(self, begin: Callable[..., None], *arguments: Any) -> None:
        self._answers: SimpleQueue[tuple[Any, ...]] = SimpleQueue()
        begin(*arguments, self._on_answer)

    def _on_answer(self, *answer: Any) -> None:
        # The last argument is MAVSDK's unused user data.
        self._answers.put(answer[:-1])

    def answer(self) -> tuple[Any, ...] | None:
        """Return MAVSDK's answer, with the result first; None while pending."""
        try:
            return self._answers.get_nowait()
        except Empty:
            return None
