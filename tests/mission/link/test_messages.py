"""The stub of the dialect is up to date, and the messages that are built have the fields that it tells."""

import inspect
import re

import pytest
import write_message_stub

from mission.link.codec.dialect import mavlink
from mission.link.codec.typed import handler, is_a, is_command

TEXT = write_message_stub.STUB.read_text(encoding="utf-8")
CLASSES = re.findall(r"^class (MAVLink_\w+_message)\(.*\n((?:    \w+: .*\n)*)", TEXT, re.MULTILINE)


def test_the_stub_is_what_the_script_writes():
    assert write_message_stub.stub() == TEXT, "run python tools/write_message_stub.py"


@pytest.mark.parametrize(("name", "fields"), CLASSES)
def test_a_message_has_the_fields_of_the_stub(name, fields):
    kind = getattr(mavlink, name)
    typed = dict(re.findall(r"    (\w+): (.*?)(?: = \.\.\.)?\n", fields))
    assert list(typed) == kind.fieldnames
    given = {"bytes": b"ab", "str": b"ab", "int": 1, "float": 1.5}
    counts = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    values = []
    for field, written in typed.items():
        one = given[re.sub(r"Sequence\[(\w+)\]", r"\1", written)]
        values.append([one] * counts[field] if written.startswith("Sequence") else one)
    message = kind(*values)
    types = {"str": str, "int": int, "float": float}
    for field, written in typed.items():
        value = getattr(message, field)
        several = written.startswith("Sequence")
        assert isinstance(value[0] if several else value, types[re.sub(r"Sequence\[(\w+)\]", r"\1", written)])


def test_the_stub_knows_the_codecs_own_parts():
    for name in ("MAVLink_message", "MAVLink", "MAVError", "enums", "mavlink_map"):
        assert hasattr(mavlink, name)
    methods = re.search(r"^class MAVLink_message:\n((?:    .*\n)*)", TEXT, re.MULTILINE)[1]
    for name in re.findall(r"def (\w+)", methods):
        assert inspect.isfunction(getattr(mavlink.MAVLink_message, name))


def test_messages_are_told_apart_by_id():
    command = mavlink.MAVLink_command_long_message(1, 1, 400, 0, *[0.0] * 7)
    assert is_command(command)
    assert is_a(command, mavlink.MAVLink_command_long_message)
    assert not is_a(command, mavlink.MAVLink_command_int_message)
    ack = mavlink.MAVLink_mission_ack_message(1, 1, 0)
    assert not is_command(ack)
    assert handler(mavlink.MAVLink_mission_ack_message, len) == (47, len)
