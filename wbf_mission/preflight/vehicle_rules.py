"""What is set on the vehicle against what the plan assumes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

from geo.frame import LocalFrame
from mission.autopilots.profile import Meaning, Question, answer_to
from mission.autopilots.registry import profile_for
from mission.ground.arming_gate import FARTHEST_M
from mission.link.codec.dialect import mavlink as m
from mission.model import Command, Frame
from sim_vehicle.airframe.parameters import parameter_value
from sim_vehicle.autopilot import firmware_of
from wbf_mission.preflight.finding import Concern, Finding, Measure, Severity
from wbf_mission.preflight.plan_rules import PLACED, legs_of
from wbf_mission.preflight.snapshot import VehicleSnapshot
from wbf_mission.preflight.subject import LANDINGS, TAKEOFFS, Subject

__all__ = [
    "check_battery_now",
    "check_calibration",
    "check_estimator",
    "check_failsafes",
    "check_fence_settings",
    "check_firmware",
    "check_gps",
    "check_landing_rules",
    "check_motion_settings",
    "check_place",
    "check_readiness",
    "check_unread",
]

_NOTICEABLE = 0.05
_NOTICEABLE_RADIUS_M = 0.5
_NOTICEABLE_HEIGHT_M = 1.0
_HIGHEST_M = 120.0
_CEILING_BIT, _RADIUS_BIT = 1, 2  # FENCE_TYPE of ArduPilot
_CONTINUES_BIT = 2  # FS_OPTIONS of ArduCopter: a mission goes on without a ground station


def _value(subject: Subject, meaning: Meaning) -> tuple[str, float] | None:
    snapshot = subject.snapshot
    return None if snapshot is None else answer_to(meaning, _questions(subject), snapshot.parameters)


def _questions(subject: Subject) -> tuple[Question, ...]:
    snapshot = subject.snapshot
    return (
        () if snapshot is None else profile_for(snapshot.autopilot).settings.asked_of(snapshot.vehicle_type)
    )


def _finding(
    severity: Severity,
    code: str,
    text: str,
    fix: str = "",
    measure: Measure | None = None,
    *,
    concern: Concern = Concern.PARAMETERS,
) -> Finding:
    return Finding(severity, code, text, fix, measure=measure, concern=concern)


_standing = partial(_finding, concern=Concern.STATE)
"""What is found in how the vehicle stands there."""


def check_unread(subject: Subject) -> Iterator[Finding]:
    """Parameters that the vehicle does not have, or did not tell."""
    snapshot = subject.snapshot
    if snapshot is None:
        return
    missing = [
        " or ".join(name for name, _ in one.names)
        for one in _questions(subject)
        if not any(name in snapshot.parameters for name, _ in one.names)
    ]
    if missing:
        text = f"could not be read: {', '.join(missing)}"
        yield _finding(Severity.NOTE, "parameter-unread", text)


def _assumed(subject: Subject, name: str, otherwise: float) -> float:
    """Return what the prediction flies with: the parameter of that name, else what it decides."""
    firmware = firmware_of(subject.vehicle)
    if firmware is None or name not in firmware.procedures.parameters:
        return otherwise
    unit = next(
        (unit for question in _questions(subject) for one, unit in question.names if one == name), 1.0
    )
    return unit * parameter_value(subject.vehicle, name, firmware.procedures.parameters)


def check_motion_settings(subject: Subject) -> Iterator[Finding]:
    """Speeds, acceptance radius and return height other than those that the prediction flies with."""
    vehicle, legs = subject.vehicle, legs_of(subject)
    cruise = _value(subject, Meaning.CRUISE_SPEED)
    first_order = next(
        (k for k, one in enumerate(subject.items) if one.command == Command.DO_CHANGE_SPEED), math.inf
    )
    uses_cruise = any(leg.item < first_order and leg.length_m > 1.0 for leg in legs)
    if cruise is not None and uses_cruise:
        name, value = cruise
        assumed = _assumed(subject, name, vehicle.cruise_speed_m_s)
        if abs(value - assumed) > _NOTICEABLE * assumed:
            yield _finding(
                Severity.WARNING,
                "other-speed",
                f"{name}: the plan is predicted with another speed",
                f"set {name}, order the speed in the mission, or predict with --param",
                Measure.planned(name, value, assumed, "m/s"),
            )
    fastest = _value(subject, Meaning.FASTEST)
    wanted = max((leg.speed_m_s for leg in legs), default=0.0)
    if fastest is not None and wanted > fastest[1] * (1.0 + _NOTICEABLE):
        yield _finding(
            Severity.WARNING,
            "speed-limit",
            f"{fastest[0]} is lower than the speed of the plan: the flight takes longer than predicted",
            f"fly slower, or raise {fastest[0]}",
            Measure.at_most("speed of the plan", wanted, fastest[1], "m/s"),
        )
    radius = _value(subject, Meaning.ACCEPTANCE_RADIUS)
    lossy = "param2" in subject.profile.lossy.get(int(Command.NAV_WAYPOINT), frozenset())
    own = any(item.command == Command.NAV_WAYPOINT and (lossy or not item.param2) for item in subject.items)
    if radius is not None and own:
        name, value = radius
        assumed = _assumed(subject, name, vehicle.acceptance_radius_m)
        if abs(value - assumed) > _NOTICEABLE_RADIUS_M:
            yield _finding(
                Severity.WARNING,
                "other-radius",
                f"{name}: the plan is predicted with another acceptance radius",
                f"set {name}, or predict with --param",
                Measure.planned(name, value, assumed, "m"),
            )
    yield from _return_height(subject)


def _return_height(subject: Subject) -> Iterator[Finding]:
    found = _value(subject, Meaning.RETURN_HEIGHT)
    if found is None or subject.vehicle.kind == "rover":
        return
    name, value = found
    if value > _HIGHEST_M:
        yield _finding(
            Severity.WARNING,
            "high-return",
            f"{name}: the return climbs higher than most rules allow",
            f"lower {name}",
            Measure.at_most("height above home", value, _HIGHEST_M, "m"),
        )
        return
    assumed = _assumed(subject, name, subject.vehicle.return_altitude_m)
    if abs(value - assumed) > _NOTICEABLE_HEIGHT_M:
        yield _finding(
            Severity.NOTE,
            "other-return",
            f"{name}: the plan is predicted with another height of the return",
            measure=Measure.planned(name, value, assumed, "m"),
        )


def check_failsafes(subject: Subject) -> Iterator[Finding]:
    """What a low battery and a lost link do to the mission."""
    battery = _value(subject, Meaning.LOW_BATTERY)
    if battery is not None and battery[1] == 0.0:
        yield _finding(
            Severity.WARNING,
            "no-battery-failsafe",
            f"{battery[0]} is 0: a low battery is only told",
            f"set {battery[0]} to return or land",
        )
    link = _value(subject, Meaning.LINK_LOST)
    if link is None:
        return
    name, value = link
    options = _value(subject, Meaning.LINK_LOST_OPTIONS)
    goes_on = options is not None and bool(int(options[1]) & _CONTINUES_BIT)
    if goes_on or value in subject.profile.settings.link_goes_on:
        yield _finding(
            Severity.NOTE,
            "link-lost-flies-on",
            f"{name} is {value:g}: without a link the mission is flown on",
        )
    else:
        yield _finding(
            Severity.NOTE, "link-lost-ends", f"{name} is {value:g}: a link lost for long ends the mission"
        )


def check_landing_rules(subject: Subject) -> Iterator[Finding]:
    """Missions that the autopilot would not arm with: without the landing that it wants, or with one."""
    commands = {item.command for item in subject.items}
    takes_off, lands = bool(commands & TAKEOFFS), bool(commands & LANDINGS)
    rule = _value(subject, Meaning.TAKEOFF_AND_LANDING)
    if rule is not None and not _told_by_dialect(subject, *rule):
        name, value = rule
        missing = _missing(value, takes_off=takes_off, lands=lands)
        if missing:
            yield _finding(
                Severity.ERROR,
                "landing-rule",
                f"{name} is {value:g}: the vehicle refuses a mission without {' and '.join(missing)}"
                " (a return is no landing)",
                f"end with NAV_LAND, or set {name} to 0" if "a landing" in missing else "add NAV_TAKEOFF",
            )
    autoland = _value(subject, Meaning.LANDS_AS_MISSION)
    if autoland is not None and autoland[1] == 0.0 and Command.NAV_RETURN_TO_LAUNCH in commands:
        yield _finding(
            Severity.WARNING,
            "circles-at-home",
            f"{autoland[0]} is 0: the return circles over home and does not land",
            "end with a landing, or land by hand",
        )


def _told_by_dialect(subject: Subject, name: str, value: float) -> bool:
    """Return whether the remarks on the autopilot's dialect tell what such a parameter asks for."""
    return any(
        one.parameter == name and subject.vehicle_type in one.vehicle_types and value in one.refusing
        for one in subject.profile.dialect.conditions
    )


