"""Fences and rally points as text: what is read, and what is refused."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink import mavwp

from mission.errors import MissionFileError
from mission.files import open_mission, read_mission, reader_for, write_mission
from mission.model import Command, Frame
from wbf_mission.addons.formats import points

FOREIGN = Path(__file__).parents[3] / "data" / "foreign"
CORNER = Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION

degrees = st.integers(-89_000_000, 89_000_000).map(lambda micro: micro / 1e6)
places = st.tuples(degrees, degrees).filter(lambda place: place != (0.0, 0.0))
fences = st.lists(places, min_size=4, max_size=12, unique=True)
spaces = st.sampled_from([" ", "\t", "   "])
ends = st.sampled_from(["\n", "\r\n"])


def fence_of(text):
    told = points.loads(text.encode())
    assert not told.mission.items and not told.mission.rally
    return told.mission.fence


def corners_of(fence):
    corners = [item for item in fence if item.command == CORNER]
    assert {item.param1 for item in corners} == {float(len(corners))}
    return [(item.x, item.y) for item in corners]


def back_of(fence):
    return [(item.x, item.y) for item in fence if item.command == Command.NAV_FENCE_RETURN_POINT]


@given(fences)
def test_a_ring_without_a_return_point_is_a_fence(corners):
    text = "".join(f"{lat} {lon}\n" for lat, lon in [*corners, corners[0]])
    assert (back_of(fence_of(text)), corners_of(fence_of(text))) == ([], corners)
    (note,) = points.loads(text.encode()).notes
    assert note.startswith("the fence has no return point: ")
    assert note.endswith(f"; {len(corners)} corners are an inclusion zone")


@given(fences)
def test_what_pymavlink_saves_it_reads_as_we_do(tmp_path_factory, named):
    path = tmp_path_factory.mktemp("fence") / "fence.txt"
    loader = mavwp.MAVFenceLoader()
    back, *corners = named
    for place in [back, *corners, corners[0]]:
        loader.add_latlon(*place)
    loader.save(path)
    theirs = mavwp.MissionItemProtocol_Fence()
    theirs.load(path)
    mission, notes = open_mission(path)
    assert notes == [
        f"the first point, {back[0]:.6f}, {back[1]:.6f}, is the fence's return point; {len(corners)} corners"
        " are an inclusion zone"
    ]
    wanted = sorted((item.command, item.param1, item.x / 1e7, item.y / 1e7) for item in theirs.wpoints)
    found = sorted((item.command, item.param1, item.x, item.y) for item in mission.fence)
    assert [row[:2] for row in found] == [row[:2] for row in wanted]
    assert [row[2:] for row in found] == [pytest.approx(row[2:], abs=2e-6) for row in wanted]


@given(
    st.lists(st.tuples(places, st.integers(-100, 5000), st.booleans()), min_size=1, max_size=9), ends, spaces
)
def test_rally_points_of_both_programs(named, end, space):
    lines = [
        space.join(("RALLY", f"{lat:.6f}", f"{lon:.6f}", f"{height:.6f}", "40" if more else "0", "0", "0"))
        for (lat, lon), height, more in named
    ]
    told = points.loads(end.join(["#saved by Mission Planner 1.3.80", *lines]).encode())
    assert [(one.x, one.y, one.z) for one in told.mission.rally] == [
        (*place, float(z)) for place, z, _ in named
    ]
    assert {(one.command, one.frame) for one in told.mission.rally} == {(5100, Frame.GLOBAL_RELATIVE_ALT)}
    lost = sum(more for *_, more in named)
    said = f"break altitudes, landing directions and flags of {lost} rally points are left out"
    assert told.notes == (f"{len(named)} rally points, altitudes above home", *[said] * bool(lost))


@pytest.mark.parametrize("name", ["a.fen", "a.ral", "a.txt", "a.waypoints"])
def test_the_content_tells_fence_from_rally(name, tmp_path):
    (tmp_path / name).write_bytes((FOREIGN / "mavproxy_fence.txt").read_bytes())
    fence = read_mission(tmp_path / name).fence
    assert len(corners_of(fence)) == 4
    assert back_of(fence) == [(-35.363720, 149.163651)]
    (tmp_path / name).write_text("RALLY 28.05\t-82.15\t30.0\t0.0\t0.0\t0\n")
    (point,) = read_mission(tmp_path / name).rally
    assert (point.x, point.y, point.z) == (28.05, -82.15, 30.0)
    write_mission(read_mission(tmp_path / name), tmp_path / "out.plan")
    assert read_mission(tmp_path / "out.plan").rally == (point,)


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("a.fen", "1 2\n3 4\n5 6\n3 4\n", "4 points; a fence has"),
        ("a.fen", "1 2\n3 4 5\n", "line 2: 3 numbers instead of 2"),
        ("a.fen", "1 2\n3 x\n", "line 2: 'x' is not a number; give degrees"),
        ("a.fen", "1 2\n1e999 4\n5 6\n7 8\n", "geoFence, polygon 1, vertex 1: "),
        ("a.fen", "1 2\n" + "3" * 3000 + " 4\n", "line 2: the line or the file is too long"),
        ("a.fen", "", "this is an empty file, not a fence or rally file"),
        ("a.fen", "QGC WPL 110\n", "this is a QGC WPL waypoint list, not a fence or rally file; rename it"),
        ("a.fen", "1 2\n\x00\x01", "this is a binary file, not a fence"),
        ("a.ral", "RALLY 1 2\n", "line 1: not RALLY, latitude, longitude and altitude"),
        ("a.ral", "RALLY 1 2 3\n4 5 6\n", "line 2: not RALLY"),
        ("a.ral", "RALLY 1 2 nan\n", "line 1: "),
        ("a.csv", "1\t2\n3\t4\n", "this is a fence file of MAVProxy or Mission Planner, not a CSV table"),
    ],
)
def test_what_is_neither_is_refused_in_a_line(name, text, says, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(MissionFileError) as caught:
        read_mission(tmp_path / name)
    message = str(caught.value)
    assert says in message and message.startswith(f"{tmp_path / name}: ")
    assert "\n" not in message and len(message) < 500


@given(
    st.binary(max_size=60),
    st.sampled_from([b"1 2\n", b"RALLY 1 2 3\n", b"QGC WPL 120\n"]),
    st.integers(0, 20),
)
def test_whatever_follows_is_read_or_refused(rest, begin, count):
    try:
        reader_for("a.txt")(begin * count + rest)
    except MissionFileError as error:
        assert "\n" not in str(error)
