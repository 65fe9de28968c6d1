import math
import subprocess
import sys

import pytest
from bad_files import complaint

from sim_vehicle.airframe.catalog import get_vehicle, vehicle_names
from sim_vehicle.airframe.power_spec import BatterySpec, PowerSpec
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.errors import VehicleError
from wbf_mission.addons.rovers.kind import RoverPowerSpec
from wbf_mission.addons.wings.kind import FixedWingPowerSpec

ROTOR = {"mass_kg": 1.0, "disc_area_m2": 0.1, "tip_speed_m_s": 70.0}
WING = {"mass_kg": 2.0, "wing_area_m2": 0.4, "wing_span_m": 1.8}
PACK = {"capacity_wh": 10.0, "cells": 4}


def test_the_names_and_the_vehicles():
    names = vehicle_names()
    assert (names[0], names[-1]) == ("quad", "ideal")
    assert {"mini-quad", "rover", "wing"} < set(names)
    assert get_vehicle("QUAD").name == "quad"
    ideal = get_vehicle("ideal")
    assert ideal.is_ideal
    assert ideal.battery is None
    assert ideal.cell_m == pytest.approx(0.3048)
    assert ideal.step_s == 1.0
    assert ideal.top_speed_m_s == pytest.approx(0.3048)


@pytest.mark.parametrize("name", ["", "../quad"])
def test_an_unknown_vehicle_names_the_known_ones(name):
    with pytest.raises(VehicleError, match=r"choose quad, .*mini-quad, .*ideal, or give a file"):
        get_vehicle(name)


@pytest.mark.parametrize(
    ("kind", "values", "reason"),
    [
        (BatterySpec, {"capacity_wh": 0.0, "cells": 4}, "capacity_wh"),
        (BatterySpec, {"capacity_wh": math.inf, "cells": 4}, "battery: "),
        (BatterySpec, {**PACK, "reserve_fraction": 0.1, "critical_fraction": 0.2}, "ascending order"),
        (BatterySpec, {**PACK, "reserve_fraction": math.nan}, "battery: "),
        (BatterySpec, {**PACK, "reserve_fraction": 1.0}, "battery: "),
        (BatterySpec, {**PACK, "resistance_ohm": -1.0}, "resistance"),
        (BatterySpec, {**PACK, "polarization_ohm": math.nan}, "battery: "),
        (BatterySpec, {**PACK, "relaxation_s": 0.0}, "battery: "),
        (BatterySpec, {**PACK, "cells": 0}, "battery: "),
        (BatterySpec, {**PACK, "cells": 3.5}, "battery: "),
        (BatterySpec, {**PACK, "full_cell_v": 3.7}, "battery: "),
        (BatterySpec, {**PACK, "empty_cell_v": 3.9}, "battery: "),
        (BatterySpec, {**PACK, "full_cell_v": 9.0}, "battery: "),
        (PowerSpec, {**ROTOR, "efficiency": 1.2}, "efficiency"),
        (FixedWingPowerSpec, {**WING, "camera_w": -1.0}, "power: "),
        (FixedWingPowerSpec, {**WING, "idle_w": math.nan}, "power: "),
        (FixedWingPowerSpec, {**WING, "oswald": 0.0}, "power: "),
        (FixedWingPowerSpec, {**WING, "wing_area_m2": "1"}, "power: "),
        (VehicleSpec, {"name": "x", "acceleration_m_s2": -1.0}, "acceleration_m_s2"),
        (VehicleSpec, {"name": "x", "jerk_m_s3": True}, "jerk"),
        (VehicleSpec, {"name": "x", "battery": BatterySpec(10.0, 4)}, "power"),
        (VehicleSpec, {"name": "x", "kind": "fixed-wing", "power": PowerSpec(**ROTOR)}, "kind fixed-wing"),
        (VehicleSpec, {"name": "x", "kind": "ideal", "power": PowerSpec(**ROTOR)}, "kind ideal"),
    ],
)
def test_impossible_batteries_are_refused(kind, values, reason):
    with pytest.raises(VehicleError, match=reason):
        kind(**values)


