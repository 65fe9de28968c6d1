"""The ground station by itself: what it sends and when it gives up, message by message."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.ground.arming_gate import ArmingGate
from mission.ground.change import ChangeOutcome, ChangeRecord
from mission.ground.contact import Contact
from mission.ground.failure_watch import FailureWatch
from mission.ground.modes import Maneuver
from mission.ground.orders import NotFlyingError
from mission.ground.station import GroundStation
from mission.ground.texts import TextLog
from mission.ground.vehicle_state import Battery, VehicleMonitor
from mission.link.codec.dialect import mavlink as m
from mission.model import Command, GeoPoint, Mission, MissionItem
from mission.outcome import Outcome, Phase
from mission.transfer import MissionServer

MISSION = Mission(
    (
        MissionItem(Command.NAV_TAKEOFF, 3, param4=None, x=28.05, y=-82.15, z=5.0),
        MissionItem.waypoint(28.051, -82.15, 5.0),
        MissionItem(Command.NAV_RETURN_TO_LAUNCH),
    ),
    GeoPoint(28.05, -82.15, 30.0),
)


def from_vehicle(message: Any, component: int = 1) -> Any:
    message.pack(m.MAVLink(None, 1, component))
    return message


def heartbeat(*, armed: bool = False) -> Any:
    mode = m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (m.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0)
    return from_vehicle(m.MAVLink_heartbeat_message(2, m.MAV_AUTOPILOT_PX4, mode, 0, 4, 3))


def ack(command: int, result: int = 0) -> Any:
    return from_vehicle(m.MAVLink_command_ack_message(command, result))


def commands(messages: list[Any]) -> list[int]:
    return [message.command for message in messages if message.get_type() == "COMMAND_LONG"]


def uploaded(ground: GroundStation) -> list[Any]:
    """Let the ground station upload to a vehicle's mission server; return what it sends then."""
    server = MissionServer(1, 1)
    queue = ground.receive(heartbeat(), 1.0)
    for _ in range(200):
        if not queue or ground.phase is Phase.ARM:
            break
        replies = []
        for message in queue:
            message.pack(m.MAVLink(None, ground.system_id, ground.component_id))
            replies += server.receive(message, 1.0).messages
        queue = [out for reply in replies for out in ground.receive(from_vehicle(reply), 1.0)]
    assert ground.phase is Phase.ARM
    assert ground.transfers[0].verified
    return queue


def test_it_sends_a_heartbeat_each_second_and_gives_up_without_a_vehicle() -> None:
    ground = GroundStation(MISSION)
    beats = 0
    for tenth in range(400):
        beats += sum(message.get_type() == "HEARTBEAT" for message in ground.poll(tenth / 10))
    assert ground.outcome is Outcome.NO_CONTACT
    assert 30 <= beats <= 41


def test_commands_are_repeated_until_answered_then_given_up() -> None:
    ground = GroundStation(MISSION)
    first = uploaded(ground)
    confirmations = [message.confirmation for message in first if message.get_type() == "COMMAND_LONG"]
    for tenth in range(12, 100):
        confirmations += [x.confirmation for x in ground.poll(tenth / 10) if x.get_type() == "COMMAND_LONG"]
    assert confirmations == [0, 1, 2, 3]
    assert ground.outcome is Outcome.ARMING_REFUSED
    assert ground.reason == "no answer"


def test_nothing_goes_up_that_the_autopilot_would_refuse() -> None:
    turns = MissionItem(Command.NAV_LOITER_TURNS, 3, 2.0, x=28.05, y=-82.15, z=5.0)
    bad = Mission((MISSION.items[0], turns, MISSION.items[2]), MISSION.home)
    ground = GroundStation(bad)
    out = ground.receive(heartbeat(), 1.0)
    assert not [message for message in out if message.get_type() == "MISSION_COUNT"]
    assert ground.outcome is Outcome.UPLOAD_FAILED
    assert "mission item 2 (NAV_LOITER_TURNS)" in ground.reason
    forced = GroundStation(bad, force=True)
    assert [x.count for x in forced.receive(heartbeat(), 1.0) if x.get_type() == "MISSION_COUNT"] == [3]


