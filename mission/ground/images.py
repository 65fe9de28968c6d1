"""Images whose messages were lost on the way are asked for once more."""

from __future__ import annotations

import math

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.transfer import RoundTrip
from mission.transfer.wire import command_long
from sensors.camera.wire import ObservationAssembler

__all__ = ["ImageFetch"]

_EACH_S = 0.5
_ROUNDS = 20
_AT_ONCE = 50
_FEW = 5
_MANY_CAME, _FEW_CAME = 0.6, 0.3


class ImageFetch:
    """Asks a vehicle's camera for the images that an assembler misses, a few at a time.

    Over a link with a measured round trip it waits for answers, and adapts the number of requests at once to
    the number of answers.
    """

    def __init__(
        self,
        assembler: ObservationAssembler,
        vehicle_system_id: int,
        round_trip: RoundTrip | None = None,
    ) -> None:
        self.due_s = math.inf
        self._assembler = assembler
        self._camera = (vehicle_system_id, int(m.MAV_COMP_ID_CAMERA))
        self._rounds = 0
        self._lost = 0
        self._counts = False
        self._round_trip = round_trip
        self._at_once = _AT_ONCE if round_trip is None else _FEW
        self._asked: tuple[int, ...] = ()

    def begin(self, now_s: float) -> bool:
        """Begin if any image is missing, and return whether one is.

        A real link may have lost the last images, which no later message shows.
        """
        self._rounds = 0
        self._counts |= self._round_trip is not None and self._assembler.statistics.images > 0
        self.due_s = now_s
        return self._counts or bool(self._assembler.missing(1))

    def look_back(self, now_s: float, since_s: float) -> None:
        """Begin after a silence: request the camera's image count, too.

        ``since_s`` is the vehicle's clock when the flight began.
        """
        self._assembler.expect_from_first(since_s)
        self._counts = True
        self._rounds = 0
        self.due_s = now_s

    def on_capture_status(self, message: m.MAVLink_camera_capture_status_message) -> None:
        """Take the camera's image count."""
        if message.get_srcSystem() == self._camera[0] and self._counts:
            self._counts = False
            self._assembler.expect(message.image_count)

    def ask(self, now_s: float) -> list[Message]:
        """The next requests; none if no image is missing or the tries are used up."""
        lost = self._assembler.statistics.lost
        self._rounds = 1 if lost < self._lost else self._rounds + 1
        self._lost = lost
        if self._round_trip is not None:
            self._adapt()
        missing = self._assembler.missing(self._at_once)
        self._asked = tuple(missing)
        if self._rounds > _ROUNDS or not (missing or self._counts):
            self.due_s = math.inf
            return []
        trip = self._round_trip
        self.due_s = now_s + (_EACH_S if trip is None else trip.wait(_EACH_S, _EACH_S, _EACH_S))
        wanted = [(m.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED, index) for index in missing]
        if self._counts:
            wanted.append((m.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS, 0))
        return [
            command_long(self._camera, m.MAV_CMD_REQUEST_MESSAGE, float(kind), float(index))
            for kind, index in wanted
        ]

    def _adapt(self) -> None:
        """Request more at once if most images came, fewer if few did: a slow line fills up."""
        if not self._asked:
            return
        still = set(self._assembler.missing())
        came = sum(index not in still for index in self._asked) / len(self._asked)
        if came >= _MANY_CAME:
            self._at_once = min(2 * self._at_once, _AT_ONCE)
        elif came <= _FEW_CAME:
            self._at_once = max(self._at_once // 2, 1)
