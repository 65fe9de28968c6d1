"""Whatever a file holds, the check ends with findings or with one line."""

import math

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from preflight_plans import HOME, checked

from geo.errors import WbfMissionError
from mission.model import GeoPoint, Mission, MissionItem

NUMBERS = st.one_of(
    st.none(),
    st.sampled_from((0.0, 1.0, 2.0, -1.0, 3.0, 1e6, -1e30, 65535.0)),
    st.floats(-1e5, 1e5, allow_nan=False),
)
NEAR = st.floats(-0.002, 0.002)


@st.composite
def items(draw, commands):
    frame = draw(st.sampled_from((0, 2, 3, 3, 3, 5, 6, 10, 4)))
    place = draw(st.sampled_from(("near", "near", "here", "far")))
    latitude, longitude = {
        "near": (HOME.latitude_deg + draw(NEAR), HOME.longitude_deg + draw(NEAR)),
        "here": (0.0, 0.0),
        "far": (draw(st.floats(-90, 90)), draw(st.floats(-180, 180))),
    }[place]
    height = draw(st.sampled_from((10.0, 20.0, 0.0, -5.0, 150.0, 99_000.0)))
    params = [draw(NUMBERS) for _ in range(4)]
    return MissionItem(draw(commands), frame, *params, x=latitude, y=longitude, z=height)


MISSION = st.sampled_from((16, 16, 16, 17, 18, 19, 20, 21, 22, 31, 82, 93, 94, 112, 114, 115, 177, 178, 189))
CAMERA = st.sampled_from((195, 201, 206, 214, 2000, 2001, 530, 3000, 60_000))
FENCE = st.sampled_from((5000, 5001, 5002, 5003, 5004, 16))
MISSIONS = st.builds(
    Mission,
    st.lists(items(st.one_of(MISSION, CAMERA)), max_size=8).map(tuple),
    st.sampled_from((HOME, HOME, None, GeoPoint(89.9999, 179.9999))),
    st.lists(items(FENCE), max_size=5).map(tuple),
    st.lists(items(st.just(5100)), max_size=2).map(tuple),
)


@settings(max_examples=20, suppress_health_check=[HealthCheck.too_slow])
@given(
    MISSIONS,
    st.sampled_from((("quad", "px4"), ("quad", "ardupilot"), ("fixed-wing", "px4"), ("rover", "ardupilot"))),
)
def test_any_mission_ends_with_findings_or_one_line(mission, flown):
    try:
        report = checked(mission, vehicle=flown[0], autopilot=flown[1]).report
    except WbfMissionError as error:
        assert "\n" not in str(error)
        return
    for finding in report.findings:
        assert "\n" not in str(finding)
        assert finding.item is None or finding.item >= 1
        assert finding.measure is None or math.isfinite(finding.measure.value)
