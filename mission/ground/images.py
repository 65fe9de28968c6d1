"""Requests for images with lost messages."""

from __future__ import annotations

import math

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.transfer import RoundTrip
from mission.transfer.wire import command_long
from sensors.camera.wire import ObservationAssembler

_EACH_S = 0.5  # Interval of the requests.
_ROUNDS = 20  # Requests without a new image before giving up.
_AT_ONCE = 50  # Images per request.
_FEW = 5  # Images per first request over a measured link.
_MANY_CAME, _FEW_CAME = 0.6, 0.3  # The batch doubles or halves at these fractions of answered requests.


class ImageFetch:
    """Requests lost images from the camera of a vehicle, in batches.

    Over a link with a measured round trip time, the interval follows the round trip, and the batch size
    adapts to the fraction of answered requests.
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

    def begin(self, now_s: float, since_s: float) -> bool:
        """Start to request lost images after the flight; return whether images are or may be missing.

        Over a real link, the first or last images may be lost without a sign in other messages. ``since_s``
        is the start of the flight by the vehicle's clock.
        """
        self._rounds = 0
        if self._round_trip is not None:
            self._assembler.expect_from_first(since_s)
        self._counts |= self._round_trip is not None and self._assembler.statistics.images > 0
        self.due_s = now_s
        return self._counts or bool(self._assembler.missing(1))

    def look_back(self, now_s: float, since_s: float) -> None:
        """Start to request lost images after a silence of the vehicle, and the camera's image count.

        ``since_s`` is the start of the flight by the vehicle's clock.
        """
        self._assembler.expect_from_first(since_s)
        self._counts = True
        self._rounds = 0
        self.due_s = now_s

    def on_capture_status(self, message: m.MAVLink_camera_capture_status_message) -> None:
        """Handle the camera's image count."""
        if message.get_srcSystem() == self._camera[0] and self._counts:
            self._counts = False
            self._assembler.expect(message.image_count)

    def ask(self, now_s: float) -> list[Message]:
        """Return the next requests; there are none if no image is missing or all attempts are used up."""
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
        """Double the batch size if most requested images arrived; halve it if few arrived."""
        if not self._asked:
            return
        still = set(self._assembler.missing())
        came = sum(index not in still for index in self._asked) / len(self._asked)
        if came >= _MANY_CAME:
            self._at_once = min(2 * self._at_once, _AT_ONCE)
        elif came <= _FEW_CAME:
            self._at_once = max(self._at_once // 2, 1)
