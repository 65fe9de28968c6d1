"""Ring buffer of a camera's images, and MAVLink messages of an image."""

from __future__ import annotations

import math
from struct import Struct
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from geo.frame import Quaternion, quaternion_of
from mission.link.codec.dialect import Message, mavlink
from sensors.camera.layout import ANNOUNCED_EVERY, FIELDS_NAME, LeafLayout
from sim_vehicle.camera.trigger import Exposure

if TYPE_CHECKING:
    from numpy.typing import NDArray

RING_IMAGES = 65_536
STORAGE_MIB = 1024.0
_MIB_PER_IMAGE = 1e-4
_PADDING = [0.0] * 58
_SINGLE = Struct("<4f")
_UNKNOWN = 65535
_TAKEN = Struct("<9q")  # An image is stored as these numbers, followed by its readings.


class Image(NamedTuple):
    """An image: number, exposure, and readings[cell][field]."""

    number: int
    exposure: Exposure
    values: list[list[float]]


class ImageMemory:
    """Memory of a camera's last 65,536 images; it numbers the images and builds their messages."""

    def __init__(self, fields: tuple[str, ...], footprint_cells: int) -> None:
        self.count = 0  # Number of images taken; the next image has this number.
        self._footprint_cells = footprint_cells
        self._layout = LeafLayout.of(fields)
        self._layout_name = self._layout.name.encode()
        self._n_fields = len(fields)
        # Bytes take a sixth of the memory that lists take, and the garbage collector does not traverse bytes.
        self._ring: list[bytes] = [b""] * RING_IMAGES
        self._attitude = ((-1, 0, 0), (1.0, 0.0, 0.0, 0.0))

    @property
    def used_mib(self) -> float:
        """Storage used by images (MiB)."""
        return min(self.count * _MIB_PER_IMAGE, STORAGE_MIB)

    def add(self, exposure: Exposure, values: NDArray[np.float32]) -> Image:
        """Store an image with the readings float32[cell, field] under the next number."""
        number = self.count
        self._ring[number % RING_IMAGES] = _TAKEN.pack(number, *exposure) + values.tobytes()
        self.count += 1
        return Image(number, exposure, values.tolist())

    def find(self, index: float) -> Image | None:
        """Return the image whose number a command gives; None if no such image is stored."""
        if not (0.0 <= index < 2**31 and index % 1.0 == 0.0):
            return None
        kept = self._ring[int(index) % RING_IMAGES]
        if not kept:
            return None
        number, *exposure = _TAKEN.unpack_from(kept)
        if number != index:
            return None
        values = np.frombuffer(kept, np.float32, offset=_TAKEN.size).reshape(-1, self._n_fields)
        return Image(number, Exposure(*exposure), values.tolist())

    def renumber(self, *, delete: bool) -> None:
        """Give the next image number 0; with `delete`, delete all images."""
        if delete:
            self._ring = [b""] * RING_IMAGES
        self.count = 0

    def report(self, image: Image, utc_offset_us: int | None) -> list[Message]:
        """Return the messages of an image; `utc_offset_us` is UTC minus time since boot, None if unknown."""
        index, exposure, values = image
        time_ms = exposure.time_us // 1000
        report: list[Message] = [
            mavlink.MAVLink_camera_image_captured_message(
                time_ms & 0xFFFFFFFF,
                0 if utc_offset_us is None else exposure.time_us + utc_offset_us,
                0,
                exposure.latitude_e7,
                exposure.longitude_e7,
                exposure.altitude_mm,
                exposure.relative_altitude_mm,
                self.attitude(exposure),
                index,
                1,
                b"",
            )
        ]
        for data in self._layout.pack(index, self._footprint_cells, values):
            data += _PADDING[len(data) :]
            report.append(
                mavlink.MAVLink_debug_float_array_message(
                    exposure.time_us, self._layout_name, index & 0xFFFF, data
                )
            )
        if index % ANNOUNCED_EVERY == 0:
            # The messages name the fields; the benchmark's fields need no such messages.
            for number, data in enumerate(self._layout.announcement()):
                padded = data + _PADDING[len(data) :]
                name = FIELDS_NAME.encode()
                report.append(
                    mavlink.MAVLink_debug_float_array_message(exposure.time_us, name, number, padded)
                )
        return report

    def attitude(self, exposure: Exposure) -> Quaternion:
        """Return the camera's attitude as a quaternion, rounded to single precision as in messages."""
        angles = exposure.roll_cdeg, exposure.pitch_cdeg, exposure.heading_cdeg
        if angles != self._attitude[0]:
            roll, pitch, yaw = (math.radians(angle / 100.0) for angle in angles)
            exact = quaternion_of(roll, pitch, 0.0 if exposure.heading_cdeg == _UNKNOWN else yaw)
            w, x, y, z = _SINGLE.unpack(_SINGLE.pack(*exact))
            self._attitude = (angles, (w, x, y, z))
        return self._attitude[1]
