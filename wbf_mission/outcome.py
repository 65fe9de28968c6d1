"""How a run goes and ends, and where it went."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from wbf_mission.exit_codes import ExitCode


class Phase(Enum):
    """What the ground station is at."""

    CONTACT = "waiting for the vehicle"
    UPLOAD = "uploading"
    ARM = "arming"
    START = "starting the mission"
    FLIGHT = "flying"
    FETCH = "fetching lost pictures"
    DONE = "done"


class Outcome(Enum):
    """How a run ended."""

    RUNNING = "running"
    COMPLETED = "completed"
    NO_CONTACT = "no_contact"
    UPLOAD_FAILED = "upload_failed"
    ARMING_REFUSED = "arming_refused"
    MISSION_REJECTED = "mission_rejected"
    CANNOT_FLY_ITEM = "cannot_fly_item"
    BATTERY_LOW = "battery_low"
    BATTERY_DEPLETED = "battery_depleted"
    FENCE_BREACHED = "fence_breached"
    LINK_LOST = "link_lost"
    POSITION_LOST = "position_lost"
    CRASHED = "crashed"
    FLIGHT_ABORTED = "flight_aborted"
    TIME_LIMIT = "time_limit"
    INTERRUPTED = "interrupted"

    @property
    def is_good(self) -> bool:
        """Whether the whole mission was flown."""
        return self is Outcome.COMPLETED

    @property
    def exit_code(self) -> int:
        """Exit code of a command whose run ended so."""
        return {
            Outcome.COMPLETED: ExitCode.GOOD,
            Outcome.INTERRUPTED: ExitCode.INTERRUPTED,
            Outcome.NO_CONTACT: ExitCode.NO_VEHICLE,
            Outcome.UPLOAD_FAILED: ExitCode.REFUSED,
            Outcome.ARMING_REFUSED: ExitCode.REFUSED,
            Outcome.MISSION_REJECTED: ExitCode.REFUSED,
        }.get(self, ExitCode.NOT_GOOD)


@dataclass(frozen=True, slots=True)
class Track:
    """Where the vehicle was, by its own GLOBAL_POSITION_INT or in truth.

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
        return float(np.hypot(np.diff(self.x_m), np.diff(self.y_m)).sum())

    def at(self, time_s: NDArray[np.float64]) -> Track:
        """Return the track at other times, straight between its fixes."""
        columns = (self.latitude_deg, self.longitude_deg, self.altitude_m, self.x_m, self.y_m)
        return Track(time_s, *(np.interp(time_s, self.time_s, column) for column in columns))

    def distance_m(self, other: Track) -> NDArray[np.float64]:
        """Return the horizontal distance from another track at the times of this one."""
        there = other.at(self.time_s)
        return np.hypot(self.x_m - there.x_m, self.y_m - there.y_m)
