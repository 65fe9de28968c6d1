"""Leaf camera for a real autopilot: follows its telemetry, and stays silent if a camera is on board."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

from mission.autopilots import profile_for
from mission.ground.items import Shots, apart_m, is_return, shots_before
from mission.ground.modes import VehicleModes, is_in_mission, mode_name
from mission.ground.vehicle_state import BootClock
from mission.link.codec.dialect import Message, mavlink
from mission.link.codec.typed import CommandMessage, is_a, is_command
from mission.model import Command, Mission, MissionItem
from mission.transfer.wire import command_long
from sim_vehicle.camera.component import LeafCameraComponent
from sim_vehicle.camera.trigger import MAX_GAP_MS

_Place = tuple[float, float]
_PATIENCE_S = 2.0
_CORNER = 0.7
"""Measured shortening of the path at a corner, as a fraction of the difference between corner and chord."""


class MissionShots:
    """Decides when a camera command of the mission applies that the autopilot may still send itself.

    If the autopilot commands the camera, the mission's command applies after a short delay, since the
    autopilot's command may still arrive; otherwise it applies at once. A lost, late or reordered command
    therefore has an effect only until the end of this delay. A ground station's command holds until the
    mission's command changes. If the autopilot triggers single images, no command of the mission applies.
    """

    def __init__(self) -> None:
        self.commanded = self.single = False
        self._ordered: Shots | None = None
        self._overruled: Shots | None = None
        self._differs_s = math.inf

    def restart(self) -> None:
        """Forget the commands, after a restart of the vehicle."""
        self.commanded = self.single = False
        self._overruled, self._differs_s = None, math.inf

    def overrule(self) -> None:
        """Note a ground station's command to the camera."""
        self._overruled = self._ordered

    def due(self, ordered: Shots | None, does: Shots, now_s: float, *, may_stop: bool) -> bool:
        """Return whether to apply the mission's camera command now.

        `may_stop` is false during a mission change: an item number of the old mission, applied to the new
        mission, must not stop the images.
        """
        self._ordered = ordered
        if ordered != self._overruled:
            self._overruled = None
        settled = ordered is None or self._overruled is not None or ordered.is_same(does)
        if ordered is None or settled or self.single or (ordered.is_off and not may_stop):
            self._differs_s = math.inf
            return False
        self._differs_s = min(self._differs_s, now_s)
        if self.commanded and now_s < self._differs_s + _PATIENCE_S:
            return False
        self._differs_s = math.inf
        return True


@dataclass(frozen=True, slots=True)
class Seen:
    """Place of the vehicle when it reported an item, and distance flown between this place and the gap."""

    place: _Place
    metres: float = 0.0


@dataclass(frozen=True, slots=True)
class Silence:
    """A gap in a vehicle's telemetry, with positions before and after."""

    before: _Place
    after: _Place
    item: int  # Last mission item before the gap; -1 if none
    seconds: float
    shots: Shots
    reach_m: float = math.inf  # Most that the vehicle can have flown, by the greatest reported speed
    lead: Seen | None = None  # From the last item report to the start of the gap
    tail: Seen | None = None  # From the end of the gap to the next item report


def images_in(silence: Silence, mission: Mission, item: int) -> int:
    """Return the approximate number of images that the mission orders during a telemetry gap.

    The path leads along the items' positions, from the last item report before the gap to the first item
    report after it. The observed parts of the path at both ends are left out. The vehicle's speed along the
    path is taken as constant. Without a camera command, the camera continues as before the gap.

    An ``item`` equal to or above the number of items means that the mission is over.
    """
    items = mission.items
    first, last = silence.item, min(item, len(items) - 1)
    known = range(first, last + 1) if first >= 0 else ()
    passed = [k for k in known if items[k].has_position and not is_return(items[k])]
    if not passed:
        # Outside a mission, the camera follows its last command. In a mission, the vehicle hovered during the
        # gap, or its mission was replaced.
        shots = (shots_before(items, last) if first >= 0 else None) or silence.shots
        return _images([(apart_m(silence.before, silence.after), shots)], silence)
    lead, tail = silence.lead or Seen(silence.before), silence.tail or Seen(silence.after)
    orders = [shots_before(items, k) or silence.shots for k in passed]
    if passed[-1] == last:
        passed.pop()
    else:
        orders.append(Shots())  # Flight home
    corners = [((items[k].x, items[k].y), _radius_m(items[k])) for k in passed]
    if corners and apart_m(corners[-1][0], tail.place) <= corners[-1][1]:
        # The vehicle is within the acceptance radius, but has not turned yet.
        corners.pop()
    legs = list(zip(_lengths_m(lead.place, corners, tail.place), orders, strict=False))
    return _images(_without(_without(legs, lead.metres)[::-1], tail.metres), silence)


def _radius_m(item: MissionItem) -> float:
    """Return the acceptance radius of a waypoint (m), 0 for other items."""
    return max(item.param2 or 0.0, 0.0) if item.command == Command.NAV_WAYPOINT else 0.0