@pytest.mark.parametrize(("state", "outcome"), [(5, Outcome.COMPLETED), (3, Outcome.FLIGHT_ABORTED)])
def test_disarming_ends_the_flight_by_the_missions_state(state: int, outcome: Outcome) -> None:
    ground = GroundStation(MISSION)
    uploaded(ground)
    ground.receive(ack(m.MAV_CMD_COMPONENT_ARM_DISARM), 1.2)
    ground.receive(ack(m.MAV_CMD_MISSION_START), 1.3)
    ground.receive(heartbeat(armed=False), 1.4)
    assert not ground.done, "a heartbeat from before the arming says nothing"
    ground.receive(heartbeat(armed=True), 2.0)
    ground.receive(from_vehicle(m.MAVLink_mission_current_message(2, 3, state, 1)), 90.0)
    for time_s, height_m in ((60.0, 5.0), (88.0, 0.0), (89.0, 0.0)):
        if time_s == 89.0:
            ground.receive(from_vehicle(m.MAVLink_extended_sys_state_message(0, 1)), 88.6)
        fix = m.MAVLink_global_position_int_message(
            round(time_s * 1e3), 280500000, -821500000, 30000, round(height_m * 1e3), 0, 0, 0, 0
        )
        ground.receive(from_vehicle(fix), time_s)
    ground.receive(heartbeat(armed=False), 91.0)
    ground.poll(94.0)
    assert ground.outcome is outcome
    assert ground.flight_time_s == pytest.approx(88.0 - 1.3), "until it tells that it has landed"


def test_another_vehicle_on_the_link_changes_nothing():
    ground = GroundStation(MISSION)
    uploaded(ground)
    before = (ground.phase, ground.vehicle_state.battery.remaining, ground.texts)
    for message in (
        m.MAVLink_heartbeat_message(2, m.MAV_AUTOPILOT_PX4, 128, 0, 4, 3),
        m.MAVLink_mission_current_message(3, 3, 5, 1),
        m.MAVLink_global_position_int_message(0, 0, 0, 0, 0, 0, 0, 0, 0),
        m.MAVLink_extended_sys_state_message(0, 2),
        m.MAVLink_hil_state_quaternion_message(0, [1.0, 0, 0, 0], 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0),
        m.MAVLink_sys_status_message(0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0),
        m.MAVLink_battery_status_message(0, 0, 0, 0, [65535] * 10, -1, -1, 500, 1),
        m.MAVLink_statustext_message(3, b"Crash"),
        m.MAVLink_command_ack_message(m.MAV_CMD_COMPONENT_ARM_DISARM, m.MAV_RESULT_DENIED),
    ):
        message.pack(m.MAVLink(None, 9, 1))
        assert ground.receive(message, 2.0) == []
    assert (ground.phase, ground.vehicle_state.battery.remaining, ground.texts) == before


def test_control_characters_of_a_text_are_not_told() -> None:
    log = TextLog()
    log.on_text(m.MAVLink_statustext_message(6, b"Mission finished\t"), 1.0)
    log.on_text(m.MAVLink_statustext_message(4, b"x" * 50, 7, 0), 2.0)
    log.on_text(m.MAVLink_statustext_message(4, b"y\x1b\t", 7, 1), 2.1)
    assert [text for _, _, text in log.texts] == ["Mission finished", "x" * 50 + "y"]


def test_the_oldest_of_very_many_texts_are_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mission.ground.texts._MOST_TEXTS", 4)
    log = TextLog()

    def says(text: bytes, number: int, chunk: int) -> None:
        log.on_text(m.MAVLink_statustext_message(4, text, number, chunk), 1.0)

    says(b"a", 7, 0)
    for text in ("second", "third", "fourth", "fifth"):
        log.note(text, 2.0)
    says(b"of a text that is dropped", 7, 1)
    assert [text for _, _, text in log.texts] == ["third", "fourth", "fifth"]
    says(b"c", 8, 0)
    says(b"d", 8, 1)
    assert [text for _, _, text in log.since(1)] == ["third", "fourth", "fifth", "cd"]
    assert (log.count, log.since(5), log.begun_until(0)) == (6, log.texts[3:], (log.texts, 6))


def test_a_battery_of_a_payload_is_not_the_motors() -> None:
    monitor, watch = VehicleMonitor(), FailureWatch()

    def reads_of(battery_id: int, function: int, percent: int, used_hj: int = -1) -> None:
        rest = ([65535] * 10, -1, -1, used_hj, percent)
        message = m.MAVLink_battery_status_message(battery_id, function, 0, 0, *rest)
        monitor.receive(message, 0.0)
        watch.on_battery_status(message)

    reads_of(0, m.MAV_BATTERY_FUNCTION_PROPULSION, 15, 500)
    reads_of(1, 4, 0, 900)
    assert (monitor.battery, watch.empty_battery) == (Battery(0.15, 500 / 36.0), False)
    reads_of(2, m.MAV_BATTERY_FUNCTION_PROPULSION, 95)
    assert (monitor.battery.remaining, monitor.battery_percent) == (0.15, 15), "the lowest counts"
    reads_of(0, m.MAV_BATTERY_FUNCTION_PROPULSION, 97)
    assert monitor.battery.remaining == 0.95


ARMED = m.MAV_MODE_FLAG_SAFETY_ARMED


