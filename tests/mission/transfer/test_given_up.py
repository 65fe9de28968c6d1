"""Uploads that the vehicle gives up: recorded, and in every order of messages."""

import ast
import csv
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from sweeps import sweep
from transfer_network import GROUND, make_items

from mission.autopilots import ARDUPILOT, PX4
from mission.link.codec.dialect import mavlink as m
from mission.transfer import (
    FailureReason,
    MissionUpload,
    RoundTrip,
    TransferFailed,
    UploadBegunAnew,
    VerifiedUpload,
)

RECORDED = Path(__file__).parents[2] / "data" / "px4_upload_given_up.csv"
ERROR, CANCELLED = m.MAV_MISSION_ERROR, m.MAV_MISSION_OPERATION_CANCELLED
# Some report of a real PX4 has an ACK with its "Operation timeout", the recorded one has none.
PERSONAS = {"px4": PX4, "px4 that answers": replace(PX4, abort_result=ERROR), "ardupilot": ARDUPILOT}


def from_vehicle(message, system_id=1):
    message._header = m.MAVLink_header(message.get_msgId(), srcSystem=system_id, srcComponent=1)
    return message


def request(seq):
    return from_vehicle(m.MAVLink_mission_request_int_message(*GROUND, seq, 0))


def ack(result):
    return from_vehicle(m.MAVLink_mission_ack_message(*GROUND, result, 0))


def names(output):
    return [one.get_type().removeprefix("MISSION_") for one in output.messages]


def recorded():
    """What the real PX4 sent: seconds and messages."""
    with RECORDED.open(newline="", encoding="utf-8") as file:
        for time_s, who, name, fields in csv.reader(file):
            if who == "3/1" and name in ("MISSION_REQUEST_INT", "MISSION_ACK"):
                told = ast.literal_eval(fields)
                message = request(told["seq"]) if "seq" in told else ack(told["type"])
                yield float(time_s), message


def test_the_recorded_upload_ends_with_the_first_error():
    """The station sent items for 32 s into no transfer."""
    upload = VerifiedUpload(make_items(11, 1), source=GROUND, profile=PX4)
    sent = [(56.87, name) for name in names(upload.start(56.87))]
    events = []
    for time_s, message in recorded():
        while (due_s := upload.next_deadline()) is not None and due_s <= time_s:
            output = upload.poll(due_s)
            sent += [(due_s, name) for name in names(output)]
            events += output.events
        output = upload.receive(message, time_s)
        sent += [(time_s, name) for name in names(output)]
        events += output.events
        if time_s > 75.0:
            break
    begun_anew = [event for event in events if isinstance(event, UploadBegunAnew)]
    assert len(begun_anew) == 1
    assert [name for time_s, name in sent if time_s == 67.11] == ["ACK", "COUNT"]
    assert {name for time_s, name in sent if time_s > 67.11} == {"COUNT"}, "no item before it is asked for"
    # As soon as the vehicle takes the new COUNT, the upload goes on from its first item.
    assert names(upload.receive(request(0), 76.0)) == ["ITEM_INT"]


ANY_MESSAGE = st.one_of(
    st.integers(0, 6).map(request),
    st.sampled_from([ERROR, ERROR, m.MAV_MISSION_INVALID_SEQUENCE, m.MAV_MISSION_DENIED]).map(ack),
)


@sweep(few=120, many=600)
@given(
    came=st.lists(st.tuples(ANY_MESSAGE, st.floats(0.0, 3.0)), max_size=60),
    profile=st.sampled_from(list(PERSONAS)),
)
@example(came=[(request(0), 0.1), (ack(ERROR), 0.1), (request(1), 0.1), (request(0), 0.1)], profile="px4")
def test_in_every_order_of_messages(came, profile):
    """After an ERROR nothing but the first item of a new upload is sent; the items go up one by one."""
    upload = VerifiedUpload(make_items(5, 1), source=GROUND, profile=PERSONAS[profile])
    upload.start(now_s := 0.0)
    highest, awaits_first, begun = -1, True, 1

    def look(output, asked):
        nonlocal highest, awaits_first, begun
        for message in output.messages:
            if message.get_type() == "MISSION_REQUEST_LIST":
                highest = -1
            if message.get_type() == "MISSION_COUNT":
                highest, awaits_first, begun = (-1, True, begun) if highest >= 0 else (highest, True, begun)
            if message.get_type() == "MISSION_ITEM_INT":
                assert not awaits_first or message.seq == asked == 0, "an item of an upload that is over"
                assert message.seq <= highest + 1 or begun == 1
                awaits_first, highest = False, max(highest, message.seq)
        begun += sum(isinstance(event, UploadBegunAnew) for event in output.events)

    for message, after_s in came:
        end_s = now_s + after_s
        while (due_s := upload.next_deadline()) is not None and due_s <= end_s:
            look(upload.poll(due_s), None)
        if upload.done:
            break
        now_s = end_s
        sent_before = highest >= 0 and not awaits_first
        output = upload.receive(message, now_s)
        if message.get_type() == "MISSION_ACK" and message.type == ERROR and sent_before:
            told = [one for one in output.messages if one.get_type() != "MISSION_REQUEST_LIST"]
            assert [one.get_type() for one in told] in (["MISSION_ACK", "MISSION_COUNT"], ["MISSION_ACK"])
            assert told[0].type == CANCELLED
        look(output, getattr(message, "seq", None))
    assert begun <= 6
    while (due_s := upload.next_deadline()) is not None:
        assert due_s < now_s + 300.0, "it ends"
        upload.poll(due_s)
    assert upload.done


