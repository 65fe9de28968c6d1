"""The one place that chooses the MAVLink dialect; everything else imports ``mavlink`` from here.

``all`` of pymavlink holds the common, standard, development and ArduPilot messages;
`mission.link.codec.additions` adds what it lacks (opaque plan ids, PROTOCOL_VERSION, COMPONENT_METADATA,
events); and its messages are made without a header until somebody asks for it (`lighten`).
"""

from typing import Any

from pymavlink.dialects.v20 import all as generated

from mission.link.codec.additions import extend


class _Header:
    """The attribute ``_header``: made of the frame when it is first read, kept from then on."""

    def __init__(self, header_type: Any) -> None:
        self._type = header_type

    def __get__(self, message: Any, _owner: Any = None) -> Any:
        if message is None:
            return self
        number = type(message).id
        frame = None if message._crc is None else message._msgbuf
        message._header = header = (
            self._type(number)
            if frame is None
            else self._type(number, frame[2], frame[3], frame[1], *frame[4:7])
        )
        return header


def lighten(dialect: Any) -> None:
    """Make the messages of a module that pymavlink generated tell of their frames only when asked.

    pymavlink gives each message a header object and eight more attributes of frames when it is made. One to
    be packed by `mission.link.codec.frames.FrameWriter` needs none of them, and of most that are received
    nobody asks for the header: without it a message is made in little more than half the time. The attributes
    say the same.
    """
    base = dialect.MAVLink_message
    if isinstance(vars(base).get("_header"), _Header):
        return
    header_type = dialect.MAVLink_header

    def initialise(self: Any, msgId: int, name: str) -> None:
        self._type = name
        if msgId != self.id:  # what is no message of the dialect
            self._header = header_type(msgId)

    base.__init__ = initialise
    base._header = _Header(header_type)
    base._msgbuf = b""
    base._payload = base._crc = base._link_id = base._instances = base._instance_field = None
    base._signed = False
    base._fieldnames = base.fieldnames


extend(generated)
lighten(generated)
mavlink: Any = generated
Message = generated.MAVLink_message

__all__ = ["Message", "lighten", "mavlink"]
