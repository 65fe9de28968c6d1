"""MAVSDK as the connection to a vehicle: MAVSDK opens the link, uploads, and sends commands."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from mavsdk.plugins.action import Action
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectResult, MavlinkMessage
from mavsdk.plugins.mission_raw import MissionRaw

from mission.ground.modes import Maneuver, VehicleModes
from mission.ground.station import GroundStation
from mission.link import MavlinkEndpoint
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import FrameReader, FrameWriter
from mission.link.codec.typed import is_a
from mission.model import Command
from mission.transfer import TransferMaker
from mission.transfer.driver import OnEvent, OnText, TransferDriver
from mission.transfer.vehicles import Vehicle
from mission.transfer.wire import GROUND_STATION
from sim_vehicle.component import Component
from wbf_mission.addons.base.links import Heard, LinkHost, LiveFlightError, Note, Tap, Via
from wbf_mission.addons.mavsdk.link import Call, MavsdkLink, mavsdk_transfers
from wbf_mission.scenario import Scenario

_POLL_S = 0.02
_Commanding = m.MAVLink_command_long_message | m.MAVLink_command_int_message
_AUTOPILOT = int(m.MAV_COMP_ID_AUTOPILOT1)
# Time to wait, after a refusal, for the vehicle's STATUSTEXT with the reason.
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
    """A command that MAVSDK carries out for the ground station.

    The answer is delivered to the ground station at `due_s`.
    """

    command: int
    name: str
    call: Call
    result: int | None = None
    due_s: float = 0.0


class MavsdkOrders:
    """Commands to the autopilot, carried out by MAVSDK; each result is returned as a COMMAND_ACK.

    Arming, return, landing and PX4's hold use the plugin action; the start of a PX4's mission uses
    mission_raw. All other commands use mavlink_direct, which also retries. Hold on an ArduCopter uses
    mavlink_direct, too: MAVSDK's hold sets LOITER, in which a copter without sticks sinks. So does its
    mission start: ArduCopter takes off at MISSION_START; MAVSDK's start_mission sets only the mode.

    MAVSDK does not send MISSION_SET_CURRENT. Its set_current_mission_item would repeat the message whenever
    the vehicle reports another current item: for ever, if the vehicle completes the item at once.
    """

    def __init__(self, link: MavsdkLink, vehicle: Vehicle, note: Note) -> None:
        self._link, self._system_id, self._note = link, vehicle.system_id, note
        # MAVSDK's plugin and function, by command and the command's first three parameters (None: any).
        self._functions: dict[tuple[int, tuple[float, ...] | None], tuple[type, str]] = {
            (m.MAV_CMD_COMPONENT_ARM_DISARM, (1.0, 0.0, 0.0)): (Action, "arm"),
            (Command.NAV_RETURN_TO_LAUNCH, None): (Action, "return_to_launch"),
            (Command.NAV_LAND, None): (Action, "land"),
        }
        if vehicle.autopilot == m.MAV_AUTOPILOT_PX4:
            hold = VehicleModes(vehicle.autopilot, vehicle.vehicle_type).maneuver(Maneuver.HOLD)
            self._functions |= {
                hold: (Action, "hold"),
                (m.MAV_CMD_MISSION_START, None): (MissionRaw, "start_mission"),
            }
        self._orders: list[_Order] = []
        self._writer = FrameWriter(vehicle.system_id, _AUTOPILOT)

    @property
    def waiting(self) -> bool:
        """Whether commands are still unanswered."""
        return bool(self._orders)

    def takes(self, message: Message) -> bool:
        """Return whether a message of the ground station is a command to the autopilot."""
        if not isinstance(message, _Commanding):
            return False
        return (message.target_system, message.target_component) == (self._system_id, _AUTOPILOT)

    def carry_out(self, message: Message) -> list[Message]:
        """Start a command, and return the messages that answer it at once."""
        assert isinstance(message, _Commanding)
        # Several message rates may be pending. Repeats of other commands are dropped: MAVSDK retries itself.
        is_rate = message.command == m.MAV_CMD_SET_MESSAGE_INTERVAL
        if not is_rate and any(order.command == message.command for order in self._orders):
            return [self._ack(message.command, int(m.MAV_RESULT_IN_PROGRESS))]
        name, begin, arguments = self._function(message)
        self._orders.append(_Order(message.command, name, Call(begin, *arguments)))
        return []

    def answers(self, now_s: float) -> list[Message]:
        """Return the COMMAND_ACKs of all commands answered since the last call."""
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
        """Read MAVSDK's answer, if any; a result of -1 means that the vehicle has not answered."""
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
        """Return MAVSDK's function for a command: its name, the function, and its arguments."""
        wanted = (message.command, (message.param1, message.param2, message.param3))
        direct = (MavlinkDirect, "send_command")
        kind, name = self._functions.get(wanted) or self._functions.get((message.command, None), direct)
        begin = getattr(self._link.plugin(kind, self._system_id), f"{name}_async")
        if kind is not MavlinkDirect:
            return name, begin, ()
        sent = MavlinkMessage(
            message_name=message.get_type(),
            target_system_id=self._system_id,
            target_component_id=_AUTOPILOT,
            fields_json=json.dumps({field: getattr(message, field) for field in type(message).fieldnames}),
        )
        return name, begin, (sent,)

    def _ack(self, command: int, result: int) -> Message:
        """Return a COMMAND_ACK that looks as if the vehicle had sent it."""
        frame = self._writer.encode(m.MAVLink_command_ack_message(command, result))
        return FrameReader().feed(frame)[0]


