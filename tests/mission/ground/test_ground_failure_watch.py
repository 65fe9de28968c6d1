"""How a flight ended, told by telemetry alone: the ground station says what the vehicle itself knows."""

import pytest

from geo.frame import LocalFrame
from mission.ground.contact import Answer, Order
from mission.ground.failure_watch import FailureWatch
from mission.ground.station import GroundStation
from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint, Mission, MissionItem
from mission.outcome import Outcome
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.px4 import PX4
from sim_vehicle.energy.battery import WH_J
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink import SimVehicle
from sim_vehicle.weather.wind import Wind

HOME = GeoPoint(28.05, -82.15, 10.0)
FRAME = LocalFrame(HOME.latitude_deg, HOME.longitude_deg, HOME.altitude_m)


def at(x_m: float, y_m: float) -> tuple[float, float]:
    return FRAME.to_wgs84(x_m, y_m)


TAKEOFF = MissionItem(22, 3, param4=None, x=HOME.latitude_deg, y=HOME.longitude_deg, z=10.0)
PATH = tuple(MissionItem.waypoint(*at(120.0 * (k % 2), 4.0 * k), 10.0) for k in range(1, 12))
ITEMS = (TAKEOFF, *PATH, MissionItem(20))
# Between the waypoints: no waypoint is in it, every path crosses it.
FENCE = (MissionItem(5004, 0, 20.0, x=at(60.0, 0.0)[0], y=at(60.0, 0.0)[1]),)


def fly(autopilot, faults=(), *, wind=None, charge=1.0, fence=(), **parameters):
    quad = get_vehicle("quad")
    vehicle = SimVehicle(quad, HOME, autopilot=autopilot, wind=wind)
    for name, value in parameters.items():
        assert hasattr(vehicle.pilot.parameters, name)
        setattr(vehicle.pilot.parameters, name, value)
    vehicle.pilot.apply_parameters()
    assert quad.battery is not None
    vehicle.pilot.executor.motion.use_energy((1.0 - charge) * quad.battery.capacity_wh * WH_J)
    ground = GroundStation(Mission(ITEMS, HOME, fence=fence))
    simulation = Simulation([vehicle, ground], remote=[ground], faults=faults)
    simulation.run(until=lambda _now_s: ground.done, limit_s=3000.0)
    return vehicle, ground


LINK = {"faults": ["link-loss,from=40,for=30"], "link_action": 2, "link_timeout_s": 5}
DIES_AFTER_A_FENCE = {
    "faults": ["dead-battery,at=airborne,from=60"],
    "fence": FENCE,
    "fence_enable": 1,
    "fence_action": 4,
}


@pytest.mark.parametrize(
    ("autopilot", "outcome", "options"),
    [
        (PX4, Outcome.BATTERY_LOW, {"charge": 0.3, "low_fraction": 0.25}),
        (ARDUPILOT, Outcome.BATTERY_LOW, {"charge": 0.3, "low_fraction": 0.25}),
        (PX4, Outcome.FENCE_BREACHED, {"fence": FENCE, "fence_enable": 1, "fence_action": 3}),
        (PX4, Outcome.BATTERY_DEPLETED, {"faults": ["dead-battery,at=item:3"]}),
        (ARDUPILOT, Outcome.BATTERY_DEPLETED, DIES_AFTER_A_FENCE),
        (ARDUPILOT, Outcome.POSITION_LOST, {"faults": ["gps-loss,at=item:3"]}),
        (PX4, Outcome.CRASHED, {"faults": ["motor-failure,at=item:3"]}),
        (ARDUPILOT, Outcome.LINK_LOST, LINK),
        (PX4, Outcome.CANNOT_FLY_ITEM, {"wind": Wind(-18.0, 0.0)}),
    ],
)
def test_the_ground_station_knows_why_a_flight_ended(autopilot, outcome, options):
    vehicle, ground = fly(autopilot, **options)
    assert ground.outcome is outcome, (ground.reason, ground.texts)
    assert (ground.outcome.value, ground.reason) == (vehicle.outcome.value, vehicle.outcome_text)


@pytest.mark.parametrize(
    ("autopilot", "action", "faults", "outcome"),
    [(PX4, 1, [], Outcome.COMPLETED), (ARDUPILOT, 0, ["motor-failure,at=airborne,from=90"], Outcome.CRASHED)],
)
def test_a_fence_that_only_warns_ends_no_flight(autopilot, action, faults, outcome):
    _, ground = fly(autopilot, faults, fence=FENCE, fence_enable=1, fence_action=action)
    assert any("outside the area" in text for _, _, text in ground.texts)
    assert ground.outcome is outcome


