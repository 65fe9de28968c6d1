"""Did a PX4 end its mission by itself, or did a pilot take it out? Messages come late, or in any order."""

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from sweeps import sweep

from mission.ground.arming_gate import ArmingGate
from mission.ground.modes import Maneuver
from mission.ground.orders import NotFlyingError
from mission.ground.station import GroundStation
from mission.link.codec.dialect import mavlink as m
from mission.model import Command, GeoPoint, Mission, MissionItem
from mission.outcome import Outcome, Phase
from mission.transfer import MissionServer

WAYPOINTS = tuple(MissionItem.waypoint(28.05 + 1e-4 * k, -82.15, 5.0) for k in range(1, 4))
TAKEOFF = MissionItem(Command.NAV_TAKEOFF, 3, param4=None, x=28.05, y=-82.15, z=5.0)
HOMEWARD = Mission(
    (TAKEOFF, *WAYPOINTS, MissionItem(Command.NAV_RETURN_TO_LAUNCH)), GeoPoint(28.05, -82.15, 30.0)
)
STAYING = Mission((TAKEOFF, *WAYPOINTS), HOMEWARD.home)
MISSION, HOLD, RTL = (4 << 16 | sub << 24 for sub in (4, 3, 5))
ACTIVE, PAUSED, COMPLETE = 3, 4, 5
END_S, MOMENT_S = 40.0, 1.0


def from_vehicle(message: Any) -> Any:
    message.pack(m.MAVLink(None, 1, 1))
    return message


def beat(mode: int, *, armed: bool = True) -> Any:
    return m.MAVLink_heartbeat_message(2, 12, 157 if armed else 29, mode, 4, 3)


def current(seq: int, state: int, total: int = 5) -> Any:
    return m.MAVLink_mission_current_message(seq, total, state, 1 if state == ACTIVE else 2)


def ready(mission: Mission) -> GroundStation:
    """A ground station that arms its vehicle at 2 s."""
    ground = GroundStation(mission, arming_gate=ArmingGate((1, 1), agreed=True))
    server = MissionServer(1, 1)
    queue = ground.receive(from_vehicle(beat(HOLD, armed=False)), 1.0)
    while queue:
        replies: list[Any] = []
        for message in queue:
            message.pack(m.MAVLink(None, 255, 190))
            replies += server.receive(message, 1.0).messages
        queue = [out for reply in replies for out in ground.receive(from_vehicle(reply), 1.0)]
    there = m.MAVLink_global_position_int_message(1500, 280500000, -821500000, 0, 0, 0, 0, 0, 0)
    ground.receive(from_vehicle(there), 1.5)
    bit = m.MAV_SYS_STATUS_PREARM_CHECK
    ground.receive(
        from_vehicle(m.MAVLink_sys_status_message(bit, bit, bit, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)), 2.0
    )
    return ground


def flying(mission: Mission) -> GroundStation:
    """A ground station whose vehicle has just begun its mission, before 10 s."""
    ground = ready(mission)
    for tenth in range(20, 25):
        for message in ground.poll(tenth / 10):
            if message.get_type() == "COMMAND_LONG" and ground.phase is not Phase.FLIGHT:
                queue = [m.MAVLink_command_ack_message(message.command, 0)]
                while queue:
                    sent = ground.receive(from_vehicle(queue.pop()), tenth / 10)
                    queue += [m.MAVLink_command_ack_message(out.command, 0) for out in sent]
    assert ground.phase is Phase.FLIGHT, ground.reason
    return ground


def each_second(begin_s: float, end_s: float, *made: Any) -> list[tuple[float, Any]]:
    return [(begin_s + k, make()) for k in range(int(end_s - begin_s)) for make in made]


def until_moment(total: int = 5) -> list[tuple[float, Any]]:
    """A PX4 on its way to its last waypoint."""
    return [
        *each_second(10.5, END_S, lambda: beat(MISSION)),
        *each_second(11.0, END_S, lambda: current(2, ACTIVE, total)),
        *[(20.0 + k, m.MAVLink_mission_item_reached_message(1)) for k in range(11)],
        *each_second(30.2, END_S, lambda: m.MAVLink_mission_item_reached_message(2)),
        *each_second(30.3, END_S, lambda: current(3, ACTIVE, total)),
    ]


