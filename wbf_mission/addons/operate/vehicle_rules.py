"""Checks of a vehicle on a link: its state, and whether its settings are those that the plan assumes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import Any

from geo.frame import LocalFrame
from mission.autopilots.profile import Meaning
from mission.ground.arming_gate import FARTHEST_M
from mission.link.codec.dialect import mavlink as m
from mission.model import Command, Frame
from sim_vehicle.autopilot import firmware_of
from sim_vehicle.autopilot.parameters import parameter_value
from wbf_mission.addons.base.inquiry import VehicleSnapshot
from wbf_mission.preflight import rules
from wbf_mission.preflight.finding import Concern, Finding, Severity
from wbf_mission.preflight.path_rules import legs_of
from wbf_mission.preflight.rules import ERROR, NOTE, WARNING, Rule, found, planned
from wbf_mission.preflight.subject import LANDINGS, PLACED, TAKEOFFS, Subject

CHECKS = rules.Checks[[Subject, VehicleSnapshot]]()

_setting = partial(Rule, concern=Concern.PARAMETERS)
_state = partial(Rule, concern=Concern.STATE)
_readiness = partial(Rule, concern=Concern.READINESS)


@CHECKS.finds(
    _state("firmware", NOTE, "{firmware}"),
    _state("firmware-unknown", NOTE, "the vehicle sends no firmware version"),
    _state("no-release", WARNING, "{firmware} is not a release", "install a release for flights that matter"),
)
def check_firmware(subject: Subject, snapshot: VehicleSnapshot) -> Iterator[Finding]:
    """Report the firmware, and warn if it is not a release."""
    version = snapshot.version
    if version is None:
        yield found(subject, "firmware-unknown")
        return
    released = version.is_official or not any((version.major, version.minor))
    firmware = f"{subject.profile.name} {version}"
    yield found(subject, "firmware" if released else "no-release", firmware=firmware)


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


@CHECKS.finds(
    _readiness(
        "not-ready", ERROR, "the vehicle's pre-arm checks fail: {reasons}", "wait, or remove the causes"
    ),
    _readiness("unhealthy", ERROR, "unhealthy sensors: {sensors}", "wait, calibrate or repair them"),
    _state("armed", ERROR, "the motors run: somebody may fly the vehicle", "let it land, and disarm it"),
)
def check_readiness(subject: Subject, snapshot: VehicleSnapshot) -> Iterator[Finding]:
    """Find failed pre-arm checks and unhealthy sensors."""
    health = snapshot.sensors_health
    if health is None:
        return
    present, enabled = snapshot.sensors_present or 0, snapshot.sensors_enabled or 0
    if present & _PREARM and not health & _PREARM and not snapshot.armed:
        reasons = ", ".join(snapshot.reasons) or "the vehicle gives no reason"
        yield found(subject, "not-ready", reasons=reasons)
    ill = [name for bit, name in _SENSORS.items() if present & enabled & bit and not health & bit]
    if ill:
        yield found(subject, "unhealthy", sensors=", ".join(ill))
    if snapshot.armed:
        yield found(subject, "armed")


_FIX_3D = 3
_FEW_SATELLITES = 8
_POOR_HDOP = 2.0


@CHECKS.finds(
    _readiness(
        "no-fix", ERROR, "no position from satellites", "wait under the open sky", rules.at_least("fix type")
    ),
    _readiness(
        "few-satellites", WARNING, "few satellites", "wait for more satellites", rules.at_least("satellites")
    ),
    _readiness(
        "poor-fix",
        WARNING,
        "poor geometry of the satellites",
        "wait for better geometry",
        rules.at_most("HDOP"),
    ),
)
def check_gps(subject: Subject, snapshot: VehicleSnapshot) -> Iterator[Finding]:
    """Find a missing or poor GNSS fix."""
    gps = snapshot.gps
    if gps is None or subject.vehicle.is_ideal:
        return
    if gps.fix < _FIX_3D:
        yield found(subject, "no-fix", measured=(gps.fix, _FIX_3D))
    elif gps.satellites is not None and gps.satellites < _FEW_SATELLITES:
        yield found(subject, "few-satellites", measured=(gps.satellites, _FEW_SATELLITES))
    elif gps.hdop is not None and gps.hdop > _POOR_HDOP:
        yield found(subject, "poor-fix", measured=(gps.hdop, _POOR_HDOP))


_PARTS = {
    int(m.ESTIMATOR_ATTITUDE): "attitude",
    int(m.ESTIMATOR_VELOCITY_HORIZ): "velocity",
    int(m.ESTIMATOR_POS_HORIZ_ABS): "position",
}


@CHECKS.finds(
    _readiness("estimator", ERROR, "the estimator has no valid {parts}", "wait until the estimator converges")
)
def check_estimator(subject: Subject, snapshot: VehicleSnapshot) -> Iterator[Finding]:
    """Find states of the vehicle for which the vehicle's estimator has no valid value."""
    flags = snapshot.estimator_flags
    unknown = [name for bit, name in _PARTS.items() if flags is not None and not flags & bit]
    if unknown:
        yield found(subject, "estimator", parts=", ".join(unknown))


