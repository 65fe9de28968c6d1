from mission.link.codec import messages as mavlink

Message = mavlink.MAVLink_message

__all__ = ["Message", "mavlink"]