class _GroundByMavsdk:
    """A ground station whose commands MAVSDK carries out, as a component of the link host."""

    def __init__(self, ground: GroundStation, orders: MavsdkOrders) -> None:
        self.system_id, self.component_id = ground.system_id, ground.component_id
        self.wanted = ground.wanted
        self._ground, self._orders = ground, orders
        self._due_s = math.inf

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Receive a message; COMMAND_ACKs of the vehicle are ignored because MAVSDK handles them."""
        return [] if is_a(message, m.MAVLink_command_ack_message) else self._hear(message, now_s)

    def _hear(self, message: Message, now_s: float) -> list[Message]:
        return self.hand_on(self._ground.receive(message, now_s), now_s)

    def poll(self, now_s: float) -> list[Message]:
        """Deliver MAVSDK's answers, and return the messages that are due."""
        out: list[Message] = []
        for answer in self._orders.answers(now_s):
            out += self._hear(answer, now_s)
        self._due_s = now_s + _POLL_S
        return out + self.hand_on(self._ground.poll(now_s), now_s)

    def next_deadline(self) -> float:
        """Return the time (s) at which the next `poll` is due; infinite if there is nothing to do."""
        return min(self._ground.next_deadline(), self._due_s if self._orders.waiting else math.inf)

    def goodbye(self) -> list[Message]:
        """Return the last messages before the link closes, without waiting for MAVSDK's answers."""
        return self._ground.goodbye()

    def hand_on(self, messages: Iterable[Message], now_s: float) -> list[Message]:
        """Pass commands to MAVSDK and return the other messages, except the heartbeat, which MAVSDK sends."""
        rest: list[Message] = []
        for message in messages:
            if self._orders.takes(message):
                for answer in self._orders.carry_out(message):
                    rest += self._hear(answer, now_s)
            elif not is_a(message, m.MAVLink_heartbeat_message):
                rest.append(message)
        self._due_s = min(self._due_s, now_s + _POLL_S)
        return rest


class MavsdkVia(Via):
    """Connection through MAVSDK, which only opens the link, transfers plans and sends commands."""

    def __init__(self) -> None:
        self._link: MavsdkLink | None = None

    @property
    def transfers(self) -> TransferMaker:
        """Uploads and downloads by MAVSDK."""
        return mavsdk_transfers(self._opened)

    def _opened(self) -> MavsdkLink:
        assert self._link is not None
        return self._link

    def serve(
        self,
        heard: Sequence[Heard],
        cameras: Sequence[Component],
        grounds: Sequence[GroundStation],
        tap: Tap | None,
        note: Note,
    ) -> LinkHost:
        """Open the link of one vehicle by MAVSDK; commands that fail in MAVSDK are passed to `note`.

        The log has the messages that MAVSDK forwards, but not those that MAVSDK sends itself.
        """
        ((url, vehicle),), (station,) = heard, grounds
        link = self._link = MavsdkLink(url)
        orders = MavsdkOrders(link, vehicle, note)
        ground = _GroundByMavsdk(station, orders)
        return LinkHost([*cameras, ground], [], tap=tap, links=[link], through=ground.hand_on)

    def driver(self, url: str, on_event: OnEvent, on_text: OnText | None = None) -> TransferDriver:
        """Open a link by MAVSDK; raise LinkError if the address is wrong or MAVSDK cannot open it."""
        link = MavsdkLink(url)
        endpoint = MavlinkEndpoint(link, *GROUND_STATION, wanted=())
        transfers = mavsdk_transfers(lambda: link)
        return TransferDriver(endpoint, on_event=on_event, on_text=on_text, maker=transfers, heartbeat=False)

    def check_count(self, vehicles: int) -> None:
        """Raise LiveFlightError if there are several vehicles."""
        if vehicles > 1:
            msg = f"--via mavsdk flies one vehicle, not {vehicles}: leave out the option, or fly one vehicle"
            raise LiveFlightError(msg)

    def check(self, scenario: Scenario, vehicle: Vehicle) -> None:
        """Raise LiveFlightError if a policy is given, but the vehicle must leave its mission for a change."""
        policy = scenario.mission.policy
        if policy is not None and vehicle.vehicle_type in (vehicle.profile.change_modes or {}):
            raise LiveFlightError(
                f"policy {policy} changes the mission in flight, which --via mavsdk cannot do for "
                f"{vehicle.profile.name}: leave out --via mavsdk, or give a planner instead"
            )