@CHECKS.finds(
    _state(
        "battery-now",
        ERROR,
        "the battery is at {holds:.0%} now: after the flight, less than the reserve would be left",
        "charge or change the battery",
        rules.LEFT,
        by_vehicle=True,
    ),
    _state("battery-unknown", NOTE, "the vehicle does not report the battery's charge"),
)
def check_battery_now(subject: Subject, snapshot: VehicleSnapshot) -> Iterator[Finding]:
    """Check the battery's present charge against the plan's need and the reserve."""
    battery = subject.vehicle.battery
    if battery is None or subject.prediction is None:
        return
    if snapshot.battery is None:
        yield found(subject, "battery-unknown")
        return
    left = max(0.0, snapshot.battery - subject.prediction.energy_wh / battery.capacity_wh)
    reserve = battery.reserve_fraction
    if left < reserve:
        yield found(subject, "battery-now", measured=(100.0 * left, 100.0 * reserve), holds=snapshot.battery)


_FAR_M = 30.0
_HEIGHT_M = 10.0


@CHECKS.finds(
    _state(
        "away-from-home",
        ERROR,
        "the vehicle is far from the plan's home, and would return to its start position",
        "carry the vehicle to the plan's home, or plan from the vehicle's position",
        rules.at_most("distance from home", "m"),
    ),
    _state(
        "other-ground-height",
        WARNING,
        "the plan has heights above the sea, but the ground at the vehicle is not as high as the plan's home",
        "give heights above home, or correct the height of the plan's home",
        rules.at_most("difference in height", "m"),
    ),
)
def check_place(subject: Subject, snapshot: VehicleSnapshot) -> Iterator[Finding]:
    """Check the vehicle's distance and height from the plan's home."""
    home = subject.mission.home
    position = None if snapshot.armed or _is_unsettled(snapshot) else snapshot.position
    if position is None or home is None:
        return
    frame = LocalFrame(home.latitude_deg, home.longitude_deg)
    x, y = frame.from_wgs84(position.latitude_deg, position.longitude_deg)
    away_m = float((x * x + y * y) ** 0.5)
    if away_m > FARTHEST_M:
        yield found(subject, "away-from-home", measured=(away_m, FARTHEST_M))
    elif away_m > _FAR_M:
        yield found(subject, "away-from-home", measured=(away_m, _FAR_M), severity=Severity.WARNING)
    above_sea = any(
        item.command in PLACED and item.has_position and item.frame == Frame.GLOBAL for item in subject.items
    )
    higher_m = abs(position.altitude_m - home.altitude_m)
    if above_sea and higher_m > _HEIGHT_M:
        yield found(subject, "other-ground-height", measured=(higher_m, _HEIGHT_M))


def _is_unsettled(snapshot: VehicleSnapshot) -> bool:
    """Return whether the vehicle reports that it has no position yet."""
    if snapshot.estimator_flags is None:
        return snapshot.gps is not None and snapshot.gps.fix < _FIX_3D
    return not snapshot.estimator_flags & m.ESTIMATOR_POS_HORIZ_ABS


