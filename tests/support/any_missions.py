"""Any missions, for files to hold; and damage to such files, which has to be refused politely."""

import math
from dataclasses import replace
from functools import partial

from hypothesis import settings
from hypothesis import strategies as st

from mission.errors import MissionFileError
from mission.files import fitted, losses, read_mission, write_mission
from mission.files.formats import differences
from mission.model import Command, Frame, GeoPoint, Mission, MissionItem, has_position
from wbf_mission.addons.formats.drawn import Drawing

patient = partial(settings, deadline=None)
FLYING = [16, 17, 18, 19, 21, 22, 31, 82, 189, 195, 4501]
DOING = [20, 93, 112, 115, 177, 178, 197, 206, 214, 2000, 2001, 12345]
parameters = st.none() | st.floats(width=32, allow_nan=False, allow_infinity=False)
latitudes = st.integers(-900_000_000, 900_000_000).map(lambda n: n / 1e7)
longitudes = st.integers(-1_800_000_000, 1_800_000_000).map(lambda n: n / 1e7)
altitudes = st.floats(-1000, 10_000, width=32)
flying_items = st.builds(
    MissionItem,
    st.sampled_from(FLYING),
    st.sampled_from([0, 3, 5, 6, 10]),
    *[parameters] * 4,
    *(latitudes, longitudes, altitudes, st.booleans()),
)
doing_items = st.builds(
    MissionItem,
    st.sampled_from(DOING),
    st.sampled_from([0, 2, 2, 3]),
    *[parameters] * 4,
    *[st.integers(-1000, 1000).map(float)] * 2,
    *(altitudes, st.booleans()),
)
homes = st.builds(GeoPoint, st.floats(0.001, 90), st.floats(-180, 180), st.floats(-500, 9000))


def polygon(inclusion, vertices):
    command = Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION if inclusion else 5002
    return [MissionItem(command, 0, float(len(vertices)), x=x, y=y, autocontinue=False) for x, y in vertices]


def circle(inclusion, radius, place):
    return [MissionItem(5003 if inclusion else 5004, 0, radius, x=place[0], y=place[1], autocontinue=False)]


places = st.tuples(latitudes, longitudes)
polygons = st.builds(polygon, st.booleans(), st.lists(places, min_size=3, max_size=6))
circles = st.builds(circle, st.booleans(), st.floats(1, 1e5, width=32), places)
returns = st.builds(
    lambda x, y, z: [MissionItem(5000, 3, x=x, y=y, z=z, autocontinue=False)],
    *(latitudes, longitudes, altitudes),
)
fences = st.builds(
    lambda first, second, third: tuple(item for part in (*first, *second, *third) for item in part),
    st.lists(polygons, max_size=3),
    st.lists(circles, max_size=3),
    st.lists(returns, max_size=1),
)
rallies = st.lists(
    st.builds(
        lambda x, y, z: MissionItem(5100, 3, x=x, y=y, z=z, autocontinue=False),
        *(latitudes, longitudes, altitudes),
    ),
    max_size=4,
).map(tuple)


@st.composite
def missions(draw, *, guarded=True):
    items = draw(st.lists(st.one_of(flying_items, doing_items), max_size=12))
    for index, item in enumerate(items):
        if item.command == Command.DO_JUMP:
            items[index] = replace(item, param1=float(draw(st.integers(0, len(items) - 1))))
    return Mission(
        tuple(items),
        home=draw(st.none() | homes),
        fence=draw(fences) if guarded else (),
        rally=draw(rallies) if guarded else (),
        cruise_speed_m_s=draw(st.floats(0, 1000)),
        hover_speed_m_s=draw(st.floats(0, 1000)),
    )


SMALL = Mission(
    (
        MissionItem(22, 3, x=28.05, y=-82.15, z=10.0),
        MissionItem(178, 2, 1.0, 5.0),
        MissionItem(177, 2, 0.0, 2.0),
        MissionItem(20, Frame.MISSION),
    ),
    home=GeoPoint(28.05, -82.15, 30.0),
)
WHOLE = replace(
    SMALL,
    fence=(*polygon(True, [(0, 0), (0, 1), (1, 1)]), *circle(False, 5.0, (1, 1))),
    rally=(MissionItem(5100, 3, x=1.0, y=2.0, z=3.0),),
)
MISSION = Mission(
    (
        MissionItem(22, 3, param4=None, x=28.05, y=-82.15, z=10.0),
        MissionItem.waypoint(28.051, -82.151, 10.0),
        MissionItem(20),
    ),
    home=GeoPoint(28.05, -82.15, 30.0),
)
SQUARE = [(28.0, -82.0), (28.001, -82.0), (28.001, -81.999), (28.0, -81.999)]
GUARDED = Mission(
    MISSION.items,
    home=MISSION.home,
    fence=tuple(MissionItem(5001, 0, 4.0, x=x, y=y) for x, y in SQUARE),
    rally=(MissionItem(5100, 3, x=28.0, y=-82.0, z=20.0),),
)
TOKENS = [*b'null NaN -1 1e400 65536 "a" [ ] { } true \xff'.split(), b"\t", b"\n"]


def refused_or_read(loads, data):
    try:
        mission = loads(data)
        if isinstance(mission, Drawing):
            mission, _ = mission.mission(30.0)
    except MissionFileError as error:
        assert str(error)
        return
    assert isinstance(mission, Mission)
    for item in (*mission.items, *mission.fence, *mission.rally):
        assert math.isfinite(item.x)
        if has_position(item.command) and item.frame in {0, 3, 10}:
            assert abs(item.x) <= 90


def check_damaged(data, loads, content):
    """Replace some bytes of a file by others."""
    content = bytearray(content)
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(content) - 1))
        length = data.draw(st.integers(0, 12))
        content[start : start + length] = data.draw(st.sampled_from(TOKENS) | st.binary(max_size=3))
        if not content:
            break
    refused_or_read(loads, bytes(content))


def check_truncated(loads, content):
    """End a file too early, at up to 800 places."""
    for end in range(0, len(content), 1 + len(content) // 800):
        refused_or_read(loads, content[:end])


def check_kept(mission, path, firmware):
    """Compare the losses of a mission in a file with the mission that is read back."""
    said = losses(mission, path, firmware=firmware)
    write_mission(fitted(mission, path), path, firmware=firmware)
    back = read_mission(path)
    assert bool(said) == bool(differences(mission, back))
    # What the vehicle would fly otherwise is a warning, and nothing else is.
    unset = {"param1": 0, "param2": 0, "param3": 0, "param4": 0}
    before, after = (
        [replace(item.in_standard_frame(), **unset) for item in plan.items] for plan in (mission, back)
    )
    guarded = (len(back.fence), len(back.rally)) == (len(mission.fence), len(mission.rally))
    assert any(loss.changes_flight for loss in said) == (not (before == after and guarded))
