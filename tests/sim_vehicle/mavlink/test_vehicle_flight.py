"""Whole flights of a vehicle, a ground station that flies a plan, and a camera that listens."""

from collections import Counter

import pytest

from geo.frame import LocalFrame
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import FrameWriter
from mission.model import Command, Frame, MissionItem
from mission.outcome import Outcome
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.autopilot.px4 import PX4
from sim_vehicle.weather.wind import Wind
from tests.support.peer import HOME, Peer

FRAME = LocalFrame(HOME.latitude_deg, HOME.longitude_deg, HOME.altitude_m)
CAMERA = FrameWriter(1, 100)


class Flown(Peer):
    """A ground station that flies a plan, and a camera that may acknowledge its orders."""

    def __init__(self, items, *, camera=None, **options):
        super().__init__(options.pop("autopilot", PX4), home=HOME, **options)
        self.camera, self.orders = camera, []
        if camera is not None:
            self.tell(m.MAVLink_heartbeat_message(30, 8, 0, 0, 3, 3), CAMERA)
        assert self.upload(items).type == 0
        self.wait(2.0)

    def _note(self, messages):
        super()._note(messages)
        for order in [one for one in messages if one.get_type() == "COMMAND_LONG"]:
            self.orders.append((self.now_s, order.command, order.param1, order.confirmation))
            if self.camera == "answers":
                self.tell(m.MAVLink_command_ack_message(order.command, 0, 0, 0, 1, 1), CAMERA)
        return messages

    def start(self):
        assert self.result(400, 1.0) == 0
        assert self.result(300) == 0
        return self

    def to_the_end(self, limit_s=600.0):
        while not self.vehicle.outcome.is_over or self.vehicle.pilot.armed:
            self.wait(0.1)
            assert self.now_s < limit_s
        return self

    def values(self, kind, field):
        """The values that a field had, in the order in which they came first."""
        return list(dict.fromkeys(getattr(message, field) for message in self.of(kind)))


def place(x_m, y_m):
    return FRAME.to_wgs84(float(x_m), float(y_m))


def waypoint(x_m, y_m, altitude_m=10.0, **options):
    return MissionItem.waypoint(*place(x_m, y_m), altitude_m, **options)


TAKEOFF = MissionItem(
    Command.NAV_TAKEOFF, Frame.GLOBAL_RELATIVE_ALT, x=HOME.latitude_deg, y=HOME.longitude_deg, z=10.0
)
RTL = MissionItem(Command.NAV_RETURN_TO_LAUNCH)
SURVEY = (
    TAKEOFF,
    MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, 1.0, 5.0, -1.0),
    waypoint(20, 0),
    MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION, 1.0, 0.0, 1.0),
    waypoint(20, 30),
    waypoint(40, 30),
    MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION, 0.0),
    RTL,
)


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_a_mission_from_upload_to_disarming(autopilot):
    peer = Flown(SURVEY, autopilot=autopilot, camera="answers")
    peer.tell(m.MAVLink_request_data_stream_message(1, 1, 0, 4, 1))  # which PX4 ignores
    peer.wait(1.0)
    peer.start().to_the_end()
    vehicle = peer.vehicle
    assert (vehicle.outcome, vehicle.outcome_text) == (Outcome.COMPLETED, "mission complete")
    first = 0 if autopilot is PX4 else 1
    if autopilot is ARDUPILOT:
        reached = list(range(first, first + len(SURVEY)))
    else:  # of a place and the commands after it the last one, and the return instead of the last place
        ends = [i for i, item in enumerate(SURVEY[:-1]) if item.has_position]
        reached = [*(after - 1 for after in ends[1:]), len(SURVEY) - 1]
    assert peer.values("MISSION_ITEM_REACHED", "seq") == reached
    assert set(peer.values("MISSION_CURRENT", "seq")) <= set(range(first, first + len(SURVEY))) | {0}
    assert peer.values("MISSION_CURRENT", "mission_state")[-3:] == [2, 3, 5]
    assert peer.of("MISSION_CURRENT")[-1].seq == (len(SURVEY) - 1 if autopilot is PX4 else 0)
    assert peer.values("EXTENDED_SYS_STATE", "landed_state") == [1, 3, 2, 4]
    assert [order[1:3] for order in peer.orders] == [(206, 1.0), (206, 0.0)]
    armed = [bool(message.base_mode & 128) for message in peer.of("HEARTBEAT")]
    assert armed[0] is False and armed[-1] is False and any(armed)
    words = {"Armed by external command", "Mission finished, loitering", "Disarmed by landing"}
    if autopilot is ARDUPILOT:
        words = {"Arming motors", "Mission complete", "Disarming motors"}
    assert words <= set(peer.texts())
    assert 30.0 < peer.now_s < 120.0
    peer.wait(1.0)
    assert peer.of("EXTENDED_SYS_STATE")[-1].landed_state == 1
    last = peer.of("GLOBAL_POSITION_INT")[-1]
    x_m, y_m = FRAME.from_wgs84(last.lat / 1e7, last.lon / 1e7)
    assert abs(x_m) < 1.0 and abs(y_m) < 1.0 and last.relative_alt == 0 and last.alt == 20_000


