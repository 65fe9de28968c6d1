"""MAVSDK (its own library, by ctypes) flies both autopilots over loopback sockets."""

import time

import pytest
from sweeps import autopilots

from mission.outcome import Outcome


@pytest.fixture
def ready(connected, tools):
    """A vehicle that MAVSDK finds healthy, and MAVSDK's plugins on it."""

    def connect(autopilot, **options):
        from mavsdk.plugins.action import Action
        from mavsdk.plugins.mission_raw import MissionRaw
        from mavsdk.plugins.telemetry import Telemetry

        flying, system = connected(autopilot, **options)
        telemetry = Telemetry(system)
        if flying.is_ardupilot:  # it sends what it is asked for
            for name in ("health", "position", "landed_state", "gps_info", "battery", "home"):
                getattr(telemetry, f"set_rate_{name}")(10.0 if name == "position" else 2.0)
        tools.wait_until(telemetry.health_all_ok, what="health all ok")
        return flying, system, telemetry, Action(system), MissionRaw(system)

    return connect


def signature(items):
    frames = {5: 0, 6: 3}  # with and without INT they mean the same
    return [
        (frames.get(i.frame, i.frame), i.command, round(i.param1, 6), i.x, i.y, round(i.z, 3)) for i in items
    ]


@autopilots()
def test_it_is_recognised(autopilot, ready, tools):
    from mavsdk import Autopilot, Vehicle
    from mavsdk.plugins.info import Info
    from mavsdk.plugins.telemetry import LandedState

    flying, system, telemetry, _, _ = ready(autopilot)
    assert system.is_connected() and system.has_autopilot()
    assert system.get_system_id() == 1
    expected = Autopilot.ARDUPILOT if flying.is_ardupilot else Autopilot.PX4
    assert (system.autopilot_type(), system.vehicle_type()) == (expected, Vehicle.MULTICOPTER)
    version = Info(system).get_version()
    major, minor, patch = flying.vehicle.firmware.mavlink.identity.version
    assert (version.flight_sw_major, version.flight_sw_minor, version.flight_sw_patch) == (
        major,
        minor,
        patch,
    )
    health = telemetry.health()
    assert health.is_armable and health.is_home_position_ok and health.is_local_position_ok
    home = telemetry.home()
    assert home.latitude_deg == pytest.approx(flying.home.latitude_deg, abs=1e-7)
    assert home.absolute_altitude_m == pytest.approx(flying.home.altitude_m, abs=1e-3)
    tools.wait_until(lambda: telemetry.landed_state() == LandedState.ON_GROUND, what="landed state")
    assert not telemetry.armed() and not telemetry.in_air()
    assert telemetry.gps_info().num_satellites >= 10
    assert telemetry.battery().remaining_percent > 90.0


@autopilots()
def test_plans_come_back_as_they_were_sent_and_changes_are_told(autopilot, ready, tools):
    from mavsdk.plugins.mission_raw import MissionRawError

    flying, _, _, _, raw = ready(autopilot, speed=2.0)
    changes = []
    raw.subscribe_mission_changed(lambda changed, _: changes.append(changed))
    mission = tools.raw_items(flying.mission)
    fence = tools.raw_items(tools.fence_about(flying.home), 1)
    rally = tools.raw_items(tools.rally_about(flying.home), 2)
    raw.upload_geofence(fence)
    raw.upload_rally_points(rally)
    raw.upload_mission(mission)
    first = 1 if flying.is_ardupilot else 0  # item 0 of an ArduPilot is home
    tools.wait_until(lambda: changes, what="mission changed")
    stored = raw.download_mission()
    assert [(i.command, i.x, i.y) for i in stored[first:]] == [(i.command, i.x, i.y) for i in mission[first:]]
    assert [i.seq for i in stored] == list(range(len(mission)))
    assert signature(raw.download_geofence()) == signature(fence)
    rally_back = raw.download_rallypoints()
    assert [(i.command, i.x, i.y, i.z) for i in rally_back] == [(i.command, i.x, i.y, i.z) for i in rally]
    tools.wait_until(lambda: raw.mission_progress().total == len(mission), what="the new count")
    raw.clear_mission()
    try:
        left = raw.download_mission()
    except MissionRawError as error:
        assert "NO_MISSION" in str(error), error
        left = []
    assert len(left) <= first
    if flying.is_ardupilot:
        with pytest.raises(MissionRawError):
            raw.start_mission()
    else:
        raw.start_mission()  # only a mode, which PX4 takes while it is disarmed