def normal_end(down_s: float) -> list[tuple[float, Any]]:
    """As a real one ends its mission with a return."""
    texts = [b"Mission finished\t", b"Returning to launch\t"]
    down_s += END_S
    return [
        (END_S, m.MAVLink_mission_item_reached_message(4)),
        *[(END_S, m.MAVLink_statustext_message(6, text)) for text in texts],
        (END_S + 0.3, beat(RTL)),
        (END_S + 0.33, current(4, ACTIVE)),
        *each_second(END_S + 1.0, END_S + 11.0, lambda: m.MAVLink_mission_item_reached_message(4)),
        *each_second(END_S + 1.3, down_s, lambda: beat(RTL)),
        *each_second(END_S + 1.33, down_s, lambda: current(4, PAUSED)),
        *each_second(down_s, down_s + 8.0, lambda: beat(HOLD, armed=False), lambda: current(0, COMPLETE)),
    ]


def pilots_end(down_s: float, *modes: int) -> list[tuple[float, Any]]:
    """As one that a pilot takes out between its last two waypoints, and that lands then."""
    down_s += END_S
    return [
        *[(END_S + 0.2 * k, beat(mode)) for k, mode in enumerate(modes)],
        *each_second(END_S + 0.2, END_S + 1.2, lambda: m.MAVLink_mission_item_reached_message(2)),
        *each_second(END_S + 1.0, down_s, lambda: beat(modes[-1]), lambda: current(3, PAUSED)),
        *each_second(down_s, down_s + 8.0, lambda: beat(HOLD, armed=False), lambda: current(3, PAUSED)),
    ]


def arrivals(sent: list[tuple[float, Any]], late: list[float], lost: set[int]) -> list[tuple[float, Any]]:
    """The messages as they arrive: each late by its own time, and some of the moment itself not at all."""
    came = []
    for number, (time_s, message) in enumerate(sorted(sent, key=lambda one: one[0])):
        of_moment = END_S <= time_s < END_S + MOMENT_S
        if not (of_moment and number % 8 in lost):
            came.append((time_s + late[number % len(late)], message))
    return sorted(came, key=lambda one: one[0])


def flown(mission: Mission, came: list[tuple[float, Any]], *, orders: bool = False) -> GroundStation:
    ground = flying(mission)
    now_s = 10.0
    for time_s, message in came:
        while now_s < time_s:
            now_s = min(time_s, max(ground.next_deadline(), now_s + 0.05))
            ground.poll(now_s)
        if not ground.done:
            ground.receive(from_vehicle(message), time_s)
    for tenth in range(100):
        ground.poll(now_s + tenth / 10)
    return ground


lates = st.lists(st.floats(0.0, 3.0), min_size=1, max_size=13)
losses = st.sets(st.integers(0, 7))
downs = st.integers(6, 20)


@sweep(few=25, many=120)
@given(lates, losses, downs)
@example([0.0], set(), 30)
@example([0.0], {0, 1, 2, 3}, 30)
@example([3.0, 0.0], set(), 6)
@example([0.0, 3.0], set(), 9)  # the state comes 3 s after the disarming
def test_a_mission_that_ends_by_itself_is_completed(late, lost, down_s):
    ground = flown(HOMEWARD, arrivals(until_moment() + normal_end(down_s), late, lost))
    assert (ground.outcome, ground.reason) == (Outcome.COMPLETED, "")
    assert not [text for _, text in ground.pilot.events if "taken out" in text]


@sweep(few=25, many=120)
@given(lates, losses, downs, st.sampled_from([(RTL,), (HOLD,), (HOLD, RTL), (RTL, HOLD)]))
@example([0.0], set(), 6, (RTL,))
@example([1.0, 0.0, 0.0, 2.0, 2.0, 1.0], set(), 6, (RTL,))  # a silence before it, nothing after it
def test_a_mission_that_a_pilot_takes_out_is_not(late, lost, down_s, modes):
    ground = flown(HOMEWARD, arrivals(until_moment() + pilots_end(down_s, *modes), late, lost))
    assert ground.outcome is Outcome.PILOT_TOOK_OVER
    assert ground.reason.startswith("taken out of its mission: mode")