def _lengths_m(begin: _Place, corners: Sequence[tuple[_Place, float]], end: _Place) -> list[float]:
    """Return the leg lengths of a path that cuts its corners within their acceptance radii (m)."""
    way = [begin, *(place for place, _ in corners), end]
    straight_m = [apart_m(*leg) for leg in pairwise(way)]
    lengths_m = straight_m[:]
    for k, (corner, radius_m) in enumerate(corners):
        cut_m = min(radius_m, 0.5 * straight_m[k], 0.5 * straight_m[k + 1])
        if cut_m > 0.0:
            chord_m = apart_m(
                _toward(corner, way[k], cut_m / straight_m[k]),
                _toward(corner, way[k + 2], cut_m / straight_m[k + 1]),
            )
            saved_m = _CORNER * (2.0 * cut_m - chord_m)
            lengths_m[k] -= 0.5 * saved_m
            lengths_m[k + 1] -= 0.5 * saved_m
    return lengths_m


def _toward(a: _Place, b: _Place, part: float) -> _Place:
    return a[0] + part * (b[0] - a[0]), a[1] + part * math.remainder(b[1] - a[1], 360.0)


def _without(legs: Sequence[tuple[float, Shots]], metres: float) -> list[tuple[float, Shots]]:
    """Return the legs without their first `metres`."""
    rest = []
    for length_m, shots in legs:
        off_m = min(length_m, metres)
        metres -= off_m
        rest.append((length_m - off_m, shots))
    return rest


def _images(legs: list[tuple[float, Shots]], silence: Silence) -> int:
    """Return the number of images on legs, given as pairs of length (m) and camera command.

    Legs longer than the vehicle can have flown, such as legs of a replaced mission, are shortened.
    """
    whole_m = sum(length_m for length_m, _ in legs)
    flown = min(1.0, silence.reach_m / whole_m) if whole_m > 0.0 else 1.0
    images = 0.0
    for length_m, shots in legs:
        share = length_m / whole_m if whole_m > 0.0 else 1.0 / len(legs)
        if shots.distance_m > 0.0:
            images += flown * length_m / shots.distance_m
        elif shots.interval_ms > 0.0:
            images += min(1000.0 * share * silence.seconds / shots.interval_ms, shots.images)
    return int(images)