@autopilots(slow_with=["ardupilot"])
def test_it_flies_a_mission_with_a_pause_and_a_jump_ahead(autopilot, ready, tools):
    from mavsdk.plugins.telemetry import FlightMode

    flying, _, telemetry, action, raw = ready(autopilot)
    wait = tools.wait_until
    raw.upload_mission(tools.raw_items(flying.mission))
    assert not raw.is_mission_finished()
    action.arm()
    wait(telemetry.armed, what="armed")
    raw.start_mission()
    wait(telemetry.in_air, what="in air")
    wait(lambda: telemetry.flight_mode() == FlightMode.MISSION, what="mission mode")
    first_place = 3 if flying.is_ardupilot else 2
    wait(lambda: raw.mission_progress().current >= first_place, what="the first place")
    raw.pause_mission()
    wait(lambda: telemetry.flight_mode() == FlightMode.HOLD, what="hold mode")
    wait(lambda: abs(telemetry.velocity_ned().east_m_s) < 0.05, what="a stop")
    assert telemetry.armed() and telemetry.in_air() and not raw.is_mission_finished()
    raw.set_current_mission_item(len(flying.mission) - 2)
    wait(lambda: raw.mission_progress().current == len(flying.mission) - 2, what="the current item")
    raw.start_mission()
    wait(lambda: telemetry.flight_mode() == FlightMode.MISSION, what="mission mode again")
    wait(raw.is_mission_finished, what="the end of the mission")
    wait(lambda: not telemetry.armed(), what="disarming")
    assert flying.vehicle.outcome is Outcome.COMPLETED
    place = telemetry.position()
    assert place.latitude_deg == pytest.approx(flying.home.latitude_deg, abs=1e-5)
    # What PX4 tells on the ground, recorded, is up to 2.7 m off.
    off_m = 0.1 if flying.is_ardupilot else 2.5
    assert place.relative_altitude_m == pytest.approx(0.0, abs=off_m)


@autopilots(slow_with=["px4"])
def test_it_takes_off_goes_returns_and_lands(autopilot, ready, tools):
    from mavsdk.plugins.action import ActionError
    from mavsdk.plugins.telemetry import FlightMode, LandedState

    flying, _, telemetry, action, _ = ready(autopilot, speed=20.0)
    wait = tools.wait_until
    states = set()
    telemetry.subscribe_landed_state(lambda state, _: states.add(state))
    action.set_takeoff_altitude(6.0)
    assert action.get_takeoff_altitude() == 6.0
    action.arm()
    action.takeoff()
    wait(lambda: telemetry.position().relative_altitude_m > 5.9, what="takeoff")
    # An ArduPilot stays in GUIDED, which MAVSDK calls OFFBOARD.
    after = FlightMode.OFFBOARD if flying.is_ardupilot else FlightMode.HOLD
    wait(lambda: telemetry.flight_mode() == after, what="the end of the takeoff")
    latitude, longitude = flying.place(10.0, 8.0)
    action.goto_location(latitude, longitude, flying.home.altitude_m + 9.0, 90.0)
    wait(lambda: abs(telemetry.position().longitude_deg - longitude) < 1e-6, what="goto")
    wait(lambda: abs(telemetry.position().relative_altitude_m - 9.0) < 0.2, what="its altitude")
    if not flying.is_ardupilot:
        wait(lambda: abs(telemetry.heading().heading_deg - 90.0) < 1.0, what="its heading")
    action.set_current_speed(3.0)
    action.hold()
    wait(lambda: telemetry.flight_mode() == FlightMode.HOLD, what="hold")
    action.return_to_launch()
    wait(lambda: telemetry.flight_mode() == FlightMode.RETURN_TO_LAUNCH, what="return")
    wait(lambda: not telemetry.armed(), what="the landing at home")
    assert telemetry.position().longitude_deg == pytest.approx(flying.home.longitude_deg, abs=1e-5)
    # The heartbeat that says disarmed may overtake the next state of landing.
    told = {LandedState.IN_AIR, LandedState.TAKING_OFF, LandedState.ON_GROUND}
    wait(lambda: told <= states, what="the states of landing")
    if flying.is_ardupilot:
        # MAVSDK takes BRAKE before it arms, in which ArduCopter refuses.
        with pytest.raises(ActionError):
            action.arm()
        return
    # ... and once more, down where it is
    action.arm()
    action.takeoff()
    wait(lambda: telemetry.position().relative_altitude_m > 5.9, what="the second takeoff")
    action.land()
    wait(lambda: telemetry.flight_mode() == FlightMode.LAND, what="land mode")
    wait(lambda: telemetry.landed_state() == LandedState.ON_GROUND, what="touch-down")
    wait(lambda: not telemetry.armed(), what="disarming")
    wait(lambda: telemetry.flight_mode() == FlightMode.HOLD, what="the mode before")