def beat(*, armed: bool) -> Any:
    return m.MAVLink_heartbeat_message(2, 12, ARMED if armed else 0, 0, 3, 3)


def reads(percent: int, used_hj: int = -1) -> Any:
    return m.MAVLink_battery_status_message(0, 0, 0, 0, [65535] * 10, -1, -1, used_hj, percent)


def test_what_a_flight_took_of_a_battery_that_is_full_again_once_it_is_disarmed() -> None:
    """PX4's simulator fills it then; this is the order in which a real one tells it."""
    monitor = VehicleMonitor()
    told = [beat(armed=False), reads(100), beat(armed=True), reads(98)]
    for message in told:
        monitor.receive(message, 0.0)
    before = monitor.battery
    monitor.begin_flight()
    for message in [reads(70), reads(49), reads(51), beat(armed=False), reads(93), reads(100)]:
        monitor.receive(message, 1.0)
    assert monitor.lowest_battery == Battery(0.49)
    assert monitor.lowest_battery.used_since(before, 80.0) == pytest.approx(0.49)
    assert monitor.battery == Battery(1.0), "the next sortie goes by what it reads now"


@given(
    st.lists(
        st.tuples(st.booleans(), st.integers(-1, 100), st.one_of(st.just(-1), st.integers(0, 10**6))),
        max_size=20,
    )
)
def test_the_lowest_reading_with_running_motors_and_the_most_energy_count(
    told: list[tuple[bool, int, int]],
) -> None:
    monitor, left, used = VehicleMonitor(), [], []
    monitor.receive(reads(90, 5), 0.0)
    monitor.begin_flight()
    known = (90, 5)
    for armed, percent, hectojoules in told:
        monitor.receive(beat(armed=armed), 1.0)
        monitor.receive(reads(percent, hectojoules), 1.0)
        known = (percent if percent >= 0 else known[0], hectojoules if hectojoules >= 0 else known[1])
        left += [known[0] / 100.0] * armed
        used.append(known[1] / 36.0)
    lowest = monitor.lowest_battery
    assert lowest.remaining == min([0.9, *left])
    assert lowest.consumed_wh == pytest.approx(max([5 / 36.0, *used]))


# What the operator may order of a vehicle in flight: out of its mission and back, and another item of it.

AUTOPILOTS = {
    "px4": (
        m.MAV_AUTOPILOT_PX4,
        {
            "MISSION": 4 << 24 | 4 << 16,
            "LOITER": 3 << 24 | 4 << 16,
            "POSCTL": 3 << 16,
            "RTL": 5 << 24 | 4 << 16,
            "LAND": 6 << 24 | 4 << 16,
        },
    ),
    "ardupilot": (
        m.MAV_AUTOPILOT_ARDUPILOTMEGA,
        {"MISSION": 3, "LOITER": 17, "POSCTL": 5, "RTL": 6, "LAND": 9},
    ),
}


class Flight:
    """A ground station whose vehicle flies its mission."""

    def __init__(self, name="px4"):
        self.autopilot, self.modes = AUTOPILOTS[name]
        self.now_s, self.ground = 1.2, GroundStation(MISSION)
        uploaded(self.ground)
        self.ground.receive(ack(m.MAV_CMD_COMPONENT_ARM_DISARM), 1.2)
        self.ground.receive(ack(m.MAV_CMD_MISSION_START), 1.3)
        self.beats("MISSION")

    def hears(self, message):
        self.now_s += 0.1
        return self.ground.receive(from_vehicle(message), self.now_s)

    def beats(self, mode, *, armed=True):
        flags = m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (m.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0)
        self.hears(m.MAVLink_heartbeat_message(2, self.autopilot, flags, self.modes[mode], 4, 3))

    def takes(self, kind):
        (order,) = self.ground.maneuver(kind, self.now_s)
        self.hears(m.MAVLink_command_ack_message(order.command, 0))
        return order


@pytest.mark.parametrize("name", AUTOPILOTS)
@pytest.mark.parametrize(
    ("mode", "armed", "orders", "note"),
    [
        ("MISSION", True, 1, None),
        ("LOITER", True, 0, None),
        ("POSCTL", True, 0, "mode POSCTL since: the vehicle did not take the order"),
        ("MISSION", False, 0, "disarmed since: the vehicle did not take the order"),
    ],
)
def test_an_unanswered_order_is_not_repeated_once_a_pilot_has_acted(name, mode, armed, orders, note):
    flight = Flight(name)
    flight.ground.poll(flight.now_s)
    (order,) = flight.ground.maneuver(Maneuver.HOLD, flight.now_s - 0.5)
    assert flight.ground.next_deadline() == flight.now_s + 0.5, "earlier than the next HEARTBEAT"
    flight.beats(mode, armed=armed)
    flight.now_s += 1.5
    assert commands(flight.ground.poll(flight.now_s)) == [order.command] * orders
    flight.beats(mode, armed=armed)
    assert flight.ground.pilot.somebody_else_flies is (mode == "POSCTL")
    shown = [text for _, _, text in flight.ground.texts if "did not take the order" in text]
    assert [text.replace("LOITER", "POSCTL") for text in shown] == [note] * (note is not None)