_NOTICEABLE = 0.05  # Relative difference of speeds above which a difference is reported
_NOTICEABLE_RADIUS_M = 0.5
_NOTICEABLE_HEIGHT_M = 1.0
# Parameter, name of the value that plans assume for it, relative and absolute tolerance
_ASSUMED = {
    "other-speed": (Meaning.CRUISE_SPEED, "cruise_speed_m_s", _NOTICEABLE, 0.0),
    "other-radius": (Meaning.ACCEPTANCE_RADIUS, "acceptance_radius_m", 0.0, _NOTICEABLE_RADIUS_M),
    "other-return": (Meaning.RETURN_HEIGHT, "return_altitude_m", 0.0, _NOTICEABLE_HEIGHT_M),
}


def _other(subject: Subject, snapshot: VehicleSnapshot, code: str) -> Iterator[Finding]:
    """Yield a finding if a parameter differs from the value that the plan assumes."""
    meaning, attribute, part, more = _ASSUMED[code]
    if (told := snapshot.told(meaning)) is None:
        return
    name, value = told
    assumed: float = getattr(subject.planned, attribute)
    firmware = firmware_of(subject.planned)
    if firmware is not None and name in firmware.procedures.parameters:
        unit = snapshot.questions[meaning][name]
        assumed = unit * parameter_value(subject.planned, name, firmware.procedures.parameters)
    if abs(value - assumed) > part * assumed + more:
        yield found(subject, code, measured=(value, assumed), name=name)


@CHECKS.finds(
    _setting(
        "other-speed",
        WARNING,
        "{name} is not the speed that the plan assumes",
        "change {name}, set the speed in the mission, or plan with --param",
        planned("m/s"),
    ),
    _setting(
        "speed-limit",
        WARNING,
        "{name} is lower than the plan's speed: the flight takes longer than predicted",
        "plan a lower speed, or raise {name}",
        rules.at_most("speed of the plan", "m/s"),
    ),
    _setting(
        "other-radius",
        WARNING,
        "{name} is not the acceptance radius that the plan assumes",
        "change {name}, or plan with --param",
        planned("m"),
    ),
)
def check_motion_settings(subject: Subject, snapshot: VehicleSnapshot) -> Iterator[Finding]:
    """Find speeds and an acceptance radius that differ from the values that the plan assumes."""
    items, legs = subject.items, legs_of(subject)
    orders = [k for k, item in enumerate(items) if item.command == Command.DO_CHANGE_SPEED]
    first_order = min(orders, default=math.inf)
    if any(leg.item < first_order and leg.length_m > 1.0 for leg in legs):
        yield from _other(subject, snapshot, "other-speed")
    fastest = snapshot.told(Meaning.FASTEST)
    wanted = max((leg.speed_m_s for leg in legs), default=0.0)
    if fastest is not None and wanted > fastest[1] * (1.0 + _NOTICEABLE):
        yield found(subject, "speed-limit", measured=(wanted, fastest[1]), name=fastest[0])
    lossy = "param2" in subject.profile.lossy.get(int(Command.NAV_WAYPOINT), frozenset())
    if any(item.command == Command.NAV_WAYPOINT and (lossy or not item.param2) for item in items):
        yield from _other(subject, snapshot, "other-radius")


@CHECKS.finds(
    _setting(
        "high-return",
        WARNING,
        "{name}: the vehicle would return above the maximum altitude",
        "lower {name}",
        rules.at_most("height above home", "m"),
    ),
    _setting(
        "other-return", NOTE, "{name} is not the return altitude that the plan assumes", measured=planned("m")
    ),
)
def check_return_height(subject: Subject, snapshot: VehicleSnapshot) -> Iterator[Finding]:
    """Find a return altitude that is too high, or differs from the prediction."""
    told = snapshot.told(Meaning.RETURN_HEIGHT)
    if told is None or subject.vehicle.drives:
        return
    highest_m = subject.given.max_altitude_m
    if told[1] > highest_m:
        yield found(subject, "high-return", measured=(told[1], highest_m), name=told[0])
    else:
        yield from _other(subject, snapshot, "other-return")


