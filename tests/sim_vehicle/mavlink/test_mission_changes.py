"""A mission changed in flight, as PX4 1.17 and ArduCopter 4.7 take it: one test for each thing they do."""

import math
from functools import cache

import pytest
from changed_missions import BASE, FRAME, RTL, TAKEOFF, TURN, Flight, do, shots, speed, wp

from mission.link.codec.dialect import mavlink as m
from mission.model import MissionItem
from mission.outcome import Outcome
from mission.transfer import wire
from sim_vehicle.autopilot import get_autopilot
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.autopilot.px4 import PX4

BOTH = pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])
DYNAMICS = pytest.mark.parametrize("dynamics", [None, "generic"], ids=["own", "generic"])
RESTARTED = "Auto mission changed, restarted command"
FAILED = "Auto mission changed but failed to restart command"
# The same up to the item that is flown to, and quite another list.
NEXT = (*BASE[:6], wp(240, 150), wp(240, 200), RTL)
OTHER = (TAKEOFF, speed(4.0), shots(2.0), wp(0, 0), wp(10, 200), wp(20, 220), wp(0, 220), RTL)
SHORTER = (TAKEOFF, wp(0, 40), wp(0, 0), wp(60, 0))
CORNER, FAR = (120, 150), (240, 150)


@cache
def undisturbed_s(name):
    """When it is at the next two positions without a change."""
    flight = Flight(get_autopilot(name)).fly().to_the_change()
    at_s = flight.now_s
    return flight.reaches(*CORNER) - at_s, flight.reaches(*FAR) - at_s


def late_s(flight, at_s):
    """How much later than without the change it is at the second position."""
    return flight.reaches(*FAR) - at_s - undisturbed_s(flight.vehicle.autopilot.name)[1]


def shots_ordered(flight, since_s=0.0):
    """The distances between shots that the vehicle ordered of its camera."""
    return [a.param1 for a in flight.of("COMMAND_LONG", since_s - 1e-9) if a.command == 206]


def shown(items):
    """What both autopilots keep of items."""
    return [(item.command, item.param1, item.x, item.y, item.z) for item in items]


def position_command(x, y, z=20.0):
    latitude, longitude = FRAME.to_wgs84(float(x), float(y))
    return m.MAVLink_command_int_message(
        1, 1, 3, 192, 0, 0, -1.0, 1.0, 0.0, math.nan, round(latitude * 1e7), round(longitude * 1e7), z
    )


def setpoint(x, y, z=20.0):
    latitude, longitude = FRAME.to_wgs84(float(x), float(y))
    at = (round(latitude * 1e7), round(longitude * 1e7), z)
    return m.MAVLink_set_position_target_global_int_message(
        0, 1, 1, 6, 0b110111111000, *at, 0, 0, 0, 0, 0, 0, 0, 0
    )


# While the items arrive.


def test_px4_flies_on_untouched_until_the_ack():
    flight = Flight(PX4).fly().to_the_change()
    at_s = flight.now_s
    before = flight.current
    wired = flight.begin(OTHER)
    for seq, item in enumerate(wired[:-1]):
        flight.send(item, seq)
        flight.wait(0.24)
        assert flight.pilot.mission.items == BASE
    assert flight.current.mission_id == before.mission_id
    assert flight.dip(at_s) < 0.05
    (ack,) = (a for a in flight.send(wired[-1], len(wired) - 1) if a.get_type() == "MISSION_ACK")
    assert ack.type == 0
    current = flight.current
    assert current.seq == 65535, "unknown for a moment"
    assert current.mission_id == ack.opaque_id != before.mission_id
    flight.wait(1.0)
    assert flight.current.seq == flight.of("MISSION_CURRENT")[-1].seq == TURN


