"""How a run goes, and where it went."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray


class Phase(Enum):
    """What the ground station is at."""

    CONTACT = "waiting for the vehicle"
    UPLOAD = "uploading"
    WAIT = "waiting for its turn to start"
    MODE = "choosing the mode to arm in"
    READY = "waiting until the vehicle can arm"
    ARM = "arming"
    START = "starting the mission"
    FLIGHT = "flying"
    FETCH = "fetching lost images"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Track:
    """Where a vehicle was, by its own GLOBAL_POSITION_INT or in truth.

    Of several flights in one track, each ends with a row of NaN, so that lines drawn along it break there.

    Parameters
    ----------
    time_s : float64[n]
        Seconds since the run began.
    latitude_deg, longitude_deg, altitude_m : float64[n]
        Position; altitude above home.
    x_m, y_m : float64[n]
        Position in the farm frame.
    """

    time_s: NDArray[np.float64]
    latitude_deg: NDArray[np.float64]
    longitude_deg: NDArray[np.float64]
    altitude_m: NDArray[np.float64]
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]

    @property
    def length_m(self) -> float:
        """Length over ground."""
        return float(np.nansum(np.hypot(np.diff(self.x_m), np.diff(self.y_m))))

    def at(self, time_s: NDArray[np.float64]) -> Track:
        """Return the track at other times, straight between its fixes."""
        columns = (self.latitude_deg, self.longitude_deg, self.altitude_m, self.x_m, self.y_m)
        return Track(time_s, *(np.interp(time_s, self.time_s, column) for column in columns))

    def distance_m(self, other: Track) -> NDArray[np.float64]:
        """Return the horizontal distance from another track at the times of this one."""
        there = other.at(self.time_s)
        return np.hypot(self.x_m - there.x_m, self.y_m - there.y_m)

    def least_distance_m(self, other: Track) -> float | None:
        """Return how near the vehicles of two tracks came to each other, heights counted; None if never seen.

        Their fixes are taken together at the times of this track, while both were told.
        """
        if not len(self.time_s) or not len(other.time_s):
            return None
        both = (self.time_s >= other.time_s[0]) & (self.time_s <= other.time_s[-1])
        if not both.any():
            return None
        there = other.at(self.time_s[both])
        aside_m = np.hypot(self.x_m[both] - there.x_m, self.y_m[both] - there.y_m)
        return float(np.hypot(aside_m, self.altitude_m[both] - there.altitude_m).min())


def joined(tracks: Sequence[Track]) -> Track:
    """Return several tracks as one, with a row of NaN between them; a single one as it is."""
    if len(tracks) == 1:
        return tracks[0]
    names = ("time_s", "latitude_deg", "longitude_deg", "altitude_m", "x_m", "y_m")
    gap = np.array([np.nan])
    columns = []
    for name in names:
        parts = [part for one in tracks for part in (getattr(one, name), gap)]
        columns.append(np.concatenate(parts[:-1]) if parts else np.empty(0))
    return Track(*columns)
