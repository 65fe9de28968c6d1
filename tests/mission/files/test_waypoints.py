"""QGC WPL waypoint lists: the habits of the programs that write them, and what is refused."""

import pytest

from mission.errors import MissionFileError
from mission.files import Firmware, waypoints
from mission.model import Command, GeoPoint, Mission, MissionItem

HEADER = "QGC WPL 110\n"
HOME = "0 1 0 16 0 0 0 0 28.05 -82.15 30.0 1\n"
TAKEOFF = "1 0 3 22 0 0 0 0 28.05 -82.15 10.0 1\n"
WAYPOINT = "2 0 3 16 0 0 0 0 28.06 -82.16 10.0 1\n"


def read(*rows, header=HEADER):
    return waypoints.loads((header + "".join(rows)).encode())


def test_text():
    mission = Mission(
        (
            MissionItem(22, 3, param4=None, x=28.05, y=-82.1500001, z=10.0),
            MissionItem(178, 3, 1.0, 5.5, -1.0),
            MissionItem(177, 2, 0.0, -1.0, autocontinue=False),
        ),
        home=GeoPoint(28.05, -82.15, 30.25),
    )
    rows = [row.split("\t") for row in waypoints.dumps(mission).splitlines()]
    zero = "0.00000000"
    assert rows == [
        ["QGC WPL 110"],
        ["0", "1", "0", "16", zero, zero, zero, zero, "28.05000000", "-82.15000000", "30.25000000", "1"],
        ["1", "0", "3", "22", zero, zero, zero, "NaN", "28.05000000", "-82.15000010", "10.00000000", "1"],
        ["2", "0", "2", "178", "1.00000000", "5.50000000", "-1.00000000", zero, zero, zero, zero, "1"],
        ["3", "0", "2", "177", "1.00000000", "-1.00000000", zero, zero, zero, zero, zero, "0"],
    ]
    assert "NaN" not in waypoints.dumps(mission, Firmware.ARDUPILOT)


@pytest.mark.parametrize(
    "row", [HOME, "0 0 0 0 0 0 0 0 28.05 -82.15 30 1\n", "0 1 3 0 0 0 0 0 28.05 -82.15 30 1\n"]
)
def test_home_row(row):
    mission = read(row, TAKEOFF, WAYPOINT)
    assert mission.home == GeoPoint(28.05, -82.15, 30.0)
    assert [item.command for item in mission.items] == [22, 16]


@pytest.mark.parametrize(
    "text",
    [
        (HEADER + HOME + TAKEOFF + WAYPOINT).replace(" ", "\t").replace("QGC\tWPL\t", "QGC WPL "),
        (HEADER + HOME + TAKEOFF + WAYPOINT).replace("\n", "\r\n"),
        "\ufeff" + HEADER + HOME + TAKEOFF + WAYPOINT.rstrip("\n"),
        HEADER + "  " + HOME + TAKEOFF.replace("10.0", "1e1") + "\t" + WAYPOINT + "\n\n",
        HEADER + HOME.replace("0 1 0", "0 0 0") + TAKEOFF + WAYPOINT.replace("2 0 3", "17 0 3"),
        HEADER + HOME + TAKEOFF.replace(" 22 ", " 22.0 ") + WAYPOINT.replace(" 1\n", " 1.0\n"),
    ],
)
def test_habits(text):
    assert waypoints.loads(text.encode()) == read(HOME, TAKEOFF, WAYPOINT)


def test_real_version_100():
    # seq frame action orbit direction param1 param2 current x(lon) y(lat) z yaw autocontinue
    text = (
        "QGC WPL 100\n"
        "0 0 25 0 0 0 0 1 -82.15 28.05 30 0 1\n"
        "1 3 24 0 0 0 0 0 -82.15 28.05 10 0 1\n"
        "2 3 3 0 0 0 0 0 0 0 0 0 1\n"
    )
    mission = waypoints.loads(text.encode())
    assert mission.home == GeoPoint(28.05, -82.15, 30.0)
    assert [item.command for item in mission.items] == [22, 20]
    with pytest.raises(MissionFileError, match="line 2: action 99"):
        waypoints.loads(text.replace(" 25 ", " 99 ").encode())