def test_ardupilot_restarts_the_leg_with_each_item():
    flight = Flight(ARDUPILOT).fly().to_the_change()
    at_s = flight.now_s
    assert flight.upload(NEXT, every_s=0.3).type == 0
    flight.wait(0.1)
    assert flight.slowest(at_s) < 2.0
    assert flight.texts().count(RESTARTED) in (len(NEXT), len(NEXT) + 1, len(NEXT) + 2)
    assert f"Mission: {TURN + 1} WP" in flight.texts()
    assert late_s(flight, at_s) == pytest.approx(5.8, abs=1.0)


# What is flown then.


@pytest.mark.parametrize(
    ("autopilot", "late", "within"), [(PX4, 0.0, 0.1), (ARDUPILOT, 1.9, 0.4)], ids=["px4", "ardupilot"]
)
@pytest.mark.parametrize("items", [NEXT, BASE], ids=["new", "identical"])
def test_the_same_items_up_to_the_present_one_keep_it(autopilot, late, within, items):
    flight = Flight(autopilot).fly().to_the_change()
    at_s, before = flight.now_s, flight.current
    assert flight.upload(items).type == 0
    assert flight.seq == TURN
    assert flight.mode is Mode.MISSION
    if items is BASE:
        assert flight.current.mission_id == before.mission_id
    flight.wait(5.0)
    assert (flight.dip(at_s) < 0.05) is (autopilot is PX4)
    assert late_s(flight, at_s) == pytest.approx(late, abs=within)


@BOTH
def test_a_quite_different_list_is_flown_from_the_same_number_at_once(autopilot):
    flight = Flight(autopilot).fly().to_the_change()
    flight.upload(OTHER)
    assert flight.seq == TURN
    flight.reaches(20, 220)
    flight.reaches(0, 220)
    flight.reaches(0, 0)
    flight.wait(120.0, lambda: not flight.pilot.armed)
    assert not flight.pilot.armed
    assert flight.pilot.outcome.value == "completed"


def test_ardupilot_turns_to_the_new_item_before_the_ack():
    flight = Flight(ARDUPILOT).fly().to_the_change()
    wired = flight.begin(OTHER)
    for seq, item in enumerate(wired[: TURN + 2]):
        flight.send(item, seq)
    flight.wait(1.0)
    assert flight.seq == TURN
    assert flight.pilot.mission.items[TURN] == OTHER[TURN]
    x = flight.place[0]
    flight.wait(6.5)
    assert flight.place[0] < x - 10.0
    assert not flight.of("MISSION_ACK", flight.now_s - 7.6)


def test_px4_clamps_to_the_last_item_of_a_shorter_list_and_holds_there():
    flight = Flight(PX4).fly().to_the_change()
    flight.upload(SHORTER)
    assert flight.seq == len(SHORTER) - 1
    flight.reaches(60, 0)
    flight.wait(12.0)
    assert flight.mode is Mode.HOLD
    assert flight.current.mission_state == m.MISSION_STATE_COMPLETE
    assert flight.speed < 0.1


@DYNAMICS
def test_ardupilot_flies_the_old_leg_to_its_end_when_its_item_is_gone(dynamics):
    flight = Flight(ARDUPILOT, dynamics=dynamics).fly().to_the_change()
    flight.upload(SHORTER)
    assert FAILED in flight.texts() or (flight.wait(0.1) and FAILED in flight.texts())
    flight.reaches(*CORNER)
    flight.wait(15.0)
    assert math.hypot(flight.place[0] - CORNER[0], flight.place[1] - CORNER[1]) < 12.0
    assert flight.speed < 0.1
    assert flight.mode is Mode.MISSION
    current = flight.current
    assert current.seq > current.total
    assert current.mission_state == m.MISSION_STATE_COMPLETE


@BOTH
def test_speed_and_shot_distance_stay(autopilot):
    flight = Flight(autopilot).fly().to_the_change()
    flight.upload(OTHER)
    flight.wait(60.0, lambda: flight.seq == TURN + 1)
    assert flight.pilot.executor.mission.settings.speed_m_s == 7.0
    assert set(shots_ordered(flight)) == {5.0}, "the new DO items before the present one are not run"