def test_an_order_is_repeated_after_the_mission_has_ended() -> None:
    flight = Flight("px4")
    (order,) = flight.ground.maneuver(Maneuver.HOLD, flight.now_s)
    flight.beats("RTL")
    assert commands(flight.ground.poll(flight.now_s + 1.5)) == [order.command]


@pytest.mark.parametrize("name", AUTOPILOTS)
def test_an_order_is_repeated_after_the_mode_of_the_order_before_it(name):
    flight = Flight(name)
    flight.ground.maneuver(Maneuver.HOLD, flight.now_s)
    (order,) = flight.ground.maneuver(Maneuver.LAND, flight.now_s)
    flight.beats("LOITER")
    assert commands(flight.ground.poll(flight.now_s + 1.5)) == [order.command]


def test_an_answer_to_another_ground_station_is_no_answer():
    flight = Flight()
    (order,) = flight.ground.maneuver(Maneuver.HOLD, flight.now_s)
    for other in ((200, 190), (200, 0), (255, 230)):
        flight.hears(m.MAVLink_command_ack_message(order.command, m.MAV_RESULT_DENIED, 0, 0, *other))
        assert flight.ground.pilot.ordered is Maneuver.HOLD
    flight.hears(m.MAVLink_command_ack_message(order.command, m.MAV_RESULT_DENIED, 0, 0, 255, 190))
    assert flight.ground.pilot.ordered is None


def test_the_answer_to_a_disarm_of_another_program_of_our_system_starts_no_mission():
    ground = GroundStation(MISSION, system_id=255, component_id=25)
    uploaded(ground)
    for target in ((255, 230), (255, 190)):
        other = m.MAVLink_command_ack_message(m.MAV_CMD_COMPONENT_ARM_DISARM, 0, 0, 0, *target)
        assert ground.receive(from_vehicle(other), 1.1) == [] and ground.phase is Phase.ARM
    ours = m.MAVLink_command_ack_message(m.MAV_CMD_COMPONENT_ARM_DISARM, 0, 0, 0, 255, 25)
    assert commands(ground.receive(from_vehicle(ours), 1.2)) == [m.MAV_CMD_MISSION_START]


@pytest.mark.parametrize(
    ("mode", "armed", "phase", "orders"),
    [
        ("LOITER", True, Phase.START, 1),
        ("MISSION", True, Phase.FLIGHT, 0),
        ("POSCTL", True, Phase.DONE, 0),
        ("LOITER", False, Phase.DONE, 0),
        ("MISSION", False, Phase.DONE, 0),
    ],
)
def test_an_unanswered_start_is_not_repeated_once_the_vehicle_flies_or_has_a_pilot(
    mode, armed, phase, orders
):
    ground = GroundStation(MISSION)
    uploaded(ground)
    flags = m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED

    def beats(name, is_armed, now_s):
        base = flags | (m.MAV_MODE_FLAG_SAFETY_ARMED if is_armed else 0)
        number = AUTOPILOTS["px4"][1][name]
        beat = m.MAVLink_heartbeat_message(2, m.MAV_AUTOPILOT_PX4, base, number, 4, 3)
        ground.receive(from_vehicle(beat), now_s)

    beats("LOITER", True, 1.1)
    assert commands(ground.receive(ack(m.MAV_CMD_COMPONENT_ARM_DISARM), 1.2)) == [m.MAV_CMD_MISSION_START]
    beats(mode, armed, 1.5)
    assert commands(ground.poll(2.5)) == [m.MAV_CMD_MISSION_START] * orders
    assert ground.phase is phase


@pytest.mark.parametrize("name", AUTOPILOTS)
def test_it_goes_on_with_its_mission_after_a_hold(name):
    flight = Flight(name)
    with pytest.raises(NotFlyingError, match="the vehicle flies its mission"):
        flight.ground.maneuver(Maneuver.RESUME, flight.now_s)
    flight.takes(Maneuver.HOLD)
    flight.beats("LOITER")
    assert flight.ground.pilot.obeyed.startswith("holds")
    order = flight.takes(Maneuver.RESUME)
    assert order.command == m.MAV_CMD_DO_SET_MODE, "MISSION_START would begin anew"
    flight.beats("LOITER")
    assert flight.ground.pilot.taken_out and not flight.ground.pilot.obeyed
    flight.beats("MISSION")
    pilot = flight.ground.pilot
    assert not pilot.taken_out and pilot.ordered is None and not pilot.events, "nobody else flew it"


