"""MAVSDK's smaller plugins before the simulated PX4: streams, calibration, actuators, origin, failures."""

import queue

import pytest


@pytest.fixture
def px4(connected):
    return connected("px4")


def test_streams_come_by_themselves_and_at_the_rate_that_is_asked_for(px4, tools):
    from mavsdk.plugins.telemetry import Telemetry

    telemetry = Telemetry(px4[1])
    counts = dict.fromkeys(("altitude", "attitude_quaternion", "imu", "odometry"), 0)
    for name in counts:

        def count(*_, name=name):
            counts[name] += 1

        getattr(telemetry, f"subscribe_{name}")(count)
    tools.wait_until(lambda: all(counts.values()), what="each stream once")
    for name in counts:
        getattr(telemetry, f"set_rate_{name}")(10.0)
    before = dict(counts)
    tools.wait_until(lambda: all(counts[name] > before[name] + 20 for name in counts), what="more of each")


def test_a_gyro_calibration_tells_its_progress(px4):
    from mavsdk.plugins.calibration import Calibration

    calibration = Calibration(px4[1])
    told = queue.Queue()
    calibration.calibrate_gyro_async(lambda result, data, *_: told.put((result.name, data.progress)))
    shares = []
    while True:
        name, progress = told.get(timeout=20.0)
        if name != "NEXT":
            break
        shares.append(progress)
    assert name == "SUCCESS"
    assert [share for share in shares if share == share][-1] == pytest.approx(0.9)


def test_actuators_and_the_origin_are_taken_and_failures_get_no_answer(px4):
    from mavsdk.plugins.action import Action
    from mavsdk.plugins.failure import Failure, FailureError, FailureType, FailureUnit

    flying, system = px4
    action = Action(system)
    action.set_actuator(1, 0.5)
    home = flying.home
    action.set_gps_global_origin(home.latitude_deg, home.longitude_deg, home.altitude_m)
    with pytest.raises(FailureError) as error:
        Failure(system).inject(FailureUnit.SENSOR_GYRO, FailureType.OFF, 0)
    assert error.value.result.name == "TIMEOUT"


@pytest.mark.parametrize("mode", ["position", pytest.param("altitude", marks=pytest.mark.slow)])
def test_manual_control_flies(mode, connected, tools):
    import threading

    from mavsdk.plugins.action import Action
    from mavsdk.plugins.manual_control import ManualControl, ManualControlError
    from mavsdk.plugins.telemetry import Telemetry

    # Sticks are lost after half a second of the vehicle's time.
    flying, system = connected("px4", speed=2.0)
    telemetry, action, control = Telemetry(system), Action(system), ManualControl(system)
    tools.wait_until(telemetry.health_all_ok, what="health all ok")
    action.arm()
    action.takeoff()
    tools.wait_until(lambda: flying.vehicle.pilot.mode.value == "hold", what="the take-off")
    begin = getattr(control, f"start_{mode}_control")
    with pytest.raises(ManualControlError):
        begin()
    forward, done = [0.0], threading.Event()

    def push():
        while not done.wait(0.02):
            control.set_manual_control_input(forward[0], 0.0, 0.5, 0.0)

    sticks = threading.Thread(target=push)
    sticks.start()
    try:
        # The vehicle takes the mode only while it hears sticks.
        control.set_manual_control_input(0.0, 0.0, 0.5, 0.0)
        begin()
        assert flying.vehicle.pilot.mode.value == mode
        east, north, height = flying.vehicle.pilot.state.position_m
        forward[0] = 0.6

        def moved():
            now = flying.vehicle.pilot.state.position_m
            return abs(now[0] - east) + abs(now[1] - north) > 10.0

        tools.wait_until(moved, what="the way by stick")
        assert abs(flying.vehicle.pilot.state.position_m[2] - height) < 1.0
    finally:
        done.set()
        sticks.join()
    tools.wait_until(lambda: flying.vehicle.pilot.mode.value == "return", what="the return without sticks")


def test_a_vehicle_that_is_armed_and_does_not_take_off_is_disarmed(px4, tools):
    from mavsdk.plugins.action import Action
    from mavsdk.plugins.telemetry import Telemetry

    _, system = px4
    telemetry, action = Telemetry(system), Action(system)
    texts = []
    telemetry.subscribe_status_text(lambda text, _: texts.append(text.text))
    tools.wait_until(telemetry.health_all_ok, what="health all ok")
    action.arm()
    tools.wait_until(lambda: "Disarmed by auto preflight disarming" in texts, what="the text")
    tools.wait_until(lambda: not telemetry.armed(), what="the heartbeat")