@sweep(few=25, many=100)
@given(lates, losses)
def test_a_mission_that_leads_nowhere_ends_in_hold(late, lost):
    ends = [
        (END_S, m.MAVLink_mission_item_reached_message(3)),
        (END_S, m.MAVLink_statustext_message(6, b"Mission finished, loitering\t")),
        (END_S + 0.3, beat(HOLD)),
        (END_S + 0.33, current(3, COMPLETE, 4)),
        *each_second(END_S + 1.3, END_S + 20.0, lambda: beat(HOLD), lambda: current(0, COMPLETE, 4)),
    ]
    ground = flown(STAYING, arrivals(until_moment(4) + ends, late, lost))
    assert ground.outcome is Outcome.COMPLETED


def test_nothing_is_ordered_while_it_is_not_known_who_chose_the_mode():
    ground = flying(HOMEWARD)
    ground.receive(from_vehicle(beat(MISSION)), 11.0)
    ground.receive(from_vehicle(current(2, ACTIVE)), 11.1)
    ground.receive(from_vehicle(beat(RTL)), 20.0)
    assert ground.pilot.taken_out and not ground.pilot.somebody_else_flies
    with pytest.raises(NotFlyingError, match=r"left its mission \(mode RTL\).*wait 5 s"):
        ground.maneuver(Maneuver.HOLD, 20.5)
    ground.receive(from_vehicle(m.MAVLink_mission_item_reached_message(4)), 21.0)
    assert not ground.pilot.taken_out and ground.flies_home
    assert ground.maneuver(Maneuver.HOLD, 21.5)


@pytest.mark.parametrize(
    ("mode", "text"),
    [
        (MISSION, "the vehicle had flown its mission to the end (MISSION)"),
        (RTL, "the vehicle had left its mission (RTL)"),
    ],
)
def test_a_change_that_comes_after_the_end_says_so(mode, text):
    ground, server = flying(HOMEWARD), MissionServer(1, 1)
    for message in (beat(MISSION), current(2, ACTIVE)):
        ground.receive(from_vehicle(message), 11.0)
    ground.receive(from_vehicle(beat(mode)), 11.5)
    ground.receive(from_vehicle(current(4, COMPLETE if mode == MISSION else PAUSED)), 11.6)
    held = 0
    asked = ground.change(replace(HOMEWARD, items=(TAKEOFF, *WAYPOINTS[1:], HOMEWARD.items[-1])), 2, 11.7)
    while asked:
        for one in asked:
            one.pack(m.MAVLink(None, 255, 190))
        replies = [reply for one in asked for reply in server.receive(one, 11.8).messages]
        held = next((one.opaque_id for one in replies if one.get_type() == "MISSION_ACK"), held)
        asked = [out for reply in replies for out in ground.receive(from_vehicle(reply), 11.9)]
    for tenth in range(120, 160):
        told = m.MAVLink_mission_current_message(0, 4, COMPLETE, 2, held)
        ground.receive(from_vehicle(told), tenth / 10)
        ground.poll(tenth / 10)
    assert [one.text for one in ground.changes] == [text]


def test_a_pilots_return_is_told_when_nothing_speaks_for_an_end():
    ground = flying(HOMEWARD)
    ground.receive(from_vehicle(beat(MISSION)), 11.0)
    ground.receive(from_vehicle(current(2, ACTIVE)), 11.1)
    ground.receive(from_vehicle(beat(RTL)), 20.0)
    ground.poll(24.9)
    assert ground.pilot.events == []
    ground.poll(25.0)
    assert ground.pilot.events == [(20.0, "taken out of its mission: mode RTL")]
    assert ground.pilot.somebody_else_flies
    ground.receive(from_vehicle(beat(MISSION)), 30.0)
    assert not ground.pilot.taken_out


def test_what_an_older_flight_of_the_same_list_told_is_outdated():
    ground = flying(HOMEWARD)
    ground.receive(from_vehicle(current(4, COMPLETE)), 10.5)
    ground.receive(from_vehicle(beat(MISSION)), 11.0)
    ground.receive(from_vehicle(current(4, COMPLETE)), 11.1)
    assert ground.flies_home
    for second in range(12, 20):
        ground.receive(from_vehicle(current(1, ACTIVE)), float(second))
    assert not ground.flies_home
    ground.receive(from_vehicle(beat(HOLD)), 20.0)
    assert ground.pilot.somebody_else_flies


