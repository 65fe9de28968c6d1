"""Compare ways to keep a day of soil humidity: size, time to write, to read a window and to read the day.

Examples::

    python benchmarks/environment_store.py
    python benchmarks/environment_store.py --farm miniberry-100

All numbers are of one day; days of different wetness compress differently, so three are tried and the means
given. "computed again" keeps nothing but the weather and computes what is asked for, through all days before.
"""

from __future__ import annotations

import argparse
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from scratch import scratch_folder
from zarr.codecs import BloscCodec, Crc32cCodec, ZstdCodec

from geo.farms import get_farm
from sensors.dynamics.soil import SoilCourse, SoilParameters, draw_weather

DAYS = (1, 6, 15)
WINDOW = 100
Soil = NDArray[np.float32]


@dataclass(frozen=True)
class Store:
    """A way to keep days: how it writes them, and how it opens them for reading."""

    name: str
    write: Callable[[Path, list[Soil]], None]
    read: Callable[[Path, int, slice, slice], Any]


def zarr_store(name: str, chunk: int, codecs: list[Any], *, shards: bool = True) -> Store:
    """Zarr, in square chunks; a shard is a day."""

    def write(path: Path, days: list[Soil]) -> None:
        width, height = days[0].shape
        side = (min(chunk, width), min(chunk, height))
        shard = tuple(-(-size // part) * part for size, part in zip((width, height), side, strict=True))
        array: Any = zarr.create_array(
            path,
            shape=(len(days), width, height),
            chunks=(1, *side),
            shards=(1, *shard) if shards else None,
            dtype="float32",
            compressors=codecs,
            fill_value=float("nan"),
            config={"write_empty_chunks": True},
        )
        for index, day in enumerate(days):
            array[index] = day

    def read(path: Path, index: int, x: slice, y: slice) -> Any:
        array: Any = zarr.open_array(path, mode="r")
        return array[index, x, y]

    return Store(f"zarr, {name}, {chunk} x {chunk}" + ("" if shards else ", a file a chunk"), write, read)


def write_npy(path: Path, days: list[Soil]) -> None:
    """Write a NumPy file a day."""
    path.mkdir()
    for index, day in enumerate(days):
        np.save(path / f"{index}.npy", day)


def read_npy(path: Path, index: int, x: slice, y: slice) -> Any:
    """Read a part of a memory-mapped NumPy file."""
    return np.array(np.load(path / f"{index}.npy", mmap_mode="r")[x, y])


def blosc(name: str, level: int, shuffle: str) -> list[Any]:
    """Give the codecs that compress and check."""
    return [BloscCodec(typesize=4, cname=name, clevel=level, shuffle=shuffle), Crc32cCodec()]  # type: ignore[arg-type]


STORES = [
    Store("npy, memory-mapped", write_npy, read_npy),
    zarr_store("not compressed", 500, [Crc32cCodec()]),
    zarr_store("lz4 of shuffled bytes", 250, blosc("lz4", 1, "shuffle")),
    zarr_store("lz4 of shuffled bytes", 500, blosc("lz4", 1, "shuffle")),
    zarr_store("lz4 of shuffled bytes", 1000, blosc("lz4", 1, "shuffle")),
    zarr_store("lz4 of shuffled bytes", 500, blosc("lz4", 1, "shuffle"), shards=False),
    zarr_store("lz4 of shuffled bits", 500, blosc("lz4", 1, "bitshuffle")),
    zarr_store("zstd 1 of shuffled bytes", 500, blosc("zstd", 1, "shuffle")),
    zarr_store("zstd 3 of shuffled bits", 500, blosc("zstd", 3, "bitshuffle")),
    zarr_store("zstd 1, not shuffled", 500, [ZstdCodec(level=1), Crc32cCodec()]),
]


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """Run and return CPU seconds of all threads, which other work disturbs least, and the result."""
    start = time.process_time()
    result = work()
    return time.process_time() - start, result


def measure(store: Store, days: list[Soil], folder: Path) -> str:
    """Measure a store and give a line of the table."""
    path = folder / "store"
    writes = []
    for _ in range(5):
        shutil.rmtree(path, ignore_errors=True)
        writes.append(timed(lambda: store.write(path, days))[0] / len(days))
    size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file()) / len(days)
    whole, windows = [], []
    rng = np.random.default_rng(1)
    for index, day in enumerate(days):
        everywhere = tuple(slice(0, cells) for cells in day.shape)
        seconds, read = timed(lambda index=index, where=everywhere: store.read(path, index, *where))  # type: ignore[misc]
        np.testing.assert_array_equal(read, day)
        whole.append(seconds)
        for _ in range(20):
            where = tuple(
                slice(corner, corner + WINDOW)
                for corner in (int(rng.integers(0, max(1, cells - WINDOW))) for cells in day.shape)
            )
            seconds, read = timed(lambda index=index, where=where: store.read(path, index, *where))  # type: ignore[misc]
            np.testing.assert_array_equal(read, day[where])
            windows.append(seconds)
    shutil.rmtree(path)
    return (
        f"{store.name:48} {size / 1e6:8.1f} {np.median(writes):8.3f} {np.mean(whole):8.3f} "
        f"{1e3 * np.median(windows):10.2f}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--farm", default="waterberry")
    parser.add_argument("--directory", type=Path, help="where is written (default: a temporary folder)")
    arguments = parser.parse_args()
    shape = get_farm(arguments.farm).grid().shape
    weather = draw_weather(shape, max(DAYS), SoilParameters(), np.random.default_rng(1))
    course = SoilCourse(shape, weather, SoilParameters(), max(DAYS))
    days = [np.empty(shape, np.float32) for _ in DAYS]
    print(
        f"a day of {shape[0]} x {shape[1]} cells; window {WINDOW} x {WINDOW}, opened anew each time; CPU time"
    )
    print(f"{'':48} {'MB':>8} {'write s':>8} {'day s':>8} {'window ms':>10}")
    computed = []
    for day, out in zip(DAYS, days, strict=True):
        computed.append(timed(lambda day=day, out=out: course.compute(day, out))[0])  # type: ignore[misc]
    print(f"{'computed again':48} {0:8.1f} {0:8.3f} {np.mean(computed):8.3f} {'-':>10}")
    with scratch_folder(arguments.directory) as folder:
        for store in STORES:
            print(measure(store, days, folder), flush=True)


if __name__ == "__main__":
    main()
