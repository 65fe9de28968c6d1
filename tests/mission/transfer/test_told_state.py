"""What the ground says of a vehicle's plan after a transfer that did not end well is true."""

from __future__ import annotations

import pytest

from mission.autopilots import ARDUPILOT, GENERIC, PX4
from mission.link.codec.frames import FrameReader, FrameWriter
from mission.model import MissionItem, MissionType
from mission.transfer import (
    FailureReason,
    MissionDownload,
    MissionServer,
    MissionUpload,
    PlanState,
    RoundTrip,
    TransferFailed,
    UploadVerified,
    VerifiedUpload,
)
from mission.transfer.storage import as_stored

KIND = MissionType.MISSION
NEW = tuple(MissionItem.waypoint(28.0 + k / 1000, -82.0, 10.0) for k in range(4))
OLD = tuple(MissionItem.waypoint(27.0 + k / 1000, -82.0, 20.0) for k in range(6))
PROFILES = pytest.mark.parametrize("profile", [PX4, ARDUPILOT, GENERIC], ids=lambda one: one.name)


def over_the_air(message, source):
    (got,) = FrameReader().feed(FrameWriter(*source).encode(message))
    return got


class Radio:
    """Carries messages between an upload and a vehicle; what `is_lost` names does not arrive."""

    def __init__(self, server, is_lost=lambda _radio, _message: False):
        self.server, self.is_lost = server, is_lost
        self.sent = []  # What the ground station sent: time, and kind of message
        self.now_s = 0.0

    @property
    def kinds(self):
        return [kind for _, kind in self.sent]

    def carry(self, upload, limit=8000):
        output, last = upload.start(self.now_s), None
        for _ in range(limit):
            last = output.events[-1] if output.events else last
            self.sent += [(self.now_s, message.get_type()) for message in output.messages]
            if upload.done:
                return last
            answers = []
            for message in output.messages:
                if not self.is_lost(self, message):
                    answers += self.server.receive(over_the_air(message, (255, 190)), self.now_s).messages
            self.now_s += 0.02
            answers += self.server.poll(self.now_s).messages
            output = upload.poll(self.now_s)
            for message in answers:
                if not upload.done and not self.is_lost(self, message):
                    output += upload.receive(over_the_air(message, (1, 1)), self.now_s)
        raise AssertionError("it never ends")


def holding_old(profile):
    server = MissionServer(1, profile=profile)
    server.set_plan(KIND, OLD)
    return server


def is_new(server, profile):
    return server.plan(KIND).items == tuple(as_stored(item, profile) for item in NEW)


@PROFILES
@pytest.mark.parametrize("direction", ["both", "up", "down"])
def test_after_an_outage_the_plan_is_told_as_it_is(profile, direction):
    """The link falls silent after any number of messages, until the ground reads the plan back."""
    told = set()
    for arriving in range(2 * len(NEW) + 3):
        server = holding_old(profile)
        passed = []

        def is_lost(radio, message, arriving=arriving, passed=passed):
            passed.append(message)
            own = message.get_type() in ("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_REQUEST_LIST")
            reads = "MISSION_REQUEST_LIST" in radio.kinds
            dead = direction == "both" or own is (direction == "up")
            return len(passed) > arriving and dead and not reads

        end = Radio(server, is_lost).carry(VerifiedUpload(NEW, profile=profile))
        if isinstance(end, UploadVerified):
            told.add("new")
            assert is_new(server, profile), arriving
        else:
            told.add(end.vehicle_plan)
            assert end.vehicle_plan is not PlanState.OLD or server.plan(KIND).items == OLD, arriving
            if profile.atomic and end.reason is FailureReason.DIFFERENT:
                assert end.vehicle_plan is PlanState.OLD, "it was read back, and is the old one whole"
    # One that overwrites in place has shortened its plan when it heard how many items come.
    assert (PlanState.OLD if profile.atomic else PlanState.UNKNOWN) in told


@PROFILES
def test_a_vehicle_that_confirms_and_holds_another_plan_is_not_told_to_hold_the_old_one(profile):
    server = holding_old(profile)

    def is_lost(radio, _message):
        if "MISSION_REQUEST_LIST" in radio.kinds:
            server.set_plan(KIND, OLD[:3])  # Another ground station's
        return False

    end = Radio(server, is_lost).carry(VerifiedUpload(NEW, profile=profile))
    assert (end.reason, end.vehicle_plan) == (FailureReason.DIFFERENT, PlanState.UNKNOWN)


class LossyTrip(RoundTrip):
    """Of a link that is slow and loses frames, whatever is measured."""

    def __init__(self):
        super().__init__()
        super().sample(2.0)
        self.loss = 0.3

    def sample(self, seconds):
        pass


@pytest.mark.parametrize(("lost", "begun"), [("up", (6, 0)), ("down", (1, 6))], ids=["upload", "reading"])
def test_over_a_lossy_link_what_was_given_up_is_made_again_five_times(lost, begun):
    """The vehicle is heard each time, but only one item gets through, or none."""
    made = []

    def counted(kind):
        return lambda *given, **options: made.append(kind) or kind(*given, **options)

    def is_lost(_radio, message):
        up = message.target_system == 1
        if message.get_type() != "MISSION_ITEM_INT" or up is not (lost == "up"):
            return False
        return not up or message.seq > 0  # an upload of which no item is taken is not made again

    upload = VerifiedUpload(
        NEW, profile=PX4, round_trip=LossyTrip(), send=counted(MissionUpload), read=counted(MissionDownload)
    )
    end = Radio(holding_old(PX4), is_lost).carry(upload, limit=100_000)
    assert (made.count(MissionUpload), made.count(MissionDownload)) == begun
    assert isinstance(end, TransferFailed)
    assert end.vehicle_plan is (PlanState.OLD if lost == "up" else PlanState.UNKNOWN)
    assert ("was sent but not verified" in end.text) is (lost == "down")


@PROFILES
def test_a_first_reading_that_an_echo_has_spoiled_is_made_again(profile):
    server = holding_old(profile)
    stored = []

    def is_lost(radio, message):
        reads = radio.kinds.count("MISSION_REQUEST_LIST")
        if message.get_type() == "MISSION_REQUEST_LIST" and reads == 1 and not stored:
            stored.append(server.plan(KIND).items)
            server.set_plan(KIND, OLD)
        elif message.get_type() == "MISSION_REQUEST_LIST" and reads == 2:
            server.set_plan(KIND, stored[0])
        return False

    radio = Radio(server, is_lost)
    assert isinstance(radio.carry(VerifiedUpload(NEW, profile=profile)), UploadVerified)
    assert radio.kinds.count("MISSION_REQUEST_LIST") == 2


def test_a_difference_is_told_by_the_number_that_the_user_knows():
    """Items that the autopilot does not take were left out before."""
    server = holding_old(PX4)

    def is_lost(radio, _message):
        if "MISSION_REQUEST_LIST" in radio.kinds:
            server.set_plan(KIND, (*NEW[:2], OLD[2], NEW[3]))
        return False

    upload = VerifiedUpload(NEW, profile=PX4, origins=(0, 2, 5, 7))
    end = Radio(server, is_lost).carry(upload)
    assert {one.sequence for one in upload.differences} == {5}
    assert "item 6: " in end.text
