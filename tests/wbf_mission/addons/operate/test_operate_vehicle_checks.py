"""Each finding in a vehicle: answers that have it, and answers that have not."""

from dataclasses import replace

import pytest
from preflight_plans import (
    CAMERA_OFF,
    FRAME,
    HOME,
    RTL,
    at,
    box,
    camera,
    checked,
    fenced,
    findings,
    good,
    takeoff,
)

from mission.link.codec.dialect import mavlink as m
from mission.model import Command, Frame, GeoPoint, Mission, MissionItem
from wbf_mission.addons.base.inquiry import FirmwareVersion, Gps, VehicleSnapshot
from wbf_mission.preflight.finding import Concern, Severity
from wbf_mission.scenario import VehicleOptions

PX4, ARDUPILOT = 12, 3
SENSORS = 1 | 2 | 4 | 8 | 32 | m.MAV_SYS_STATUS_AHRS | m.MAV_SYS_STATUS_PREARM_CHECK
PX4_PARAMETERS = {
    "MPC_XY_CRUISE": 5.0,
    "MPC_XY_VEL_MAX": 12.0,
    "NAV_ACC_RAD": 2.0,
    "RTL_RETURN_ALT": 30.0,
    "COM_LOW_BAT_ACT": 3.0,
    "NAV_DLL_ACT": 2.0,
    "MIS_TKO_LAND_REQ": 0.0,
    "GF_ACTION": 2.0,
    "GF_MAX_VER_DIST": 0.0,
    "GF_MAX_HOR_DIST": 0.0,
    "CAL_ACC0_ID": 1.0,
    "CAL_GYRO0_ID": 1.0,
    "CAL_MAG0_ID": 1.0,
}
COPTER_PARAMETERS = {
    "WPNAV_SPEED": 1000.0,
    "WPNAV_RADIUS": 200.0,
    "RTL_ALT": 1500.0,
    "FS_GCS_ENABLE": 1.0,
    "FS_OPTIONS": 0.0,
    "BATT_FS_LOW_ACT": 2.0,
    "FENCE_ENABLE": 1.0,
    "FENCE_ACTION": 1.0,
    "FENCE_TYPE": 7.0,
    "FENCE_ALT_MAX": 100.0,
    "FENCE_RADIUS": 150.0,
}
PLANE_PARAMETERS = {
    "AIRSPEED_CRUISE": 12.0,
    "AIRSPEED_MAX": 22.0,
    "WP_RADIUS": 90.0,
    "RTL_ALTITUDE": 60.0,
    "RTL_AUTOLAND": 1.0,
    "FS_GCS_ENABL": 0.0,
    **{name: COPTER_PARAMETERS[name] for name in ("BATT_FS_LOW_ACT", "FENCE_ENABLE", "FENCE_ACTION")},
    "FENCE_TYPE": 0.0,
    "FENCE_ALT_MAX": 100.0,
    "FENCE_RADIUS": 150.0,
}


def vehicle(autopilot=PX4, kind=2, parameters=None, **more):
    known = {PX4: PX4_PARAMETERS, ARDUPILOT: COPTER_PARAMETERS if kind == 2 else PLANE_PARAMETERS}[autopilot]
    given = {
        "parameters": {**known, **(parameters or {})},
        "version": FirmwareVersion(1, 15, 4, 255),
        "sensors_present": SENSORS,
        "sensors_enabled": SENSORS,
        "sensors_health": SENSORS,
        "gps": Gps(3, 14, 0.8),
        "estimator_flags": 831,
        "position": HOME,
        "battery": 1.0,
        **more,
    }
    return VehicleSnapshot(1, autopilot, kind, **given)


def place(metres_east, up=0.0):
    return GeoPoint(*FRAME.to_wgs84(metres_east, 0.0), HOME.altitude_m + up)


def px4(**parameters):
    return vehicle(parameters=parameters)


def copter(**parameters):
    return vehicle(ARDUPILOT, parameters=parameters)


def plane(**parameters):
    return vehicle(ARDUPILOT, kind=1, parameters=parameters)


