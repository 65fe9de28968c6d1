"""Which parameters of which autopilot change what a plan assumes, under their names of several versions.

Sources: PX4 parameter reference 1.14 to 1.17; ArduPilot parameter references 4.3 to 4.7, where centimetres
became metres (``WPNAV_SPEED`` is ``WP_SPD`` since 4.7, ``RTL_ALT`` ``RTL_ALT_M``, ...).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

from mission.link.codec.dialect import mavlink as m
from mission.transfer import ARDUPILOT, PX4

__all__ = ["Meaning", "Question", "answer_to", "questions_for"]


class Meaning(Enum):
    """What a parameter decides."""

    CRUISE_SPEED = "the speed of a mission that sets none"
    FASTEST = "the greatest speed"
    ACCEPTANCE_RADIUS = "the acceptance radius of waypoints"
    RETURN_HEIGHT = "the height of the return"
    LOW_BATTERY = "what a low battery does"
    LINK_LOST = "what a lost link does"
    LINK_LOST_OPTIONS = "whether a mission goes on without a link"
    TAKEOFF_AND_LANDING = "whether a mission needs a take-off and a landing"
    FENCE_ON = "whether the fence counts"
    FENCE_ACTION = "what a broken fence does"
    FENCE_TYPES = "what belongs to the fence"
    FENCE_CEILING = "the ceiling"
    FENCE_RADIUS = "how far from home"
    LANDS_AS_MISSION = "whether a return flies the landing of the mission"
    MISSION_CARD = "the room for a mission on an SD card"
    ACCELEROMETER = "the accelerometer's calibration"
    GYROSCOPE = "the gyroscope's calibration"
    COMPASS = "the compass's calibration"


@dataclass(frozen=True, slots=True)
class Question:
    """A parameter that is asked for.

    Parameters
    ----------
    meaning : Meaning
    names : tuple of (str, float)
        Its names, that of the newest version first, and SI units in a unit of each.
    """

    meaning: Meaning
    names: tuple[tuple[str, float], ...]


def _question(meaning: Meaning, *names: str | tuple[str, float]) -> Question:
    return Question(meaning, tuple((one, 1.0) if isinstance(one, str) else one for one in names))


_PX4 = (
    _question(Meaning.ACCEPTANCE_RADIUS, "NAV_ACC_RAD"),
    _question(Meaning.RETURN_HEIGHT, "RTL_RETURN_ALT"),
    _question(Meaning.LOW_BATTERY, "COM_LOW_BAT_ACT"),
    _question(Meaning.LINK_LOST, "NAV_DLL_ACT"),
    _question(Meaning.TAKEOFF_AND_LANDING, "MIS_TKO_LAND_REQ"),
    _question(Meaning.FENCE_ACTION, "GF_ACTION"),
    _question(Meaning.FENCE_CEILING, "GF_MAX_VER_DIST"),
    _question(Meaning.FENCE_RADIUS, "GF_MAX_HOR_DIST"),
    _question(Meaning.ACCELEROMETER, "CAL_ACC0_ID"),
    _question(Meaning.GYROSCOPE, "CAL_GYRO0_ID"),
    _question(Meaning.COMPASS, "CAL_MAG0_ID"),
)
_PX4_COPTER = (
    _question(Meaning.CRUISE_SPEED, "MPC_XY_CRUISE"),
    _question(Meaning.FASTEST, "MPC_XY_VEL_MAX"),
    *_PX4,
)
_PX4_WING = (
    _question(Meaning.CRUISE_SPEED, "FW_AIRSPD_TRIM"),
    _question(Meaning.FASTEST, "FW_AIRSPD_MAX"),
    *_PX4,
)
_ARDUPILOT = (
    _question(Meaning.LOW_BATTERY, "BATT_FS_LOW_ACT"),
    _question(Meaning.FENCE_ON, "FENCE_ENABLE"),
    _question(Meaning.FENCE_ACTION, "FENCE_ACTION"),
    _question(Meaning.FENCE_TYPES, "FENCE_TYPE"),
    _question(Meaning.FENCE_CEILING, "FENCE_ALT_MAX"),
    _question(Meaning.FENCE_RADIUS, "FENCE_RADIUS"),
    _question(Meaning.MISSION_CARD, "BRD_SD_MISSION"),
)
_ARDUCOPTER = (
    _question(Meaning.CRUISE_SPEED, "WP_SPD", ("WPNAV_SPEED", 0.01)),
    _question(Meaning.ACCEPTANCE_RADIUS, "WP_RADIUS_M", ("WPNAV_RADIUS", 0.01)),
    _question(Meaning.RETURN_HEIGHT, "RTL_ALT_M", ("RTL_ALT", 0.01)),
    _question(Meaning.LINK_LOST, "FS_GCS_ENABLE"),
    _question(Meaning.LINK_LOST_OPTIONS, "FS_OPTIONS"),
    *_ARDUPILOT,
)
_ARDUPLANE = (
    _question(Meaning.CRUISE_SPEED, "AIRSPEED_CRUISE", ("TRIM_ARSPD_CM", 0.01)),
    _question(Meaning.FASTEST, "AIRSPEED_MAX", "ARSPD_FBW_MAX"),
    _question(Meaning.ACCEPTANCE_RADIUS, "WP_RADIUS"),
    _question(Meaning.RETURN_HEIGHT, "RTL_ALTITUDE", ("ALT_HOLD_RTL", 0.01)),
    _question(Meaning.LANDS_AS_MISSION, "RTL_AUTOLAND"),
    _question(Meaning.LINK_LOST, "FS_GCS_ENABL", "FS_GCS_ENABLE"),
    *_ARDUPILOT,
)
_ROVER = (
    _question(Meaning.CRUISE_SPEED, "WP_SPEED"),
    _question(Meaning.ACCEPTANCE_RADIUS, "WP_RADIUS"),
    _question(Meaning.LINK_LOST, "FS_GCS_ENABLE"),
    *_ARDUPILOT,
)
_WING, _GROUND = int(m.MAV_TYPE_FIXED_WING), int(m.MAV_TYPE_GROUND_ROVER)
_OF: Mapping[int, Mapping[int | None, tuple[Question, ...]]] = {
    PX4.autopilot: {_WING: _PX4_WING, _GROUND: _PX4, None: _PX4_COPTER},
    ARDUPILOT.autopilot: {_WING: _ARDUPLANE, _GROUND: _ROVER, None: _ARDUCOPTER},
}


def questions_for(autopilot: int, vehicle_type: int) -> tuple[Question, ...]:
    """Return what is asked of an autopilot (MAV_AUTOPILOT) on a vehicle (MAV_TYPE); nothing of others.

    Examples
    --------
    >>> [name for name, _ in questions_for(3, 2)[0].names]
    ['WP_SPD', 'WPNAV_SPEED']
    """
    of = _OF.get(autopilot, {})
    return of.get(vehicle_type, of.get(None, ()))


def answer_to(
    meaning: Meaning, questions: Sequence[Question], parameters: Mapping[str, float]
) -> tuple[str, float] | None:
    """Return the name of a parameter and its value in SI units; None if it was not read.

    Examples
    --------
    >>> answer_to(Meaning.RETURN_HEIGHT, questions_for(3, 2), {"RTL_ALT": 1500.0})
    ('RTL_ALT', 15.0)
    """
    for question in questions:
        if question.meaning is meaning:
            for name, unit in question.names:
                if name in parameters:
                    return name, parameters[name] * unit
    return None
