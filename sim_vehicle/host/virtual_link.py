"""A link on the virtual clock: ground software that blocks, without any real time passing."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from mission.errors import LinkError
from mission.link.codec.frames import FrameReader

if TYPE_CHECKING:
    from mission.link.address import Link

__all__ = ["VirtualLink"]


class VirtualLink:
    """A `mission.link.Link` on a clock of its own; made by `Simulation.open_link`.

    Whoever takes a clock and a way to wait (as `mission.transfer.driver.TransferDriver` does) runs on the
    virtual clock with it: waiting lets the clock go on until something arrives or the time is up.

    Parameters
    ----------
    name : str
        For messages.
    clock : callable
        Gives the virtual time in seconds.
    send_frame : callable
        Takes each whole frame that is sent.
    pass_time : callable
        ``pass_time(seconds, until)`` lets so much time pass, or less where ``until()`` holds earlier.

    Examples
    --------
    >>> from mission.model import GeoPoint
    >>> from sim_vehicle.host.simulation import Simulation
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> from sim_vehicle.mavlink import SimVehicle
    >>> simulation = Simulation([SimVehicle(get_vehicle("quad"), GeoPoint(28.05, -82.15))])
    >>> link = simulation.open_link()
    >>> link.sleep(3600.0)
    >>> link.clock(), len(link.receive()) > 3600
    (3600.0, True)
    """

    def __init__(
        self,
        name: str,
        clock: Callable[[], float],
        send_frame: Callable[[bytes], None],
        pass_time: Callable[[float, Callable[[], bool] | None], None],
    ) -> None:
        self.name = name
        self.clock = clock
        self._send_frame = send_frame
        self._pass_time = pass_time
        self._arrived: list[bytes] = []
        self._frames: list[bytes] = []
        self._reader = FrameReader(wanted=(), tap=self._frames.append)
        self._open = True

    def send(self, data: bytes) -> None:
        """Send bytes; frames are routed as they become whole, whatever is none is dropped."""
        if not self._open:
            msg = f"{self.name}: the link is closed"
            raise LinkError(msg)
        self._reader.feed(data)
        frames = self._frames[:]
        self._frames.clear()
        for frame in frames:
            self._send_frame(frame)

    def receive(self) -> list[bytes]:
        """Frames that have arrived; no time passes."""
        arrived = self._arrived[:]
        self._arrived.clear()
        return arrived

    def deliver(self, frame: bytes) -> None:
        """Take a frame that arrives; for the host."""
        if self._open:
            self._arrived.append(frame)

    def wait(self, link: Link, seconds: float) -> None:  # noqa: ARG002
        """Let time pass until something has arrived, at most so long; as ``TransferDriver`` calls it."""
        if not self._arrived:
            self._pass_time(max(0.0, seconds), lambda: bool(self._arrived))

    def sleep(self, seconds: float) -> None:
        """Let so much time pass."""
        self._pass_time(max(0.0, seconds), None)

    def close(self) -> None:
        """Hear and send nothing more."""
        self._open = False

    def fileno(self) -> int | None:
        """Return None: there is nothing to wait on but `wait`."""
        return None
