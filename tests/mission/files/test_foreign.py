"""Mission files of old programs, and files that are no missions."""

from pathlib import Path

import pytest

from mission.errors import MissionFileError
from mission.files import read_mission, waypoints
from mission.files.common import WithNotes
from mission.model import GeoPoint

FOREIGN = Path(__file__).parents[2] / "data" / "foreign"

# Version 120 of WPL, which QGroundControl wrote without a home.

HOME = "0 1 0 16 0 0 0 0 28.05 -82.15 30 1\n"
TAKEOFF = "1 0 3 22 0 0 0 0 0 0 10 1\n"
SPEED = "2 0 0 178 1 5 -1 0 0 0 0 1\n"
AT_SEA_LEVEL = "2 0 0 16 0 0 0 0 28.06 -82.16 40 1\n"
FIRST = "0 1 3 16 0 0 0 0 28.05 -82.15 30 1\n"


@pytest.mark.parametrize(
    ("rows", "home", "items", "said"),
    [
        (HOME + TAKEOFF + SPEED, GeoPoint(28.05, -82.15, 30.0), 2, "row 0 is read as home"),
        (HOME + AT_SEA_LEVEL, None, 2, "row 0 is read as the first waypoint, not as home"),
        (FIRST + AT_SEA_LEVEL, None, 2, None),
        ("", None, 0, None),
    ],
)
def test_version_120_has_a_home_only_if_row_0_can_be_nothing_else(rows, home, items, said):
    found = waypoints.loads(f"QGC WPL 120\n{rows}".encode())
    mission, notes = (found.mission, found.notes) if isinstance(found, WithNotes) else (found, ())
    assert (mission.home, len(mission.items)) == (home, items)
    assert [said in note for note in notes] == [True] * (said is not None)
    usual = waypoints.loads(f"QGC WPL 110\n{rows}".encode())
    assert usual.home == (GeoPoint(28.05, -82.15, 30.0) if rows.startswith(HOME) else None)


# Files that are sent elsewhere.


@pytest.mark.parametrize("name", ["old.mission", "old.plan"])
def test_a_mission_of_qgroundcontrol_3_is_told_what_to_do(name, tmp_path):
    (tmp_path / "other.plan").write_text('{"plannedHomePosition": [1, 2, 3]}')
    with pytest.raises(MissionFileError, match="this is a JSON file of another kind"):
        read_mission(tmp_path / "other.plan")
    (tmp_path / name).write_bytes((FOREIGN / "qgc3.mission").read_bytes())
    says = r"this is a mission of QGroundControl 3 .*; open it in QGroundControl 4 and save it as a \.plan"
    with pytest.raises(MissionFileError, match=says):
        read_mission(tmp_path / name)


@pytest.mark.parametrize("name", ["a.poly", "a.zip"])
def test_a_farm_file_is_sent_to_plan(name):
    with pytest.raises(MissionFileError, match=rf"{name}: this is a farm file.*wbf-mission plan --farm FILE"):
        read_mission(name)
