"""Type narrowing of messages by message id, and typed tables of message handlers.

The functions compare ids, not classes: each generated dialect has classes of its own for the same messages.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeAlias, TypeVar

from mission.link.codec.dialect import Message, mavlink

if TYPE_CHECKING:
    from typing_extensions import TypeIs


CommandMessage: TypeAlias = mavlink.MAVLink_command_long_message | mavlink.MAVLink_command_int_message

M = TypeVar("M", bound=Message)
P = ParamSpec("P")
R = TypeVar("R")


def is_a(message: Message, kind: type[M]) -> TypeIs[M]:
    """Whether a message has the id of the message class ``kind``.

    >>> ack = mavlink.MAVLink_mission_ack_message(255, 190, 0)
    >>> is_a(ack, mavlink.MAVLink_mission_ack_message), is_a(ack, mavlink.MAVLink_heartbeat_message)
    (True, False)
    """
    return type(message).id == kind.id


def is_command(message: Message) -> TypeIs[CommandMessage]:
    """Whether a message is a COMMAND_LONG or COMMAND_INT."""
    return type(message).id in (mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_COMMAND_INT)


def handler(
    kind: type[M], handle: Callable[Concatenate[M, P], R]
) -> tuple[int, Callable[Concatenate[Any, P], R]]:
    """Return an entry (message id, handler) of a handler table; type checkers verify that both match.

    >>> handlers = dict([handler(mavlink.MAVLink_mission_ack_message, lambda message: message.type)])
    >>> handlers[47](mavlink.MAVLink_mission_ack_message(255, 190, 13))
    13
    """
    return kind.id, handle
