"""The conformance kit finds a vehicle that tells something else than it should, message by message."""

import pytest

from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink import SimVehicle
from wbf_mission.addons.check import check_vehicle

HOME = GeoPoint(28.05, -82.15, 20.0)


class Liar(SimVehicle):
    """Changes every message of one name before it is sent."""

    def __init__(self, name, changes):
        super().__init__(get_vehicle("quad"), HOME)
        self.lie = name, changes

    def receive(self, message, now_s):
        return self._changed(super().receive(message, now_s))

    def poll(self, now_s):
        return self._changed(super().poll(now_s))

    def _changed(self, messages):
        name, changes = self.lie
        for message in messages:
            if message.get_type() == name:
                for field, value in changes.items():
                    setattr(message, field, value(getattr(message, field)) if callable(value) else value)
        return messages


@pytest.mark.parametrize(
    ("name", "changes", "expected"),
    [
        ("HEARTBEAT", {"type": m.MAV_TYPE_GENERIC}, {"identity.heartbeat-fields"}),
        ("HEARTBEAT", {"base_mode": lambda mode: mode & ~1}, {"identity.heartbeat-fields"}),
        ("HEARTBEAT", {"system_status": 99}, {"identity.heartbeat-fields"}),
        ("AUTOPILOT_VERSION", {"capabilities": 0}, {"identity.capabilities"}),
        ("AUTOPILOT_VERSION", {"capabilities": 2**20 - 1}, {"identity.capabilities"}),
        ("PARAM_VALUE", {"param_index": lambda index: min(index, index // 2)}, {"param.list"}),
        ("PARAM_VALUE", {"_param_id_raw": b"SAME_NAME"}, {"param.list", "param.read-name"}),
        ("PARAM_VALUE", {"param_value": 7.25}, {"param.set"}),
        ("MISSION_COUNT", {"count": lambda count: count + 1}, {"mission.one-item", "transfer.re-read"}),
        ("MISSION_COUNT", {"count": lambda count: max(0, count - 1)}, {"mission.one-item", "mission.fence"}),
        ("MISSION_COUNT", {"mission_type": 2}, {"mission.one-item", "mission.types-apart"}),
        ("MISSION_ITEM_INT", {"x": lambda x: x + 5000}, {"mission.ten-items", "mission.replaced"}),
        ("MISSION_ITEM_INT", {"seq": lambda seq: seq + 1}, {"mission.ten-items", "transfer.request-beyond"}),
        ("MISSION_ITEM_INT", {"command": 17}, {"mission.camera-items", "mission.rally"}),
        ("MISSION_ACK", {"type": 0}, {"transfer.too-many", "transfer.unknown-type", "transfer.wrong-type"}),
        ("MISSION_ACK", {"type": 4}, {"mission.clear", "transfer.final-ack", "transfer.duplicate-item"}),
        ("MISSION_ACK", {"target_system": 77}, {"transfer.final-ack", "transfer.last-ack-again"}),
        ("MISSION_REQUEST_INT", {"target_system": 77}, {"transfer.asks-first", "transfer.out-of-order"}),
        ("MISSION_REQUEST_INT", {"seq": lambda seq: seq + 1}, {"transfer.asks-first", "transfer.nan"}),
        ("COMMAND_ACK", {"result": 0}, {"command.unknown-int", "command.request-unknown"}),
        ("COMMAND_ACK", {"result": 4}, {"command.request-message", "telemetry.interval"}),
        ("COMMAND_ACK", {"target_system": 77}, {"command.ack-address", "command.repeated"}),
        ("MISSION_CURRENT", {"seq": 200}, {"mission.set-current"}),
        ("EXTENDED_SYS_STATE", {"landed_state": 0}, {"telemetry.landed-state"}),
        ("GLOBAL_POSITION_INT", {"lat": 950_000_000}, {"telemetry.position"}),
        ("SYS_STATUS", {"onboard_control_sensors_present": 0}, {"telemetry.sys-status"}),
        ("TIMESYNC", {"tc1": 0}, {"telemetry.timesync"}),
        ("TIMESYNC", {"target_system": 77}, {"telemetry.timesync"}),
        ("PARAM_VALUE", {"param_count": lambda count: count + 1}, {"param.list"}),
        ("MISSION_CURRENT", {"total": 3}, {"mission.total"}),
    ],
)
def test_a_vehicle_that_tells_something_else_fails_there(name, changes, expected):
    link = Simulation([Liar(name, changes)]).open_link()
    only = sorted({"identity.heartbeat", *expected})
    report = check_vehicle(link, clock=link.clock, wait=link.wait, only=only)
    failed = {result.check.id for result in report.results if result.verdict.value == "failed"}
    assert expected <= failed
    assert "identity.heartbeat" not in failed


class Pretender(SimVehicle):
    """Says yes to some orders and does nothing."""

    def receive(self, message, now_s):
        kind = message.get_type()
        if kind == "MISSION_CLEAR_ALL":
            return [m.MAVLink_mission_ack_message(255, 190, m.MAV_MISSION_ACCEPTED, message.mission_type)]
        if kind == "COMMAND_LONG" and message.command == m.MAV_CMD_SET_MESSAGE_INTERVAL:
            return [m.MAVLink_command_ack_message(message.command, m.MAV_RESULT_ACCEPTED, 0, 0, 255, 190)]
        return super().receive(message, now_s)


def test_a_vehicle_that_says_yes_and_does_nothing_is_found_out():
    link = Simulation([Pretender(get_vehicle("quad"), HOME)]).open_link()
    report = check_vehicle(link, clock=link.clock, wait=link.wait, only=("mission", "telemetry"))
    failed = {result.check.id for result in report.results if result.verdict.value == "failed"}
    assert {"mission.clear", "telemetry.interval", "telemetry.interval-off"} <= failed
