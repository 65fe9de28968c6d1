"""One order to one vehicle, confirmed by what the vehicle shows then, not by its answer alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from geo.errors import WbfMissionError
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.transfer import profile_for
from mission.transfer.wire import ground_heartbeat
from wbf_mission.ground.link_state import LinkState
from wbf_mission.ground.modes import (
    Maneuver,
    ModeNumbers,
    maneuver_command,
    maneuver_modes,
    mode_named,
)
from wbf_mission.ground.orders import Answer, Order, result_name
from wbf_mission.ground.station import GROUND_COMPONENT_ID, GROUND_SYSTEM_ID
from wbf_mission.ground.texts import TextLog
from wbf_mission.ground.vehicle_state import VehicleMonitor
from wbf_mission.live.errors import VehicleRefusedError, VehicleSilentError

__all__ = ["ORDERS", "CommandSession", "OrderError", "Wish"]

_HEARTBEAT_S = 1.0
_PATIENCE_S = 15.0
_ROUND_TRIPS = 12.0
_ASK_AGAIN_S = 3.0
_OFF_GROUND_M = 0.5
_FAST_US = 200_000.0
_STREAMED = (m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, m.MAVLINK_MSG_ID_MISSION_CURRENT)
ORDERS = ("arm", "disarm", "takeoff", "mission", "hold", "return", "land", "set-item", "mode")
"""What can be ordered; takeoff takes a height in metres, set-item the number of an item, mode its name."""
_TAKES = {"takeoff": "a height in metres", "set-item": "the number of an item, from 1", "mode": "a name"}


class OrderError(WbfMissionError, ValueError):
    """An order that is none, or not one for this vehicle now."""


@dataclass(frozen=True, slots=True)
class Wish:
    """What an operator wants.

    Parameters
    ----------
    order : str
        One of `ORDERS`.
    value : str
        What it takes; empty for nothing.

    Raises
    ------
    OrderError
        If there is no such order, or its value is missing or wrong.

    Examples
    --------
    >>> Wish("takeoff", "ten")
    Traceback (most recent call last):
    ...
    wbf_mission.live.commanding.OrderError: takeoff 'ten': give a height in metres
    """

    order: str
    value: str = ""

    def __post_init__(self) -> None:
        if self.order not in ORDERS:
            msg = f"order {self.order!r} is unknown; there are {', '.join(ORDERS)}"
            raise OrderError(msg)
        takes = _TAKES.get(self.order)
        if takes is None and self.value:
            msg = f"{self.order} {self.value!r}: {self.order} takes nothing more"
            raise OrderError(msg)
        if takes is not None and not self._is_sound():
            msg = f"{self.order} {self.value!r}: give {takes}"
            raise OrderError(msg)

    def _is_sound(self) -> bool:
        if self.order == "mode":
            return bool(self.value.strip())
        try:
            number = float(self.value)
        except ValueError:
            return False
        if self.order == "set-item":
            return number.is_integer() and 1 <= number < 65535
        return 0.0 < number <= 1000.0


@dataclass(slots=True)
class _Step:
    """A command, and what shows that it is carried out."""

    command: int
    params: tuple[float, ...]
    shown: Callable[[VehicleMonitor], bool]
    otherwise: Message | None = field(default=None)


class CommandSession:
    """A component that gives one order to one vehicle.

    Parameters
    ----------
    wish : Wish
    system_id : int or None
        Of the vehicle; None: the first one that is heard.

    Attributes
    ----------
    done : bool
    error : Exception or None
        Why it was not carried out.
    vehicle : tuple of int or None
        System and component, once it was heard.
    """

    system_id = GROUND_SYSTEM_ID
    component_id = GROUND_COMPONENT_ID
    wanted: frozenset[int] | None = None

    def __init__(self, wish: Wish, *, system_id: int | None = None) -> None:
        self.done = False
        self.error: Exception | None = None
        self.vehicle: tuple[int, int] | None = None
        self._wish = wish
        self._only = system_id
        self._heard = VehicleMonitor()
        self._link = LinkState()
        self._texts = TextLog()
        self._step: _Step | None = None
        self._order: Order | None = None
        self._accepted = False
        self._begun_s = math.inf
        self._heartbeat_s = self._streams_s = -math.inf

    @property
    def mode(self) -> str:
        """Name of the vehicle's flight mode."""
        return self._heard.mode

    @property
    def texts(self) -> list[str]:
        """What the vehicle said meanwhile."""
        return [text for _, _, text in self._texts.texts]

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Take one message."""
        source = (message.get_srcSystem(), message.get_srcComponent())
        if self.done or source[1] != m.MAV_COMP_ID_AUTOPILOT1 or self._only not in (None, source[0]):
            return []
        if self.vehicle is None and isinstance(message, m.MAVLink_heartbeat_message):
            self.vehicle, self._begun_s = source, now_s
            self._link.receive(message, now_s)
            return self._note(message, now_s)
        if source != self.vehicle:
            return []
        self._link.receive(message, now_s)
        return self._note(message, now_s)

    def poll(self, now_s: float) -> list[Message]:
        """Send what is due."""
        if self.done:
            return []
        out: list[Message] = []
        if now_s >= self._heartbeat_s:
            self._heartbeat_s = now_s + _HEARTBEAT_S
            out.append(ground_heartbeat())
        out += self._link.poll(now_s)
        if self.vehicle is not None and now_s >= self._streams_s:
            self._streams_s = now_s + _ASK_AGAIN_S
            out += self._ask_for_streams()
        if self._order is not None and now_s >= self._order.due_s:
            if self._order.is_given_up:
                self._fail(VehicleSilentError(f"{self._name}: no answer to {self._wish.order}"))
            else:
                out += self._order.send(now_s)
        if now_s >= self._end_s:
            self._fail(self._not_shown())
        return out

    def next_deadline(self) -> float:
        """When `poll` has something to do."""
        if self.done:
            return math.inf
        order_s = math.inf if self._order is None else self._order.due_s
        streams_s = math.inf if self.vehicle is None else self._streams_s
        return min(self._heartbeat_s, self._end_s, order_s, streams_s, self._link.next_deadline())

    @property
    def _end_s(self) -> float:
        """When the vehicle has to have shown that it obeys; later over a slow link, whose orders repeat."""
        return self._begun_s + _PATIENCE_S + _ROUND_TRIPS * (self._link.round_trip.known_s or 0.0)

    @property
    def _name(self) -> str:
        return "vehicle" if self.vehicle is None else f"system {self.vehicle[0]}"

    def _ask_for_streams(self) -> list[Message]:
        """Ask for what shows that it obeys; again and again, for a request may get lost."""
        assert self.vehicle is not None
        interval = int(m.MAV_CMD_SET_MESSAGE_INTERVAL)
        return [
            m.MAVLink_command_long_message(*self.vehicle, interval, 0, kind, _FAST_US, 0, 0, 0, 0, 0)
            for kind in _STREAMED
        ]

    def _note(self, message: Message, now_s: float) -> list[Message]:
        heard = self._heard
        if isinstance(message, m.MAVLink_heartbeat_message):
            heard.on_heartbeat(message, now_s)
        elif isinstance(message, m.MAVLink_global_position_int_message):
            heard.on_position(message, now_s)
        elif isinstance(message, m.MAVLink_mission_current_message):
            heard.on_mission_current(message, now_s)
        elif isinstance(message, m.MAVLink_statustext_message):
            self._texts.on_text(message, now_s)
        elif isinstance(message, m.MAVLink_command_ack_message):
            return self._on_ack(message, now_s)
        if self._step is None:
            return self._begin(now_s)
        if self._accepted and self._step.shown(heard):
            self.done = True
        return []

    def _begin(self, now_s: float) -> list[Message]:
        """Give the order, once all is known that it takes."""
        if self._wish.order == "takeoff" and self._heard.position_heard_s == -math.inf:
            return []
        try:
            self._step = self._step_of(self._wish)
        except WbfMissionError as error:
            self._fail(error)
            return []
        assert self.vehicle is not None
        self._order = Order(
            self.vehicle, self._step.command, *self._step.params, round_trip=self._link.round_trip
        )
        return self._order.send(now_s)

    def _on_ack(self, message: m.MAVLink_command_ack_message, now_s: float) -> list[Message]:
        if self._order is None or self._step is None:
            return []
        answer = self._order.answer(message, now_s)
        if answer is Answer.NONE:
            return []
        self._order = None
        if answer is Answer.ACCEPTED:
            self._accepted = True
            return []
        if self._step.otherwise is not None and message.result == m.MAV_RESULT_UNSUPPORTED:
            self._accepted = True
            return [self._step.otherwise]
        text = self._texts.last_warning(result_name(message.result))
        self._fail(VehicleRefusedError(f"{self._name} refused {self._wish.order}: {text}"))
        return []

    def _step_of(self, wish: Wish) -> _Step:
        """Return the command of an order for this vehicle."""
        heard, vehicle = self._heard, self.vehicle
        assert vehicle is not None
        kind = (heard.autopilot, heard.vehicle_type)
        if wish.order in ("arm", "disarm"):
            wanted = wish.order == "arm"
            return _Step(
                m.MAV_CMD_COMPONENT_ARM_DISARM, (float(wanted),), lambda one: one.state.armed == wanted
            )
        if wish.order == "takeoff":
            return self._takeoff(float(wish.value))
        if wish.order == "mission":
            return _Step(m.MAV_CMD_MISSION_START, (), lambda one: one.in_mission)
        if wish.order == "set-item":
            item = int(float(wish.value)) - 1
            seq = item + (1 if profile_for(heard.autopilot).home_at_zero else 0)
            by_message = m.MAVLink_mission_set_current_message(*vehicle, seq)
            command = m.MAV_CMD_DO_SET_MISSION_CURRENT
            return _Step(command, (float(seq),), lambda one: one.state.item == item, by_message)
        if wish.order == "mode":
            return _to_mode(mode_named(*kind, wish.value), _spoken(kind, wish.value))
        maneuver = Maneuver(wish.order)
        modes = maneuver_modes(maneuver, *kind)
        command, params = maneuver_command(maneuver, *kind)
        return _Step(command, params, lambda one: one.mode in modes if modes else not one.in_mission)

    def _takeoff(self, height_m: float) -> _Step:
        heard = self._heard
        if not heard.state.armed:
            msg = "takeoff: the motors stand still; arm first"
            raise OrderError(msg)
        # Above sea level; ArduPilot counts from home.
        from_home = heard.autopilot == m.MAV_AUTOPILOT_ARDUPILOTMEGA
        altitude_m = height_m if from_home else height_m + heard.home_altitude_m
        params = (0.0, 0.0, 0.0, math.nan, math.nan, math.nan, altitude_m)
        if from_home:
            params = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, altitude_m)
        return _Step(m.MAV_CMD_NAV_TAKEOFF, params, lambda one: one.state.height_m > _OFF_GROUND_M)

    def _not_shown(self) -> Exception:
        if self._accepted:
            text = self._texts.last_warning(f"mode {self.mode}")
            shown = f"does not show it in {self._end_s - self._begun_s:.0f} s: {text}"
            return VehicleRefusedError(f"{self._name} accepted {self._wish.order}, but {shown}")
        return VehicleSilentError(f"{self._name}: no answer to {self._wish.order}")

    def _fail(self, error: Exception) -> None:
        self.error, self.done, self._order = error, True, None


def _to_mode(numbers: ModeNumbers, name: str) -> _Step:
    params = (numbers.base, numbers.main, numbers.sub)
    return _Step(m.MAV_CMD_DO_SET_MODE, params, lambda one: one.mode == name)


def _spoken(kind: tuple[int, int], name: str) -> str:
    """Return how HEARTBEAT's mode is called then."""
    wanted = name.strip().upper()
    return "LOITER" if wanted == "HOLD" and kind[0] == m.MAV_AUTOPILOT_PX4 else wanted
