"""State of one vehicle on the ground station, and orders and transfers to that vehicle."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum
from typing import Any

from mission.autopilots.profile import Profile
from mission.ground.link_state import LinkState
from mission.ground.texts import TextLog
from mission.ground.vehicle_state import VehicleMonitor
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import DEGREES_E7, Frame
from mission.transfer import OWN_TRANSFERS, RoundTrip, Transfer, TransferMaker, VerifiedUpload
from mission.transfer.wire import GROUND_STATION, enum_name, ground_heartbeat

_RETRY_S = 1.0
_TRIES = 4
_MOST_TRIES = 12
_FAILS = 0.001
_DOUBLINGS = 3
LATE_ORDER_S = 30.0
"""Greatest delay with which a vehicle may still obey an order (s)."""
_LATE_ANSWER_S = 1.0
"""Time allowed for reading an answer that arrived while the program was suspended (s)."""


class Answer(Enum):
    """Meaning of a COMMAND_ACK for an order."""

    NONE = "no answer to this order, or a preliminary answer"
    ACCEPTED = "accepted"
    REFUSED = "refused"


class Order:
    """Pending command to a vehicle: COMMAND_LONG, or COMMAND_INT with a position.

    ``position`` is latitude and longitude (degrees) and altitude above home (m). ``message`` replaces a
    command that the vehicle does not support; no COMMAND_ACK answers the message. ``tries`` is the largest
    number of transmissions: by default four, or more over a link that loses frames. ``round_trip`` determines
    the timeout. COMMAND_ACKs to other ids than ``sender`` (system and component) are ignored, and so is the
    answer that may still come to ``earlier``, the last order of the same command.
    """

    def __init__(
        self,
        target: tuple[int, int],
        command: int,
        *params: float,
        position: tuple[float, float, float] | None = None,
        message: Message | None = None,
        tries: int | None = None,
        round_trip: RoundTrip | None = None,
        sender: tuple[int, int] | None = None,
        earlier: Order | None = None,
    ) -> None:
        self.due_s = -math.inf
        self._earlier = earlier
        self._is_answered = self._skips_answer = False
        self._position, self._message = position, message
        self._most = tries
        self._round_trip = round_trip
        self._target, self._sender = target, sender
        self._command = command
        self._params = (*params, *[0.0] * (7 - len(params)))
        self._tries = 0

    @property
    def is_given_up(self) -> bool:
        """Whether all transmissions are used up."""
        return self._tries >= (tries_over(self._round_trip) if self._most is None else self._most)

    @property
    def repeats(self) -> int:
        """Number of repetitions."""
        return max(0, self._tries - 1)

    def end_repeats(self, now_s: float) -> None:
        """Repeat the order no more: wait only for an answer that has arrived but was not read yet."""
        self._most = 0
        self.due_s = max(self.due_s, now_s + _LATE_ANSWER_S)

    def send(self, now_s: float) -> list[Message]:
        """Return the command, with the number of earlier transmissions as ``confirmation``."""
        confirmation = self._tries
        if self._earlier is not None:
            self._skips_answer = not self._earlier._is_answered and now_s < self._earlier.due_s
            self._earlier = None
        self._tries += 1
        self.due_s = now_s + retry_s_over(self._round_trip, confirmation)
        if self._message is not None:
            return [self._message]
        if self._position is not None:
            latitude, longitude, altitude_m = self._position
            first, second, third, fourth = self._params[:4]
            return [
                m.MAVLink_command_int_message(
                    *self._target,
                    int(Frame.GLOBAL_RELATIVE_ALT_INT),
                    self._command,
                    0,
                    0,
                    first,
                    second,
                    third,
                    fourth,
                    round(latitude * DEGREES_E7),
                    round(longitude * DEGREES_E7),
                    altitude_m,
                )
            ]
        return [m.MAVLink_command_long_message(*self._target, self._command, confirmation, *self._params)]

    def answer(self, message: m.MAVLink_command_ack_message, now_s: float) -> Answer:
        """Return the meaning of a COMMAND_ACK for this order; IN_PROGRESS extends the timeout."""
        # On a shared link, answers to other stations arrive, too. In answers of MAVLink 1, the target is 0.
        system, component = self._sender or (0, 0)
        target = message.target_system, message.target_component or component
        is_other = system and target[0] and target != (system, component)
        if message.command != self._command or is_other:
            return Answer.NONE
        if message.result == m.MAV_RESULT_IN_PROGRESS:
            self.due_s = now_s + 3.0 * retry_s_over(self._round_trip)
            return Answer.NONE
        if self._skips_answer:
            self._skips_answer = False
            return Answer.NONE
        self._is_answered = True
        if message.result == m.MAV_RESULT_ACCEPTED:
            return Answer.ACCEPTED
        later = message.result == m.MAV_RESULT_TEMPORARILY_REJECTED and not self.is_given_up
        return Answer.NONE if later else Answer.REFUSED


@dataclass(frozen=True, slots=True)
class StateBefore:
    """Flight mode, armed state and current item (None: unknown) of a vehicle when an order was given."""

    mode: str
    is_armed: bool
    item: int | None
    given_s: float

    @classmethod
    def of(cls, monitor: VehicleMonitor, now_s: float) -> StateBefore:
        """Return the present state of a vehicle."""
        return cls(monitor.mode, monitor.is_armed, monitor.item, now_s)

    def is_past(self, monitor: VehicleMonitor) -> bool:
        """Whether a HEARTBEAT has arrived since the order."""
        return monitor.mode_heard_s > self.given_s

    def is_overruled(self, monitor: VehicleMonitor, expected: Collection[str] = ()) -> bool:
        """Whether a pilot or a failsafe has acted since the order, so that the order must not be repeated.

        Modes in ``expected`` are not signs of such an action.
        """
        changed = monitor.mode != self.mode and monitor.mode not in expected
        disarmed = self.is_armed and not monitor.is_armed
        return changed or disarmed


def tries_over(round_trip: RoundTrip | None) -> int:
    """Return the number of transmissions with which only one request in a thousand remains unanswered.

    >>> trip = RoundTrip()
    >>> tries_over(trip)
    4
    >>> trip.loss = 0.3
    >>> tries_over(trip)
    11
    """
    arrives = 1.0 if round_trip is None else (1.0 - round_trip.loss) ** 2
    if arrives >= 1.0:
        return _TRIES
    tries = math.log(_FAILS) / math.log(1.0 - arrives) if arrives > 0.0 else math.inf
    return min(max(_TRIES, math.ceil(min(tries, _MOST_TRIES))), _MOST_TRIES)


def retry_s_over(round_trip: RoundTrip | None, repeats: int = 0) -> float:
    """Return the timeout of an order (s): one second, or 1.1 round trips if longer.

    Until the round trip time is known, each repetition doubles the timeout, up to eight seconds.

    >>> [retry_s_over(RoundTrip(), repeats) for repeats in range(5)]
    [1.0, 2.0, 4.0, 8.0, 8.0]
    """
    if round_trip is None:
        return _RETRY_S
    return round_trip.wait(_RETRY_S * 2.0 ** min(repeats, _DOUBLINGS), _RETRY_S, _RETRY_S)


def result_name(result: int) -> str:
    """Return the name of a MAV_RESULT for messages to the user.

    >>> result_name(2)
    'denied'
    """
    name = enum_name("MAV_RESULT", result, f"result {result}")
    return name.removeprefix("MAV_RESULT_").lower().replace("_", " ")


_HEARTBEAT_S = 1.0


class Contact:
    """Ids, telemetry, texts and link quality of one vehicle; factory of orders and transfers to the vehicle.

    If ``is_real``, the timeouts of orders and transfers adapt to the measured round trip time and loss.
    """

    def __init__(
        self,
        vehicle: tuple[int, int] = (0, 0),
        ground: tuple[int, int] = GROUND_STATION,
        *,
        maker: TransferMaker = OWN_TRANSFERS,
        is_real: bool = True,
    ) -> None:
        self.vehicle, self.ground = vehicle, ground
        self.monitor, self.texts, self.link = VehicleMonitor(), TextLog(), LinkState()
        self.round_trip = self.link.round_trip if is_real else None
        self._maker = maker
        self._last_orders: dict[int, Order] = {}  # last order of each command

    @property
    def profile(self) -> Profile:
        """Profile of the autopilot."""
        return self.monitor.profile

    def receive(self, message: Message, now_s: float) -> None:
        """Handle any message of the autopilot."""
        if self.link.receive(message, now_s):
            self.monitor.receive(message, now_s)
        if isinstance(message, m.MAVLink_statustext_message):
            self.texts.on_text(message, now_s)

    @property
    def clears(self) -> bool:
        """Whether an upload may clear the old mission first; transfers by MAVSDK do not."""
        return self._maker is OWN_TRANSFERS

    def order(self, command: int, *params: float, **options: Any) -> Order:
        """Return an order to the vehicle; ``options`` go to `Order`."""
        options |= {"round_trip": self.round_trip, "sender": self.ground}
        order = Order(self.vehicle, command, *params, earlier=self._last_orders.get(command), **options)
        self._last_orders[command] = order
        return order

    def upload(self, *plan: Any, **options: Any) -> VerifiedUpload:
        """Return an upload to the vehicle; the arguments go to `VerifiedUpload`."""
        return self._maker.upload(*plan, **self._address, **options)

    def download(self, *plan: Any, **options: Any) -> Transfer:
        """Return a download from the vehicle; the arguments go to `MissionDownload`."""
        return self._maker.download(*plan, **self._address, **options)

    @property
    def _address(self) -> dict[str, Any]:
        return {"target": self.vehicle, "source": self.ground, "profile": self.profile}


class Heartbeat:
    """Timer of the ground station's HEARTBEAT (1 Hz)."""

    def __init__(self) -> None:
        self.due_s = -math.inf

    def poll(self, now_s: float) -> list[Message]:
        """Return the HEARTBEAT if due."""
        if now_s < self.due_s:
            return []
        self.due_s = now_s + _HEARTBEAT_S
        return [ground_heartbeat()]
