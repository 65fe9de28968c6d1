"""One order to one vehicle, message by message."""

import pytest

from mission.ground.command import MotorsStandError, OperatorCommand, VehicleSilentError
from mission.link.codec.dialect import mavlink as m
from wbf_mission.addons.operate.command_session import CommandSession
from wbf_mission.exit_codes import ExitCode, exit_code_of

PX4, ARDUPILOT = m.MAV_AUTOPILOT_PX4, m.MAV_AUTOPILOT_ARDUPILOTMEGA
HOLDING = 3 << 24 | 4 << 16
ARMED = m.MAV_MODE_FLAG_SAFETY_ARMED | m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED


class Vehicle:
    """What a vehicle sends, by hand, to a session whose time is ours."""

    def __init__(self, order, value="", *, autopilot=ARDUPILOT, system_id=1, only=None):
        self.wall_s = 1e5
        command = OperatorCommand(order, value)
        self.session = CommandSession(command, system_id=only, clock=lambda: self.wall_s)
        self.autopilot, self.system_id = autopilot, system_id
        self.now_s, self.sent, self._number = 0.0, [], 0

    def says(self, message, system_id=None):
        message._header = m.MAVLink_header(message.get_msgId(), srcSystem=1, srcComponent=1)
        message._header.srcSystem = self.system_id if system_id is None else system_id
        message._header.seq = self._number % 256
        self._number += 1
        self.sent += self.session.receive(message, self.now_s)

    def beats(self, *, armed=False, mode=0, system_id=None):
        base = ARMED if armed else m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        self.says(
            m.MAVLink_heartbeat_message(m.MAV_TYPE_QUADROTOR, self.autopilot, base, mode, 4, 3), system_id
        )

    def stands(self, *, height_m=0.0, landed=m.MAV_LANDED_STATE_ON_GROUND):
        position = (0, 280000000, -820000000, round(1000 * (20.0 + height_m)), round(1000 * height_m))
        self.says(m.MAVLink_global_position_int_message(*position, 0, 0, 0, 0))
        if landed is not None:
            self.says(m.MAVLink_extended_sys_state_message(0, landed))

    def tells_item(self, seq, total, state=m.MISSION_STATE_ACTIVE):
        self.says(m.MAVLink_mission_current_message(seq, total, state, 1))

    def answers(self, command, result):
        self.says(m.MAVLink_command_ack_message(command, result))

    def warns(self, text, number=0, chunk=0):
        self.says(m.MAVLink_statustext_message(4, text.encode(), number, chunk))

    def passes(self, seconds):
        end_s = self.now_s + seconds
        for _ in range(10_000):
            due_s = self.session.next_deadline()
            if due_s > end_s or self.session.done:
                break
            self.now_s = max(self.now_s, due_s)
            self.sent += self.session.poll(self.now_s)
        else:
            pytest.fail("it polls without end")
        self.now_s = end_s

    def commands(self, kind):
        return [one for one in self.sent if getattr(one, "command", None) == kind]


def test_a_reason_that_follows_the_refusal_is_told():
    vehicle = Vehicle("disarm")
    vehicle.beats(armed=True)
    vehicle.answers(400, m.MAV_RESULT_FAILED)
    vehicle.passes(0.2)
    assert not vehicle.session.done, "ArduPilot's text comes after its answer"
    vehicle.warns("Disarming denied: not landed")
    vehicle.passes(0.2)
    assert str(vehicle.session.error) == "system 1 refused disarm: Disarming denied: not landed"
    assert vehicle.session.texts == [], "what the error says is not said twice"


@pytest.mark.parametrize("landed", [m.MAV_LANDED_STATE_IN_AIR, None])
@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_who_flies_does_not_take_off(autopilot, landed):
    vehicle = Vehicle("takeoff", "30", autopilot=autopilot)
    vehicle.beats(armed=True)
    vehicle.stands(height_m=9.8, landed=landed)
    vehicle.passes(5.0)
    assert "takeoff 30: it flies already, 9.8 m above home in mode " in str(vehicle.session.error)
    assert vehicle.commands(m.MAV_CMD_NAV_TAKEOFF) == []