def test_a_mission_that_comes_when_the_old_one_has_ended_does_not_make_the_return_a_pilots():
    """A real PX4 took the whole list and told it as active all the way home."""
    came = [
        *until_moment(),
        (END_S, m.MAVLink_statustext_message(6, b"Mission finished, loitering\t")),
        *each_second(END_S + 0.3, END_S + 30.0, lambda: beat(RTL), lambda: current(2, ACTIVE)),
        *each_second(END_S + 30.0, END_S + 38.0, lambda: beat(HOLD, armed=False), lambda: current(2, ACTIVE)),
    ]
    ground = flown(HOMEWARD, came)
    assert not [text for _, text in ground.pilot.events if "taken out" in text]
    assert ground.outcome is Outcome.COMPLETED


@settings(max_examples=30, deadline=None)
@given(late_s=st.floats(0.0, 5.0), item=st.integers(1, 3), came=st.integers(1, 4))
@example(late_s=5.0, item=2, came=1)
def test_what_was_sent_before_the_end_and_comes_after_it_undoes_no_end(late_s, item, came):
    """HEARTBEATs come once a second: the last one that was heard is of the mission's mode still."""
    ground = flying(HOMEWARD)
    ground.receive(from_vehicle(beat(MISSION)), 39.5)
    ground.receive(from_vehicle(current(3, ACTIVE)), 39.6)
    ground.receive(from_vehicle(m.MAVLink_statustext_message(6, b"Mission finished, loitering\t")), 40.0)
    for number in range(came):
        ground.receive(from_vehicle(current(item, ACTIVE)), 40.0 + late_s * (number + 1) / came)
    assert ground.pilot.mission_over and ground.flies_home
    # So the return that follows is the mission's own, and no pilot's.
    ground.receive(from_vehicle(beat(RTL)), 45.1)
    ground.poll(60.0)
    assert not ground.pilot.events and not ground.pilot.taken_out


def test_a_mission_that_is_flown_on_long_after_an_end_was_told_is_not_over():
    """A vehicle that shows its mission's mode, and items left, flies them: a return then is a pilot's."""
    ground = flying(HOMEWARD)
    ground.receive(from_vehicle(beat(MISSION)), 39.5)
    ground.receive(from_vehicle(m.MAVLink_statustext_message(6, b"Mission finished, loitering\t")), 40.0)
    ground.receive(from_vehicle(beat(RTL)), 45.0)
    ground.receive(from_vehicle(current(2, ACTIVE)), 45.2)
    assert ground.pilot.mission_over, "on its way home it tells an item, too"
    ground.receive(from_vehicle(beat(MISSION)), 46.0)
    ground.receive(from_vehicle(current(2, ACTIVE)), 46.1)
    assert not ground.pilot.mission_over
    ground.receive(from_vehicle(beat(HOLD)), 47.0)
    assert ground.pilot.somebody_else_flies


def test_a_vehicle_that_a_pilot_has_landed_is_not_back_in_its_mission():
    """A PX4 that was taken out goes back to its mission's mode when it is disarmed."""
    ground = flying(HOMEWARD)
    ground.receive(from_vehicle(beat(MISSION)), 11.0)
    ground.receive(from_vehicle(current(2, ACTIVE)), 11.1)
    ground.receive(from_vehicle(beat(HOLD)), 20.0)
    assert ground.pilot.somebody_else_flies
    ground.receive(from_vehicle(beat(MISSION, armed=False)), 40.0)
    assert ground.pilot.somebody_else_flies
    for tenth in range(400, 500):
        ground.poll(tenth / 10)
    assert (ground.outcome, ground.reason) == (
        Outcome.PILOT_TOOK_OVER,
        "taken out of its mission: mode LOITER",
    )


