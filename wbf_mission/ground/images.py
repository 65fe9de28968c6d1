"""Images whose messages were lost on the way are asked for once more."""

from __future__ import annotations

import math

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from sensors.camera.wire import ObservationAssembler

__all__ = ["ImageFetch"]

_EACH_S = 0.5
_ROUNDS = 20
_AT_ONCE = 50


class ImageFetch:
    """Asks a vehicle's camera for the images that an assembler misses, a few at a time.

    Parameters
    ----------
    assembler : ObservationAssembler
    vehicle_system_id : int

    Attributes
    ----------
    due_s : float
        When to ask (again).
    """

    def __init__(self, assembler: ObservationAssembler, vehicle_system_id: int) -> None:
        self.due_s = math.inf
        self._assembler = assembler
        self._camera = (vehicle_system_id, int(m.MAV_COMP_ID_CAMERA))
        self._rounds = 0

    def begin(self, now_s: float) -> bool:
        """Begin if any image is missing; tell whether there is."""
        self.due_s = now_s
        return bool(self._assembler.missing())

    def ask(self, now_s: float) -> list[Message]:
        """The next requests; none when nothing is missing any more, or it was asked for often enough."""
        missing = self._assembler.missing()[:_AT_ONCE]
        self._rounds += 1
        if self._rounds > _ROUNDS:
            return []
        self.due_s = now_s + _EACH_S
        wanted = float(m.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED)
        return [
            m.MAVLink_command_long_message(
                *self._camera, int(m.MAV_CMD_REQUEST_MESSAGE), 0, wanted, float(index), *[0.0] * 5
            )
            for index in missing
        ]
