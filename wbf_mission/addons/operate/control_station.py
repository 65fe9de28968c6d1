"""Ground station that carries out a watcher's orders to vehicles, and confirms each order."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from geo.system import steady_s
from mission.ground.arming_gate import Standstill
from mission.ground.command import OperatorCommand
from mission.ground.contact import Contact, Heartbeat
from mission.ground.vehicle_state import VehicleMonitor
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.transfer.vehicles import vehicle_of
from mission.transfer.wire import GROUND_STATION
from wbf_mission.addons.operate.command_session import CommandSession
from wbf_mission.run.orders import IN_FLIGHT, START, Orders, WatchersOrder

_ORDERS = (START, "arm", "takeoff", *IN_FLIGHT)
_LOOK_S = 0.1
_MOST_VEHICLES = 250
_AUTOPILOT = int(m.MAV_COMP_ID_AUTOPILOT1)


def commands_of(order: WatchersOrder, heard: VehicleMonitor) -> list[OperatorCommand]:
    """Return the commands that carry out an order; the first is to arm if the vehicle must be armed."""
    if order.order not in (START, "arm"):
        return [order.command]
    begins = order.order == START
    out = []
    if not heard.state.armed and not (begins and heard.profile.start_arms):
        mode = heard.modes.arming
        if mode is not None and mode != heard.mode:
            out.append(OperatorCommand("mode", mode))
        out.append(OperatorCommand("arm"))
    return [*out, OperatorCommand("mission", arms=True)] if begins else out or [OperatorCommand("arm")]


@dataclass(slots=True)
class _Vehicle:
    """A vehicle and its current order."""

    contact: Contact
    order: WatchersOrder | None = None
    left: deque[OperatorCommand] = field(default_factory=deque)
    session: CommandSession | None = None


class ControlStation:
    """Component that carries out `Orders`: each command of an order is a `CommandSession`.

    A new order to a vehicle replaces the previous one. The station sends nothing before the first order.
    From then on, it sends heartbeats without end, since a vehicle may trigger a failsafe when heartbeats
    stop. If `clock` shows that the program was suspended, the station discards the current orders, because
    the state of the vehicles is unknown.
    """

    # The component that watches the same link has another component id.
    system_id, component_id = GROUND_STATION[0], int(m.MAV_COMP_ID_USER1)
    wanted: frozenset[int] | None = None

    def __init__(self, orders: Orders, clock: Callable[[], float] = steady_s) -> None:
        self._orders, self._standstill = orders, Standstill(clock)
        self._vehicles: dict[int, _Vehicle] = {}
        self._heartbeat: Heartbeat | None = None
        self._look_s = -math.inf

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Receive a message."""
        self._look_at_clock()
        if message.get_srcComponent() != _AUTOPILOT:
            return []
        number = message.get_srcSystem()
        vehicle = self._vehicles.get(number)
        if vehicle is None:
            # Only a vehicle takes orders: an order to system 0 would reach all vehicles.
            if vehicle_of(message) is None or len(self._vehicles) >= _MOST_VEHICLES:
                return []
            contact = Contact((number, _AUTOPILOT), (self.system_id, self.component_id))
            vehicle = self._vehicles[number] = _Vehicle(contact)
            self._orders.allow(_ORDERS, self._vehicles)
        vehicle.contact.receive(message, now_s)
        out = [] if vehicle.session is None else vehicle.session.receive(message, now_s)
        return out + self._go_on(vehicle, now_s)

    def poll(self, now_s: float) -> list[Message]:
        """Take new orders, and send the due messages."""
        self._look_at_clock()
        self._look_s = now_s + _LOOK_S
        for order in self._orders.taken():
            for number, vehicle in self._vehicles.items():
                if order.is_for(number):
                    self._begin(vehicle, order)
        out = [] if self._heartbeat is None else self._heartbeat.poll(now_s)
        for vehicle in self._vehicles.values():
            if vehicle.session is not None:
                out += vehicle.session.poll(now_s)
            out += self._go_on(vehicle, now_s)
        return out

    def next_deadline(self) -> float:
        """Time (s) at which the next `poll` is due."""
        sessions = (vehicle.session for vehicle in self._vehicles.values())
        return min([self._look_s, *(session.next_deadline() for session in sessions if session is not None)])

    def _look_at_clock(self) -> None:
        """Discard the current orders if the program was suspended."""
        stood_s = self._standstill.look()
        if stood_s == 0.0:
            return
        for vehicle in self._vehicles.values():
            if vehicle.order is not None:
                text = f"{vehicle.order.order} is dropped: the program stood still for {stood_s:.0f} s"
                self._orders.warn(
                    f"{self._at(vehicle)}{text}; check the vehicle's state, and give the order again"
                )
                vehicle.order, vehicle.session = None, None
                vehicle.left.clear()

    def _begin(self, vehicle: _Vehicle, order: WatchersOrder) -> None:
        self._heartbeat = self._heartbeat or Heartbeat()
        self._orders.note(f"{self._at(vehicle)}{order}")
        vehicle.order, vehicle.session = order, None
        vehicle.left = deque(commands_of(order, vehicle.contact.monitor))

    def _go_on(self, vehicle: _Vehicle, now_s: float) -> list[Message]:
        """Start the next command after a finished one; report the outcome of the order."""
        session = vehicle.session
        if session is not None and not session.done:
            return []
        if session is not None and session.error is not None:
            # The error's text names the vehicle.
            self._orders.warn(str(session.error))
            vehicle.order, vehicle.session = None, None
            vehicle.left.clear()
        elif vehicle.left:
            vehicle.session = CommandSession(vehicle.left.popleft(), contact=vehicle.contact)
            return vehicle.session.poll(now_s)
        elif session is not None and vehicle.order is not None:
            mode = vehicle.contact.monitor.mode
            self._orders.note(f"{self._at(vehicle)}{vehicle.order.order} is carried out (mode {mode})")
            vehicle.order, vehicle.session = None, None
        return []

    def _at(self, vehicle: _Vehicle) -> str:
        return f"vehicle {vehicle.contact.vehicle[0]}: " if len(self._vehicles) > 1 else ""
