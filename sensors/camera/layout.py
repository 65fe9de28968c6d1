"""Layout of DEBUG_FLOAT_ARRAY messages that carry the readings of an image, or announce the field names.

Readings have two layouts. Messages of version 1, ``WBF_LEAF``, carry the benchmark's three fields:

====== ===============================================================================
0      image index (exact up to 2^24; beyond, ``array_id`` and the time identify the image)
1      side of the square footprint in cells, n
2      number of the first cell of this message within the footprint
3 ...  the values cell by cell, each in the order of the fields; NaN where not sensed
====== ===============================================================================

Messages of version 2, ``WBF_LEAF2``, carry any other fields, with two more floats before the values:

====== ===============================================================================
3      number of fields
4      check number of the names: the first 24 bits of the SHA-256 of the names joined by commas
5 ...  the values
====== ===============================================================================

A camera of version 2 also announces the field names with its first image and then every `ANNOUNCED_EVERY`
images. Each message ``WBF_FIELDS`` carries a part of the names, numbered from 0 by ``array_id``:

====== ===============================================================================
0      version of the layout, 2
1      check number of the names
2      length of the joined names in characters
3 ...  the characters from ``array_id * 55`` on, one number each
====== ===============================================================================
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from sensors.camera.leaf_camera import MAX_FOOTPRINT_CELLS
from sensors.fields import MAX_FIELDS, PAPER_FIELDS

ARRAY_FLOATS = 58
LEAF_NAME = "WBF_LEAF"
FURTHER_NAME = "WBF_LEAF2"
FIELDS_NAME = "WBF_FIELDS"
ANNOUNCED_EVERY = 64
"""Number of images after which the field names are announced again, for receivers that join late."""

_VERSION = 2
_NAMES_HEADER = 3
_NAMES_FLOATS = ARRAY_FLOATS - _NAMES_HEADER
_MAX_NAMES = 25 * MAX_FIELDS


@dataclass(frozen=True, slots=True)
class Readings:
    """Readings of one message, which may be only a part of an image's readings."""

    footprint_cells: int
    first: int
    cells: int
    values: list[float]


@dataclass(frozen=True, slots=True)
class LeafLayout:
    """Layout of messages with readings of a set of fields.

    `header` follows the first three floats of a message. A message holds up to `cells_per_array` cells.

    Examples
    --------
    >>> LeafLayout.of(PAPER_FIELDS.names).pack(7, 1, [[1.0, 0.5, 0.25]])
    [[7.0, 1.0, 0.0, 1.0, 0.5, 0.25]]
    >>> layout = LeafLayout.of(("ccr", "nitrogen"))
    >>> layout.name, layout.pack(7, 1, [[1.0, 0.5]])
    ('WBF_LEAF2', [[7.0, 1.0, 0.0, 2.0, 3747660.0, 1.0, 0.5]])
    """

    fields: tuple[str, ...]
    name: str
    header: tuple[float, ...]
    cells_per_array: int

    @staticmethod
    @lru_cache(maxsize=16)
    def of(fields: tuple[str, ...]) -> LeafLayout:
        """Return the layout of messages with readings of these fields."""
        header: tuple[float, ...] = ()
        name = LEAF_NAME
        if fields != PAPER_FIELDS.names:
            header, name = (float(len(fields)), _check_number(fields)), FURTHER_NAME
        return LeafLayout(fields, name, header, (ARRAY_FLOATS - 3 - len(header)) // len(fields))

    def pack(
        self, image_index: int, footprint_cells: int, values: Sequence[Sequence[float]]
    ) -> list[list[float]]:
        """Return the data of each message for an image; `values` has one row per cell."""
        parts = []
        for first in range(0, len(values), self.cells_per_array):
            data = [float(image_index), float(footprint_cells), float(first), *self.header]
            for cell in values[first : first + self.cells_per_array]:
                data += cell
            parts.append(data)
        return parts

    def unpack(self, data: Sequence[float]) -> Readings | None:
        """Return the readings in a message's data, or None if the data are invalid."""
        side, first = data[1], data[2]
        if not (1.0 <= side <= MAX_FOOTPRINT_CELLS and side % 1.0 == 0.0 and 0.0 <= first < side * side):
            return None
        n, start = int(side), int(first)
        cells = min(n * n - start, self.cells_per_array)
        offset = 3 + len(self.header)
        values = list(data[offset : offset + len(self.fields) * cells])
        if start % self.cells_per_array or math.inf in values or -math.inf in values:
            return None
        return Readings(n, start, cells, values)

    def fits(self, data: Sequence[float]) -> bool:
        """Return whether the header in a message's data is the header of this layout's fields."""
        return tuple(data[3 : 3 + len(self.header)]) == self.header

    def announcement(self) -> list[list[float]]:
        """Return the data of each message that announces the field names; version 1 has no such message."""
        if not self.header:
            return []
        text = ",".join(self.fields)
        header = [float(_VERSION), self.header[1], float(len(text))]
        return [
            header + [float(ord(letter)) for letter in text[start : start + _NAMES_FLOATS]]
            for start in range(0, len(text), _NAMES_FLOATS)
        ]


class Announcement:
    """Assembles the field names from the parts of an announcement, which may arrive in any order.

    Examples
    --------
    >>> heard = Announcement()
    >>> for number, data in enumerate(LeafLayout.of(("ccr", "nitrogen")).announcement()):
    ...     _ = heard.add(number, data + [0.0] * (58 - len(data)))
    >>> heard.fields
    ('ccr', 'nitrogen')
    """

    def __init__(self) -> None:
        self._parts: dict[int, str] = {}
        self._header: tuple[float, ...] = ()
        self.fields: tuple[str, ...] | None = None

    def add(self, number: int, data: Sequence[float]) -> bool:
        """Add a message's data, part `number` of the announcement; return False if the data are invalid."""
        header = tuple(data[:_NAMES_HEADER])
        version, check, length = header
        start = number * _NAMES_FLOATS
        if version != _VERSION or not (1.0 <= length <= _MAX_NAMES and length % 1.0 == 0.0):
            return False
        codes = data[_NAMES_HEADER : _NAMES_HEADER + max(0, int(length) - start)]
        if not codes or not all(32.0 < code < 127.0 and code % 1.0 == 0.0 for code in codes):
            return False
        if header != self._header:
            self._parts, self._header = {}, header
        self._parts[number] = "".join(chr(int(code)) for code in codes)
        text = "".join(self._parts[part] for part in sorted(self._parts))
        if len(text) == length:
            names = tuple(text.split(","))
            if _check_number(names) != check:
                return False
            self.fields = names
        return True


def _check_number(fields: tuple[str, ...]) -> float:
    digest = hashlib.sha256(",".join(fields).encode()).digest()
    return float(int.from_bytes(digest[:3], "big"))
