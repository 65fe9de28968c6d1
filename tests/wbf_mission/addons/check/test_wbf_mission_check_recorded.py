"""The conformance kit against stand-ins that answer as real autopilots were seen to answer."""

import json
import time
from pathlib import Path

import pytest
from recorded import HOME, Bench, Item, served
from recorded_ardupilot import ArduCopter
from recorded_px4 import Px4

from wbf_mission.addons.check import Verdict, all_checks, check_vehicle
from wbf_mission.cli.app import main

REAL = {"ArduPilot": ArduCopter, "PX4": Px4}
# What one of the two does not do.
ADVICE = {"ArduPilot": {"transfer.old-plan-kept"}, "PX4": {"transfer.bad-latitude"}}


def run(autopilot, delay_s=0.0, **options):
    bench = Bench(autopilot, delay_s)
    return check_vehicle(bench.link, clock=bench.clock, wait=bench.wait, **options)


def failed(report, *, required=True):
    return {
        result.check.id: result.told
        for result in report.results
        if result.verdict is Verdict.FAILED and result.required is required
    }


@pytest.mark.parametrize("delay_s", [0.0, 0.3], ids=["cable", "radio"])
@pytest.mark.parametrize("name", REAL)
def test_real_autopilots_conform(name, delay_s):
    report = run(REAL[name](), delay_s, fly=True)
    assert report.vehicle.profile.name == name
    assert failed(report) == {}
    assert report.passed
    assert len(report.results) == len(all_checks())
    assert set(failed(report, required=False)) == ADVICE[name]


def test_the_stand_ins_have_nothing_of_our_own_vehicle():
    for path in (Path(__file__).parents[3] / "support").glob("recorded*.py"):
        text = path.read_text(encoding="utf-8")
        assert "sim_vehicle" not in text
        assert "mission.transfer" not in text


def place(frame, command, x, y, z, p1=0.0, autocontinue=0):
    return Item(frame, command, autocontinue, (p1, 0.0, 0.0, 0.0), x, y, z)


# As each keeps them: PX4 gives the frames 5 and 6 for 0 and 3.
PLANS = {
    "PX4": {
        0: [
            place(6, 16, -353_630_000, 1_491_650_000, 12.0, 3.0, 1),
            place(6, 19, -353_631_000, 1_491_651_000, 9.0, 30.0, 1),
        ],
        1: [place(5, 5003, -353_632_622, 1_491_652_376, 0.0, 30.0)],
        2: [place(6, 5100, -353_631_000, 1_491_652_000, 15.0)],
    },
    "ArduPilot": {
        0: [
            place(0, 16, *HOME[:2], HOME[2] / 1000, autocontinue=1),
            place(3, 16, -353_630_000, 1_491_650_000, 12.0, 3.0, 1),
            place(3, 18, -353_631_000, 1_491_651_000, 9.0, 3.0, 1),
        ],
        1: [place(0, 5003, -353_632_622, 1_491_652_376, 0.0, 30.0)],
        2: [place(3, 5100, -353_631_000, 1_491_652_000, 15.0)],
    },
}


@pytest.mark.parametrize("only", ["transfer", "transfer.nan", "mission.types-apart"])
@pytest.mark.parametrize("empty", [(), (0,), (0, 1, 2)])
@pytest.mark.parametrize("name", REAL)
def test_its_own_plans_are_there_afterwards(name, empty, only):
    plans = {kind: [] if kind in empty else plan for kind, plan in PLANS[name].items()}
    vehicle = REAL[name]()
    vehicle.plans = {kind: list(plan) for kind, plan in plans.items()}
    report = run(vehicle, only=(only,))
    assert report.warnings == ()
    assert vehicle.plans == plans


class SaysNothingOfItsPlans(Px4):
    def on_mission_request_list(self, message, sender):
        """Say nothing."""


