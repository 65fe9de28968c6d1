"""Host of components on a virtual clock, which runs as fast as the machine can.

The sender's writer encodes each message once, and the host routes the frame by the rules of mavlink-router.
The clock jumps to the next deadline, so the same components and seeds give the same bytes at the same times.
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
from mission.link.faults import Faults
from sim_vehicle.component import NEVER, UNHEARD, Component, SaysMuch
from sim_vehicle.errors import VehicleError
from sim_vehicle.host.injection import AnyFault, Radio, injection
from sim_vehicle.host.router import RadioRange, RoutingTable, frame_id, frame_source, frame_target

if TYPE_CHECKING:
    from mission.link.address import Link


class VirtualLink:
    """A `mission.link.Link` on the virtual clock, as `Simulation.open_link` makes it.

    With its `clock` and `wait`, programs such as `mission.transfer.driver.TransferDriver` run on virtual
    time. `wait` advances the clock until data arrive or the time is over.
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
        """Send bytes; the host routes complete frames and drops other bytes."""
        if not self._open:
            raise LinkError(f"{self.name}: the link is closed")
        self._reader.feed(data)
        frames = self._frames[:]
        self._frames.clear()
        for frame in frames:
            self._send_frame(frame)

    def receive(self) -> list[bytes]:
        """Return the frames that have arrived, without advancing the clock."""
        arrived = self._arrived[:]
        self._arrived.clear()
        return arrived

    def deliver(self, frame: bytes) -> None:
        """Add an arriving frame; the host calls this method."""
        if self._open:
            self._arrived.append(frame)

    def wait(self, link: Link, seconds: float) -> None:  # noqa: ARG002
        """Advance the clock to the next frame, at most by `seconds`; ``TransferDriver`` passes `link`."""
        if not self._arrived:
            self._pass_time(max(0.0, seconds), lambda: bool(self._arrived))

    def sleep(self, seconds: float) -> None:
        """Advance the clock by `seconds`."""
        self._pass_time(max(0.0, seconds), None)

    def close(self) -> None:
        """Close the link."""
        self._open = False

    def fileno(self) -> int | None:
        """Return None, because the link has no descriptor."""
        return None


# One instant may hold an upload and a download of the longest mission (65535 items).
_STEPS_AT_ONE_INSTANT = 300_000


class StopReason(Enum):
    """Reason why the `run` of a host returned."""

    FINISHED = "finished"  # The caller's condition is true.
    TIME_LIMIT = "time limit"  # The time limit is reached.
    IDLE = "idle"  # No message is in transit, and no component has a deadline.
    STALLED = "stalled"  # Messages between components never end, so time cannot advance.
    STOPPED = "stopped"  # `stop` or Ctrl-C ended the run of a `Server`.


