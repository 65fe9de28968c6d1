"""Frames, routing, and the shape of a component."""

import pytest

from mission.link.codec.dialect import mavlink
from sim_vehicle.host.router import RoutingTable, frame_id, frame_source, frame_target, target_offsets


def packed(message, system=1, component=1, seq=0, version_1=False):
    codec = mavlink.MAVLink(None, system, component)
    codec.seq = seq
    return message.pack(codec, force_mavlink1=version_1)


@pytest.mark.parametrize("version_1", [False, True])
def test_frame_facts(version_1):
    frame = packed(mavlink.MAVLink_command_long_message(7, 9, 400, *[0] * 8), 255, 190, version_1=version_1)
    assert frame_id(frame) == 76
    assert frame_source(frame) == (255, 190)
    assert frame_target(frame) == (7, 9)


def test_target_offsets_of_every_message_agree_with_the_codec():
    with_target = 0
    for message_id, kind in mavlink.mavlink_map.items():
        system_at, component_at = target_offsets(message_id)
        assert (system_at >= 0) == ("target_system" in kind.fieldnames)
        assert (component_at >= 0) == ("target_component" in kind.fieldnames)
        if system_at < 0:
            continue
        with_target += 1
        payload = bytearray(kind.unpacker.size)
        payload[system_at] = 77
        if component_at >= 0:
            payload[component_at] = 99
        values = kind.unpacker.unpack(payload)
        names = [
            name
            for name, length in zip(kind.ordered_fieldnames, kind.lengths, strict=True)
            for _ in range(length if not isinstance(values[0], bytes) else 1)
        ]
        if len(names) == len(values):
            assert values[names.index("target_system")] == 77
    assert with_target > 60


def test_routing_follows_what_was_heard():
    table = RoutingTable()
    table.learn("vehicle", (1, 1))
    table.learn("camera", (1, 100))
    table.learn("ground", (255, 190))
    ports = ["vehicle", "camera", "ground", "unknown"]
    assert table.destinations((0, 0), "vehicle", ports) == ["camera", "ground", "unknown"]
    assert table.destinations((1, 0), "ground", ports) == ["vehicle", "camera"]
    assert table.destinations((1, 100), "ground", ports) == ["camera"]
    assert table.destinations((1, 190), "ground", ports) == ["vehicle"]
    assert table.destinations((255, 190), "vehicle", ports) == ["ground"]
    assert table.destinations((9, 1), "ground", ports) == []
    table.forget("camera")
    assert table.destinations((1, 100), "ground", ports) == ["vehicle"]


def test_routing_table_does_not_grow_without_end():
    table = RoutingTable()
    for system in range(256):
        for component in range(4):
            table.learn("flood", (system, component))
    assert len(table._known["flood"]) == 256