def test_a_takeoff_from_a_hill_above_home():
    """Standing high above home is not flying, and shown is what was climbed."""
    vehicle = Vehicle("takeoff", "30", autopilot=PX4)
    vehicle.beats(armed=True)
    vehicle.stands(height_m=12.0)
    (order,) = vehicle.commands(m.MAV_CMD_NAV_TAKEOFF)
    assert order.param7 == pytest.approx(50.0), "20 m above the sea, and 30 m"
    vehicle.answers(m.MAV_CMD_NAV_TAKEOFF, m.MAV_RESULT_ACCEPTED)
    vehicle.stands(height_m=12.3, landed=m.MAV_LANDED_STATE_TAKEOFF)
    assert not vehicle.session.done
    vehicle.stands(height_m=12.6, landed=m.MAV_LANDED_STATE_TAKEOFF)
    assert vehicle.session.done
    assert vehicle.session.error is None


@pytest.mark.parametrize(
    ("total", "state", "text"),
    [
        (89, m.MISSION_STATE_ACTIVE, "set-item 300: its mission has 89 items; give 1 to 89"),
        (65535, m.MISSION_STATE_NO_MISSION, "set-item 300: it holds no mission; upload a mission"),
        (0, m.MISSION_STATE_NO_MISSION, "set-item 300: it holds no mission; upload a mission"),
    ],
)
@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_an_item_that_is_not_there_is_refused_at_once(autopilot, total, state, text):
    vehicle = Vehicle("set-item", "300", autopilot=autopilot)
    vehicle.beats()
    vehicle.tells_item(0, total, state)
    assert text in str(vehicle.session.error)
    assert vehicle.commands(m.MAV_CMD_DO_SET_MISSION_CURRENT) == []


def test_who_does_not_count_its_items_is_asked():
    vehicle = Vehicle("set-item", "300")
    vehicle.beats()
    vehicle.tells_item(1, 0, m.MISSION_STATE_UNKNOWN)
    (order,) = vehicle.commands(m.MAV_CMD_DO_SET_MISSION_CURRENT)
    assert order.param1 == 300.0, "home is its item 0"


def test_who_tells_no_item_is_asked_in_the_end():
    vehicle = Vehicle("set-item", "3", autopilot=m.MAV_AUTOPILOT_GENERIC)
    vehicle.beats()
    assert vehicle.commands(m.MAV_CMD_DO_SET_MISSION_CURRENT) == []
    vehicle.passes(4.0)
    assert vehicle.commands(m.MAV_CMD_DO_SET_MISSION_CURRENT)[0].param1 == 2.0


def set_items(vehicle):
    return [one for one in vehicle.sent if isinstance(one, m.MAVLink_mission_set_current_message)]


def test_px4_gets_the_item_by_message_until_it_shows_it():
    vehicle = Vehicle("set-item", "3", autopilot=PX4)
    vehicle.beats()
    for _ in range(5):
        vehicle.tells_item(0, 9)
        vehicle.passes(0.5)
    assert [one.seq for one in set_items(vehicle)] == [2, 2, 2]
    assert vehicle.commands(m.MAV_CMD_DO_SET_MISSION_CURRENT) == []
    vehicle.tells_item(2, 9)
    assert vehicle.session.done
    assert vehicle.session.error is None


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
@pytest.mark.parametrize("skipped", [1, 3])
def test_an_item_that_is_done_at_once_is_ordered_once_and_shown_by_the_item_after_it(autopilot, skipped):
    """A DO item may be a shot or a gripper's: another order would run it again."""
    vehicle = Vehicle("set-item", "5", autopilot=autopilot)
    home = int(autopilot == ARDUPILOT)
    vehicle.beats()
    vehicle.tells_item(home, 20)
    vehicle.passes(0.5)
    vehicle.tells_item(4 + skipped + home, 20)
    vehicle.passes(5.0)
    given = set_items(vehicle) + vehicle.commands(m.MAV_CMD_DO_SET_MISSION_CURRENT)
    assert len(given) == 1
    assert vehicle.session.done and vehicle.session.error is None


@pytest.mark.parametrize("before", [5, 7])
def test_an_item_before_the_present_one_is_ordered_once(before):
    """After DO items from the one ordered, the vehicle reports the item that it reported before."""
    vehicle = Vehicle("set-item", "5", autopilot=PX4)
    vehicle.beats()
    for _ in range(40):
        vehicle.tells_item(before, 20)
        vehicle.passes(0.5)
    assert [one.seq for one in set_items(vehicle)] == [4]
    assert "was given set-item 5, but its telemetry does not confirm" in str(vehicle.session.error)


