"""How far a mission is flown, as telemetry tells."""

import pytest

from geo.frame import LocalFrame
from mission.course import Course, MissionProgress
from mission.errors import MissionError
from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint, Mission, MissionItem

FRAME = LocalFrame(28.05, -82.15)
PX4, ARDUPILOT = 12, 3
MISSION_PX4, RETURN_PX4 = (4 << 24) | (4 << 16), (5 << 24) | (4 << 16)
AUTO, RTL = 3, 6


def at(x, y):
    return MissionItem.waypoint(*FRAME.to_wgs84(x, y), 10.0)


ITEMS = (
    MissionItem(22, 3, x=28.05, y=-82.15, z=10.0),
    at(0.0, 0.0),
    MissionItem(206, param1=2.0),
    at(100.0, 0.0),
    at(100.0, 20.0),
    at(0.0, 20.0),
    MissionItem(206),
    MissionItem(20),
)
COURSE = Course(Mission(ITEMS, GeoPoint(28.05, -82.15)))


class Log:
    """What a vehicle tells."""

    def __init__(self, autopilot=PX4):
        self.progress = MissionProgress(COURSE)
        self.autopilot = autopilot
        self.now_s = 0.0

    def beat(self, mode=None, armed=True):
        flies = MISSION_PX4 if self.autopilot == PX4 else AUTO
        base = 1 | (128 if armed else 0) | (8 if self.autopilot == PX4 else 0)
        self._tell(
            m.MAVLink_heartbeat_message(2, self.autopilot, base, flies if mode is None else mode, 4, 3)
        )

    def be(self, item, x, y):
        home = 1 if self.autopilot == ARDUPILOT else 0
        self._tell(m.MAVLink_mission_current_message(item + home))
        latitude, longitude = FRAME.to_wgs84(x, y)
        place = (round(latitude * 1e7), round(longitude * 1e7))
        self._tell(m.MAVLink_global_position_int_message(0, *place, 40000, 10000, 0, 0, 0, 0))

    def _tell(self, message):
        self.now_s += 0.2
        self.progress.receive(message, self.now_s)


@pytest.mark.parametrize(("autopilot", "home"), [(PX4, RETURN_PX4), (ARDUPILOT, RTL)])
def test_the_way_home_does_not_count(autopilot, home):
    log = Log(autopilot)
    log.beat()
    log.be(3, 60.0, 0.5)
    log.beat()
    log.be(3, 75.0, 0.5)  # told after the last heartbeat in the mission: it may be on the way home
    log.beat(home)
    log.be(3, 90.0, 0.0)
    log.beat(home)
    log.beat()  # it is in its mission again: what it was told of before was not
    log.beat()
    place = log.progress.place()
    assert place.item == 3 and place.fraction == pytest.approx(0.6, abs=1e-3)


@pytest.mark.parametrize(("autopilot", "home"), [(PX4, 0), (ARDUPILOT, 1)])
@pytest.mark.parametrize(("reached", "over"), [(5, True), (4, False)])
def test_the_last_item_is_reached_from_a_radius_away(autopilot, home, reached, over):
    log = Log(autopilot)
    log.beat()
    log.be(5, 6.0, 20.0)
    log.beat()
    log._tell(m.MAVLink_mission_item_reached_message(reached + home))
    assert (log.progress.place() is None) == over


def test_what_tells_nothing_is_refused():
    log = Log()
    log.beat(armed=False)
    log.be(3, 60.0, 0.0)
    log.beat(armed=False)
    with pytest.raises(MissionError, match="no message shows"):
        log.progress.place()
    for item, x, text in (
        (20, 0.0, "flies item 21, but the mission has 8 items"),
        (3, 900.0, "another mission"),
    ):
        log = Log()
        log.beat()
        log.be(item, x, 0.0)
        log.beat()
        with pytest.raises(MissionError, match=text):
            log.progress.place()


def test_a_vehicle_whose_mission_is_suspended_flies_something_else():
    """It shows its mission's mode still, as while it goes home by itself; MISSION_CURRENT says so."""
    log = Log()
    log.beat()
    log.be(3, 40.0, 0.0)
    log.beat()
    flown = log.progress.place()
    log._tell(m.MAVLink_mission_current_message(3, len(ITEMS), 4, 2))
    latitude, longitude = FRAME.to_wgs84(90.0, 0.0)
    place = (round(latitude * 1e7), round(longitude * 1e7))
    log._tell(m.MAVLink_global_position_int_message(0, *place, 40000, 10000, 0, 0, 0, 0))
    log.beat()
    assert log.progress.place() == flown