class TakesOnePlan(Px4):
    """Refuses what comes after the check."""

    def on_mission_count(self, message, sender):
        if self.last_upload is None:
            super().on_mission_count(message, sender)
        else:
            self.ack(sender, 1, message.mission_type)


def test_plans_that_are_lost_are_told():
    (text,) = run(SaysNothingOfItsPlans(), only=("mission.one-item",)).warnings
    assert text.startswith("the vehicle's plans could not be read, so they will not be restored: ")
    vehicle = TakesOnePlan()
    vehicle.plans[0] = list(PLANS["PX4"][0])
    (text,) = run(vehicle, only=("mission.one-item",)).warnings
    assert text.startswith("the vehicle's plans could not be restored: ")


def test_the_command_says_who_has_trouble_without_advice(pace, capsys):
    with served(Px4(), lambda: pace * time.monotonic()) as url:
        assert main(["check", url, "--only", "transfer.bad-latitude", "--json"]) == 0
    captured = capsys.readouterr()
    told = "failed  transfer.bad-latitude: it is accepted (trouble for clients that do not check coordinates"
    assert told in captured.err
    (check,) = json.loads(captured.out)["checks"]
    assert (check["result"], check["required"]) == ("failed", False)
    assert "MAVSDK" in check["suffers"]


# -- behaviour of which the record knows two, or which another version may have


class Px4WithoutAnswerToAPart(Px4):
    """A part of the list, in flight: "no answer"."""

    def on_mission_write_partial_list(self, message, sender):
        """Say nothing."""


class Px4ThatChecksRanges(Px4):
    """A later one may refuse what this one stores."""

    def judge(self, item):
        return (10, None) if abs(item.x) > 900_000_000 else super().judge(item)


class ArduCopterThatKeepsAutocontinue(ArduCopter):
    """What is stored more faithfully is no fault."""

    def judge(self, message):
        result, item = super().judge(message)
        return result, item and item._replace(autocontinue=message.autocontinue)


class ArduCopterWithTheNewBit(ArduCopter):
    """PARAM_ENCODE_C_CAST beside PARAM_FLOAT, which it replaces."""

    capabilities = ArduCopter.capabilities | 131072


@pytest.mark.parametrize(
    "variant",
    [Px4WithoutAnswerToAPart, Px4ThatChecksRanges, ArduCopterThatKeepsAutocontinue, ArduCopterWithTheNewBit],
)
def test_what_they_may_do_as_well_conforms(variant):
    assert failed(run(variant())) == {}


# -- behaviour made wrong


class MixesAfterABreak(Px4):
    """Stores in place what comes."""

    def on_mission_item_int(self, message, sender):
        super().on_mission_item_int(message, sender)
        if message.mission_type == self.kind:
            self.plans[self.kind][: len(self.new)] = self.new


class TakesAnyItem(Px4):
    """Takes what comes for what was asked."""

    def is_wanted(self, number):
        return True


class EndsAtTheWrongItem(Px4):
    """INVALID_SEQUENCE, by which MAVSDK and the protocol mean the end."""

    def is_wanted(self, number):
        if number != self.next:
            self.ack(self.partner, 13, self.kind)
        return number == self.next


class AsksInAnotherOrder(Px4):
    """Asks for item 2 before item 1."""

    order = (0, 2, 1)

    def request(self):
        right = self.next
        self.next = self.order[right] if right < 3 <= self.count else right
        super().request()
        self.next = right

    def keep(self, number, item):
        self.new.insert(number, item)

    def is_wanted(self, number):
        return number == (self.order[self.next] if self.next < 3 <= self.count else self.next)


class NeverAsksAgain(Px4):
    def transfer_timers(self):
        self.asked_s = self.now_s
        super().transfer_timers()


class WaitsForEver(Px4):
    """Never gives an upload up."""

    def transfer_timers(self):
        if self.count:
            self.heard_s = self.now_s
        super().transfer_timers()