def ordered_at_the_first_item(item, autopilot):
    vehicle = Vehicle("set-item", item, autopilot=autopilot)
    vehicle.beats()
    vehicle.tells_item(0, 20)
    vehicle.passes(0.3)
    return vehicle


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_an_item_is_not_ordered_again_over_another_stations_choice(autopilot):
    vehicle = ordered_at_the_first_item("9", autopilot)
    for _ in range(40):
        vehicle.tells_item(3, 20)
        vehicle.passes(0.5)
    assert len(set_items(vehicle) + vehicle.commands(m.MAV_CMD_DO_SET_MISSION_CURRENT)) == 1


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_an_item_is_not_ordered_again_while_the_vehicle_is_silent(autopilot):
    vehicle = ordered_at_the_first_item("5", autopilot)
    vehicle.tells_item(0, 20)
    vehicle.passes(30.0)
    assert len(set_items(vehicle) + vehicle.commands(m.MAV_CMD_DO_SET_MISSION_CURRENT)) <= 2


def test_a_takeoff_that_changes_the_mode_is_not_repeated_and_shows_by_its_height():
    vehicle = Vehicle("takeoff", "30", autopilot=PX4)
    vehicle.beats(armed=True, mode=HOLDING)
    vehicle.stands()
    vehicle.beats(armed=True, mode=2 << 24 | 4 << 16)
    vehicle.passes(5.0)
    assert len(vehicle.commands(m.MAV_CMD_NAV_TAKEOFF)) == 1
    vehicle.stands(height_m=1.0, landed=m.MAV_LANDED_STATE_TAKEOFF)
    assert vehicle.session.done
    assert vehicle.session.error is None


@pytest.mark.parametrize(
    ("order", "value", "before", "after", "times"),
    [
        ("hold", "", (True, 5), (True, 17), 1),
        ("hold", "", (True, 17), (True, 5), 1),
        ("hold", "", (True, 5), (True, 5), 2),
        ("hold", "", (True, 17), (True, 17), 2),
        ("mode", "GUIDED", (True, 3), (True, 5), 1),
        ("arm", "", (False, 4), (True, 4), 1),
        ("arm", "", (True, 4), (False, 4), 1),
        ("arm", "", (False, 4), (False, 5), 1),
        ("mission", "", (True, 4), (False, 4), 1),
        ("disarm", "", (True, 4), (False, 4), 1),
        ("disarm", "", (True, 4), (True, 5), 2),
    ],
)
def test_an_unanswered_order_is_not_repeated_once_it_shows_or_a_pilot_has_changed_the_state(
    order, value, before, after, times
):
    vehicle = Vehicle(order, value)
    vehicle.beats(armed=before[0], mode=before[1])
    vehicle.passes(0.5)
    vehicle.beats(armed=after[0], mode=after[1])
    vehicle.passes(1.0)
    given = [one for one in vehicle.sent if isinstance(one, m.MAVLink_command_long_message)]
    assert len([one for one in given if one.command != m.MAV_CMD_SET_MESSAGE_INTERVAL]) == times


def test_an_order_that_was_shown_is_carried_out_though_a_pilot_has_ended_it_since():
    vehicle = Vehicle("arm")
    vehicle.beats(mode=4)
    vehicle.beats(mode=4, armed=True)
    vehicle.beats(mode=4)
    vehicle.passes(2.0)
    assert len(vehicle.commands(m.MAV_CMD_COMPONENT_ARM_DISARM)) == 1
    assert vehicle.session.done
    assert vehicle.session.error is None


def test_an_order_that_was_overruled_fails_in_time_and_is_accepted_late():
    for answers in (True, False):
        vehicle = Vehicle("hold")
        vehicle.beats(mode=3, armed=True)
        vehicle.beats(mode=5, armed=True)
        vehicle.passes(3.0)
        vehicle.beats(mode=3, armed=True)
        vehicle.passes(9.0)
        assert len(vehicle.commands(m.MAV_CMD_DO_SET_MODE)) == 1, "nor when the pilot has left it"
        if answers:
            vehicle.answers(m.MAV_CMD_DO_SET_MODE, m.MAV_RESULT_ACCEPTED)
            vehicle.beats(mode=17, armed=True)
            assert vehicle.session.done
            assert vehicle.session.error is None
        else:
            vehicle.beats(mode=5, armed=True)
            vehicle.passes(9.0)
            text = "system 1: no answer to hold; its mode changed to LOITER"
            assert str(vehicle.session.error) == text
            assert isinstance(vehicle.session.error, VehicleSilentError)