@pytest.mark.parametrize("name", AUTOPILOTS)
@pytest.mark.parametrize(
    ("kind", "modes"),
    [(Maneuver.HOLD, ["LOITER"]), (Maneuver.RETURN, ["RTL", "LAND"])],
    ids=["hold", "return"],
)
def test_a_pilot_who_takes_over_after_an_obeyed_order_keeps_the_vehicle(name, kind, modes):
    flight = Flight(name)
    pilot = flight.ground.pilot
    flight.takes(kind)
    for mode in modes:
        flight.beats(mode)
    assert pilot.obeyed and not pilot.somebody_else_flies and not pilot.events
    flight.beats("POSCTL")
    assert pilot.somebody_else_flies and not pilot.obeyed and pilot.ordered is None
    assert pilot.events[-1][1].startswith("taken out of its mission: mode ")
    with pytest.raises(NotFlyingError, match="somebody else flies"):
        flight.ground.choose_item(1, flight.now_s)
    with pytest.raises(NotFlyingError, match="somebody else flies"):
        flight.ground.maneuver(Maneuver.RESUME, flight.now_s)


def test_a_pilot_who_takes_over_while_an_order_to_resume_waits_keeps_the_vehicle():
    flight = Flight()
    flight.takes(Maneuver.HOLD)
    flight.beats("LOITER")
    flight.ground.maneuver(Maneuver.RESUME, flight.now_s)
    flight.beats("POSCTL")
    flight.now_s += 1.5
    assert commands(flight.ground.poll(flight.now_s)) == []
    flight.beats("POSCTL")
    assert flight.ground.pilot.somebody_else_flies


def test_who_does_not_go_on_still_holds_for_us():
    flight = Flight()
    flight.takes(Maneuver.HOLD)
    flight.beats("LOITER")
    flight.ground.maneuver(Maneuver.RESUME, flight.now_s)
    flight.hears(m.MAVLink_command_ack_message(m.MAV_CMD_DO_SET_MODE, m.MAV_RESULT_DENIED))
    flight.beats("LOITER")
    assert flight.ground.pilot.ordered is Maneuver.HOLD
    assert not flight.ground.pilot.somebody_else_flies
    assert flight.ground.texts[-1][2] == "denied: the vehicle did not take the order"


def test_nobody_goes_on_with_a_mission_that_came_in_part():
    flight = Flight()
    flight.hears(m.MAVLink_mission_current_message(1, 3, m.MISSION_STATE_ACTIVE, 1))
    flight.ground.change(MISSION, 1, flight.now_s)
    flight.takes(Maneuver.HOLD)
    flight.beats("LOITER")
    for order in (
        lambda at: flight.ground.maneuver(Maneuver.RESUME, at),
        lambda at: flight.ground.choose_item(1, at),
    ):
        with pytest.raises(NotFlyingError, match="its mission is unknown"):
            order(flight.now_s)
    assert flight.takes(Maneuver.RETURN).command == 20


def real() -> GroundStation:
    """A ground station of a real vehicle, whose operator has agreed."""
    return GroundStation(MISSION, arming_gate=ArmingGate((1, 1), agreed=True, clock=lambda: 0.0))


@pytest.mark.parametrize("when", [Phase.CONTACT, Phase.UPLOAD, Phase.READY])
def test_a_vehicle_whose_motors_run_is_left_alone(when: Phase) -> None:
    ground = real()
    if when is not Phase.CONTACT:
        ground.receive(heartbeat(), 1.0)
        ground.phase = when
    sent = ground.receive(heartbeat(armed=True), 2.0) + ground.poll(2.1) + ground.goodbye()
    assert ground.outcome is Outcome.NOT_STARTED
    assert [one.get_type() for one in sent] == ["HEARTBEAT"]
    assert ground.reason.startswith("the motors run, but not by this program: somebody else flies")


def test_a_vehicle_whose_motors_run_is_flown_by_force() -> None:
    gate = ArmingGate((1, 1), agreed=True)
    ground = GroundStation(MISSION, arming_gate=gate, force=True)
    sent = ground.receive(heartbeat(armed=True), 1.0)
    assert ground.phase is Phase.UPLOAD and any(one.get_type().startswith("MISSION") for one in sent)


