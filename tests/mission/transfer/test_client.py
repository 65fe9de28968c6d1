"""The ground station's side, row by row, and against random messages."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweeps import sweep

from mission.autopilots import ARDUPILOT, PX4
from mission.link import FrameReader, FrameWriter
from mission.link.codec.dialect import mavlink
from mission.model import Command, GeoPoint, MissionItem, MissionType
from mission.transfer import (
    ClearComplete,
    ClientTimers,
    DownloadComplete,
    FailureReason,
    LocalTransferError,
    MissionClear,
    MissionDownload,
    MissionUpload,
    PlanState,
    Progress,
    RoundTrip,
    TransferFailed,
    UploadBegunAnew,
    UploadComplete,
    UploadVerified,
    VerifiedUpload,
    check_plan,
    result_text,
    wire,
)
from mission.transfer.client import CLIENT_TABLE, ClientInput, ClientState

MISSION, FENCE, RALLY = MissionType
GROUND = (255, 190)
A, B, C = (MissionItem.waypoint(28.0 + k / 1000, -82.0, 5.0 + k) for k in range(3))


def sent(message, source=(1, 1)):
    (got,) = FrameReader().feed(FrameWriter(*source).encode(message))
    return got


def request(sequence, kind=0, target=GROUND, source=(1, 1)):
    return sent(mavlink.MAVLink_mission_request_int_message(*target, sequence, kind), source)


def ack(result, kind=0, target=GROUND, source=(1, 1)):
    return sent(mavlink.MAVLink_mission_ack_message(*target, result, kind), source)


def count(number, kind=0):
    return sent(mavlink.MAVLink_mission_count_message(*GROUND, number, kind))


def item(plan_item, sequence, kind=0, integer=True):
    return sent(wire.item_to_message(plan_item, sequence, kind, GROUND, integer=integer))


def names(output):
    return [message.get_type()[8:] for message in output.messages]


def start(machine, now_s=0.0):
    machine.start(now_s)
    return machine


def test_upload():
    upload = MissionUpload((A, B), start_sequence=1)
    (opening,) = upload.start(0.0).messages
    assert (opening.count, opening.target_system, opening.target_component) == (2, 1, 1)
    output = upload.receive(request(0), 0.1)
    assert (output.messages[0].seq, output.messages[0].current) == (0, 0)
    assert output.events == (Progress(MISSION, 1, 2),)
    assert upload.receive(ack(0), 0.15).events == ()  # too early to be ours
    assert upload.receive(request(1), 0.2).messages[0].current == 1
    assert upload.state is ClientState.CONFIRMING
    assert upload.receive(ack(0), 0.3).events == (UploadComplete(MISSION, 2),)
    assert upload.done
    assert upload.next_deadline() is None
    assert upload.round_trip.seconds == pytest.approx(0.1)
    statistics = upload.statistics()
    assert (statistics.items, statistics.messages_sent, statistics.messages_received) == (2, 3, 4)
    assert (statistics.retries, statistics.duration_s) == (0, pytest.approx(0.3))
    assert upload.receive(request(0), 0.4).messages == ()
    assert upload.poll(100.0).messages == ()


def test_plain_requests_are_answered_with_integer_items():
    upload = start(MissionUpload((A,)))
    message = sent(mavlink.MAVLink_mission_request_message(*GROUND, 0, 0))
    assert names(upload.receive(message, 0.1)) == ["ITEM_INT"]


def test_a_request_is_not_answered_twice_within_a_round_trip():
    upload = start(MissionUpload((A, B)))
    upload.receive(request(0), 0.2)
    assert upload.receive(request(0), 0.3).messages == ()
    assert names(upload.receive(request(0), 0.5)) == ["ITEM_INT"]
    assert upload.statistics().retries == 1
    assert upload.receive(request(2), 0.6).messages == ()  # beyond the plan


@pytest.mark.parametrize(
    ("transfer", "opening", "held"),
    [
        (MissionUpload((A, B)), "COUNT", PlanState.OLD),
        (MissionUpload(()), "CLEAR_ALL", PlanState.UNKNOWN),
        (MissionDownload(), "REQUEST_LIST", PlanState.OLD),
        (VerifiedUpload((A, B)), "COUNT", PlanState.OLD),
    ],
)
def test_a_vehicle_that_never_answers_is_asked_six_times(transfer, opening, held):
    start(transfer)
    times = []
    while not transfer.done:
        now_s = transfer.next_deadline()
        output = transfer.poll(now_s)
        times.append((now_s, *names(output)))
    assert times == [(1.5 * k, opening) for k in range(1, 6)] + [(9.0, "ACK")]
    assert output.messages[0].type == wire.OPERATION_CANCELLED
    (failed,) = output.events
    assert (failed.reason, failed.vehicle_plan) == (FailureReason.TIMEOUT, held)
    assert "at the start" in failed.text


def test_the_last_item_is_repeated_until_the_ack_comes():
    upload = start(MissionUpload((A,)))
    upload.receive(request(0), 0.1)
    assert upload.next_deadline() == pytest.approx(0.1 + 0.5)
    (again,) = upload.poll(0.6).messages
    assert again.seq == 0
    assert isinstance(upload.receive(ack(0), 0.7).events[0], UploadComplete)


def test_refusals_end_at_once_with_a_reason():
    for result in (2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 15, 99):
        upload = start(MissionUpload((A, B)))
        upload.receive(request(0), 0.1)
        output = upload.receive(ack(result), 0.2)
        assert output.messages == ()
        (failed,) = output.events
        assert (failed.reason, failed.result, failed.vehicle_plan) == (
            FailureReason.REFUSED,
            result,
            PlanState.OLD,
        )
        assert result_text(result) in failed.text
        assert "\n" not in failed.text


@pytest.mark.parametrize("result", [13, 14])
def test_trouble_ends_only_if_nothing_better_follows(result):
    upload = start(MissionUpload((A, B)))
    upload.receive(request(0), 0.1)
    assert upload.receive(ack(result), 0.2).events == ()
    assert names(upload.receive(request(1), 0.3)) == ["ITEM_INT"]
    assert isinstance(upload.receive(ack(0), 0.4).events[0], UploadComplete)
    upload = start(MissionUpload((A, B)))
    upload.receive(request(0), 0.1)
    upload.receive(ack(result), 0.2)
    while not upload.done:
        output = upload.poll(now_s := upload.next_deadline())
    assert now_s < 5.0
    assert (output.events[0].result, output.events[0].reason) == (result, FailureReason.REFUSED)


def test_a_vehicle_that_asks_for_ever_does_not_keep_us():
    upload = start(MissionUpload((A, B)))
    now_s = 0.0
    while not upload.done:
        now_s += 0.25
        assert now_s < 60.0
        upload.receive(request(0), now_s)
        upload.poll(now_s)


def test_cancel():
    upload = start(MissionUpload((A, B)))
    upload.receive(request(0), 0.1)
    output = upload.cancel(0.2)
    assert output.messages[0].type == wire.OPERATION_CANCELLED
    assert output.events[0].reason is FailureReason.CANCELLED
    assert output.events[0].vehicle_plan is PlanState.OLD
    with pytest.raises(LocalTransferError, match="over"):
        upload.cancel(0.3)
    assert MissionUpload((A,)).cancel(0.0).messages == ()


def test_misuse_is_a_local_error():
    with pytest.raises(LocalTransferError, match="started before"):
        start(start(MissionDownload()))
    with pytest.raises(LocalTransferError, match="send a shorter plan"):
        check_plan([A] * 65535, MISSION)
    with pytest.raises(LocalTransferError, match="item 2: command 16 does not belong in a fence plan"):
        MissionUpload((MissionItem(5003, 3, 5.0), A), FENCE)
    with pytest.raises(LocalTransferError, match="window"):
        MissionDownload(window=0)


def test_an_empty_plan_is_a_clear():
    upload = MissionUpload(())
    assert names(upload.start(0.0)) == ["CLEAR_ALL"]
    assert upload.receive(request(0), 0.1).messages == ()
    assert isinstance(upload.receive(ack(0), 0.2).events[0], UploadComplete)


def test_others_are_not_heard():
    upload = start(MissionUpload((A,)))
    for message in (
        request(0, kind=1),
        request(0, target=(254, 190)),
        request(0, target=(255, 1)),
        request(0, source=(2, 1)),
        request(0, source=(1, 100)),
        ack(3, kind=2),
        sent(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3)),
    ):
        assert upload.receive(message, 0.1) == upload.poll(0.1)
    assert names(upload.receive(request(0, target=(255, 0)), 0.1)) == ["ITEM_INT"]


def test_home_first_for_ardupilot():
    jump = MissionItem(Command.DO_JUMP, 2, 0.0, 2.0)
    upload = MissionUpload((A, jump), profile=ARDUPILOT, home=GeoPoint(28.0, -82.0, 9.0))
    assert upload.start(0.0).messages[0].count == 3
    first = upload.receive(request(0), 0.1).messages[0]
    assert (first.command, first.frame, first.x, first.z, first.current) == (16, 0, 280000000, 9.0, 0)
    second = upload.receive(request(1), 0.2).messages[0]
    assert (wire.item_from_message(second), second.current) == (A, 1)
    assert upload.receive(request(2), 0.3).messages[0].param1 == 1.0
    download = start(MissionDownload(profile=ARDUPILOT))
    download.receive(count(3), 0.1)
    for message in (first, second):
        message.target_system, message.target_component = GROUND
        download.receive(sent(message), 0.2)
    end = download.receive(item(MissionItem(Command.DO_JUMP, 2, 1.0, 2.0), 2), 0.3).events[-1]
    assert end.items == (A, jump)
    assert end.home == GeoPoint(28.0, -82.0, 9.0)


def test_download():
    download = MissionDownload()
    assert names(download.start(0.0)) == ["REQUEST_LIST"]
    assert download.receive(item(A, 0), 0.05).messages == ()
    assert download.receive(count(2), 0.1).messages[0].seq == 0
    assert download.next_deadline() == pytest.approx(0.1 + 0.4)
    assert names(download.poll(0.5)) == ["REQUEST_INT"]
    assert download.receive(item(A, 0), 0.55).messages[0].seq == 1
    assert download.receive(item(A, 0), 0.7).messages == ()
    output = download.receive(item(B, 1, integer=False), 0.8)
    assert output.messages[0].type == wire.ACCEPTED
    assert isinstance(output.events[-1], DownloadComplete)
    assert output.events[-1].items[0] == A
    assert download.statistics().retries == 1
    # An item that was asked for twice measures nothing: 0.1 s of the list, an eighth of the way to 0.25 s.
    assert download.round_trip.seconds == pytest.approx(0.1 + 0.15 / 8.0)


def test_download_of_nothing():
    output = start(MissionDownload()).receive(count(0), 0.1)
    assert names(output) == ["ACK"]
    assert output.events == (DownloadComplete(MISSION, ()),)


def test_window():
    download = start(MissionDownload(profile=ARDUPILOT, window=3))
    assert [m.seq for m in download.receive(count(9), 0.1).messages] == [0, 1, 2]
    assert [m.seq for m in download.receive(item(A, 1), 0.2).messages] == [3]
    assert MissionDownload(profile=PX4).window == 1
    assert MissionDownload(profile=ARDUPILOT).window == 10


def test_download_starts_anew_when_the_vehicle_has_left():
    download = start(MissionDownload())
    download.receive(count(3), 0.1)
    download.receive(item(A, 0), 0.2)
    download.receive(ack(1), 0.3)
    assert names(download.poll(download.next_deadline())) == ["REQUEST_LIST"]
    assert download.receive(count(3), 1.0).messages[0].seq == 0


def test_a_broken_item_ends_the_download():
    download = start(MissionDownload())
    download.receive(count(1), 0.1)
    bad = wire.item_to_message(A, 0, 0, GROUND)
    bad.x = 2_000_000_000
    output = download.receive(sent(bad), 0.2)
    assert output.events[0].reason is FailureReason.BROKEN
    assert "item 1 of the vehicle" in output.events[0].text
    assert output.messages[0].type == wire.OPERATION_CANCELLED


def test_clear():
    machine = start(MissionClear(RALLY))
    assert machine.receive(ack(0, kind=2), 0.1).events == (ClearComplete(RALLY),)
    machine = start(MissionClear(RALLY))
    assert machine.receive(ack(3, kind=2), 0.1).events[0].vehicle_plan is PlanState.UNKNOWN


def verified(held):
    """A verified upload of (A, B) on a vehicle that accepts and then shows other items."""
    machine = VerifiedUpload((A, B))
    outputs = [machine.start(0.0), *(machine.receive(request(k), 0.1 + k / 10) for k in (0, 1))]
    outputs.append(machine.receive(ack(0), 0.3))
    now_s = 0.3
    while not machine.done:
        now_s += 0.1
        last = outputs[-1].messages[-1]
        answer = (
            count(len(held)) if last.get_type() == "MISSION_REQUEST_LIST" else item(held[last.seq], last.seq)
        )
        outputs.append(machine.receive(answer, now_s))
    return machine, outputs[-1].events[-1]


def test_verified_upload():
    machine, end = verified((A, B))
    assert end == UploadVerified(MISSION, 2)
    statistics = machine.statistics()
    assert statistics.verified
    assert statistics.messages_sent == 3 + 4
    machine, end = verified((A, C))
    assert end.reason is FailureReason.DIFFERENT
    assert "item 2: x was sent as" in end.text
    assert [difference.field for difference in machine.differences] == ["x", "z"]
    assert not machine.statistics().verified
    _, end = verified((A,))
    assert "2 items were sent, the vehicle holds 1" in end.text


def test_verified_upload_cancelled_while_reading():
    machine = start(VerifiedUpload((A,)))
    machine.receive(request(0), 0.1)
    assert names(machine.receive(ack(0), 0.2)) == ["REQUEST_LIST"]
    output = machine.cancel(0.3)
    assert output.messages[0].type == wire.OPERATION_CANCELLED
    assert (output.events[0].reason, output.events[0].vehicle_plan) == (
        FailureReason.CANCELLED,
        PlanState.UNKNOWN,
    )
    with pytest.raises(LocalTransferError):
        machine.cancel(0.4)


def test_adaptive_waiting():
    trip = RoundTrip()
    for _ in range(50):
        trip.sample(0.01)
    assert trip.wait(0.25, 0.1, 1.5) == pytest.approx(0.1)
    for _ in range(100):
        trip.sample(0.6)
    assert trip.wait(0.25, 0.1, 1.5) == 1.5
    for _ in range(100):
        trip.sample(4.0)
    assert trip.wait(0.25, 0.1, 1.5) == pytest.approx(4.4, rel=1e-3), "never before an answer can have come"


def test_the_table_uses_every_input_and_state_and_each_action_is_done_by_a_transfer():
    kinds = (MissionClear, MissionUpload, MissionDownload)
    for action, _ in CLIENT_TABLE.values():
        assert any(hasattr(kind, "_" + action.replace(" ", "_")) for kind in kinds), action
    assert {found for _, found in CLIENT_TABLE} == set(ClientInput)
    assert {state for state, _ in CLIENT_TABLE} == set(ClientState)


whole = st.integers(0, 4)
number = st.sampled_from([0, 0, 0, 1, 2, 255])
any_message = st.one_of(
    st.builds(request, whole, number),
    st.builds(ack, st.integers(0, 16), number),
    st.builds(count, whole, number),
    st.builds(item, st.sampled_from([A, B, C]), whole, number, st.booleans()),
)
machines = st.sampled_from(
    [
        lambda: MissionUpload((A, B, C)),
        lambda: MissionUpload(()),
        lambda: MissionUpload((A,), profile=ARDUPILOT),
        lambda: MissionDownload(),
        lambda: MissionDownload(profile=ARDUPILOT),
        lambda: MissionClear(MISSION),
        lambda: VerifiedUpload((A, B)),
    ]
)


@sweep(few=120, many=800)
@given(machines, st.lists(st.tuples(any_message, st.floats(0, 2)), max_size=60))
def test_random_messages_never_raise_and_it_always_ends(make, steps):
    machine = make()
    events = list(machine.start(0.0).events)
    now_s = 0.0
    for message, wait_s in steps:
        now_s += wait_s
        events += machine.poll(now_s).events
        events += machine.receive(message, now_s).events
    for _ in range(3000):
        deadline_s = machine.next_deadline()
        if deadline_s is None:
            break
        now_s = max(now_s, deadline_s)
        events += machine.poll(now_s).events
    assert machine.done
    ends = [e for e in events if not isinstance(e, Progress | UploadBegunAnew)]
    assert len(ends) == 1
    assert ends == events[-1:]
    assert isinstance(
        ends[0], TransferFailed | UploadComplete | UploadVerified | DownloadComplete | ClearComplete
    )


def test_timers_can_be_changed():
    upload = start(MissionUpload((A,), timers=ClientTimers(reply_s=0.2, retries=1)))
    assert upload.next_deadline() == pytest.approx(0.2)
    upload.poll(0.2)
    assert upload.poll(0.4).events[0].reason is FailureReason.TIMEOUT


@pytest.mark.parametrize(("round_trip_s", "silence_s"), [(0.01, 10.0), (0.2, 16.0), (3.0, 30.0)])
def test_silence_lasts_twenty_attempts_on_a_slow_link(round_trip_s, silence_s):
    upload = start(MissionUpload((A, B, A)))
    upload.receive(request(0), round_trip_s)
    upload.receive(request(1), 2.0 * round_trip_s)
    while not upload.done:
        now_s = upload.next_deadline()
        output = upload.poll(now_s)
    assert now_s == pytest.approx(2.0 * round_trip_s + silence_s)
    (failed,) = output.events
    assert (failed.reason, failed.vehicle_plan) == (FailureReason.TIMEOUT, PlanState.OLD)
