"""Messages whose header is made when it is asked for, against those that pymavlink makes."""

import copy
import importlib.util
import pickle

import pytest
from pymavlink.dialects.v20 import minimal

from mission.link import FrameReader, FrameWriter
from mission.link.codec.dialect import lighten
from mission.link.codec.dialect import mavlink as m

ASKED = (
    "header",
    "msgbuf",
    "payload",
    "crc",
    "fieldnames",
    "type",
    "msgId",
    "srcSystem",
    "srcComponent",
    "seq",
)
ASKED += ("signed", "link_id")


@pytest.fixture(scope="module")
def lean():
    """Return another copy of a dialect, with lean messages."""
    spec = importlib.util.find_spec("pymavlink.dialects.v20.minimal")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    lighten(module)
    lighten(module)
    return module


def told(message):
    """Return all that a message tells of its frame."""
    answers = {name: getattr(message, f"get_{name}")() for name in ASKED}
    answers |= {"header": vars(answers["header"]), "msgbuf": bytes(answers["msgbuf"])}
    return answers | {"fields": message.to_dict(), "text": str(message), "of": message._instance_field}


def heartbeat(dialect):
    return dialect.MAVLink_heartbeat_message(2, 12, 81, 65536, 4, 3)


def test_a_new_message_tells_what_pymavlinks_does(lean):
    assert told(heartbeat(lean)) == told(heartbeat(minimal))


def test_a_packed_and_a_decoded_message_tell_what_pymavlinks_do(lean):
    both = []
    for dialect in (lean, minimal):
        codec = dialect.MAVLink(None, 7, 8)
        codec.seq = 9
        message = heartbeat(dialect)
        frame = message.pack(codec)
        both.append((frame, told(message), told(codec.decode(bytearray(frame)))))
    assert both[0] == both[1]
    assert both[0][1]["srcSystem"] == 7


@pytest.mark.parametrize("repeat", [copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_copies_tell_the_same(repeat):
    (got,) = FrameReader().feed(FrameWriter(7, 8).encode(heartbeat(m)))
    again = repeat(got)
    assert told(again) == told(got)
    assert again == got
