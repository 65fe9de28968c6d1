"""The host on a virtual clock: components that talk in bytes, as fast as the machine can.

Every message is packed once, by its sender, and its bytes go where mavlink-router would send them. The clock
jumps to the next deadline, so the same components and seeds give the same bytes at the same times.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from mission.link.dialect import mavlink
from mission.link.frames import FrameReader, FrameWriter
from sim_vehicle.component import NEVER, Component
from sim_vehicle.errors import VehicleError
from sim_vehicle.routing import RoutingTable

__all__ = ["Impairment", "Simulation", "StopReason"]

_STEPS_AT_ONE_INSTANT = 100_000


class StopReason(Enum):
    """Why `Simulation.run` returned."""

    FINISHED = "finished"
    """The condition of the caller holds."""
    TIME_LIMIT = "time limit"
    """The time limit passed first."""
    IDLE = "idle"
    """Nothing can happen any more: no message is under way and no component has a deadline."""
    STALLED = "stalled"
    """The components keep each other busy and time does not go on."""
    STOPPED = "stopped"
    """Somebody stopped it (`Server` only)."""


@dataclass(frozen=True, slots=True)
class Impairment:
    """A bad radio between the `remote` components and all others; each frame has its own luck.

    Parameters
    ----------
    loss, duplication : float
        Probabilities for one frame on one way, 0 to 1.
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
        The components on the far side of the radio.

    Attributes
    ----------
    now_s : float
        Virtual seconds since the start.
    frames, bytes_sent : int
        What was sent so far.

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
    ) -> None:
        self.now_s = 0.0
        self.frames = 0
        self.bytes_sent = 0
        self._components = tuple(components)
        self._tap = tap
        self._writers = [FrameWriter(c.system_id, c.component_id) for c in components]
        self._reader = FrameReader()
        self._wanted = [c.wanted for c in components]
        self._table: RoutingTable[int] = RoutingTable()
        for port, component in enumerate(components):
            address = (component.system_id, component.component_id)
            if any((c.system_id, c.component_id) == address for c in components[:port]):
                msg = f"simulation: two components have the address {address}; give each its own"
                raise VehicleError(msg)
            self._table.heard(port, address)
        self._routes: dict[tuple[int, int, int], tuple[int, ...]] = {}
        self._inbox: deque[tuple[tuple[int, ...], bytes]] = deque()
        self._impairment = impairment
        self._remote = frozenset(i for i, c in enumerate(components) if any(c is r for r in remote))
        seed = impairment.seed if impairment else 0
        sequence = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
        self._luck = [np.random.default_rng(s) for s in sequence.spawn(2)]
        self._late: list[tuple[float, int, int, bytes]] = []
        self._late_count = 0

    def run(self, until: Callable[[float], bool] | None = None, limit_s: float = NEVER) -> StopReason:
        """Let time pass until a condition holds or `limit_s` more seconds went by.

        Parameters
        ----------
        until : callable, optional
            ``until(now_s)``, asked after each step.
        limit_s : float
            Virtual seconds from now.

        Returns
        -------
        StopReason
            `run` may be called again after any of them.
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
            if self._late and self._late[0][0] < next_s:
                next_s = self._late[0][0]
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

    def _step(self, deadlines: Iterable[float]) -> None:
        now_s = self.now_s
        while self._late and self._late[0][0] <= now_s:
            _, _, port, frame = heapq.heappop(self._late)
            self._inbox.append(((port,), frame))
        for port, deadline_s in enumerate(deadlines):
            if deadline_s <= now_s:
                messages = self._components[port].poll(now_s)
                if messages:
                    self._send(port, messages)

    def _send(self, source: int, messages: Iterable[mavlink.MAVLink_message]) -> None:
        """Pack each message once and put its bytes on the way."""
        encode, tap, inbox, routes = self._writers[source].encode, self._tap, self._inbox, self._routes
        for message in messages:
            frame = encode(message)
            self.frames += 1
            self.bytes_sent += len(frame)
            if tap is not None:
                tap(frame, self.now_s)
            message_id = type(message).id
            target = getattr(message, "target_system", 0)
            key = (source, message_id, target << 8 | getattr(message, "target_component", 0))
            ports = routes.get(key)
            if ports is None:
                ports = routes[key] = self._route(*key)
            if ports:
                if self._impairment is not None:
                    ports = self._impair(source, ports, frame)
                inbox.append((ports, frame))

    def _route(self, source: int, message_id: int, target: int) -> tuple[int, ...]:
        """Ports that get such a message and care for it."""
        found = self._table.destinations((target >> 8, target & 255), source, range(len(self._components)))
        return tuple(p for p in found if (wanted := self._wanted[p]) is None or message_id in wanted)

    def _impair(self, source: int, ports: tuple[int, ...], frame: bytes) -> tuple[int, ...]:
        """Send the frame over the radio to the ports on its far side; return the ports on the near side."""
        impairment = self._impairment
        assert impairment is not None
        near = tuple(p for p in ports if (p in self._remote) == (source in self._remote))
        luck = self._luck[source in self._remote]
        for port in ports:
            if port in near:
                continue
            copies = 0 if luck.random() < impairment.loss else 1
            if impairment.duplication and luck.random() < impairment.duplication:
                copies *= 2
            for _ in range(copies):
                late_s = impairment.delay_s + impairment.jitter_s * luck.random()
                self._late_count += 1
                heapq.heappush(self._late, (self.now_s + late_s, self._late_count, port, frame))
        return near

    def _deliver(self) -> bool:
        """Hand over what has arrived, and the answers to it; False when the answers never end."""
        inbox, components, feed, now_s = self._inbox, self._components, self._reader.feed, self.now_s
        for _ in range(_STEPS_AT_ONE_INSTANT):
            if not inbox:
                return True
            ports, frame = inbox.popleft()
            for message in feed(frame):
                for port in ports:
                    replies = components[port].receive(message, now_s)
                    if replies:
                        self._send(port, replies)
        return False
