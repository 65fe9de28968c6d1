"""The host on a virtual clock: components that talk in bytes, as fast as the machine can.

Every message is packed once, by its sender, and its bytes go where mavlink-router would send them. The clock
jumps to the next deadline, so the same components and seeds give the same bytes at the same times.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from mission.errors import LinkError
from mission.link.codec.dialect import mavlink
from mission.link.codec.frames import FrameReader, FrameWriter, decode_frame, valid_frame_end
from mission.link.codec.signing import SETUP_SIGNING, Signing
from sim_vehicle.component import NEVER, UNHEARD, Component, SaysMuch
from sim_vehicle.errors import VehicleError
from sim_vehicle.faults.fault import Fault
from sim_vehicle.faults.session import FaultSession, FaultyLink
from sim_vehicle.host.router import RadioRange, RoutingTable, frame_id, frame_source, frame_target

if TYPE_CHECKING:
    from mission.link.address import Link

__all__ = ["Impairment", "Simulation", "StopReason", "VirtualLink"]


class VirtualLink:
    """A `mission.link.Link` on a clock of its own; made by `Simulation.open_link`.

    Whoever takes a clock and a way to wait (as `mission.transfer.driver.TransferDriver` does) runs on the
    virtual clock with it: waiting lets the clock go on until something arrives or the time is up.

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
        """Send bytes; frames are routed as they become whole, other bytes are dropped."""
        if not self._open:
            raise LinkError(f"{self.name}: the link is closed")
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
        """Let this time pass."""
        self._pass_time(max(0.0, seconds), None)

    def close(self) -> None:
        """Hear and send nothing more."""
        self._open = False

    def fileno(self) -> int | None:
        """Return None: there is nothing to wait on but `wait`."""
        return None


# The longest mission, 65535 items, crosses twice in one instant: sent and read back.
_STEPS_AT_ONE_INSTANT = 300_000


class StopReason(Enum):
    """Why `Simulation.run` returned."""

    FINISHED = "finished"  # the condition of the caller holds
    TIME_LIMIT = "time limit"  # it passed first
    IDLE = "idle"  # nothing can happen any more: no message is in transit, no component has a deadline
    STALLED = "stalled"  # the components keep each other busy and time does not go on
    STOPPED = "stopped"  # somebody stopped it (`Server` only)


