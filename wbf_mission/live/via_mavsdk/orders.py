"""What a ground station sends to its vehicle, carried out by MAVSDK's plugins."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mavsdk.plugins.action import Action
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectResult, MavlinkMessage
from mavsdk.plugins.mission_raw import MissionRaw

from mission.ground.modes import Maneuver, VehicleModes
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import FrameReader, FrameWriter
from mission.model import Command
from wbf_mission.live.via_mavsdk.link import Call, MavsdkLink

__all__ = ["MavsdkOrders"]

_Commanding = m.MAVLink_command_long_message | m.MAVLink_command_int_message
_AUTOPILOT = int(m.MAV_COMP_ID_AUTOPILOT1)
# What the vehicle says of a refusal may come after it.
_WORDS_S = 0.3
_RESULTS = {
    "SUCCESS": m.MAV_RESULT_ACCEPTED,
    "BUSY": m.MAV_RESULT_TEMPORARILY_REJECTED,
    "UNSUPPORTED": m.MAV_RESULT_UNSUPPORTED,
    "COMMAND_DENIED": m.MAV_RESULT_DENIED,
    "COMMAND_DENIED_LANDED_STATE_UNKNOWN": m.MAV_RESULT_DENIED,
    "COMMAND_DENIED_NOT_LANDED": m.MAV_RESULT_DENIED,
    "DENIED": m.MAV_RESULT_DENIED,
}
_NO_ANSWER = frozenset({"TIMEOUT", "NO_SYSTEM", "CONNECTION_ERROR"})


@dataclass(slots=True)
class _Order:
    """A command that MAVSDK carries out.

    ``due_s`` is when its answer is handed on.
    """

    command: int
    name: str
    call: Call
    result: int | None = None
    due_s: float = 0.0


class MavsdkOrders:
    """Carries out what a ground station would send to an autopilot; what comes of it is a COMMAND_ACK again.

    Arming, return, landing and PX4's hold go by the plugin action, the mission's start by mission_raw.
    Every other command goes by mavlink_direct, which repeats it, too: other modes (MAVSDK's hold of an
    ArduCopter is LOITER, in which it sinks without a stick), rates of messages, and the start of an
    ArduCopter's mission, which takes off at MISSION_START only (MAVSDK's start_mission chooses the mode).

    MISSION_SET_CURRENT is not for MAVSDK: its set_current_mission_item sends it again at each MISSION_CURRENT
    that names another item, without end if a vehicle goes on from a command to its next waypoint at once.
    """

    def __init__(
        self,
        link: MavsdkLink,
        system_id: int,
        autopilot: int,
        vehicle_type: int,
        note: Callable[[str], None],
    ) -> None:
        self._link, self._system_id, self._note = link, system_id, note
        self._is_px4 = autopilot == m.MAV_AUTOPILOT_PX4
        self._hold = VehicleModes(autopilot, vehicle_type).maneuver(Maneuver.HOLD)
        self._orders: list[_Order] = []
        self._writer = FrameWriter(system_id, _AUTOPILOT)

    @property
    def waiting(self) -> bool:
        """Whether MAVSDK has not answered everything yet."""
        return bool(self._orders)

    def takes(self, message: Message) -> bool:
        """Return whether a message of the ground station is an order to the autopilot, and so for MAVSDK."""
        if not isinstance(message, _Commanding):
            return False
        return (message.target_system, message.target_component) == (self._system_id, _AUTOPILOT)

    def carry_out(self, message: Message) -> list[Message]:
        """Let MAVSDK do what a message asks for; return what can be answered at once."""
        assert isinstance(message, _Commanding)
        if any(one.command == message.command for one in self._orders) and not _is_setting(message):
            # It is under way; MAVSDK repeats it by itself.
            return [self._ack(message.command, int(m.MAV_RESULT_IN_PROGRESS))]
        name, begin, arguments = self._function(message)
        self._orders.append(_Order(message.command, name, Call(begin, *arguments)))
        return []

    def answers(self, now_s: float) -> list[Message]:
        """Return what MAVSDK has answered since the last call, as the vehicle would."""
        done: list[Message] = []
        for order in list(self._orders):
            if order.result is None:
                self._take_answer(order, now_s)
            if order.result is not None and now_s >= order.due_s:
                self._orders.remove(order)
                if order.result >= 0:
                    done.append(self._ack(order.command, order.result))
        return done

    def _take_answer(self, order: _Order, now_s: float) -> None:
        """Take MAVSDK's answer, if there is one; -1 is none of the vehicle."""
        answer = order.call.answer()
        if answer is None:
            return
        result = answer[0]
        if result is MavlinkDirectResult.SUCCESS:
            order.result = int(json.loads(answer[1].fields_json)["result"])
        elif result.name in _NO_ANSWER:
            order.result = -1
        else:
            order.result = int(_RESULTS.get(result.name, m.MAV_RESULT_FAILED))
        order.due_s = now_s
        if order.result != m.MAV_RESULT_ACCEPTED:
            order.due_s = now_s + _WORDS_S
            if result is not MavlinkDirectResult.SUCCESS:
                self._note(f"MAVSDK: {order.name}: {result.name}")

    def _function(self, message: _Commanding) -> tuple[str, Callable[..., None], tuple[Any, ...]]:
        """Return MAVSDK's function for a command: its name, itself, and what it takes."""
        params = (message.param1, message.param2, message.param3)
        wanted = (message.command, params)
        action = self._plugin(Action)
        if wanted == (m.MAV_CMD_COMPONENT_ARM_DISARM, (1.0, 0.0, 0.0)):
            return "arm", action.arm_async, ()
        if message.command == Command.NAV_RETURN_TO_LAUNCH:
            return "return_to_launch", action.return_to_launch_async, ()
        if message.command == Command.NAV_LAND:
            return "land", action.land_async, ()
        if self._is_px4 and wanted == self._hold:
            return "hold", action.hold_async, ()
        if self._is_px4 and message.command == m.MAV_CMD_MISSION_START:
            return "start_mission", self._plugin(MissionRaw).start_mission_async, ()
        return "send_command", self._plugin(MavlinkDirect).send_command_async, (self._direct(message),)

    def _plugin(self, kind: type) -> Any:
        return self._link.plugin(kind, self._system_id)

    def _direct(self, message: Message) -> MavlinkMessage:
        fields = {name: getattr(message, name) for name in type(message).fieldnames}
        return MavlinkMessage(
            message_name=message.get_type(),
            target_system_id=self._system_id,
            target_component_id=_AUTOPILOT,
            fields_json=json.dumps(fields),
        )

    def _ack(self, command: int, result: int) -> Message:
        """Return the COMMAND_ACK that the vehicle would have sent."""
        frame = self._writer.encode(m.MAVLink_command_ack_message(command, result))
        return FrameReader().feed(frame)[0]


def _is_setting(message: _Commanding) -> bool:
    """Return whether such a command is sent for one thing after the other: rates of messages."""
    return message.command == m.MAV_CMD_SET_MESSAGE_INTERVAL
