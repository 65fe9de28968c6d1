"""Watching any number of vehicles on a link: what each told last, and how well it is heard."""

from __future__ import annotations

import math
from typing import Any

from mission.ground.contact import Contact, Heartbeat
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.transfer.wire import GROUND_STATION

__all__ = ["FleetWatch", "WatchedVehicle"]

_STREAM_HZ = 2
_ASK_AGAIN_S = 5.0
_SILENT_S = 3.0
_MOST_VEHICLES = 250


class WatchedVehicle(Contact):
    """One vehicle: what it told, and how well it is heard."""

    def summary(self, now_s: float) -> dict[str, Any]:
        """Return plain values for JSON; what is not known is None.

        ``item`` counts from 1, without home; ``seq`` is MISSION_CURRENT's own number.
        """
        state = self.monitor.state
        located = state.heard_s > -math.inf
        return {
            "system_id": self.vehicle[0],
            "autopilot": self.profile.name,
            "mode": self.monitor.mode,
            "armed": state.armed,
            "latitude_deg": state.latitude_deg if located else None,
            "longitude_deg": state.longitude_deg if located else None,
            "height_m": state.height_m if located else None,
            "ground_speed_m_s": state.ground_speed_m_s if located else None,
            "item": None if state.item is None else state.item + 1,
            "seq": self.monitor.seq,
            "items": state.total,
            "battery": state.battery.remaining,
            "gps_fix": self.monitor.gps_fix,
            "satellites": self.monitor.satellites,
            "link_quality": self.link.quality,
            "lost_frames": self.link.lost_frames,
            "round_trip_s": self.link.round_trip.seconds,
            "silent_s": max(0.0, now_s - self.link.heard_s),
        }

    def is_silent(self, now_s: float) -> bool:
        """Whether nothing was heard of it for a while."""
        return now_s - self.link.heard_s > _SILENT_S


class FleetWatch:
    """A ground station that only listens, to all vehicles that are there.

    It sends a heartbeat, and asks autopilots that stream nothing unasked for their telemetry.
    """

    system_id, component_id = GROUND_STATION
    wanted: frozenset[int] | None = None

    def __init__(self) -> None:
        self.vehicles: dict[int, WatchedVehicle] = {}  # By system id, as they were heard
        self._heartbeat = Heartbeat()
        self._asked_s: dict[int, float] = {}

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Take one message."""
        if message.get_srcComponent() != m.MAV_COMP_ID_AUTOPILOT1:
            return []
        system_id = message.get_srcSystem()
        vehicle = self.vehicles.get(system_id)
        if vehicle is None:
            is_beat = isinstance(message, m.MAVLink_heartbeat_message)
            if not is_beat or len(self.vehicles) >= _MOST_VEHICLES:
                return []
            vehicle = self.vehicles[system_id] = WatchedVehicle((system_id, int(m.MAV_COMP_ID_AUTOPILOT1)))
        vehicle.receive(message, now_s)
        return []

    def poll(self, now_s: float) -> list[Message]:
        """Send the heartbeat, and requests for telemetry that does not come."""
        out = self._heartbeat.poll(now_s)
        if not out:
            return []
        for system_id, vehicle in self.vehicles.items():
            out += vehicle.link.poll(now_s)
            if not vehicle.profile.streams_on_request:
                continue
            quiet = now_s - vehicle.monitor.position_heard_s > _ASK_AGAIN_S
            # Another ground station may have asked for positions alone.
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
        """When `poll` has something to do."""
        return self._heartbeat.due_s
