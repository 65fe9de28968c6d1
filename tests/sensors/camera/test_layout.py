"""The layout of readings of any fields, and how their names are told."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from sweeps import sweep

from geo import get_farm
from mission.link.codec.dialect import mavlink
from sensors.camera.layout import ARRAY_FLOATS, FIELDS_NAME, Announcement, LeafLayout
from sensors.camera.wire import ObservationAssembler
from sensors.fields import PAPER_FIELDS

FARM = get_farm("miniberry-10")
names = st.lists(
    st.from_regex(r"[a-z][a-z0-9_]{0,23}", fullmatch=True), min_size=1, max_size=16, unique=True
).map(tuple)


def wire(message: Any) -> Any:
    sender, receiver = mavlink.MAVLink(None, 1, 100), mavlink.MAVLink(None)
    return receiver.parse_buffer(message.pack(sender))[0]


def array(name: str, number: int, data: list[float], time_us: int = 5000) -> Any:
    padded = data + [0.0] * (ARRAY_FLOATS - len(data))
    return wire(mavlink.MAVLink_debug_float_array_message(time_us, name.encode(), number, padded))


def image(index: int, x: int, y: int) -> Any:
    latitude, longitude = FARM.frame.to_wgs84(*FARM.cell_centre(x, y))
    where = round(latitude * 1e7), round(longitude * 1e7)
    return wire(
        mavlink.MAVLink_camera_image_captured_message(
            5, 0, 0, *where, 40000, 10000, (0.5**0.5, 0.0, -(0.5**0.5), 0.0), index, 1, b""
        )
    )


def sent(fields: tuple[str, ...], values: list[list[float]], side: int) -> list[Any]:
    layout = LeafLayout.of(fields)
    return [image(3, 4, 5), *(array(layout.name, 3, data) for data in layout.pack(3, side, values))]


@sweep(few=30, many=200)
@given(names, st.integers(1, 4), st.randoms(use_true_random=False))
def test_readings_of_any_fields_arrive_bit_for_bit(fields: tuple[str, ...], side: int, luck: Any) -> None:
    values = np.array([[luck.random() for _ in fields] for _ in range(side * side)], np.float32)
    messages = sent(fields, values.tolist(), side)
    luck.shuffle(messages)
    assembler = ObservationAssembler(FARM, day=6, fields=fields)
    for message in messages:
        assembler.add(message)
    seen = assembler.take()
    assert seen.fields == fields
    np.testing.assert_array_equal(seen.values, values)
    assert assembler.mismatch() is None


@sweep(few=40, many=200)
@given(names, st.randoms(use_true_random=False))
def test_names_are_told_in_parts_in_any_order(fields: tuple[str, ...], luck: Any) -> None:
    heard = Announcement()
    parts = list(enumerate(LeafLayout.of(fields).announcement()))
    luck.shuffle(parts)
    assert all(heard.add(*part) for part in parts)
    assert heard.fields == (None if fields == PAPER_FIELDS.names else fields)


def test_the_benchmarks_fields_travel_as_they_always_did() -> None:
    layout = LeafLayout.of(PAPER_FIELDS.names)
    assert (layout.name, layout.cells_per_array, layout.announcement()) == ("WBF_LEAF", 18, [])
    assert layout.pack(7, 1, [[1.0, 0.5, 0.25]]) == [[7.0, 1.0, 0.0, 1.0, 0.5, 0.25]]


def test_readings_of_other_fields_are_no_observations_and_said() -> None:
    four, other = ("tylcv", "ccr", "soil", "nitrogen"), ("tylcv", "ccr", "soil", "rust")
    for expected, found in ((PAPER_FIELDS.names, four), (four, PAPER_FIELDS.names), (four, other)):
        assembler = ObservationAssembler(FARM, day=6, fields=expected)
        for message in sent(found, [[0.5] * len(found)], 1):
            assembler.add(message)
        assert len(assembler.take()) == 0
        assert assembler.statistics.other_fields == 1
        told = assembler.mismatch()
        assert told is not None
        assert f"other fields than {', '.join(expected)}; give" in told
    for number, data in enumerate(LeafLayout.of(other).announcement()):
        assembler.add(array(FIELDS_NAME, number, data))
    assert "the camera senses tylcv, ccr, soil, rust instead of tylcv" in str(assembler.mismatch())


@sweep(few=30, many=200)
@given(st.integers(0, 65535), st.lists(st.floats(width=32), min_size=58, max_size=58))
def test_an_announcement_may_be_anything(number: int, data: list[float]) -> None:
    heard = Announcement()
    heard.add(number, data)
    heard.add(0, [2.0, data[0], 3.0, 97.0, 44.0, 98.0, *data[6:]])
    assert heard.fields in (None, ("a", "b"))
