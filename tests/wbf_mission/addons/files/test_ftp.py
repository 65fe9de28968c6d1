"""MAVLink FTP: the packets, the files, the protocol, and what each autopilot has in its files."""

import json
import lzma
import math
import re
import struct
import zlib

import pytest
from ftp_client import Client
from hypothesis import given, settings
from hypothesis import strategies as st
from sweeps import sweep

from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import FrameReader
from mission.model import GeoPoint
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import get_autopilot
from sim_vehicle.mavlink.vehicle import SimVehicle
from wbf_mission.addons.files import extra
from wbf_mission.addons.files.file_tree import FileTree, FtpError
from wbf_mission.addons.files.ftp import ACK, MOST_DATA, NAK, FtpServer, Operation, Packet

HOME = GeoPoint(28.05, -82.15, 10.0)
TEXT = bytes(range(256)) * 5


def of_vehicle(name, kind="quad"):
    """The FTP of a whole vehicle, as a server."""
    vehicle = SimVehicle(get_vehicle(kind), HOME, autopilot=get_autopilot(name))
    vehicle.poll(0.0)
    return vehicle


def client():
    return Client(FtpServer(FileTree(("/", "/logs"), made={"/etc/a.txt": lambda _query, _size: b"fixed"})))


def test_a_file_is_written_read_listed_and_removed():
    one = client()
    one.write("/logs/flight.bin", TEXT)
    assert one.read("/logs/flight.bin") == TEXT
    assert one.read("logs/./flight.bin", size=80) == TEXT
    assert one.ask(Operation.LIST, "/logs") == f"Fflight.bin\t{len(TEXT)}\0".encode()
    assert one.ask(Operation.LIST, "/logs", offset=1) is FtpError.END_OF_FILE
    assert struct.unpack("<I", one.ask(Operation.CHECKSUM, "/logs/flight.bin"))[0] == (
        zlib.crc32(TEXT, 0xFFFFFFFF) ^ 0xFFFFFFFF
    )
    assert one.ask(Operation.TRUNCATE, "/logs/flight.bin", offset=10) == b""
    assert one.read("/logs/flight.bin") == TEXT[:10]
    assert one.ask(Operation.RENAME, b"/logs/flight.bin\0/logs/other.bin\0") == b""
    assert one.read("/logs/flight.bin") is FtpError.NOT_FOUND
    assert one.ask(Operation.REMOVE, "/logs/other.bin") == b""
    assert one.ask(Operation.REMOVE, "/logs/other.bin") is FtpError.NOT_FOUND


def test_directories():
    one = client()
    assert one.ask(Operation.MAKE_DIRECTORY, "/logs/new") == b""
    assert one.ask(Operation.MAKE_DIRECTORY, "/logs/new") is FtpError.FILE_EXISTS
    one.write("/logs/new/a", b"1")
    assert one.ask(Operation.REMOVE_DIRECTORY, "/logs/new") is FtpError.FAIL
    assert one.ask(Operation.REMOVE, "/logs/new/a") == b""
    assert one.ask(Operation.REMOVE_DIRECTORY, "/logs/new") == b""
    assert one.ask(Operation.LIST, "/logs/new") is FtpError.NOT_FOUND
    assert one.ask(Operation.LIST, "/") == b"Detc\0Dlogs\0"
    assert one.ask(Operation.CREATE, "/nowhere/a") is FtpError.NOT_FOUND


@pytest.mark.parametrize("path", ["/logs/../secret", "..", "/a/../../b", "/" + "d/" * 9])
def test_no_path_leads_out(path):
    one = client()
    for operation in (Operation.LIST, Operation.OPEN_TO_READ, Operation.CREATE, Operation.REMOVE):
        assert isinstance(one.ask(operation, path), FtpError)