def _missing(rule: float, *, takes_off: bool, lands: bool) -> list[str]:
    """Return what MIS_TKO_LAND_REQ misses: 1 take-off, 2 landing, 3 both, 4 and 5 both or neither."""
    wants_takeoff = rule in (1.0, 3.0) or (rule in (4.0, 5.0) and lands)
    wants_landing = rule in (2.0, 3.0) or (rule in (4.0, 5.0) and takes_off)
    missing = ["a take-off"] if wants_takeoff and not takes_off else []
    return [*missing, "a landing"] if wants_landing and not lands else missing


def check_fence_settings(subject: Subject) -> Iterator[Finding]:
    """A fence that does nothing, and a ceiling or a radius that the plan breaks."""
    on, action = _value(subject, Meaning.FENCE_ON), _value(subject, Meaning.FENCE_ACTION)
    off = next((one for one in (on,) if one is not None and one[1] == 0.0), None)
    settings = subject.profile.settings
    if off is None and action is not None and action[1] in settings.fence_off:
        off = action
    weak = action is not None and action[1] in settings.fence_tells
    if subject.mission.fence:
        if off is not None:
            yield _finding(
                Severity.WARNING,
                "fence-off",
                f"{off[0]} is 0: the fence of the plan does nothing",
                f"set {off[0]}",
            )
        elif weak and action is not None:
            yield _finding(
                Severity.WARNING,
                "fence-tells-only",
                f"{action[0]} is {action[1]:g}: a broken fence is only told",
                f"set {action[0]} to return or land",
            )
    if off is not None:
        return
    types = _value(subject, Meaning.FENCE_TYPES)
    bits = _CEILING_BIT | _RADIUS_BIT if types is None else int(types[1])
    for meaning, bit, what, reached, code in (
        (Meaning.FENCE_CEILING, _CEILING_BIT, "height above home", _highest_m(subject), "above-ceiling"),
        (
            Meaning.FENCE_RADIUS,
            _RADIUS_BIT,
            "distance from home",
            _farthest_m(subject),
            "beyond-fence-radius",
        ),
    ):
        bound = _value(subject, meaning)
        if bound is not None and bits & bit and 0.0 < bound[1] < reached:
            yield _finding(
                Severity.ERROR,
                code,
                f"{bound[0]}: the plan leaves the fence of the vehicle",
                f"change the plan, or raise {bound[0]}",
                Measure.at_most(what, reached, bound[1], "m"),
            )


