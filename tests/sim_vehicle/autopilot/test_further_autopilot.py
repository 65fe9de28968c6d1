"""A third autopilot in a package of its own: it flies, and is listed, without any change elsewhere."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from mission_items import item
from packages import command_lines, importable, install

from mission import autopilots
from mission.autopilots.profile import Meaning
from mission.ground.modes import Maneuver, ModeError, VehicleModes, is_in_mission, mode_name
from mission.ground.station import GroundStation
from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint, Mission, MissionItem
from mission.outcome import Outcome
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import autopilot_names, forget_autopilots, get_autopilot, with_autopilot
from sim_vehicle.errors import VehicleError
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink import SimVehicle
from wbf_mission.addons.base.inquiry import VehicleSnapshot

POINT = GeoPoint(28.05, -82.15, 12.0)
ENTRY_POINTS = """\
[wbf_mission.autopilots]
nimbus = nimbus:NIMBUS

[wbf_mission.transfer_profiles]
nimbus = nimbus:PROFILE
"""


def forget():
    forget_autopilots()
    autopilots._profiles.cache_clear()


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder of installed packages with the third autopilot's."""
    folder = tmp_path_factory.mktemp("site")
    shutil.copy(Path(__file__).parent / "further" / "nimbus.py", folder)
    install(folder, "nimbus", ENTRY_POINTS)
    return folder


@pytest.fixture
def nimbus(site, monkeypatch):
    monkeypatch.syspath_prepend(str(site))
    forget()
    yield get_autopilot("nimbus")
    monkeypatch.undo()
    sys.modules.pop("nimbus", None)
    forget()


MISSION = Mission(
    (item(22, 0.0, 0.0, 12.0), item(16, 40.0, 0.0, 12.0), item(16, 40.0, 30.0, 12.0), MissionItem(20, 2)),
    POINT,
)


def test_its_name_is_known_and_others_are_refused(nimbus):
    assert autopilot_names() == ("px4", "ardupilot", "nimbus")
    assert get_autopilot(" Nimbus ") is nimbus
    with pytest.raises(VehicleError, match="unknown autopilot 'cumulus': choose px4, ardupilot, nimbus"):
        get_autopilot("cumulus")
    with pytest.raises(VehicleError, match="nimbus flies no rover: choose a vehicle of kind multirotor"):
        with_autopilot(get_vehicle("rover"), "nimbus")
    with pytest.raises(VehicleError, match="nimbus flies no fixed-wing"):
        SimVehicle(get_vehicle("fixed-wing"), POINT, autopilot=nimbus)


def test_it_flies_a_mission_over_mavlink(nimbus):
    spec = with_autopilot(get_vehicle("quad"), "nimbus", {"NIM_SPEED": 5.0})
    vehicle = SimVehicle(spec, POINT, autopilot=nimbus)
    ground = GroundStation(MISSION)
    codec, heard = m.MAVLink(None), []

    def tap(frame, now_s):
        message = codec.parse_char(frame)
        if message is not None:
            heard.append(message)

    Simulation([vehicle, ground], tap=tap).run(lambda _now: ground.done, limit_s=600.0)
    assert ground.outcome is Outcome.COMPLETED, ground.outcome_text
    own = [message for message in heard if message.get_srcSystem() == 1]
    beats = [message for message in own if message.get_type() == "HEARTBEAT"]
    assert {beat.autopilot for beat in beats} == {m.MAV_AUTOPILOT_REFLEX}
    # It boots in its position mode, flies the mission in its mission mode.
    assert beats[0].custom_mode == 72
    assert {72, 75} <= {beat.custom_mode for beat in beats} <= set(range(70, 79))
    # Its own rules speak, and home is item 0 of its missions.
    counts = [message.count for message in heard if message.get_type() == "MISSION_COUNT"]
    assert set(counts) == {len(MISSION.items) + 1}
    speeds = [message.groundspeed for message in own if message.get_type() == "VFR_HUD"]
    assert 4.5 < max(speeds) < 5.5


def test_a_ground_station_knows_its_modes_and_parameters(nimbus):
    reflex = m.MAV_AUTOPILOT_REFLEX
    beats = [m.MAVLink_heartbeat_message(2, reflex, 129, mode, 4, 3) for mode in (75, 99, 72)]
    assert [mode_name(one) for one in beats] == ["SURVEY", "Mode(99)", "STAY"]
    assert [is_in_mission(one) for one in beats] == [True, False, False]
    modes = VehicleModes(reflex, 2)
    assert modes.maneuver(Maneuver.HOLD) == (m.MAV_CMD_DO_SET_MODE, (1.0, 72.0, 0.0))
    with pytest.raises(ModeError, match="unknown mode 'auto': choose STAY, SURVEY"):
        modes.numbers("auto")
    answers = VehicleSnapshot(1, reflex, 2, parameters={"NIM_LINK_ACT": 1.0})
    assert answers.told(Meaning.LINK_LOST) == ("NIM_LINK_ACT", 1.0)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("nowhere_at_all:X", "cannot be loaded"),
        ("nimbus:PROFILE", "is not a sim_vehicle.autopilot.Autopilot"),
        ("sim_vehicle.autopilot.px4:PX4", "calls itself px4"),
    ],
)
def test_a_broken_package_is_told_in_one_line(site, tmp_path, monkeypatch, value, text):
    install(tmp_path, "broken", f"[wbf_mission.autopilots]\nbroken = {value}\n")
    shutil.copy(site / "nimbus.py", tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    forget()
    try:
        with pytest.raises(VehicleError, match=text) as caught:
            get_autopilot("broken")
        assert "\n" not in str(caught.value)
        assert "broken" in str(caught.value)
    finally:
        monkeypatch.undo()
        sys.modules.pop("nimbus", None)
        forget()


def test_the_command_line_lists_and_flies_it(site):
    fly = (
        "fly --autopilot nimbus --param NIM_SPEED=6 --farm miniberry-10 --planner lawnmower --estimator point"
    )
    codes, (told,), printed, errors = command_lines(
        site, "fly --help", "fly --autopilot cumulus", f"{fly} --no-files --no-plots --json"
    )
    assert codes == [0, 2, 0], errors
    assert "px4 or ardupilot or nimbus" in " ".join(printed.split())
    assert "px4, ardupilot, nimbus" in errors
    assert told["outcome"] == "completed"


def test_a_shell_completes_it(site):
    words = {"COMP_WORDS": "wbf-mission fly --autopilot n", "COMP_CWORD": "3"}
    completed = subprocess.run(
        [sys.executable, "-m", "wbf_mission"],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": importable(site), "_WBF_MISSION_COMPLETE": "complete_bash", **words},
        check=False,
    )
    assert completed.stdout.split() == ["nimbus"]