def silent(_sent, _now_s):
    return []


def busy(sent, _now_s):
    return [ack(ERROR)] if sent.get_type() == "MISSION_COUNT" else []


def asks_for_ever(sent, _now_s):
    return [request(0)] if sent.get_type() in ("MISSION_COUNT", "MISSION_ITEM_INT") else []


def gives_up_at_once(sent, _now_s):
    asked = sent.get_type() == "MISSION_COUNT"
    return [request(0)] if asked else [ack(ERROR)] if sent.get_type() == "MISSION_ITEM_INT" else []


def gives_up_slowly(sent, now_s):
    return gives_up_at_once(sent, now_s)


@pytest.mark.parametrize("profile", [PX4, ARDUPILOT], ids=lambda one: one.name)
@pytest.mark.parametrize("vehicle", [silent, busy, asks_for_ever, gives_up_at_once, gives_up_slowly])
@pytest.mark.parametrize("loss", [0.0, 0.3])
@pytest.mark.parametrize("trip_s", [None, 0.05, 1.0, 4.0])
def test_an_upload_that_never_gets_under_way_ends_within_30_s(profile, vehicle, loss, trip_s):
    """Two vehicles that took no item kept an operator waiting for 150 s."""
    trip = RoundTrip()
    trip.loss = loss
    if trip_s is not None:
        trip.sample(trip_s)
    upload = VerifiedUpload(make_items(4, 1), source=GROUND, profile=profile, round_trip=trip)
    now_s, waiting, events = 0.0, [], []
    late_s = 4.0 if vehicle is gives_up_slowly else trip_s or 0.05

    def take(output):
        events.extend(output.events)
        for sent in output.messages:
            listed = sent.get_type() == "MISSION_REQUEST_LIST"
            empty = from_vehicle(m.MAVLink_mission_count_message(*GROUND, 0, 0))
            answers = [empty] if listed else vehicle(sent, now_s)
            waiting.extend((now_s + late_s, answer) for answer in answers)

    take(upload.start(now_s))
    while not upload.done:
        due_s = upload.next_deadline()
        if waiting and waiting[0][0] <= due_s:
            now_s, answer = waiting.pop(0)
            take(upload.receive(answer, now_s))
        else:
            now_s = due_s
            take(upload.poll(now_s))
        # An ArduPilot, which overwrites in place, is read after an answer that is no clear end.
        assert now_s <= 30.0 + 4.0 * late_s * (profile is ARDUPILOT)
    last = events[-1]
    assert isinstance(last, TransferFailed)
    assert last.reason in (FailureReason.TIMEOUT, FailureReason.REFUSED)
    assert last.text.startswith("upload of the mission")
    assert "\n" not in last.text


def test_answers_to_repetitions_do_not_put_the_end_off():
    """An ArduPilot that answers each repeated item with INVALID_SEQUENCE and asks for nothing."""
    upload = MissionUpload(make_items(5, 1), source=GROUND, profile=ARDUPILOT)
    upload.start(0.0)
    upload.receive(request(0), 0.1)
    upload.receive(request(1), 0.2)
    now_s = 0.2
    while not upload.done:
        now_s = upload.next_deadline()
        for sent in names(upload.poll(now_s)):
            if sent == "ITEM_INT":
                upload.receive(ack(m.MAV_MISSION_INVALID_SEQUENCE), now_s + 0.05)
        assert now_s < 6.0


