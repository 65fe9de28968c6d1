"""What the leaf camera saw, on its way over MAVLink and back.

A picture is two standard messages: CAMERA_IMAGE_CAPTURED says when and where, DEBUG_FLOAT_ARRAY (name
``WBF_LEAF``) holds the readings. They belong together by the image index (its low 16 bits are the array's
``array_id``) and by their time since boot. The array's data are

====== ===============================================================================
0      image index (exact up to 2^24; beyond, ``array_id`` and the time still identify it)
1      side of the square footprint in cells, n
2      number of the footprint's first cell in this message
3 ...  for each cell in turn its values in the order of `FIELDS`, NaN where not sensed
====== ===============================================================================

for as many cells as fit, so that a footprint of more than 18 cells takes several messages. The picture's cell
is the one under the reported position, rounded to 1e-7 degree as in the message; the footprint's cells
count from there in the order of `sensors.camera.leaf_camera.footprint_offsets`.

Nothing here needs a MAVLink library: messages are told by their ``id`` and read by their fields.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from sensors.camera.leaf_camera import MAX_FOOTPRINT_CELLS, footprint_offsets
from sensors.fields import FIELDS
from sensors.observations import Observations

if TYPE_CHECKING:
    from geo.farm import Farm

LEAF_NAME = "WBF_LEAF"
CAMERA_IMAGE_CAPTURED = 263
DEBUG_FLOAT_ARRAY = 350
ARRAY_FLOATS = 58
HEADER_FLOATS = 3
CELLS_PER_ARRAY = (ARRAY_FLOATS - HEADER_FLOATS) // len(FIELDS)
_ID_MASK = 0xFFFF
_MAX_PENDING = 1024
_MAX_KNOWN = 32768
_MAX_MISSING = 10_000
_E7 = 1e7
_Key = tuple[int, int]


def pack_values(
    image_index: int, footprint_cells: int, values: Sequence[Sequence[float]]
) -> list[list[float]]:
    """Return the data of the DEBUG_FLOAT_ARRAY messages of one picture.

    Parameters
    ----------
    image_index : int
        Index of the picture.
    footprint_cells : int
        Side of the footprint.
    values : sequence of footprint_cells ** 2 sequences of float
        Readings of each cell.

    Examples
    --------
    >>> pack_values(7, 1, [[1.0, 0.5, 0.25]])
    [[7.0, 1.0, 0.0, 1.0, 0.5, 0.25]]
    """
    parts = []
    for first in range(0, len(values), CELLS_PER_ARRAY):
        data = [float(image_index), float(footprint_cells), float(first)]
        for cell in values[first : first + CELLS_PER_ARRAY]:
            data += cell
        parts.append(data)
    return parts


@dataclass(slots=True)
class AssemblerStatistics:
    """What arrived.

    Parameters
    ----------
    pictures : int
        Pictures of which both halves arrived.
    observations : int
        Cells with at least one reading that they gave.
    duplicates : int
        Messages of a picture or half that was there already.
    lost : int
        Pictures missing by the gaps in the image index, now.
    unpaired : int
        Pictures given up because a half never came.
    failed : int
        Pictures that the camera reported as failed.
    malformed : int
        Messages whose content makes no sense.
    off_farm : int
        Cells that do not lie on the farm, or that had no reading at all.
    """

    pictures: int = 0
    observations: int = 0
    duplicates: int = 0
    lost: int = 0
    unpaired: int = 0
    failed: int = 0
    malformed: int = 0
    off_farm: int = 0


@dataclass(slots=True)
class _Picture:
    """A picture of which something arrived."""

    index: int = -1
    latitude_e7: int = 0
    longitude_e7: int = 0
    time_us: int = 0
    footprint_cells: int = 0
    parts: dict[int, list[float]] = field(default_factory=dict)
    cells: int = 0


class ObservationAssembler:
    """Pairs the camera's messages, in any order, and gives observations.

    Parameters
    ----------
    farm : Farm
        Turns positions into cells.
    day : int
        Day of the flight, stored with each observation.
    system_id, component_id : int, optional
        The camera to listen to; None is any.
    start_s : float
        The vehicle's clock (seconds since boot) when the run began: times count from there.

    Attributes
    ----------
    statistics : AssemblerStatistics

    Notes
    -----
    Lost messages cost their picture, duplicates are counted, nonsense is counted and never raises. At most
    1024 incomplete pictures are kept.
    """

    def __init__(
        self,
        farm: Farm,
        *,
        day: int,
        system_id: int | None = None,
        component_id: int | None = None,
        start_s: float = 0.0,
    ) -> None:
        self.statistics = AssemblerStatistics()
        self._farm = farm
        self._day = day
        self._source = (system_id, component_id)
        self._any_source = system_id is None and component_id is None
        self._start_s = start_s
        self._pending: dict[_Key, _Picture] = {}
        self._known: dict[_Key, None] = {}
        self._missing: dict[int, None] = {}
        self._highest = -1
        self._highest_ms = 0
        self._single: list[tuple[int, int, int, float, float, float]] = []
        self._wide: list[_Picture] = []

    def add(self, message: Any) -> None:
        """Take a MAVLink message; what is not the camera's is ignored."""
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
        elif message.name == LEAF_NAME:
            self._add_values(message)

    def _add_image(self, message: Any) -> None:
        index: int = message.image_index
        key = (index & _ID_MASK, message.time_boot_ms)
        picture = self._pending.get(key)
        if key in self._known or (picture is not None and picture.index >= 0):
            self.statistics.duplicates += 1
            return
        if abs(message.lat) > 900_000_000 or abs(message.lon) > 1_800_000_000 or index < 0:
            self.statistics.malformed += 1
            return
        if message.capture_result != 1:
            self.statistics.failed += 1
            self._finish(key, index)
            return
        if picture is None:
            picture = self._expect(key)
        picture.index = index
        picture.latitude_e7 = message.lat
        picture.longitude_e7 = message.lon
        if picture.cells and picture.cells == picture.footprint_cells**2:
            self._complete(key, picture)

    def _add_values(self, message: Any) -> None:
        data = message.data
        key = (message.array_id, message.time_usec // 1000)
        side, first = data[1], data[2]
        if not (1.0 <= side <= MAX_FOOTPRINT_CELLS and side % 1.0 == 0.0 and 0.0 <= first < side * side):
            self.statistics.malformed += 1
            return
        n, start = int(side), int(first)
        cells = min(n * n - start, CELLS_PER_ARRAY)
        values = data[HEADER_FLOATS : HEADER_FLOATS + len(FIELDS) * cells]
        if start % CELLS_PER_ARRAY or math.inf in values or -math.inf in values:
            self.statistics.malformed += 1
            return
        picture = self._pending.get(key)
        if picture is None:
            if key in self._known:
                self.statistics.duplicates += 1
                return
            picture = self._expect(key)
        elif start in picture.parts:
            self.statistics.duplicates += 1
            return
        elif picture.footprint_cells and picture.footprint_cells != n:
            self.statistics.malformed += 1
            return
        picture.footprint_cells = n
        picture.time_us = message.time_usec
        picture.parts[start] = values
        picture.cells += cells
        if picture.index >= 0 and picture.cells == n * n:
            self._complete(key, picture)

    def _expect(self, key: _Key) -> _Picture:
        if len(self._pending) >= _MAX_PENDING:
            oldest = next(iter(self._pending))
            given_up = self._pending.pop(oldest)
            self.statistics.unpaired += 1
            if given_up.index >= 0:
                self._finish(oldest, given_up.index)
        picture = self._pending[key] = _Picture()
        return picture

    def _complete(self, key: _Key, picture: _Picture) -> None:
        del self._pending[key]
        self._finish(key, picture.index)
        self.statistics.pictures += 1
        if picture.footprint_cells == 1:
            tylcv, ccr, soil = picture.parts[0]
            self._single.append(
                (picture.time_us, picture.latitude_e7, picture.longitude_e7, tylcv, ccr, soil)
            )
        else:
            self._wide.append(picture)

    def _finish(self, key: _Key, index: int) -> None:
        known = self._known
        known[key] = None
        if len(known) > _MAX_KNOWN:
            del known[next(iter(known))]
        highest = self._highest
        if index == highest + 1 or highest < 0:
            self._highest, self._highest_ms = index, key[1]
        elif index > highest:
            self._missing.update(dict.fromkeys(range(max(highest + 1, index - _MAX_MISSING), index)))
            self._highest, self._highest_ms = index, key[1]
            while len(self._missing) > _MAX_MISSING:
                del self._missing[next(iter(self._missing))]
        elif index in self._missing:
            del self._missing[index]
        elif key[1] > self._highest_ms:  # a camera that counts anew
            self._highest, self._highest_ms = index, key[1]
        self.statistics.lost = len(self._missing)

    def missing(self) -> list[int]:
        """Return the indexes of pictures that have not arrived whole: to be asked for again."""
        waiting = (picture.index for picture in self._pending.values() if picture.index >= 0)
        return sorted({*self._missing, *waiting})

    def take(self) -> Observations:
        """Return the observations completed since the last call, in order of time."""
        single, wide = self._single, self._wide
        self._single, self._wide = [], []
        if not single and not wide:
            return Observations.empty()
        rows = np.array(single, np.float64).reshape(-1, 6)
        parts = [self._observe(rows[:, 0], rows[:, 1], rows[:, 2], rows[:, None, 3:], 1)]
        for picture in wide:
            data = np.concatenate([picture.parts[first] for first in sorted(picture.parts)])
            where = np.array([[picture.time_us], [picture.latitude_e7], [picture.longitude_e7]], np.float64)
            values = data.reshape(1, -1, len(FIELDS))
            parts.append(self._observe(where[0], where[1], where[2], values, picture.footprint_cells))
        observations = Observations.concatenate(parts)
        self.statistics.observations += len(observations)
        if len(parts) == 1 and np.all(observations.time_s[1:] >= observations.time_s[:-1]):
            return observations
        return observations[np.argsort(observations.time_s, kind="stable")]

    def _observe(
        self, time_us: Any, latitude_e7: Any, longitude_e7: Any, values: Any, footprint_cells: int
    ) -> Observations:
        """Return the observations of n pictures with values[n, k, 3]."""
        dx, dy = footprint_offsets(footprint_cells)
        x_m, y_m = self._farm.frame.from_wgs84(latitude_e7 / _E7, longitude_e7 / _E7)
        ix: Any
        iy: Any
        ix, iy = self._farm.cell_of(x_m, y_m)
        x, y = (ix[:, None] + dx).ravel(), (iy[:, None] + dy).ravel()
        time_s = np.repeat(time_us / 1e6 - self._start_s, len(dx))
        flat = values.reshape(-1, len(FIELDS)).astype(np.float32)
        kept = (x >= 0) & (x < self._farm.width_cells) & (y >= 0) & (y < self._farm.height_cells)
        kept &= ~np.isnan(flat).all(axis=1)
        self.statistics.off_farm += int(len(kept) - np.count_nonzero(kept))
        day = np.full(int(np.count_nonzero(kept)), self._day, np.int32)
        return Observations(x[kept], y[kept], time_s[kept], day, flat[kept])