def test_telemetry_rates_and_contents():
    peer = Flown(SURVEY).start()
    peer.wait(20.0 - peer.now_s)
    shown = zip(peer.times, peer.told, strict=True)
    times = Counter(message.get_type() for now_s, message in shown if 10.0 <= now_s < 20.0)
    assert times["GLOBAL_POSITION_INT"] == times["ATTITUDE"] == 100
    assert times["LOCAL_POSITION_NED"] == times["VFR_HUD"] == times["ATTITUDE_QUATERNION"] == 50
    assert times["ALTITUDE"] == times["HIGHRES_IMU"] == times["ODOMETRY"] == 10
    assert times["GPS_RAW_INT"] == times["EXTENDED_SYS_STATE"] == 20
    assert times["HEARTBEAT"] == times["SYS_STATUS"] == times["BATTERY_STATUS"] == times["SYSTEM_TIME"] == 10
    assert 10 <= times["MISSION_CURRENT"] <= 14
    assert times["HOME_POSITION"] == 5
    state = peer.vehicle.pilot.state
    position = peer.of("GLOBAL_POSITION_INT")[-1]
    east, north = FRAME.from_wgs84(position.lat / 1e7, position.lon / 1e7)
    assert (east, north) == pytest.approx(state.position_m[:2], abs=0.02)
    assert position.relative_alt == pytest.approx(1000 * state.position_m[2], abs=1)
    assert position.time_boot_ms == 20_000
    assert (position.vy, position.vx) == pytest.approx([100 * v for v in state.velocity_m_s[:2]], abs=1)
    ned = peer.of("LOCAL_POSITION_NED")[-1]
    assert (ned.y, ned.x, -ned.z) == pytest.approx(state.position_m, abs=1e-3)
    status = peer.of("SYS_STATUS")[-1]
    for bit in (1, 2, 4, 8, 32, 1 << 20, 1 << 28):
        assert status.onboard_control_sensors_present & status.onboard_control_sensors_health & bit
    assert 0 < status.battery_remaining <= 100
    home = peer.of("HOME_POSITION")[0]
    assert (home.latitude, home.longitude, home.altitude) == (280500000, -821500000, 20000)
    beat = peer.of("HEARTBEAT")[0]
    assert (beat.type, beat.autopilot, beat.custom_mode) == (2, 12, 0x03040000)
    assert beat.base_mode & 1


def test_mode_then_arm_starts_the_mission_as_qgroundcontrol_does_it():
    peer = Flown(SURVEY)
    assert peer.result(176, 1.0, 4.0, 4.0) == 0
    assert peer.result(400, 1.0) == 0
    peer.to_the_end()
    assert peer.vehicle.outcome is Outcome.COMPLETED