def test_fixed_files_stay_as_they_are():
    one = client()
    assert one.read("/etc/a.txt") == b"fixed"
    for operation in (Operation.CREATE, Operation.OPEN_TO_WRITE, Operation.REMOVE, Operation.TRUNCATE):
        assert one.ask(operation, "/etc/a.txt") is FtpError.PROTECTED
    assert one.ask(Operation.RENAME, b"/etc/a.txt\0/b") is FtpError.PROTECTED


def test_a_burst_comes_in_parts_and_ends_with_the_file():
    one = client()
    data = TEXT * 30  # 38400 bytes: more than a burst
    one.write("/a", data)
    one.ask(Operation.OPEN_TO_READ, "/a")
    got, offset, now_s = bytearray(), 0, 0.0
    ended = False
    while not ended:
        packets = one.send(Packet(9, 0, Operation.BURST, MOST_DATA, offset=offset), now_s)
        while one.server.due_s < float("inf"):
            assert len(packets) <= 100
            now_s = one.server.due_s
            packets += [Packet.parse(bytes(r.payload)) for r in one.server.poll(now_s)]
        assert [p.sequence for p in packets] == [10 + i for i in range(len(packets))]
        for packet in packets:
            if packet.operation == NAK:
                assert packet.data == bytes([FtpError.END_OF_FILE])
                ended = True
            else:
                assert packet.offset == len(got)
                got += packet.data
        assert ended or packets[-1].complete
        offset = len(got)
    assert bytes(got) == data


def test_a_request_again_gets_the_same_answer_and_is_done_once():
    one = client()
    request = Packet(5, 0, Operation.CREATE, data=b"/x")
    first = one.send(request)
    write = Packet(6, 0, Operation.WRITE, data=b"abc")
    assert one.send(write) == one.send(write)
    remove = Packet(7, 0, Operation.REMOVE, data=b"/x")
    assert [p.operation for p in one.send(remove) + one.send(remove)] == [ACK, ACK]
    assert first[0].operation == ACK


def test_sessions_are_each_clients_own_and_few():
    one = client()
    other = Client(one.server, source=254)
    one.write("/a", b"one")
    for session in range(8):
        assert one.ask(Operation.OPEN_TO_READ, "/a", session=session) == struct.pack("<I", 3)
    assert other.ask(Operation.OPEN_TO_READ, "/a") is FtpError.NO_SESSIONS
    assert other.ask(Operation.READ, size=10) is FtpError.INVALID_SESSION
    assert one.ask(Operation.WRITE, b"x", session=1) is FtpError.FAIL
    one.ask(Operation.RESET)
    assert other.ask(Operation.OPEN_TO_READ, "/a") == struct.pack("<I", 3)
    assert one.ask(Operation.READ, size=10, session=3) is FtpError.INVALID_SESSION


def test_there_is_room_for_so_much():
    one = client()
    assert one.ask(Operation.CREATE, "/big") == b""
    assert one.ask(Operation.WRITE, b"x", offset=2**32 - 10) is FtpError.FAIL
    assert one.ask(Operation.WRITE, b"x", offset=3_999_998) == b""
    assert one.ask(Operation.WRITE, b"xy", offset=3_999_999) is FtpError.FAIL
    made = 0
    while one.ask(Operation.MAKE_DIRECTORY, f"/d{made}") == b"":
        made += 1
    assert 400 < made < 520


@sweep(few=80, many=400)
@given(st.lists(st.binary(max_size=251), max_size=12), st.integers(0, 15))
def test_any_bytes_are_answered_or_ignored(payloads, operation):
    one = client()
    for payload in payloads:
        packed = bytearray(payload.ljust(251, b"\0"))
        packed[3] = operation if packed[3] % 2 else packed[3]
        message = m.MAVLink_file_transfer_protocol_message(0, 1, 1, list(packed))
        (crossed,) = FrameReader().feed(one.writer.encode(message))
        for reply in one.server.receive(crossed, 0.0):
            assert len(reply.payload) == 251
    one.server.poll(1.0)
    assert isinstance(one.ask(Operation.LIST, "/"), bytes)


