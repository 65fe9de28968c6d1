"""One thing wrong with a vehicle, and the check that finds it, with the reason it gives."""

import pytest

from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink import SimVehicle
from wbf_mission.addons.check import Verdict, check_vehicle

HOME = GeoPoint(28.05, -82.15, 20.0)
GROUND = (255, 190)


class Vehicle(SimVehicle):
    """A vehicle with one fault: subclasses change what it hears, or what it says."""

    def __init__(self):
        super().__init__(get_vehicle("quad"), HOME)
        self.counts = {}

    def count(self, key):
        self.counts[key] = self.counts.get(key, 0) + 1
        return self.counts[key]

    def hears(self, message, kind):
        """Answer in the vehicle's place, or None."""

    def says(self, message, kind):
        """Whether the message goes out; it may be changed."""
        return True

    def receive(self, message, now_s):
        answers = self.hears(message, message.get_type())
        if answers is None:
            answers = super().receive(message, now_s)
        return [answer for answer in answers if self.says(answer, answer.get_type())]

    def poll(self, now_s):
        return [message for message in super().poll(now_s) if self.says(message, message.get_type())]


def result(vehicle, name):
    link = Simulation([vehicle]).open_link()
    report = check_vehicle(link, clock=link.clock, wait=link.wait, only=(name,), fly=name.startswith("fly"))
    return report.result(name)


def ack(kind):
    return m.MAVLink_mission_ack_message(*GROUND, kind, 0)


class TakesAnyOrder(Vehicle):
    def hears(self, message, kind):
        return [ack(m.MAV_MISSION_ACCEPTED)] if kind == "MISSION_ITEM_INT" and message.seq == 2 else None


class TakesItemsOfAnyPlan(Vehicle):
    def hears(self, message, kind):
        if kind == "MISSION_ITEM_INT":
            message.mission_type = 0


class ForgetsWhatItTook(Vehicle):
    done = False

    def hears(self, message, kind):
        return [] if self.done and kind == "MISSION_ITEM_INT" else None

    def says(self, message, kind):
        self.done |= kind == "MISSION_ACK" and message.type == m.MAV_MISSION_ACCEPTED
        return True


class ChokesOnNan(Vehicle):
    choked = False

    def hears(self, message, kind):
        self.choked |= kind == "MISSION_ITEM_INT" and message.param4 != message.param4 and message.seq == 1

    def says(self, message, kind):
        return not (self.choked and kind.startswith("MISSION_"))


class ReadsEachItemOnce(Vehicle):
    def hears(self, message, kind):
        if kind == "MISSION_REQUEST_LIST":
            self.counts.clear()
        return [] if kind == "MISSION_REQUEST_INT" and self.count(message.seq) > 1 else None


class NeverEnds(Vehicle):
    def hears(self, message, kind):
        if kind in ("MISSION_ITEM_INT", "MISSION_ITEM") and message.frame == 200:
            return [m.MAVLink_mission_request_int_message(*GROUND, 1, 0)]
        return None


class NameAndIndexDiffer(Vehicle):
    by_name = False

    def hears(self, message, kind):
        self.by_name = kind == "PARAM_REQUEST_READ" and message.param_index < 0

    def says(self, message, kind):
        if kind == "PARAM_VALUE" and self.by_name:
            message.param_value += 1.0
        return True


class KnowsEveryName(Vehicle):
    def hears(self, message, kind):
        if kind == "PARAM_REQUEST_READ" and message.param_index < 0:
            return [m.MAVLink_param_value_message(message.param_id.encode(), 0.0, 9, 1, 0)]
        return None


class KeepsNewNames(Vehicle):
    def hears(self, message, kind):
        if kind == "PARAM_SET":
            self.counts[message.param_id] = message.param_value
        elif kind == "PARAM_REQUEST_READ" and message.param_id in self.counts:
            value = self.counts[message.param_id]
            return [m.MAVLink_param_value_message(message.param_id.encode(), value, 9, 1, 0)]
        return None


class FallsAsleep(Vehicle):
    def says(self, message, kind):
        return kind != "HEARTBEAT" or self.count(kind) <= 2


class LosesItsAutopilot(Vehicle):
    def says(self, message, kind):
        if kind == "HEARTBEAT" and self.count(kind) > 2:
            message.autopilot = m.MAV_AUTOPILOT_INVALID
        return True


class ClockStands(Vehicle):
    def says(self, message, kind):
        if kind == "ATTITUDE":
            message.time_boot_ms = 5
        return True