UNORDERED = Mission((takeoff(), at(40, 0, param2=0.0), at(0, 40, param2=0.0), RTL), HOME)
FENCED = fenced(good(), box(-50, -50, 90, 90))
ABOVE_SEA = good(
    *(replace(one, frame=int(Frame.GLOBAL), z=30.0) for one in (at(40, 0), at(0, 40))),
    start=(replace(takeoff(), frame=int(Frame.GLOBAL), z=30.0),),
)
WING = Mission(
    (
        at(0, 150, 40.0, Command.NAV_TAKEOFF, param1=10.0),
        camera(5.0),
        at(0, 500, 40.0),
        at(500, 500, 40.0),
        CAMERA_OFF,
        at(-400, 0, 30.0, Command.DO_LAND_START),
        at(-400, 80, 30.0, Command.NAV_LOITER_TO_ALT, param1=1.0, param2=80.0, param4=1.0),
        at(0, 0, 0.0, Command.NAV_LAND),
    ),
    HOME,
)
WING_HOME = replace(WING, items=(*WING.items[:5], MissionItem(Command.NAV_RETURN_TO_LAUNCH)))
COPTER = {"autopilot": "ardupilot"}
PLANE = {"vehicle": "fixed-wing", "autopilot": "ardupilot"}

# (code, mission, answers that have it, answers that have not, severity, options)
CASES = [
    ("other-speed", UNORDERED, px4(MPC_XY_CRUISE=8.0), px4(), "warning", {}),
    (
        "other-speed",
        UNORDERED,
        px4(),
        px4(MPC_XY_CRUISE=8.0),
        "warning",
        {"parameters": {"MPC_XY_CRUISE": 8.0}},
    ),
    ("other-speed", UNORDERED, copter(WPNAV_SPEED=500.0), copter(), "warning", COPTER),
    ("speed-limit", good(), px4(MPC_XY_VEL_MAX=3.0), px4(), "warning", {}),
    ("other-radius", UNORDERED, px4(NAV_ACC_RAD=10.0), px4(), "warning", {}),
    ("other-radius", good(), copter(WPNAV_RADIUS=600.0), copter(), "warning", COPTER),
    ("high-return", good(), px4(RTL_RETURN_ALT=150.0), px4(), "warning", {}),
    ("other-return", good(), px4(RTL_RETURN_ALT=50.0), px4(), "note", {}),
    ("no-battery-failsafe", good(), px4(COM_LOW_BAT_ACT=0.0), px4(), "warning", {}),
    ("no-battery-failsafe", good(), copter(BATT_FS_LOW_ACT=0.0), copter(), "warning", COPTER),
    ("link-lost-flies-on", good(), px4(NAV_DLL_ACT=0.0), px4(), "note", {}),
    ("link-lost-flies-on", good(), copter(FS_OPTIONS=2.0), copter(), "note", COPTER),
    ("link-lost-ends", good(), px4(), px4(NAV_DLL_ACT=0.0), "note", {}),
    ("link-lost-ends", good(), copter(), copter(FS_GCS_ENABLE=0.0), "note", COPTER),
    ("landing-rule", good(), px4(MIS_TKO_LAND_REQ=2.0), px4(), "error", {}),
    ("landing-rule", good(start=()), px4(MIS_TKO_LAND_REQ=1.0), px4(), "error", {}),
    ("landing-rule", good(), px4(MIS_TKO_LAND_REQ=4.0), px4(MIS_TKO_LAND_REQ=1.0), "error", {}),
    ("circles-at-home", WING_HOME, plane(RTL_AUTOLAND=0.0), plane(), "warning", PLANE),
    ("fence-off", FENCED, px4(GF_ACTION=0.0), px4(), "warning", {}),
    ("fence-off", FENCED, copter(FENCE_ENABLE=0.0), copter(), "warning", COPTER),
    ("fence-tells-only", FENCED, px4(GF_ACTION=1.0), px4(), "warning", {}),
    ("fence-tells-only", FENCED, copter(FENCE_ACTION=0.0), copter(), "warning", COPTER),
    ("above-ceiling", good(), px4(GF_MAX_VER_DIST=9.0), px4(GF_MAX_VER_DIST=40.0), "error", {}),
    (
        "above-ceiling",
        good(),
        copter(FENCE_ALT_MAX=9.0),
        copter(FENCE_ALT_MAX=9.0, FENCE_TYPE=4.0),
        "error",
        COPTER,
    ),
    ("beyond-fence-radius", good(), px4(GF_MAX_HOR_DIST=50.0), px4(GF_MAX_HOR_DIST=60.0), "error", {}),
    (
        "beyond-fence-radius",
        good(),
        copter(FENCE_RADIUS=50.0),
        copter(FENCE_RADIUS=50.0, FENCE_ENABLE=0.0),
        "error",
        COPTER,
    ),
    ("not-calibrated", good(), px4(CAL_GYRO0_ID=0.0), px4(), "error", {}),
    ("not-calibrated", good(), px4(CAL_MAG0_ID=0.0), px4(), "warning", {}),
    ("parameter-unread", good(), replace(px4(), parameters={}), px4(), "note", {}),
    ("firmware", good(), vehicle(), vehicle(version=None), "note", {}),
    ("firmware-unknown", good(), vehicle(version=None), vehicle(), "note", {}),
    ("no-release", good(), vehicle(version=FirmwareVersion(1, 16, 0, 64)), vehicle(), "warning", {}),
    ("not-ready", good(), vehicle(sensors_health=SENSORS & ~(1 << 28)), vehicle(), "error", {}),
    ("unhealthy", good(), vehicle(sensors_health=SENSORS & ~4), vehicle(), "error", {}),
    ("armed", good(), vehicle(armed=True), vehicle(), "error", {}),
    ("no-fix", good(), vehicle(gps=Gps(1, 0, None)), vehicle(), "error", {}),
    ("few-satellites", good(), vehicle(gps=Gps(3, 5, 0.9)), vehicle(gps=Gps(3, None, 0.9)), "warning", {}),
    ("poor-fix", good(), vehicle(gps=Gps(3, 9, 3.0)), vehicle(gps=Gps(3, 9, None)), "warning", {}),
    ("estimator", good(), vehicle(estimator_flags=831 & ~16), vehicle(estimator_flags=None), "error", {}),
    ("battery-now", good(), vehicle(battery=0.22), vehicle(battery=0.4), "error", {}),
    ("battery-unknown", good(), vehicle(battery=None), vehicle(), "note", {}),
    ("away-from-home", good(), vehicle(position=place(350.0)), vehicle(), "error", {}),
    ("away-from-home", good(), vehicle(position=place(60.0)), vehicle(position=None), "warning", {}),
    ("other-ground-height", ABOVE_SEA, vehicle(position=place(5.0, up=15.0)), vehicle(), "warning", {}),
]


