"""Framing against pymavlink's own codec, and against garbage."""

from __future__ import annotations

import struct

import pytest
from fastcrc import crc16
from hypothesis import given, settings
from hypothesis import strategies as st
from sweeps import sweep

from mission.link import FrameReader, FrameWriter, MavlinkEndpoint, SourceStatistics, memory_pair
from mission.link.codec.dialect import mavlink
from mission.link.codec.frames import decode_frame
from mission.link.codec.signing import Signing

RANGES = {
    "b": (-(2**7), 2**7 - 1),
    "B": (0, 2**8 - 1),
    "h": (-(2**15), 2**15 - 1),
    "H": (0, 2**16 - 1),
    "i": (-(2**31), 2**31 - 1),
    "I": (0, 2**32 - 1),
    "q": (-(2**63), 2**63 - 1),
    "Q": (0, 2**64 - 1),
}
CODES = {
    "int8_t": "b",
    "uint8_t": "B",
    "uint8_t_mavlink_version": "B",
    "int16_t": "h",
    "uint16_t": "H",
    "int32_t": "i",
    "uint32_t": "I",
    "int64_t": "q",
    "uint64_t": "Q",
}
TYPES = sorted(mavlink.mavlink_map.values(), key=lambda kind: kind.id)


def field(kind, index):
    """A strategy for one field, in the order of the constructor."""
    name, code = kind.fieldnames[index], kind.fieldtypes[index]
    length = kind.array_lengths[kind.ordered_fieldnames.index(name)]
    if code == "char":
        return st.binary(min_size=int(not length), max_size=max(length, 1)).map(
            lambda text: text.replace(b"\0", b"x")
        )
    if code in ("float", "double"):
        one = st.floats(width=32, allow_nan=False)
    else:
        low, high = RANGES[CODES[code]]
        one = st.integers(low, high)
    return st.lists(one, min_size=length, max_size=length) if length else one


@st.composite
def messages(draw):
    kind = draw(st.sampled_from(TYPES))
    values = [draw(field(kind, index)) for index in range(len(kind.fieldnames))]
    return kind, values


@sweep(few=150, many=800)
@given(messages(), st.integers(0, 255))
def test_every_message_packs_and_parses_as_the_generated_codec_does(drawn, sequence):
    kind, values = drawn
    codec = mavlink.MAVLink(None, 7, 8)
    codec.seq = sequence
    expected = bytes(kind(*values).pack(codec))
    writer = FrameWriter(7, 8)
    writer.codec.seq = sequence
    assert writer.encode(kind(*values)) == expected
    assert writer.codec.seq == (sequence + 1) % 256
    reader = FrameReader()
    (got,) = reader.feed(expected)
    reference = codec.decode(bytearray(expected))
    assert type(got) is kind
    assert got.to_dict() == reference.to_dict()
    assert bytes(got.get_msgbuf()) == expected
    assert got == reference
    for name in ("get_srcSystem", "get_srcComponent", "get_seq", "get_msgId", "get_crc"):
        assert getattr(got, name)() == getattr(reference, name)()
    assert bytes(got.get_payload() or b"")[-1:] == bytes(expected[-3:-2])


def frames(number, *, system_id=1, start=0):
    writer = FrameWriter(system_id, 1)
    writer.codec.seq = start
    return [writer.encode(mavlink.MAVLink_mission_current_message(index)) for index in range(number)]


@sweep(few=30, many=200)
@given(st.binary(max_size=2000), st.data())
def test_garbage_never_raises_stalls_or_grows(garbage, data):
    reader = FrameReader()
    stream = garbage + b"".join(frames(40))
    at = 0
    got = []
    while at < len(stream):
        size = data.draw(st.integers(1, 400))
        got += reader.feed(stream[at : at + size])
        assert len(reader._pending) <= 280
        at += size
    # A false start can hold back at most one frame's length; everything before that has come out.
    got += reader.feed(b"\0" * 300)
    assert [message.seq for message in got if message.get_type() == "MISSION_CURRENT"][-5:] == list(
        range(35, 40)
    )


@given(st.lists(st.binary(max_size=300), max_size=20))
def test_a_datagram_with_a_frame_is_heard_at_once_whatever_came_before(datagrams):
    reader = FrameReader()
    for garbage in datagrams:
        reader.feed(garbage)
    got = reader.feed(frames(1, system_id=42)[0])
    assert got[-1].get_srcSystem() == 42