def test_disarmed_without_a_reason_tells_how_far_it_came():
    vehicle = SimVehicle(get_vehicle("quad"), HOME)
    ground = GroundStation(Mission(ITEMS, HOME))
    simulation = Simulation([vehicle, ground])
    simulation.run(until=lambda now_s: now_s > 40.0)
    seq = vehicle.pilot.mission.current_seq
    vehicle.pilot.disarm(force=True)
    simulation.run(until=lambda _now_s: ground.done, limit_s=60.0)
    assert ground.outcome is Outcome.FLIGHT_ABORTED
    assert ground.reason == vehicle.outcome_text == f"disarmed at item {seq + 1} of {len(ITEMS)}"


def test_what_an_earlier_safety_function_told_is_not_taken_for_the_last():
    watch = FailureWatch()
    texts = [(10.0, 4, "Fence breached: 3.0 m outside the area"), (20.0, 4, "Battery low (24 %): returning")]
    beat = m.MAVLink_heartbeat_message(2, 12, 128, 0, m.MAV_STATE_CRITICAL, 3)
    watch.on_heartbeat(beat, 2)
    assert watch.cause(texts) == (Outcome.BATTERY_LOW, "battery low (24 %)")
    early = FailureWatch()
    early.on_heartbeat(beat, 1)
    assert early.cause(texts[:1]) == (Outcome.FENCE_BREACHED, "fence: 3.0 m outside the area")
    assert FailureWatch().cause(texts[:1]) is None


@pytest.mark.parametrize(
    ("battery", "unhealthy", "expected"),
    [
        (None, 0, None),
        (None, m.MAV_SYS_STATUS_SENSOR_GPS, Outcome.POSITION_LOST),
        (None, m.MAV_SYS_STATUS_GEOFENCE, Outcome.FENCE_BREACHED),
        (None, m.MAV_SYS_STATUS_GEOFENCE | m.MAV_SYS_STATUS_SENSOR_GPS, Outcome.POSITION_LOST),
        ((m.MAV_BATTERY_CHARGE_STATE_LOW, 20), m.MAV_SYS_STATUS_SENSOR_GPS, Outcome.BATTERY_LOW),
        ((m.MAV_BATTERY_CHARGE_STATE_EMERGENCY, 0), 0, Outcome.BATTERY_DEPLETED),
    ],
)
def test_without_its_texts_a_vehicle_is_known_by_its_state(battery, unhealthy, expected):
    watch = FailureWatch()
    enabled = m.MAV_SYS_STATUS_SENSOR_GPS | m.MAV_SYS_STATUS_GEOFENCE
    status = m.MAVLink_sys_status_message(enabled, enabled, enabled & ~unhealthy, *[0] * 10)
    watch.on_sys_status(status)
    # It is remembered when the vehicle is healthy again.
    watch.on_sys_status(m.MAVLink_sys_status_message(enabled, enabled, enabled, *[0] * 10))
    if battery is not None:
        state, remaining = battery
        told = m.MAVLink_battery_status_message(0, 1, 1, 0, [0] * 10, -1, 0, 0, remaining, 0, state)
        watch.on_battery_status(told)
    assert watch.cause([]) is None  # without a failsafe it is no cause
    watch.on_heartbeat(m.MAVLink_heartbeat_message(2, 12, 128, 0, m.MAV_STATE_CRITICAL, 3), 0)
    cause = watch.cause([])
    assert (cause[0] if cause else None) is expected


def test_an_order_waits_longer_while_the_vehicle_works_on_it():
    order = Order((1, 1), m.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
    order.send(10.0)
    usual_s = order.due_s
    another = m.MAVLink_command_ack_message(m.MAV_CMD_MISSION_START, m.MAV_RESULT_DENIED)
    assert order.answer(another, 10.1) is Answer.NONE and order.due_s == usual_s
    working = m.MAVLink_command_ack_message(m.MAV_CMD_COMPONENT_ARM_DISARM, m.MAV_RESULT_IN_PROGRESS)
    assert order.answer(working, 10.1) is Answer.NONE and order.due_s > usual_s + 1.0
    done = m.MAVLink_command_ack_message(m.MAV_CMD_COMPONENT_ARM_DISARM, m.MAV_RESULT_ACCEPTED)
    assert order.answer(done, 10.2) is Answer.ACCEPTED
