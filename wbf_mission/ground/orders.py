"""Commands that are repeated until the vehicle answers them."""

from __future__ import annotations

import math
from enum import Enum

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m

__all__ = ["Answer", "Order", "result_name"]

_RETRY_S = 1.0
_TRIES = 4


class Answer(Enum):
    """What a COMMAND_ACK means for an order."""

    NONE = "no answer to this order, or not the last one"
    ACCEPTED = "accepted"
    REFUSED = "refused"


class Order:
    """A COMMAND_LONG on its way to a vehicle.

    Parameters
    ----------
    target : tuple of int
        System and component.
    command : int
        MAV_CMD.
    params : float
        The first parameters; the others are 0.

    Attributes
    ----------
    due_s : float
        When it is to be sent (again).
    """

    def __init__(self, target: tuple[int, int], command: int, *params: float) -> None:
        self.due_s = -math.inf
        self._target = target
        self._command = command
        self._params = (*params, *[0.0] * (7 - len(params)))
        self._tries = 0

    @property
    def is_given_up(self) -> bool:
        """Whether it was sent as often as it is worth."""
        return self._tries >= _TRIES

    def send(self, now_s: float) -> list[Message]:
        """Send it, with the number of the try as confirmation."""
        confirmation = self._tries
        self._tries += 1
        self.due_s = now_s + _RETRY_S
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