@dataclass(frozen=True, slots=True)
class Impairment:
    """A bad radio between the `remote` components and the others; faults strike each frame separately.

    Parameters
    ----------
    loss, duplication : float
        Probabilities for a frame in one direction, 0 to 1.
    delay_s, jitter_s : float
        Delay of a frame: `delay_s`, plus a uniform random part of `jitter_s`, which reorders frames.
    seed : int or numpy.random.SeedSequence
        Seed of both directions.
    """

    loss: float = 0.0
    duplication: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    seed: int | np.random.SeedSequence = 0

    def __post_init__(self) -> None:
        for name in ("loss", "duplication"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                msg = f"link impairment: {name} {getattr(self, name)} is not a probability; give 0 to 1"
                raise VehicleError(msg)
        for name in ("delay_s", "jitter_s"):
            if not 0.0 <= getattr(self, name) < NEVER:
                msg = f"link impairment: {name} {getattr(self, name)} is not a delay; give 0 or more seconds"
                raise VehicleError(msg)

    @property
    def faults(self) -> Faults:
        """Disturbances of a radio with this impairment."""
        return Faults(self.loss, self.duplication, delay_s=self.delay_s, jitter_s=self.jitter_s)


class Simulation:
    """Host of components on a virtual clock.

    Parameters
    ----------
    components : sequence of Component
        Components with different addresses.
    tap : callable, optional
        ``tap(frame, now_s)`` is called once with the bytes of each message, when it is sent (for a tlog).
    impairment : Impairment, optional
        Radio between `remote` and the other components; by default frames arrive at once.
    remote : sequence of Component
        Components behind a radio, each with its own radio. Links of `open_link` have radios, too.
    faults : sequence of Fault or str
        Faults (needs the add-on); links are numbered in the order of `remote`, then of `open_link`.
    seed : int or numpy.random.SeedSequence
        Seed of the faults; the impairment has its own seed.
    signing : Signing, optional
        Signature of the components' messages; frames of `open_link` without a valid signature are dropped.
    radio_range : RadioRange, optional
        Range of the radios; frames to or from a vehicle beyond the range are lost.

    Attributes
    ----------
    now_s : float
        Virtual seconds since the start.
    frames, bytes_sent : int
        Sent frames, and bytes of the sent frames that have a receiver or a tap.

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
        faults: Sequence[AnyFault | str] = (),
        seed: int | np.random.SeedSequence = 0,
        signing: Signing | None = None,
        radio_range: RadioRange | None = None,
    ) -> None:
        self._signing = signing
        self._range = radio_range
        self.now_s = 0.0
        self.frames = 0
        self.bytes_sent = 0
        impaired = Faults() if impairment is None else impairment.faults
        self._injection = injection(faults, seed if impairment is None else impairment.seed)
        self._always = None if radio_range is None and impaired == Faults() else impaired
        far = [any(c is r for r in remote) for c in components]
        near = iter(
            self._injection.wrap([c for c, is_far in zip(components, far, strict=True) if not is_far])
        )
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
                msg = f"simulation: two components have the address {address}; give each a different address"
                raise VehicleError(msg)
            self._table.learn(port, address)
        self._routes: dict[tuple[int, int, int], tuple[int, ...]] = {}
        self._inbox: deque[tuple[tuple[int, ...], bytes]] = deque()
        self._links: list[VirtualLink] = []
        self._radios: dict[int, Radio] = {}
        self._radio_count = 0
        for port, component in enumerate(components):
            if far[port]:
                self._add_radio(port, f"{component.system_id}.{component.component_id}")
        self._share_listeners()

    def _share_listeners(self) -> None:
        """Let `SaysMuch` components leave out unwanted messages, unless links, logs or radios need all."""
        plain = not self._injection.faults and self._tap is None and self._signing is None
        plain = plain and not self._links and not self._radios
        for port, component in enumerate(self._components):
            if isinstance(component, SaysMuch):
                wanted = [ids for other, ids in enumerate(self._wanted) if other != port]
                heard = [ids for ids in wanted if ids is not None]
                all_known = plain and len(heard) == len(wanted)
                component.only_heard(frozenset().union(*heard) if all_known else None)

    def open_link(self, name: str = "virtual") -> VirtualLink:
        """Open a link for ground software; faults and errors name the link by `name`."""
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
        """Run for `seconds` or until a condition is true; the clock advances even in an idle simulation."""
        end_s = self.now_s + seconds

        def is_over(_now_s: float = 0.0) -> bool:
            return until is not None and until()

        self.run(is_over, limit_s=seconds)
        if end_s < NEVER and not is_over():
            self.now_s = max(self.now_s, end_s)

    def _add_radio(self, port: int, name: str) -> None:
        self._radio_count += 1
        radio = self._injection.radio(name, self._radio_count, always=self._always)
        if radio is not None:
            self._radios[port] = radio

    def run(self, until: Callable[[float], bool] | None = None, limit_s: float = NEVER) -> StopReason:
        """Run until ``until(now_s)`` is true (checked after each step), at most `limit_s` virtual seconds.

        `run` may be called again after every `StopReason`.
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
        """Send messages that a component did not return from `receive` or `poll`.

        Raises VehicleError if the component does not belong to the simulation.
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

    def _arrive(self, port: int, radio: Radio) -> None:
        """Forward the frames that arrive over a radio; components never get damaged frames, links do."""
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
        """Return whether the ground station's radio reaches the component at a port."""
        if self._range is None or port >= len(self._components) or port in self._radios:
            return True
        return self._range.reaches(self._components[port].system_id)

    def _send(self, source: int, messages: Iterable[mavlink.MAVLink_message]) -> None:
        """Encode each message once and send the frame."""
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
        """Send a frame from a virtual link."""
        self.frames += 1
        self.bytes_sent += len(frame)
        message_id = frame_id(frame)
        if self._signing is not None and not self._signing.accepts(frame, message_id):
            return
        if self._tap is not None and message_id != SETUP_SIGNING:  # The tap never gets signing keys.
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
        """Return the ports to which a message goes and which want the message."""
        everyone = range(len(self._components) + len(self._links))
        found = self._table.destinations((target >> 8, target & 255), source, everyone)
        return tuple(port for port in found if self._wants(port, message_id))

    def _wants(self, port: int, message_id: int) -> bool:
        if port >= len(self._components):
            return message_id != SETUP_SIGNING
        wanted = self._wanted[port]
        return wanted is None or message_id in wanted

    def _forward(self, frame: bytes, ports: tuple[int, ...]) -> None:
        """Send a frame to ports, which may be links or lie behind radios."""
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
        """Deliver the pending messages and all answers to them; return False if the answers never end."""
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