def test_a_vehicle_that_may_have_armed_unheard_is_disarmed() -> None:
    ground = ready(Mission((MissionItem.waypoint(28.051, -82.15, 5.0),), GeoPoint(28.05, -82.15)))
    sent = [message for second in range(2, 60) for message in ground.poll(float(second))]
    arming = [one.param1 for one in sent if getattr(one, "command", 0) == m.MAV_CMD_COMPONENT_ARM_DISARM]
    assert ground.outcome is Outcome.NO_ANSWER
    assert arming == [1.0] * 4 + [0.0] * 4, "each is repeated until it is answered"
    assert ground.reason.startswith("no answer while ") and ground.reason.endswith("its motors may run")


@pytest.mark.parametrize("refused", [False, True])
def test_a_lost_order_to_disarm_is_repeated_until_the_vehicle_shows_it(refused: bool) -> None:
    disarm = (m.MAV_CMD_COMPONENT_ARM_DISARM, 0.0)
    ground = arming()
    if refused:
        ground.receive(from_vehicle(m.MAVLink_command_ack_message(m.MAV_CMD_COMPONENT_ARM_DISARM, 0)), 2.1)
        denied = m.MAVLink_command_ack_message(m.MAV_CMD_MISSION_START, m.MAV_RESULT_DENIED)
        assert orders(ground.receive(from_vehicle(denied), 2.2)) == [disarm]
        now_s = 2.2
    else:
        now_s = 2.0
        while disarm not in orders(ground.poll(now_s)):
            now_s += 0.1
    ground.receive(from_vehicle(beat(HOLD)), now_s + 0.5)
    now_s += 10.0
    assert not ground.done and orders(ground.poll(now_s)) == [disarm], "the first was lost"
    assert orders(ground.goodbye()) == [disarm]
    ground.receive(from_vehicle(m.MAVLink_command_ack_message(m.MAV_CMD_COMPONENT_ARM_DISARM, 0)), now_s)
    if not refused:
        assert not ground.done, "it may be the late answer to the order to arm"
        ground.receive(from_vehicle(beat(HOLD, armed=False)), now_s + 0.5)
        ground.poll(now_s + 10.0)
    assert ground.done and "motors" not in ground.reason
    assert orders(ground.goodbye()) == []


def arming(mission: Mission = HOMEWARD) -> GroundStation:
    """A ground station that has just ordered its vehicle to arm, at 2 s."""
    ground = ready(mission)
    ground.poll(2.0)
    assert ground.phase is Phase.ARM
    return ground


def orders(messages: list[Any]) -> list[tuple[int, float]]:
    return [(one.command, one.param1) for one in messages if isinstance(one, m.MAVLink_command_long_message)]


def test_a_vehicle_that_shows_itself_armed_is_started_and_not_armed_again() -> None:
    ground = arming()
    assert orders(ground.receive(from_vehicle(beat(HOLD)), 2.5)) == []
    assert orders(ground.poll(3.5)) == [(m.MAV_CMD_MISSION_START, 0.0)]
    assert ground.phase is Phase.START
    assert ground.goodbye() == [], "it may be taking off"


@pytest.mark.parametrize("answers", [False, True])
def test_a_vehicle_that_a_pilot_has_disarmed_is_not_armed_again(answers: bool) -> None:
    ground = arming()
    ground.receive(from_vehicle(beat(HOLD, armed=False)), 2.1)
    assert ground.phase is Phase.ARM, "the order has not arrived"
    ground.receive(from_vehicle(beat(HOLD)), 2.5)
    ground.receive(from_vehicle(beat(HOLD, armed=False)), 2.9)
    assert ground.outcome is Outcome.NOT_STARTED
    late = m.MAVLink_command_ack_message(m.MAV_CMD_COMPONENT_ARM_DISARM, 0)
    sent = ground.receive(from_vehicle(late), 3.0) if answers else []
    sent += [message for second in range(3, 60) for message in ground.poll(float(second))]
    assert orders(sent + ground.goodbye()) == []


def test_a_program_that_ends_disarms_a_vehicle_that_may_have_armed() -> None:
    disarm = [(m.MAV_CMD_COMPONENT_ARM_DISARM, 0.0)]
    assert orders(ready(HOMEWARD).goodbye()) == []
    ground = arming()
    assert orders(ground.goodbye()) == disarm
    ground.interrupt(Outcome.INTERRUPTED, "", 2.5)
    assert orders(ground.goodbye()) == disarm
    assert orders(flying(HOMEWARD).goodbye()) == []
