"""MAVSDK before the simulated PX4, beyond its examples: actuators, origin, failures, a UDP server."""

import pytest


def test_actuators_and_the_origin_are_taken_and_failures_get_no_answer(connected):
    from mavsdk.plugins.action import Action
    from mavsdk.plugins.failure import Failure, FailureError, FailureType, FailureUnit

    flying, system = connected("px4")
    action = Action(system)
    action.set_actuator(1, 0.5)
    home = flying.home
    action.set_gps_global_origin(home.latitude_deg, home.longitude_deg, home.altitude_m)
    with pytest.raises(FailureError) as error:
        Failure(system).inject(FailureUnit.SENSOR_GYRO, FailureType.OFF, 0)
    assert error.value.result.name == "TIMEOUT"


def test_a_server_at_a_udp_port_is_called(fly, mavsdk_system, tools):
    from mavsdk.plugins.mission_raw import MissionRaw

    flying = fly("px4", ("udpin:127.0.0.1:0",))
    mission = MissionRaw(mavsdk_system(f"udpout://127.0.0.1:{tools.port_of(flying.urls[0])}"))
    sent = tools.raw_items(flying.mission)
    mission.upload_mission(sent)
    back = mission.download_mission()
    assert [(i.command, i.x, i.y) for i in back] == [(i.command, i.x, i.y) for i in sent]
