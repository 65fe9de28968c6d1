"""The MAVLink dialect of the project; all other modules import ``mavlink`` from here.

pymavlink's dialect ``all`` has the common, standard, development and ArduPilot messages.
`mission.link.codec.additions` adds opaque plan ids, PROTOCOL_VERSION, COMPONENT_METADATA and events.
`lighten` makes the creation of messages faster, if messages have the private attributes that it uses.
"""

from typing import Any

from pymavlink.dialects.v20 import all as generated

from mission.link.codec.additions import extend


class _Header:
    """Attribute ``_header`` of messages: built from the frame on first access, then cached."""

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
    """Make the messages of a generated dialect build their headers on first access.

    pymavlink creates a header object and eight frame attributes for each message. `FrameWriter` does not need
    these objects, and most received messages' headers are never read. Without a header, a message is created
    in little more than half the time. The values of the attributes stay the same.
    """
    base = dialect.MAVLink_message
    if isinstance(vars(base).get("_header"), _Header):
        return
    header_type = dialect.MAVLink_header

    def initialise(self: Any, msgId: int, name: str) -> None:
        self._type = name
        if msgId != self.id:  # MAVLink_bad_data and MAVLink_unknown
            self._header = header_type(msgId)

    base.__init__ = initialise
    base._header = _Header(header_type)
    base._msgbuf = b""
    base._payload = base._crc = base._link_id = base._instances = base._instance_field = None
    base._signed = False
    base._fieldnames = base.fieldnames


_PRIVATE = "_crc _fieldnames _header _instance_field _instances _link_id _msgbuf _payload _signed _type"
IS_KNOWN_INSIDE = " ".join(
    sorted(vars(generated.MAVLink_message(0, "")))
) == _PRIVATE and "_text_raw" in vars(generated.MAVLink_statustext_message(6, b""))
"""Whether messages have the private attributes that `lighten` and fast codecs use; if not, both are off."""

extend(generated)
if IS_KNOWN_INSIDE:
    lighten(generated)
mavlink: Any = generated
Message = generated.MAVLink_message