@dataclass(frozen=True, slots=True)
class Impairment:
    """A bad radio between the `remote` components and all others; each frame has its own luck.

    Parameters
    ----------
    loss, duplication : float
        Probabilities for one frame in one direction, 0 to 1.
    delay_s, jitter_s : float
        Each frame is late by `delay_s` plus a uniform part of `jitter_s` (which reorders frames).
    seed : int or numpy.random.SeedSequence
        For the two directions.
    """

    loss: float = 0.0
    duplication: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    seed: int | np.random.SeedSequence = 0

    def __post_init__(self) -> None:
        for name in ("loss", "duplication"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                msg = f"link impairment: {name} {getattr(self, name)} is no probability; give 0 to 1"
                raise VehicleError(msg)
        for name in ("delay_s", "jitter_s"):
            if not 0.0 <= getattr(self, name) < NEVER:
                msg = f"link impairment: {name} {getattr(self, name)} is no delay; give seconds from 0"
                raise VehicleError(msg)

    @property
    def faults(self) -> tuple[Fault, ...]:
        """The same as faults of a link."""
        kinds = ("loss", "duplicate", "delay", "jitter")
        values = (self.loss, self.duplication, self.delay_s, self.jitter_s)
        return tuple(Fault(kind, value) for kind, value in zip(kinds, values, strict=True) if value)


class Simulation:
    """Runs components on one virtual clock.

    Parameters
    ----------
    components : sequence of Component
        Their addresses must differ.
    tap : callable, optional
        ``tap(frame, now_s)`` sees the bytes of every message once, as it is sent (for a tlog).
    impairment : Impairment, optional
        The radio between `remote` and the others; without it every frame arrives at once.
    remote : sequence of Component
        The components on the far side of a radio, each with its own; so is every `open_link`.
    faults : sequence of Fault or str
        What goes wrong, see `sim_vehicle.faults.fault`; the links are numbered as `remote` lists them, then
        as they are opened.
    seed : int or numpy.random.SeedSequence
        Of the faults (the impairment has its own).
    signing : Signing, optional
        Signs what the components send; of `open_link` only what it accepts is received and forwarded.
    radio_range : RadioRange, optional
        What crosses a radio to or from a vehicle that is farther away is lost.

    Attributes
    ----------
    now_s : float
        Virtual seconds since the start.
    frames, bytes_sent : int
        What was sent so far; bytes of the frames that somebody cares for, a tap for all.

    Raises
    ------
    VehicleError
        If two components have the same address.

    Examples
    --------
    >>> Simulation([]).run(limit_s=10.0)
    <StopReason.IDLE: 'idle'>
    """

    def __init__(
        self,
        components: Sequence[Component],
        *,
        tap: Callable[[bytes, float], None] | None = None,
        impairment: Impairment | None = None,
        remote: Sequence[Component] = (),
        faults: Sequence[Fault | str] = (),
        seed: int | np.random.SeedSequence = 0,
        signing: Signing | None = None,
        radio_range: RadioRange | None = None,
    ) -> None:
        self._signing = signing
        self._range = radio_range
        self.now_s = 0.0
        self.frames = 0
        self.bytes_sent = 0
        if impairment is not None:
            faults, seed = (*faults, *impairment.faults), impairment.seed
        self._session = FaultSession(faults, seed)
        far = [any(c is r for r in remote) for c in components]
        near = iter(self._session.wrap([c for c, is_far in zip(components, far, strict=True) if not is_far]))
        self._components = tuple(
            c if is_far else next(near) for c, is_far in zip(components, far, strict=True)
        )
        self._tap = tap
        self._writers = [FrameWriter(c.system_id, c.component_id, signing=signing) for c in components]
        self._wanted = [c.wanted for c in components]
        self._addresses = [(c.system_id, c.component_id) for c in components]
        self._table: RoutingTable[int] = RoutingTable()
        for port, component in enumerate(components):
            address = (component.system_id, component.component_id)
            if any((c.system_id, c.component_id) == address for c in components[:port]):
                msg = f"simulation: two components have the address {address}; give each its own"
                raise VehicleError(msg)
            self._table.learn(port, address)
        self._routes: dict[tuple[int, int, int], tuple[int, ...]] = {}
        self._inbox: deque[tuple[tuple[int, ...], bytes]] = deque()
        self._links: list[VirtualLink] = []
        self._radios: dict[int, FaultyLink] = {}
        self._radio_count = 0
        for port, component in enumerate(components):
            if far[port]:
                self._add_radio(port, f"{component.system_id}.{component.component_id}")
        self._unbroken = not faults
        self._share_listeners()

    def _share_listeners(self) -> None:
        """Let components with much telemetry make only messages that another component or a link wants."""
        plain = self._unbroken and self._tap is None and self._signing is None
        plain = plain and not self._links and not self._radios
        for port, component in enumerate(self._components):
            if isinstance(component, SaysMuch):
                wanted = [ids for other, ids in enumerate(self._wanted) if other != port]
                heard = [ids for ids in wanted if ids is not None]
                all_known = plain and len(heard) == len(wanted)
                component.only_heard(frozenset().union(*heard) if all_known else None)

    def open_link(self, name: str = "virtual") -> VirtualLink:
        """Open a link for ground software on the virtual clock; faults and messages may name it."""
        port = len(self._components) + len(self._links)
        link = VirtualLink(
            name, lambda: self.now_s, lambda frame: self._send_frame(port, frame), self._pass_time
        )
        self._links.append(link)
        self._routes.clear()
        self._add_radio(port, name)
        self._share_listeners()
        return link

    def _pass_time(self, seconds: float, until: Callable[[], bool] | None) -> None:
        """Run for so long, or until a condition holds; time goes on also when nothing happens any more."""
        end_s = self.now_s + seconds

        def is_over(_now_s: float = 0.0) -> bool:
            return until is not None and until()

        self.run(is_over, limit_s=seconds)
        if end_s < NEVER and not is_over():
            self.now_s = max(self.now_s, end_s)

    def _add_radio(self, port: int, name: str) -> None:
        self._radio_count += 1
        radio = self._session.link(name, self._radio_count, always=self._range is not None)
        if radio is not None:
            self._radios[port] = radio

    def run(self, until: Callable[[float], bool] | None = None, limit_s: float = NEVER) -> StopReason:
        """Let time pass until ``until(now_s)``, asked after each step, or `limit_s` more virtual seconds.

        It may be called again after any of the reasons to stop.
        """
        end_s = self.now_s + limit_s
        steps = 0
        while True:
            if not self._deliver():
                return StopReason.STALLED
            if until is not None and until(self.now_s):
                return StopReason.FINISHED
            deadlines = [component.next_deadline() for component in self._components]
            next_s = min(deadlines, default=NEVER)
            for radio in self._radios.values():
                next_s = min(next_s, radio.next_arrival())
            if next_s == NEVER:
                return StopReason.IDLE
            if next_s > end_s:
                self.now_s = end_s
                return StopReason.TIME_LIMIT
            if next_s > self.now_s:
                self.now_s = next_s
                steps = 0
            steps += 1
            if steps > _STEPS_AT_ONE_INSTANT:
                return StopReason.STALLED
            self._step(deadlines)

    def send(self, component: Component, messages: Iterable[mavlink.MAVLink_message]) -> None:
        """Send messages of a component now, which nothing that it received or a deadline made it send.

        VehicleError if it is none of the simulation's.
        """
        address = (component.system_id, component.component_id)
        if address not in self._addresses:
            raise VehicleError(f"simulation: no component has the address {address}")
        self._send(self._addresses.index(address), messages)

    def _step(self, deadlines: Iterable[float]) -> None:
        now_s = self.now_s
        for port, radio in self._radios.items():
            self._arrive(port, radio)
        for port, deadline_s in enumerate(deadlines):
            if deadline_s <= now_s:
                messages = self._components[port].poll(now_s)
                if messages:
                    self._send(port, messages)

    def _arrive(self, port: int, radio: FaultyLink) -> None:
        """Take the bytes that leave a radio now; damaged frames end here, but links see them."""
        for frame in radio.receive("up", self.now_s):
            if valid_frame_end(frame) == len(frame):
                ports = self._ports(port, frame_id(frame), frame_target(frame))
                self._forward(frame, tuple(port for port in ports if self._reaches(port)))
        for frame in radio.receive("down", self.now_s):
            if port >= len(self._components):
                self._links[port - len(self._components)].deliver(frame)
            elif valid_frame_end(frame) == len(frame):
                self._inbox.append(((port,), frame))

    def _reaches(self, port: int) -> bool:
        """Return whether a radio of the ground reaches the component of a port."""
        if self._range is None or port >= len(self._components) or port in self._radios:
            return True
        return self._range.reaches(self._components[port].system_id)

    def _send(self, source: int, messages: Iterable[mavlink.MAVLink_message]) -> None:
        """Pack each message once and send its bytes."""
        encode, tap, inbox, routes = self._writers[source].encode, self._tap, self._inbox, self._routes
        plain = not self._links and not self._radios
        silent = plain and tap is None and self._signing is None
        for message in messages:
            self.frames += 1
            if message is UNHEARD:
                self._writers[source].skip()
                continue
            message_id, target = type(message).id, 0
            key = (source, message_id, target)
            if hasattr(message, "target_system"):
                target = message.target_system
                key = (source, message_id, target << 8 | getattr(message, "target_component", 0))
            ports = routes.get(key)
            if ports is None:
                ports = routes[key] = self._route(*key)
            if silent and not ports:
                self._writers[source].skip()
                continue
            frame = encode(message)
            self.bytes_sent += len(frame)
            if tap is not None:
                tap(frame, self.now_s)
            if plain:
                if ports:
                    inbox.append((ports, frame))
            elif source in self._radios:
                self._radios[source].send("up", frame, target, self.now_s)
            else:
                self._forward(frame, ports)

    def _send_frame(self, source: int, frame: bytes) -> None:
        """Send a whole frame of a virtual link."""
        self.frames += 1
        self.bytes_sent += len(frame)
        message_id = frame_id(frame)
        if self._signing is not None and not self._signing.accepts(frame, message_id):
            return
        if self._tap is not None and message_id != SETUP_SIGNING:  # a key is never logged
            self._tap(frame, self.now_s)
        if self._table.learn(source, frame_source(frame)):
            self._routes.clear()
        target = frame_target(frame)
        if source in self._radios:
            self._radios[source].send("up", frame, target[0], self.now_s)
        else:
            self._forward(frame, self._ports(source, message_id, target))

    def _ports(self, source: int, message_id: int, target: tuple[int, int]) -> tuple[int, ...]:
        key = (source, message_id, target[0] << 8 | target[1])
        ports = self._routes.get(key)
        if ports is None:
            ports = self._routes[key] = self._route(*key)
        return ports

    def _route(self, source: int, message_id: int, target: int) -> tuple[int, ...]:
        """Ports that get such a message and care for it."""
        everyone = range(len(self._components) + len(self._links))
        found = self._table.destinations((target >> 8, target & 255), source, everyone)
        return tuple(p for p in found if self._cares(p, message_id))

    def _cares(self, port: int, message_id: int) -> bool:
        if port >= len(self._components):
            return message_id != SETUP_SIGNING
        wanted = self._wanted[port]
        return wanted is None or message_id in wanted

    def _forward(self, frame: bytes, ports: tuple[int, ...]) -> None:
        """Send a frame to ports of which some are links or behind radios."""
        near: list[int] = []
        system = frame_source(frame)[0]
        for port in ports:
            if port in self._radios:
                if self._range is None or self._range.reaches(system):
                    self._radios[port].send("down", frame, system, self.now_s)
            elif port >= len(self._components):
                self._links[port - len(self._components)].deliver(frame)
            else:
                near.append(port)
        if near:
            self._inbox.append((tuple(near), frame))

    def _deliver(self) -> bool:
        """Hand over the messages that have arrived, and the answers; False when the answers never end."""
        inbox, components, now_s = self._inbox, self._components, self.now_s
        for _ in range(_STEPS_AT_ONE_INSTANT):
            if not inbox:
                return True
            ports, frame = inbox.popleft()
            message = decode_frame(frame)
            if message is None:
                continue
            for port in ports:
                replies = components[port].receive(message, now_s)
                if replies:
                    self._send(port, replies)
        return False