def test_an_item_is_not_sent_again_once_a_pilot_has_changed_the_mode():
    vehicle = Vehicle("set-item", "3", autopilot=PX4)
    vehicle.beats(armed=True, mode=4 << 24 | 4 << 16)
    vehicle.tells_item(0, 9)
    vehicle.beats(armed=True, mode=3 << 16)
    vehicle.passes(5.0)
    assert len(set_items(vehicle)) == 1


def test_a_vehicle_that_has_passed_its_item_since_is_not_sent_back_to_it():
    vehicle = Vehicle("set-item", "3")
    vehicle.beats(armed=True, mode=3)
    vehicle.tells_item(3, 9)
    vehicle.tells_item(4, 9)
    vehicle.passes(5.0)
    assert len(vehicle.commands(m.MAV_CMD_DO_SET_MISSION_CURRENT)) == 1


def test_another_vehicle_is_named():
    vehicle = Vehicle("arm", only=9)
    vehicle.beats()
    vehicle.beats(system_id=4)
    assert vehicle.session.vehicle is None
    assert "only system 1 (ArduPilot), system 4 (ArduPilot)" in str(vehicle.session.search.failure("x", 2.0))


def test_a_mission_starts_the_motors_of_a_px4_only_where_that_was_said():
    vehicle = Vehicle("mission", autopilot=PX4)
    vehicle.beats()
    assert isinstance(vehicle.session.error, MotorsStandError)
    assert "the motors stand still; PX4 starts them and takes off" in str(vehicle.session.error)
    assert vehicle.commands(m.MAV_CMD_MISSION_START) == []
    assert exit_code_of(vehicle.session.error) is ExitCode.BAD_INPUT
    for given in ({"arms": True}, {"autopilot": ARDUPILOT}, {"armed": True}):
        vehicle = Vehicle("mission", autopilot=given.get("autopilot", PX4))
        vehicle.session = CommandSession(OperatorCommand("mission", arms=given.get("arms", False)))
        vehicle.beats(armed=given.get("armed", False))
        assert len(vehicle.commands(m.MAV_CMD_MISSION_START)) == 1


@pytest.mark.parametrize(
    ("order", "command", "mode", "advice"),
    [
        ("arm", 400, 3, "; it arms in GUIDED: give the order mode GUIDED first"),
        ("arm", 400, 0, ""),
        ("takeoff 30", 22, 0, "; it takes off in GUIDED: give the order mode GUIDED first"),
        ("takeoff 30", 22, 4, ""),
    ],
)
def test_who_is_refused_is_told_in_which_mode_it_obeys(order, command, mode, advice):
    vehicle = Vehicle(*order.split())
    vehicle.beats(armed=command != 400, mode=mode)
    vehicle.stands()
    vehicle.warns("not now")
    vehicle.answers(command, m.MAV_RESULT_FAILED)
    vehicle.passes(1.0)
    assert str(vehicle.session.error) == f"system 1 refused {order}: not now{advice}"


@pytest.mark.parametrize("stood_s", [2.1, 600.0])
@pytest.mark.parametrize("hears_first", [True, False])
def test_a_program_that_stood_still_gives_its_order_no_more(stood_s, hears_first):
    """A laptop slept while a vehicle had not answered: people may stand at the vehicle since."""
    vehicle = Vehicle("arm")
    vehicle.beats()
    vehicle.passes(0.5)
    assert len(vehicle.commands(m.MAV_CMD_COMPONENT_ARM_DISARM)) == 1
    before = len(vehicle.sent)
    vehicle.wall_s += stood_s
    vehicle.now_s += stood_s
    if hears_first:
        vehicle.beats()
    vehicle.passes(30.0)
    assert len(vehicle.sent) == before
    assert isinstance(vehicle.session.error, VehicleSilentError)
    assert str(vehicle.session.error) == (
        f"system 1: arm is dropped: the program stood still for {stood_s:.0f} s;"
        " check the vehicle's state, and give the order again"
    )
