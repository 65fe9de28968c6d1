"""Asking a vehicle: sans-IO with loss, delay and hostile answers; and our simulator over real sockets."""

import random
import struct

import pytest
from preflight_plans import HOME
from stand_in import stand_in

from mission.autopilots import profile_for
from mission.link.codec.dialect import mavlink as m
from mission.transfer.events import NoVehicleError
from wbf_mission.addons.base.inquiry import Inquiry, ask_vehicle, decoded

PX4, ARDUPILOT = 12, 3


def packed(message, system=1, component=1):
    message.pack(m.MAVLink(None, system, component))
    return message


def beat(autopilot=PX4, kind=2, system=1, component=1):
    return packed(m.MAVLink_heartbeat_message(kind, autopilot, 1, 0, 3, 3), system, component)


class Answering:
    """A vehicle that answers parameters and messages."""

    def __init__(self, autopilot=PX4, parameters=None, *, ready=True):
        self.autopilot = autopilot
        asked = profile_for(autopilot).settings
        names = [list(one)[-1] for one in (*asked.asked_of(2).values(), *asked.motion_of(2).values())]
        self.parameters = dict.fromkeys(names, 7.0) if parameters is None else parameters
        self.asked = []
        self.ready = ready

    def answer(self, message):
        if isinstance(message, m.MAVLink_param_request_read_message):
            name = str(message.param_id)
            self.asked.append(name)
            if name in self.parameters:
                value = m.MAVLink_param_value_message(name.encode(), self.parameters[name], 9, 1, 0)
                return [packed(value)]
        if isinstance(message, m.MAVLink_command_long_message):
            if message.command == m.MAV_CMD_RUN_PREARM_CHECKS and not self.ready:
                return [packed(m.MAVLink_statustext_message(4, b"PreArm: GPS 1: Bad fix"))]
            if message.command == m.MAV_CMD_REQUEST_MESSAGE:
                self.asked.append(int(message.param1))
                return [packed(one) for one in self.told(int(message.param1))]
        return []

    def told(self, number):
        bits = 0x1000002F
        health = bits if self.ready else 0x0F
        latitude, longitude = round(HOME.latitude_deg * 1e7), round(HOME.longitude_deg * 1e7)
        messages = {
            148: m.MAVLink_autopilot_version_message(
                0, 0x010F04FF, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0
            ),
            1: m.MAVLink_sys_status_message(bits, bits, health, 0, 0, 0, 55, 0, 0, 0, 0, 0, 0),
            24: m.MAVLink_gps_raw_int_message(0, 3, 0, 0, 0, 80, 65535, 0, 0, 255),
            33: m.MAVLink_global_position_int_message(0, latitude, longitude, 20_000, 0, 0, 0, 0, 0),
            147: m.MAVLink_battery_status_message(0, 0, 0, 0, [0] * 10, 0, 0, 0, 91),
            230: m.MAVLink_estimator_status_message(0, 831, 0, 0, 0, 0, 0, 0, 0, 0),
            193: m.MAVLink_ekf_status_report_message(831, 0, 0, 0, 0, 0),
        }
        return [messages[number]] if number in messages else []


def converse(vehicle, *, delay_s=0.01, loss=0.0, limit_s=60.0, inquiry=None):
    """Let time pass until the inquiry is done; returns it and how long it took."""
    chance = random.Random(3)
    inquiry = inquiry or Inquiry()
    now_s, next_beat_s = 0.0, 0.0
    on_the_way = []
    while not inquiry.done:
        assert now_s < limit_s
        if now_s >= next_beat_s:
            next_beat_s += 1.0
            on_the_way.append((now_s + delay_s, beat(vehicle.autopilot)))
        out = inquiry.poll(now_s)
        for due_s, message in [one for one in on_the_way if one[0] <= now_s]:
            on_the_way.remove((due_s, message))
            out = [*out, *inquiry.receive(message, now_s)]
        for message in out:
            if chance.random() >= loss:
                answers = [one for one in vehicle.answer(message) if chance.random() >= loss]
                on_the_way += [(now_s + 2.0 * delay_s, one) for one in answers]
        now_s += 0.01
    return inquiry.snapshot(), now_s


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_everything_is_asked_and_noted(autopilot):
    vehicle = Answering(autopilot)
    answers, took_s = converse(vehicle)
    assert dict(answers.parameters) == vehicle.parameters
    assert str(answers.version) == "1.15.4"
    assert (answers.gps.fix, answers.gps.satellites, answers.gps.hdop) == (3, None, 0.8)
    assert answers.estimator_flags == 831
    assert answers.battery == 0.91
    assert answers.position == HOME
    assert answers.reasons == ()
    assert took_s < 3.0
    assert vehicle.asked.count("WP_SPD" if autopilot == ARDUPILOT else "NAV_ACC_RAD") == 1