@CHECKS.finds(
    _setting(
        "landing-rule",
        ERROR,
        "{name} is {value:g}: the vehicle refuses a mission without {missing} (a return is not a landing)",
        "{mend}",
    ),
    _setting(
        "circles-at-home",
        WARNING,
        "{name} is 0: after the return, the vehicle circles over home and does not land",
        "end the mission with a landing, or land by hand",
    ),
)
def check_landing_rules(subject: Subject, snapshot: VehicleSnapshot) -> Iterator[Finding]:
    """Find a required take-off or landing that the mission lacks, and a return that does not land."""
    commands = {item.command for item in subject.items}
    takes_off, lands = bool(commands & TAKEOFFS), bool(commands & LANDINGS)
    rule = snapshot.told(Meaning.TAKEOFF_AND_LANDING)
    if rule is not None and not _told_by_dialect(subject, *rule):
        name, value = rule
        missing = _missing(value, takes_off=takes_off, lands=lands)
        if missing:
            lands_not = "a landing" in missing
            mend = f"end with NAV_LAND, or set {name} to 0" if lands_not else "add NAV_TAKEOFF"
            without = " and ".join(missing)
            yield found(subject, "landing-rule", name=name, value=value, missing=without, mend=mend)
    if Command.NAV_RETURN_TO_LAUNCH in commands:
        yield from _zero(subject, snapshot, Meaning.LANDS_AS_MISSION, "circles-at-home")


def _told_by_dialect(subject: Subject, name: str, value: float) -> bool:
    """Return whether the findings about the autopilot's dialect already report this parameter."""
    return any(
        rule.parameter == name and subject.vehicle_type in rule.vehicle_types and value in rule.refusing
        for rule in subject.profile.dialect.conditions
    )


def _missing(rule: float, *, takes_off: bool, lands: bool) -> list[str]:
    """Return the missing items; `rule` 1 wants a take-off, 2 a landing, 3 both, 4 and 5 both or neither."""
    wants_takeoff = rule in (1.0, 3.0) or (rule in (4.0, 5.0) and lands)
    wants_landing = rule in (2.0, 3.0) or (rule in (4.0, 5.0) and takes_off)
    missing = ["a take-off"] if wants_takeoff and not takes_off else []
    return [*missing, "a landing"] if wants_landing and not lands else missing


_CEILING_BIT, _RADIUS_BIT = 1, 2  # FENCE_TYPE of ArduPilot


@CHECKS.finds(
    _setting("fence-off", WARNING, "{name} is 0: the plan's fence has no effect", "set {name}"),
    _setting(
        "fence-tells-only",
        WARNING,
        "{name} is {value:g}: the vehicle only reports a fence breach",
        "set {name} to a value that means return or land",
    ),
    _setting(
        "above-ceiling",
        ERROR,
        "{name}: the plan climbs above the ceiling that is set in the vehicle",
        "change the plan, or raise {name}",
        rules.at_most("height above home", "m"),
    ),
    _setting(
        "beyond-fence-radius",
        ERROR,
        "{name}: the plan goes beyond the fence radius that is set in the vehicle",
        "change the plan, or raise {name}",
        rules.at_most("distance from home", "m"),
    ),
)
def check_fence_settings(subject: Subject, snapshot: VehicleSnapshot) -> Iterator[Finding]:
    """Find a fence without effect, and a ceiling or radius that the plan exceeds."""
    on, action = snapshot.told(Meaning.FENCE_ON), snapshot.told(Meaning.FENCE_ACTION)
    settings = subject.profile.settings
    off = on if on is not None and on[1] == 0.0 else None
    if off is None and action is not None and action[1] in settings.fence_off:
        off = action
    if subject.mission.fence:
        if off is not None:
            yield found(subject, "fence-off", name=off[0])
        elif action is not None and action[1] in settings.fence_tells:
            yield found(subject, "fence-tells-only", name=action[0], value=action[1])
    if off is not None:
        return
    types = snapshot.told(Meaning.FENCE_TYPES)
    farthest_m = max((math.hypot(*leg.end_m[:2]) for leg in legs_of(subject)), default=0.0)
    bits = _CEILING_BIT | _RADIUS_BIT if types is None else int(types[1])
    for meaning, bit, reached, code in (
        (Meaning.FENCE_CEILING, _CEILING_BIT, _highest_m(subject), "above-ceiling"),
        (Meaning.FENCE_RADIUS, _RADIUS_BIT, farthest_m, "beyond-fence-radius"),
    ):
        bound = snapshot.told(meaning)
        if bound is not None and bits & bit and 0.0 < bound[1] < reached:
            yield found(subject, code, measured=(reached, bound[1]), name=bound[0])


