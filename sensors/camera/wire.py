"""Turns the MAVLink messages of a leaf camera into observations.

An image is sent in two standard messages: CAMERA_IMAGE_CAPTURED has the image's time and position, and
DEBUG_FLOAT_ARRAY has the readings (`sensors.camera.layout`). A large footprint needs several
DEBUG_FLOAT_ARRAY messages. Messages of an image share the time since boot and the image index; ``array_id``
has the index's low 16 bits. An image's cell is where the optical axis meets flat ground
(`ground_offset`), seen from the reported position (resolution 1e-7 degree). Other cells are in the order of
`footprint_offsets`.

No MAVLink library is imported: a message is recognised by its ``id``, and its fields are read as attributes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from sensors.camera.layout import FIELDS_NAME, FURTHER_NAME, LEAF_NAME, Announcement, LeafLayout
from sensors.camera.leaf_camera import footprint_offsets, ground_offset
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations

if TYPE_CHECKING:
    from geo.farm import Farm

CAMERA_IMAGE_CAPTURED = 263
DEBUG_FLOAT_ARRAY = 350
_ID_MASK = 0xFFFF
_MAX_PENDING = 1024
_MAX_KNOWN = 131_072
_MOST_BEFORE = 8  # If half of the images are lost, the chance of losing 8 in a row is 1/256
_MAX_MISSING = 65_536
_MOST_IMAGES = 1 << 24
_E7 = 1e7
_PLACE = 5
_Key = tuple[int, int]


@dataclass(slots=True)
class AssemblerStatistics:
    """Counts of images and messages that were received, lost or discarded.

    Parameters
    ----------
    off_farm : int
        Cells that are outside the farm (such as all cells of an image of the sky) or have no reading.
    """

    images: int = 0  # Complete images.
    observations: int = 0  # Cells with at least one reading.
    duplicates: int = 0  # Messages received more than once.
    lost: int = 0  # Missing images, known from gaps in the image index and from the camera's count.
    unpaired: int = 0  # Incomplete images that were discarded.
    failed: int = 0  # Images that the camera reported as failed.
    malformed: int = 0  # Messages with invalid content.
    off_farm: int = 0
    other_fields: int = 0  # Messages with readings of unexpected fields.


@dataclass(slots=True)
class _Image:
    """An image with at least one received message."""

    index: int = -1
    latitude_e7: int = 0
    longitude_e7: int = 0
    ahead_m: tuple[float, float] = (0.0, 0.0)
    time_us: float = 0
    footprint_cells: int = 0
    parts: dict[int, list[float]] = field(default_factory=dict)
    cells: int = 0


def _place(image: _Image) -> tuple[float, ...]:
    return (image.time_us, image.latitude_e7, image.longitude_e7, *image.ahead_m)


class ObservationAssembler:
    """Assembles observations from the camera's messages, which may arrive in any order.

    Parameters
    ----------
    farm : Farm
        The farm, which converts positions to cells.
    day : int
        Day of the flight, which is stored with each observation.
    system_id, component_id : int, optional
        System and component id of the camera whose messages are used; None accepts any id.
    start_s : float
        Start of the run on the vehicle's clock (seconds since boot); observation times count from it.
    fields : tuple of str
        Names of the expected fields, in order.

    Notes
    -----
    An incomplete image gives no observation; at most 1024 incomplete images are kept. Duplicate and invalid
    messages are counted and raise no error.
    """

    def __init__(
        self,
        farm: Farm,
        *,
        day: int,
        system_id: int | None = None,
        component_id: int | None = None,
        start_s: float = 0.0,
        fields: tuple[str, ...] = PAPER_FIELDS.names,
    ) -> None:
        self.statistics = AssemblerStatistics()
        self._layout = LeafLayout.of(fields)
        self._announcement = Announcement()
        self._farm = farm
        self._day = day
        self._source = (system_id, component_id)
        self._any_source = system_id is None and component_id is None
        self._start_s = start_s
        self._pending: dict[_Key, _Image] = {}
        self._known: dict[_Key, None] = {}
        self._missing: dict[int, None] = {}
        self._highest = -1
        self._highest_ms = 0
        self._first = 0  # First image index received; 0 once earlier images count as missing
        self._from_first = False
        self._moved_us = 0.0
        self._since_us = -math.inf
        self._single: list[tuple[float, ...]] = []
        self._wide: list[_Image] = []

    def add(self, message: Any) -> None:
        """Add a MAVLink message; a message of another kind or sender is ignored."""
        kind = type(message).id
        if kind != DEBUG_FLOAT_ARRAY and kind != CAMERA_IMAGE_CAPTURED:
            return
        if not self._any_source:
            system_id, component_id = self._source
            if system_id is not None and message.get_srcSystem() != system_id:
                return
            if component_id is not None and message.get_srcComponent() != component_id:
                return
        if kind == CAMERA_IMAGE_CAPTURED:
            self._add_image(message)
        elif message.name == self._layout.name:
            self._add_values(message)
        elif message.name in (LEAF_NAME, FURTHER_NAME):
            self.statistics.other_fields += 1
        elif message.name == FIELDS_NAME and not self._announcement.add(message.array_id, message.data):
            self.statistics.malformed += 1

    def mismatch(self) -> str | None:
        """Return an error text if the camera senses other fields than expected, or else None."""
        if not self.statistics.other_fields:
            return None
        sensed = self._announcement.fields
        found = f"{', '.join(sensed)} instead of" if sensed else "other fields than"
        expected = ", ".join(self._layout.fields)
        return f"the camera senses {found} {expected}; give this command and the camera the same fields"

    def _add_image(self, message: Any) -> None:
        index: int = message.image_index
        key = (index & _ID_MASK, message.time_boot_ms)
        image = self._pending.get(key)
        if key in self._known or (image is not None and image.index >= 0):
            self.statistics.duplicates += 1
            return
        if abs(message.lat) > 900_000_000 or abs(message.lon) > 1_800_000_000 or index < 0:
            self.statistics.malformed += 1
            return
        if message.capture_result != 1:
            self.statistics.failed += 1
            self._finish(key, index)
            return
        if image is None:
            image = self._expect(key)
        image.index = index
        image.latitude_e7 = message.lat
        image.longitude_e7 = message.lon
        image.ahead_m = ground_offset(message.q, message.relative_alt / 1000.0)
        if image.cells and image.cells == image.footprint_cells**2:
            self._complete(key, image)

    def _add_values(self, message: Any) -> None:
        key = (message.array_id, message.time_usec // 1000)
        if not self._layout.fits(message.data):
            self.statistics.other_fields += 1
            return
        part = self._layout.unpack(message.data)
        if part is None:
            self.statistics.malformed += 1
            return
        image = self._pending.get(key)
        if image is None:
            if key in self._known:
                self.statistics.duplicates += 1
                return
            image = self._expect(key)
        elif part.first in image.parts:
            self.statistics.duplicates += 1
            return
        elif image.footprint_cells and image.footprint_cells != part.footprint_cells:
            self.statistics.malformed += 1
            return
        image.footprint_cells = part.footprint_cells
        image.time_us = message.time_usec
        image.parts[part.first] = part.values
        image.cells += part.cells
        if image.index >= 0 and image.cells == part.footprint_cells**2:
            self._complete(key, image)

    def _expect(self, key: _Key) -> _Image:
        if len(self._pending) >= _MAX_PENDING:
            oldest = next(iter(self._pending))
            given_up = self._pending.pop(oldest)
            self.statistics.unpaired += 1
            if given_up.index >= 0:
                self._finish(oldest, given_up.index)
        image = self._pending[key] = _Image()
        return image

    def _complete(self, key: _Key, image: _Image) -> None:
        del self._pending[key]
        self._finish(key, image.index)
        image.time_us += self._moved_us
        if image.time_us < self._since_us:
            self._missing = {index: None for index in self._missing if index > image.index}
            self.statistics.lost = len(self._missing)
            return
        self.statistics.images += 1
        if image.footprint_cells == 1:
            self._single.append((*_place(image), *image.parts[0]))
        else:
            self._wide.append(image)

    def _finish(self, key: _Key, index: int) -> None:
        known = self._known
        known[key] = None
        if len(known) > _MAX_KNOWN:
            del known[next(iter(known))]
        highest = self._highest
        if index == highest + 1 or (highest < 0 and not self._from_first):
            self._first = index if highest < 0 else self._first
            self._highest, self._highest_ms = index, key[1]
        elif index > highest:
            self._miss(highest + 1, index)
            self._highest, self._highest_ms = index, key[1]
        elif index in self._missing:
            del self._missing[index]
        elif key[1] > self._highest_ms:  # The camera began to count anew
            self._highest, self._highest_ms = index, key[1]
        self.statistics.lost = len(self._missing)

    def _miss(self, begin: int, end: int) -> None:
        """Record the image indices from `begin` to `end` - 1 as missing; keep the latest `_MAX_MISSING`."""
        self._missing.update(dict.fromkeys(range(max(begin, end - _MAX_MISSING), end)))
        while len(self._missing) > _MAX_MISSING:
            del self._missing[next(iter(self._missing))]

    def expect_from_first(self, since_s: float = 0.0) -> None:
        """Count the images before the first received image as missing: the link was down when they were sent.

        Images taken before `since_s` on the vehicle's clock belong to earlier flights and are ignored.
        """
        self._from_first = True
        self._since_us = 1e6 * since_s
        # A lossy link may also have lost a few images just before the first image that arrived.
        self._miss(max(0, self._first - _MOST_BEFORE), self._first)
        self._first = 0
        self.statistics.lost = len(self._missing)

    def move_clock(self, seconds: float) -> None:
        """Add `seconds` to the time of each further image, because the vehicle's clock restarted."""
        self._moved_us = 1e6 * seconds

    def expect(self, count: int) -> None:
        """Record as missing all images that have not arrived; the camera has taken `count` images."""
        if self._highest + 1 < count < _MOST_IMAGES:
            self._miss(self._highest + 1, count)
            self._highest = count - 1
            self.statistics.lost = len(self._missing)

    def missing(self, most: int | None = None) -> list[int]:
        """Return up to `most` indices of missing or incomplete images, for a request to resend them."""
        waiting = (image.index for image in self._pending.values() if image.index >= 0)
        return sorted({*islice(self._missing, most), *waiting})[:most]

    @property
    def waiting(self) -> int:
        """Number of cells in the complete images that `take` would turn into observations."""
        return len(self._single) + sum(image.footprint_cells**2 for image in self._wide)

    def take(self) -> Observations:
        """Return the observations that were completed since the last call, in order of time."""
        single, wide = self._single, self._wide
        self._single, self._wide = [], []
        if not single and not wide:
            return Observations.empty(self._layout.fields)
        rows = np.array(single, np.float64).reshape(-1, _PLACE + len(self._layout.fields))
        parts = [self._observe(rows[:, :_PLACE].T, rows[:, None, _PLACE:], 1)]
        for image in wide:
            data = np.concatenate([image.parts[first] for first in sorted(image.parts)])
            where = np.array(_place(image), np.float64)[:, None]
            values = data.reshape(1, -1, len(self._layout.fields))
            parts.append(self._observe(where, values, image.footprint_cells))
        observations = Observations.concatenate(parts, self._layout.fields)
        self.statistics.observations += len(observations)
        if len(parts) == 1 and np.all(observations.time_s[1:] >= observations.time_s[:-1]):
            return observations
        return observations[np.argsort(observations.time_s, kind="stable")]

    def _observe(self, places: Any, values: Any, footprint_cells: int) -> Observations:
        """Return the observations of n images with places[5, n] (see `_place`) and values[n, k, fields]."""
        dx, dy = footprint_offsets(footprint_cells)
        time_us, latitude_e7, longitude_e7, east_m, north_m = places
        x_m, y_m = self._farm.frame.from_wgs84(latitude_e7 / _E7, longitude_e7 / _E7)
        ahead_x_m, ahead_y_m = self._farm.frame.from_east_north(east_m, north_m)
        x_m, y_m = x_m + ahead_x_m, y_m + ahead_y_m
        ix: Any
        iy: Any
        ix, iy = self._farm.cell_of(x_m, y_m)
        x, y = (ix[:, None] + dx).ravel(), (iy[:, None] + dy).ravel()
        time_s = np.repeat(time_us / 1e6 - self._start_s, len(dx))
        flat = values.reshape(-1, len(self._layout.fields)).astype(np.float32)
        kept = (x >= 0) & (x < self._farm.width_cells) & (y >= 0) & (y < self._farm.height_cells)
        kept &= ~np.isnan(flat).all(axis=1)
        self.statistics.off_farm += int(len(kept) - np.count_nonzero(kept))
        day = np.full(int(np.count_nonzero(kept)), self._day, np.int32)
        return Observations(x[kept], y[kept], time_s[kept], day, flat[kept], self._layout.fields)