def _highest_m(subject: Subject) -> float:
    """Return the height above home of the highest item or of the predicted return."""
    planned = [leg.end_m[2] for leg in legs_of(subject)]
    # The controllers overshoot by centimetres.
    flown = [float(track.points_m[:, 2].max()) - 0.5 for track in subject.tracks]
    return max((*planned, *flown), default=0.0)


def _farthest_m(subject: Subject) -> float:
    planned = [math.hypot(*leg.end_m[:2]) for leg in legs_of(subject)]
    return max(planned, default=0.0)


def check_calibration(subject: Subject) -> Iterator[Finding]:
    """Sensors that were never calibrated."""
    for meaning in (Meaning.ACCELEROMETER, Meaning.GYROSCOPE, Meaning.COMPASS):
        found = _value(subject, meaning)
        if found is not None and found[1] == 0.0:
            what = meaning.value.removeprefix("the ").removesuffix("'s calibration")
            yield _finding(
                Severity.WARNING if meaning is Meaning.COMPASS else Severity.ERROR,
                "not-calibrated",
                f"{found[0]} is 0: there is no calibrated {what}",
                "calibrate it" if meaning is not Meaning.COMPASS else "calibrate it, if the vehicle has one",
            )


_FAR_M = 30.0
_HEIGHT_M = 10.0
_FIX_3D = 3
_FEW_SATELLITES = 8
_POOR_HDOP = 2.0
_PREARM = int(m.MAV_SYS_STATUS_PREARM_CHECK)
_SENSORS = {
    int(m.MAV_SYS_STATUS_SENSOR_3D_GYRO): "gyroscope",
    int(m.MAV_SYS_STATUS_SENSOR_3D_ACCEL): "accelerometer",
    int(m.MAV_SYS_STATUS_SENSOR_3D_MAG): "compass",
    int(m.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE): "barometer",
    int(m.MAV_SYS_STATUS_SENSOR_GPS): "GPS",
    int(m.MAV_SYS_STATUS_AHRS): "attitude estimate",
    int(m.MAV_SYS_STATUS_SENSOR_BATTERY): "battery",
}
_PARTS = {
    int(m.ESTIMATOR_ATTITUDE): "attitude",
    int(m.ESTIMATOR_VELOCITY_HORIZ): "velocity",
    int(m.ESTIMATOR_POS_HORIZ_ABS): "position",
}


