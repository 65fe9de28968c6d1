"""The vehicle as it stands there: firmware, sensors, satellites, estimator, battery, place."""

from __future__ import annotations

from collections.abc import Iterator

from geo.frame import LocalFrame
from mission.ground.clearance import FARTHEST_M
from mission.link.codec.dialect import mavlink as m
from mission.model import Frame
from wbf_mission.preflight.checks.legs import PLACED
from wbf_mission.preflight.finding import Concern, Finding, Measure, Severity
from wbf_mission.preflight.subject import Subject
from wbf_mission.preflight.vehicle.snapshot import VehicleSnapshot

__all__ = [
    "check_battery_now",
    "check_estimator",
    "check_firmware",
    "check_gps",
    "check_place",
    "check_readiness",
]

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
        yield _finding(Severity.NOTE, "firmware-unknown", "the vehicle does not tell its firmware's version")
        return
    text = f"{subject.profile.name} {snapshot.version}"
    if snapshot.version.is_official or not any((snapshot.version.major, snapshot.version.minor)):
        yield _finding(Severity.NOTE, "firmware", text)
    else:
        fix = "fly a release where it matters"
        yield _finding(Severity.WARNING, "no-release", f"{text} is no release", fix)


def check_readiness(subject: Subject) -> Iterator[Finding]:
    """Whether its own checks pass, and sensors that are not healthy."""
    snapshot = subject.snapshot
    if snapshot is None or snapshot.sensors_health is None:
        return
    present, enabled = snapshot.sensors_present or 0, snapshot.sensors_enabled or 0
    health = snapshot.sensors_health
    if present & _PREARM and not health & _PREARM and not snapshot.armed:
        reasons = ", ".join(snapshot.reasons) or "it does not tell why"
        yield _finding(
            Severity.ERROR,
            "not-ready",
            f"the vehicle says that it cannot arm: {reasons}",
            "wait, or do what it says",
            concern=Concern.READINESS,
        )
    ill = [name for bit, name in _SENSORS.items() if present & enabled & bit and not health & bit]
    if ill:
        yield _finding(
            Severity.ERROR,
            "unhealthy",
            f"not healthy: {', '.join(ill)}",
            "wait until it is, calibrate or repair it",
            concern=Concern.READINESS,
        )
    if snapshot.armed:
        yield _finding(Severity.WARNING, "armed", "the motors are running", "is it flying?")


def check_gps(subject: Subject) -> Iterator[Finding]:
    """No fix, or a poor one."""
    gps = None if subject.snapshot is None else subject.snapshot.gps
    if gps is None or subject.vehicle.is_ideal:
        return
    if gps.fix < _FIX_3D:
        yield _finding(
            Severity.ERROR,
            "no-fix",
            "no position from satellites",
            "wait under the open sky",
            Measure.at_least("fix type", gps.fix, _FIX_3D),
            concern=Concern.READINESS,
        )
    elif gps.satellites is not None and gps.satellites < _FEW_SATELLITES:
        yield _finding(
            Severity.WARNING,
            "few-satellites",
            "few satellites",
            "wait for more",
            Measure.at_least("satellites", gps.satellites, _FEW_SATELLITES),
            concern=Concern.READINESS,
        )
    elif gps.hdop is not None and gps.hdop > _POOR_HDOP:
        yield _finding(
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
        yield _finding(
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
        yield _finding(Severity.NOTE, "battery-unknown", "the vehicle does not tell what its battery holds")
        return
    left = snapshot.battery - subject.needed_wh / battery.capacity_wh
    if left < battery.reserve_fraction:
        yield _finding(
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
        yield _finding(
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
        yield _finding(
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


def _finding(
    severity: Severity,
    code: str,
    text: str,
    fix: str = "",
    measure: Measure | None = None,
    *,
    concern: Concern = Concern.STATE,
) -> Finding:
    return Finding(severity, code, text, fix, measure=measure, concern=concern)
