"""The user's own map tiles: MBTiles and PMTiles files, good ones and hostile ones."""

from __future__ import annotations

import gzip
import itertools
import json
import os
import random
import sqlite3
import struct
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweeps import sweep

from wbf_mission.addons.web import tiles
from wbf_mission.addons.web.tiles import MapTiles, MapTilesError, _tile_id, _varints

PNG = b"\x89PNG\r\n\x1a\n"
JPEG = b"\xff\xd8\xff\xe0"
WEBP = b"RIFF\x00\x00\x00\x00WEBP"


def mbtiles(path: Path, rows: list[tuple[int, int, int, Any]], **metadata: str) -> Path:
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        database.execute("CREATE TABLE tiles (zoom_level INT, tile_column INT, tile_row INT, tile_data BLOB)")
        database.executemany("INSERT INTO metadata VALUES (?, ?)", metadata.items())
        database.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", rows)
    database.close()
    return path


def varint(number: int) -> bytes:
    found = bytearray()
    while number > 0x7F:
        found.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*found, number])


def directory(entries: list[tuple[int, int, int, int]]) -> bytes:
    """Entries of number, run, length and offset, as a directory is written."""
    steps = [one[0] - before for one, before in zip(entries, [0, *(e[0] for e in entries)], strict=False)]
    columns = [
        steps,
        [one[1] for one in entries],
        [one[2] for one in entries],
        [one[3] + 1 for one in entries],
    ]
    return varint(len(entries)) + b"".join(varint(n) for column in columns for n in column)


def pmtiles(
    path: Path,
    root: bytes,
    leaves: bytes = b"",
    data: bytes = b"",
    *,
    metadata: bytes = b"{}",
    version: int = 3,
    packing: int = 2,
    kind: int = 2,
    zooms: tuple[int, int] = (0, 3),
) -> Path:
    pack: Callable[[bytes], bytes] = gzip.compress if packing == 2 else bytes
    parts = [pack(root), pack(metadata), leaves, data]
    places, at = [], 127
    for part in parts:
        places += [at, len(part)]
        at += len(part)
    header = b"PMTiles" + bytes([version]) + struct.pack("<8Q", *places) + bytes(24)
    header += bytes([1, packing, 1, kind, *zooms])
    path.write_bytes(header.ljust(127, b"\0") + b"".join(parts))
    return path


def test_an_mbtiles_file_counts_its_rows_from_the_south(tmp_path: Path) -> None:
    rows = [(1, 0, 1, PNG), (1, 1, 0, JPEG), (2, 3, 3, WEBP), (2, 0, 0, b"<svg>"), (2, 1, 1, "text")]
    path = mbtiles(
        tmp_path / "a map?.mbtiles", rows, minzoom="1", maxzoom="2", attribution="x <a href='y'>&copy; z</a>"
    )
    before = path.read_bytes()
    held = MapTiles(path)
    assert held.read(1, 0, 0) == (PNG, "image/png")
    assert held.read(1, 1, 1) == (JPEG, "image/jpeg")
    assert held.read(2, 3, 0) == (WEBP, "image/webp")
    for place in ((2, 0, 3), (2, 1, 2), (1, 1, 0), (0, 0, 0), (3, 0, 0), (1, 2, 0), (1, 0, 5)):
        assert held.read(*place) is None
    assert (held.background.attribution, held.background.min_zoom, held.background.max_zoom) == (
        "x © z",
        1,
        2,
    )
    held.close()
    assert path.read_bytes() == before and [one.name for one in tmp_path.iterdir()] == [path.name]


def test_attribution_is_no_markup(tmp_path: Path) -> None:
    hostile = "<script>alert(1)</script>&lt;img src=x&gt; <b"
    held = MapTiles(mbtiles(tmp_path / "m", [(0, 0, 0, PNG)], attribution=hostile + "y" * 1000))
    assert not set("<>") & set(held.background.attribution) and len(held.background.attribution) <= 200
    held.close()


def test_a_query_that_never_ends_is_cut_short(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiles, "QUERY_S", 0.3)
    endless = "WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n)"
    shape = "k AS zoom_level, 0 AS tile_column, 0 AS tile_row, x'00' AS tile_data FROM n WHERE k < 0"
    path = tmp_path / "endless"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE metadata (name, value)")
        database.execute(f"CREATE VIEW tiles AS {endless} SELECT {shape}")
    database.close()
    began = time.monotonic()
    with pytest.raises(MapTilesError, match="interrupted"):
        MapTiles(path)
    assert time.monotonic() - began < 60


def test_a_picture_that_is_too_large_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "large"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE metadata (name, value)")
        place = "0 AS zoom_level, 0 AS tile_column, 0 AS tile_row"
        database.execute(f"CREATE VIEW tiles AS SELECT {place}, zeroblob(900000000) AS tile_data")
    database.close()
    with pytest.raises(MapTilesError):
        MapTiles(path)


