"""The ground station's side, row by row, and against random messages."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweeps import sweep

from mission.autopilots import ARDUPILOT
from mission.link import FrameReader, FrameWriter
from mission.link.codec.dialect import mavlink
from mission.model import MissionItem, MissionType
from mission.transfer import (
    ClearComplete,
    DownloadComplete,
    FailureReason,
    LocalTransferError,
    MissionClear,
    MissionDownload,
    MissionUpload,
    PlanState,
    Progress,
    TransferFailed,
    UploadBegunAnew,
    UploadComplete,
    UploadVerified,
    VerifiedUpload,
    check_plan,
    result_text,
    wire,
)
from mission.transfer.client import ClientState

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