@pytest.mark.parametrize(("autopilot", "again"), [(PX4, True), (ARDUPILOT, False)], ids=["px4", "ardupilot"])
def test_the_counter_of_jumps(autopilot, again):
    jumping = (TAKEOFF, wp(0, 20), wp(20, 20), do(177, 1.0, 1.0), wp(20, 40), RTL)
    flight = Flight(autopilot, items=jumping).fly()
    settings = flight.pilot.executor.mission.settings
    flight.wait(90.0, lambda: bool(settings.jumps))
    assert settings.jumps == {3: 1}
    assert flight.seq == 1
    flight.upload((*jumping[:-1], wp(0, 40), RTL))
    settings = flight.pilot.executor.mission.settings
    assert (settings.jumps == {}) is again


# Orders about the present item.


@BOTH
def test_set_current_after_the_ack(autopilot):
    flight = Flight(autopilot).fly().to_the_change()
    flight.upload(NEXT)
    flight.tell(m.MAVLink_mission_set_current_message(1, 1, TURN + 1 + flight.offset))
    assert flight.seq == TURN + 1
    flight.reaches(*FAR)


def test_the_command_for_the_current_item_is_ardupilots_only():
    flight = Flight(PX4).fly().to_the_change()
    assert flight.result(224, 6.0) == m.MAV_RESULT_UNSUPPORTED
    assert flight.seq == TURN
    flight = Flight(ARDUPILOT).fly().to_the_change()
    for items in (None, NEXT):
        if items is not None:
            flight.upload(items)
        assert flight.result(224, 7.0) == 0
        assert flight.seq == TURN + 1
        assert flight.result(224, 6.0) == 0
        assert flight.seq == TURN


def test_px4_obeys_the_mark_without_a_dip():
    flight = Flight(PX4).fly().to_the_change()
    at_s = flight.now_s
    flight.upload((TAKEOFF, wp(*CORNER), wp(*FAR), RTL), marked=1)
    assert flight.seq == 1
    flight.wait(5.0)
    assert flight.dip(at_s) < 0.05
    assert late_s(flight, at_s) == pytest.approx(0.0, abs=0.1)


def test_px4_runs_the_do_items_from_the_mark_on():
    flight = Flight(PX4).fly().to_the_change()
    at_s = flight.now_s
    flight.upload((TAKEOFF, speed(4.0), shots(2.0), wp(*CORNER), wp(*FAR), RTL), marked=1)
    assert flight.seq == 3
    flight.wait(0.1)
    assert set(shots_ordered(flight, at_s)) == {2.0}
    flight.wait(6.0)
    assert flight.speed == pytest.approx(4.0, abs=0.1)


@pytest.mark.parametrize(("autopilot", "items", "seq"), [(PX4, BASE, 3), (ARDUPILOT, NEXT, TURN)])
def test_ardupilot_ignores_the_mark(autopilot, items, seq):
    flight = Flight(autopilot).fly().to_the_change()
    flight.upload(items, marked=3)
    assert flight.seq == seq, "PX4 obeys it, in an identical list, too"


# Pause, upload, go on.


def test_px4_holds_takes_a_list_and_goes_on():
    flight = Flight(PX4).fly().to_the_change()
    at_s = flight.now_s
    assert flight.result(176, 1.0, 4.0, 3.0) == 0
    flight.upload(NEXT)
    assert flight.seq == TURN
    flight.wait(4.0)
    assert flight.result(176, 1.0, 4.0, 4.0) == 0
    assert flight.seq == TURN, "another list is not flown twice"
    flight.wait(5.0)
    assert flight.pilot.executor.mission.settings.speed_m_s == 7.0
    assert 4.0 < late_s(flight, at_s) < 9.0