@pytest.mark.parametrize(
    ("code", "mission", "with_it", "without", "severity", "options"), CASES, ids=[one[0] for one in CASES]
)
def test_a_vehicle_that_has_it_and_one_that_has_not(code, mission, with_it, without, severity, options):
    found = findings(mission, snapshot=with_it, **options)
    assert code in found, list(found)
    assert found[code].severity is Severity(severity), str(found[code])
    assert found[code].concern is not Concern.PLAN
    assert found[code].fix or severity == "note"
    assert code not in findings(mission, snapshot=without, **options)


@pytest.mark.parametrize(
    ("answers", "options"), [(vehicle(), {}), (vehicle(ARDUPILOT), COPTER), (vehicle(ARDUPILOT, 1), PLANE)]
)
def test_a_vehicle_as_it_should_be_gives_notes_only(answers, options):
    mission = WING if options is PLANE else good()
    found = findings(mission, snapshot=answers, **options)
    assert {code for code, one in found.items() if one.severity is not Severity.NOTE} <= {"tight-turn"}
    assert "firmware" in found


def test_a_landing_that_the_vehicle_does_not_arm_with_is_told_once():
    report = checked(WING, snapshot=plane(RTL_AUTOLAND=0.0), **PLANE).report
    assert [one.code for one in report.findings if "RTL_AUTOLAND" in one.text] == ["landing-rule"]
    assert not checked(WING, snapshot=plane(), **PLANE).report.has_errors


def test_what_counts_for_an_upload_and_what_for_a_start():
    ill = vehicle(battery=0.1, gps=Gps(0), sensors_health=0, parameters={"GF_MAX_VER_DIST": 5.0})
    concerns = {code: one.concern for code, one in findings(good(), snapshot=ill).items()}
    assert concerns["above-ceiling"] is Concern.PARAMETERS
    assert concerns["battery-now"] is Concern.STATE
    assert {concerns[code] for code in ("no-fix", "not-ready", "unhealthy")} == {Concern.READINESS}


