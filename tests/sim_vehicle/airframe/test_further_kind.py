"""A kind of vehicle in a package of its own: it is listed, flies, uses energy, with no change elsewhere."""

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from packages import command_lines, install

from mission.transfer.vehicles import Vehicle
from sim_vehicle.airframe.catalog import forget_vehicles, get_vehicle, vehicle_names
from sim_vehicle.airframe.kind import get_kind, kind_names
from sim_vehicle.autopilot import (
    adapt_vehicle,
    flight_procedures,
    forget_autopilots,
    get_autopilot,
    with_autopilot,
)
from sim_vehicle.errors import VehicleError
from wbf_mission.addons.base.links import typical_vehicle

ENTRY_POINTS = """\
[wbf_mission.vehicle_kinds]
boat = skiff:BOAT

[wbf_mission.autopilots]
tide = skiff:TIDE
"""
FILE = """\
kind = "boat"
cruise_speed_m_s = 1.2
[power]
mass_kg = 25.0
[airframe]
turn_lengths = 2.0
"""


def forget():
    for name in [name for name in sys.modules if name.partition(".")[0] == "skiff"]:
        del sys.modules[name]
    forget_vehicles()
    forget_autopilots()


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder of installed packages with that of the boats."""
    folder = tmp_path_factory.mktemp("site")
    shutil.copytree(Path(__file__).parent / "further" / "skiff", folder / "skiff")
    install(folder, "skiff", ENTRY_POINTS)
    (folder / "mine.toml").write_text(FILE)
    return folder


@pytest.fixture
def boat(site, monkeypatch):
    """The specification of a vehicle file of that kind."""
    monkeypatch.syspath_prepend(str(site))
    forget()
    yield get_vehicle(str(site / "mine.toml"))
    monkeypatch.undo()
    forget()


def test_its_vehicles_are_known_and_its_files_are_read(boat, tmp_path):
    assert kind_names() == ("multirotor", "ideal", "boat", "fixed-wing", "rover")
    assert "skiff" in vehicle_names() and vehicle_names()[-1] == "ideal"
    assert (boat.drives, boat.hovers, boat.circles, boat.is_ideal) == (True, False, False, False)
    assert (boat.power.mass_kg, boat.power.drag_area_m2) == (25.0, 16.0)
    assert (boat.airframe.length_m, boat.airframe.turn_lengths) == (1.2, 2.0)
    assert boat.acceptance_radius_m == get_vehicle("skiff").acceptance_radius_m == 2.0
    path = tmp_path / "x.toml"
    for text, reason in [
        ('kind = "raft"', "kind 'raft' is not one of multirotor, ideal, boat, fixed-wing, rover$"),
        ('kind = "boat"\n[airframe]\nthrust_n = 1', r"\[airframe\]: unknown key 'thrust_n'"),
        ('kind = "boat"\n[airframe]\nlength_m = "long"', "length_m 'long' has the wrong type"),
        ('kind = "boat"\nbase = "rover"', "kind boat does not fit base rover, which is a rover"),
        ('kind = "rover"\n[airframe]\nlength_m = 1.0', r"a vehicle of kind rover has no \[airframe\]"),
        ('kind = "boat"\n[power]\nmass_kg = -1', "mass_kg -1 is not a positive number"),
    ]:
        path.write_text(text)
        with pytest.raises(VehicleError, match=reason):
            get_vehicle(str(path))


def test_autopilots_fly_it_or_show_it(boat):
    # PX4 has no firmware for boats: they move by the procedures of their kind, and are shown as rovers.
    shown = with_autopilot(boat, "px4")
    assert shown.autopilot == "generic"
    assert adapt_vehicle(shown, get_autopilot("px4")) is shown
    assert get_autopilot("px4").for_vehicle("boat").title == "PX4"
    assert flight_procedures(shown).limits(shown).turn_radius == pytest.approx(2.4)
    with pytest.raises(VehicleError, match="has no parameter RO_YAW_P"):
        with_autopilot(boat, "px4", {"RO_YAW_P": 2.0})
    # Another has one.
    flown = with_autopilot(boat, "tide")
    assert (flown.autopilot, flown.cruise_speed_m_s) == ("tide", 2.0)
    with pytest.raises(VehicleError, match="tide flies no rover: choose a vehicle of kind boat"):
        with_autopilot(get_vehicle("rover"), "tide")


@pytest.mark.parametrize(
    ("firmware", "text"),
    [
        ("nowhere_at_all:X", "of kind rover cannot be loaded"),
        ("sim_vehicle.errors:VehicleError", "of kind rover is no Firmware"),
    ],
)
def test_a_firmware_that_a_kind_cannot_give_is_refused(monkeypatch, firmware, text):
    broken = replace(get_kind("rover"), firmwares={"px4": firmware})
    monkeypatch.setattr("sim_vehicle.autopilot.get_kind", lambda name: broken)
    with pytest.raises(VehicleError, match=f"{firmware} {text}"):
        get_autopilot("px4").for_vehicle("rover")


def test_a_heartbeat_of_it_is_known(boat):
    assert typical_vehicle(Vehicle(1, 1, 3, 11)) == "skiff"
    assert typical_vehicle(Vehicle(1, 1, 3, 10)) == "rover"
    assert typical_vehicle(Vehicle(1, 1, 3, 13)) == "quad"


def test_without_its_package_it_is_unknown(site):
    with pytest.raises(VehicleError, match=r"is not one of multirotor, ideal, fixed-wing, rover$"):
        get_vehicle(str(site / "mine.toml"))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("nowhere_at_all:X", "cannot be loaded"),
        ("skiff:BOAT", "is not a sim_vehicle.airframe.kind.VehicleKind of this name"),
    ],
)
def test_a_broken_package_is_told_in_one_line(boat, tmp_path, monkeypatch, value, text):
    install(tmp_path, "broken", f"[wbf_mission.vehicle_kinds]\nbroken = {value}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(VehicleError, match=rf"vehicle kind broken \({value}\) {text}") as told:
        get_kind("broken")
    assert "\n" not in str(told.value)


def test_the_command_line_lists_and_flies_it(site):
    file = site / "mine.toml"
    fly = f"fly --vehicle {file} --farm miniberry-10 --planner lawnmower --budget 40s --estimator point"
    codes, (listed, *flights), printed, errors = command_lines(
        site,
        "vehicle list --json",
        f"vehicle show {file}",
        *(f"{fly} --autopilot {name} --no-files --no-plots --json" for name in ("px4", "tide")),
    )
    assert codes == [0] * 4, errors
    assert [one["kind"] for one in listed if one["name"] == "skiff"] == ["boat"]
    assert "boat" in printed and "25 kg" in printed
    for told in flights:
        assert told["outcome"] == "completed"
        assert told["observations"] > 10
        assert 0.001 < told["battery_used"] == pytest.approx(told["predicted_battery_used"], rel=0.1)
    assert flights[0] != flights[1]
