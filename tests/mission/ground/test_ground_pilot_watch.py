"""The parts of a live flight, message by message: modes and pilot."""

import pytest

from mission.ground.modes import Maneuver, ModeError, VehicleModes
from mission.ground.pilot_watch import PilotWatch
from mission.link.codec.dialect import mavlink as m


def test_an_unknown_mode_is_named_with_those_that_there_are():
    with pytest.raises(ModeError, match=r"this vehicle: unknown mode 'hover': choose .*GUIDED"):
        VehicleModes(m.MAV_AUTOPILOT_ARDUPILOTMEGA, m.MAV_TYPE_QUADROTOR).numbers("hover")


def beat(custom_mode, *, armed=True):
    base_mode = 209 if armed else 81
    return m.MAVLink_heartbeat_message(
        m.MAV_TYPE_QUADROTOR, m.MAV_AUTOPILOT_ARDUPILOTMEGA, base_mode, custom_mode, 4, 3
    )


AUTO, GUIDED, LOITER, RTL = 3, 4, 5, 6


def flying_watch():
    watch = PilotWatch()
    watch.on_heartbeat(beat(AUTO), 0.0, expects_change=False)
    return watch


def test_a_hold_on_the_way_home_is_told_and_ends_nothing():
    """Another station stopped a vehicle in its landing, and the operator read nothing of it."""
    watch, home = flying_watch(), {"expects_change": True, "flies_home": True}
    for now_s, mode in ((1.0, AUTO), (2.0, RTL), (3.0, LOITER), (4.0, LOITER), (5.0, RTL), (6.0, RTL)):
        watch.on_heartbeat(beat(mode), now_s, **home)
    watch.on_heartbeat(beat(LOITER, armed=False), 7.0, **home)
    assert watch.events == [(3.0, "stopped on its way home: mode LOITER"), (5.0, "goes on home: mode RTL")]
    assert not watch.somebody_else_flies


def test_what_leads_home_or_was_ordered_is_no_hold():
    home = {"expects_change": True, "flies_home": True}
    watch = flying_watch()
    watch.on_heartbeat(beat(LOITER), 1.0, ends_in=("LOITER",), **home)
    watch.on_heartbeat(beat(LOITER), 2.0, expects_change=True)  # the mission is being changed
    assert watch.events == []
    watch.order(Maneuver.HOLD)
    watch.on_heartbeat(beat(LOITER), 3.0, **home)
    assert watch.events == []


@pytest.mark.parametrize("clock_first", [True, False])
def test_a_restart_is_told_once_with_what_it_changed(clock_first):
    watch, up = flying_watch(), beat(LOITER, armed=False)
    if clock_first:
        watch.on_restart(None, 20.0)
        assert watch.events == []
        watch.on_heartbeat(up, 20.5, expects_change=False)
    else:
        watch.on_heartbeat(up, 20.0, expects_change=False, unsure=True)
        assert watch.somebody_else_flies, "at once: nothing is ordered any more"
        assert watch.events == []
        watch.on_restart(up, 20.5)
    watch.on_heartbeat(up, 21.0, expects_change=False)
    text = "its autopilot has started again: mode LOITER, motors off"
    assert watch.events == [(20.5, text)]
    assert watch.ended_by_restart == text


def test_a_pilot_who_came_during_a_silence_is_told_once_it_was_no_restart():
    watch = flying_watch()
    watch.on_heartbeat(beat(LOITER), 20.0, expects_change=False, unsure=True)
    assert watch.events == []
    watch.settle()
    assert watch.events == [(20.0, "taken out of its mission: mode LOITER")]
    assert watch.reason
    watch = flying_watch()
    watch.on_heartbeat(beat(LOITER), 20.0, expects_change=False, unsure=True)
    watch.on_heartbeat(beat(LOITER), 26.0, expects_change=False)
    assert len(watch.events) == 1, "it never told its clock"


def test_an_order_on_the_way_home_that_is_not_obeyed_has_not_ended_the_mission():
    watch = flying_watch()
    watch.order(Maneuver.HOLD)
    watch.on_heartbeat(beat(RTL), 1.0, expects_change=True)
    assert not watch.obeyed
    assert not watch.ended_mission
    assert watch.taken_out, "nothing else is ordered meanwhile"