def test_the_vehicles_own_reasons_are_told():
    ill = vehicle(sensors_health=SENSORS & ~(1 << 28), reasons=("GPS 1: Bad fix", "Battery low"))
    assert "GPS 1: Bad fix, Battery low" in findings(good(), snapshot=ill)["not-ready"].text


def test_names_of_newer_versions_count_first():
    newer = {**COPTER_PARAMETERS, "WP_SPD": 5.0, "RTL_ALT_M": 150.0}
    answers = replace(vehicle(ARDUPILOT), parameters=newer)
    found = findings(UNORDERED, snapshot=answers, **COPTER)
    assert found["other-speed"].text.startswith("WP_SPD")
    assert found["high-return"].measure.value == 150.0


def test_an_unknown_autopilot_is_asked_nothing_and_judged_by_its_state():
    answers = VehicleSnapshot(1, 0, 2, gps=Gps(0), battery=1.0, position=HOME)
    found = findings(good(), snapshot=answers)
    assert "no-fix" in found
    assert "parameter-unread" not in found


def test_home_of_a_plan_without_one_is_where_the_vehicle_stands():
    mission = replace(good(), home=None)
    found = findings(mission, snapshot=vehicle(position=place(-1500.0)))
    assert found["far-start"].measure.value == pytest.approx(1500.0, abs=5.0)


COPTER_4_7 = {
    "WP_SPD": 8.0,
    "RTL_ALT_M": 40.0,
    "RTL_SPEED_MS": 3.0,
    "RTL_CONE_SLOPE": 0.0,
    "LAND_SPD_MS": 0.30000001192092896,
    "LAND_ALT_LOW_M": 10.0,
}


@pytest.mark.parametrize(
    ("told", "options", "wanted"),
    [
        (vehicle(parameters={}), {"autopilot": "px4"}, {}),
        (px4(RTL_RETURN_ALT=60.0, RTL_CONE_ANG=90.0), {}, {"RTL_RETURN_ALT": 60.0, "RTL_CONE_ANG": 90}),
        (px4(MPC_LAND_SPEED=0.699999988079071), {}, {}),  # the default, in four bytes
        (px4(RTL_RETURN_ALT=1e6, MPC_LAND_SPEED=-1.0), {}, {}),  # nothing that the model can fly
        (px4(), {"parameters": {"RTL_RETURN_ALT": 12.0}}, {"RTL_RETURN_ALT": 30.0}),
        (
            vehicle(ARDUPILOT, parameters=COPTER_4_7),
            COPTER,
            {
                "WPNAV_SPEED": 800.0,
                "RTL_ALT": 4000,
                "RTL_SPEED": 300,
                "RTL_CONE_SLOPE": 0.0,
                "LAND_SPEED": 30,
            },
        ),
        (copter(RTL_ALT=4000.0, RTL_ALT_M=20.0), COPTER, {"RTL_ALT": 2000}),  # the newest name counts
        (plane(RTL_ALTITUDE=80.0), PLANE, {}),
    ],
)
def test_a_vehicle_is_predicted_with_what_is_set_on_it(told, options, wanted):
    named = {"name" if key == "vehicle" else key: value for key, value in options.items()}
    given = VehicleOptions(**{"name": "quad", "autopilot": "px4", **named})
    set_on_it = told.as_set(given).parameters
    assert set_on_it == {**given.parameters, **wanted}
    assert (told.as_set(given) is given) == (not wanted)


@pytest.mark.parametrize(
    ("snapshot", "longer_s", "options"),
    [
        (px4(RTL_RETURN_ALT=60.0), 20.0, {}),
        (copter(RTL_ALT=6000.0, RTL_CONE_SLOPE=0.0), 20.0, COPTER),
        (copter(LAND_SPEED=30.0), 10.0, COPTER),
        (px4(RTL_LAND_DELAY=40.0), 30.0, {}),
    ],
)
def test_the_check_predicts_the_return_and_the_landing_that_the_vehicle_flies(snapshot, longer_s, options):
    plain = px4() if snapshot.autopilot == PX4 else copter()
    times = [
        checked(good(), snapshot=one, **options).subject.prediction.duration_s for one in (plain, snapshot)
    ]
    assert times[1] > times[0] + longer_s
    assert checked(good(), **options).subject.prediction.duration_s == pytest.approx(times[0], abs=0.1)