def _place(position: mavlink.MAVLink_global_position_int_message) -> _Place:
    return position.lat / 1e7, position.lon / 1e7


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
    """Leaf camera that follows a vehicle by telemetry alone.

    This component first listens for a camera on board; if a camera is on board, it stays silent for good. An
    autopilot with a camera driver also commands this camera (DO_SET_CAM_TRIGG_DIST, CAMERA_TRIGGER). Such a
    command may be lost or late, and other autopilots send no commands. In a mission, therefore, the camera
    obeys the last camera command before the item in MISSION_CURRENT (`MissionShots`). It obeys a stop in any
    mode, because PX4 reports the last item, the return, only after it has switched to return mode.
    """

    def __init__(
        self,
        camera: LeafCameraComponent,
        mission: Callable[[], Mission],
        changing: Callable[[], bool] = lambda: False,
        follow: Callable[[Message, float], None] = lambda _message, _now_s: None,
    ) -> None:
        self.system_id, self.component_id = camera.system_id, camera.component_id
        self.wanted: frozenset[int] | None = (camera.wanted or frozenset()) | {
            mavlink.MAVLINK_MSG_ID_MISSION_CURRENT
        }
        self._camera = camera
        self._mission, self._changing, self._follow = mission, changing, follow
        self._heard_s = math.inf
        self._other = False
        self._shots = MissionShots()
        self._in_mission = self._returns = False
        self._home = 0
        self._clock = BootClock()
        self._before: Any = None
        self._item = -1
        self._seen: Seen | None = None
        # Item, place and camera command at the last position
        self._then: tuple[int, Seen | None, Shots] = (-1, None, Shots())
        self._silence: Silence | None = None
        self._fastest_m_s = 0.0
        self.missed = 0

    def next_deadline(self) -> float:
        """Return the time of the next heartbeat (s)."""
        if self._other:
            return math.inf
        return max(self._camera.next_deadline(), self._heard_s + _LISTEN_S)

    def poll(self, now_s: float) -> list[Message]:
        """Send the due heartbeat."""
        return [] if self._other or now_s < self._heard_s + _LISTEN_S else self._camera.poll(now_s)

    def goodbye(self) -> list[Message]:
        """Return a last HEARTBEAT, unless the camera never sent one."""
        return [] if self._other or math.isinf(self._heard_s) else self._camera.goodbye()

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Receive a message, and follow the vehicle."""
        source = (message.get_srcSystem(), message.get_srcComponent())
        is_autopilot = source == (self.system_id, mavlink.MAV_COMP_ID_AUTOPILOT1)
        if is_autopilot:
            self._follow(message, now_s)
        self._other |= source == (self.system_id, self.component_id)
        if self._other:
            return []
        if isinstance(message, mavlink.MAVLink_mission_current_message):
            return self._on_item(message.seq, now_s) if is_autopilot else []
        if is_command(message):
            self._on_command(message)
        elif is_autopilot and isinstance(message, mavlink.MAVLink_heartbeat_message):
            self._on_heartbeat(message, now_s)
        elif is_autopilot and isinstance(message, mavlink.MAVLink_global_position_int_message):
            self._on_position(message, now_s)
        elif is_autopilot and isinstance(message, mavlink.MAVLink_camera_trigger_message):
            self._on_single()
        return self._camera.receive(message, now_s)

    def _on_heartbeat(self, message: mavlink.MAVLink_heartbeat_message, now_s: float) -> None:
        self._heard_s = min(self._heard_s, now_s)
        self._home = int(profile_for(message.autopilot).home_at_zero)
        armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        self._in_mission = armed and is_in_mission(message)
        # A vehicle in this mode has ended its mission only if it enters the mode for nothing but the final
        # return.
        ends = VehicleModes(message.autopilot, message.type).ends(Command.NAV_RETURN_TO_LAUNCH)
        self._returns = armed and ends == {mode_name(message)}

    def _on_command(self, message: CommandMessage) -> None:
        """Note whether the autopilot or a ground station commands the camera."""
        system, component = message.target_system, message.target_component
        mine = system in (0, self.system_id) and component in (0, self.component_id)
        if not mine or message.command not in _TRIGGERS:
            return
        if message.get_srcSystem() != self.system_id:
            self._shots.overrule()
        elif message.command == mavlink.MAV_CMD_IMAGE_START_CAPTURE and message.param3 == 1.0:
            self._on_single()
        else:
            self._shots.commanded = True

    def _on_single(self) -> None:
        """Stop the camera's series: the autopilot triggers single images, which would be taken twice."""
        if not self._shots.single:
            self._shots.single = True
            self._camera.trigger.stop()

    def _on_position(self, message: mavlink.MAVLink_global_position_int_message, now_s: float) -> None:
        """Note a telemetry gap, to count missed images; reset after a restart of the autopilot."""
        before, (item, lead, did) = self._before, self._then
        self._before = message
        self._fastest_m_s = max(self._fastest_m_s, math.hypot(message.vx, message.vy) / 100.0)
        restarts = self._clock.restarts
        before_ms = 0 if before is None else before.time_boot_ms + self._clock.offset_ms
        time_ms = self._clock.take(message.time_boot_ms, now_s)
        if self._clock.restarts > restarts:
            self._shots.restart()
        if before is not None:
            places = (_place(before), _place(message))
            if time_ms - before_ms > MAX_GAP_MS:
                # The next item report shows the mission's progress during the gap.
                seconds = (time_ms - before_ms) / 1000.0
                reach_m = max(self._fastest_m_s * seconds, apart_m(*places))
                silence = self._silence or Silence(*places, item, 0.0, did, 0.0, lead)
                self._silence = replace(
                    silence,
                    after=places[1],
                    seconds=silence.seconds + seconds,
                    reach_m=silence.reach_m + reach_m,
                )
                self._seen = Seen(places[1])
            elif self._seen is not None:
                self._seen = replace(self._seen, metres=self._seen.metres + apart_m(*places))
        # After a gap, the vehicle may report its item before its position.
        self._then = (self._item, self._seen, self._does)

    @property
    def _does(self) -> Shots:
        """Distance or interval of the camera's automatic images at present."""
        trigger = self._camera.trigger
        return Shots(trigger.distance_m, trigger.interval_us / 1000.0)

    def _on_item(self, sequence: int, now_s: float) -> list[Message]:
        """Apply the mission's last camera command before the current item, if it is due."""
        if sequence == _UNKNOWN_ITEM:
            return []
        here = None if self._before is None else _place(self._before)
        silence, self._silence = self._silence, None
        if silence is not None and here is not None and self._seen is not None:
            mission = self._mission()
            # Some autopilots report the first item again after the end of the mission.
            item = sequence - self._home if self._in_mission else len(mission.items)
            silence = replace(silence, tail=Seen(here, self._seen.metres))
            self.missed += images_in(silence, mission, item)
        self._seen = None if here is None else Seen(here)
        item = sequence - self._home
        self._item = item if self._in_mission else -1
        ordered = Shots() if self._returns else shots_before(self._mission().items, item)
        if ordered is not None and ordered.images < math.inf:
            ordered = None  # Only the autopilot knows how many images of this series have been taken
        if not self._in_mission and (ordered is None or not ordered.is_off):
            return []
        if not self._shots.due(ordered, self._does, now_s, may_stop=not self._changing()):
            return []
        assert ordered is not None
        by_time = ordered.interval_ms > 0.0
        command = Command.DO_SET_CAM_TRIGG_INTERVAL if by_time else Command.DO_SET_CAM_TRIGG_DIST
        value = ordered.interval_ms if by_time else ordered.distance_m
        order = command_long((self.system_id, self.component_id), command, value, 0.0, 1.0)
        # The answers include the first image. The COMMAND_ACK is dropped, because nobody waits for it.
        answers = self._camera.receive(order, now_s)
        return [answer for answer in answers if not is_a(answer, mavlink.MAVLink_command_ack_message)]
