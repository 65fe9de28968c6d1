"""The full parameter lists: names, types, what is kept, values beyond the vehicle, the pace of a list."""

import math
import struct
from pathlib import Path

import pytest

from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import get_autopilot
from sim_vehicle.mavlink.vehicle import SimVehicle

HOME = GeoPoint(28.05, -82.15, 10.0)
FIRMWARES = [(name, kind) for name in ("px4", "ardupilot") for kind in ("multirotor", "fixed-wing", "rover")]
VEHICLES = {"multirotor": "quad", "fixed-wing": "fixed-wing", "rover": "rover"}


def vehicle_of(name, kind="multirotor"):
    return SimVehicle(get_vehicle(VEHICLES[kind]), HOME, autopilot=get_autopilot(name))


def set_to(vehicle, name, value, kind=9):
    answers = vehicle.receive(m.MAVLink_param_set_message(1, 1, name.encode(), value, kind), 0.0)
    (told,) = [answer for answer in answers if answer.get_type() == "PARAM_VALUE"]
    return told.param_value, [a.text for a in answers if a.get_type() == "STATUSTEXT"]


@pytest.mark.parametrize(("name", "kind"), FIRMWARES)
def test_the_list_has_every_name_of_the_real_autopilot(name, kind):
    firmware = get_autopilot(name).for_vehicle(kind)
    table = firmware.parameters(get_vehicle(VEHICLES[kind]), 1)
    names = [parameter.name for parameter in table]
    assert names == sorted(set(names))
    assert all(0 < len(text) <= 16 and text.isascii() for text in names)
    least = {"px4": 870, "ardupilot": 1349} if kind == "multirotor" else {"px4": 740, "ardupilot": 1300}
    assert len(names) >= least[name]
    known = {
        "px4": {"MAV_SYS_ID", "EKF2_BARO_NOISE", "COM_ARM_WO_GPS", "RC1_MIN", "SYS_HITL"},
        "ardupilot": {
            "MAV_SYSID",
            "ARMING_RUDDER",
            "EK3_ENABLE",
            "FENCE_RADIUS",
            "INS_GYR_CAL",
            "SIM_WIND_T",
        },
    }[name]
    assert known <= set(names)
    for parameter in table:
        assert math.isfinite(parameter.value)
        if parameter.integer:
            assert parameter.bits in (8, 16, 32)
            assert parameter.stored is False or abs(parameter.value) < 2 ** (parameter.bits - 1)
        on_the_wire = struct.unpack("<f", struct.pack("<f", parameter.value))[0]
        assert on_the_wire == pytest.approx(parameter.value, rel=1e-6)


def test_what_does_nothing_here_is_kept_through_a_reboot():
    vehicle = vehicle_of("ardupilot")
    assert set_to(vehicle, "ARMING_RUDDER", 1.0, 2) == (1.0, [])
    assert set_to(vehicle, "ATC_RAT_RLL_P", 0.25)[0] == 0.25
    vehicle.reboot()
    answers = vehicle.receive(m.MAVLink_param_request_read_message(1, 1, b"ARMING_RUDDER", -1), 1.0)
    assert answers[0].param_value == 1.0


def test_a_kept_integer_is_whole_and_fits_its_type():
    vehicle = vehicle_of("ardupilot")
    before = set_to(vehicle, "ARMING_RUDDER", 2.0, 2)[0]
    told, texts = set_to(vehicle, "ARMING_RUDDER", 300.0, 2)
    assert told == before == 2.0
    assert texts == ["ARMING_RUDDER must be -128 to 127"]
    assert set_to(vehicle, "ARMING_RUDDER", 1.4, 2)[0] == 1.0
    with pytest.raises(ValueError):  # no PARAM_VALUE
        set_to(vehicle, "ARMING_RUDDER", math.nan, 2)
    assert vehicle.pilot.parameters.kept("ARMING_RUDDER", 0.0) == 1.0


@pytest.mark.parametrize(
    "name", ["ARMING_RUDDER", "FS_GCS_ENABLE", "WP_YAW_BEHAVIOR", "LAND_SPEED", "RTL_ALT"]
)
@pytest.mark.parametrize(("fraction", "extra"), [(0.6, 0.0), (0.4, 0.0), (0.995, 1.0)])
def test_ardupilot_drops_the_fraction_of_an_integer(name, fraction, extra):
    vehicle = vehicle_of("ardupilot")
    whole = {"LAND_SPEED": 60.0, "RTL_ALT": 1000.0}.get(name, 1.0)
    assert set_to(vehicle, name, whole + fraction) == (whole + extra, [])


def test_the_conformance_table_has_the_number_of_parameters():
    table = (Path(__file__).parents[3] / "docs/conformance.csv").read_text(encoding="utf-8")
    px4, _, _, copter, plane, rover = (
        len(get_autopilot(name).for_vehicle(kind).parameters(get_vehicle(VEHICLES[kind]), 1))
        for name, kind in FIRMWARES
    )
    assert f"{px4} on a multirotor" in table
    assert f"{copter}, {plane} and {rover} on copter, plane, rover" in table


@pytest.mark.parametrize(("name", "speed"), [("px4", "MPC_XY_CRUISE"), ("ardupilot", "WPNAV_SPEED")])
def test_a_value_beyond_the_vehicle_is_kept_and_the_nearest_holds(name, speed):
    vehicle = vehicle_of(name)
    told, texts = set_to(vehicle, speed, 1e6)
    assert told == 1e6
    assert vehicle.pilot.spec.cruise_speed_m_s == pytest.approx(vehicle.pilot.spec.top_speed_m_s)
    assert len(texts) == 1 and texts[0].startswith(f"{speed} 1e+06 is stored, ")
    scale = 100.0 if name == "ardupilot" else 1.0
    assert set_to(vehicle, speed, 4.0 * scale) == (4.0 * scale, [])
    assert vehicle.pilot.spec.cruise_speed_m_s == pytest.approx(4.0)


def test_a_choice_that_there_is_not_is_refused():
    vehicle = vehicle_of("px4")
    told, texts = set_to(vehicle, "GF_ACTION", struct.unpack("<f", struct.pack("<i", 77))[0], 6)
    assert struct.unpack("<i", struct.pack("<f", told))[0] != 77
    assert texts == ["GF_ACTION must be 0 to 5"]


def test_a_list_comes_in_parts_and_a_second_request_begins_it_anew():
    vehicle = vehicle_of("ardupilot")
    ask = m.MAVLink_param_request_list_message(1, 1)

    def indices(messages):
        return [message.param_index for message in messages if message.get_type() == "PARAM_VALUE"]

    first = indices(vehicle.receive(ask, 0.0))
    assert first == list(range(25))
    assert vehicle.next_deadline() <= 0.02
    second = indices(vehicle.poll(0.02))
    assert second == list(range(25, 50))
    assert indices(vehicle.receive(ask, 0.03)) == first
    rest = []
    for tick in range(1, 200):
        rest += indices(vehicle.poll(0.03 + 0.02 * tick))
    count = len(vehicle.firmware.parameters(vehicle.pilot.spec, 1))
    assert rest == list(range(25, count))