def test_return_to_launch_in_mid_mission_is_an_interruption_and_stops_the_camera():
    peer = Flown(SURVEY, camera="answers").start()
    peer.wait(15.0 - peer.now_s)
    assert peer.result(20) == 0
    peer.to_the_end()
    assert peer.vehicle.outcome is Outcome.FLIGHT_ABORTED
    assert "item" in peer.vehicle.outcome_text
    assert [order[1:3] for order in peer.orders] == [(206, 1.0), (206, 0.0)]
    assert peer.orders[-1][0] == pytest.approx(15.0, abs=0.2)


def test_a_camera_that_never_answers_is_asked_three_times_and_reported():
    peer = Flown(SURVEY, camera="silent").start().to_the_end()
    assert [order[3] for order in peer.orders if order[2] == 1.0] == [0, 1, 2]
    assert "Camera does not answer command 206" in peer.texts()
    assert peer.vehicle.outcome is Outcome.COMPLETED


def test_unfit_to_arm_is_visible_before():
    peer = Flown(SURVEY)
    peer.vehicle.pilot.drain_battery(0.1)
    peer.wait(1.5)
    assert not peer.of("SYS_STATUS")[-1].onboard_control_sensors_health & 1 << 28
    assert peer.result(300) == 1, "TEMPORARILY_REJECTED"
    assert not peer.vehicle.pilot.armed
    assert any(text.startswith("Preflight Fail: battery low") for text in peer.texts())


def test_wind_too_strong_ends_in_a_landing_not_in_a_hang():
    peer = Flown((TAKEOFF, waypoint(-300, 0), RTL), wind=Wind(18.0, 0.0)).start().to_the_end(3000.0)
    assert peer.vehicle.outcome is Outcome.CANNOT_FLY_ITEM
    assert "wind" in peer.vehicle.outcome_text


def test_the_ideal_vehicle_flies_too():
    peer = Flown((TAKEOFF, waypoint(3, 0), waypoint(3, 3), RTL), kind="ideal").start().to_the_end(3000.0)
    assert peer.vehicle.outcome is Outcome.COMPLETED
    shown = zip(peer.times, peer.told, strict=True)
    times = Counter(message.get_type() for now_s, message in shown if 5.0 <= now_s < 15.0)
    assert times["GLOBAL_POSITION_INT"] == 10, "it moves once a second"
    assert peer.of("SYS_STATUS")[-1].battery_remaining == -1


def test_a_second_flight_after_the_first():
    peer = Flown(SURVEY).start().to_the_end()
    peer.start().to_the_end()
    peer.wait(1.0)
    assert peer.vehicle.outcome is Outcome.COMPLETED
    assert peer.texts().count("Mission finished, loitering") == 2


def test_px4_ends_a_mission_in_the_mode_of_returns():
    """As PX4 1.17 (SIH) does: first the item and the texts, then the mode, then the item that it is at."""
    peer = Flown(SURVEY).start().to_the_end()
    last, rtl = len(SURVEY) - 1, PX4.for_vehicle("multirotor").mavlink.modes[Mode.RTL]
    told = list(zip(peer.times, peer.told, strict=True))
    at = next(
        i for i, (_, one) in enumerate(told) if one.get_type() == "MISSION_ITEM_REACHED" and one.seq == last
    )
    begin_s = told[at][0]
    texts = [(now_s, one.text) for now_s, one in told if one.get_type() == "STATUSTEXT" and now_s >= begin_s]
    assert texts[:2] == [(begin_s, "Mission finished, loitering"), (begin_s, "Returning to launch")]
    beat_s = next(t for t, one in told if one.get_type() == "HEARTBEAT" and one.custom_mode == rtl)
    assert beat_s - begin_s == pytest.approx(0.3, abs=0.1)
    currents = [(t, one) for t, one in told[at:] if one.get_type() == "MISSION_CURRENT" and t > beat_s]
    current_s, current = currents[0]
    assert current_s - beat_s < 0.1 and (current.seq, current.mission_state) == (last, 5)
    assert currents[-1][1].mission_state == 5
