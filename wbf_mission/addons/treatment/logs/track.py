"""Track of a log: vehicle positions over time, and camera images."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from geo.errors import WbfMissionError
from geo.texts import one_line

Floats: TypeAlias = NDArray[np.float64]

MAX_LOG_BYTES = 2**30
_STDERR = 2
LONGEST_GAP_S = 5.0
"""Longest gap between two fixes across which positions are interpolated (s)."""
LEAST_UTC_S = 1e9
"""Times from this (s since 1970, in the year 2001) are UTC; smaller times are seconds since boot."""


class LogError(WbfMissionError, ValueError):
    """A log or a folder of pictures cannot be read, or lacks the requested data."""


@dataclass(frozen=True, slots=True, eq=False)
class LogImages:
    """Images of a camera, in the order of the log: arrays of n entries."""

    index: NDArray[np.int64]  # Image numbers of the camera
    boot_s: Floats  # Times, see `LogTrack`
    utc_s: Floats
    latitude_deg: Floats  # NaN if only the time is known
    longitude_deg: Floats
    names: tuple[str, ...] = ()  # File names; empty if the images are not files

    @classmethod
    def of(cls, rows: ArrayLike, names: tuple[str, ...] = ()) -> LogImages:
        """Return images from rows of index, boot_s, utc_s, latitude_deg, longitude_deg."""
        index, boot_s, utc_s, latitude, longitude = np.asarray(rows, np.float64).reshape(-1, 5).T
        return cls(index.astype(np.int64), boot_s, utc_s, latitude, longitude, names)


@dataclass(frozen=True, slots=True, eq=False)
class LogTrack:
    """Positions of a vehicle over time (WGS84): arrays of n entries."""

    kind: str  # Kind of the log, for messages
    boot_s: Floats  # Seconds since the vehicle booted; NaN if unknown
    utc_s: Floats  # Seconds since 1970; NaN if unknown
    latitude_deg: Floats
    longitude_deg: Floats
    images: LogImages
    notes: tuple[str, ...] = ()  # Notes on the log for the user, one line each

    @classmethod
    def of(cls, kind: str, rows: ArrayLike, images: LogImages, notes: tuple[str, ...] = ()) -> LogTrack:
        """Return a track from rows of boot_s, utc_s, latitude_deg, longitude_deg; drop rows without a fix."""
        table = np.asarray(rows, np.float64).reshape(-1, 4)
        fixed = is_position(table[:, 2], table[:, 3])
        boot_s, utc_s, latitude, longitude = table[fixed].T
        return cls(kind, boot_s, utc_s, latitude, longitude, images, notes)

    def at(self, time_s: Floats) -> tuple[Floats, Floats]:
        """Return latitude and longitude at each time, interpolated linearly between fixes.

        Times of at least `LEAST_UTC_S` are UTC; smaller times count from the boot. Positions are NaN before
        the first fix, after the last fix, and in gaps of more than `LONGEST_GAP_S`. Raises LogError if the
        log has no times by the clock of `time_s`, or the vehicle was rebooted within the log.
        """
        found = np.full((2, len(time_s)), np.nan)
        is_utc = time_s >= LEAST_UTC_S
        for wanted, clock_s, clock in ((is_utc, self.utc_s, "UTC"), (~is_utc, self.boot_s, "since boot")):
            if not wanted.any():
                continue
            known = np.flatnonzero(np.isfinite(clock_s))
            if not len(known):
                other = "since the vehicle's start" if clock == "UTC" else "in UTC"
                raise LogError(f"the {self.kind} has no positions with a time {clock}; give times {other}")
            fix_s = clock_s[known]
            if (np.diff(fix_s) < 0.0).any():
                raise LogError(f"the time {clock} goes back in the {self.kind}; give times on another clock")
            asked = time_s[wanted]
            after = np.searchsorted(fix_s, asked, side="left").clip(1, max(len(fix_s) - 1, 1))
            before = after - 1
            after = np.minimum(after, len(fix_s) - 1)
            inside = (asked >= fix_s[0]) & (asked <= fix_s[-1])
            inside &= (fix_s[after] - fix_s[before] <= LONGEST_GAP_S) | (fix_s[after] == asked)
            longitude_deg = np.unwrap(self.longitude_deg[known], period=360.0)  # across the date line
            for row, positions in zip(found, (self.latitude_deg[known], longitude_deg), strict=True):
                row[wanted] = np.where(inside, np.interp(asked, fix_s, positions), np.nan)
        found[1] -= 360.0 * np.round(found[1] / 360.0)
        return found[0], found[1]

    def of_images(self) -> tuple[Floats, Floats]:
        """Return latitude and longitude of the images; positions that images lack come from the track."""
        images = self.images
        latitude, longitude = images.latitude_deg.copy(), images.longitude_deg.copy()
        lacks = ~is_position(latitude, longitude)
        for times in (images.boot_s, images.utc_s):
            wanted = lacks & np.isfinite(times)
            if wanted.any() and len(self.latitude_deg):
                with contextlib.suppress(LogError):
                    latitude[wanted], longitude[wanted] = self.at(times[wanted])
                    lacks &= ~np.isfinite(latitude)
        latitude[lacks] = longitude[lacks] = np.nan
        return latitude, longitude


def is_position(latitude_deg: Floats, longitude_deg: Floats) -> NDArray[np.bool_]:
    """Return a mask of valid positions; (0, 0) is invalid, because receivers report it without a fix."""
    inside = (np.abs(latitude_deg) <= 90.0) & (np.abs(longitude_deg) <= 180.0)
    return inside & ~((latitude_deg == 0.0) & (longitude_deg == 0.0))


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """Discard a library's output, including output of its compiled code on stderr."""
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere, contextlib.ExitStack() as stack:
        stack.enter_context(contextlib.redirect_stdout(nowhere))
        stack.enter_context(contextlib.redirect_stderr(nowhere))
        with contextlib.suppress(OSError):  # a process without a stderr
            kept = os.dup(_STDERR)
            stack.callback(os.close, kept)
            stack.callback(os.dup2, kept, _STDERR)
            os.dup2(nowhere.fileno(), _STDERR)
        yield


@contextlib.contextmanager
def parsing(path: Path, kind: str) -> Iterator[None]:
    """Silence a library that reads a log, and raise its errors as a LogError of one line."""
    try:
        with _silence():
            yield
    except MemoryError:
        raise
    except LogError as error:
        raise LogError(f"{path}: {error}") from None
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {(error.strerror or str(error)).lower()}") from None
    except Exception as error:
        what = one_line(f"{type(error).__name__}: {error}", 200)
        raise LogError(f"{path}: is no {kind} that can be read ({what})") from error