@pytest.mark.parametrize(
    ("apart_s", "flies", "ends"), [(0.2, False, True), (20.0, False, False), (0.2, True, False)]
)
def test_two_vehicles_with_one_system_id_are_not_started(apart_s: float, flies: bool, ends: bool) -> None:
    """The second case is one vehicle that is started again and again; in flight, nothing is undone."""
    ground = real()
    ground.receive(heartbeat(), 1.0)
    ground.phase = Phase.FLIGHT if flies else ground.phase
    for turn in range(9):
        ground.receive(from_vehicle(at(900_000 if turn % 2 else 30_000)), 1.0 + turn * apart_s)
    assert (ground.outcome is Outcome.NOT_STARTED) is ends
    assert not ends or ground.reason.startswith(
        "two vehicles use this system id, and both would obey; give each"
    )


def test_the_answer_to_an_order_does_not_confirm_the_order_after_it() -> None:
    flight = Flight()
    (hold,) = flight.ground.maneuver(Maneuver.HOLD, flight.now_s)
    flight.beats("LOITER")
    (resume,) = flight.ground.maneuver(Maneuver.RESUME, flight.now_s)
    assert hold.command == resume.command
    flight.hears(m.MAVLink_command_ack_message(hold.command, 0))
    assert commands(flight.ground.poll(flight.now_s + 1.1)) == [resume.command], "it is not answered yet"
    flight.hears(m.MAVLink_command_ack_message(hold.command, 0))
    assert commands(flight.ground.poll(flight.now_s + 5.0)) == []


def test_an_order_that_follows_an_answered_or_a_forgotten_order_is_confirmed_at_once() -> None:
    for answers, later_s in ((True, 0.0), (False, 30.0)):
        flight = Flight()
        (order,) = flight.ground.maneuver(Maneuver.HOLD, flight.now_s)
        if answers:
            flight.hears(m.MAVLink_command_ack_message(order.command, 0))
        flight.beats("LOITER")
        flight.now_s += later_s
        flight.takes(Maneuver.RESUME)
        assert commands(flight.ground.poll(flight.now_s + 1.5)) == []


def at(boot_ms: int) -> m.MAVLink_global_position_int_message:
    return m.MAVLink_global_position_int_message(boot_ms, *[0] * 8)


@pytest.mark.parametrize(
    ("later_s", "total", "mission_id", "told"),
    [
        (6.0, 36, 7, " (36 items)"),
        (6.0, 3, 9, " (3 items)"),
        (6.0, 3, 7, None),
        (6.0, 0, 0, None),
        (1.0, 36, 9, None),
    ],
)
def test_a_mission_of_another_station_is_told_and_not_completed(later_s, total, mission_id, told):
    """The last case is the mission before, which the vehicle still reports at the start."""

    def current(seq, total, mission_id, state=m.MISSION_STATE_ACTIVE):
        return m.MAVLink_mission_current_message(seq, total, state, 1, mission_id)

    flight = Flight()
    flight.ground.arming_gate = ArmingGate((1, 1), agreed=True)
    flight.hears(current(1, 3, 7))
    flight.now_s += later_s
    flight.hears(at(60_000))  # No reboot was hidden by the silence
    for _ in range(2):
        flight.hears(current(1, total, mission_id))
    events = [text for _, text in flight.ground.pilot.events]
    text = f"taken out of its mission: another station has sent another mission{told}"
    assert events == [text] * (told is not None)
    if told is None:
        flight.ground.choose_item(1, flight.now_s)
        return
    for order in (
        lambda: flight.ground.choose_item(1, flight.now_s),
        lambda: flight.ground.change(MISSION, 1, flight.now_s),
    ):
        with pytest.raises(NotFlyingError, match="another station has sent another mission, so its mission"):
            order()
    flight.hears(current(total, total, mission_id, 5))
    flight.beats("MISSION", armed=False)
    flight.ground.poll(flight.now_s + 20.0)
    assert (flight.ground.outcome, flight.ground.reason) == (Outcome.PILOT_TOOK_OVER, text)


@pytest.mark.parametrize("rebooted", [True, False])
def test_a_reboot_that_empties_the_mission_is_no_mission_of_another_station(rebooted):
    empty = m.MAVLink_mission_current_message(0, 0xFFFF, m.MISSION_STATE_NO_MISSION, 1, 0)
    flight = Flight()
    flight.ground.arming_gate = ArmingGate((1, 1), agreed=True)
    flight.hears(at(60_000))
    flight.hears(m.MAVLink_mission_current_message(1, 3, m.MISSION_STATE_ACTIVE, 1, 7))
    flight.now_s += 10.0
    flight.hears(empty)
    assert not flight.ground.pilot.replaced, "not before the clock shows whether it was a reboot"
    flight.hears(at(500 if rebooted else 70_200))
    flight.hears(empty)
    flight.beats("LOITER" if rebooted else "MISSION", armed=not rebooted)
    flight.hears(empty)
    events = [text for _, text in flight.ground.pilot.events]
    if rebooted:
        assert events == ["its autopilot has started again: mode LOITER, motors off"]
    else:
        assert events == ["taken out of its mission: another station has sent another mission (0 items)"]


