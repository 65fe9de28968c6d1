"""Signed frames: who is heard, who is not, and that others' implementations agree."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.errors import LinkError
from mission.link import FrameReader, FrameWriter
from mission.link.codec.dialect import mavlink
from mission.link.codec.signing import Signing, key_from_text

KEY, OTHER = b"k" * 32, b"o" * 32
EPOCH_S = 1_420_070_400
START = mavlink.MAVLink_mission_set_current_message(1, 1, 3)


def frame(signing, message=START, source=(255, 190)):
    return FrameWriter(*source, signing=signing).encode(message)


def heard(signing, *frames):
    reader = FrameReader(signing=signing)
    return [len(reader.feed(data)) for data in frames]


def test_only_who_has_the_key_is_heard():
    ours = Signing(KEY)
    good = frame(Signing(KEY))
    assert good[2] == 1
    assert len(good) == len(frame(None)) + 13
    assert heard(ours, good, frame(Signing(OTHER)), frame(None)) == [1, 0, 0]
    assert (ours.statistics.good, ours.statistics.wrong, ours.statistics.unsigned) == (1, 1, 1)
    assert heard(None, good) == [1]  # without a key everything is believed


@given(st.integers(0, 40), st.integers(1, 255))
def test_any_changed_byte_is_noticed(place, change):
    good = bytearray(frame(Signing(KEY)))
    good[place % len(good)] ^= change
    assert heard(Signing(KEY), bytes(good)) == [0]


def test_version_1_and_unsigned_frames_are_refused_except_of_radios():
    codec = mavlink.MAVLink(None, 255, 190)
    old = bytes(START.pack(codec, force_mavlink1=True))
    radio = frame(None, mavlink.MAVLink_radio_status_message(1, 2, 3, 4, 5, 6, 7), (51, 68))
    assert heard(Signing(KEY), old, radio) == [0, 1]


def test_replays_are_refused():
    ours, writer = Signing(KEY), FrameWriter(255, 190, signing=Signing(KEY))
    first, second = writer.encode(START), writer.encode(START)
    assert heard(ours, second, second, first) == [1, 0, 0]
    assert ours.statistics.old == 2
    assert heard(ours, frame(Signing(KEY, link_id=1))) == [1], "another link counts by itself"


def test_a_new_sender_may_be_a_minute_behind():
    late = EPOCH_S + 1000.0
    assert heard(Signing(KEY, start_unix_s=late), frame(Signing(KEY, start_unix_s=late - 59.9))) == [1]
    assert heard(Signing(KEY, start_unix_s=late), frame(Signing(KEY, start_unix_s=late - 60.1))) == [0]


def test_a_forged_time_stamp_locks_nobody_out():
    ours, writer = Signing(KEY), FrameWriter(255, 190, signing=Signing(KEY))
    assert heard(ours, writer.encode(START)) == [1]
    forged = bytearray(writer.encode(START))
    forged[-12:-6] = b"\xff" * 6
    assert heard(ours, bytes(forged), writer.encode(START)) == [0, 1]


def test_time_stamps_follow_the_clock_and_never_stand():
    now = [EPOCH_S + 10.0]
    writer = FrameWriter(1, 1, signing=Signing(KEY, clock=lambda: now[0]))
    stamps = []
    for step in (0.0, 0.0, 5.0, -100.0):
        now[0] += step
        stamps.append(int.from_bytes(writer.encode(START)[-12:-6], "little"))
    assert stamps == [1_000_001, 1_000_002, 1_500_001, 1_500_002]


def test_senders_cannot_fill_the_memory():
    ours = Signing(KEY)
    sent = [frame(Signing(KEY), source=(s, c)) for s in range(1, 12) for c in range(1, 101)]
    assert sum(heard(ours, *sent)) == 1024
    assert len(ours._heard) == 1024


def test_pymavlink_and_we_understand_each_other():
    theirs = mavlink.MAVLink(None, 255, 190)
    theirs.signing.secret_key, theirs.signing.sign_outgoing = KEY, True
    theirs.signing.timestamp = 12345
    assert heard(Signing(KEY), bytes(START.pack(theirs))) == [1]
    for message in (START, mavlink.MAVLink_protocol_version_message(200, 100, 200, [0] * 8, [0] * 8)):
        signing = Signing(KEY, link_id=message.get_msgId() & 255, start_unix_s=EPOCH_S + 5)
        (got,) = theirs.parse_buffer(frame(signing, message, (1, 1)))
        assert got.get_signed()
    theirs.signing.secret_key = OTHER
    with pytest.raises(mavlink.MAVError, match="signature"):
        theirs.parse_buffer(frame(Signing(KEY)))


def test_the_key_changes_only_where_it_may():
    ours = Signing()
    assert not ours.active
    assert heard(ours, frame(None)) == [1]
    with pytest.raises(LinkError, match="may not be changed"):
        ours.setup(KEY)
    ours = Signing(may_setup=True)
    ours.setup(KEY, 100)
    assert heard(ours, frame(None), frame(Signing(KEY))) == [0, 1]
    ours.setup(bytes(32))
    assert not ours.active


def test_keys_and_links_that_are_none():
    with pytest.raises(LinkError, match="31 bytes"):
        Signing(bytes(31))
    with pytest.raises(LinkError, match="link 256"):
        Signing(KEY, link_id=256)
    with pytest.raises(LinkError, match="empty"):
        key_from_text(" ")
    with pytest.raises(LinkError, match="1 bytes"):
        Signing(may_setup=True).setup(b"x")
    assert key_from_text("6b" * 32) == KEY
    assert key_from_text("g" * 64) != key_from_text("phrase")


def test_the_key_is_not_shown():
    assert "k" * 8 not in repr(Signing(KEY))
    assert KEY.hex() not in repr(Signing(KEY))
