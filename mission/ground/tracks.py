"""Where the vehicle was: its own fixes, its simulator's true positions, and how long it was in the air."""

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

__all__ = ["FlownLength", "Track", "TrackRecorder", "joined"]

_GROUND_MM = 50
_ON_GROUND = 1  # MAV_LANDED_STATE_ON_GROUND
_Fix = tuple[float, int, int, int]  # ms, 1e-7 degree, 1e-7 degree, mm above home


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


class TrackRecorder:
    """Notes positions of one flight; it hears the vehicle's messages only."""

    def __init__(self) -> None:
        # Time of the vehicle's last fix in the air, milliseconds since it started; 0 before the first
        self.aloft_ms = 0
        self._fixes: list[_Fix] = []
        self._true_fixes: list[_Fix] = []
        self._ground_mm: int | None = None
        self._grounded = False

    def on_position(
        self, message: m.MAVLink_global_position_int_message, time_ms: int, *, is_rover: bool
    ) -> None:
        """Note a GLOBAL_POSITION_INT of the flight, at a time of the vehicle's clock."""
        self._fixes.append((time_ms, message.lat, message.lon, message.relative_alt))
        off_ground = message.relative_alt > _GROUND_MM or is_rover
        # From the first fix in the air until the vehicle tells that it has landed: it takes it a while.
        if (off_ground or self.aloft_ms > 0) and not self._grounded:
            self.aloft_ms = time_ms

    def on_landed_state(self, message: m.MAVLink_extended_sys_state_message) -> None:
        """Note an EXTENDED_SYS_STATE."""
        self._grounded = message.landed_state == _ON_GROUND

    def on_truth(self, message: TrueState, now_s: float, *, flying: bool) -> None:
        """Note a HIL_STATE_QUATERNION or SIM_STATE; its height counts from where the vehicle stood first."""
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
        """Return the fixes of the flight from a number on."""
        return self._fixes[number:]

    def track(self, frame: LocalFrame) -> Track:
        """What was flown, in WGS84 and in `frame`."""
        return _track(self._fixes, frame)

    def true_track(self, frame: LocalFrame) -> Track | None:
        """Where the vehicle truly was; None if its simulator did not tell."""
        return _track(self._true_fixes, frame) if self._true_fixes else None


class FlownLength:
    """The length over ground of a flight that goes on; each fix is looked at once."""

    def __init__(self, tracks: TrackRecorder, frame: LocalFrame) -> None:
        self._tracks = tracks
        self._frame = frame
        self._seen = 0
        self._length_m = 0.0

    def measure(self) -> float:
        """Return how many metres there are from the first fix to the last one."""
        # The last fix that was looked at is the beginning of the next step.
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