@autopilots()
def test_it_hears_refusals_and_why(autopilot, ready, tools):
    from mavsdk.plugins.action import ActionError, ActionResult

    flying, _, telemetry, action, _ = ready(autopilot, speed=5.0)
    texts = []
    telemetry.subscribe_status_text(lambda text, _: texts.append(text.text))

    def refused(order, *arguments):
        with pytest.raises(ActionError) as error:
            order(*arguments)
        return error.value.result

    no = (ActionResult.COMMAND_DENIED, ActionResult.FAILED)  # PX4's word and ArduPilot's
    flying.vehicle.pilot.arming.block = "compass not calibrated"
    tools.wait_until(lambda: not telemetry.health().is_armable, what="not armable")
    assert refused(action.arm) in no
    reason = f"{'Arm' if flying.is_ardupilot else 'Preflight Fail'}: compass not calibrated"
    tools.wait_until(lambda: reason in texts, what="the reason")
    assert flying.vehicle.outcome is Outcome.ARMING_REFUSED
    flying.vehicle.pilot.arming.block = None
    tools.wait_until(lambda: telemetry.health().is_armable, what="armable")
    assert refused(action.goto_location, *flying.place(5, 5), 40.0, 0.0) in no
    action.arm()
    action.takeoff()
    tools.wait_until(telemetry.in_air, what="in air")
    assert refused(action.disarm) in no
    if not flying.is_ardupilot:  # which says nothing to it
        tools.wait_until(lambda: any("not landed" in t for t in texts), what="the second reason")
    assert telemetry.armed()
    action.land()


@autopilots()
def test_parameters_are_read_set_and_listed(autopilot, connected, tools):
    from mavsdk.plugins.param import Param, ParamError

    flying, system = connected(autopilot, speed=5.0)
    param = Param(system)
    ardupilot = flying.is_ardupilot
    speed, scale = ("WPNAV_SPEED", 100.0) if ardupilot else ("MPC_XY_CRUISE", 1.0)
    system_id, delay = ("MAV_SYSID", "DISARM_DELAY") if ardupilot else ("MAV_SYS_ID", "COM_LOW_BAT_ACT")
    assert param.get_param_float(speed) == pytest.approx(flying.vehicle.pilot.spec.cruise_speed_m_s * scale)
    param.set_param_float(speed, 6.5 * scale)
    assert param.get_param_float(speed) == 6.5 * scale
    assert flying.vehicle.pilot.spec.cruise_speed_m_s == 6.5
    assert param.get_param_int(system_id) == 1
    param.set_param_int(delay, 0)
    assert param.get_param_int(delay) == 0
    if not ardupilot:
        assert flying.vehicle.pilot.parameters.low_battery_action == 0
    everything = param.get_all_params()
    floats = {p.name: p.value for p in everything.float_params}
    integers = {p.name: p.value for p in everything.int_params}
    assert floats[speed] == 6.5 * scale
    assert ("RTL_RETURN_ALT" in floats) is not ardupilot
    assert (integers[system_id], integers[delay]) == (1, 0)
    with pytest.raises(ParamError):
        param.get_param_int(speed)  # the wrong type


@autopilots()
def test_rates_change_and_streams_arrive(autopilot, ready, tools):
    _, _, telemetry, _, _ = ready(autopilot, speed=10.0)
    counts = dict.fromkeys(("position", "quaternion", "velocity", "time"), 0)

    def counting(name):
        def count(*_):
            counts[name] += 1

        return count

    telemetry.subscribe_position(counting("position"))
    telemetry.subscribe_attitude_quaternion(counting("quaternion"))
    telemetry.subscribe_velocity_ned(counting("velocity"))
    telemetry.subscribe_unix_epoch_time(counting("time"))
    for name, rate in (
        ("position", 1.0),
        ("attitude_quaternion", 10.0),
        ("battery", 2.0),
        ("gps_info", 2.0),
        ("home", 1.0),
        ("in_air", 5.0),
        ("unix_epoch_time", 2.0),
    ):
        getattr(telemetry, f"set_rate_{name}")(rate)
    time.sleep(0.05)  # what was on the way at the old rates
    before = dict(counts)
    tools.wait_until(lambda: counts["quaternion"] - before["quaternion"] >= 60, what="sixty quaternions")
    position = counts["position"] - before["position"]
    assert 4 <= position <= 10, "positions at a tenth of the quaternions' rate"
    quaternion = telemetry.attitude_quaternion()
    assert quaternion.w**2 + quaternion.z**2 == pytest.approx(1.0, abs=1e-3)
    assert telemetry.unix_epoch_time() > 1_700_000_000_000_000
    assert counts["velocity"] > 0 and counts["time"] > 0