def test_an_item_that_the_vehicle_does_not_take_is_sent_twice_at_most():
    """PX4 answers with the same ERROR, but nothing had to be repeated: time was not what it wanted."""
    items = make_items(5, 1)
    upload = VerifiedUpload(items, source=GROUND, profile=PX4)
    upload.start(0.0)
    counts = 0
    for attempt in range(2):
        now_s = 1.0 * attempt
        for seq in range(3):
            now_s += 0.01
            upload.receive(request(seq), now_s)
        output = upload.receive(ack(ERROR), now_s + 0.01)
        counts += sum(one.get_type() == "MISSION_COUNT" for one in output.messages)
    (failed,) = output.events
    assert counts == 1
    assert (failed.reason, failed.result, failed.item) == (FailureReason.REFUSED, ERROR, 2)
    assert upload.done


def test_each_upload_is_marked_anew():
    """A vehicle in flight has passed a waypoint when its mission is sent for the second time."""
    marks = iter([1, 3])
    upload = VerifiedUpload(make_items(5, 1), source=GROUND, profile=PX4, start_sequence=lambda: next(marks))
    upload.start(0.0)
    marked = []
    for _ in range(2):
        for seq in range(5):
            (item,) = upload.receive(request(seq), 0.1).messages
            marked += [seq] * item.current
        upload.receive(ack(ERROR), 0.2)
    assert marked == [1, 3]


@pytest.mark.parametrize("result", [ERROR, CANCELLED])
@pytest.mark.parametrize("patience_s", [2.0, 5.0, 8.0])
@settings(max_examples=25, deadline=None)
@given(taken=st.integers(1, 9))
def test_a_vehicle_that_never_finishes_an_upload_is_given_up_within_30_s(result, patience_s, taken):
    """It takes some items, waits, and breaks off, whenever the upload is begun anew."""
    upload = VerifiedUpload(make_items(10, 1), source=GROUND, profile=PX4)
    output, now_s, asked, ends_s = upload.start(0.0), 0.0, 0, None
    while not upload.done:
        answers = []
        for message in output.messages:
            if message.get_type() == "MISSION_COUNT":
                asked, ends_s = 0, now_s + patience_s
                answers.append(request(0))
            elif message.get_type() == "MISSION_ITEM_INT" and message.seq == asked < taken:
                asked, ends_s = asked + 1, now_s + patience_s
                answers.append(request(asked))
        if answers:
            now_s += 0.05
            output = upload.receive(answers[-1], now_s)
            continue
        due_s = upload.next_deadline()
        if ends_s is not None and ends_s <= due_s:
            now_s, ends_s = ends_s, None
            output = upload.receive(ack(result), now_s)
        else:
            now_s = due_s
            output = upload.poll(now_s)
        assert now_s < 30.0
    assert any(isinstance(event, TransferFailed) for event in output.events)


def counts(output):
    return [one.get_type() for one in output.messages].count("MISSION_COUNT")


@pytest.mark.parametrize("answer", [ERROR, CANCELLED])
def test_an_upload_that_was_under_way_has_its_time_again_where_it_begins_anew(answer):
    upload = VerifiedUpload(make_items(8, 1), source=GROUND, profile=PX4)
    upload.start(0.0)
    for begun_s in (0.0, 50.0, 100.0):
        for seq in range(5):
            upload.receive(request(seq), begun_s + 1.0 + 8.0 * seq)
        assert counts(upload.receive(ack(answer), begun_s + 42.0)) == 1
        # The vehicle takes the new COUNT five seconds later; meanwhile it is asked for in vain.
        while (due_s := upload.next_deadline()) < begun_s + 47.0:
            upload.poll(due_s)
        (item,) = upload.receive(request(0), begun_s + 47.0).messages
        assert item.seq == 0 and not upload.done
        upload.receive(request(1), begun_s + 47.5)


def test_a_vehicle_that_gave_up_and_is_busy_then_is_not_sent_the_plan_again_and_again():
    """What it took of the first try says nothing of the second."""
    upload, begun, now_s = VerifiedUpload(make_items(4, 1), target=(1, 1)), 0, 0.5
    upload.start(0.0)
    requests = [m.MAVLink_mission_request_int_message(255, 190, k, 0) for k in range(2)]
    acks = [m.MAVLink_mission_ack_message(255, 190, result, 0) for result in (15, 1)]
    for message in (*requests, *acks):
        message.pack(m.MAVLink(None, 1, 1))
        output = upload.receive(message, 0.4)
        begun += sum(isinstance(event, UploadBegunAnew) for event in output.events)
    while not upload.done and now_s < 60.0:
        now_s += 0.25
        begun += sum(isinstance(event, UploadBegunAnew) for event in upload.poll(now_s).events)
    assert (upload.done, begun) == (True, 1)
