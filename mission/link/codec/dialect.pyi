from types import ModuleType

from mission.link.codec import messages as mavlink

IS_KNOWN_INSIDE: bool
Message = mavlink.MAVLink_message

def lighten(dialect: ModuleType) -> None: ...

__all__ = ["IS_KNOWN_INSIDE", "Message", "lighten", "mavlink"]
