"""Simulated vehicles on the live page: their telemetry and images, and the page's orders to them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from mission.ground.contact import Contact
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import Mission, MissionItem
from mission.transfer.storage import UncheckedItem
from sensors.camera.wire import CAMERA_IMAGE_CAPTURED, DEBUG_FLOAT_ARRAY, ObservationAssembler
from sensors.field_files import load_field_set
from sensors.observations import Observations
from sim_vehicle.component import NEVER, Component
from wbf_mission.addons.base.simulator import Simulated
from wbf_mission.addons.operate.control_station import ControlStation
from wbf_mission.addons.operate.telemetry_events import TelemetryEvents
from wbf_mission.events import DayBegun, EventStream, RunBegun, VehicleInfo
from wbf_mission.run.orders import Orders
from wbf_mission.scenario import Scenario

_LOOKED_AT = tuple(
    int(kind)
    for kind in (
        m.MAVLINK_MSG_ID_HEARTBEAT,
        m.MAVLINK_MSG_ID_GPS_RAW_INT,
        m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        m.MAVLINK_MSG_ID_MISSION_CURRENT,
        m.MAVLINK_MSG_ID_BATTERY_STATUS,
    )
)


class FollowedSimulation:
    """Part of the live page that follows a simulation (`addons.base.pages.FollowedSimulation`)."""

    def __init__(
        self, simulated: Simulated, scenario: Scenario, events: EventStream, orders: Orders | None
    ) -> None:
        self._simulated, self._scenario, self._events = simulated, scenario, events
        self._watch = SimulatedWatch(simulated, scenario.farm.day)
        self.components: list[Component] = [
            self._watch,
            *(() if orders is None else [ControlStation(orders)]),
        ]

    def begin(self) -> Callable[[float], bool]:
        """Publish the first events, once the page listens; return the function to call at each later step."""
        simulated, scenario, events = self._simulated, self._scenario, self._events
        environment, day = simulated.environment, scenario.farm.day
        specs = [(vehicle.system_id, vehicle.pilot.spec) for vehicle in simulated.vehicles]
        begun = RunBegun(
            f"{simulated.farm.name}, simulated {simulated.fleet.autopilot.name}",
            simulated.farm,
            None if environment is None else load_field_set(scenario.farm.fields),
            tuple(VehicleInfo(number, spec.name, spec.kind) for number, spec in specs),
            seed=scenario.seed,
        )
        telemetry = TelemetryEvents(events, self._watch, begun, day=day)
        if environment is not None and events.wants(DayBegun):
            events.tell(DayBegun(0.0, day, environment.values(day)))
        return telemetry.look


class SimulatedWatch:
    """Receive-only component that follows simulated vehicles as a ground station would.

    `look` reads the vehicles' telemetry directly, because some autopilots stream nothing unless requested and
    a fast simulation sends more than can be shown. Texts and camera messages are received over MAVLink.
    """

    system_id, component_id = 254, int(m.MAV_COMP_ID_USER1)
    wanted: frozenset[int] | None = frozenset(
        {m.MAVLINK_MSG_ID_STATUSTEXT, CAMERA_IMAGE_CAPTURED, DEBUG_FLOAT_ARRAY}
    )

    def __init__(self, simulated: Simulated, day: int) -> None:
        ids = [(vehicle.system_id, vehicle.component_id) for vehicle in simulated.vehicles]
        self.vehicles = {system_id: Contact((system_id, component)) for system_id, component in ids}
        self.missions: dict[int, Mission] = {}
        self._simulated = simulated
        self._plans: dict[int, tuple[tuple[MissionItem, ...], ...]] = {}
        self._assemblers: dict[int, ObservationAssembler] = {}
        if simulated.environment is not None:
            fields = simulated.environment.fields.names
            self._assemblers = {
                number: ObservationAssembler(simulated.farm, day=day, fields=fields)
                for number in self.vehicles
            }

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Take one message from a vehicle or camera."""
        number = message.get_srcSystem()
        contact = self.vehicles.get(number)
        if contact is None:
            return []
        if isinstance(message, m.MAVLink_statustext_message):
            if message.get_srcComponent() == contact.vehicle[1]:
                contact.texts.on_text(message, now_s)
        elif number in self._assemblers:
            self._assemblers[number].add(message)
        return []

    def poll(self, now_s: float) -> list[Message]:  # noqa: ARG002
        """Send nothing."""
        return []

    def next_deadline(self) -> float:
        """Return infinity: `poll` never does anything."""
        return NEVER

    def look(self, now_s: float) -> None:
        """Update the state and mission of each vehicle."""
        for vehicle in self._simulated.vehicles:
            number = vehicle.system_id
            monitor = self.vehicles[number].monitor
            for kind in _LOOKED_AT:
                for message in vehicle.built(kind):
                    monitor.receive(message, now_s)
            plans = vehicle.plans
            if plans != self._plans.get(number):
                self._plans[number] = plans
                items, fence, rally = (
                    tuple(item for item in plan if not isinstance(item, UncheckedItem)) for plan in plans
                )
                self.missions[number] = Mission(items, vehicle.home, fence, rally)

    def seen(self) -> Iterator[tuple[float, Observations]]:
        """Yield each vehicle's boot time (s), and its camera's observations since the last call."""
        for number, assembler in self._assemblers.items():
            monitor = self.vehicles[number].monitor
            if assembler.waiting:
                assembler.move_clock(monitor.clock.offset_ms / 1e3)
                yield monitor.position_heard_s - monitor.boot_s, assembler.take()