class LetsASecondStationIn(Px4):
    def on_mission_count(self, message, sender):
        if sender != self.partner:
            self.state = "idle"
        super().on_mission_count(message, sender)


class SendsWhatIsNotThere(Px4):
    def on_mission_request_int(self, message, sender):
        plan = self.plans[self.kind]
        if message.seq >= len(plan) > 0:
            self.send(self.item_message(plan[-1], message.seq, self.kind, sender))
        super().on_mission_request_int(message, sender)


class BothEncodings(Px4):
    capabilities = Px4.capabilities | 131072


class KnowsNoIntegers(ArduCopter):
    capabilities = ArduCopter.capabilities & ~4


class ClearsNothing(Px4):
    """Says yes to type 255."""

    def on_mission_clear_all(self, message, sender):
        if message.mission_type == 255:
            self.ack(sender, 0, 255)
        else:
            super().on_mission_clear_all(message, sender)


class LosesTheRadius(Px4):
    def judge(self, item):
        result, stored = super().judge(item)
        if item.command == 5004:
            stored = stored._replace(params=(0.0, 0.0, 0.0, 0.0))
        return result, stored


class LosesTheAltitude(ArduCopter):
    def judge(self, message):
        result, item = super().judge(message)
        return result, item._replace(z=0.0) if message.mission_type == 2 else item


class LosesTheHold(ArduCopter):
    def stored(self, item):
        stored = super().stored(item)
        return stored._replace(params=(0.0, *stored.params[1:])) if item.command == 16 else stored


class HasNoHome(ArduCopter):
    """Does not keep what is sent as item 0, nor anything in its place."""

    def on_mission_request_list(self, message, sender):
        self.plans[0] = [item for item in self.plans[0] if item != self.home_item()]
        super().on_mission_request_list(message, sender)


class KeepsTheHomeThatWasSent(ArduCopter):
    def judge(self, message):
        result, item = super().judge(message)
        if message.mission_type == 0 and message.seq == 0:
            item = item._replace(x=message.x, y=message.y)
        return result, item


class AcknowledgesSomebodyElse(ArduCopter):
    """MISSION_ACK goes to another component."""

    def ack(self, sender, result, kind, opaque_id=0):
        super().ack((sender[0], 77), result, kind, opaque_id)


class AnswersSomebodyElse(ArduCopter):
    """COMMAND_ACK goes to another system."""

    def acknowledgement(self, command, result, sender):
        return super().acknowledgement(command, result, (77, sender[1]))


class AnswersForOthers(ArduCopter):
    def is_for_us(self, message):
        return True


class KnowsOneComponent(ArduCopter):
    """Hears what is addressed to component 1 only."""

    def is_for_us(self, message):
        return super().is_for_us(message) and getattr(message, "target_component", 1) == 1


class DeniesNobody(ArduCopter):
    def is_foreign(self, sender):
        return False


class GoesBeyond(ArduCopter):
    def choose_by_command(self, number):
        self.current = number
        return 0


class ClearsTheMissionToo(ArduCopter):
    def on_mission_clear_all(self, message, sender):
        super().on_mission_clear_all(message, sender)
        if message.mission_type == 1:
            self.plans[0] = []


class ForgetsAParameter(ArduCopter):
    def parameter(self, name, index):
        message = super().parameter(name, index)
        if index == 700:
            message.param_index = 701
        return message


class PartsNothing(ArduCopter):
    def on_mission_write_partial_list(self, message, sender):
        """Say nothing."""


class RefusesIntervals(ArduCopter):
    def command(self, command, p):
        return (3,) if command == 511 else super().command(command, p)


class ArmsAtAnything(Px4):
    def arm(self, value):
        return super().arm(float(value > 0.0))


class SkipsReached(ArduCopter):
    def reached(self, number):
        if number != 3:
            super().reached(number)