@given(st.integers(0, 65535), st.integers(0, 255), st.sampled_from(Operation), st.binary(max_size=239))
def test_packets_survive_the_wire(sequence, session, operation, data):
    if operation in (Operation.READ, Operation.BURST):
        data = b""
    packet = Packet(sequence, session, operation, data=data, offset=sequence * 7)
    assert Packet.parse(packet.payload()) == packet


def unpacked(data):
    """Read param.pck as ArduPilot's comment at its head describes it."""
    magic, count, total = struct.unpack_from("<HHH", data)
    assert magic in (0x671B, 0x671C)
    found, before, at = {}, "", 6
    while at < len(data):
        if data[at] == 0:
            at += 1
            continue
        kind, flags = data[at] & 15, data[at] >> 4
        common, length = data[at + 1] & 15, (data[at + 1] >> 4) + 1
        name = before[:common] + data[at + 2 : at + 2 + length].decode()
        at += 2 + length
        code = {1: "<b", 2: "<h", 3: "<i", 4: "<f"}[kind]
        (value,) = struct.unpack_from(code, data, at)
        first = struct.unpack_from(code, data, at + struct.calcsize(code))[0] if flags & 1 else value
        at += struct.calcsize(code) * (1 + (flags & 1))
        found[name], before = (value, first), name
    assert len(found) == count
    return total, found


@pytest.mark.parametrize("read_size", [80, 239])
def test_ardupilots_parameters_are_one_file(read_size):
    server = of_vehicle("ardupilot")
    one = Client(server)
    total, found = unpacked(one.read("@PARAM/param.pck", read_size))
    table = server.firmware.parameters(server.pilot.spec, 1)
    assert total == len(found) == len(table)
    assert list(found) == [parameter.name for parameter in table]
    assert found["WPNAV_SPEED"] == (800.0, 800.0)
    set_speed = m.MAVLink_param_set_message(1, 1, b"WPNAV_SPEED", 700.0, 9)
    server.receive(set_speed, 0.0)
    _, changed = unpacked(one.read("@PARAM/param.pck?withdefaults=1", read_size))
    assert {name for name, (now, first) in changed.items() if now != first} == {"MIS_TOTAL", "WPNAV_SPEED"}
    assert changed["WPNAV_SPEED"] == (700.0, 800.0)


def test_a_part_of_the_parameters():
    one = Client(of_vehicle("ardupilot"))
    _, everything = unpacked(one.read("@PARAM/param.pck"))
    total, part = unpacked(one.read("@PARAM/param.pck?start=5&count=3"))
    assert total == len(everything)
    assert list(part) == list(everything)[5:8]
    for query in ("start=99999", "count=x", "start=65000", "withdefaults=2", "other=1"):
        one.ask(Operation.OPEN_TO_READ, f"@PARAM/param.pck?{query}")
        assert one.ask(Operation.READ, size=200) is FtpError.FAIL
        one.ask(Operation.TERMINATE)
    assert one.ask(Operation.REMOVE, "@PARAM/param.pck") is FtpError.PROTECTED


def test_values_do_not_cross_from_one_read_to_the_next():
    server = of_vehicle("ardupilot")
    data = Client(server).read("@PARAM/param.pck", 80)
    at, ends = 6, []
    while at < len(data):
        if data[at] == 0:
            at += 1
            continue
        width = {1: 1, 2: 2, 3: 4, 4: 4}[data[at] & 15]
        at += 2 + (data[at + 1] >> 4) + 1 + width
        ends.append((at, width))
    assert all(end % 80 == 0 or end % 80 >= width for end, width in ends)


