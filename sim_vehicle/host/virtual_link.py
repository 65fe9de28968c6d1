"""A link on the virtual clock: ground software that blocks, without any real time passing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mission.errors import LinkError
from mission.link.codec.frames import FrameReader

if TYPE_CHECKING:
    from mission.link.link import Link
    from sim_vehicle.host.simulation import Simulation

__all__ = ["VirtualLink"]

_NEVER = float("inf")


class VirtualLink:
    """A `mission.link.Link` into a `Simulation`; made by `Simulation.open_link`.

    Whoever takes a clock and a way to wait (as `mission.transfer.driver.TransferDriver` does) runs on the
    virtual clock with it: waiting lets the simulation go on until something arrives or the time is up.

    Parameters
    ----------
    name : str
        For messages.
    simulation : Simulation
        Where it leads.
    port : int
        Its number there.

    Examples
    --------
    >>> from mission.model import GeoPoint
    >>> from sim_vehicle.host.simulation import Simulation
    >>> from sim_vehicle.airframe.spec import get_vehicle
    >>> from sim_vehicle.mavlink import SimVehicle
    >>> simulation = Simulation([SimVehicle(get_vehicle("quad"), GeoPoint(28.05, -82.15))])
    >>> link = simulation.open_link()
    >>> link.sleep(3600.0)
    >>> link.clock(), len(link.receive()) > 3600
    (3600.0, True)
    """

    def __init__(self, name: str, simulation: Simulation, port: int) -> None:
        self.name = name
        self.port = port
        self._simulation = simulation
        self._arrived: list[bytes] = []
        self._frames: list[bytes] = []
        self._reader = FrameReader(wanted=(), tap=self._frames.append)
        self._open = True

    def clock(self) -> float:
        """Virtual seconds since the start."""
        return self._simulation.now_s

    def send(self, data: bytes) -> None:
        """Send bytes; frames are routed as they become whole, whatever is none is dropped."""
        if not self._open:
            msg = f"{self.name}: the link is closed"
            raise LinkError(msg)
        self._reader.feed(data)
        frames = self._frames[:]
        self._frames.clear()
        for frame in frames:
            self._simulation.send_frame(self.port, frame)

    def receive(self) -> list[bytes]:
        """Return what has arrived; no time passes."""
        arrived = self._arrived[:]
        self._arrived.clear()
        return arrived

    def deliver(self, frame: bytes) -> None:
        """Take a frame; for the simulation."""
        if self._open:
            self._arrived.append(frame)

    def wait(self, link: Link, seconds: float) -> None:  # noqa: ARG002
        """Let time pass until something has arrived, at most so long; as ``TransferDriver`` calls it."""
        self._pass(seconds, until_arrival=True)

    def sleep(self, seconds: float) -> None:
        """Let so much time pass."""
        self._pass(seconds, until_arrival=False)

    def _pass(self, seconds: float, *, until_arrival: bool) -> None:
        if until_arrival and self._arrived:
            return
        simulation = self._simulation
        end_s = simulation.now_s + max(0.0, seconds)
        simulation.run((lambda _: bool(self._arrived)) if until_arrival else None, limit_s=max(0.0, seconds))
        if end_s < _NEVER and not (until_arrival and self._arrived):
            simulation.now_s = max(simulation.now_s, end_s)

    def close(self) -> None:
        """Hear and send nothing more."""
        self._open = False

    def fileno(self) -> int | None:
        """Return None: there is nothing to wait on but `wait`."""
        return None
