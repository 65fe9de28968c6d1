"""Orders of who watches, message by message: what a program that stood still does with them."""

import pytest

from mission.ground.command import OperatorCommand, OrderError
from mission.ground.contact import Contact
from mission.link.codec.dialect import mavlink as m
from wbf_mission.addons.operate.command_session import CommandSession
from wbf_mission.addons.operate.control_station import ControlStation
from wbf_mission.addons.operate.watching import FleetWatch
from wbf_mission.events import EventStream, Noted
from wbf_mission.run.orders import LIFE_S, Orders


class Watched:
    """A vehicle that stands disarmed, a station that gives it orders, and the clock of both."""

    def __init__(self):
        self.wall_s, self.warned, self.sent = 1e5, [], []
        stream = EventStream()
        stream.listen(lambda event: self.warned.append(event.text) if event.warns else None, Noted)
        self.orders = Orders(stream, clock=lambda: self.wall_s)
        self.station = ControlStation(self.orders, clock=lambda: self.wall_s)
        self.says(
            m.MAVLink_heartbeat_message(m.MAV_TYPE_QUADROTOR, m.MAV_AUTOPILOT_ARDUPILOTMEGA, 1, 0, 4, 3)
        )

    def says(self, message, system_id=1):
        message._header = m.MAVLink_header(message.get_msgId(), srcSystem=system_id, srcComponent=1)
        self.sent += self.station.receive(message, self.wall_s)

    def passes(self, seconds, *, at_once=False):
        end_s = self.wall_s + seconds
        while self.wall_s < end_s:
            self.wall_s = end_s if at_once else min(end_s, self.wall_s + 0.1)
            self.sent += self.station.poll(self.wall_s)

    def taken(self, kind=m.MAV_CMD_COMPONENT_ARM_DISARM):
        return [one for one in self.sent if getattr(one, "command", None) == kind]


@pytest.mark.parametrize("stood_s", [LIFE_S + 0.1, 30.0])
def test_an_order_under_way_is_dropped_when_the_program_stood_still(stood_s):
    watched = Watched()
    assert watched.orders.take([1], "start", "", True) == ""
    watched.passes(1.0)
    before = len(watched.sent)
    assert not watched.taken(), "it chooses the mode in which it arms, and waits for the answer"
    watched.wall_s += stood_s
    watched.says(m.MAVLink_command_ack_message(m.MAV_CMD_DO_SET_MODE, m.MAV_RESULT_ACCEPTED))
    watched.says(m.MAVLink_heartbeat_message(m.MAV_TYPE_QUADROTOR, m.MAV_AUTOPILOT_ARDUPILOTMEGA, 1, 4, 4, 3))
    watched.passes(30.0)
    assert not watched.taken(), "it was armed by an old order"
    later = [one for one in watched.sent[before:] if not isinstance(one, m.MAVLink_heartbeat_message)]
    assert later == []
    (warning,) = watched.warned
    assert warning.startswith("start is dropped: the program stood still for ")


def test_an_order_that_waits_while_the_program_stands_still_is_not_begun():
    watched = Watched()
    assert watched.orders.take([1], "arm", "", True) == ""
    watched.passes(30.0, at_once=True)
    watched.passes(5.0)
    assert watched.sent == []
    (warning,) = watched.warned
    assert warning.startswith("ordered by the page: arm: too late: it was given 30 s ago")


def test_a_program_that_goes_on_carries_an_order_out():
    watched = Watched()
    assert watched.orders.take([1], "start", "", True) == ""
    watched.passes(1.0)
    for component, answered in ((190, False), (watched.station.component_id, True)):
        answer = m.MAVLink_command_ack_message(m.MAV_CMD_DO_SET_MODE, 0, 0, 0, 255, component)
        watched.says(answer)
        vehicle = watched.station._vehicles[1]
        assert vehicle.session._accepted is answered
    watched.says(m.MAVLink_heartbeat_message(m.MAV_TYPE_QUADROTOR, m.MAV_AUTOPILOT_ARDUPILOTMEGA, 1, 4, 4, 3))
    watched.passes(1.0)
    assert watched.taken() and not watched.warned


@pytest.mark.parametrize(
    ("system_id", "kind", "autopilot"),
    [
        (0, m.MAV_TYPE_QUADROTOR, m.MAV_AUTOPILOT_PX4),
        (200, m.MAV_TYPE_GCS, m.MAV_AUTOPILOT_PX4),
        (200, m.MAV_TYPE_GIMBAL, m.MAV_AUTOPILOT_INVALID),
        (200, m.MAV_TYPE_ONBOARD_CONTROLLER, m.MAV_AUTOPILOT_PX4),
    ],
)
def test_only_a_vehicle_is_watched_and_takes_orders(system_id, kind, autopilot):
    """An order to system 0 would be an order to every vehicle on the link."""
    watched, watch = Watched(), FleetWatch()
    beat = m.MAVLink_heartbeat_message(kind, autopilot, 1, 0, 4, 3)
    watched.says(beat, system_id)
    watch.receive(beat, 0.0)
    assert not watch.vehicles
    assert "there is no vehicle" in watched.orders.take([system_id], "arm", "", True)
    watched.passes(5.0)
    assert watched.sent == []


@pytest.mark.parametrize(("boots_s", "both"), [((900.0, 30.0), True), ((30.0, 29.0), False)])
def test_two_vehicles_with_one_system_id_get_no_order(boots_s, both):
    """The second case is one vehicle with a message that comes late."""
    watched = Watched()
    for turn in range(10):
        watched.says(m.MAVLink_global_position_int_message(round(1e3 * boots_s[turn % 2]), *[0] * 8))
        watched.passes(0.2)
    assert watched.orders.take([1], "arm", "", True) == ""
    watched.passes(1.0)
    assert bool(watched.taken(m.MAV_CMD_DO_SET_MODE)) is not both
    assert [text for text in watched.warned if "two vehicles use this system id" in text] == watched.warned
    assert len(watched.warned) == both


@pytest.mark.parametrize("given", [{"system_id": 0}, {"contact": Contact((0, 1))}])
def test_an_order_to_system_0_is_refused(given):
    with pytest.raises(OrderError, match="arm: an order to system 0 reaches all vehicles; name one"):
        CommandSession(OperatorCommand("arm"), **given)
