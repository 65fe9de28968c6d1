"""Events of watched vehicles, real or simulated, from their telemetry."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
import shapely

from geo.farm import Farm, Patch
from geo.frame import LocalFrame
from mission.ground.contact import Contact
from mission.ground.items import FLOWN_TO
from mission.ground.texts import WHOLE_S
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import Mission, MissionItem
from mission.transfer.storage import UncheckedItem
from sensors.camera.wire import CAMERA_IMAGE_CAPTURED, DEBUG_FLOAT_ARRAY, ObservationAssembler
from sensors.field_files import load_field_set
from sensors.observations import Observations
from sim_vehicle.component import NEVER, Component
from wbf_mission.addons.operate.control_station import ControlStation
from wbf_mission.events import (
    DayBegun,
    EventStream,
    Planned,
    RunBegun,
    Seen,
    VehicleInfo,
    VehicleMoved,
    VehicleSaid,
)
from wbf_mission.run.orders import Orders
from wbf_mission.scenario import Scenario

if TYPE_CHECKING:
    from wbf_mission.addons.base.simulator import Simulated

_APART_S = 0.1
_AGAIN_S = 1.0
_SIDE_M = 500.0


class Watch(Protocol):
    """Source of the telemetry of vehicles."""

    @property
    def vehicles(self) -> Mapping[int, Contact]:
        """State of each vehicle, by system id."""

    @property
    def missions(self) -> Mapping[int, Mission]:
        """Known missions by system id; a changed mission is a new object."""

    def look(self, now_s: float) -> None:
        """Update the state to `now_s`."""

    def seen(self) -> Iterable[tuple[float, Observations]]:
        """Return the observations since the last call, each with the time at which its vehicle booted."""


@dataclass(slots=True)
class _Told:
    """Record of the events already sent about a vehicle."""

    mission: Mission | None = None
    texts: int = 0
    flight: int = 0  # Number of times the vehicle was armed
    armed: bool = False
    moved: VehicleMoved | None = None


class TelemetryEvents:
    """Emits the events of a watch, with at most ten states per vehicle and second of wall time.

    The start of the run, `begun`, is sent at once. A vehicle is added to `begun` when it is first heard, with
    the name and kind from `named`; without `named`, only vehicles of `begun` are shown. Without a farm, a
    square of land around the first vehicle is added.
    """

    def __init__(
        self,
        events: EventStream,
        watch: Watch,
        begun: RunBegun,
        *,
        day: int = 0,
        named: Callable[[Contact], tuple[str, str]] | None = None,
    ) -> None:
        self._events, self._watch, self._begun, self._day = events, watch, begun, day
        self._named = named
        self._told: dict[int, _Told] = {}
        self._due_wall_s = -math.inf
        events.tell(begun)

    def look(self, now_s: float) -> bool:
        """Emit new events if they are due; return False, as a server's end condition that never holds."""
        wall_s = time.monotonic()
        if wall_s >= self._due_wall_s:
            self._due_wall_s = wall_s + _APART_S
            self._tell(now_s)
        return False

    def _tell(self, now_s: float) -> None:
        watch = self._watch
        watch.look(now_s)
        located = {number: one for number, one in watch.vehicles.items() if _is_located(one)}
        self._meet(located)
        farm = self._begun.farm
        for number, contact in watch.vehicles.items():
            told = self._told.setdefault(number, _Told())
            said, told.texts = contact.texts.begun_until(told.texts, now_s - WHOLE_S)
            for time_s, severity, text in said:
                self._events.tell(VehicleSaid(time_s, number, severity, text))
            if farm is None:
                continue
            if number in located:
                self._tell_state(number, contact, told, farm.frame, now_s)
            mission = watch.missions.get(number)
            if mission is None or mission is told.mission:
                continue
            # An empty mission is reported only if it replaces another mission.
            if told.mission is not None or mission.items or mission.fence:
                told.mission = mission
                flight, path_m = max(1, told.flight), _path_of(mission, farm.frame)
                self._events.tell(Planned(now_s, self._day, flight, number, mission, path_m))
        for offset_s, observations in watch.seen():
            if len(observations):
                self._events.tell(Seen(offset_s, observations))

    def _meet(self, located: Mapping[int, Contact]) -> None:
        """Announce vehicles that are heard for the first time."""
        begun = self._begun
        if self._named is not None:
            known = {vehicle.system_id for vehicle in begun.vehicles}
            new = [
                VehicleInfo(number, *self._named(one))
                for number, one in located.items()
                if number not in known
            ]
            begun = replace(begun, vehicles=(*begun.vehicles, *new)) if new else begun
        if begun.farm is None and located:
            state = next(iter(located.values())).monitor.state
            begun = replace(begun, farm=land_about(state.latitude_deg, state.longitude_deg))
        if begun is not self._begun:
            self._begun = begun
            self._events.tell(begun)

    def _tell_state(
        self, number: int, contact: Contact, told: _Told, frame: LocalFrame, now_s: float
    ) -> None:
        monitor, state = contact.monitor, contact.monitor.state
        told.flight += state.armed and not told.armed
        told.armed = state.armed
        moved = VehicleMoved.of(
            state,
            frame,
            (now_s, self._day, max(1, told.flight), number),
            mode=monitor.mode,
            link_quality=contact.link.quality,
            # The age is that of the position: other messages do not make a position newer.
            silent_s=max(0.0, now_s - monitor.position_heard_s),
        )
        before = told.moved
        # An unchanged state is repeated at a lower rate.
        if (
            before is None
            or now_s - before.time_s >= _AGAIN_S
            or moved != replace(before, time_s=moved.time_s, silent_s=moved.silent_s)
        ):
            told.moved = moved
            self._events.tell(moved)


def _is_located(contact: Contact) -> bool:
    """Return whether a vehicle's position is known and valid."""
    state = contact.monitor.state
    on_globe = abs(state.latitude_deg) <= 90.0 and abs(state.longitude_deg) <= 180.0
    return on_globe and contact.monitor.knows_position


def _path_of(mission: Mission, frame: LocalFrame) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Return the positions of the mission's items, float64[n, 2], in metres of a frame."""
    places = [(item.x, item.y) for item in mission.items if item.command in FLOWN_TO and item.has_position]
    latitude, longitude = np.array(places, np.float64).reshape(-1, 2).T
    return np.column_stack(frame.from_wgs84(latitude, longitude))


def land_about(latitude_deg: float, longitude_deg: float) -> Farm:
    """Return a square of land around a position, for watching without a farm.

    >>> farm = land_about(28.05, -82.15)
    >>> farm.width_cells, farm.home_m
    (500, (250.0, 250.0))
    """
    half_m = 0.5 * _SIDE_M
    about = LocalFrame(latitude_deg, longitude_deg)
    corner = LocalFrame(*map(float, about.to_wgs84(-half_m, -half_m)))
    side = int(_SIDE_M)
    land = Patch("land", "unknown", "unknown", shapely.box(0.0, 0.0, _SIDE_M, _SIDE_M))
    return Farm("land", corner, side, side, (land,), "unknown", (half_m, half_m), cell_size_m=1.0)


_LOOKED_AT = (
    m.MAVLINK_MSG_ID_HEARTBEAT,
    m.MAVLINK_MSG_ID_GPS_RAW_INT,
    m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    m.MAVLINK_MSG_ID_MISSION_CURRENT,
    m.MAVLINK_MSG_ID_BATTERY_STATUS,
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
