"""Watches all vehicles on a link: their latest telemetry and the link quality."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any

from mission.ground.contact import Contact, Heartbeat
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import Mission, MissionType
from mission.transfer import CLIENT_MESSAGES, DownloadComplete, Output, Transfer, TransferFailed
from mission.transfer.vehicles import vehicle_of
from mission.transfer.wire import ACCEPTED, GROUND_STATION
from sensors.observations import Observations

_STREAM_HZ = 2
_ASK_AGAIN_S = 5.0
_SILENT_S = 3.0
_MOST_VEHICLES = 250
_TELLS_S = 3.0
"""Time (s) within which a vehicle sends its mission state, if it sends it at all."""
_READ_AGAIN_S, _REST_S = 10.0, 1.0
_TRIES = 3
# Possible range of the numbers in `WatchedVehicle.summary`, for any aircraft on earth.
_POSSIBLE = {
    "latitude_deg": (-90.0, 90.0),
    "longitude_deg": (-180.0, 180.0),
    "height_m": (-12_000.0, 50_000.0),
    "ground_speed_m_s": (0.0, 350.0),
    "battery": (0.0, 1.0),
    "gps_fix": (0, 8),
}
# Messages in which NaN is an error; in other messages NaN stands for unknown.
_OF_NUMBERS = (
    m.MAVLink_attitude_message,
    m.MAVLink_attitude_quaternion_message,
    m.MAVLink_local_position_ned_message,
    m.MAVLink_vfr_hud_message,
)


class PlanReader:
    """Reads the mission and fence of a vehicle when it is first heard, and after each change of its mission.

    A change is recognised by MISSION_CURRENT (mission id or item count) or by an overheard upload. After
    three failed tries, `failed` is called with the reason.
    """

    def __init__(self, vehicle: WatchedVehicle, failed: Callable[[str], None]) -> None:
        self.mission: Mission | None = None
        self._vehicle, self._failed = vehicle, failed
        self._kinds: deque[MissionType] = deque()
        self._read: dict[MissionType, DownloadComplete] = {}
        self._transfer: Transfer | None = None
        self._held: tuple[int, int | None] | None = None  # MISSION_CURRENT's id and count at the last read
        self._heard_s = math.inf
        self._due_s = -math.inf
        self._tries = 0

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Receive a message of the vehicle."""
        self._heard_s = min(self._heard_s, now_s)
        if type(message).id not in CLIENT_MESSAGES:
            return []
        if self._transfer is not None:
            return self._take(self._transfer.receive(message, now_s), now_s)
        if isinstance(message, m.MAVLink_mission_ack_message) and message.type == ACCEPTED:
            self._held = None
        return []

    def poll(self, now_s: float) -> list[Message]:
        """Start or continue reading."""
        if self._transfer is not None:
            return self._take(self._transfer.poll(now_s), now_s)
        monitor = self._vehicle.monitor
        is_known = monitor.item_heard_s > -math.inf or now_s > self._heard_s + _TELLS_S
        held = (monitor.state.mission_id, monitor.state.total)
        if not is_known or now_s < self._due_s or held == self._held:
            return []
        self._held, self._read = held, {}
        self._kinds = deque((MissionType.MISSION, MissionType.FENCE))
        return self._next(now_s)

    def next_deadline(self) -> float:
        """Deadline of the current transfer (s); infinite without a transfer, as `poll` begins reads."""
        deadline_s = None if self._transfer is None else self._transfer.next_deadline()
        return math.inf if deadline_s is None else deadline_s

    def _next(self, now_s: float) -> list[Message]:
        if self._kinds:
            self._transfer = self._vehicle.download(self._kinds.popleft())
            return self._take(self._transfer.start(now_s), now_s)
        # The pause limits how often the mission is read if it changes all the time.
        self._transfer, self._tries, self._due_s = None, 0, now_s + _REST_S
        mission = self._read[MissionType.MISSION]
        fence = self._read[MissionType.FENCE].items if MissionType.FENCE in self._read else ()
        self.mission = Mission(mission.items, mission.home, fence)
        return []

    def _take(self, output: Output, now_s: float) -> list[Message]:
        out = list(output.messages)
        for event in output.events:
            if isinstance(event, DownloadComplete):
                self._read[event.mission_type] = event
                out += self._next(now_s)
            elif isinstance(event, TransferFailed) and MissionType.MISSION in self._read:
                # Not every autopilot sends its fence: keep the mission without a fence.
                self._kinds.clear()
                out += self._next(now_s)
            elif isinstance(event, TransferFailed):
                self._give_up(event.text, now_s)
        return out

    def _give_up(self, why: str, now_s: float) -> None:
        self._transfer, self._due_s = None, now_s + _READ_AGAIN_S
        self._tries += 1
        if self._tries < _TRIES:
            self._held = None
        else:
            self._tries = 0
            self._failed(f"vehicle {self._vehicle.vehicle[0]}: its mission cannot be read: {why}")