def test_nobody_else_sends_missions_to_a_simulated_vehicle() -> None:
    flight = Flight()
    for total in (3, 36):
        flight.now_s += 6.0
        flight.hears(m.MAVLink_mission_current_message(1, total, m.MISSION_STATE_ACTIVE))
    assert flight.ground.pilot.events == []


@pytest.mark.parametrize(("outcome", "told"), [(ChangeOutcome.DONE, True), (ChangeOutcome.GIVEN_UP, False)])
def test_after_a_change_that_failed_the_vehicle_may_hold_either_mission_of_ours(outcome, told):
    flight = Flight()
    flight.ground.arming_gate = ArmingGate((1, 1), agreed=True)
    flight.hears(m.MAVLink_mission_current_message(1, 3, m.MISSION_STATE_ACTIVE, 1, 7))
    flight.ground.changes.append(ChangeRecord(7, 1, ended_s=flight.now_s, outcome=outcome))
    flight.now_s += 10.0
    flight.hears(at(60_000))
    # The first report after the change, which may come late, has the new id.
    for total, mission_id in ((3, 9), (3, 9), (7, 9)):
        assert not flight.ground.pilot.replaced
        flight.hears(m.MAVLink_mission_current_message(1, total, m.MISSION_STATE_ACTIVE, 1, mission_id))
    assert flight.ground.pilot.replaced is told


def test_a_vehicle_with_a_mission_of_another_station_still_takes_an_order_to_hold():
    flight = Flight()
    flight.ground.pilot.on_other_mission(None, flight.now_s)
    assert commands(flight.ground.maneuver(Maneuver.HOLD, flight.now_s))


@pytest.mark.parametrize("name", AUTOPILOTS)
@pytest.mark.parametrize(
    ("after_s", "mode", "is_ours"), [(5, "LOITER", 1), (60, "LOITER", 0), (5, "POSCTL", 0)]
)
def test_an_unanswered_order_that_is_obeyed_late_is_no_takeover(name, after_s, mode, is_ours):
    flight = Flight(name)
    flight.ground.arming_gate = ArmingGate((1, 1), agreed=True)
    home = flight.autopilot == m.MAV_AUTOPILOT_ARDUPILOTMEGA
    flight.hears(m.MAVLink_mission_current_message(1 + home, 3, m.MISSION_STATE_ACTIVE, 1))
    flight.beats("MISSION")
    flight.ground.maneuver(Maneuver.HOLD, flight.now_s)
    while "did not take the order" not in str(flight.ground.texts):
        flight.now_s += 1.0
        flight.ground.poll(flight.now_s)
    flight.now_s += after_s
    flight.beats(mode)
    flight.ground.poll(flight.now_s + 6.0)
    assert flight.ground.pilot.somebody_else_flies is not bool(is_ours)
    assert bool(flight.ground.pilot.obeyed) is bool(is_ours)
    if is_ours:
        assert flight.takes(Maneuver.RESUME)


def test_a_pilots_hold_after_an_unanswered_order_to_hold_is_the_pilots():
    flight = Flight()
    flight.ground.arming_gate = ArmingGate((1, 1), agreed=True)
    flight.hears(m.MAVLink_mission_current_message(1, 3, m.MISSION_STATE_ACTIVE, 1))
    flight.beats("MISSION")
    flight.ground.pilot.on_no_answer(Maneuver.HOLD, flight.now_s)
    for mode in ("POSCTL", "LOITER"):
        flight.beats(mode)
        assert flight.ground.pilot.somebody_else_flies


def test_another_item_is_chosen_as_the_autopilot_takes_it():
    flight = Flight("px4")
    flight.hears(m.MAVLink_mission_current_message(0, 3, m.MISSION_STATE_ACTIVE, 1))
    (message,) = flight.ground.choose_item(1, flight.now_s)
    assert (message.get_type(), message.seq) == ("MISSION_SET_CURRENT", 1)
    flight.hears(m.MAVLink_mission_current_message(0, 3, m.MISSION_STATE_ACTIVE, 1))
    again = flight.ground.poll(flight.now_s + 1.5)
    assert any(one.get_type() == "MISSION_SET_CURRENT" for one in again), "nothing answers it"
    flight.hears(m.MAVLink_mission_current_message(1, 3, m.MISSION_STATE_ACTIVE, 1))
    later = flight.ground.poll(flight.now_s + 4.0)
    assert not any(one.get_type() == "MISSION_SET_CURRENT" for one in later), "it shows it"
    assert not flight.ground.pilot.taken_out