@pytest.mark.parametrize(
    ("target", "part"),
    [("0", "seq 0, which does not exist"), ("9", "seq 9"), ("1.5", "1.5"), ("nan", "None")],
)
def test_bad_jumps(target, part):
    with pytest.raises(MissionFileError, match="line 4: DO_JUMP") as caught:
        read(HOME, TAKEOFF, f"2 0 2 177 {target} 3 0 0 0 0 0 1\n")
    assert part in str(caught.value)


def test_fence_and_rally_files():
    fence = read("0 0 3 5001 3 0 0 0 1 2 0 1\n1 0 3 5001 3 0 0 0 1 3 0 1\n2 0 3 5001 3 0 0 0 2 3 0 1\n")
    assert (len(fence.fence), fence.items, fence.home) == (3, (), None)
    rally = read("0 0 3 5100 0 0 0 0 1 2 30 1\n")
    assert rally.rally[0].z == 30.0


@pytest.mark.parametrize(
    ("row", "part"),
    [
        ("1 0 3 16 0 0 0 0 28 -82 10\n", "line 3: 11 columns instead of 12"),
        ("1 0 3 16 0 0 0 0 north -82 10 1\n", "line 3: x (latitude) is 'north'"),
        ("1 0 3 16 0 0 0 0 95 -82 10 1\n", "line 3: mission item (command 16): latitude 95"),
        ("1 0 3 16 0 0 0 0 nan -82 10 1\n", "line 3: latitude of command 16 is missing"),
        ("1 0 3 16 0 0 0 0 28 -82 10 1 " + "0 " * 2000 + "\n", "line 3: longer than"),
        ("1.5 0 3 16 0 0 0 0 28 -82 10 1\n", "seq is '1.5'"),
        ("1 0 3 16 0 0 0 0 \uff12\uff18 -82 10 1\n", "x (latitude)"),
    ],
)
def test_bad_rows_are_named(row, part):
    with pytest.raises(MissionFileError) as caught:
        read(HOME, row)
    assert part in str(caught.value)


@pytest.mark.parametrize("header", ["QGC WPL 130\n", "QGC WPL PB 110\n", "QGC WPL\n", "QGC WPL 110 5\n"])
def test_other_versions_are_refused(header):
    with pytest.raises(MissionFileError, match="line 1: version"):
        read(HOME, header=header)


def test_no_utf_8():
    with pytest.raises(MissionFileError, match="line 2: this is not UTF-8"):
        waypoints.loads(HEADER.encode() + b"# caf\xe9\n")


def test_too_many_rows(monkeypatch):
    assert waypoints.MAX_ITEMS == 65_535
    for module in ("mission.files.waypoints", "mission.model"):
        monkeypatch.setattr(f"{module}.MAX_ITEMS", 20)
    row = "5 0 2 20 0 0 0 0 0 0 0 1\n"
    assert len(read(HOME, row * 20).items) == 20
    for text, says in ((HOME + row * 21, "more than 20 items"), (row * 21, "the maximum is 20;")):
        with pytest.raises(MissionFileError, match=says):
            read(text)


def test_too_many_lines():
    with pytest.raises(MissionFileError, match="more than 500000 lines"):
        read("#\n" * 500_000)


def test_one_plan_a_file():
    item = MissionItem.waypoint(1.0, 2.0, 3.0)
    fence = (MissionItem(5003, 0, 5.0, x=1.0, y=2.0),)
    with pytest.raises(
        MissionFileError, match=r"not 1 mission items and 1 fence items; write a \.plan or \.json"
    ):
        waypoints.dumps(Mission((item,), fence=fence))
    with pytest.raises(MissionFileError, match="item 1: command 5003 belongs"):
        waypoints.dumps(Mission(fence))


@pytest.mark.parametrize("target", [-1.0, 2.0, 0.5, None])
def test_jump_to_nowhere_is_not_written(target):
    with pytest.raises(MissionFileError, match="item 2: DO_JUMP"):
        waypoints.dumps(Mission((MissionItem.waypoint(1, 2, 3), MissionItem(Command.DO_JUMP, 2, target))))
