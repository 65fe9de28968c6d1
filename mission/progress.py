"""Progress of a vehicle along its mission, from live or logged telemetry."""

from __future__ import annotations

import numpy as np

from mission.course import Course, Place
from mission.errors import MissionError
from mission.ground.vehicle_state import VehicleMonitor
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m

__all__ = ["MissionProgress"]

# A vehicle farther from its leg is on the approach, or flies another mission.
_ON_LEG_M = 50.0


class MissionProgress:
    """Progress of a vehicle along the course of its mission.

    A position counts after a later HEARTBEAT confirms the mission mode; positions of the return home are
    discarded. `receive` expects only messages of the vehicle's autopilot.

    Parameters
    ----------
    course : Course
        Course of the mission on the vehicle.
    """

    def __init__(self, course: Course) -> None:
        self.course = course
        self.monitor = VehicleMonitor()
        self._pending: list[tuple[int, float, float]] = []
        self._flown: list[tuple[int, float, float]] = []
        self._reached = -1

    def receive(self, message: Message, now_s: float) -> None:
        """Process a message of the vehicle."""
        self.monitor.receive(message, now_s)
        if isinstance(message, m.MAVLink_heartbeat_message):
            if self._flies:
                self._flown += self._pending
            self._pending.clear()
        elif isinstance(message, m.MAVLink_mission_item_reached_message) and self._flies:
            self._reached = message.seq - (1 if self.monitor.profile.home_at_zero else 0)
        elif isinstance(message, m.MAVLink_global_position_int_message) and self._flies:
            state = self.monitor.state
            if state.item is not None and self.monitor.knows_position:
                self._pending.append((state.item, state.latitude_deg, state.longitude_deg))

    @property
    def _flies(self) -> bool:
        return self.monitor.in_mission and self.monitor.state.armed and not self.monitor.left_mission

    def place(self) -> Place | None:
        """Return the farthest place flown; None if the mission was flown to its end.

        MissionError if the vehicle never flew its mission.
        """
        if not self._flown:
            msg = "the vehicle is never seen to fly its mission by itself"
            raise MissionError(msg)
        course = self.course
        items, latitude, longitude = np.array(self._flown).T
        if items.max() >= len(course.mission.items):
            msg = (
                f"the vehicle flies item {int(items.max()) + 1}, but the mission has"
                f" {len(course.mission.items)} items: it is another mission"
            )
            raise MissionError(msg)
        if self._reached >= course.legs[-1].item:
            return None
        east, north = course.frame.from_wgs84(latitude, longitude)
        on_leg = course.aside_m(items, east, north) <= _ON_LEG_M
        if not on_leg.any():
            msg = f"the vehicle was never within {_ON_LEG_M:g} m of its leg: it is another mission"
            raise MissionError(msg)
        return course.place(float(course.along(items, east, north)[on_leg].max()))
