"""MAVLink camera component for a real camera on a companion computer."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np

from geo.errors import told_error
from mission.link.codec.dialect import Message
from sensors.fields import PAPER_FIELDS
from sim_vehicle.camera.component import CAMERA_COMPONENT_ID, CameraComponent
from sim_vehicle.camera.trigger import Exposure

if TYPE_CHECKING:
    from numpy.typing import NDArray

P = TypeVar("P")
_CHECK_S = 0.05  # Interval between two checks for new readings.


class PictureCamera(CameraComponent, Generic[P]):
    """A camera that uses functions of the user to take pictures and to read field values from them.

    The camera takes pictures on the same triggers as `CameraComponent`. A thread classifies the pictures one
    after the other, so that a slow classifier delays neither the next picture nor the link. If a picture
    cannot be taken or classified, the image has no readings, and `note` gets the reason.

    Parameters
    ----------
    take : callable
        ``take(exposure)`` takes a picture and returns the input of `classify`. An `Exposure` has the time
        since boot (us), the position (1e-7 degree, mm) and the heading.
    classify : callable
        ``classify(picture)`` returns values of fields by name, in 0..1 (`sensors.fields`). A value is a
        number, or a sequence with a number per cell of the footprint, column by column. A missing field, or
        NaN, was not seen.
    fields : tuple of str
        Names of all fields, in the order of the ground station.
    footprint_cells : int
        Side of the square footprint of a picture, in cells of the farm.
    system_id, component_id : int
        MAVLink address of the camera; `system_id` is the system id of the vehicle.
    note : callable, optional
        Called with a line of text for each failed picture.

    Examples
    --------
    >>> camera = PictureCamera(lambda exposure: "a leaf", lambda picture: {"tylcv": 0.5})
    >>> camera.image_count, camera.next_deadline()
    (0, -inf)
    """

    def __init__(
        self,
        take: Callable[[Exposure], P],
        classify: Callable[[P], Mapping[str, float | Sequence[float]]],
        *,
        fields: tuple[str, ...] = PAPER_FIELDS.names,
        footprint_cells: int = 1,
        system_id: int = 1,
        component_id: int = CAMERA_COMPONENT_ID,
        note: Callable[[str], None] | None = None,
    ) -> None:
        super().__init__(fields, footprint_cells, system_id=system_id, component_id=component_id)
        self._picture, self._classify, self._note = take, classify, note
        self._names = fields
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="classify")
        self._waiting: deque[tuple[Exposure, Future[NDArray[np.float32]]]] = deque()
        self._checked_s = -math.inf

    @property
    def waiting(self) -> int:
        """Number of pictures that are not classified yet."""
        return len(self._waiting)

    def next_deadline(self) -> float:
        """Return the time of the next heartbeat, or of the next check for readings if that is earlier."""
        due_s = super().next_deadline()
        return min(due_s, self._checked_s + _CHECK_S) if self._waiting else due_s

    def poll(self, now_s: float) -> list[Message]:
        """Return the heartbeat if it is due, and the images with new readings."""
        self._checked_s = now_s
        return [*super().poll(now_s), *self._classified()]

    def goodbye(self) -> list[Message]:
        """Wait for the last readings; return their images and a HEARTBEAT with the state POWEROFF."""
        self._pool.shutdown(wait=True)
        return [*self._classified(), *super().goodbye()]

    def _take(self, exposures: Sequence[Exposure]) -> list[Message]:
        for exposure in exposures:
            try:
                picture = self._picture(exposure)
            except Exception as error:  # Any error of the user's camera function.
                self._say(f"picture {self.image_count + self.waiting + 1} was not taken: {told_error(error)}")
                future: Future[NDArray[np.float32]] = Future()
                future.set_result(self._nothing())
            else:
                future = self._pool.submit(self._values, picture)
            self._waiting.append((exposure, future))
        return self._classified()

    def _classified(self) -> list[Message]:
        """Return the messages of classified pictures, in the order of exposure."""
        messages: list[Message] = []
        while self._waiting and self._waiting[0][1].done():
            exposure, future = self._waiting.popleft()
            messages += self._report(exposure, future.result())
        return messages

    def _values(self, picture: P) -> NDArray[np.float32]:
        """Return the readings of a picture, float32[cells, fields]; NaN for fields that it does not show."""
        values = self._nothing()
        try:
            for name, given in self._classify(picture).items():
                readings = np.asarray(given, np.float32)
                seen = readings[np.isfinite(readings)]
                if name not in self._names:
                    raise ValueError(f"field {name!r:.60} is not one of {', '.join(self._names)}")
                if ((seen < 0.0) | (seen > 1.0)).any():
                    raise ValueError(
                        f"{name} is {float(seen[(seen < 0.0) | (seen > 1.0)][0]):g}, not in 0..1"
                    )
                values[:, self._names.index(name)] = readings
        except Exception as error:  # Any error of the user's classifier.
            self._say(f"a picture was not understood: {told_error(error)}")
            return self._nothing()
        return values

    def _nothing(self) -> NDArray[np.float32]:
        return np.full((self._footprint_cells**2, len(self._names)), np.nan, np.float32)

    def _say(self, text: str) -> None:
        if self._note is not None:
            self._note(text)