def test_a_server_at_a_udp_port_is_called(fly, mavsdk_system, tools):
    from mavsdk.plugins.mission_raw import MissionRaw

    flying = fly("px4", ("udpin:127.0.0.1:0",))
    mission = MissionRaw(mavsdk_system(f"udpout://127.0.0.1:{tools.port_of(flying.urls[0])}"))
    sent = tools.raw_items(flying.mission)
    mission.upload_mission(sent)
    back = mission.download_mission()
    assert [(i.command, i.x, i.y) for i in back] == [(i.command, i.x, i.y) for i in sent]


def test_follow_me_is_started_told_where_the_target_is_and_stopped(connected, tools):
    import math
    import time

    from mavsdk.plugins.action import Action
    from mavsdk.plugins.follow_me import FollowMe, TargetLocation
    from mavsdk.plugins.telemetry import FlightMode, Telemetry

    flying, system = connected("px4", speed=4.0)
    telemetry, action, follow = Telemetry(system), Action(system), FollowMe(system)
    tools.wait_until(telemetry.health_all_ok, what="health all ok")
    config = follow.get_config()
    config.follow_height_m, config.follow_distance_m, config.follow_angle_deg = 12.0, 10.0, 90.0
    config.responsiveness, config.max_tangential_vel_m_s = 0.2, 4.0
    follow.set_config(config)
    stored = flying.vehicle.pilot.parameters.stored
    assert (stored["FLW_TGT_HT"], stored["FLW_TGT_DST"]) == (12.0, 10.0)
    action.arm()
    action.takeoff()
    tools.wait_until(lambda: flying.vehicle.pilot.mode.value == "hold", what="the take-off")
    follow.start()
    tools.wait_until(follow.is_active, what="the mode Follow me")
    tools.wait_until(lambda: telemetry.flight_mode() == FlightMode.FOLLOW_ME, what="the mode in telemetry")
    frame = flying.vehicle.pilot.frame

    def near():
        latitude, longitude = frame.to_wgs84(40.0, 30.0)
        follow.set_target_location(TargetLocation(latitude, longitude, frame.altitude_m, 0.0, 0.0, 0.0))
        time.sleep(0.1)
        x, y, z = flying.vehicle.pilot.state.position_m
        return math.hypot(x - 40.0, y - 30.0) < 12.0 and z > 11.0

    tools.wait_until(near, what="the vehicle beside the target")
    follow.stop()
    tools.wait_until(lambda: flying.vehicle.pilot.mode.value == "hold", what="the hold mode")


def test_offboard_attitudes_fly_in_the_order_of_the_example(connected, tools):
    import time

    from mavsdk.plugins.action import Action
    from mavsdk.plugins.offboard import Attitude, Offboard
    from mavsdk.plugins.telemetry import Telemetry

    # MAVSDK repeats a setpoint every 50 ms of real time; PX4 leaves offboard mode after 1 s of its own.
    flying, system = connected("px4", speed=2.0)
    telemetry, action, offboard = Telemetry(system), Action(system), Offboard(system)
    tools.wait_until(telemetry.health_all_ok, what="health all ok")
    action.arm()
    offboard.set_attitude(Attitude(0.0, 0.0, 0.0, 0.0))
    offboard.start()
    offboard.set_attitude(Attitude(0.0, 0.0, 0.0, 0.7))
    tools.wait_until(lambda: flying.vehicle.pilot.state.position_m[2] > 2.0, what="the climb")
    offboard.set_attitude(Attitude(30.0, 0.0, 0.0, 0.6))
    tools.wait_until(lambda: flying.vehicle.pilot.state.roll_rad > 0.3, what="the roll")
    offboard.set_attitude(Attitude(-30.0, 0.0, 0.0, 0.6))
    tools.wait_until(lambda: flying.vehicle.pilot.state.roll_rad < -0.3, what="the roll back")
    offboard.set_attitude(Attitude(0.0, 0.0, 0.0, 0.6))
    time.sleep(0.2)
    assert offboard.is_active()
    offboard.stop()
    tools.wait_until(lambda: flying.vehicle.pilot.mode.value == "hold", what="the hold mode")