@pytest.mark.parametrize("packing", [1, 2])
def test_a_pmtiles_file_is_read_by_its_directories(tmp_path: Path, packing: int) -> None:
    pack: Callable[[bytes], bytes] = gzip.compress if packing == 2 else bytes
    first, second = PNG + b"first", JPEG + b"second"
    leaf = pack(
        directory([(_tile_id(2, 1, 1), 1, len(first), 0), (_tile_id(3, 0, 0), 4, len(second), len(first))])
    )
    root = directory([(0, 1, len(first), 0), (_tile_id(2, 0, 0), 0, len(leaf), 0)])
    metadata = json.dumps({"attribution": "the land office"}).encode()
    held = MapTiles(pmtiles(tmp_path / "p", root, leaf, first + second, metadata=metadata, packing=packing))
    assert held.background.attribution == "the land office"
    assert held.read(0, 0, 0) == (first, "image/png") == held.read(2, 1, 1)
    by_number = {_tile_id(3, x, y): (x, y) for x in range(8) for y in range(8)}
    run = [by_number[_tile_id(3, 0, 0) + k] for k in range(5)]
    assert [held.read(3, *place) for place in run] == [(second, "image/jpeg")] * 4 + [None]
    assert held.read(1, 0, 0) is None and held.read(2, 0, 0) is None
    held.close()


def test_numbers_of_tiles_follow_a_hilbert_curve() -> None:
    # From the specification of PMTiles 3.
    assert [
        _tile_id(*zxy) for zxy in ((0, 0, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0), (2, 0, 0))
    ] == list(range(6))
    assert _tile_id(12, 3423, 1763) == 19078479
    for z in range(5):
        numbers = {_tile_id(z, x, y): (x, y) for x in range(1 << z) for y in range(1 << z)}
        assert sorted(numbers) == list(range((4**z - 1) // 3, (4 ** (z + 1) - 1) // 3))
        places = [numbers[number] for number in sorted(numbers)]
        assert all(abs(a - c) + abs(b - d) == 1 for (a, b), (c, d) in itertools.pairwise(places))


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (lambda path: mbtiles(path, [(0, 0, 0, gzip.compress(b"vector"))], format="pbf"), "vector"),
        (lambda path: mbtiles(path, []), "no pictures"),
        (lambda path: mbtiles(path, [(0, 0, 0, PNG)], minzoom="x"), "damaged"),
        (lambda path: mbtiles(path, [(0, 0, 0, PNG)], maxzoom="99999"), "zoom levels"),
        (lambda path: pmtiles(path, directory([]), kind=1), "vector"),
        (lambda path: pmtiles(path, directory([]), version=2), "version 2"),
        (lambda path: pmtiles(path, directory([]), packing=3), "only gzip"),
        (lambda path: pmtiles(path, directory([]), zooms=(9, 3)), "zoom levels"),
        (lambda path: pmtiles(path, b"\xff" * 50), "64 bits"),
        (lambda path: pmtiles(path, varint(10**15)), "another length"),
        (lambda path: pmtiles(path, bytes(50_000_000)), "more than"),
        (lambda path: pmtiles(path, directory([]), metadata=bytes(50_000_000)), "more than"),
        (lambda path: pmtiles(path, directory([]), metadata=b"[" * 100_000), "damaged"),
        (lambda path: path.write_bytes(b"PMTiles\x03" + b"\xff" * 200), "no pictures"),
        (lambda path: path.write_bytes(b"PMTiles"), "damaged"),
        (lambda path: path.write_bytes(b"SQLite format 3\0" + b"\xff" * 5000), "damaged"),
        (lambda path: path.write_bytes(b"something else"), "neither an MBTiles nor a PMTiles"),
        (lambda path: path.mkdir(), "is not a file"),
        (os.mkfifo, "is not a file"),
        (lambda path: None, "cannot be read"),
    ],
)
def test_what_cannot_be_used_is_told_in_one_line(
    tmp_path: Path, made: Callable[[Path], Any], told: str
) -> None:
    path = tmp_path / "file"
    made(path)
    with pytest.raises(MapTilesError) as error:
        MapTiles(path)
    assert told in str(error.value) and str(path) in str(error.value) and "\n" not in str(error.value)


def test_directories_that_lead_back_to_themselves_end(tmp_path: Path) -> None:
    # The leaf's only entry is the leaf again; its length does not depend on its content's.
    leaf = directory([(0, 0, 6, 0)])
    root = directory([(0, 0, len(leaf), 0)])
    held = MapTiles(pmtiles(tmp_path / "loop", root, leaf, packing=1))
    assert held.read(0, 0, 0) is None
    held.close()


@sweep(few=25, many=150)
@given(st.integers(0, 2**32), st.booleans())
def test_damaged_files_end_in_an_error_or_in_tiles(
    tmp_path_factory: pytest.TempPathFactory, seed: int, gzipped: bool
) -> None:
    made, folder = random.Random(seed), tmp_path_factory.mktemp("damaged")
    leaf = directory([(5, 1, 8, 0), (9, 2, 8, 8)])
    root = directory([(0, 1, 8, 0), (1, 0, len(leaf), 0)])
    for path in (
        pmtiles(folder / "p", root, leaf, PNG + PNG, packing=2 if gzipped else 1),
        mbtiles(folder / "m", [(0, 0, 0, PNG), (1, 0, 0, PNG)], minzoom="0", maxzoom="1"),
    ):
        data = bytearray(path.read_bytes())
        for _ in range(made.randrange(1, 12)):
            data[made.randrange(min(len(data), 9000))] = made.randrange(256)
        path.write_bytes(data[: made.randrange(len(data))] if made.random() < 0.2 else data)
        try:
            held = MapTiles(path)
        except MapTilesError:
            continue
        for z in range(4):
            for x in range(1 << z):
                held.read(z, x, made.randrange(1 << z))
        held.close()


@given(st.lists(st.integers(0, 2**63)))
def test_numbers_are_read_as_they_are_written(numbers: list[int]) -> None:
    assert _varints(b"".join(map(varint, numbers))) == numbers
