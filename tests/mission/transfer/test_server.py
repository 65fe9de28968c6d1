"""The vehicle's side, row by row, and against random messages."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweeps import sweep

from mission.autopilots import ARDUPILOT, GENERIC, PX4
from mission.link import FrameReader, FrameWriter
from mission.link.codec.dialect import mavlink
from mission.model import GeoPoint, MissionItem, MissionType
from mission.transfer import (
    FailureReason,
    MissionServer,
    PlanCleared,
    PlanReplaced,
    PlanSent,
    StatusText,
    TransferFailed,
    plan_checksum,
    wire,
)
from mission.transfer.events import NOTHING
from mission.transfer.server_session import ServerState
from mission.transfer.storage import UncheckedItem, as_stored

GROUND, OTHER = (255, 190), (245, 190)
MISSION, FENCE, RALLY = MissionType
A, B, C = (MissionItem.waypoint(28.0 + k / 1000, -82.0, 5.0 + k) for k in range(3))
OLD = (C,)


def sent(message, source=GROUND):
    """The message as it arrives from that sender."""
    (got,) = FrameReader().feed(FrameWriter(*source).encode(message))
    return got


def count(number, kind=0, source=GROUND, target=(1, 1)):
    return sent(mavlink.MAVLink_mission_count_message(*target, number, kind), source)


def item(plan_item, sequence, kind=0, source=GROUND, current=False, integer=True):
    return sent(
        wire.item_to_message(plan_item, sequence, kind, (1, 1), current=current, integer=integer), source
    )


def request(sequence, kind=0, source=GROUND, integer=True):
    if integer:
        return sent(mavlink.MAVLink_mission_request_int_message(1, 1, sequence, kind), source)
    return sent(mavlink.MAVLink_mission_request_message(1, 1, sequence, kind), source)


def listing(kind=0, source=GROUND):
    return sent(mavlink.MAVLink_mission_request_list_message(1, 1, kind), source)


def ack(result, kind=0, source=GROUND):
    return sent(mavlink.MAVLink_mission_ack_message(1, 1, result, kind), source)


def clear(kind=0, source=GROUND):
    return sent(mavlink.MAVLink_mission_clear_all_message(1, 1, kind), source)


def short(output):
    """The messages in a form that reads well: type, the number that matters, the addressee."""
    fields = {"MISSION_ACK": "type", "MISSION_COUNT": "count"}
    return [
        (m.get_type()[8:], getattr(m, fields.get(m.get_type(), "seq")), (m.target_system, m.target_component))
        for m in output.messages
    ]


def texts(output):
    return [event.text for event in output.events if isinstance(event, StatusText)]


def kinds(output):
    return [type(event) for event in output.events]


@pytest.fixture
def server():
    made = MissionServer(1, profile=PX4)
    made.set_plan(MISSION, OLD)
    return made


def begin(server, number=2, now_s=0.0):
    return server.receive(count(number), now_s)


def test_upload_replaces_the_plan_at_the_last_item(server):
    assert short(begin(server)) == [("REQUEST_INT", 0, GROUND)]
    assert short(server.receive(item(A, 0), 0.1)) == [("REQUEST_INT", 1, GROUND)]
    assert server.plan(MISSION).items == OLD
    output = server.receive(item(B, 1, current=True), 0.2)
    assert short(output) == [("ACK", 0, GROUND)]
    (event,) = output.events
    assert event == PlanReplaced(MISSION, (A, B), plan_checksum((A, B)), True, 1)
    assert server.plan(MISSION).items == (A, B)
    assert not server.busy
    assert server.next_deadline() is None


def test_the_same_plan_again_is_no_change(server):
    server.set_plan(MISSION, (A,))
    begin(server, 1)
    assert server.receive(item(A, 0), 0.1).events[0].changed is False


def test_the_last_item_again_gets_the_ack_again(server):
    begin(server, 1)
    server.receive(item(A, 0), 0.1)
    output = server.receive(item(A, 0), 0.5)
    assert (short(output), output.events) == ([("ACK", 0, GROUND)], ())
    assert short(server.receive(item(B, 0), 0.6)) == [("ACK", 0, GROUND)], "PX4 compares the number alone"
    other = server.receive(item(A, 0, source=OTHER), 0.7)
    assert (short(other), texts(other)) == ([], ["REJ. MIS ITEM: partner id mismatch"])
    begin(server, 2)
    server.receive(item(A, 0), 0.8)
    server.receive(item(B, 1), 0.9)
    late = server.receive(item(A, 0), 1.0)
    assert (short(late), texts(late)) == ([("ACK", wire.ERROR, GROUND)], ["IGN MISSION_ITEM: No transfer"])
    server.receive(listing(), 1.1)
    late = server.receive(item(B, 1), 1.2)
    assert (short(late), texts(late)) == ([("ACK", wire.ERROR, GROUND)], ["IGN MISSION_ITEM: Busy"])


def test_re_requests_and_abort(server):
    begin(server)
    assert server.next_deadline() == pytest.approx(0.25)
    assert server.poll(0.2).messages == ()
    assert short(server.poll(0.25)) == [("REQUEST_INT", 0, GROUND)]
    server.receive(item(A, 0), 1.0)
    for step in range(1, 20):
        assert short(server.poll(1.0 + step * 0.25)) == [("REQUEST_INT", 1, GROUND)]
    output = server.poll(6.0)
    assert output.messages == ()
    assert kinds(output) == [TransferFailed, StatusText]
    assert output.events[0].reason is FailureReason.TIMEOUT
    assert output.events[1].text == "Operation timeout"
    assert server.plan(MISSION).items == OLD
    assert server.poll(100.0).events == ()


def test_count_again(server):
    begin(server, 2)
    assert short(server.receive(count(3), 0.1)) == [("REQUEST_INT", 0, GROUND)]
    server.receive(item(A, 0), 0.2)
    assert short(server.receive(count(3), 0.3)) == [("ACK", wire.ERROR, GROUND)]
    assert short(server.receive(count(1, source=OTHER), 0.4)) == [("ACK", wire.ERROR, OTHER)]
    assert short(server.receive(item(B, 1), 0.5)) == [("REQUEST_INT", 2, GROUND)]


def test_out_of_order_and_foreign_items(server):
    begin(server)
    assert server.receive(item(B, 1), 0.1).messages == ()
    output = server.receive(item(A, 0, source=OTHER), 0.1)
    assert (short(output), kinds(output)) == ([], [StatusText])
    assert short(server.receive(item(A, 0, kind=1), 0.1)) == [("ACK", wire.ERROR, GROUND)]
    assert server.state is ServerState.RECEIVING
    assert short(server.receive(item(A, 0), 0.2)) == [("REQUEST_INT", 1, GROUND)]


@pytest.mark.parametrize(
    ("bad", "kind", "result"),
    [
        (MissionItem(16, 1, x=1, y=2, z=3), 0, wire.UNSUPPORTED_FRAME),
        (MissionItem(5100, 3, x=1, y=2), 0, wire.ERROR),
        (MissionItem(16, 3, x=1, y=2), 1, wire.UNSUPPORTED),
        (MissionItem(5001, 3, 2.0, x=1, y=2), 1, wire.ERROR),
        (MissionItem(18, 3, x=1, y=2), 0, wire.UNSUPPORTED),
    ],
)
def test_items_that_cannot_be_flown_end_the_upload(server, bad, kind, result):
    server.validator = lambda candidate: wire.UNSUPPORTED if candidate.command == 18 else wire.ACCEPTED
    server.receive(count(2, kind), 0.0)
    output = server.receive(item(bad, 0, kind), 0.1)
    assert short(output) == [("ACK", result, GROUND)]
    assert kinds(output) == [TransferFailed] + [StatusText] * (result != wire.ERROR)
    assert output.events[0].result == result
    assert server.plan(MISSION).items == OLD
    for following in (bad, MissionItem(16, 3, x=1, y=2, z=3)):
        again = server.receive(item(following, 0, kind), 0.2)
        assert short(again) == [("ACK", wire.ERROR, GROUND)]
        assert texts(again) == ["IGN MISSION_ITEM: No transfer"]
    assert not server.busy


@pytest.mark.parametrize(
    ("field", "value", "result"),
    [("param1", float("inf"), 6), ("x", 950_000_000, 10), ("y", 1_900_000_000, 11), ("z", float("nan"), 12)],
)
def test_numbers_that_make_no_sense(field, value, result):
    for profile, place in ((GENERIC, 0), (ARDUPILOT, 1)):
        server = MissionServer(1, profile=profile)
        server.set_plan(MISSION, OLD)
        begin(server, 1 + place)
        if place:
            server.receive(item(A, 0), 0.1)
        message = wire.item_to_message(A, place, 0, (1, 1))
        setattr(message, field, value)
        assert short(server.receive(sent(message), 0.1)) == [("ACK", result, GROUND)]
        assert server.plan(MISSION).items == OLD


@pytest.mark.parametrize(
    ("field", "value"), [("x", 950_000_000), ("z", float("nan")), ("param1", float("inf"))]
)
def test_px4_does_not_check_ranges(server, field, value):
    begin(server, 1)
    message = wire.item_to_message(A, 0, 0, (1, 1))
    setattr(message, field, value)
    assert short(server.receive(sent(message), 0.1)) == [("ACK", 0, GROUND)]
    assert isinstance(server.plan(MISSION).items[0], UncheckedItem)
    server.receive(listing(), 1.0)
    back = getattr(sent(server.receive(request(0), 1.1).messages[0], (1, 1)), field)
    assert back == value or (math.isnan(back) and math.isnan(value))


def test_a_float_item_that_no_number_holds_is_refused_by_all(server):
    begin(server, 1)
    message = wire.item_to_message(A, 0, 0, (1, 1), integer=False)
    message.x = float("inf")
    assert short(server.receive(sent(message), 0.1)) == [("ACK", 10, GROUND)]


def test_float_items_and_requests(server):
    begin(server, 1)
    assert short(server.receive(item(A, 0, integer=False), 0.1)) == [("ACK", 0, GROUND)]
    got = server.plan(MISSION).items[0]
    assert got.x == pytest.approx(A.x, abs=2e-6)
    server.receive(listing(), 1.0)
    assert server.receive(request(0, integer=False), 1.1).messages[0].get_type() == "MISSION_ITEM"
    assert server.receive(request(0), 1.2).messages[0].get_type() == "MISSION_ITEM_INT"
    spec = MissionServer(1, profile=GENERIC)
    spec.set_plan(MISSION, OLD)
    spec.receive(listing(), 0.0)
    assert spec.receive(request(0, integer=False), 0.1).messages[0].get_type() == "MISSION_ITEM_INT"


def test_counts_that_do_not_fit(server):
    small = MissionServer(1, capacity={MISSION: 2})
    output = small.receive(count(3), 0.0)
    assert short(output) == [("ACK", wire.NO_SPACE, GROUND)]
    assert output.events == ()
    assert short(small.receive(count(2), 0.0)) == [("REQUEST_INT", 0, GROUND)]
    assert short(server.receive(count(1, kind=7), 0.0)) == [("ACK", wire.INVALID, GROUND)]
    output = server.receive(count(0), 0.0)
    assert (short(output), kinds(output)) == ([("ACK", 0, GROUND)], [PlanCleared])
    assert server.plan(MISSION).items == ()


def test_cancel(server):
    begin(server)
    assert server.receive(ack(15, source=OTHER), 0.1).events == ()
    assert server.receive(ack(15, kind=1), 0.1).events == ()
    output = server.receive(ack(15), 0.1)
    assert output.messages == ()
    assert output.events[0].reason is FailureReason.CANCELLED
    assert server.plan(MISSION).items == OLD
    server.receive(listing(), 1.0)
    assert server.receive(ack(15), 1.1).events[0].reason is FailureReason.CANCELLED
    assert not server.busy


def test_ardupilot_marks_no_item_in_a_download():
    made = MissionServer(1, profile=ARDUPILOT, home=GeoPoint(28.0, -82.0, 12.0))
    made.set_plan(MISSION, (A, B))
    assert [made.receive(request(number), 0.1).messages[0].current for number in range(3)] == [0, 0, 0]


def test_download(server):
    server.set_plan(MISSION, (A, B))
    server.current_sequence = 1
    assert short(server.receive(listing(), 0.0)) == [("COUNT", 2, GROUND)]
    first = server.receive(request(0), 0.1).messages[0]
    assert (first.seq, first.current, wire.item_from_message(first)) == (0, 0, A)
    assert short(server.receive(request(0), 0.2)) == [("ITEM_INT", 0, GROUND)]
    assert server.receive(ack(0), 0.2).events == ()  # too early: an echo
    assert server.receive(request(1), 0.3).messages[0].current == 1
    assert server.receive(request(2), 0.3) == NOTHING
    other = server.receive(request(0, source=OTHER), 0.3)
    assert (short(other), texts(other)) == ([], ["WPM: REJ. CMD: partner id mismatch"])
    assert kinds(server.receive(ack(0), 0.4)) == [PlanSent]
    for sequence in (0, 7):
        assert server.receive(request(sequence), 0.5) == NOTHING


def test_download_that_jumps_or_stops(server):
    server.set_plan(MISSION, (A, B, C))
    for sequence in (2, 0):  # a jump, an item before the last one sent
        server.receive(listing(), 0.0)
        for before in range(2 if sequence != 2 else 0):
            server.receive(request(before), 0.1)
        output = server.receive(request(sequence), 0.1)
        assert short(output) == [("ACK", wire.ERROR, GROUND)]
        assert texts(output) == ["WPM: REJ. CMD: Req. WP was unexpected"]
        assert not server.busy
    server.receive(listing(), 1.0)
    server.receive(request(0), 1.1)
    assert short(server.receive(listing(), 1.2)) == [("COUNT", 3, GROUND)]
    assert server.next_deadline() == pytest.approx(6.2)
    assert kinds(server.poll(6.2)) == [TransferFailed, StatusText]
    server.receive(listing(), 10.0)
    assert server.receive(ack(1), 10.1).events[0].reason is FailureReason.REFUSED


def test_one_transfer_at_a_time(server):
    server.receive(listing(), 0.0)
    assert short(server.receive(count(1), 0.1)) == [("ACK", wire.ERROR, GROUND)]
    output = server.receive(listing(source=OTHER), 0.1)
    assert texts(output) == ["Mission download request ignored, already active"]
    output = server.receive(clear(source=OTHER), 0.1)
    assert (short(output), texts(output)) == ([], ["WPM: IGN CLEAR CMD: Busy"])
    output = server.receive(item(A, 0), 0.1)
    assert (short(output), texts(output)) == ([("ACK", wire.ERROR, GROUND)], ["IGN MISSION_ITEM: Busy"])
    server.receive(request(0), 0.2)
    output = server.receive(count(1), 0.3)  # everything was sent: the ACK must have been lost
    assert short(output) == [("REQUEST_INT", 0, GROUND)]
    assert kinds(output)[0] is PlanSent
    assert short(server.receive(listing(), 0.4)) == [
        ("COUNT", 1, GROUND)
    ]  # nothing came: it wants to read instead


def test_clear(server):
    server.set_plan(FENCE, (MissionItem(5003, 3, 5.0, x=1, y=2),))
    assert kinds(server.receive(clear(1), 0.0)) == [PlanCleared]
    assert server.plan(MISSION).items == OLD
    output = server.receive(clear(255), 0.0)
    assert len(output.events) == 3
    assert output.messages[0].mission_type == 255
    assert short(server.receive(clear(9), 0.0)) == [("ACK", wire.INVALID, GROUND)]


@pytest.mark.parametrize(("profile", "answers"), [(GENERIC, [("ACK", wire.ERROR, GROUND)]), (PX4, [])])
def test_partial_lists_are_refused(profile, answers):
    server = MissionServer(1, profile=profile)
    for build in (
        mavlink.MAVLink_mission_write_partial_list_message,
        mavlink.MAVLink_mission_request_partial_list_message,
    ):
        assert short(server.receive(sent(build(1, 1, 0, 0)), 0.0)) == answers
    begin(server)
    message = mavlink.MAVLink_mission_write_partial_list_message(1, 1, 0, 0)
    assert server.receive(sent(message), 0.0).messages == ()


def test_only_our_messages(server):
    assert server.receive(count(1, source=(0, 0)), 0.0).messages == ()
    assert server.receive(count(1, target=(2, 1)), 0.0).messages == ()
    assert server.receive(count(1, target=(1, 100)), 0.0).messages == ()
    assert server.receive(sent(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)), 0.0).messages == ()
    assert server.receive(count(1, target=(0, 0)), 0.0).messages != ()
    assert server.receive(count(1, target=(1, 190)), 0.0).messages != ()


@pytest.fixture
def copter():
    made = MissionServer(1, profile=ARDUPILOT, home=GeoPoint(28.0, -82.0, 12.0))
    made.set_plan(MISSION, (C, C, C))
    return made


def kept(plan_item):
    return as_stored(plan_item, ARDUPILOT)


def test_ardupilot_uploads_in_place(copter):
    assert short(begin(copter, 3)) == [("REQUEST", 0, GROUND)]
    copter.receive(item(A, 0), 0.1)  # home: not stored
    assert short(copter.receive(item(C, 2), 0.2)) == [("ACK", wire.INVALID_SEQUENCE, GROUND)]
    copter.receive(item(A, 1), 0.3)
    assert copter.next_deadline() == pytest.approx(1.3)
    output = copter.poll(8.4)
    assert short(output) == [("ACK", wire.OPERATION_CANCELLED, GROUND)]
    assert "Mission upload timeout" in texts(output)
    assert copter.plan(MISSION).items == (kept(A), C)  # the new beginning, the old rest
    assert [event.complete for event in output.events if isinstance(event, PlanReplaced)] == [False]


def test_ardupilot_denies_whoever_comes_during_an_upload(copter):
    begin(copter, 3)
    for message in (listing(source=OTHER), count(3, source=OTHER), item(A, 0, source=OTHER)):
        output = copter.receive(message, 0.0)
        assert (short(output), output.events) == ([("ACK", wire.DENIED, OTHER)], ())
    assert short(copter.receive(listing(), 0.0)) == [("ACK", wire.DENIED, GROUND)]
    assert short(copter.receive(request(0), 0.0)) == [("ACK", wire.DENIED, GROUND)]
    assert short(copter.receive(clear(), 0.0)) == [("ACK", wire.ERROR, GROUND)]
    copter.receive(item(A, 0), 0.1)
    assert short(copter.receive(count(2), 0.2)) == [("REQUEST", 0, GROUND)]


def test_ardupilot_answers_items_without_an_upload_by_an_ack_alone(copter):
    begin(copter, 2)
    copter.receive(item(A, 0), 0.1)
    assert short(copter.receive(item(B, 1), 0.2)) == [("ACK", wire.ACCEPTED, GROUND)]
    for message in (item(B, 1), item(C, 0), item(A, 1, source=OTHER), item(A, 0, kind=1)):
        output = copter.receive(message, 0.3)
        assert ([answer.type for answer in output.messages], output.events) == ([wire.ERROR], ())
    for message in (item(A, 0, kind=3), request(0, kind=3)):
        assert short(copter.receive(message, 0.4)) == [("ACK", wire.UNSUPPORTED, GROUND)]
    assert short(copter.receive(request(9, kind=1), 0.5)) == [("ACK", wire.INVALID_SEQUENCE, GROUND)]


def test_ardupilot_answers_requests_at_any_time(copter):
    assert short(copter.receive(request(2), 9.0)) == [("ITEM_INT", 2, GROUND)]
    assert short(copter.receive(request(4), 9.0)) == [
        ("COUNT", 4, GROUND),
        ("ACK", wire.INVALID_SEQUENCE, GROUND),
    ]
    copter.receive(listing(), 9.0)
    output = copter.receive(request(1, integer=False), 9.0)
    assert short(output) == [("ITEM", 1, GROUND)]
    assert texts(output) == ["got MISSION_REQUEST; use MISSION_REQUEST_INT!"]
    assert texts(copter.receive(request(2, integer=False), 9.0)) == []


def test_ardupilot_clears_what_it_may(copter):
    assert short(copter.receive(clear(255), 9.0)) == [("ACK", wire.UNSUPPORTED, GROUND)]
    assert short(copter.receive(count(1, kind=7), 0.0)) == [("ACK", wire.UNSUPPORTED, GROUND)]
    copter.locked = True
    assert short(copter.receive(clear(), 9.0)) == [("ACK", wire.ERROR, GROUND)]
    assert copter.plan(MISSION).items == (C, C, C)
    assert short(copter.receive(clear(1), 9.0)) == [("ACK", wire.ACCEPTED, GROUND)]


@pytest.mark.parametrize(
    ("bad", "result"),
    [
        (MissionItem(177, 2, 0.0, 1.0), wire.ERROR),
        (MissionItem(177, 2, 1.0, 1.0), wire.ACCEPTED),
        (MissionItem(16, 3, None, x=1, y=2, z=3), wire.INVALID_PARAM1),
        (MissionItem(16, 3, 0.0, param4=None, x=1, y=2, z=3), wire.ACCEPTED),
        (MissionItem(19, 3, 0.0, param4=None, x=1, y=2, z=3), wire.INVALID_PARAM1 + 3),
        (MissionItem(16, 2, x=1, y=2, z=3), wire.UNSUPPORTED_FRAME),
        (MissionItem(16, 1, x=280382014, y=-821497984, z=3), wire.UNSUPPORTED_FRAME),
        (MissionItem(201, 2, x=280382014, y=-821497984, z=3), wire.ACCEPTED),
    ],
)
def test_ardupilot_judges_items(copter, bad, result):
    begin(copter, 3)
    copter.receive(item(A, 0), 0.1)
    output = copter.receive(item(bad, 1), 0.2)
    assert short(output) == ([("REQUEST", 2, GROUND)] if result == 0 else [("ACK", result, GROUND)])


@pytest.mark.parametrize(
    ("bad", "result"),
    [
        (MissionItem(20, 3), wire.UNSUPPORTED),
        (MissionItem(20, 2), wire.ACCEPTED),
        (MissionItem(16, 10, x=1, y=2), wire.UNSUPPORTED_FRAME),
        (MissionItem(201, 3, 1.0, x=1, y=2), wire.INVALID_PARAM1),
        (MissionItem(201, 3, 3.0, x=1, y=2), wire.ACCEPTED),
    ],
)
def test_px4_judges_items(server, bad, result):
    begin(server, 2)
    output = server.receive(item(bad, 0), 0.1)
    assert short(output) == ([("REQUEST_INT", 1, GROUND)] if result == 0 else [("ACK", result, GROUND)])


def test_what_is_kept_of_items(server, copter):
    server.set_plan(MISSION, (A,))
    server.receive(listing(), 0.0)
    assert server.receive(request(0, integer=False), 0.1).messages[0].frame == 3
    back = server.receive(request(0), 0.1).messages[0]
    assert back.frame == 6
    assert math.isnan(back.param4)
    items = (MissionItem(20, 2), MissionItem(93, 2, 3.0), MissionItem.waypoint(1, 2, 3, hold_s=2.7))
    begin(copter, 3 + 1)
    copter.receive(item(A, 0), 0.1)
    copter.receive(item(items[0], 1), 0.1)
    copter.receive(item(items[1], 2), 0.1)
    copter.receive(item(items[2], 3), 0.1)
    back = [copter.receive(request(seq), 1.0).messages[0] for seq in (1, 2, 3)]
    assert [(b.frame, b.param1, b.param2) for b in back] == [(0, 0.0, 0.0), (0, 3.0, 0.0), (3, 2.0, 0.0)]


def write_part(first, last, kind=0):
    return sent(mavlink.MAVLink_mission_write_partial_list_message(1, 1, first, last, kind))


def test_ardupilot_writes_a_part(copter):
    copter.set_plan(MISSION, (kept(A), kept(B), kept(C)))
    assert short(copter.receive(write_part(2, 2), 0.0)) == [("REQUEST", 2, GROUND)]
    output = copter.receive(item(C, 2), 0.1)
    assert short(output) == [("ACK", 0, GROUND)]
    assert copter.plan(MISSION).items == (kept(A), kept(C), kept(C))
    copter.receive(write_part(4, 4), 0.0)
    copter.receive(item(B, 4), 0.1)
    assert copter.plan(MISSION).items == (kept(A), kept(C), kept(C), kept(B))
    copter.receive(write_part(0, 1), 0.0)
    copter.receive(item(C, 0), 0.1)
    copter.receive(item(B, 1), 0.1)
    assert copter.plan(MISSION).items == (kept(B), kept(C), kept(C), kept(B))
    for first, last in ((3, 2), (0, 6), (-1, 2)):
        assert short(copter.receive(write_part(first, last), 0.0)) == [("ACK", wire.ERROR, GROUND)]
    copter.receive(write_part(1, 3), 1.0)
    copter.receive(item(A, 1), 1.1)
    copter.poll(10.0)
    assert copter.plan(MISSION).items == (kept(A), kept(C), kept(C), kept(B))


def corner(corners, latitude, command=5001):
    return MissionItem(command, 0, float(corners), x=latitude, y=-82.0)


@pytest.mark.parametrize(
    ("fence", "result"),
    [
        ([corner(3, 28.0), corner(3, 28.1), corner(3, 28.2)], 0),
        ([corner(3, 28.0), corner(3, 28.1)], 1),
        ([corner(4, 28.0), corner(4, 28.1), corner(4, 28.2)], 1),
        ([corner(3, 28.0), corner(3, 28.1), corner(3, 28.2, 5002)], 1),
        ([corner(0, 28.0, 5003)], 1),
        ([corner(-5, 28.0, 5004)], 1),
        ([corner(0, 28.0, 5000)], 0),
        ([corner(0, 28.0, 5000), corner(0, 28.1, 5000)], 1),
    ],
)
def test_ardupilot_takes_only_a_whole_fence(copter, server, fence, result):
    before = (corner(30, 28.0, 5003),)
    for vehicle, expected in ((copter, result), (server, 0)):
        vehicle.set_plan(FENCE, before)
        vehicle.receive(count(len(fence), FENCE), 0.0)
        for seq, plan_item in enumerate(fence):
            assert vehicle.plan(FENCE).items == before
            output = vehicle.receive(item(plan_item, seq, FENCE), 0.1)
        assert [answer.type for answer in output.messages] == [expected]
        assert len(vehicle.plan(FENCE).items) == (len(before) if expected else len(fence))
        assert ("Fence validation failed" in texts(output)) == bool(expected)
        assert vehicle.state is ServerState.IDLE


def test_ardupilot_keeps_its_fence_when_the_ground_station_falls_silent(copter):
    before = tuple(corner(3, latitude) for latitude in (28.0, 28.1, 28.2))
    copter.set_plan(FENCE, before)
    copter.receive(count(2, FENCE), 0.0)
    copter.receive(item(corner(30, 28.0, 5003), 0, FENCE), 0.1)
    copter.poll(20.0)
    assert copter.state is ServerState.IDLE and copter.plan(FENCE).items == before


def test_px4_refuses_counts_for_a_while_after_an_empty_one(server):
    assert short(server.receive(count(0), 0.0)) == [("ACK", 0, GROUND)]
    assert short(server.receive(count(2), 4.9)) == [("ACK", wire.ERROR, GROUND)]
    assert short(server.receive(count(2), 5.0)) == [("REQUEST_INT", 0, GROUND)]


def test_px4_wants_requests_of_one_kind(server):
    server.set_plan(MISSION, (A, B))
    server.receive(listing(), 0.0)
    server.receive(request(0), 0.1)
    assert short(server.receive(request(1, integer=False), 0.2)) == [("ACK", wire.ERROR, GROUND)]
    assert short(server.receive(request(1), 0.3)) == [("ITEM_INT", 1, GROUND)]


def test_the_plans_id_is_in_ack_and_count(server):
    begin(server, 1)
    (message,) = server.receive(item(A, 0), 0.1).messages
    assert sent(message, (1, 1)).opaque_id == plan_checksum((A,)) == server.plan(MISSION).opaque_id != 0
    (message,) = server.receive(listing(), 0.2).messages
    assert sent(message, (1, 1)).opaque_id == server.plan(MISSION).opaque_id


whole = st.integers(0, 5)
sources = st.sampled_from([GROUND, OTHER])
kind_numbers = st.sampled_from([0, 0, 0, 1, 2, 7, 255])
any_message = st.one_of(
    st.builds(count, whole, kind_numbers, sources),
    st.builds(
        item, st.sampled_from([A, B, MissionItem(5100, 3)]), whole, kind_numbers, sources, st.booleans()
    ),
    st.builds(request, whole, kind_numbers, sources, st.booleans()),
    st.builds(listing, kind_numbers, sources),
    st.builds(ack, st.integers(0, 16), kind_numbers, sources),
    st.builds(clear, kind_numbers, sources),
    st.builds(
        lambda a, b, c: sent(mavlink.MAVLink_mission_write_partial_list_message(1, 1, a, b, c)),
        whole,
        whole,
        kind_numbers,
    ),
)


@sweep(few=100, many=600)
@given(
    st.lists(st.tuples(any_message, st.floats(0, 3)), max_size=60), st.sampled_from([PX4, ARDUPILOT, GENERIC])
)
def test_random_messages_never_raise_and_are_never_broadcast(steps, profile):
    server = MissionServer(1, profile=profile, capacity={MISSION: 4})
    now_s = 0.0
    for message, wait_s in steps:
        now_s += wait_s
        outputs = [server.poll(now_s), server.receive(message, now_s)]
        for reply in (m for output in outputs for m in output.messages):
            assert (reply.target_system, reply.target_component) in (GROUND, OTHER)
            FrameWriter(1, 1).encode(reply)
        for event in (e for output in outputs for e in output.events):
            if isinstance(event, StatusText):
                assert len(event.text) <= 50
    for _ in range(100):
        deadline_s = server.next_deadline()
        if deadline_s is None:
            break
        now_s = max(now_s, deadline_s)
        server.poll(now_s)
    assert not server.busy
