"""MAVSDK's gimbal plugin and pymavlink turn the gimbal of the simulated ArduPilot over a socket."""

import math

import pytest

from wbf_mission.addons.gimbal.extra import GimbalExtra


def gimbal_of(flying):
    return next(extra.gimbal for extra in flying.vehicle.extras if isinstance(extra, GimbalExtra))


def test_mavsdk_takes_control_turns_the_gimbal_and_follows_it(connected, tools):
    from mavsdk.plugins.gimbal import ControlMode, Gimbal, GimbalMode, SendMode

    flying, system = connected("ardupilot", camera=True, speed=4.0)
    tools.request_streams(flying)
    gimbal = Gimbal(system)
    found = tools.wait_until(lambda: gimbal.gimbal_list().gimbals, what="the gimbal")
    (number,) = (one.gimbal_id for one in found)
    attitudes = []
    gimbal.subscribe_attitude(lambda attitude, _: attitudes.append(attitude))
    gimbal.take_control(number, ControlMode.PRIMARY)
    tools.wait_until(
        lambda: gimbal.get_control_status(number).control_mode == ControlMode.PRIMARY, what="the control"
    )
    assert gimbal_of(flying).controller[0] == 245

    def looks(pitch, yaw):
        def there():
            angles = attitudes[-1].euler_angle_forward if attitudes else None
            wanted = (pitch, yaw)
            return angles and (angles.pitch_deg, angles.yaw_deg) == pytest.approx(wanted, abs=0.2)

        tools.wait_until(there, f"pitch {pitch}, yaw {yaw}")

    for send, mode, pitch, yaw in (
        (SendMode.ONCE, GimbalMode.YAW_FOLLOW, -30.0, 20.0),
        (SendMode.STREAM, GimbalMode.YAW_FOLLOW, -60.0, -40.0),
        (SendMode.ONCE, GimbalMode.YAW_LOCK, -15.0, 90.0),
    ):
        gimbal.set_angles(number, 0.0, pitch, yaw, mode, send)
        looks(pitch, yaw)
        assert gimbal_of(flying).locks_yaw == (mode == GimbalMode.YAW_LOCK)
    gimbal.set_angular_rates(number, 0.0, 10.0, 0.0, GimbalMode.YAW_FOLLOW, SendMode.ONCE)
    looks(20.0, 90.0)
    north = flying.place(0.0, 100.0)
    gimbal.set_roi_location(number, *north, flying.home.altitude_m)
    tools.wait_until(
        lambda: gimbal_of(flying).mode == 4 and abs(attitudes[-1].euler_angle_forward.yaw_deg) < 0.2,
        "the region of interest",
    )
    gimbal.release_control(number)
    tools.wait_until(
        lambda: gimbal.get_control_status(number).control_mode == ControlMode.NONE, what="the release"
    )


def test_pymavlink_turns_it_by_the_mount_messages(fly, tools):
    from pymavlink import mavutil

    flying = fly("ardupilot")
    link = mavutil.mavlink_connection(f"tcp:127.0.0.1:{tools.port_of(flying.urls[0])}", source_system=255)
    assert link.wait_heartbeat(timeout=20) is not None
    link.mav.command_long_send(1, 1, 511, 0, 158, 100_000, 0, 0, 0, 0, 0)
    link.mav.mount_configure_send(1, 1, 2, 1, 1, 1)
    link.mav.mount_control_send(1, 1, -4500, 0, 3000, 0)

    def told():
        status = link.recv_match(type="MOUNT_STATUS", blocking=True, timeout=10)
        return status and (status.pointing_a, status.pointing_b, status.pointing_c) == (-4500, 0, 3000)

    tools.wait_until(told, what="the angles")
    link.mav.command_long_send(1, 1, 205, 0, -10, 0, 0, 0, 0, 0, 2)
    ack = link.recv_match(
        type="COMMAND_ACK", condition="COMMAND_ACK.command == 205", blocking=True, timeout=10
    )
    assert ack.result == 0
    turned = math.radians(-10.0)
    tools.wait_until(lambda: gimbal_of(flying).angles_rad[1] == turned, what="the command")
    link.close()
