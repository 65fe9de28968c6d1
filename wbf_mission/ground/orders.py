"""Commands that are repeated until the vehicle answers them."""

from __future__ import annotations

import math
from enum import Enum

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import DEGREES_E7, Frame

__all__ = ["Answer", "Order", "result_name"]

_RETRY_S = 1.0
_TRIES = 4


class Answer(Enum):
    """What a COMMAND_ACK means for an order."""

    NONE = "no answer to this order, or not the last one"
    ACCEPTED = "accepted"
    REFUSED = "refused"


class Order:
    """A command on its way to a vehicle: COMMAND_LONG, or COMMAND_INT with a position.

    Parameters
    ----------
    target : tuple of int
        System and component.
    command : int
        MAV_CMD.
    params : float
        The first parameters; the others are 0.
    position : tuple of 3 floats, optional
        Latitude and longitude in degrees, altitude above home in metres.
    tries : int
        So often it is worth sending.

    Attributes
    ----------
    due_s : float
        When it is to be sent (again).
    """

    def __init__(
        self,
        target: tuple[int, int],
        command: int,
        *params: float,
        position: tuple[float, float, float] | None = None,
        tries: int = _TRIES,
    ) -> None:
        self.due_s = -math.inf
        self._position = position
        self._most = tries
        self._target = target
        self._command = command
        self._params = (*params, *[0.0] * (7 - len(params)))
        self._tries = 0

    @property
    def is_given_up(self) -> bool:
        """Whether it was sent as often as it is worth."""
        return self._tries >= self._most

    @property
    def repeats(self) -> int:
        """How often it was sent again."""
        return max(0, self._tries - 1)

    def send(self, now_s: float) -> list[Message]:
        """Send it, with the number of the try as confirmation."""
        confirmation = self._tries
        self._tries += 1
        self.due_s = now_s + _RETRY_S
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
        """Take a COMMAND_ACK of the vehicle."""
        if message.command != self._command:
            return Answer.NONE
        if message.result == m.MAV_RESULT_ACCEPTED:
            return Answer.ACCEPTED
        if message.result == m.MAV_RESULT_IN_PROGRESS:
            self.due_s = now_s + 3.0 * _RETRY_S
            return Answer.NONE
        later = message.result == m.MAV_RESULT_TEMPORARILY_REJECTED and not self.is_given_up
        return Answer.NONE if later else Answer.REFUSED


def result_name(result: int) -> str:
    """The name of a MAV_RESULT, for people.

    >>> result_name(2)
    'denied'
    """
    entry = m.enums["MAV_RESULT"].get(result)
    return entry.name.removeprefix("MAV_RESULT_").lower().replace("_", " ") if entry else f"result {result}"