@pytest.mark.parametrize(
    "values",
    [
        {"cells": 0},
        {"cells": 3.5},
        {"cells": True},
        {"relaxation_s": 0.0},
        {"polarization_ohm": -0.1},
        {"polarization_ohm": math.nan},
        {"full_cell_v": 3.7},
        {"empty_cell_v": 3.9},
        {"full_cell_v": 9.0},
        {"capacity_wh": math.inf},
        {"reserve_fraction": 1.0},
        {"reserve_fraction": math.nan},
    ],
)
def test_impossible_values_of_a_battery(values):
    with pytest.raises(VehicleError, match=r"battery: "):
        BatterySpec(**{"capacity_wh": 10.0, "cells": 4, **values})


@pytest.mark.parametrize(
    "values",
    [{"camera_w": -1.0}, {"idle_w": math.nan}, {"oswald": 0.0}, {"efficiency": 1.01}, {"wing_area_m2": "1"}],
)
def test_impossible_values_of_a_wing(values):
    with pytest.raises(VehicleError, match=r"power: "):
        FixedWingPowerSpec(**{"mass_kg": 2.0, "wing_area_m2": 0.4, "wing_span_m": 1.8, **values})


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("cruise = 5.0", "unknown key 'cruise'"),
        ("cruise_speed_m_s = -5.0", "not a positive number"),
        ("cruise_speed_m_s = 2e9", "not a positive number below 1e9"),
        ("cruise_speed_m_s = '5'", "wrong type"),
        ("base = 'boat'", "base must be one of"),
        ("base = 3", "base must be one of"),
        ("kind = 3", "kind 3"),
        ("battery = 5", "must be a table"),
        ("base = 'ideal'\n[battery]\ncells = 5", "capacity_wh"),
        ("[battery]\ncells = 4.5", "cells"),
        ("[battery]\ncapacity_wh = true", "wrong type"),
        ("not toml", "vehicle file"),
        ("kind = 'fixed-wing'\n[power]\ndisc_area_m2 = 1.0", "unknown key 'disc_area_m2'"),
        ("base = 'quad'\nkind = 'rover'", "kind rover does not fit base quad, which is a multirotor"),
        ("base = 'ideal'\n[battery]\ncells = 4\ncapacity_wh = 5", "a battery needs a power model"),
        ("base = 'ideal'\n[power]\nmass_kg = 1.0", "kind ideal has no [power]"),
        ("[published]\nendurance_min = 0", "endurance_min"),
        ("[published]\nused_fraction = 2\nendurance_min = 9", "used_fraction"),
        ("px4 = 5", "px4 must be a table"),
        ("[px4]\nmpc_acc = 1", "is not a parameter name"),
        ("[px4]\nMPC_ACC_HOR = '3'", "not a number"),
        ("[ardupilot]\nWPNAV_SPEED = 1e9", "not a number from -1e9 to 1e9"),
    ],
)
def test_bad_vehicle_files_say_what_is_wrong(tmp_path, text, reason):
    assert reason in complaint(lambda path: get_vehicle(str(path)), tmp_path, text, VehicleError)


def test_a_vehicle_file_that_is_no_text_is_refused(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(VehicleError, match=r"bad\.toml"):
        get_vehicle(str(path))


def test_a_file_is_based_on_the_vehicle_of_its_kind(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text("kind = 'fixed-wing'\n[power]\nmass_kg = 2.0\n")
    wing = get_vehicle(str(path))
    assert isinstance(wing.power, FixedWingPowerSpec)
    assert (wing.power.mass_kg, wing.power.wing_span_m) == (2.0, 2.35)
    assert wing.battery == get_vehicle("wing").battery
    # What the maker of the other vehicle tells is not told of this one.
    assert wing.published is None and wing.description == ""
    path.write_text("kind = 'rover'\n[power]\nrolling_resistance = 0.2\n")
    assert isinstance(get_vehicle(str(path)).power, RoverPowerSpec)


def test_an_ideal_flight_does_not_import_numba():
    code = (
        "import sys; from geo.frame import LocalFrame; from mission.model import MissionItem, Mission;"
        "from sim_vehicle.prediction.predict import predict_flight;"
        "from sim_vehicle.airframe.catalog import get_vehicle;"
        "up = MissionItem(22, 3, 0, 0, 0, None, 28.0, -82.0, 2.0);"
        "m = Mission((up, MissionItem.waypoint(28.0001, -82.0, 2.0)));"
        "p = predict_flight(m, get_vehicle('ideal'), frame=LocalFrame(28.0, -82.0));"
        "assert p.feasible, p; assert 'numba' not in sys.modules; assert 'scipy' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
