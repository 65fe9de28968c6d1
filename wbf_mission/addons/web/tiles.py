"""The user's background map: raster tiles from an untrusted MBTiles or PMTiles file.

Formats: MBTiles 1.3 (an SQLite database, rows counted from the south) and PMTiles 3 (directories of tile
numbers along a Hilbert curve). The browser gets pictures unchanged if they start like PNG, JPEG or WebP.
Sizes stated in a file are not trusted: every read is limited in bytes or in time.
"""

from __future__ import annotations

import bisect
import html
import json
import re
import sqlite3
import struct
import threading
import time
import zlib
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from geo.errors import WbfMissionError
from geo.texts import one_line
from wbf_mission.addons.web.schema import Background

MAX_ZOOM = 30
MAX_TILE_BYTES = 4_000_000
MAX_DIRECTORY_BYTES = 1_000_000
MAX_METADATA_BYTES = 1_000_000
MAX_DEPTH = 4
QUERY_S = 2.0
_ATTRIBUTION = 200
_PICTURES = {
    "image/png": re.compile(rb"\x89PNG\r\n\x1a\n"),
    "image/jpeg": re.compile(rb"\xff\xd8\xff"),
    "image/webp": re.compile(rb"RIFF....WEBP", re.DOTALL),
}
_NO_PICTURES = "has no pictures, but perhaps vector tiles; give a file of raster tiles (PNG, JPEG or WebP)"
_TILE = "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ? LIMIT 1"
_ZOOMS = "SELECT (SELECT min(zoom_level) FROM tiles), (SELECT max(zoom_level) FROM tiles)"


class MapTilesError(WbfMissionError, ValueError):
    """A file of map tiles that cannot be used."""


class MapTiles:
    """Raster tiles of an MBTiles or PMTiles file; raises MapTilesError if it has none. Thread-safe."""

    def __init__(self, path: Path) -> None:
        self._lock = threading.Lock()
        try:
            if path.exists() and not path.is_file():
                raise MapTilesError(f"{path}: is not a file of map tiles; give an MBTiles or PMTiles file")
            with path.open("rb") as file:
                start = file.read(7)
            kinds: dict[bytes, type[_PMTiles | _MBTiles]] = {b"PMTiles": _PMTiles, b"SQLite ": _MBTiles}
            if start not in kinds:
                raise MapTilesError(f"{path}: is neither an MBTiles nor a PMTiles file")
            self._archive = kinds[start](path)
        except MapTilesError:
            raise
        except OSError as error:
            raise MapTilesError(f"{path}: cannot be read ({error.strerror})") from None
        except _DAMAGES as error:
            raise MapTilesError(f"{path}: is damaged ({one_line(str(error), 80)})") from None
        low, high = self._archive.zooms
        if not 0 <= low <= high <= MAX_ZOOM:
            self._archive.close()
            raise MapTilesError(f"{path}: is damaged (zoom levels {low} to {high})")
        plain = html.unescape(re.sub(r"<[^>]*>", "", self._archive.attribution))
        self.background = Background(one_line(re.sub(r"[<>]", "", plain), _ATTRIBUTION), low, high)

    def read(self, z: int, x: int, y: int) -> tuple[bytes, str] | None:
        """Return a tile and its media type (rows count from the north); None if there is no picture."""
        low, high = self._archive.zooms
        if not (low <= z <= high and 0 <= x < 1 << z and 0 <= y < 1 << z):
            return None
        with self._lock:
            try:
                data = self._archive.read(z, x, y)
            except (OSError, *_DAMAGES):
                return None
        kind = None if data is None else _media_type(data)
        return None if data is None or kind is None else (data, kind)

    def close(self) -> None:
        """Close the file of map tiles."""
        with self._lock:
            self._archive.close()


def _media_type(data: bytes) -> str | None:
    return next((kind for kind, begins in _PICTURES.items() if begins.match(data)), None)


class _MBTiles:
    """An SQLite database, opened read-only; queries have a time limit, as `tiles` may be a slow view."""

    def __init__(self, path: Path) -> None:
        self._until_s = time.monotonic() + QUERY_S
        uri = f"{path.absolute().as_uri()}?mode=ro"
        self._database = sqlite3.connect(uri, uri=True, check_same_thread=False)
        try:
            self._database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_TILE_BYTES)
            self._database.execute("PRAGMA trusted_schema = OFF")
            self._database.execute("PRAGMA query_only = ON")
            self._database.set_progress_handler(lambda: time.monotonic() > self._until_s, 10_000)
            rows = self._database.execute("SELECT name, value FROM metadata LIMIT 100").fetchall()
            known = {str(name): str(value) for name, value in rows}
            (first,) = self._database.execute("SELECT tile_data FROM tiles LIMIT 1").fetchone() or (b"",)
            if not isinstance(first, bytes) or _media_type(first) is None:
                raise MapTilesError(f"{path}: {_NO_PICTURES}")
            zooms = self._database.execute(_ZOOMS).fetchone()
            low, high = known.get("minzoom", zooms[0]), known.get("maxzoom", zooms[1])
            self.zooms = int(low or 0), int(high or 0)
        except BaseException:
            self._database.close()
            raise
        self.attribution = known.get("attribution", "")

    def read(self, z: int, x: int, y: int) -> bytes | None:
        self._until_s = time.monotonic() + QUERY_S
        found = self._database.execute(_TILE, (z, x, (1 << z) - 1 - y)).fetchone()
        return found[0] if found and isinstance(found[0], bytes) else None

    def close(self) -> None:
        self._database.close()