def test_a_parameter_that_it_does_not_have_is_given_up():
    names = {name: 1.0 for names in profile_for(PX4).settings.asked_of(2).values() for name in names}
    del names["MIS_TKO_LAND_REQ"]
    vehicle = Answering(PX4, names)
    answers, took_s = converse(vehicle)
    assert "MIS_TKO_LAND_REQ" not in answers.parameters
    assert 2 <= vehicle.asked.count("MIS_TKO_LAND_REQ") <= 5
    assert took_s < 5.0


def test_a_link_of_two_seconds_is_not_flooded():
    vehicle = Answering(ARDUPILOT)
    answers, took_s = converse(vehicle, delay_s=2.0)
    assert dict(answers.parameters) == vehicle.parameters
    assert max(vehicle.asked.count(one) for one in set(vehicle.asked)) <= 6
    assert took_s < 40.0


def test_one_that_never_answers_ends_too():
    class Silent(Answering):
        def answer(self, message):
            return []

    answers, took_s = converse(Silent())
    assert (answers.parameters, answers.version, answers.battery) == ({}, None, None)
    assert took_s < 12.0


def test_why_it_would_not_arm_is_waited_for():
    answers, _ = converse(Answering(ARDUPILOT, ready=False))
    assert answers.reasons == ("GPS 1: Bad fix",)


def test_only_the_wanted_vehicle_is_asked():
    inquiry = Inquiry(system_id=2)
    assert inquiry.receive(beat(system=1), 0.0) == []
    assert inquiry.receive(packed(m.MAVLink_heartbeat_message(6, 8, 0, 0, 3, 3), 2, 190), 0.0) == []
    assert inquiry.vehicle is None, "a ground station is none"
    asked = inquiry.receive(beat(system=2), 0.0)
    assert {one.target_system for one in asked} == {2}


def test_what_others_say_is_not_believed():
    inquiry = Inquiry()
    inquiry.receive(beat(), 0.0)
    inquiry.receive(packed(m.MAVLink_param_value_message(b"NAV_ACC_RAD", 9.0, 9, 1, 0), 7, 1), 0.1)
    inquiry.receive(packed(m.MAVLink_param_value_message(b"EVIL", 9.0, 9, 1, 0)), 0.1)
    inquiry.receive(packed(m.MAVLink_param_value_message(b"NAV_ACC_RAD", float("nan"), 9, 1, 0)), 0.1)
    inquiry.receive(packed(m.MAVLink_global_position_int_message(0, 2**31 - 1, 5, 0, 0, 0, 0, 0, 0)), 0.1)
    answers = inquiry.snapshot()
    assert (answers.parameters, answers.position) == ({}, None)


@pytest.mark.parametrize(("kind", "code", "value"), [(6, "<i", -3), (5, "<I", 70_000), (2, "<b3x", -2)])
def test_integers_as_the_bytes_of_the_float(kind, code, value):
    wire = struct.unpack("<f", struct.pack(code, value))[0]
    assert decoded(wire, kind, bytewise=True) == value
    assert decoded(float(value), kind, bytewise=False) == value


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_our_simulator_over_a_socket(autopilot):
    with stand_in(autopilot, speed=4.0) as (url, made):
        answers = ask_vehicle(url)
        pilot = made.vehicle.pilot
    radius = {"px4": ("NAV_ACC_RAD", 1.0), "ardupilot": ("WPNAV_RADIUS", 100.0)}[autopilot]
    assert answers.parameters[radius[0]] == pytest.approx(radius[1] * pilot.executor.spec.acceptance_radius_m)
    low = {"px4": "COM_LOW_BAT_ACT", "ardupilot": "BATT_FS_LOW_ACT"}[autopilot]
    assert answers.parameters[low] == float(int(answers.parameters[low]))
    assert answers.battery == 1.0
    assert answers.gps.fix >= 3
    assert answers.version is not None
    assert answers.position.latitude_deg == pytest.approx(28.05, abs=0.1)
    assert not answers.armed


def test_nobody_there():
    with pytest.raises(NoVehicleError, match="no vehicle with system id 9 was heard"):
        ask_vehicle("udpin:127.0.0.1:0", wait_s=0.2, system_id=9)
