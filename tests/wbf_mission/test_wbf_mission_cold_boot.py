"""A vehicle that boots when it is spoken to, as ArduCopter does, and one that refuses to arm at first."""

import itertools
import math
import re

import pytest
from mission_items import SHORT as MISSION
from stand_in import Nobody, heard, scenario, stand_in
from sweeps import slow

from geo import get_farm
from geo.errors import WbfMissionError
from mission.ground.arming_gate import ArmingGate
from mission.ground.station import GroundStation
from mission.ground.vehicle_state import VehicleMonitor
from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint
from mission.outcome import Outcome, Phase
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import get_autopilot
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink import SimVehicle
from wbf_mission.addons.base.inquiry import Inquiry
from wbf_mission.addons.operate.link import LiveLink
from wbf_mission.events import Noted
from wbf_mission.flight import fly

HOME = MISSION.home


class Log:
    """What a vehicle sends, with the time on its own clock."""

    system_id, component_id = 250, 1
    wanted = None

    def __init__(self):
        self.heard = []

    def receive(self, message, now_s):
        if message.get_srcSystem() == 1:
            self.heard.append((now_s, message))
        return []

    def poll(self, now_s):
        return []

    def next_deadline(self):
        return float("inf")

    def of(self, kind):
        return [(time_s, one) for time_s, one in self.heard if one.get_type() == kind]


def flown(mission=MISSION, *, home=HOME, cold=True):
    vehicle = SimVehicle(get_vehicle("quad"), home, autopilot=get_autopilot("ardupilot"), cold=cold)
    ground, log = GroundStation(mission, arming_gate=ArmingGate((1, 1), agreed=True)), Log()
    Simulation([vehicle, ground, log]).run(lambda _now_s: ground.done, limit_s=400.0)
    return ground, log


def test_a_copter_that_boots_is_waited_for_and_flies():
    ground, log = flown()
    assert (ground.outcome, ground.reason) == (Outcome.COMPLETED, "")
    assert ground.started_s is not None and 40.0 <= ground.started_s < 50.0
    (armed_s, _) = next(one for one in log.of("HEARTBEAT") if one[1].base_mode & 128)
    assert armed_s >= 40.0
    assert not [one for _, one in log.of("COMMAND_ACK") if one.command == 400 and one.result]


def test_it_boots_in_the_order_and_at_the_times_of_a_real_one():
    _, log = flown()
    places = log.of("GLOBAL_POSITION_INT")
    first_s, first = places[0]
    assert 8.5 <= first_s < 9.0 and (first.lat, first.lon) == (0, 0)
    assert 10.0 <= next(time_s for time_s, one in places if one.lat) < 10.5
    fixes = [(time_s, one.fix_type) for time_s, one in log.of("GPS_RAW_INT")]
    assert [kind for k, (_, kind) in enumerate(fixes) if not k or kind != fixes[k - 1][1]] in (
        [0, 6],
        [0, 1, 6],
    )
    flags = log.of("EKF_STATUS_REPORT")
    assert flags[0][1].flags == 167
    assert 40.0 <= next(time_s for time_s, one in flags if one.flags & 16) < 41.0
    texts = [(time_s, one.text) for time_s, one in log.of("STATUSTEXT")]
    for due_s, text in ((20.0, "EKF3 IMU0 origin set"), (40.0, "EKF3 IMU0 is using GPS")):
        assert due_s <= next(time_s for time_s, said in texts if said == text) < due_s + 1.0
    assert 20.0 <= log.of("HOME_POSITION")[0][0] < 21.0
    reasons = list(dict.fromkeys(said for _, said in texts if said.startswith("PreArm")))
    assert reasons[0] == "PreArm: Accels inconsistent"
    assert {said for time_s, said in texts if said.startswith("PreArm") and time_s > 24.0} <= {
        "PreArm: Need Position Estimate"
    }