def test_px4_goes_back_in_a_survey_after_a_plain_hold():
    flight = Flight(PX4).fly().to_the_change()
    at_s = flight.now_s
    flight.result(176, 1.0, 4.0, 3.0)
    flight.wait(4.0)
    flight.result(176, 1.0, 4.0, 4.0)
    assert flight.seq == TURN - 2
    assert set(shots_ordered(flight, at_s)) == {0.0}
    flight.reaches(0, 30)
    flight.wait(1.0)
    assert shots_ordered(flight, at_s)[-1] == 5.0, "shots go on from the next position"


@pytest.mark.parametrize("mode", [4.0, 17.0], ids=["guided", "brake"])
def test_ardupilot_pauses_takes_a_list_and_goes_on_at_its_own_speed(mode):
    flight = Flight(ARDUPILOT).fly().to_the_change()
    flight.result(176, 1.0, mode)
    flight.wait(3.0)
    flight.upload(NEXT)
    assert flight.seq == TURN
    assert RESTARTED not in flight.texts()
    flight.wait(3.0)
    assert flight.speed < 0.1
    current = flight.current
    assert (current.mission_state, current.mission_mode) == (m.MISSION_STATE_NOT_STARTED, 0)
    flight.result(176, 1.0, 3.0)
    assert flight.seq == TURN
    flight.reaches(*FAR)
    assert max(v for t, v in flight.speeds if t > flight.now_s - 15.0) > 8.0


def test_an_upload_ends_ardupilots_pause():
    flight = Flight(ARDUPILOT).fly().to_the_change()
    assert flight.result(193, 0.0) == 0
    flight.wait(6.0)
    assert flight.speed < 0.1
    assert flight.mode is Mode.MISSION
    flight.upload(NEXT)
    flight.reaches(*FAR)
    flight = Flight(PX4).fly().to_the_change()
    assert flight.result(193, 0.0) == m.MAV_RESULT_UNSUPPORTED


# Transfers that end otherwise.


def test_a_part_of_the_mission_is_ardupilots_only():
    part = m.MAVLink_mission_write_partial_list_message
    flight = Flight(PX4).fly().to_the_change()
    assert flight.tell(part(1, 1, 5, 5, 0)) == []
    flight = Flight(ARDUPILOT).fly().to_the_change()
    at_s = flight.now_s
    flight.tell(part(1, 1, TURN + 1, TURN + 1, 0))
    answers = flight.send(wp(90, 170), TURN + 1)
    assert [a.type for a in answers if a.get_type() == "MISSION_ACK"] == [0]
    flight.wait(3.0)
    assert RESTARTED in flight.texts()
    assert flight.slowest(at_s) < 6.0
    flight.reaches(90, 170)
    answers = flight.tell(part(1, 1, 40, 41, 0))
    assert [a.type for a in answers] == [wire.ERROR]


def test_a_ground_station_that_falls_silent_leaves_px4_its_old_list():
    flight = Flight(PX4).fly().to_the_change(110.0)
    at_s = flight.now_s
    flight.upload(OTHER, stop_after=6)
    flight.wait(4.8)
    assert "Operation timeout" not in flight.texts()
    flight.wait(0.4)
    assert "Operation timeout" in flight.texts()
    assert not flight.of("MISSION_ACK", at_s)
    assert flight.pilot.mission.items == BASE
    flight.reaches(*FAR)


def test_a_ground_station_that_falls_silent_leaves_ardupilot_a_mixed_list():
    flight = Flight(ARDUPILOT).fly().to_the_change(110.0)
    at_s = flight.now_s
    flight.upload(OTHER[:-1], stop_after=TURN + 2)
    flight.wait(0.2)
    mixed = shown((*OTHER[: TURN + 1], *BASE[TURN + 1 : len(OTHER) - 1]))
    assert shown(flight.pilot.mission.items) == mixed
    flight.wait(7.5)
    assert not flight.of("MISSION_ACK", at_s)
    restarts = flight.texts().count(RESTARTED)
    flight.wait(0.6)
    assert flight.texts().count(RESTARTED) == restarts, "what came is flown already"
    assert [a.type for a in flight.of("MISSION_ACK", at_s)] == [wire.OPERATION_CANCELLED]
    assert shown(flight.pilot.mission.items) == mixed, "never rolled back"
    flight.reaches(20, 220)