def _highest_m(subject: Subject) -> float:
    """Return the greatest height above home of the items and the predicted return."""
    planned = [leg.end_m[2] for leg in legs_of(subject)]
    # The altitude controller overshoots by up to 0.5 m.
    flown = [float(track.points_m[:, 2].max()) - 0.5 for track in subject.tracks]
    return max((*planned, *flown), default=0.0)


_CONTINUES_BIT = 2  # FS_OPTIONS of ArduCopter: continue the mission without a ground station


@CHECKS.finds(
    _setting(
        "no-battery-failsafe",
        WARNING,
        "{name} is 0: the vehicle only reports a low battery",
        "set {name} to a value that means return or land",
    ),
    _setting("link-lost-flies-on", NOTE, "{name} is {value:g}: a lost link does not end the mission"),
    _setting("link-lost-ends", NOTE, "{name} is {value:g}: a long loss of the link ends the mission"),
)
def check_failsafes(subject: Subject, snapshot: VehicleSnapshot) -> Iterator[Finding]:
    """Report the effects of a low battery and a lost link on the mission."""
    yield from _zero(subject, snapshot, Meaning.LOW_BATTERY, "no-battery-failsafe")
    link = snapshot.told(Meaning.LINK_LOST)
    if link is None:
        return
    name, value = link
    options = snapshot.told(Meaning.LINK_LOST_OPTIONS)
    goes_on = options is not None and bool(int(options[1]) & _CONTINUES_BIT)
    goes_on = goes_on or value in subject.profile.settings.link_goes_on
    yield found(subject, "link-lost-flies-on" if goes_on else "link-lost-ends", name=name, value=value)


def _zero(
    subject: Subject, snapshot: VehicleSnapshot, meaning: Meaning, code: str, **words: Any
) -> Iterator[Finding]:
    """Yield a finding if a parameter is 0."""
    told = snapshot.told(meaning)
    if told is not None and told[1] == 0.0:
        yield found(subject, code, name=told[0], **words)


_CALIBRATED = {
    Meaning.ACCELEROMETER: (Severity.ERROR, "calibrate the accelerometer"),
    Meaning.GYROSCOPE: (Severity.ERROR, "calibrate the gyroscope"),
    Meaning.COMPASS: (Severity.WARNING, "calibrate the compass, if the vehicle has one"),
}


@CHECKS.finds(_setting("not-calibrated", ERROR, "{name} is 0: the {sensor} is not calibrated", "{mend}"))
def check_calibration(subject: Subject, snapshot: VehicleSnapshot) -> Iterator[Finding]:
    """Find sensors that were never calibrated."""
    for meaning, (severity, mend) in _CALIBRATED.items():
        sensor = meaning.value.removeprefix("the ").removesuffix("'s calibration")
        words: dict[str, Any] = {"severity": severity, "sensor": sensor, "mend": mend}
        yield from _zero(subject, snapshot, meaning, "not-calibrated", **words)


@CHECKS.finds(_setting("parameter-unread", NOTE, "parameters that could not be read: {names}"))
def check_unread(subject: Subject, snapshot: VehicleSnapshot) -> Iterator[Finding]:
    """Find parameters that the vehicle did not send."""
    missing = [
        " or ".join(names)
        for names in snapshot.questions.values()
        if snapshot.parameters.keys().isdisjoint(names)
    ]
    if missing:
        yield found(subject, "parameter-unread", names=", ".join(missing))