def test_the_check_of_another_mode_says_nothing_of_a_position():
    vehicle = SimVehicle(get_vehicle("quad"), HOME, autopilot=get_autopilot("ardupilot"), cold=True)
    log = Log()
    simulation = Simulation([vehicle, log])

    def order(command, *params):
        simulation.send(
            log, [m.MAVLink_command_long_message(1, 1, command, 0, *params, *[0.0] * (7 - len(params)))]
        )
        simulation.run(limit_s=1.0)
        return log.of("COMMAND_ACK")[-1][1].result

    order(m.MAV_CMD_SET_MESSAGE_INTERVAL, 1, 250_000)
    simulation.run(limit_s=29.0)
    assert log.of("SYS_STATUS")[-1][1].onboard_control_sensors_health & m.MAV_SYS_STATUS_PREARM_CHECK
    assert order(m.MAV_CMD_DO_SET_MODE, 1, 4) == m.MAV_RESULT_ACCEPTED
    assert not log.of("SYS_STATUS")[-1][1].onboard_control_sensors_health & m.MAV_SYS_STATUS_PREARM_CHECK
    assert order(m.MAV_CMD_COMPONENT_ARM_DISARM, 1) == m.MAV_RESULT_FAILED
    assert log.of("STATUSTEXT")[-1][1].text == "Arm: Need Position Estimate"
    simulation.run(limit_s=10.0)
    assert order(m.MAV_CMD_COMPONENT_ARM_DISARM, 1) == m.MAV_RESULT_ACCEPTED


def test_one_that_stands_elsewhere_is_not_started_once_it_knows_where():
    ground, _ = flown(home=GeoPoint(28.06, -82.15, 30.0))
    assert ground.outcome is Outcome.NOT_STARTED
    assert ground.reason == "the vehicle stands 1108 m from the start of its plan"
    assert ground.ended_s is not None and ground.ended_s > 40.0


@pytest.mark.parametrize("aside_m", [60.0, slow(0.0)])
def test_one_that_boots_is_planned_from_where_it_stands(aside_m):
    """It is asked as soon as it boots, and knows its place 40 s later."""
    events, told = heard(Noted)
    given = {"budget": "90s"}
    frame, (x_m, y_m) = get_farm("miniberry-10").frame, get_farm("miniberry-10").home_m
    latitude, longitude = frame.to_wgs84(x_m - aside_m, y_m)
    homes = [(GeoPoint(float(latitude), float(longitude), frame.altitude_m), 0.0)]
    with stand_in("ardupilot", cold=True, speed=20.0, homes=homes, **given) as (url, _):
        result = fly(scenario(**given), by=LiveLink(url, Nobody(), agreed=True), events=events)
    assert result.outcome is Outcome.COMPLETED, result.reason
    told = [note.text for note in told]
    assert told.count("waiting until the vehicle knows its position") == 1
    assert any(f"the vehicle is {aside_m:.0f} m from the start" in text for text in told) == (aside_m > 5.0)
    flown, planned = result.summary()["path_length_m"], result.plan.length_m
    assert flown == pytest.approx(planned, rel=0.12)
    assert planned > 2.0 * aside_m


def boots(now_s, *, estimates=True):
    """Return what a real ArduCopter tells of its place at a time since its boot."""
    lat, lon = (280500000, -821500000) if now_s >= 10.0 else (0, 0)
    fix = 6 if now_s >= 10.2 else 1 if now_s >= 10.0 else 0
    flags = 831 if now_s >= 40.0 else 167
    told = [
        m.MAVLink_global_position_int_message(0, lat, lon, 0, 0, 0, 0, 0, 0),
        m.MAVLink_gps_raw_int_message(0, fix, 1, 1, 0, 0, 0, 0, 0, 9),
    ]
    return [*told, m.MAVLink_ekf_status_report_message(flags, 0, 0, 0, 0, 0)] if estimates else told