@pytest.mark.parametrize("kind", ["quad", "fixed-wing"])
def test_px4_describes_its_parameters_in_files(kind):
    server = of_vehicle("px4", kind)
    ask = m.MAVLink_command_long_message(1, 1, 512, 0, 397, 0, 0, 0, 0, 0, 0)
    answers = server.receive(ask, 0.0)
    (told,) = [answer for answer in answers if answer.get_type() == "COMPONENT_METADATA"]
    address = told.uri if isinstance(told.uri, str) else told.uri.decode()
    one = Client(server)
    raw = one.read(address.rstrip("\0").removeprefix("mftp://"))
    assert zlib.crc32(raw, 0xFFFFFFFF) ^ 0xFFFFFFFF == told.file_crc
    (kind_of_file,) = json.loads(lzma.decompress(raw))["metadataTypes"]
    raw = one.read(kind_of_file["uri"].removeprefix("mftp://"))
    assert zlib.crc32(raw, 0xFFFFFFFF) ^ 0xFFFFFFFF == kind_of_file["fileCrc"]
    entries = {entry["name"]: entry for entry in json.loads(lzma.decompress(raw))["parameters"]}
    table = server.firmware.parameters(server.pilot.spec, 1)
    assert set(entries) == {parameter.name for parameter in table}
    assert entries["NAV_ACC_RAD"]["type"] == "Float" and entries["GF_ACTION"]["type"] == "Int32"
    assert one.ask(Operation.REMOVE, address.removeprefix("mftp://")) is FtpError.PROTECTED


def told_parameters(kind="quad"):
    client = Client(of_vehicle("px4", kind))
    return json.loads(lzma.decompress(client.read("/etc/extras/parameters.json.xz")))


def test_ranges_and_units_are_told():
    told = told_parameters()["parameters"]
    by_name = {entry["name"]: entry for entry in told}
    assert {"min": 0.5, "max": 8.0, "units": "m/s"}.items() <= by_name["MPC_Z_V_AUTO_UP"].items()
    assert {"min": 1, "max": 6, "default": 2}.items() <= by_name["NAV_RCL_ACT"].items()
    assert by_name["MPC_LAND_CRWL"]["min"] == 0.1
    assert "max" not in by_name["MPC_LAND_CRWL"]
    assert "min" not in by_name["COM_DISARM_PRFLT"]
    assert by_name["MPC_XY_CRUISE"]["units"] == "m/s"
    assert sum("min" in entry or "max" in entry for entry in told) > 640


def test_groups_choices_bits_and_steps_are_told():
    by_name = {entry["name"]: entry for entry in told_parameters()["parameters"]}
    assert by_name["GF_ACTION"]["group"] == "Geofence"
    assert by_name["GF_ACTION"]["values"][3] == {"value": 3, "description": "Return mode"}
    assert by_name["RC1_REV"]["values"][0] == {"value": -1.0, "description": "Reverse"}
    assert by_name["EKF2_GPS_CTRL"]["bitmask"][1] == {"index": 1, "description": "Altitude"}
    assert by_name["SENS_BOARD_ROT"]["values"][1]["description"] == "Yaw 45°"
    assert by_name["MAV_SYS_ID"]["rebootRequired"] is True
    assert "rebootRequired" not in by_name["MPC_XY_P"]
    assert (by_name["MPC_XY_P"]["decimalPlaces"], by_name["MPC_XY_P"]["increment"]) == (2, 0.1)


# Of parameter.schema.json in mavlink/mavlink, component_metadata/: the keys that there are, and their types.
SCHEMA = {
    "name": str,
    "type": str,
    "shortDesc": str,
    "longDesc": str,
    "units": str,
    "default": (int, float),
    "decimalPlaces": int,
    "min": (int, float),
    "max": (int, float),
    "increment": (int, float),
    "rebootRequired": bool,
    "group": str,
    "category": str,
    "volatile": bool,
    "values": list,
    "bitmask": list,
    "readOnly": bool,
}
# The vehicle returns at a low battery, by a value that PX4 1.17 no longer lists (docs/vehicle-model.md).
NO_CHOICE = {"COM_LOW_BAT_ACT"}
NUMBER = {"Int32": int, "Float": float}