READS_THE_MISSION = """
mission.one-item mission.ten-items mission.hundred-items mission.camera-items mission.replaced mission.clear
mission.loiter mission.home mission.clear-all mission.part mission.set-current mission.set-current-beyond
mission.types-apart transfer.duplicate-count transfer.duplicate-item transfer.out-of-order transfer.cancel
transfer.cancel-download transfer.late-item transfer.count-zero transfer.re-read transfer.request-beyond
transfer.second-station
transfer.silence
"""
SENDS_BY_HAND = """
transfer.final-ack transfer.asks-again transfer.duplicate-count transfer.duplicate-item transfer.out-of-order
transfer.unknown-command transfer.second-station
"""
NEEDS_STREAMS = """
telemetry.position telemetry.attitude telemetry.sys-status telemetry.gps telemetry.landed-state
telemetry.mission-current telemetry.interval
"""


@pytest.mark.parametrize(
    ("variant", "expected", "reason"),
    [
        (MixesAfterABreak, "transfer.old-plan-kept", "the mission differs"),
        (
            TakesAnyItem,
            "transfer.out-of-order transfer.duplicate-count transfer.duplicate-item",
            "the vehicle asks for item 1",
        ),
        (EndsAtTheWrongItem, "transfer.duplicate-count transfer.duplicate-item", "an item came out of order"),
        (AsksInAnotherOrder, SENDS_BY_HAND, "requests item 2 after item 0"),
        (NeverAsksAgain, "transfer.asks-again", "it is not requested again"),
        (WaitsForEver, "transfer.silence", "because of another transfer"),
        (LetsASecondStationIn, "transfer.second-station", "item 0 of the second station"),
        (DeniesNobody, "transfer.second-station", "item 0 of the second station"),
        (SendsWhatIsNotThere, "transfer.request-beyond", "item 300 comes"),
        (BothEncodings, "identity.capabilities", "both bytewise and cast"),
        (KnowsNoIntegers, "identity.capabilities", "the bit MISSION_INT is missing"),
        (ClearsNothing, "mission.clear-all", "and 4 items are left"),
        (LosesTheRadius, "mission.fence", "item 5: param1"),
        (LosesTheAltitude, "mission.rally", "item 1: z"),
        (LosesTheHold, "mission.camera-items", "param1"),
        (HasNoHome, READS_THE_MISSION, "3 items were sent, the vehicle holds 2"),
        (
            KeepsTheHomeThatWasSent,
            "mission.home",
            "item 0 is at -35.3532622, 149.1652376, home at -35.3632622",
        ),
        (
            AcknowledgesSomebodyElse,
            "transfer.final-ack mission.clear mission.clear-empty mission.types-apart mission.fence "
            "mission.rally",
            "it is addressed to 255/77",
        ),
        (AnswersSomebodyElse, "command.ack-address", "it is addressed to (77, 190)"),
        (AnswersForOthers, "command.foreign-system transfer.foreign-system", "a request for system 237"),
        (KnowsOneComponent, "transfer.components", "component 0"),
        (GoesBeyond, "mission.set-current-beyond", "becomes 999"),
        (ClearsTheMissionToo, "mission.types-apart", "0 items instead of 5"),
        (ForgetsAParameter, "param.list", "1 of 1349 never come, the first is 700"),
        (PartsNothing, "mission.part", "no answer"),
        (RefusesIntervals, NEEDS_STREAMS, "not even after SET_MESSAGE_INTERVAL"),
        (ArmsAtAnything, "command.bad-arming", "it armed"),
    ],
)
def test_wrong_behaviour_fails_where_it_is_wrong(variant, expected, reason):
    report = run(variant())
    found = failed(report)
    assert set(found) == set(expected.split())
    assert any(reason in detail for detail in found.values())
    assert not report.passed


def test_a_waypoint_that_is_not_reported_fails_the_flight():
    found = failed(run(SkipsReached(), fly=True, only=("fly",)))
    assert found == {"fly.mission": "no MISSION_ITEM_REACHED for item 2, only for [0, 1, 3, 4]"}