@pytest.mark.parametrize("heard", [2, None])
@pytest.mark.parametrize("name", AUTOPILOTS)
def test_a_chosen_item_that_was_passed_unheard_does_not_turn_the_vehicle_back(name, heard):
    flight = Flight(name)
    home = flight.autopilot == m.MAV_AUTOPILOT_ARDUPILOTMEGA
    flight.hears(m.MAVLink_mission_current_message(home, 3, m.MISSION_STATE_ACTIVE, 1))
    flight.ground.choose_item(1, flight.now_s)
    if heard is not None:
        flight.hears(m.MAVLink_mission_current_message(heard + home, 3, m.MISSION_STATE_ACTIVE, 1))
    begun_s = flight.now_s
    sent = [message for second in range(1, 31) for message in flight.ground.poll(begun_s + second)]
    assert not [one for one in sent if one.get_type() in ("MISSION_SET_CURRENT", "COMMAND_LONG")]
    notes = [text for _, _, text in flight.ground.texts]
    assert notes == ["no answer: the vehicle did not take the order"] * (heard is None)


def test_a_chosen_item_is_not_ordered_again_over_another_stations_choice():
    flight = Flight("px4")
    flight.hears(m.MAVLink_mission_current_message(2, 3, m.MISSION_STATE_ACTIVE, 1))
    flight.ground.choose_item(1, flight.now_s)
    flight.hears(m.MAVLink_mission_current_message(0, 3, m.MISSION_STATE_ACTIVE, 1))
    sent = [message for second in range(1, 31) for message in flight.ground.poll(flight.now_s + second)]
    assert not [one for one in sent if one.get_type() == "MISSION_SET_CURRENT"]


def test_an_order_without_a_flight_mode_is_refused_and_the_change_goes_on():
    """A quadplane (type 20) has no BRAKE."""
    flight = Flight("ardupilot")
    flight.hears(m.MAVLink_mission_current_message(1, 3, m.MISSION_STATE_ACTIVE, 1))
    flight.hears(m.MAVLink_heartbeat_message(20, flight.autopilot, 129, 10, 4, 3))
    flight.ground.change(MISSION, 1, flight.now_s)
    with pytest.raises(
        NotFlyingError, match=r"^the vehicle has no flight mode to hold; the order was not sent"
    ):
        flight.ground.maneuver(Maneuver.HOLD, flight.now_s)
    assert flight.ground.changing and flight.ground.pilot.ordered is None
    assert commands(flight.ground.maneuver(Maneuver.RETURN, flight.now_s)) == [20]


def test_an_item_that_there_is_not_is_refused():
    flight = Flight()
    with pytest.raises(NotFlyingError, match="item 4 does not exist; there are 3 items"):
        flight.ground.choose_item(3, flight.now_s)
    with pytest.raises(NotFlyingError, match="the vehicle does not fly"):
        GroundStation(MISSION).maneuver(Maneuver.HOLD, 1.0)
    with pytest.raises(NotFlyingError, match="the vehicle does not fly"):
        GroundStation(MISSION).choose_item(0, 0.0)
    assert commands(flight.ground.maneuver(Maneuver.LAND, flight.now_s)) == [21]


@pytest.mark.parametrize(
    ("sequence", "later_s", "counts"),
    [(249, 0.1, False), (6, 0.1, True), (200, 0.1, True), (249, 2.5, True), (1, 0.1, False)],
)
def test_a_mode_or_item_that_newer_frames_overtook_is_no_news(sequence, later_s, counts):
    """The last frame has the number 2: 249 is 9 frames older, 200 comes after a reboot or a silence."""

    def numbered(message, sequence):
        link = m.MAVLink(None, 1, 1)
        link.seq = sequence
        message.pack(link)
        return message

    flight = Flight()
    flight.ground.arming_gate = ArmingGate((1, 1), agreed=True)
    ground = flight.ground
    flight.beats("MISSION")
    ground.receive(numbered(m.MAVLink_mission_current_message(1, 3), 2), flight.now_s)
    state = m.MAVLink_mission_current_message(0, 3)
    ground.receive(numbered(state, sequence), flight.now_s + later_s)
    assert ground.vehicle_state.item == (0 if counts else 1)
    mode = m.MAVLink_heartbeat_message(2, flight.autopilot, 129, flight.modes["POSCTL"], 4, 3)
    ground.receive(numbered(mode, sequence), flight.now_s + 2.0 * later_s)
    assert ground.pilot.somebody_else_flies is counts
    contact = Contact((1, 1))
    for message, number in ((mode, 2), (state, sequence)):
        contact.receive(numbered(message, number), 0.0 if number == 2 else later_s)
    assert (contact.monitor.item is not None) is counts
    ground.receive(numbered(m.MAVLink_statustext_message(2, b"Low battery"), sequence), flight.now_s + 0.3)
    assert ground.texts[-1][2] == "Low battery"
