"""Fields and messages that are added to pymavlink's dialect."""

import pytest

from mission.link import FrameReader, FrameWriter
from mission.link.codec.additions import MESSAGES, Definition, crc_extra, extend
from mission.link.codec.dialect import mavlink as m

# As mavgen gives them for the definitions of https://github.com/mavlink/mavlink.
KNOWN_EXTRAS = {300: 217, 397: 182, 410: 160, 411: 106, 412: 33, 413: 77}


def crossed(message):
    (got,) = FrameReader().feed(FrameWriter(1, 1).encode(message))
    return got


def test_checksums_are_those_of_the_definitions():
    assert {d.number: crc_extra(d) for d in MESSAGES} == KNOWN_EXTRAS
    assert {d.number: m.mavlink_map[d.number].crc_extra for d in MESSAGES} == KNOWN_EXTRAS


def test_the_checksum_is_that_of_generated_messages():
    made = Definition.of(
        253, "STATUSTEXT", "uint8_t severity", "char[50] text"
    )  # without its extensions, which do not count
    assert crc_extra(made) == m.MAVLink_statustext_message.crc_extra


def test_the_generated_codec_packs_the_same_bytes():
    for message in (
        m.MAVLink_mission_ack_message(255, 190, 0, opaque_id=77),
        m.MAVLink_protocol_version_message(200, 100, 200, [1] * 8, [2] * 8),
        m.MAVLink_component_metadata_message(1, 2, b"mftp://general.json"),
        m.MAVLink_event_message(0, 0, 5, 6, 7, 8, list(range(40))),
    ):
        frame = FrameWriter(1, 1).encode(message)
        assert bytes(message.pack(m.MAVLink(None, 1, 1))) == frame
        again = m.MAVLink(None).decode(bytearray(frame))
        assert again.to_dict() == crossed(message).to_dict()
    assert crossed(m.MAVLink_component_metadata_message(1, 2, b"x")).uri == "x"
    event = crossed(m.MAVLink_event_message(0, 0, 5, 6, 7, 8, [9] * 40))
    assert (event.id, type(event).id, event.arguments) == (5, 410, [9] * 40)


def test_missing_and_unknown_fields_are_named():
    with pytest.raises(TypeError, match="PROTOCOL_VERSION: field min_version is missing"):
        m.MAVLink_protocol_version_message(200)
    for wrong in ({"nothing": 1}, {"type": 3}):
        with pytest.raises(TypeError, match="MISSION_ACK: its fields are"):
            m.MAVLink_mission_ack_message(255, 190, 0, **wrong)


def test_twice_is_once():
    before = m.MAVLink_mission_ack_message
    extend(m)
    assert m.MAVLink_mission_ack_message is before