class _Directory(NamedTuple):
    """Entries of a PMTiles directory as columns; an entry with a run of 0 points to another directory."""

    ids: list[int]
    runs: list[int]
    lengths: list[int]
    offsets: list[int]


class _PMTiles:
    """PMTiles 3: a header, a root directory, and leaf directories."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb")
        try:
            header = self._file.read(127)
            places = struct.unpack_from("<8Q", header, 8)
            self._root, self._leaves, self._tiles = (places[0], places[1]), places[4], places[6]
            version, packing, tile_packing, kind, low, high = header[7], *header[97:102]
            if version != 3:
                raise MapTilesError(f"{path}: is PMTiles version {version}; give a file of version 3")
            if kind not in (0, 2, 3, 4):
                raise MapTilesError(f"{path}: {_NO_PICTURES}")
            if packing not in (1, 2) or tile_packing not in (0, 1):
                raise MapTilesError(f"{path}: has an unknown compression; only gzip can be read")
            self._gzip = packing == 2
            self.zooms = low, high
            self._directory = lru_cache(8)(self._read_directory)
            self._directory(*self._root)
            metadata: Any = json.loads(self._unpacked(places[2], places[3], MAX_METADATA_BYTES) or b"{}")
        except BaseException:
            self._file.close()
            raise
        self.attribution = str(metadata.get("attribution", "")) if isinstance(metadata, dict) else ""

    def read(self, z: int, x: int, y: int) -> bytes | None:
        wanted, place = _tile_id(z, x, y), self._root
        for _ in range(MAX_DEPTH):
            found = self._directory(*place)
            k = bisect.bisect_right(found.ids, wanted) - 1
            if k < 0:
                return None
            if found.runs[k]:
                inside = wanted < found.ids[k] + found.runs[k]
                tile = self._tiles + found.offsets[k], found.lengths[k]
                return self._at(*tile, MAX_TILE_BYTES) if inside else None
            place = self._leaves + found.offsets[k], found.lengths[k]
        return None

    def close(self) -> None:
        self._file.close()

    def _at(self, offset: int, length: int, limit: int) -> bytes:
        if length > limit:
            raise ValueError(f"a part of {length} bytes")
        self._file.seek(offset)
        data = self._file.read(length)
        if len(data) < length:
            raise ValueError("it ends in the middle")
        return data

    def _unpacked(self, offset: int, length: int, limit: int) -> bytes:
        data = self._at(offset, length, limit)
        if not self._gzip or not data:
            return data
        unpack = zlib.decompressobj(wbits=31)
        data = unpack.decompress(data, limit)
        if unpack.unconsumed_tail:
            raise ValueError(f"a part of more than {limit} bytes")
        return data

    def _read_directory(self, offset: int, length: int) -> _Directory:
        numbers = _varints(self._unpacked(offset, length, MAX_DIRECTORY_BYTES))
        count = numbers[0] if numbers else 0
        if len(numbers) != 4 * count + 1:
            raise ValueError("a directory of another length")
        steps, runs, lengths, places = (numbers[1 + k * count : 1 + (k + 1) * count] for k in range(4))
        ids, offsets, at, end = [], [], 0, 0
        for step, size, place in zip(steps, lengths, places, strict=True):
            at += step
            start = place - 1 if place else end  # 0: the tile follows the previous one
            end = start + size
            ids.append(at)
            offsets.append(start)
        return _Directory(ids, runs, lengths, offsets)


_DAMAGES = (sqlite3.Error, ValueError, struct.error, zlib.error, IndexError, OverflowError, RecursionError)


def _varints(data: bytes) -> list[int]:
    """Decode varints: seven bits per byte, lowest first."""
    numbers, value, shift = [], 0, 0
    for byte in data:
        value |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            numbers.append(value)
            value = shift = 0
        elif shift > 63:
            raise ValueError("a number of more than 64 bits")
    return numbers


def _tile_id(z: int, x: int, y: int) -> int:
    """Return the number of a tile; numbers count all lower zoom levels, then go along the Hilbert curve.

    >>> [_tile_id(*zxy) for zxy in ((0, 0, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0), (2, 0, 0))]
    [0, 1, 2, 3, 4, 5]
    """
    number, side = ((1 << 2 * z) - 1) // 3, 1 << z >> 1
    while side:
        right, top = bool(x & side), bool(y & side)
        number += side * side * ((3 * right) ^ top)
        if not top:
            if right:
                x, y = side - 1 - (x & side - 1), side - 1 - (y & side - 1)
            x, y = y, x
        side >>= 1
    return number