class PingsEverybody(Vehicle):
    def says(self, message, kind):
        if kind == "PING":
            message.target_system = message.target_component = 0
        return True


class AnswersEverybody(Vehicle):
    def says(self, message, kind):
        if kind == "COMMAND_ACK":
            message.target_system = message.target_component = 0
        return True


class WillNotArm(Vehicle):
    def hears(self, message, kind):
        if kind == "COMMAND_LONG" and message.command == m.MAV_CMD_COMPONENT_ARM_DISARM:
            return [m.MAVLink_command_ack_message(400, m.MAV_RESULT_DENIED, 0, 0, *GROUND)]
        return None


class StaysDown(Vehicle):
    def hears(self, message, kind):
        if kind == "COMMAND_LONG" and message.command == m.MAV_CMD_NAV_TAKEOFF:
            return [m.MAVLink_command_ack_message(22, m.MAV_RESULT_ACCEPTED, 0, 0, *GROUND)]
        return None


@pytest.mark.parametrize(
    ("fault", "check", "reason"),
    [
        (TakesAnyOrder, "transfer.out-of-order", "it is accepted"),
        (TakesItemsOfAnyPlan, "transfer.wrong-type", "it is accepted: the vehicle asks for item 1"),
        (ForgetsWhatItTook, "transfer.last-ack-again", "no MISSION_ACK"),
        (ChokesOnNan, "transfer.nan", "the vehicle falls silent"),
        (ReadsEachItemOnce, "transfer.re-read", "request 2 of item 0 gives no MISSION_ITEM_INT"),
        (NeverEnds, "transfer.unknown-frame", "it is neither refused nor accepted"),
        (NameAndIndexDiffer, "param.read-name", "by index"),
        (KnowsEveryName, "param.read-unknown", "it has a value"),
        (KeepsNewNames, "param.set-unknown", "now it has a value"),
        (FallsAsleep, "identity.heartbeat", "heartbeats in 4.2 s"),
        (FallsAsleep, "identity.heartbeat-fields", "no heartbeat"),
        (FallsAsleep, "identity.mavlink2", "no heartbeat"),
        (LosesItsAutopilot, "identity.heartbeat-fields", "autopilot is INVALID"),
        (ClockStands, "telemetry.interval", "messages in 3 s"),
        (PingsEverybody, "telemetry.ping", "it is addressed to system 0"),
        (WillNotArm, "fly.takeoff-land", "it does not arm in"),
        (StaysDown, "fly.takeoff-land", "it does not climb in"),
    ],
)
def test_the_check_tells_what_is_wrong(fault, check, reason):
    found = result(fault(), check)
    assert found.verdict is Verdict.FAILED
    assert reason in found.detail


class RefusesAnotherOrder(Vehicle):
    def hears(self, message, kind):
        if kind == "MISSION_ITEM_INT" and message.seq == 2 and self.count(kind) == 1:
            return [ack(m.MAV_MISSION_INVALID_SEQUENCE)]
        return None


class RefusesNan(Vehicle):
    def hears(self, message, kind):
        if kind == "MISSION_ITEM_INT" and message.param4 != message.param4:
            return [ack(m.MAV_MISSION_INVALID_PARAM4)]
        return None


class LosesParameters(Vehicle):
    """Loses each seventh once, and begins with a value that has no index."""

    def says(self, message, kind):
        if kind != "PARAM_VALUE":
            return True
        if self.count(kind) == 3:
            message.param_index = 65535
        return message.param_index % 7 > 0 or self.count(message.param_index) > 1


class TakesItsTime(Vehicle):
    """Accepts a command after it has told that it works on it."""

    def receive(self, message, now_s):
        answers = super().receive(message, now_s)
        for answer in list(answers):
            if answer.get_type() == "COMMAND_ACK":
                working = m.MAVLink_command_ack_message(answer.command, 5, 10, 0, *GROUND)
                answers.insert(answers.index(answer), working)
        return answers


@pytest.mark.parametrize(
    ("vehicle", "check", "detail"),
    [
        (RefusesAnotherOrder, "transfer.out-of-order", ""),
        (RefusesNan, "transfer.nan", "refused: "),
        (LosesParameters, "param.list", " parameters"),
        (TakesItsTime, "command.request-message", ""),
        (AnswersEverybody, "command.ack-address", "a broadcast"),
    ],
)
def test_what_a_vehicle_may_do_as_well_passes(vehicle, check, detail):
    found = result(vehicle(), check)
    assert found.verdict is Verdict.PASSED, found.detail
    assert detail in found.detail
