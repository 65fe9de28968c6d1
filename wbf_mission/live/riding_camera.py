"""The leaf camera beside a real autopilot: by telemetry alone, and silent where a camera is on board."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from mission.link.codec.dialect import Message, mavlink
from mission.model import Command, Mission
from mission.transfer import profile_for
from sim_vehicle.camera.component import LeafCameraComponent
from sim_vehicle.camera.trigger import MAX_GAP_MS
from wbf_mission.ground.boot_clock import BootClock

__all__ = ["RidingCamera"]

_LISTEN_S = 2.2
_TRIGGERS = frozenset(
    {
        Command.DO_SET_CAM_TRIGG_DIST,
        mavlink.MAV_CMD_DO_SET_CAM_TRIGG_INTERVAL,
        mavlink.MAV_CMD_IMAGE_START_CAPTURE,
        mavlink.MAV_CMD_IMAGE_STOP_CAPTURE,
    }
)
_UNKNOWN_ITEM = 65535


class RidingCamera:
    """A leaf camera that rides along by telemetry alone.

    It first listens for a camera that is on board already; if there is one, it stays silent for good. An
    autopilot with a camera of its own driver commands this one, too (DO_SET_CAM_TRIGG_DIST, CAMERA_TRIGGER).
    An autopilot that commands none does not know of it: then the camera reads its orders from the mission,
    as far as MISSION_CURRENT tells that they were carried out.

    Parameters
    ----------
    camera : LeafCameraComponent
        Of the vehicle's system.
    mission : callable
        Returns the mission that the vehicle holds.

    Attributes
    ----------
    missed : int
        About how many images were not taken because nothing was heard of the vehicle.
    """

    def __init__(self, camera: LeafCameraComponent, mission: Callable[[], Mission]) -> None:
        self.system_id, self.component_id = camera.system_id, camera.component_id
        self.wanted: frozenset[int] | None = (camera.wanted or frozenset()) | {
            mavlink.MAVLINK_MSG_ID_MISSION_CURRENT
        }
        self._camera = camera
        self._mission = mission
        self._heard_s = math.inf
        self._other = False
        self._commanded = False
        self._home = 0
        self._spacing_m: float | None = None
        self._clock = BootClock()
        self._before: Any = None
        self.missed = 0

    def next_deadline(self) -> float:
        """Return when the camera has something to say."""
        if self._other:
            return math.inf
        return max(self._camera.next_deadline(), self._heard_s + _LISTEN_S)

    def poll(self, now_s: float) -> list[Message]:
        """Send the heartbeat when it is due."""
        if self._other or now_s < self._heard_s + _LISTEN_S:
            return []
        return self._camera.poll(now_s)

    def goodbye(self) -> list[Message]:
        """A last HEARTBEAT, unless it never spoke."""
        return [] if self._other or math.isinf(self._heard_s) else self._camera.goodbye()

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Follow the vehicle."""
        if message.get_srcSystem() == self.system_id and message.get_srcComponent() == self.component_id:
            self._other = True
        if self._other:
            return []
        if isinstance(message, mavlink.MAVLink_heartbeat_message) and self._is_autopilot(message):
            self._heard_s = min(self._heard_s, now_s)
            self._home = 1 if profile_for(message.autopilot).home_at_zero else 0
        if isinstance(message, mavlink.MAVLink_global_position_int_message) and self._is_autopilot(message):
            self._on_position(message, now_s)
        if isinstance(message, mavlink.MAVLink_mission_current_message):
            if self._is_autopilot(message):
                self._on_item(message.seq, now_s)
            return []
        self._commanded |= _commands_camera(message) and message.get_srcSystem() == self.system_id
        return self._camera.receive(message, now_s)

    def _on_position(self, message: mavlink.MAVLink_global_position_int_message, now_s: float) -> None:
        """Count what a silence cost; after a restart of the autopilot nobody has told the camera to shoot."""
        before, self._before = self._before, message
        restarts = self._clock.restarts
        before_ms = 0 if before is None else before.time_boot_ms + self._clock.offset_ms
        time_ms = self._clock.take(message.time_boot_ms, now_s)
        if self._clock.restarts > restarts:
            self._commanded, self._spacing_m = False, None
        spacing_m = self._camera.trigger.distance_m
        if before is not None and spacing_m > 0.0 and time_ms - before_ms > MAX_GAP_MS:
            # The way between is not known; its length is, about, by the speeds at its ends.
            speed_m_s = 0.005 * sum(math.hypot(one.vx, one.vy) for one in (before, message))
            self.missed += int(speed_m_s * (time_ms - before_ms) / 1000.0 / spacing_m)

    def _is_autopilot(self, message: Message) -> bool:
        return (
            message.get_srcSystem() == self.system_id
            and message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1
        )

    def _on_item(self, sequence: int, now_s: float) -> None:
        """Carry out what the mission orders before the item that is flown, unless the autopilot does."""
        if self._commanded or sequence == _UNKNOWN_ITEM:
            return
        spacing_m = spacing_before(self._mission(), sequence - self._home)
        if spacing_m is None or spacing_m == self._spacing_m:
            return
        self._spacing_m = spacing_m
        target, command = (self.system_id, self.component_id), int(Command.DO_SET_CAM_TRIGG_DIST)
        order = mavlink.MAVLink_command_long_message(*target, command, 0, spacing_m, 0, 1, 0, 0, 0, 0)
        self._camera.receive(order, now_s)


def spacing_before(mission: Mission, item: int) -> float | None:
    """Return the distance between images that holds while an item is flown; None while none was ordered.

    Examples
    --------
    >>> from mission.model import MissionItem
    >>> orders = [MissionItem(Command.DO_SET_CAM_TRIGG_DIST, param1=metres) for metres in (5.0, 0.0)]
    >>> leg = MissionItem(Command.NAV_WAYPOINT, x=27.0, y=-82.0, z=10.0)
    >>> mission = Mission((leg, orders[0], leg, orders[1], leg))
    >>> [spacing_before(mission, item) for item in range(5)]
    [None, None, 5.0, 5.0, 0.0]
    """
    ordered = [
        one.param1 for one in mission.items[: max(item, 0)] if one.command == Command.DO_SET_CAM_TRIGG_DIST
    ]
    return ordered[-1] if ordered else None


def _commands_camera(message: Message) -> bool:
    if isinstance(message, mavlink.MAVLink_camera_trigger_message):
        return True
    commands = (mavlink.MAVLink_command_long_message, mavlink.MAVLink_command_int_message)
    return isinstance(message, commands) and message.command in _TRIGGERS