@pytest.mark.parametrize("kind", ["quad", "fixed-wing", "rover"])
def test_the_parameter_file_keeps_to_the_schema_of_component_metadata(kind):
    whole = told_parameters(kind)
    assert whole.keys() == {"version", "parameters"} and whole["version"] == 1
    names = [entry["name"] for entry in whole["parameters"]]
    assert len(set(names)) == len(names)
    for entry in whole["parameters"]:
        name = entry["name"]
        assert entry.keys() <= SCHEMA.keys(), name
        assert all(isinstance(value, SCHEMA[key]) for key, value in entry.items()), name
        assert re.fullmatch(r"[.\-a-zA-Z0-9_{}]{1,16}", name)
        number = NUMBER[entry["type"]]
        for key in {"default", "min", "max", "increment"} & entry.keys():
            assert type(entry[key]) is number, (name, key)
        assert entry.get("min", -math.inf) <= entry["default"] <= entry.get("max", math.inf), name
        assert entry.get("decimalPlaces", 0) >= 0 and entry.get("increment", 1) > 0, name
        values = entry.get("values", [])
        assert all(value.keys() == {"value", "description"} for value in values), name
        assert all(type(value["value"]) is number and value["description"] for value in values), name
        if values:
            assert len({value["value"] for value in values}) == len(values), name
            assert entry["default"] in {value["value"] for value in values} or name in NO_CHOICE, name
        bits = entry.get("bitmask", [])
        assert all(bit.keys() == {"index", "description"} and bit["description"] for bit in bits), name
        assert [bit["index"] for bit in bits] == list(range(len(bits))), name
        if bits:
            assert 0 <= entry["default"] < 1 << len(bits), name
            assert entry.get("max", 0) < 1 << len(bits), name


def test_ardupilot_has_no_component_metadata():
    ask = m.MAVLink_command_long_message(1, 1, 512, 0, 397, 0, 0, 0, 0, 0, 0)
    answers = of_vehicle("ardupilot").receive(ask, 0.0)
    assert [a.result for a in answers if a.get_type() == "COMMAND_ACK"] == [4]


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
def test_the_list_of_logs_is_empty_and_says_so(name):
    answers = of_vehicle(name).receive(m.MAVLink_log_request_list_message(1, 1, 0, 65535), 0.0)
    (entry,) = [answer for answer in answers if answer.get_type() == "LOG_ENTRY"]
    assert (entry.id, entry.num_logs, entry.last_log_num, entry.size) == (0, 0, 0, 0)


def upload(*entries):
    """Parameters as MAVProxy sends them, without common beginnings."""
    body = b"".join(
        bytes([kind, len(name) - 1 << 4]) + name + struct.pack(code, value)
        for kind, code, name, value in entries
    )
    return struct.pack("<HHH", 0x671B, len(entries), 6 + len(body)) + body


def put(client, path, data):
    assert client.ask(Operation.CREATE, path) == b""
    assert client.ask(Operation.WRITE, data) == b""
    return client.ask(Operation.TERMINATE)


def test_parameters_are_written_as_a_file():
    server = of_vehicle("ardupilot")
    data = upload((4, "<f", b"WPNAV_SPEED", 600.0), (1, "<b", b"FS_THR_ENABLE", 3), (2, "<h", b"NO_SUCH", 1))
    client = Client(server)
    assert put(client, "@PARAM/param.pck", data) == b""
    pilot = server.pilot
    assert pilot.parameters.cruise_speed_m_s == pytest.approx(6.0)
    assert pilot.parameters.stored["FS_THR_ENABLE"] == 3.0
    for wrong in (b"", data[:-1], data[:6], data.replace(b"WPNAV", b"WPN\xffV")):
        assert put(client, "@PARAM/param.pck", wrong) is FtpError.FAIL


@given(st.binary(max_size=120))
@settings(max_examples=200)
def test_any_bytes_are_parameters_or_none(data):
    head = struct.pack("<HHH", 0x671B, 3, 6 + len(data))
    values = extra.unpacked(head + data)
    assert values is None or len(values) == 3
