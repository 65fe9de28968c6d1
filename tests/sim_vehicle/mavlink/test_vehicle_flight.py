"""Whole flights over the in-memory link: a scripted ground station, the vehicle, a camera that listens."""

from collections import Counter

import pytest

from geo.frame import LocalFrame
from mission.link.codec.dialect import mavlink as m
from mission.model import Command, Frame, GeoPoint, MissionItem, MissionType
from mission.outcome import Outcome
from mission.transfer import wire
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.autopilot.px4 import PX4
from sim_vehicle.component import NEVER
from sim_vehicle.host.simulation import Simulation, StopReason
from sim_vehicle.mavlink import SimVehicle

HOME = GeoPoint(28.05, -82.15, 20.0)
FRAME = LocalFrame(HOME.latitude_deg, HOME.longitude_deg, HOME.altitude_m)


class Ground:
    """Uploads a plan, then sends each of its orders when it is due; notes everything that it hears."""

    system_id, component_id, wanted = 255, 190, None

    def __init__(self, items=(), orders=(), mission_type=0):
        self.items, self.orders, self.mission_type = tuple(items), list(orders), mission_type
        self.heard, self.beat_s = [], 0.0
        self.uploaded = not self.items

    def receive(self, message, now_s):
        self.heard.append((now_s, message))
        kind = message.get_type()
        if kind.startswith("MISSION_REQUEST") and message.mission_type == self.mission_type:
            item = self.items[message.seq]
            return [wire.item_to_message(item, message.seq, MissionType(self.mission_type), (1, 1))]
        if kind == "MISSION_ACK":
            self.uploaded = True
        return []

    def poll(self, now_s):
        sent = []
        if self.beat_s <= now_s:
            sent.append(m.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
            if self.beat_s == 0.0 and self.items:
                sent.append(m.MAVLink_mission_count_message(1, 1, len(self.items), self.mission_type))
            self.beat_s += 1.0
        while self.orders and self.orders[0][0] <= now_s:
            sent.append(self.orders.pop(0)[1])
        return sent

    def next_deadline(self):
        return min(self.beat_s, self.orders[0][0]) if self.orders else self.beat_s

    def of(self, kind):
        return [message for _, message in self.heard if message.get_type() == kind]

    def texts(self):
        return [message.text for message in self.of("STATUSTEXT")]

    def acks(self):
        return [(message.command, message.result) for message in self.of("COMMAND_ACK")]


class Camera:
    """Notes commands; acknowledges the n-th try of each."""

    system_id, component_id, wanted = 1, 100, frozenset({76})

    def __init__(self, answers_try=1):
        self.answers_try, self.commands, self.tries = answers_try, [], Counter()

    def receive(self, message, now_s):
        self.commands.append((now_s, message.command, message.param1, message.confirmation))
        self.tries[message.command] += 1
        if self.tries[message.command] < self.answers_try:
            return []
        return [m.MAVLink_command_ack_message(message.command, 0, 0, 0, 1, 1)]

    def poll(self, now_s):
        return []

    def next_deadline(self):
        return NEVER


def command(number, *params, system=1, component=1, confirmation=0):
    filled = [*params, *[0.0] * (7 - len(params))]
    return m.MAVLink_command_long_message(system, component, number, confirmation, *filled)


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
ARM = command(m.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
START = command(m.MAV_CMD_MISSION_START)
MISSION_MODE = command(m.MAV_CMD_DO_SET_MODE, 1.0, 4.0, 4.0)


def fly(items, orders, *, spec=None, limit_s=600.0, camera=None, prepare=None, until=None, **options):
    vehicle = SimVehicle(spec or get_vehicle("quad"), HOME, **options)
    if prepare:
        prepare(vehicle)
    ground = Ground(items, orders)
    components = [vehicle, ground] + ([camera] if camera else [])
    simulation = Simulation(components)
    reason = simulation.run(
        until or (lambda now_s: vehicle.outcome.is_over and not vehicle.pilot.armed), limit_s
    )
    return vehicle, ground, reason, simulation


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_a_mission_from_upload_to_disarming(autopilot):
    items = SURVEY if autopilot is PX4 else (waypoint(0, 0), *SURVEY)
    camera = Camera()
    streams = m.MAVLink_request_data_stream_message(1, 1, 0, 4, 1)  # which PX4 ignores
    vehicle, ground, reason, simulation = fly(
        items, [(0.0, streams), (2.0, ARM), (2.2, START)], camera=camera, autopilot=autopilot, until=None
    )
    assert reason is StopReason.FINISHED
    assert (vehicle.outcome, vehicle.outcome_text) == (Outcome.COMPLETED, "mission complete")
    assert ground.of("MISSION_ACK")[0].type == 0
    assert (400, 0) in ground.acks() and (300, 0) in ground.acks()
    first = 0 if autopilot is PX4 else 1
    reached = list(dict.fromkeys(message.seq for message in ground.of("MISSION_ITEM_REACHED")))
    if autopilot is ARDUPILOT:
        assert reached == list(range(first, first + len(SURVEY)))
    else:  # of a place and the commands after it the last one, and the return instead of the last place
        ends = [i for i, item in enumerate(SURVEY[:-1]) if item.has_position]
        merged = [after - 1 for after in ends[1:]]
        assert reached == [*merged, len(SURVEY) - 1]
    currents = list(dict.fromkeys(message.seq for message in ground.of("MISSION_CURRENT")))
    assert set(currents) <= set(range(first, first + len(SURVEY))) | {0}
    states = list(dict.fromkeys(message.mission_state for message in ground.of("MISSION_CURRENT")))
    assert states[-3:] == [2, 3, 5]
    assert ground.of("MISSION_CURRENT")[-1].seq == (len(SURVEY) - 1 if autopilot is PX4 else 0)
    landed = list(dict.fromkeys(message.landed_state for message in ground.of("EXTENDED_SYS_STATE")))
    assert landed == [1, 3, 2, 4]
    assert ground.of("EXTENDED_SYS_STATE")[-1].landed_state == 1
    assert [c[1:3] for c in camera.commands] == [(206, 1.0), (206, 0.0)]
    armed = [
        bool(message.base_mode & 128) for message in ground.of("HEARTBEAT") if message.get_srcComponent() == 1
    ]
    assert armed[0] is False and armed[-1] is False and any(armed)
    words = {"Armed by external command", "Mission finished, loitering", "Disarmed by landing"}
    if autopilot is ARDUPILOT:
        words = {"Arming motors", "Mission complete", "Disarming motors"}
    assert words <= set(ground.texts())
    assert 30.0 < simulation.now_s < 120.0
    last = ground.of("GLOBAL_POSITION_INT")[-1]
    x_m, y_m = FRAME.from_wgs84(last.lat / 1e7, last.lon / 1e7)
    assert abs(x_m) < 1.0 and abs(y_m) < 1.0 and last.relative_alt == 0 and last.alt == 20_000


def test_telemetry_rates_and_contents():
    vehicle, ground, _, _ = fly(SURVEY, [(2.0, ARM), (2.2, START)], until=lambda t: t >= 20.0)
    times = Counter(message.get_type() for now_s, message in ground.heard if 10.0 <= now_s < 20.0)
    assert times["GLOBAL_POSITION_INT"] == times["ATTITUDE"] == 100
    assert times["LOCAL_POSITION_NED"] == times["VFR_HUD"] == times["ATTITUDE_QUATERNION"] == 50
    assert times["ALTITUDE"] == times["HIGHRES_IMU"] == times["ODOMETRY"] == 10
    assert times["GPS_RAW_INT"] == times["EXTENDED_SYS_STATE"] == 20
    assert times["HEARTBEAT"] == times["SYS_STATUS"] == times["BATTERY_STATUS"] == times["SYSTEM_TIME"] == 10
    assert 10 <= times["MISSION_CURRENT"] <= 14
    assert times["HOME_POSITION"] == 5
    state = vehicle.pilot.state
    position = ground.of("GLOBAL_POSITION_INT")[-1]
    east, north = FRAME.from_wgs84(position.lat / 1e7, position.lon / 1e7)
    assert (east, north) == pytest.approx(state.position_m[:2], abs=0.02)
    assert position.relative_alt == pytest.approx(1000 * state.position_m[2], abs=1)
    assert position.time_boot_ms == 20_000
    assert (position.vy, position.vx) == pytest.approx([100 * v for v in state.velocity_m_s[:2]], abs=1)
    ned = ground.of("LOCAL_POSITION_NED")[-1]
    assert (ned.y, ned.x, -ned.z) == pytest.approx(state.position_m, abs=1e-3)
    status = ground.of("SYS_STATUS")[-1]
    for bit in (1, 2, 4, 8, 32, 1 << 20, 1 << 28):
        assert status.onboard_control_sensors_present & status.onboard_control_sensors_health & bit
    assert 0 < status.battery_remaining <= 100
    home = ground.of("HOME_POSITION")[0]
    assert (home.latitude, home.longitude, home.altitude) == (280500000, -821500000, 20000)
    beat = next(message for message in ground.of("HEARTBEAT") if message.get_srcSystem() == 1)
    assert (beat.type, beat.autopilot, beat.custom_mode) == (2, 12, 0x03040000)
    assert beat.base_mode & 1


def test_mode_then_arm_starts_the_mission_as_qgroundcontrol_does_it():
    vehicle, _ground, reason, _ = fly(SURVEY, [(2.0, MISSION_MODE), (2.5, ARM)])
    assert (vehicle.outcome, reason) == (Outcome.COMPLETED, StopReason.FINISHED)


def test_return_to_launch_in_mid_mission_is_an_interruption_and_stops_the_camera():
    camera = Camera()
    vehicle, _ground, _, _ = fly(SURVEY, [(2.0, ARM), (2.2, START), (15.0, command(20))], camera=camera)
    assert vehicle.outcome is Outcome.FLIGHT_ABORTED
    assert "item" in vehicle.outcome_text
    assert [c[1:3] for c in camera.commands] == [(206, 1.0), (206, 0.0)]
    assert camera.commands[-1][0] == pytest.approx(15.0, abs=0.2)


def test_a_camera_that_loses_commands_gets_them_again():
    camera = Camera(answers_try=3)
    _, ground, _, _ = fly(SURVEY, [(2.0, ARM), (2.2, START)], camera=camera)
    first = [c for c in camera.commands if c[2] == 1.0]
    assert [c[3] for c in first] == [0, 1, 2]
    assert not any("Camera" in text for text in ground.texts())


def test_a_camera_that_never_answers_is_reported():
    camera = Camera(answers_try=99)
    vehicle, ground, _, _ = fly(SURVEY, [(2.0, ARM), (2.2, START)], camera=camera)
    assert [c[3] for c in camera.commands if c[2] == 1.0] == [0, 1, 2]
    assert "Camera does not answer command 206" in ground.texts()
    assert vehicle.outcome is Outcome.COMPLETED


def drain(fraction):
    """Use the battery down to a fraction."""

    def prepare(vehicle):
        vehicle.pilot.drain_battery(fraction)

    return prepare


@pytest.mark.parametrize(
    ("prepare", "items", "orders", "reason"),
    [
        (drain(0.1), SURVEY, [(2.0, ARM)], "battery low"),
        (lambda v: setattr(v.pilot, "position_ok", False), SURVEY, [(2.0, ARM)], "no position"),
        (
            lambda v: setattr(v.pilot.arming, "block", "compass not calibrated"),
            SURVEY,
            [(2.0, ARM)],
            "compass",
        ),
        (None, (), [(1.0, command(21)), (2.0, ARM)], "mode land"),
    ],
)
def test_arming_is_refused_with_the_reason(prepare, items, orders, reason):
    vehicle, ground, _, _ = fly(items, orders, prepare=prepare, limit_s=10.0)
    assert vehicle.outcome is Outcome.ARMING_REFUSED
    assert reason in vehicle.outcome_text
    assert (400, 1) in ground.acks()
    assert any(reason in text for text in ground.texts())
    assert not any(b.base_mode & 128 for b in ground.of("HEARTBEAT"))


def test_unfit_to_arm_is_visible_before():
    _, ground, _, _ = fly((), [], prepare=drain(0.1), limit_s=3.0)
    assert not ground.of("SYS_STATUS")[-1].onboard_control_sensors_health & 1 << 28


def test_mission_start_without_a_mission_is_refused():
    _vehicle, ground, _, _ = fly((), [(1.0, ARM), (1.5, START), (2.0, MISSION_MODE)], limit_s=4.0)
    assert ground.acks() == [(400, 0), (300, 1), (176, 1)]
    assert ground.texts().count("Switching to Mission is currently not available") == 2
    assert ground.of("MISSION_CURRENT")[-1].mission_state == 1


def test_a_mission_that_cannot_be_flown_is_rejected_and_not_started():
    far = (TAKEOFF, waypoint(0, 100), MissionItem.waypoint(30.0, -82.15, 10.0), RTL)
    vehicle, ground, _, _ = fly(far, [(2.0, ARM), (2.5, START)], limit_s=6.0)
    assert vehicle.outcome is Outcome.MISSION_REJECTED or (300, 1) in ground.acks()
    assert ground.of("MISSION_ACK")[0].type == 0, "PX4 stores it and refuses to fly it"
    assert any(text.startswith("Mission rejected: item 3") for text in ground.texts())
    assert ground.of("MISSION_CURRENT")[-1].mission_state == 1


def test_an_unknown_command_is_refused_in_the_transfer():
    vehicle, ground, _, _ = fly((TAKEOFF, MissionItem(4501), RTL), [], limit_s=3.0)
    assert ground.of("MISSION_ACK")[0].type == 3
    assert vehicle.outcome is Outcome.MISSION_REJECTED
    assert vehicle.pilot.mission.size == 0


def test_wind_too_strong_ends_in_a_landing_not_in_a_hang():
    from sim_vehicle.weather.wind import Wind

    vehicle, _ground, reason, _ = fly(
        (TAKEOFF, waypoint(-300, 0), RTL), [(2.0, ARM), (2.2, START)], wind=Wind(18.0, 0.0), limit_s=3000.0
    )
    assert reason is StopReason.FINISHED
    assert vehicle.outcome is Outcome.CANNOT_FLY_ITEM
    assert "wind" in vehicle.outcome_text


def test_the_ideal_vehicle_flies_too():
    vehicle, ground, reason, _ = fly(
        (TAKEOFF, waypoint(3, 0), waypoint(3, 3), RTL),
        [(2.0, ARM), (2.2, START)],
        spec=get_vehicle("ideal"),
        limit_s=3000.0,
    )
    assert (vehicle.outcome, reason) == (Outcome.COMPLETED, StopReason.FINISHED)
    times = Counter(message.get_type() for now_s, message in ground.heard if 5.0 <= now_s < 15.0)
    assert times["GLOBAL_POSITION_INT"] == 10, "it moves once a second"
    assert ground.of("SYS_STATUS")[-1].battery_remaining == -1


def test_a_second_flight_after_the_first():
    again = [(2.0, ARM), (2.2, START), (100.0, ARM), (100.2, START)]
    vehicle, ground, _, _simulation = fly(SURVEY, again, until=lambda t: t > 105.0 and False, limit_s=220.0)
    assert vehicle.outcome is Outcome.COMPLETED
    assert ground.texts().count("Mission finished, loitering") == 2


def test_px4_ends_a_mission_in_the_mode_of_returns():
    """As PX4 1.17 (SIH) does: first the item and the texts, then the mode, then the item that it is at."""
    _, ground, _, _ = fly(SURVEY, [(2.0, ARM), (2.2, START)])
    last, rtl = len(SURVEY) - 1, PX4.for_vehicle("multirotor").mavlink.modes[Mode.RTL]
    told = [(now_s, message) for now_s, message in ground.heard if message.get_srcComponent() == 1]
    names = [(message.get_type(), message) for _, message in told]
    begin_s, at = next(
        (now_s, i)
        for i, (now_s, message) in enumerate(told)
        if message.get_type() == "MISSION_ITEM_REACHED" and message.seq == last
    )
    texts = [(now_s, one.text) for now_s, one in told if one.get_type() == "STATUSTEXT" and now_s >= begin_s]
    assert texts[:2] == [(begin_s, "Mission finished, loitering"), (begin_s, "Returning to launch")]
    beat_s = next(t for t, one in told if one.get_type() == "HEARTBEAT" and one.custom_mode == rtl)
    assert beat_s - begin_s == pytest.approx(0.3, abs=0.1)
    assert [one.mission_state for name, one in names[at:] if name == "MISSION_CURRENT"][-1] == 5
    current_s, current = next(
        (t, one) for t, one in told[at:] if one.get_type() == "MISSION_CURRENT" and t > beat_s
    )
    assert current_s - beat_s < 0.1 and (current.seq, current.mission_state) == (last, 5)


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_mission_start_arms_a_px4_and_no_ardupilot(autopilot):
    vehicle, ground, _, _ = fly(
        SURVEY, [(2.0, START)], autopilot=autopilot, until=lambda t: t > 20.0, limit_s=30.0
    )
    assert ((int(m.MAV_CMD_MISSION_START), 0) in ground.acks()) is (autopilot is PX4)
    assert vehicle.pilot.armed is (autopilot is PX4)
    assert ("Armed by mission start" in ground.texts()) is (autopilot is PX4)
    assert (vehicle.true_position_m[2] > 5.0) is (autopilot is PX4)


def test_a_px4_that_cannot_arm_refuses_to_start_its_mission():
    def empty(vehicle):
        vehicle.pilot.drain_battery(0.01)

    vehicle, ground, _, _ = fly(SURVEY, [(2.0, START)], prepare=empty, until=lambda t: t > 5.0)
    assert (int(m.MAV_CMD_MISSION_START), 1) in ground.acks(), "TEMPORARILY_REJECTED"
    assert not vehicle.pilot.armed
    assert any(text.startswith("Preflight Fail: battery low") for text in ground.texts())