@given(st.data())
def test_mutated_frames_are_refused_and_the_next_is_heard(data):
    frame = bytearray(frames(1)[0])
    for _ in range(data.draw(st.integers(1, 4))):
        frame[data.draw(st.integers(0, len(frame) - 1))] ^= data.draw(st.integers(1, 255))
    reader = FrameReader()
    got = reader.feed(bytes(frame) + b"".join(frames(30, system_id=9)) + b"\0" * 300)
    assert [m.seq for m in got if m.get_srcSystem() == 9][-10:] == list(range(20, 30))


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(TYPES), st.binary(min_size=1, max_size=255), st.booleans())
def test_any_payload_with_a_good_checksum_decodes_as_the_generated_codec_does(kind, payload, older):
    if older and kind.id < 256:
        head = struct.pack("<BBBBBB", 0xFE, len(payload), 1, 2, 3, kind.id)
    else:
        head = struct.pack("<BBBBBBBHB", 0xFD, len(payload), 0, 0, 1, 2, 3, kind.id & 0xFFFF, kind.id >> 16)
    crc = crc16.mcrf4xx(bytes([kind.crc_extra]), crc16.mcrf4xx(head[1:] + payload))
    frame = head + payload + struct.pack("<H", crc)
    (got,) = FrameReader().feed(frame)
    reference = mavlink.MAVLink(None).decode(bytearray(frame))
    assert repr(got.to_dict()) == repr(reference.to_dict())
    assert got.get_srcSystem() == 2
    known = decode_frame(frame)
    assert repr(known.to_dict()) == repr(reference.to_dict())
    assert vars(known.get_header()) == vars(got.get_header())


def test_version_1_frames_are_read():
    codec = mavlink.MAVLink(None, 3, 4)
    frame = mavlink.MAVLink_mission_request_message(1, 1, 5).pack(codec, force_mavlink1=True)
    (message,) = FrameReader().feed(bytes(frame))
    assert (message.seq, message.get_srcSystem(), message.mission_type) == (5, 3, 0)


def test_unknown_messages_are_counted_and_skipped():
    head = struct.pack("<BBBBBBBHB", 0xFD, 4, 0, 0, 1, 1, 1, 0xFFF0, 0x7F)
    unknown = head + b"\xfd\xfe\0\0" + b"\x11\x22"
    reader = FrameReader()
    got = reader.feed(frames(1)[0] + unknown + frames(1, start=2)[0])
    assert len(got) == 2
    assert reader.unknown == 1
    assert reader.sources[1, 1].lost == 0


def test_an_unknown_frame_is_believed_only_where_a_frame_or_the_end_follows():
    good = frames(1)[0]
    head = struct.pack("<BBBBBBBHB", 0xFD, len(good), 0, 0, 1, 1, 1, 0xFFF0, 0x7F)
    # Something that looks like the head of an unknown frame must not swallow the frame behind it.
    reader = FrameReader()
    assert len(reader.feed(head + good + b"\x11\x22" + b"\x00" + frames(1, start=1)[0])) == 2
    assert (reader.unknown, reader.frames) == (0, 2)
    for end in (b"", frames(1, start=1)[0]):
        reader = FrameReader()
        reader.feed(head + good + b"\x11\x22" + end)
        assert (reader.unknown, reader.frames) == (1, bool(end))


def test_unwanted_messages_are_counted_but_not_decoded():
    ours, theirs = memory_pair()
    seen = []
    endpoint = MavlinkEndpoint(ours, 255, 190, wanted={0}, tap=lambda frame, sent: seen.append((frame, sent)))
    sender = MavlinkEndpoint(theirs, 1, 1)
    sender.send(mavlink.MAVLink_mission_current_message(3))
    sender.send(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3))
    assert [m.get_type() for m in endpoint.receive()] == ["HEARTBEAT"]
    assert endpoint.reader.frames == 2
    assert [sent for _, sent in seen] == [False, False]
    endpoint.send(mavlink.MAVLink_mission_current_message(3))
    assert seen[-1][1] is True
    endpoint.reader.wanted = None
    sender.send(mavlink.MAVLink_mission_current_message(3))
    assert len(endpoint.receive()) == 1
    assert [sent for _, sent in seen].count(True) == 1


@pytest.mark.parametrize(
    ("sequences", "lost", "late"),
    [
        ([254, 255, 0, 1], 0, 0),
        ([0, 1, 5], 3, 0),
        ([0, 1, 1, 2], 0, 1),
        ([0, 2, 1, 3], 1, 1),
        ([0, 128, 129], 127, 0),
        ([0, 129], 0, 1),
    ],
)
def test_losses_by_sequence(sequences, lost, late):
    source = SourceStatistics()
    for sequence in sequences:
        source.count(sequence)
    assert (source.received, source.lost, source.late) == (len(sequences), lost, late)


def test_a_field_out_of_range_raises_and_keeps_the_sequence():
    writer = FrameWriter(1, 1)
    with pytest.raises(struct.error):
        writer.encode(mavlink.MAVLink_mission_current_message(70000))
    assert writer.codec.seq == 0


@pytest.mark.parametrize("signed", [False, True])
def test_a_frame_with_the_sequence_number_of_another_link_is_sound(signed):
    signing = Signing(b"k" * 32) if signed else None
    one, other = FrameWriter(1, 1, signing=signing), FrameWriter(1, 1, signing=signing)
    messages = [mavlink.MAVLink_mission_ack_message(255, 190, result) for result in range(5)]
    frames = [one.encode(message) for message in messages[:3]]
    other.skip()
    renumbered = [other.renumber(frame) for frame in frames] + [other.encode(messages[3])]
    read = [decode_frame(frame) for frame in renumbered]
    assert [message.get_seq() for message in read] == [1, 2, 3, 4]
    assert [message.type for message in read] == [0, 1, 2, 3]
    heard = Signing(b"k" * 32)
    assert all(heard.accepts(frame, 47) for frame in renumbered) is signed
