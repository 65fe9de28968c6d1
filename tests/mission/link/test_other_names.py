"""A pymavlink whose private attributes have other names: the same frames, by its own codec."""

import json
import subprocess
import sys

EXCHANGE = """
import json
from mission.link import FrameReader, FrameWriter
from mission.link.codec.dialect import IS_KNOWN_INSIDE, mavlink as m

sent = [
    m.MAVLink_heartbeat_message(2, 12, 81, 65536, 4, 3),
    m.MAVLink_statustext_message(6, b"text"),
    m.MAVLink_param_value_message(b"WPNAV_SPEED", 500.0, 9, 900, 3),
    m.MAVLink_mission_ack_message(255, 190, 0, 0, 77),
    m.MAVLink_mission_count_message(1, 1, 12, 0),
    m.MAVLink_component_metadata_message(5, 6, b"mftp://general.json"),
    m.MAVLink_v2_extension_message(1, 2, 3, 4, list(range(249))),
    m.MAVLink_actuator_control_target_message(1, 0, [0.5] * 8),
]
writer, reader = FrameWriter(7, 8), FrameReader()
frames = [writer.encode(message) for message in sent]
got = [message for frame in frames for message in reader.feed(frame)]
fields = [{name: getattr(message, name) for name in type(message).fieldnames} for message in got]
sources = [(message.get_type(), message.get_srcSystem(), message.get_seq()) for message in got]
print(IS_KNOWN_INSIDE, json.dumps([[frame.hex() for frame in frames], fields, sources]))
"""

RENAME = r"""
import importlib.util, re, sys

spec = importlib.util.find_spec("pymavlink.dialects.v20.all")
source = spec.loader.get_data(spec.origin).decode()
private = "header|payload|msgbuf|crc|fieldnames|type|signed|link_id|instances|instance_field|pack"
source = re.sub(rf"(\.| )_({private})\b", r"\1_other_\2", source)
source = re.sub(r"\._(\w+)_raw\b", r"._other_\1", source)
module = importlib.util.module_from_spec(spec)
sys.modules[spec.name] = module
exec(compile(source, spec.origin, "exec"), vars(module))
"""


def exchanged(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    known, _, answers = done.stdout.partition(" ")
    return known, json.loads(answers)


def test_frames_are_the_same_without_the_private_names_of_pymavlink():
    known, expected = exchanged(EXCHANGE)
    assert (known, len(expected[1])) == ("True", 8)
    assert exchanged(RENAME + EXCHANGE) == ("False", expected)
