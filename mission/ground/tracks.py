"""Tracks of a vehicle: reported positions, true positions from its simulator, and time in the air."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from geo.frame import LocalFrame
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a

TrueState: TypeAlias = m.MAVLink_hil_state_quaternion_message | m.MAVLink_sim_state_message


_GROUND_MM = 50
_ON_GROUND = 1  # MAV_LANDED_STATE_ON_GROUND.
_Fix = tuple[float, int, int, int]  # ms, 1e-7 degree, 1e-7 degree, mm above home.


@dataclass(frozen=True, slots=True)
class Track:
    """Track of a vehicle, from its GLOBAL_POSITION_INT or from the simulator's true positions.

    Between two flights, a track has a row of NaN, which interrupts a line drawn along the track.

    Parameters
    ----------
    time_s : float64[n]
        Time since the start of the run (s).
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
        """Length over ground (m)."""
        return float(np.nansum(np.hypot(np.diff(self.x_m), np.diff(self.y_m))))

    def at(self, time_s: NDArray[np.float64]) -> Track:
        """Return the track at other times, linearly interpolated."""
        columns = (self.latitude_deg, self.longitude_deg, self.altitude_m, self.x_m, self.y_m)
        return Track(time_s, *(np.interp(time_s, self.time_s, column) for column in columns))

    def distance_m(self, other: Track) -> NDArray[np.float64]:
        """Return the horizontal distances (m) between this and another track, at the times of this track."""
        there = other.at(self.time_s)
        return np.hypot(self.x_m - there.x_m, self.y_m - there.y_m)

    def least_distance_m(self, other: Track) -> float | None:
        """Return the smallest 3D distance from another track (m), or None if no times overlap.

        The distance is evaluated at the times of this track that lie in the time span of the other track.
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
    """Concatenate tracks, separated by rows of NaN; a single track is returned unchanged."""
    if len(tracks) == 1:
        return tracks[0]
    names = ("time_s", "latitude_deg", "longitude_deg", "altitude_m", "x_m", "y_m")
    gap = np.array([np.nan])
    columns = []
    for name in names:
        parts = [part for track in tracks for part in (getattr(track, name), gap)]
        columns.append(np.concatenate(parts[:-1]) if parts else np.empty(0))
    return Track(*columns)


class TrackRecorder:
    """Recorder of the positions of one flight, from the vehicle's messages."""

    def __init__(self) -> None:
        self.aloft_ms = 0  # time of the last position in the air (ms since boot), 0 before the first
        self._fixes: list[_Fix] = []
        self._true_fixes: list[_Fix] = []
        self._ground_mm: int | None = None
        self._grounded = False

    def on_position(
        self, message: m.MAVLink_global_position_int_message, time_ms: int, *, is_rover: bool
    ) -> None:
        """Record a GLOBAL_POSITION_INT at ``time_ms`` of the vehicle's clock."""
        self._fixes.append((time_ms, message.lat, message.lon, message.relative_alt))
        off_ground = message.relative_alt > _GROUND_MM or is_rover
        # The flight lasts until the vehicle detects the landing, some time after touchdown.
        if (off_ground or self.aloft_ms > 0) and not self._grounded:
            self.aloft_ms = time_ms

    def on_landed_state(self, message: m.MAVLink_extended_sys_state_message) -> None:
        """Record the landed state of an EXTENDED_SYS_STATE."""
        self._grounded = message.landed_state == _ON_GROUND

    def on_truth(self, message: TrueState, now_s: float, *, flying: bool) -> None:
        """Record a HIL_STATE_QUATERNION or SIM_STATE, with the height above the first true position."""
        if is_a(message, m.MAVLink_sim_state_message):
            latitude_e7, longitude_e7 = message.lat_int, message.lon_int
            altitude_mm = round(1000.0 * message.alt)
        else:
            latitude_e7, longitude_e7, altitude_mm = message.lat, message.lon, message.alt
        if self._ground_mm is None:
            self._ground_mm = altitude_mm
        if flying:
            height_mm = altitude_mm - self._ground_mm
            self._true_fixes.append((1000.0 * now_s, latitude_e7, longitude_e7, height_mm))

    def fixes_from(self, number: int) -> Sequence[_Fix]:
        """Return the recorded positions from index ``number`` on."""
        return self._fixes[number:]

    def track(self, frame: LocalFrame) -> Track:
        """Return the reported track, in WGS84 and in ``frame``."""
        return _track(self._fixes, frame)

    def true_track(self, frame: LocalFrame) -> Track | None:
        """Return the true track, or None if no simulator sent true positions."""
        return _track(self._true_fixes, frame) if self._true_fixes else None


class FlownLength:
    """Length over ground of a running flight, updated incrementally."""

    def __init__(self, tracks: TrackRecorder, frame: LocalFrame) -> None:
        self._tracks = tracks
        self._frame = frame
        self._seen = 0
        self._length_m = 0.0

    def measure(self) -> float:
        """Return the length of the track up to the last position (m)."""
        # The last position of the previous call starts the next segment.
        begin = max(self._seen - 1, 0)
        new = self._tracks.fixes_from(begin)
        self._seen = begin + len(new)
        if len(new) > 1:
            self._length_m += _track(new, self._frame).length_m
        return self._length_m


def _track(fixes: Sequence[_Fix], frame: LocalFrame) -> Track:
    rows = np.array(fixes, dtype=np.float64).reshape(-1, 4)
    latitude, longitude = rows[:, 1] / 1e7, rows[:, 2] / 1e7
    x_m, y_m = frame.from_wgs84(latitude, longitude)
    return Track(rows[:, 0] / 1e3, latitude, longitude, rows[:, 3] / 1e3, x_m, y_m)