def check_firmware(subject: Subject) -> Iterator[Finding]:
    """Which firmware it is, and whether it is a release."""
    snapshot = subject.snapshot
    if snapshot is None:
        return
    if snapshot.version is None:
        yield _standing(Severity.NOTE, "firmware-unknown", "the vehicle does not tell its firmware's version")
        return
    text = f"{subject.profile.name} {snapshot.version}"
    if snapshot.version.is_official or not any((snapshot.version.major, snapshot.version.minor)):
        yield _standing(Severity.NOTE, "firmware", text)
    else:
        fix = "fly a release where it matters"
        yield _standing(Severity.WARNING, "no-release", f"{text} is no release", fix)


def check_readiness(subject: Subject) -> Iterator[Finding]:
    """Whether its own checks pass, and sensors that are not healthy."""
    snapshot = subject.snapshot
    if snapshot is None or snapshot.sensors_health is None:
        return
    present, enabled = snapshot.sensors_present or 0, snapshot.sensors_enabled or 0
    health = snapshot.sensors_health
    if present & _PREARM and not health & _PREARM and not snapshot.armed:
        reasons = ", ".join(snapshot.reasons) or "it does not tell why"
        yield _standing(
            Severity.ERROR,
            "not-ready",
            f"the vehicle says that it cannot arm: {reasons}",
            "wait, or do what it says",
            concern=Concern.READINESS,
        )
    ill = [name for bit, name in _SENSORS.items() if present & enabled & bit and not health & bit]
    if ill:
        yield _standing(
            Severity.ERROR,
            "unhealthy",
            f"not healthy: {', '.join(ill)}",
            "wait until it is, calibrate or repair it",
            concern=Concern.READINESS,
        )
    if snapshot.armed:
        yield _standing(Severity.WARNING, "armed", "the motors are running", "is it flying?")