@pytest.mark.parametrize(
    ("placed", "knows_s", "settled_s"),
    [
        (False, 40.0, (0.0, 35.0)),  # who only checks takes what is told
        (True, 40.0, (40.0, 45.0)),
        (True, math.inf, (180.0, 190.0)),  # and is not waited for without end
    ],
)
def test_an_inquiry_waits_for_the_place_of_a_vehicle_that_boots(placed, knows_s, settled_s):
    inquiry, asked = Inquiry(placed=placed), []
    now_s = 0.0
    while not inquiry.done:
        assert now_s < 400.0
        if now_s % 1.0 == 0.0:
            inquiry.receive(sent(m.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3)), now_s)
        for message in inquiry.poll(now_s):
            if message.get_type() != "COMMAND_LONG" or message.command != 512:
                continue
            asked.append((now_s, message.param1))
            # Before it knows its place it goes on telling what it told at the beginning.
            for answer in boots(now_s if now_s >= knows_s else min(now_s, 39.0)):
                if answer.get_msgId() == message.param1:
                    inquiry.receive(sent(answer), now_s)
        now_s += 0.25
    assert settled_s[0] <= now_s <= settled_s[1]
    if placed:
        again = [time_s for time_s, kind in asked if kind == m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT]
        assert min(b - a for a, b in itertools.pairwise(again)) >= 0.5, "not more often than it can answer"
        known = inquiry.snapshot().position
        assert known is not None and known.latitude_deg == 28.05


def sent(message):
    message.pack(m.MAVLink(None, srcSystem=1, srcComponent=1))
    message._header.srcSystem, message._header.srcComponent = 1, 1
    return message


def test_a_cold_boot_that_is_not_known_is_refused():
    with pytest.raises(WbfMissionError, match="the boot of PX4 on a multirotor is unknown"):
        SimVehicle(get_vehicle("quad"), HOME, autopilot=get_autopilot("px4"), cold=True)


class Stubborn(SimVehicle):
    """A copter whose own check passes, and that refuses to arm so often."""

    refusals, asked = 0, 0

    def receive(self, message, now_s):
        arms = message.get_type() == "COMMAND_LONG" and (message.command, message.param1) == (400, 1.0)
        if arms and self.asked < self.refusals:
            self.asked += 1
            # The reason comes after the answer.
            return [
                m.MAVLink_command_ack_message(400, m.MAV_RESULT_FAILED),
                m.MAVLink_statustext_message(2, f"Arm: Reason {self.asked}".encode()),
            ]
        return super().receive(message, now_s)


@pytest.mark.parametrize(
    ("refusals", "outcome", "reason"),
    [(3, Outcome.COMPLETED, ""), (1000, Outcome.ARMING_REFUSED, r"Arm: Reason \d\d")],
)
def test_a_refusal_that_may_pass_is_asked_again_for_a_while(refusals, outcome, reason):
    vehicle = Stubborn(get_vehicle("quad"), HOME, autopilot=get_autopilot("ardupilot"))
    vehicle.refusals = refusals
    ground = GroundStation(MISSION, arming_gate=ArmingGate((1, 1), agreed=True))
    Simulation([vehicle, ground]).run(lambda _now_s: ground.done, limit_s=400.0)
    assert ground.outcome is outcome
    assert re.fullmatch(reason, ground.reason), ground.reason
    assert vehicle.asked >= 3
    assert ground.phase is Phase.DONE and ground.ended_s is not None and ground.ended_s < 250.0


def test_a_position_counts_with_an_estimate_or_a_fix():
    monitor = VehicleMonitor()

    def at(lat, lon):
        monitor.receive(m.MAVLink_global_position_int_message(0, lat, lon, 0, 0, 0, 0, 0, 0), 1.0)

    def fix(kind):
        monitor.receive(m.MAVLink_gps_raw_int_message(0, kind, 1, 1, 0, 0, 0, 0, 0, 9), 1.0)

    def estimate(flags):
        monitor.receive(m.MAVLink_ekf_status_report_message(flags, 0, 0, 0, 0, 0), 1.0)

    assert not monitor.knows_position
    at(0, 0)
    assert not monitor.knows_position
    at(280500000, -821500000)
    assert monitor.knows_position, "it tells nothing else"
    fix(1)
    assert not monitor.knows_position
    fix(3)
    assert monitor.knows_position
    estimate(167)
    assert not monitor.knows_position, "a fix is no estimate"
    estimate(831)
    assert monitor.knows_position
    fix(0)
    assert monitor.knows_position, "by something else than satellites"
    estimate(1023)
    assert monitor.knows_position, "PX4 1.17 at rest tells CONST_POS_MODE, too, while it uses satellites"
    estimate(511)
    assert not monitor.knows_position, "held, without satellites"
