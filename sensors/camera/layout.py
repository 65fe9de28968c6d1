"""Layout of an image's readings, and of the announcement of field names, in DEBUG_FLOAT_ARRAY messages.

There are two versions. Version 1, with the name ``WBF_LEAF``, carries the benchmark's three fields:

====== ===============================================================================
0      image index (exact up to 2^24; beyond, ``array_id`` and the time identify the image)
1      side of the square footprint in cells, n
2      number of the first cell of this message within the footprint
3 ...  the values cell by cell, each in the order of the fields; NaN where not sensed
====== ===============================================================================

Version 2, with the name ``WBF_LEAF2``, carries any other set of fields. Two floats more precede the values:

====== ===============================================================================
3      number of fields
4      check number of the names: the first 24 bits of the SHA-256 of the names joined by commas
5 ...  the values
====== ===============================================================================

A camera of version 2 also announces the field names, with its first image and then every `ANNOUNCED_EVERY`
images, in DEBUG_FLOAT_ARRAY messages ``WBF_FIELDS`` (``array_id`` is the number of the part, from 0):

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
"""Number of images between two announcements of the field names, repeated for receivers that join late."""

_VERSION = 2
_NAMES_HEADER = 3
_NAMES_FLOATS = ARRAY_FLOATS - _NAMES_HEADER
_MAX_NAMES = 25 * MAX_FIELDS


@dataclass(frozen=True, slots=True)
class Readings:
    """The part of an image's readings that one message carries."""

    footprint_cells: int
    first: int
    cells: int
    values: list[float]


@dataclass(frozen=True, slots=True)
class LeafLayout:
    """Layout of the readings of a set of fields.

    `header` follows the first three floats of a message; `cells_per_array` cells fit into a message.

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
        """Return the layout for these fields."""
        header: tuple[float, ...] = ()
        name = LEAF_NAME
        if fields != PAPER_FIELDS.names:
            header, name = (float(len(fields)), _check_number(fields)), FURTHER_NAME
        return LeafLayout(fields, name, header, (ARRAY_FLOATS - 3 - len(header)) // len(fields))

    def pack(
        self, image_index: int, footprint_cells: int, values: Sequence[Sequence[float]]
    ) -> list[list[float]]:
        """Return the data of each message for the readings of an image, one row of values per cell."""
        parts = []
        for first in range(0, len(values), self.cells_per_array):
            data = [float(image_index), float(footprint_cells), float(first), *self.header]
            for cell in values[first : first + self.cells_per_array]:
                data += cell
            parts.append(data)
        return parts

    def unpack(self, data: Sequence[float]) -> Readings | None:
        """Return the readings in the data of a message; None if the data are invalid."""
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
        """Return whether the header in the data of a message is the header of these fields."""
        return tuple(data[3 : 3 + len(self.header)]) == self.header

    def announcement(self) -> list[list[float]]:
        """Return the data of each message that announces the field names; none for version 1."""
        if not self.header:
            return []
        text = ",".join(self.fields)
        header = [float(_VERSION), self.header[1], float(len(text))]
        return [
            header + [float(ord(letter)) for letter in text[start : start + _NAMES_FLOATS]]
            for start in range(0, len(text), _NAMES_FLOATS)
        ]


class Announcement:
    """Assembly of the field names from the parts of an announcement, in any order.

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
        """Add the data of a message; return False if the data are invalid."""
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