def test_a_shorter_count_truncates_ardupilots_list_at_once():
    flight = Flight(ARDUPILOT).fly().to_the_change()
    flight.begin(SHORTER)
    flight.wait(0.2)
    assert shown(flight.pilot.mission.items) == shown(BASE[: len(SHORTER)])
    assert FAILED in flight.texts()


@BOTH
def test_clear_and_bad_items_in_the_middle_of_an_upload(autopilot):
    flight = Flight(autopilot).fly().to_the_change()
    wired = flight.begin(OTHER)
    for seq, item in enumerate(wired[:4]):
        flight.send(item, seq)
    answers = flight.tell(m.MAVLink_mission_clear_all_message(1, 1, 0))
    acks = [a.type for a in answers if a.get_type() == "MISSION_ACK"]
    assert acks == ([] if autopilot is PX4 else [wire.ERROR])
    bad = MissionItem(16, 2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 10.0) if autopilot is PX4 else wp(0, 0)
    message = wire.item_to_message(bad, 4, 0, (1, 1))
    if autopilot is ARDUPILOT:
        message.x = 950_000_000
    (ack,) = (a for a in flight.tell(message) if a.get_type() == "MISSION_ACK")
    assert ack.type == (wire.UNSUPPORTED if autopilot is PX4 else m.MAV_MISSION_INVALID_PARAM5_X)
    flight.wait(0.2)
    expected = BASE if autopilot is PX4 else (*OTHER[:3], *BASE[3 : len(OTHER)])
    assert shown(flight.pilot.mission.items) == shown(expected)
    assert flight.mode is Mode.MISSION
    flight.reaches(*CORNER)


def test_px4_clears_in_flight_and_holds():
    flight = Flight(PX4).fly().to_the_change()
    (ack,) = (
        a for a in flight.tell(m.MAVLink_mission_clear_all_message(1, 1, 0)) if a.get_type() == "MISSION_ACK"
    )
    assert ack.type == 0
    flight.wait(20.0)
    assert "No valid mission available, loitering" in flight.texts()
    assert flight.mode is Mode.HOLD
    assert flight.speed < 0.1


def test_ardupilot_clears_nothing_in_auto():
    flight = Flight(ARDUPILOT).fly().to_the_change()
    answers = flight.tell(m.MAVLink_mission_clear_all_message(1, 1, 0))
    assert [a.type for a in answers if a.get_type() == "MISSION_ACK"] == [wire.ERROR]
    flight.reaches(*FAR)