class WatchedVehicle(Contact):
    """Telemetry and link quality of one vehicle."""

    def __init__(self, vehicle: tuple[int, int]) -> None:
        super().__init__(vehicle)
        self._no_numbers: dict[str, float] = {}

    def receive(self, message: Message, now_s: float) -> None:
        """Receive a message of the vehicle's autopilot."""
        super().receive(message, now_s)
        if isinstance(message, _OF_NUMBERS):
            kind = message.get_type()
            for name in m.mavlink_map[type(message).id].fieldnames:
                value = getattr(message, name)
                if isinstance(value, float) and not math.isfinite(value):
                    self._no_numbers[f"{kind}.{name}"] = value
                else:
                    self._no_numbers.pop(f"{kind}.{name}", None)

    def _impossible(self, summary: dict[str, Any]) -> dict[str, Any]:
        checked = ((key, summary[key], *bounds) for key, bounds in _POSSIBLE.items())
        wrong = {
            key: value for key, value, low, high in checked if value is not None and not low <= value <= high
        }
        return wrong | {name: str(value) for name, value in self._no_numbers.items()}

    def summary(self, now_s: float) -> dict[str, Any]:
        """Return plain values for JSON; None for unknown values.

        Place, height and speed are unknown while the last position is older than 3 s, since a vehicle that
        loses its position sends heartbeats on.

        ``item`` is the item number from 1, without home; ``seq`` is the number in MISSION_CURRENT.
        ``impossible`` lists values outside their possible range, and message fields that are NaN.
        """
        state = self.monitor.state
        located = now_s - state.heard_s <= _SILENT_S
        summary = {
            "system_id": self.vehicle[0],
            "autopilot": self.profile.name,
            "mode": self.monitor.mode,
            "armed": state.armed,
            "latitude_deg": state.latitude_deg if located else None,
            "longitude_deg": state.longitude_deg if located else None,
            "height_m": state.height_m if located else None,
            "ground_speed_m_s": state.ground_speed_m_s if located else None,
            "item": None if state.item is None or state.total == 0 else state.item + 1,
            "seq": self.monitor.seq,
            "items": state.total,
            "battery": None if (percent := self.monitor.battery_percent) is None else percent / 100.0,
            "gps_fix": self.monitor.gps_fix,
            "satellites": self.monitor.satellites,
            "link_quality": self.link.quality,
            "lost_frames": self.link.lost_frames,
            "round_trip_s": self.link.round_trip.seconds,
            "silent_s": max(0.0, now_s - self.link.heard_s),
        }
        return summary | {"impossible": self._impossible(summary)}

    def is_silent(self, now_s: float) -> bool:
        """Return whether the vehicle has been silent for a few seconds."""
        return now_s - self.link.heard_s > _SILENT_S


class FleetWatch:
    """Ground station that watches all vehicles on its links, and gives no orders.

    The station sends a heartbeat, and requests telemetry from autopilots that stream none. With `plan_failed`
    it also reads the vehicles' missions (`PlanReader`).
    """

    system_id, component_id = GROUND_STATION
    wanted: frozenset[int] | None = None

    def __init__(self, plan_failed: Callable[[str], None] | None = None) -> None:
        self.vehicles: dict[int, WatchedVehicle] = {}  # Keys: system ids, in the order of discovery
        self._readers: dict[int, PlanReader] = {}
        self._plan_failed = plan_failed
        self._heartbeat = Heartbeat()
        self._asked_s: dict[int, float] = {}

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Receive a message."""
        if message.get_srcComponent() != m.MAV_COMP_ID_AUTOPILOT1:
            return []
        system_id = message.get_srcSystem()
        vehicle = self.vehicles.get(system_id)
        if vehicle is None:
            if vehicle_of(message) is None or len(self.vehicles) >= _MOST_VEHICLES:
                return []
            vehicle = self.vehicles[system_id] = WatchedVehicle((system_id, int(m.MAV_COMP_ID_AUTOPILOT1)))
            if self._plan_failed is not None:
                self._readers[system_id] = PlanReader(vehicle, self._plan_failed)
        vehicle.receive(message, now_s)
        reader = self._readers.get(system_id)
        return [] if reader is None else reader.receive(message, now_s)

    def poll(self, now_s: float) -> list[Message]:
        """Send the heartbeat, and requests for missing telemetry."""
        reading = [output for reader in self._readers.values() for output in reader.poll(now_s)]
        out = self._heartbeat.poll(now_s)
        if not out:
            return reading
        out += reading
        for system_id, vehicle in self.vehicles.items():
            out += vehicle.link.poll(now_s)
            if not vehicle.profile.streams_on_request:
                continue
            quiet = now_s - vehicle.monitor.position_heard_s > _ASK_AGAIN_S
            # Another ground station may have requested positions only.
            if (quiet or vehicle.monitor.gps_fix is None) and now_s - self._asked_s.get(
                system_id, -math.inf
            ) >= _ASK_AGAIN_S:
                self._asked_s[system_id] = now_s
                out.append(
                    m.MAVLink_request_data_stream_message(
                        system_id, m.MAV_COMP_ID_AUTOPILOT1, m.MAV_DATA_STREAM_ALL, _STREAM_HZ, 1
                    )
                )
        return out

    def next_deadline(self) -> float:
        """Time (s) at which the next `poll` is due."""
        return min([self._heartbeat.due_s, *(reader.next_deadline() for reader in self._readers.values())])

    @property
    def missions(self) -> dict[int, Mission]:
        """Missions that were read, by system id."""
        read = {number: reader.mission for number, reader in self._readers.items()}
        return {number: mission for number, mission in read.items() if mission is not None}

    def look(self, now_s: float) -> None:
        """Do nothing: the state is always current."""

    def seen(self) -> tuple[tuple[float, Observations], ...]:
        """Return nothing: images go to the ground station that flies the vehicle."""
        return ()