def check_gps(subject: Subject) -> Iterator[Finding]:
    """No fix, or a poor one."""
    gps = None if subject.snapshot is None else subject.snapshot.gps
    if gps is None or subject.vehicle.is_ideal:
        return
    if gps.fix < _FIX_3D:
        yield _standing(
            Severity.ERROR,
            "no-fix",
            "no position from satellites",
            "wait under the open sky",
            Measure.at_least("fix type", gps.fix, _FIX_3D),
            concern=Concern.READINESS,
        )
    elif gps.satellites is not None and gps.satellites < _FEW_SATELLITES:
        yield _standing(
            Severity.WARNING,
            "few-satellites",
            "few satellites",
            "wait for more",
            Measure.at_least("satellites", gps.satellites, _FEW_SATELLITES),
            concern=Concern.READINESS,
        )
    elif gps.hdop is not None and gps.hdop > _POOR_HDOP:
        yield _standing(
            Severity.WARNING,
            "poor-fix",
            "a poor dilution of precision",
            "wait for more satellites",
            Measure.at_most("HDOP", gps.hdop, _POOR_HDOP),
            concern=Concern.READINESS,
        )


def check_estimator(subject: Subject) -> Iterator[Finding]:
    """Parts of the state that the estimator does not know."""
    flags = None if subject.snapshot is None else subject.snapshot.estimator_flags
    if flags is None:
        return
    unknown = [name for bit, name in _PARTS.items() if not flags & bit]
    if unknown:
        yield _standing(
            Severity.ERROR,
            "estimator",
            f"the estimator does not know: {', '.join(unknown)}",
            "wait until it has settled",
            concern=Concern.READINESS,
        )


def check_battery_now(subject: Subject) -> Iterator[Finding]:
    """The battery now against what the plan needs and the reserve."""
    snapshot, battery = subject.snapshot, subject.vehicle.battery
    if snapshot is None or battery is None or subject.prediction is None:
        return
    if snapshot.battery is None:
        yield _standing(Severity.NOTE, "battery-unknown", "the vehicle does not tell what its battery holds")
        return
    left = snapshot.battery - subject.needed_wh / battery.capacity_wh
    if left < battery.reserve_fraction:
        yield _standing(
            Severity.WARNING if subject.assumed else Severity.ERROR,
            "battery-now",
            f"the battery holds {snapshot.battery:.0%} now: less is left at the end than the reserve",
            "charge or change it",
            Measure.at_least(
                "left in the battery at the end", 100.0 * left, 100.0 * battery.reserve_fraction, "%"
            ),
        )


def check_place(subject: Subject) -> Iterator[Finding]:
    """How far the vehicle stands from home of the plan, and how much higher or lower."""
    snapshot, home = subject.snapshot, subject.mission.home
    position = None if snapshot is None or snapshot.armed or _is_unsettled(snapshot) else snapshot.position
    if position is None or home is None:
        return
    frame = LocalFrame(home.latitude_deg, home.longitude_deg)
    x, y = frame.from_wgs84(position.latitude_deg, position.longitude_deg)
    away_m = float((x * x + y * y) ** 0.5)
    if away_m > _FAR_M:
        far = away_m > FARTHEST_M
        yield _standing(
            Severity.ERROR if far else Severity.WARNING,
            "away-from-home",
            "the vehicle stands far from the home of the plan, and returns to where it starts",
            "carry it there, or plan from where it stands",
            Measure.at_most("distance from home", away_m, FARTHEST_M if far else _FAR_M, "m"),
        )
    above_sea = any(
        item.command in PLACED and item.has_position and item.frame == Frame.GLOBAL for item in subject.items
    )
    higher_m = position.altitude_m - home.altitude_m
    if above_sea and abs(higher_m) > _HEIGHT_M:
        yield _standing(
            Severity.WARNING,
            "other-ground-height",
            "the ground here is at another height than the plan's, and heights count above the sea",
            "give heights above home, or correct the home of the plan",
            Measure.at_most("difference in height", abs(higher_m), _HEIGHT_M, "m"),
        )


def _is_unsettled(snapshot: VehicleSnapshot) -> bool:
    """Return whether the vehicle itself says that it does not know yet where it is."""
    if snapshot.estimator_flags is None:
        return snapshot.gps is not None and snapshot.gps.fix < _FIX_3D
    return not snapshot.estimator_flags & m.ESTIMATOR_POS_HORIZ_ABS