@BOTH
def test_a_dead_link_changes_nothing_by_default(autopilot):
    flight = Flight(autopilot).fly()
    flight.tell(m.MAVLink_heartbeat_message(m.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
    flight.to_the_change()
    flight.wait(90.0)
    # A PX4 may have come to its end meanwhile, which is a return.
    assert flight.mode is Mode.MISSION or (autopilot is PX4 and flight.vehicle.pilot.mission.returns)
    assert flight.seq > TURN
    assert not any("GCS" in text for text in flight.texts())


# Positions one by one.


def aim(flight, positions, send, every_s):
    """Send positions, each when the one before is 10 m ahead; the speeds on the way."""
    at_s = flight.now_s
    for x, y in positions:
        flight.tell(send(x, y))
        waited_s = 0.0
        while math.hypot(flight.place[0] - x, flight.place[1] - y) > 10.0 and waited_s < 20.0:
            flight.wait(every_s)
            waited_s += every_s
            if send is setpoint:
                flight.tell(send(x, y))
    return [v for t, v in flight.speeds if t > at_s + 3.0]


@pytest.mark.parametrize("send", [position_command, setpoint])
def test_ardupilot_flies_through_positions_at_its_own_speed(send):
    flight = Flight(ARDUPILOT).fly().to_the_change()
    x, y = flight.place[:2]
    if send is setpoint:
        flight.result(176, 1.0, 4.0)
    speeds = aim(flight, [(x, y + 11 + k) for k in range(60)], send, 0.1)
    assert flight.mode is Mode.GUIDED
    assert 4.5 < sum(speeds) / len(speeds) < 7.2
    assert min(speeds) > 3.5
    flight.tell(send(x, y + 400))
    flight.wait(12.0)
    assert flight.speed == pytest.approx(10.0, abs=0.3), "its own speed, not the mission's"
    assert flight.result(178, 1.0, 6.0, -1.0) == 0
    flight.wait(6.0)
    assert flight.speed == pytest.approx(6.0, abs=0.3)


def test_px4_repositions_at_its_own_speed():
    flight = Flight(PX4).fly().to_the_change()
    x, y = flight.place[:2]
    flight.tell(position_command(x, y + 200))
    assert flight.mode is Mode.HOLD
    flight.wait(10.0)
    assert flight.speed == pytest.approx(5.0, abs=0.2)
    flight.wait(60.0)
    assert math.hypot(flight.place[0] - x, flight.place[1] - y - 200) < 1.0
    flight.wait(60.0)
    assert (flight.mode, flight.pilot.armed) == (Mode.HOLD, True), "it stays when nobody asks for more"


def test_px4_offboard_is_fast_also_in_corners_and_returns_without_setpoints():
    flight = Flight(PX4).fly().to_the_change()
    x, y = flight.place[:2]
    for _ in range(3):
        flight.tell(setpoint(x, y + 10))
        flight.wait(0.1)
    assert flight.result(176, 1.0, 6.0) == 0
    at_s = flight.now_s
    travelled = 0.0
    while travelled < 110.0:
        travelled = max(travelled, flight.place[1] - y + flight.place[0] - x)
        ahead = travelled + 10.0
        flight.tell(setpoint(x, y + ahead) if ahead < 60.0 else setpoint(x + ahead - 60.0, y + 60.0))
        flight.wait(0.1)
        assert flight.now_s < at_s + 60.0
    speeds = [v for t, v in flight.speeds if t > at_s + 3.0]
    assert max(speeds) > 7.5
    assert min(speeds) > 5.0
    assert flight.mode is Mode.GUIDED
    flight.wait(0.9)
    assert flight.mode is Mode.GUIDED
    flight.wait(0.4)
    assert flight.mode is Mode.RTL
    flight.wait(200.0, lambda: not flight.pilot.armed)
    assert not flight.pilot.armed


def test_ardupilot_hovers_in_guided_when_the_ground_station_dies():
    flight = Flight(ARDUPILOT).fly().to_the_change()
    flight.tell(position_command(150, 150))
    before = len(flight.texts())
    flight.wait(90.0)
    assert math.hypot(flight.place[0] - 150, flight.place[1] - 150) < 1.0
    assert flight.mode is Mode.GUIDED
    assert [text for text in flight.texts()[before:] if "Camera" not in text] == []


@pytest.mark.parametrize("left_m", [6.0, 12.0])
def test_ardupilots_safe_way_loses_little(left_m):
    flight = Flight(ARDUPILOT).fly().to_the_change()
    at_s = flight.now_s
    flight.tell(position_command(*CORNER))
    assert flight.result(178, 1.0, 7.0, -1.0) == 0
    flight.wait(2.0)
    assert flight.upload((*NEXT[:6], speed(7.0), *NEXT[6:])).type == 0
    assert flight.result(224, TURN + 2.0) == 0
    flight.wait(30.0, lambda: math.dist(flight.place[:2], CORNER) <= left_m)
    assert flight.result(176, 1.0, 3.0) == 0
    # Real ones were 0.6 to 1.5 s late.
    assert late_s(flight, at_s) < 1.5 * 1.1
    # Recorded in the four seconds after AUTO: 1.26 to 1.8 m/s.
    assert flight.slowest(at_s) > 0.9 * 1.26


# Take-off, return, the end.


@BOTH
@DYNAMICS
def test_a_take_off_is_finished_before_the_new_list(autopilot, dynamics):
    flight = Flight(autopilot, dynamics=dynamics).fly()
    flight.wait(60.0, lambda: flight.place[2] > 8.0)
    flight.upload((TAKEOFF, wp(-40, 0), RTL))
    while flight.place[2] < 18.0:
        flight.wait(0.1)
        assert math.hypot(*flight.place[:2]) < 1.5
    assert RESTARTED not in flight.texts()
    flight.reaches(-40, 0)
    flight.wait(120.0, lambda: not flight.pilot.armed)
    assert flight.pilot.outcome.value == "completed"


@BOTH
def test_a_return_is_not_disturbed(autopilot):
    flight = Flight(autopilot).fly().to_the_change()
    assert flight.result(20) == 0
    flight.wait(5.0)
    flight.upload(OTHER)
    assert flight.mode is Mode.RTL
    assert flight.seq == TURN
    flight.wait(200.0, lambda: not flight.pilot.armed)
    assert math.hypot(*flight.place[:2]) < 1.0


def test_ardupilot_goes_on_at_the_item_of_the_same_number_after_a_return():
    flight = Flight(ARDUPILOT).fly().to_the_change()
    flight.result(20)
    flight.wait(5.0)
    flight.upload(OTHER)
    flight.result(176, 1.0, 3.0)
    assert flight.seq == TURN
    flight.reaches(20, 220)
    assert max(v for t, v in flight.speeds if t > flight.now_s - 12.0) > 8.0, "at its own speed"


def test_px4_takes_off_again_when_the_mission_is_taken_at_touch_down():
    flight = Flight(PX4).fly().to_the_change()
    flight.result(20)
    flight.wait(200.0, lambda: flight.place[2] <= 0.0)
    assert flight.pilot.armed
    assert flight.result(176, 1.0, 4.0, 4.0) == 0
    flight.wait(20.0)
    assert flight.place[2] > 5.0


END = (TAKEOFF, wp(0, 30), wp(30, 30))


def test_px4_holds_after_the_last_item_and_starts_from_a_chosen_one():
    flight = Flight(PX4, items=END).fly()
    flight.wait(90.0, lambda: flight.mode is Mode.HOLD)
    assert flight.current.mission_state == m.MISSION_STATE_COMPLETE
    flight.wait(5.0)
    flight.tell(m.MAVLink_mission_set_current_message(1, 1, 1))
    flight.wait(3.0)
    assert flight.speed < 0.1
    flight.result(176, 1.0, 4.0, 4.0)
    flight.reaches(0, 30)


@pytest.mark.parametrize(
    ("autopilot", "hold", "lands", "seq"),
    [(PX4, (4.0, 3.0), False, 0), (PX4, (4.0, 3.0), True, 0), (ARDUPILOT, (17.0,), False, TURN)],
    ids=["px4", "px4-landed", "ardupilot"],
)
def test_px4_restarts_its_mission_at_mission_start(autopilot, hold, lands, seq):
    flight = Flight(autopilot).fly().to_the_change()
    assert flight.result(176, 1.0, *hold) == 0
    flight.wait(3.0)
    assert flight.upload(BASE).type == 0
    if lands:
        flight.result(21)
        flight.wait(100.0, lambda: not flight.pilot.armed)
    assert flight.seq == TURN
    flight.fly()
    assert flight.seq == seq, "ArduPilot goes on, PX4 begins anew"


@pytest.mark.parametrize(("by_upload", "landed"), [(False, True), (True, False)], ids=["landed", "uploaded"])
def test_px4_goes_on_at_what_came_on_the_way_home_of_its_mission(by_upload, landed):
    flight = Flight(PX4, items=(*END, RTL)).fly()
    flight.wait(90.0, lambda: flight.mode is Mode.RTL)
    flight.wait(2.0)
    if by_upload:
        assert flight.upload((*END, wp(60, 60), RTL), marked=1).type == 0
    else:
        flight.tell(m.MAVLink_mission_set_current_message(1, 1, 1))
    flight.wait(2.0)
    assert flight.mode is Mode.RTL, "the way home is flown on"
    if landed:
        flight.wait(200.0, lambda: not flight.pilot.armed)
        assert flight.pilot.outcome is Outcome.COMPLETED
        assert flight.result(400, 1.0) == 0
    assert flight.result(176, 1.0, 4.0, 4.0) == 0
    assert flight.seq == 1
    flight.reaches(0, 30)
    if by_upload:
        flight.reaches(60, 60)
    flight.wait(200.0, lambda: flight.mode is Mode.RTL)
    flight.wait(200.0, lambda: not flight.pilot.armed)
    assert flight.pilot.outcome is Outcome.COMPLETED


def test_ardupilot_stays_in_auto_after_the_last_item_until_the_mission_is_started():
    flight = Flight(ARDUPILOT, items=END).fly()
    complete = m.MISSION_STATE_COMPLETE
    flight.wait(90.0, lambda: flight.pilot.mission.state == complete)
    flight.wait(8.0)
    here = flight.place
    assert flight.mode is Mode.MISSION
    assert flight.current.mission_state == complete
    assert flight.upload((*END, wp(60, 60), RTL)).type == 0
    assert flight.current.mission_state == complete
    flight.tell(m.MAVLink_mission_set_current_message(1, 1, 4))
    flight.wait(2.0)
    assert flight.result(176, 1.0, 3.0) == 0
    flight.wait(10.0)
    assert math.dist(flight.place, here) < 0.5, "nothing moves"
    assert flight.result(300) == 0
    flight.reaches(60, 60)


# Shots by distance.


@pytest.mark.parametrize(
    ("autopilot", "mode", "goes_on"),
    [
        (PX4, (4.0, 3.0), False),
        (PX4, (4.0, 5.0), False),
        (ARDUPILOT, (17.0,), True),
        (ARDUPILOT, (6.0,), True),
    ],
    ids=["px4-hold", "px4-rtl", "ardupilot-brake", "ardupilot-rtl"],
)
def test_where_shots_go_on(autopilot, mode, goes_on):
    flight = Flight(autopilot).fly().to_the_change()
    at_s = flight.now_s
    assert flight.result(176, 1.0, *mode) == 0
    flight.wait(2.0)
    orders = shots_ordered(flight, at_s)
    assert (orders == []) is goes_on
    assert set(orders) <= {0.0}


@BOTH
def test_ardupilot_tells_of_its_own_shots(autopilot):
    flight = Flight(autopilot).fly().to_the_change()
    image = m.MAVLink_camera_image_captured_message(
        61_000, 0, 0, 280500000, -821500000, 40_000, 20_000, [1.0, 0.0, 0.0, 0.0], 7, 1, b""
    )
    answers = flight.tell(image)
    assert answers == [], "another system's"
    answers = flight.tell_as(1, 100, image)
    if autopilot is PX4:
        assert answers == []
        return
    (feedback,) = answers
    assert feedback.get_type() == "CAMERA_FEEDBACK"
    assert (feedback.img_idx, feedback.lat, feedback.lng) == (7, 280500000, -821500000)
    assert (feedback.alt_msl, feedback.alt_rel, feedback.time_usec) == (40.0, 20.0, 61_000_000)
    flight.tell(m.MAVLink_mission_set_current_message(1, 1, 3))
    flight.vehicle.command_camera(206, (0.0,) * 7)
    assert [a.get_type() for a in flight.tell_as(1, 100, image)] == ["COMMAND_LONG"], "not ordered any more"
