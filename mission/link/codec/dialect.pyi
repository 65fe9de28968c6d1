from types import ModuleType

from mission.link.codec import messages as mavlink

Message = mavlink.MAVLink_message

def lighten(dialect: ModuleType) -> None: ...

__all__ = ["Message", "lighten", "mavlink"]
